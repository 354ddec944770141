"""The compiled half of the package; its public face is the modules beside it."""

from collections.abc import Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self, disjoint_base

__all__ = [
    "EnvCore",
    "IrlCore",
    "LateralCore",
    "LongitudinalCore",
    "Parts",
    "PlannerCore",
    "PolicyCore",
    "QpCore",
    "ResultsCore",
    "Task",
    "VectorCore",
    "WorldCore",
    "__version__",
    "evaluate",
    "idm",
    "qp_infinite_horizon_weight",
    "qp_zero_order_hold",
    "quintic_at",
    "quintic_between",
    "quintic_maxima",
    "safe_gap",
    "safe_speed",
    "scenarios",
]

_Floats = NDArray[np.float64]
_Integers = NDArray[np.int64]
_Solve = tuple[bool, int, int, float, float]
_Coefficients = tuple[float, float, float, float, float, float]

__version__: str

def scenarios() -> list[str]:
    """Names of the scenarios that come with the package."""

@final
class Task:
    """What is simulated: a preset with the user's own numbers laid over it, and the seat that is taken."""

    def __new__(
        cls,
        preset: str,
        config: dict[str, Any],
        scenario: str | None,
        seat: str,
        masked_actions: str,
        units: str,
    ) -> Task: ...
    @property
    def actions(self) -> int | None:
        """Number of discrete actions, or ``None``."""
    @property
    def action_bounds(self) -> tuple[list[float], list[float], list[float]] | None:
        """The smallest action, the one in the middle and the largest, in SI units, if actions are continuous."""
    @property
    def action_names(self) -> list[str]:
        """What each action does, in words; empty if actions are continuous."""
    @property
    def observation_shape(self) -> list[int]:
        """Shape of an observation."""
    @property
    def observation_bounds(self) -> tuple[list[float], list[float]]:
        """The smallest and the largest observation, flat."""
    @property
    def config_toml(self) -> str:
        """The complete configuration as TOML."""
    @property
    def step_s(self) -> float:
        """Simulated time from one step to the next, s."""

@disjoint_base
class EnvCore:
    """An environment; the base of :class:`lanecraft.Env`."""

    def __new__(cls, *_args: Any, **_kwargs: Any) -> Self: ...
    def _open(self, task: Task) -> None: ...
    def _begin(self, seed: int | None) -> tuple[NDArray[np.float32], dict[str, Any]]: ...
    def _rgb(self, width_px: int, height_px: int) -> NDArray[np.uint8]: ...
    def _ansi(self, columns: int) -> str: ...
    def _stored(self) -> bytes | None: ...
    def _series(self) -> tuple[int, int] | None: ...
    def _resume(self, series: tuple[int, int], snapshot: bytes) -> None: ...
    def _close(self) -> None: ...
    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One step: observation, reward, terminated, truncated, info.

        Raises:
            ActionError: the action does not exist, is out of bounds or, with ``masked_actions="raise"``, is forbidden now.
            ResetNeeded: the episode is over, or none has begun.
        """
    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are allowed now, shape (actions,)."""
    def snapshot(self) -> bytes:
        """The running episode, to be gone on from with the same bits, here or in another process."""
    def restore(self, snapshot: bytes) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Goes on from an episode that was stored; observation and info of that instant.

        Raises:
            SnapshotError: it is no snapshot, damaged, or one of another configuration.
        """
    def digest(self) -> int:
        """A digest of the whole physical state: equal states have equal digests."""

@final
class ResultsCore:
    """The episodes of an evaluation; the engine of :class:`lanecraft.Results`."""

    def rows(self) -> list[str]:
        """The figures of each policy, as the lines of JSON that the command line prints."""
    def episodes(self) -> list[str]:
        """The episodes of all policies, as JSON."""
    def comparisons(self) -> list[tuple[str, str, tuple[float, float, float], str]]:
        """The first policy against each of the others: names, lead with its interval, and in words."""
    def table(self) -> str:
        """The table that the command line prints."""

def evaluate(
    policies: list[tuple[str, Any]],
    environment: tuple[str, dict[str, Any], str | None],
    masked_actions: str,
    threads: int,
) -> ResultsCore:
    """Drives each policy, a ``PolicyCore`` or anything callable with a name, through the same scenarios; ``environment``: preset,
    configuration and scenario."""

@disjoint_base
class PolicyCore:
    """A policy; the base of :class:`lanecraft.policies.Policy`."""

    def __new__(cls, name: str) -> Self: ...
    @property
    def name(self) -> str:
        """``rule:…``, or the name of the run's folder."""
    @property
    def observation_shape(self) -> list[int] | None:
        """Shape of an observation, or ``None`` for a rule."""
    @property
    def actions(self) -> int | None:
        """Number of actions that a network chooses among; ``None`` for a rule."""
    def to_onnx(self) -> bytes:
        """A network as an ONNX model: ``observation`` and ``action_mask`` to ``q_heads``, ``q`` and ``action``."""
    def _act(self, env: EnvCore) -> int: ...
    def _q_heads(self, observations: NDArray[np.float32]) -> NDArray[np.float32]: ...
    def _predict(self, observations: NDArray[np.float32], masks: NDArray[np.bool_]) -> NDArray[np.int64]: ...

