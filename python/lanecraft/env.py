"""One environment, as Gymnasium knows it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from os import PathLike
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from . import _tasks
from ._lanecraft import EnvCore
from .errors import ConfigError

Observation = NDArray[np.float32]
Info = dict[str, Any]


class Env(EnvCore, gymnasium.Env[Observation, Any]):
    """A highway with traffic and one car whose seat is yours.

    Args:
        preset: ``"default"`` (what works best), ``"paper"``, or ``"fast"`` (traffic and a kinematic car alone, for raw speed).
        config: your own numbers laid over the preset, with nested or dotted keys: ``{"traffic.density_veh_per_km_lane": 20}``.
            ``config_toml`` shows every key with its value.
        scenario: the name of a scenario that comes with the package (:func:`lanecraft.scenarios`) or the path of a scenario file.
        seat: ``"decide"`` (a discrete action each 0.5 s), ``"plan"`` (lateral end position, duration and speed each 0.5 s) or
            ``"control"`` (acceleration and road-wheel angle each 0.05 s).
        masked_actions: what becomes of an action that ``info["action_mask"]`` forbids: ``"replace"`` takes *continue*, else *hold* in
            its place (``info["action"]`` tells), ``"raise"`` raises :class:`ActionError`.
        units: of continuous actions: ``"normalized"``, from −1 to 1 over ``action_bounds``, or ``"si"``: m, s and m/s for a plan, m/s²
            and rad for a command.
        render_mode: ``"rgb_array"``, ``"ansi"`` or ``None``; neither needs a display.

    Raises:
        ConfigError: a name, key or value that does not exist or is out of range.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "ansi"], "render_fps": 2}

    def __init__(
        self,
        *,
        preset: str = "default",
        config: Mapping[str, Any] | None = None,
        scenario: str | PathLike[str] | None = None,
        seat: str = "decide",
        masked_actions: str = "replace",
        units: str = "normalized",
        render_mode: str | None = None,
    ) -> None:
        task = _tasks.make_task(preset, config, scenario, seat, masked_actions, units)
        self._arguments = {
            "preset": preset,
            "config": config,
            "scenario": scenario,
            "seat": seat,
            "masked_actions": masked_actions,
            "units": units,
            "render_mode": render_mode,
        }
        self._open(task)
        self.render_mode = _checked_render_mode(render_mode, self.metadata["render_modes"])
        self.metadata = {**type(self).metadata, "render_fps": round(1.0 / task.step_s)}
        self.config_toml = task.config_toml
        self.action_names = task.action_names
        self.action_bounds = task.action_bounds
        self.action_space = _tasks.action_space(task, units)
        self.observation_space = _tasks.observation_space(task)
        self._seeded = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, Info]:
        """Begins an episode.

        Args:
            seed: that of the scenario, 0 to 2⁶⁴ − 1: the same seed gives the same episode, here, in :class:`VectorEnv` and on the command
                line. Without one, the next episode of the series that the last seed began; at first, a random one.
            options: none are known; here because Gymnasium asks for it.
        """
        if seed is not None:
            seed = _tasks.checked_seed(seed)
        super().reset(seed=seed)
        if seed is None and not self._seeded:
            seed = int(self.np_random.integers(2**53))
        observation_and_info = self._begin(seed)
        self._seeded = True
        return observation_and_info

    def render(self) -> Any:
        """The scene as an RGB array of shape (150, 600, 3), as text, or ``None``, by ``render_mode``."""
        if self.render_mode == "rgb_array":
            return self._rgb(600, 150)
        if self.render_mode == "ansi":
            return self._ansi(100)
        return None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled and copied by its arguments and a snapshot of the running episode."""
        return _remade, (type(self), self._arguments, self._series(), self._stored(), self._seeded)

    def close(self) -> None:
        """Lets go of the episode; the environment cannot be used afterwards."""
        self._close()


def _remade(kind: Callable[..., Env], arguments: dict[str, Any], series: Any, snapshot: bytes | None, seeded: bool) -> Env:
    env = kind(**arguments)
    env._seeded = seeded
    if snapshot is not None:
        env._resume(series, snapshot)
    return env


def _checked_render_mode(mode: str | None, modes: list[str]) -> str | None:
    if mode is not None and mode not in modes:
        raise ConfigError(f"there is no render mode `{mode}`; allowed are {', '.join(modes)}")
    return mode
