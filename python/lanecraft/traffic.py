"""The human traffic alone, and the formulas that its drivers follow.

>>> import lanecraft.traffic
>>> world = lanecraft.traffic.World(seed=1)
>>> world.step(20).overlaps
0
>>> world.speed_mps.shape == (len(world),)
True
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _lanecraft, _tasks
from ._lanecraft import WorldCore
from .errors import ConfigError

__all__ = ["Collision", "Events", "ExternalVehicle", "World", "idm", "safe_gap", "safe_speed"]

#: More steps than this in one call are a mistake.
_MOST_STEPS = 10**9


class Collision(NamedTuple):
    """A vehicle that the externally driven one touched, and whose fault it was."""

    id: int
    fault: str
    at_fault: bool


class Events(NamedTuple):
    """What happened in one or more steps."""

    #: Lane changes that human drivers began.
    lane_changes: int
    #: Pairs of human-driven vehicles that touched, counted in each step: always 0.
    overlaps: int
    collision: Collision | None


@dataclass(frozen=True)
class ExternalVehicle:
    """A vehicle that you drive and the traffic reacts to; positions are those of its center."""

    #: Along the road, m.
    s_m: float
    #: To the left of the reference line, m; ``World.lane_centers_m`` has those of the lanes.
    d_m: float
    #: Along its heading, m/s.
    speed_mps: float
    #: The lane that it keeps or changes into.
    target_lane: int
    #: Along its heading, m/s².
    accel_mps2: float = 0.0
    #: Relative to the road, positive to the left, rad.
    heading_rad: float = 0.0
    length_m: float = 4.8
    width_m: float = 1.9

    def _body(self) -> tuple[list[float], int]:
        names = ("s_m", "d_m", "heading_rad", "speed_mps", "accel_mps2", "length_m", "width_m")
        numbers = [_tasks.checked_real(name, getattr(self, name)) for name in names]
        return numbers, _arrays.whole("target_lane", self.target_lane, 0, 255)


class World(WorldCore):
    """Human drivers on a road; the same seed and configuration give the same bits everywhere.

    One step is ``env.control_period_s`` long. Numbers of the vehicles are arrays of shape (vehicles,) by rising ``id``, made anew at
    each access: ``id``, ``s_m``, ``d_m``, ``speed_mps``, ``lateral_speed_mps``, ``accel_mps2``, ``length_m``, ``width_m``, ``lane``
    and ``target_lane`` (equal to ``lane`` but during a lane change). Lanes count from the right.

    Args:
        preset: ``"default"`` or ``"paper"``.
        config: your own numbers laid over it, as for :class:`lanecraft.Env`; road and traffic count.
        scenario: name or path of a scenario, whose road and traffic stand for those of the configuration; one with a recording, too.
        seed: that of the scene, 0 to 2⁶⁴ − 1.

    Raises:
        ConfigError: a name, key or value that does not exist or is out of range, or a scene that is impossible.
    """

    def __new__(
        cls,
        *,
        preset: str = "default",
        config: Mapping[str, Any] | None = None,
        scenario: str | PathLike[str] | None = None,
        seed: int = 0,
    ) -> World:
        return super().__new__(cls, preset, *_tasks.checked_scene(config, scenario), _tasks.checked_seed(seed))

    def step(self, steps: int = 1, *, ego: ExternalVehicle | None = None) -> Events:
        """Lets the traffic drive, outside of Python's lock.

        Args:
            steps: how many steps; the sum of their events comes back.
            ego: your vehicle where it is *after* the step, which then must be one. Without, there is none on the road.
        """
        steps = _arrays.whole("steps", steps, 0, _MOST_STEPS)
        if ego is None:
            return _events(self._step(steps))
        if steps != 1:
            raise ConfigError(f"with an ego there is one step at a time, not {steps}")
        return _events(self._step_with(_checked(ego)._body()))

    def place(self, ego: ExternalVehicle) -> None:
        """Puts your vehicle on the road before its first step; ``ego_start`` (s_m, lane, speed_mps) is where there is room for it."""
        self._place(_checked(ego)._body())


def _checked(ego: Any) -> ExternalVehicle:
    if not isinstance(ego, ExternalVehicle):
        raise TypeError(f"ego is an ExternalVehicle, not {type(ego).__name__}")
    return ego


def _events(events: tuple[int, int, tuple[int, str, bool] | None]) -> Events:
    lane_changes, overlaps, collision = events
    return Events(lane_changes, overlaps, None if collision is None else Collision(*collision))


def idm(
    gap_m: ArrayLike,
    speed_mps: ArrayLike,
    approach_mps: ArrayLike,
    *,
    desired_speed_mps: ArrayLike,
    time_headway_s: ArrayLike,
    min_gap_m: ArrayLike,
    max_accel_mps2: ArrayLike,
    comfort_decel_mps2: ArrayLike,
) -> Any:
    """Acceleration of the Intelligent Driver Model (Treiber, Hennecke and Helbing, 2000), m/s².

    a = a_max [1 − (v/v₀)⁴ − (s*/s)²] with s* = s₀ + max(0, v T + v Δv / (2 √(a_max b))). All arguments are broadcast against each other.

    Args:
        gap_m: s, bumper to bumper; ``inf`` without a leader; taken as at least 0.1 m.
        speed_mps: v.
        approach_mps: Δv, own speed minus the leader's.
        desired_speed_mps: v₀.
        time_headway_s: T.
        min_gap_m: s₀.
        max_accel_mps2: a_max.
        comfort_decel_mps2: b, positive.

    >>> round(idm(float("inf"), 0.0, 0.0, desired_speed_mps=30, time_headway_s=1.5, min_gap_m=2, max_accel_mps2=1.5,
    ...           comfort_decel_mps2=2), 3)
    1.5
    """
    arguments = {
        "gap_m": gap_m,
        "speed_mps": speed_mps,
        "approach_mps": approach_mps,
        "desired_speed_mps": desired_speed_mps,
        "time_headway_s": time_headway_s,
        "min_gap_m": min_gap_m,
        "max_accel_mps2": max_accel_mps2,
        "comfort_decel_mps2": comfort_decel_mps2,
    }
    return _everywhere(_lanecraft.idm, arguments)


def safe_gap(
    speed_mps: ArrayLike,
    leader_speed_mps: ArrayLike,
    *,
    braking_mps2: ArrayLike,
    leader_braking_mps2: ArrayLike,
    margin_m: ArrayLike = 0.0,
) -> Any:
    """The smallest bumper-to-bumper gap from which one can stop behind a leader that brakes as hard as it can, m.

    g = m + max(0, v²/(2b) − v_l²/(2b_l)), the condition behind the safe speed of Krauss (1998); a law only for b ≤ b_l. All arguments
    are broadcast against each other.
    """
    arguments = {"speed_mps": speed_mps, "leader_speed_mps": leader_speed_mps}
    return _everywhere(_lanecraft.safe_gap, arguments | _limits(braking_mps2, leader_braking_mps2, margin_m))


def safe_speed(
    gap_m: ArrayLike,
    leader_speed_mps: ArrayLike,
    *,
    braking_mps2: ArrayLike,
    leader_braking_mps2: ArrayLike,
    margin_m: ArrayLike = 0.0,
) -> Any:
    """The largest speed at which :func:`safe_gap` is kept, m/s; −1 where none is, for the gap is within the margin."""
    arguments = {"gap_m": gap_m, "leader_speed_mps": leader_speed_mps}
    return _everywhere(_lanecraft.safe_speed, arguments | _limits(braking_mps2, leader_braking_mps2, margin_m))


def _limits(braking_mps2: ArrayLike, leader_braking_mps2: ArrayLike, margin_m: ArrayLike) -> dict[str, ArrayLike]:
    return {"braking_mps2": braking_mps2, "leader_braking_mps2": leader_braking_mps2, "margin_m": margin_m}


def _everywhere(law: Callable[[Sequence[NDArray[Any]], NDArray[Any]], None], arguments: dict[str, ArrayLike]) -> Any:
    arrays = [_tasks.checked_reals(name, values) for name, values in arguments.items()]
    shape = np.broadcast_shapes(*(array.shape for array in arrays))
    out = np.empty(shape)
    law([np.broadcast_to(array, shape) for array in arrays], out)
    return out if shape else float(out)