@disjoint_base
class WorldCore:
    """The traffic of one road; the base of :class:`lanecraft.traffic.World`. Columns have shape (vehicles,), by rising id."""

    def __new__(cls, preset: str, config: dict[str, Any], scenario: str | None, seed: int) -> Self: ...
    def __len__(self) -> int: ...
    @property
    def seed(self) -> int:
        """Seed of the scene."""
    @property
    def step_s(self) -> float:
        """Length of a step, s."""
    @property
    def time_s(self) -> float:
        """Time since the start, s."""
    @property
    def ego_start(self) -> tuple[float, int, float]:
        """Where there is room for a vehicle of one's own at the start: position in m, lane, speed in m/s."""
    @property
    def lane_centers_m(self) -> NDArray[np.float64]:
        """Lateral positions of the lanes' centers, m, from the right."""
    @property
    def id(self) -> NDArray[np.int64]:
        """Which vehicle; ids are never used again."""
    @property
    def s_m(self) -> NDArray[np.float64]:
        """Position of the center along the road, m."""
    @property
    def d_m(self) -> NDArray[np.float64]:
        """Position of the center to the left of the reference line, m."""
    @property
    def speed_mps(self) -> NDArray[np.float64]:
        """Speed along the road, m/s."""
    @property
    def lateral_speed_mps(self) -> NDArray[np.float64]:
        """Speed to the left, m/s."""
    @property
    def accel_mps2(self) -> NDArray[np.float64]:
        """Mean acceleration over the last step, m/s²."""
    @property
    def length_m(self) -> NDArray[np.float64]:
        """Length, m."""
    @property
    def width_m(self) -> NDArray[np.float64]:
        """Width, m."""
    @property
    def lane(self) -> NDArray[np.int64]:
        """The lane it is in, or leaves."""
    @property
    def target_lane(self) -> NDArray[np.int64]:
        """The lane it changes into; ``lane`` when it keeps."""
    def snapshot(self) -> bytes:
        """The world between two steps, to be gone on from with the same bits, here or in another process."""
    def restore(self, snapshot: bytes) -> None:
        """Goes on from a world that was stored by one with steps of the same length.

        Raises:
            SnapshotError: it is no snapshot of a world, or damaged.
        """
    def digest(self) -> int:
        """A digest of the whole state: equal states have equal digests."""
    def _step(self, steps: int) -> tuple[int, int, tuple[int, str, bool] | None]: ...
    def _step_with(self, ego: tuple[list[float], int]) -> tuple[int, int, tuple[int, str, bool] | None]: ...
    def _place(self, ego: tuple[list[float], int]) -> None: ...

def idm(arrays: Sequence[NDArray[np.float64]], out: NDArray[np.float64]) -> None:
    """The IDM's acceleration at every place of ``out``."""

def safe_gap(arrays: Sequence[NDArray[np.float64]], out: NDArray[np.float64]) -> None:
    """The smallest safe gap at every place of ``out``."""

def safe_speed(arrays: Sequence[NDArray[np.float64]], out: NDArray[np.float64]) -> None:
    """The largest safe speed at every place of ``out``."""

