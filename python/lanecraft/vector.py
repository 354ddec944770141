"""Many environments at once, stepped by several threads outside of Python's lock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from . import _arrays, _tasks
from ._lanecraft import VectorCore
from .errors import ActionError, ConfigError

_KINDS = {"float": np.float64, "int": np.int64, "bool": np.bool_}


class VectorEnv(gymnasium.vector.VectorEnv[NDArray[np.float32], NDArray[Any], NDArray[Any]]):
    """Many environments of one kind, each with the same bits as an :class:`Env` of its seed, at any number of threads.

    Args:
        num_envs: how many.
        autoreset_mode: when an environment whose episode has ended begins the next one: by the next step (``"NextStep"``, Gymnasium's
            default), by the same step with ``info["final_obs"]`` and ``info["final_info"]`` (``"SameStep"``), or when told to by
            ``reset(options={"reset_mask": ...})`` (``"Disabled"``).
        threads: how many threads step them; 0 is one for each processor.
        copy: whether arrays are yours to keep. Without, they are overwritten by the next step, and nothing is copied.
        preset, config, scenario, seat, masked_actions, units: as for :class:`Env`.
        render_mode: must be ``None``; render an :class:`Env` of the same seed.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int = 0,
        copy: bool = True,
        preset: str = "default",
        config: Mapping[str, Any] | None = None,
        scenario: str | PathLike[str] | None = None,
        seat: str = "decide",
        masked_actions: str = "replace",
        units: str = "normalized",
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None:
            raise ConfigError("a VectorEnv does not render; make an Env with the same seed for that")
        num_envs = _arrays.whole("num_envs", num_envs, 1, 1 << 16)
        threads = _arrays.whole("threads", threads, 0, 1024)
        task = _tasks.make_task(preset, config, scenario, seat, masked_actions, units)
        mode = autoreset_mode.value if isinstance(autoreset_mode, AutoresetMode) else autoreset_mode
        self._core = VectorCore(task, num_envs, mode, threads)
        self.metadata = {**type(self).metadata, "autoreset_mode": AutoresetMode(mode)}
        self.num_envs = num_envs
        self.render_mode = None
        self.config_toml = task.config_toml
        self.action_names = task.action_names
        self.action_bounds = task.action_bounds
        self.single_action_space = _tasks.action_space(task, units)
        self.single_observation_space = _tasks.observation_space(task)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._seeded = False
        self._copy = copy
        self._shape = (num_envs, *task.observation_shape)
        self._columns = [(name, _KINDS[kind]) for name, kind in self._core.metric_columns]
        self._all = np.ones(num_envs, dtype=bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begins an episode in every environment.

        Args:
            seed: of the first environment, with those after it counted up, or one for each; without, every environment goes on in
                the series that its last seed began; at first, from a random one.
            options: ``{"reset_mask": array of bool}`` resets only these.
        """
        chosen = None if options is None else options.get("reset_mask")
        if chosen is not None:
            chosen = np.asarray(chosen)
            if chosen.dtype != bool or chosen.shape != (self.num_envs,):
                raise ActionError(f"reset_mask is an array of {self.num_envs} booleans, not of {chosen.shape} {chosen.dtype}")
            chosen = chosen.tolist()
        seeds = self._seeds(seed)
        if seeds is None and not self._seeded:
            seeds = self.np_random.integers(2**53, size=self.num_envs).tolist()
        self._core.reset(seeds, chosen)
        self._seeded = True
        return self._observations(), self._infos(self._core.metrics)

    def step(
        self, actions: Any
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """One step of every environment; see Gymnasium for what comes back."""
        core = self._core
        core.step(actions)
        infos = self._infos(core.metrics)
        ends = core.terminated | core.truncated
        if self.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP and ends.any():
            infos["final_obs"] = core.final_observations.reshape(self._shape).copy()
            infos["final_info"] = self._named(core.final_metrics.copy())
            infos["_final_obs"] = infos["_final_info"] = ends
        return self._observations(), self._own(core.rewards), self._own(core.terminated), self._own(core.truncated), infos

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are allowed now, shape (num_envs, actions)."""
        return self._own(self._core.masks)

    def digests(self) -> list[int]:
        """A digest of the whole physical state of every environment: equal states have equal digests."""
        return self._core.digests()

    def close_extras(self, **kwargs: Any) -> None:
        """Lets go of all episodes."""
        self._core.close()

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int] | None:
        if seed is None:
            return None
        if isinstance(seed, Sequence | np.ndarray):
            if len(seed) != self.num_envs:
                raise ConfigError(f"there are {len(seed)} seeds for {self.num_envs} environments")
            return [_tasks.checked_seed(one) for one in seed]
        first = _tasks.checked_seed(seed)
        return [_tasks.checked_seed(first + index) for index in range(self.num_envs)]

    def _observations(self) -> NDArray[np.float32]:
        return self._own(self._core.observations.reshape(self._shape))

    def _infos(self, metrics: NDArray[np.float64]) -> dict[str, Any]:
        infos = self._named(self._own(metrics))
        masks = self._core.masks
        if masks.shape[1]:
            infos["action_mask"] = self._own(masks).view(np.int8)
        for name in list(infos):
            infos[f"_{name}"] = self._all
        return infos

    def _named(self, metrics: NDArray[np.float64]) -> dict[str, Any]:
        columns = enumerate(self._columns)
        return {name: metrics[:, index].astype(kind, copy=False) for index, (name, kind) in columns}

    def _own(self, array: NDArray[Any]) -> NDArray[Any]:
        return array.copy() if self._copy else array
