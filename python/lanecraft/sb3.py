"""Environments for Stable-Baselines3, and for MaskablePPO of sb3-contrib.

All environments of a vector are stepped by one call outside of Python's lock, which takes the place of SB3's ``DummyVecEnv`` and
``SubprocVecEnv``:

.. code-block:: python

    from stable_baselines3 import PPO
    from lanecraft.sb3 import make_vec_env

    model = PPO("MlpPolicy", make_vec_env(16, seed=1, preset="fast"))
    model.learn(100_000)
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from .vector import VectorEnv

try:
    from stable_baselines3.common import vec_env as _sb3  # pyright: ignore[reportMissingImports]
except ImportError as error:
    raise ImportError("lanecraft.sb3 needs Stable-Baselines3: pip install 'lanecraft[sb3]'") from error

__all__ = ["VecEnv", "make_vec_env"]

#: What the environments of a vector can be asked for, one by one.
_METHODS = ("action_masks", "digest")


class VecEnv(_sb3.VecEnv):
    """A :class:`lanecraft.VectorEnv` as Stable-Baselines3 knows it.

    An environment whose episode has ended begins the next one in the same step; its ``info`` is that of the last step of the episode, with
    ``terminal_observation`` and ``TimeLimit.truncated``.

    Args:
        env: with ``autoreset_mode="SameStep"`` and copies of its own.
    """

    def __init__(self, env: VectorEnv) -> None:
        if env.metadata["autoreset_mode"] is not AutoresetMode.SAME_STEP:
            raise ValueError('Stable-Baselines3 resets in the same step: make the VectorEnv with autoreset_mode="SameStep"')
        if not env._copy:
            raise ValueError("Stable-Baselines3 keeps observations: make the VectorEnv with copy=True")
        self.env = env
        self._actions: Any = None
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> Any:
        """Begins an episode in every environment, of the seeds that ``seed`` has set."""
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observations, infos = self.env.reset(seed=seeds)
        self.reset_infos = self._split(infos)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: Any) -> None:
        """Takes the actions; the step itself is in :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, Any, Any, list[dict[str, Any]]]:
        """Observations, rewards, ends of episodes and infos of one step."""
        observations, rewards, terminated, truncated, vector_infos = self.env.step(self._actions)
        ends = terminated | truncated
        infos = self._split(vector_infos)
        if ends.any():
            final_infos = self._split(vector_infos["final_info"])
            for index in np.flatnonzero(ends):
                self.reset_infos[index] = infos[index]
                infos[index] = {**final_infos[index], "terminal_observation": vector_infos["final_obs"][index]}
        for info, cut in zip(infos, (truncated & ~terminated).tolist(), strict=True):
            info["TimeLimit.truncated"] = cut
        return observations, rewards.astype(np.float32), ends, infos

    def close(self) -> None:
        """Lets go of all episodes."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the vector, once for each environment: all are of one kind. ``action_masks`` is a method of each."""
        indices = list(self._get_indices(indices))
        if attr_name in _METHODS:
            return [lambda index=index: self.env_method(attr_name, indices=index)[0] for index in indices]
        return [getattr(self.env, attr_name)] * len(indices)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not possible: one engine steps all environments."""
        raise AttributeError(f"`{attr_name}` cannot be set for single environments of a vector; make another vector")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """``action_masks`` (booleans) or ``digest`` of each environment."""
        if method_name not in _METHODS:
            raise AttributeError(f"an environment of a vector has no `{method_name}`; it has {' and '.join(_METHODS)}")
        each = self.env.action_masks() if method_name == "action_masks" else self.env.digests()
        return [each[index] for index in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No environment of the vector is."""
        return [False for _ in self._get_indices(indices)]

    def _split(self, infos: dict[str, Any]) -> list[dict[str, Any]]:
        """One dictionary for each environment, of plain numbers."""
        names = [name for name, _ in self.env._columns]
        return [dict(zip(names, row, strict=True)) for row in zip(*(infos[name].tolist() for name in names), strict=True)]


def make_vec_env(
    n_envs: int = 1,
    *,
    seed: int | Sequence[int] | None = None,
    monitor_file: str | None = None,
    info_keywords: Iterable[str] = ("collided",),
    threads: int = 0,
    **task: Any,
) -> Any:
    """Environments with a ``VecMonitor`` around them, so that logs tell returns and lengths of episodes.

    Args:
        n_envs: how many.
        seed: of the first episodes: of the first environment, with those after it counted up, or one for each.
        monitor_file: where a line for each episode is written, ``None`` for nowhere.
        info_keywords: what of the last ``info`` of an episode goes with it.
        threads: as for :class:`lanecraft.VectorEnv`.
        **task: ``preset``, ``config``, ``scenario``, ``seat`` and ``masked_actions``, as for :class:`lanecraft.Env`.

    Raises:
        ConfigError: as for :class:`lanecraft.Env`.
    """
    env = VecEnv(VectorEnv(n_envs, autoreset_mode=AutoresetMode.SAME_STEP, threads=threads, **task))
    if isinstance(seed, Sequence | np.ndarray):
        env._seeds = list(seed)
    elif seed is not None:
        env.seed(seed)
    return _sb3.VecMonitor(env, monitor_file, tuple(info_keywords))
