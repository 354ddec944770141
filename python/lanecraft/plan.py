"""Lane-change paths alone: polynomials, candidates, and the planner that chooses among them (Eqs. 12–20).

Example:
    >>> from lanecraft.plan import Planner
    >>> from lanecraft.scene import Ego, Neighbors, Scene
    >>> scene = Scene(Ego(speed_mps=28.0, d_m=3.75), Neighbors(ahead_m=[45.0], speed_mps=[22.0], lane=[1]))
    >>> outcome = Planner().plan(scene, "left")
    >>> outcome.path.duration_s if outcome else outcome.refusal.words
    2.5
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import _arrays
from ._arrays import Floats
from ._lanecraft import Parts, PlannerCore, quintic_at, quintic_between, quintic_maxima
from .errors import ConfigError
from .scene import Scene, packed

__all__ = ["FEATURE_NAMES", "LaneChange", "Motion", "Planner", "Quintic", "Refusal"]

FEATURE_NAMES = (
    "stability",
    "collision",
    "comfort",
    "travel",
    "jerk",
    "lateral-acceleration",
    "time-headway",
    "time-to-collision",
    "follower",
)
"""Names of the features of a candidate, in their order (Eqs. 18, 19)."""

SHORTEST_S = 1e-2
LONGEST_S = 1e3


class Motion(NamedTuple):
    """Lateral motion at some times."""

    d_m: Floats
    """Position to the left of the reference line, m."""
    speed_mps: Floats
    """Speed to the left, m/s."""
    accel_mps2: Floats
    """Acceleration to the left, m/s²."""
    jerk_mps3: Floats
    """Jerk to the left, m/s³."""


@dataclass(frozen=True)
class Quintic:
    """A lateral motion d(t) = Σ c_i tⁱ on [0, ``duration_s``]; before and after it stays where it begins and ends.

    Args:
        coefficients: c_0 … c_5, m/sⁱ.
        duration_s: its duration, 0.01 to 1000 s.

    Example:
        >>> Quintic.between((0.0, 0.0, 0.0), 3.75, 4.0).max_accel_mps2
        1.3531...
    """

    coefficients: tuple[float, float, float, float, float, float]
    duration_s: float

    def __post_init__(self) -> None:
        found = _arrays.numbers("coefficients", self.coefficients)
        if found.shape != (6,):
            raise ConfigError(f"`coefficients` has shape {found.shape}, but must have (6,)")
        _arrays.bounded("coefficients", found, (6,), -1e30, 1e30)
        object.__setattr__(self, "coefficients", tuple(found.tolist()))
        object.__setattr__(self, "duration_s", _arrays.number("duration_s", self.duration_s, SHORTEST_S, LONGEST_S))

    @classmethod
    def between(cls, start: ArrayLike, end_m: float, duration_s: float) -> Quintic:
        """From a lateral state to rest.

        Args:
            start: position (m), speed (m/s) and acceleration (m/s²) to the left.
            end_m: position at the end, m.
            duration_s: time for it, 0.01 to 1000 s.
        """
        d_m, speed_mps, accel_mps2 = _arrays.bounded("start", start, (3,)).tolist()
        duration = _arrays.number("duration_s", duration_s, SHORTEST_S, LONGEST_S)
        return cls(quintic_between((d_m, speed_mps, accel_mps2), _arrays.number("end_m", end_m), duration), duration)

    def at(self, times_s: ArrayLike) -> Motion:
        """Position, speed, acceleration and jerk at ``times_s``, each of its shape; at rest outside of the duration."""
        times = _arrays.numbers("times_s", times_s)
        found = quintic_at(self.coefficients, self.duration_s, times.reshape(-1))
        return Motion(*(part.reshape(times.shape) for part in found))

    @property
    def max_speed_mps(self) -> float:
        """Largest lateral speed on the whole duration, m/s, from the roots of the acceleration."""
        return self._maxima()[0]

    @property
    def max_accel_mps2(self) -> float:
        """Largest lateral acceleration, m/s², from the roots of the jerk."""
        return self._maxima()[1]

    @property
    def max_jerk_mps3(self) -> float:
        """Largest lateral jerk, m/s³."""
        return self._maxima()[2]

    def _maxima(self) -> tuple[float, float, float]:
        return quintic_maxima(self.coefficients, self.duration_s)


@dataclass(frozen=True)
class Refusal:
    """Why a lane change is not allowed."""

    name: str
    """``no-lane``, ``lane-ends``, ``occupied``, ``lateral-limit``, ``target-leader``, ``current-leader``, ``follower``, ``empty-window``."""
    words: str
    """The same in a sentence."""


@dataclass(frozen=True, eq=False)
class LaneChange:
    """What the planner finds for one side; true if a lane change is allowed. Without one, the arrays are empty."""

    side: str
    """``"left"`` or ``"right"``."""
    refusal: Refusal | None
    """Why there is none."""
    from_lane: int | None
    """The lane it leaves."""
    to_lane: int | None
    """The lane it enters."""
    window_s: tuple[float, float] | None
    """Shortest and longest duration allowed, s."""
    candidates: tuple[Quintic, ...]
    """All paths within the lateral bounds, C of them, by rising duration."""
    features: Floats
    """Their features, shape (C, 9), in the order of :data:`FEATURE_NAMES`."""
    rewards: Floats
    """Their rewards, shape (C,)."""
    chosen: int | None
    """Index of the candidate with the highest reward, the shortest of equal ones."""

    def __bool__(self) -> bool:
        return self.refusal is None

    @property
    def path(self) -> Quintic | None:
        """The chosen candidate."""
        return None if self.chosen is None else self.candidates[self.chosen]


class Planner:
    """Plans lane changes; holds only parameters.

    Args:
        config: your own numbers laid over the preset, as for :class:`lanecraft.Env`: the sections ``planner``, ``road``, ``vehicle`` and
            ``prediction`` count.
        preset: ``"default"`` or ``"paper"``.
    """

    def __init__(self, config: Mapping[str, Any] | None = None, *, preset: str = "default") -> None:
        self._parts = Parts(_arrays.text("preset", preset), _arrays.settings(config))
        self._core = PlannerCore(self._parts)

    @property
    def config_toml(self) -> str:
        """The complete configuration, every key with its value."""
        return self._parts.config_toml

    def plan(self, scene: Scene, side: str) -> LaneChange:
        """The lane change to ``side`` (``"left"`` or ``"right"``), or why there is none."""
        name = _arrays.text("side", side)
        found, refused = self._core.plan(packed(scene, self._parts.lane_width_m), name)
        if refused is not None:
            nothing = np.empty((0, len(FEATURE_NAMES))), np.empty(0)
            return LaneChange(name, Refusal(*refused), None, None, None, (), *nothing, None)
        assert found is not None
        (from_lane, to_lane, shortest_s, longest_s), (paths, features, rewards, chosen) = found
        candidates = tuple(Quintic(tuple(row[:6]), row[6]) for row in paths.tolist())  # type: ignore[arg-type]
        return LaneChange(name, None, from_lane, to_lane, (shortest_s, longest_s), candidates, features, rewards, chosen)

    def path_to(self, scene: Scene, end_m: float, duration_s: float) -> Quintic | None:
        """The path from the ego's lateral state to rest at ``end_m`` (m) that takes ``duration_s`` (s), or as little longer as the
        lateral bounds ask for; ``None`` if no duration keeps them. The other vehicles do not count."""
        end, duration = _arrays.number("end_m", end_m), _arrays.number("duration_s", duration_s, SHORTEST_S, LONGEST_S)
        found = self._core.path_to(packed(scene, self._parts.lane_width_m), end, duration)
        return None if found is None else Quintic(*found)