@final
class VectorCore:
    """The engine of :class:`lanecraft.VectorEnv`. All arrays are its own and are written anew by every step."""

    def __new__(cls, task: Task, num_envs: int, autoreset: str, threads: int) -> VectorCore: ...
    @property
    def metric_columns(self) -> list[tuple[str, str]]:
        """Names and kinds (``float``, ``int``, ``bool``) of the columns of ``metrics``."""
    @property
    def observations(self) -> NDArray[np.float32]:
        """Shape (num_envs, numbers in an observation)."""
    @property
    def rewards(self) -> NDArray[np.float64]:
        """Shape (num_envs,)."""
    @property
    def terminated(self) -> NDArray[np.bool_]:
        """Shape (num_envs,)."""
    @property
    def truncated(self) -> NDArray[np.bool_]:
        """Shape (num_envs,)."""
    @property
    def masks(self) -> NDArray[np.bool_]:
        """Shape (num_envs, actions)."""
    @property
    def metrics(self) -> NDArray[np.float64]:
        """Shape (num_envs, columns)."""
    @property
    def final_observations(self) -> NDArray[np.float32]:
        """As ``observations``, of the episodes that ended in this step; empty but for ``SameStep``."""
    @property
    def final_metrics(self) -> NDArray[np.float64]:
        """As ``metrics``, of the episodes that ended in this step; empty but for ``SameStep``."""
    def reset(self, seeds: list[int] | None, chosen: list[bool] | None) -> None:
        """Begins the episodes of these seeds, or of the next ones where ``chosen``."""
    def step(self, actions: Any) -> None:
        """One step of every environment."""
    def digests(self) -> list[int]:
        """A digest of the state of every environment."""
    def close(self) -> None:
        """Lets go of all episodes."""

@final
class IrlCore:
    def __new__(cls, preset: str, options: dict[str, Any]) -> IrlCore: ...
    def fit(
        self, features: _Floats, counts: _Integers, chosen: _Integers
    ) -> tuple[list[float], list[float], tuple[float, float], float, int, bool]: ...

@final
class LateralCore:
    def __new__(cls, parts: Parts) -> LateralCore: ...
    def plan(
        self, scene: Any, path: tuple[_Coefficients, float, float], speeds_mps: _Floats, path_ratio: float
    ) -> tuple[float, _Floats | None, str, _Solve, tuple[float, float, float]]: ...
    def sent(self, steer_rad: float) -> None: ...

@final
class LongitudinalCore:
    def __new__(cls, parts: Parts) -> LongitudinalCore: ...
    def plan(
        self, scene: Any, aim: tuple[float, float | None], lanes: tuple[int | None, int | None], speed_ratio: float
    ) -> tuple[float, float, _Floats, _Floats | None, str, _Solve]: ...
    def sent(self, accel_mps2: float) -> None: ...

@final
class Parts:
    def __new__(cls, preset: str, config: dict[str, Any]) -> Parts: ...
    @property
    def config_toml(self) -> str: ...
    @property
    def lane_width_m(self) -> float: ...
    @property
    def plain_weights(self) -> tuple[float, float]: ...

@final
class PlannerCore:
    def __new__(cls, parts: Parts) -> PlannerCore: ...
    def plan(
        self, scene: Any, side: str
    ) -> tuple[tuple[tuple[int, int, float, float], tuple[_Floats, _Floats, _Floats, int]] | None, tuple[str, str] | None]: ...
    def path_to(self, scene: Any, end_m: float, duration_s: float) -> tuple[_Coefficients, float] | None: ...

def quintic_at(
    coefficients: _Coefficients, duration_s: float, times_s: _Floats
) -> tuple[_Floats, _Floats, _Floats, _Floats]: ...
def quintic_between(start: tuple[float, float, float], end_m: float, duration_s: float) -> _Coefficients: ...
def quintic_maxima(coefficients: _Coefficients, duration_s: float) -> tuple[float, float, float]: ...

@final
class QpCore:
    def __new__(cls, horizon: int, states: int, rows: int) -> QpCore: ...
    def solve(
        self, problem: Any, shift: int | None, steps: int | None
    ) -> tuple[
        _Floats, _Floats, str, tuple[int, float, float], list[tuple[int, int | None, bool, float, float]], _Floats
    ]: ...
    def reset(self) -> None: ...

def qp_infinite_horizon_weight(a: _Floats, b: _Floats, state_weight: _Floats, input_weight: float) -> _Floats | None: ...
def qp_zero_order_hold(a: _Floats, b: _Floats, dt_s: float) -> tuple[_Floats, _Floats]: ...
