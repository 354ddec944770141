"""The compiled half of the package; its public face is the modules beside it."""

from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import disjoint_base

__all__ = ["EnvCore", "Task", "VectorCore", "__version__", "scenarios"]

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

    def __new__(cls, *_args: Any, **_kwargs: Any) -> EnvCore: ...
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
