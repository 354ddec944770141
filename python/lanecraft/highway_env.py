"""highway-env's ``highway-v0`` and ``highway-fast-v0`` in this package's traffic, with highway-env's ids, configuration and ``info``.

``import lanecraft.highway_env`` instead of ``import highway_env`` is all that a script changes. The names, defaults and formulas are those
of highway-env 1.12.1 (Leurent, 2018); the page ``from-highway-env`` of the documentation says what maps to what and what differs.

The ids ``highway-v0`` and ``highway-fast-v0`` are registered unless highway-env's own are (then a warning says so);
``lanecraft/highway-v0`` and ``lanecraft/highway-fast-v0`` are registered always.
"""

from __future__ import annotations

import copy
import difflib
import math
import warnings
from collections.abc import Collection, Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from .env import Env
from .errors import ConfigError

__all__ = ["ACTIONS", "HighwayEnv", "HighwayEnvFast", "register", "to_lanecraft"]

#: What each action does.
ACTIONS = {0: "LANE_LEFT", 1: "IDLE", 2: "LANE_RIGHT", 3: "FASTER", 4: "SLOWER"}
_IDLE = 1
# What is divided by must not vanish, and what is counted must end.
_LEAST, _MOST, _MOST_LANES = 0.01, 1e6, 100
#: Lanes are counted from the right.
_LANES_TO_THE_LEFT = {0: 1, 2: -1}

_FEATURES = ["presence", "x", "y", "vx", "vy"]
_TARGET_SPEEDS_MPS = [20.0, 25.0, 30.0]

# What each of highway-env's keys sets here.
_KEYS = {
    "vehicles_count": "task.vehicles",
    "lanes_count": "road.lanes",
    "simulation_frequency": "task.simulation_hz",
    "collision_reward": "task.collision_reward",
    "right_lane_reward": "task.right_lane_reward",
    "high_speed_reward": "task.high_speed_reward",
    "lane_change_reward": "task.lane_change_reward",
    "normalize_reward": "task.normalize_reward",
}
_OBSERVATION_KEYS = {
    "vehicles_count": "task.observation.observed_vehicles",
    "features": "task.observation.features",
    "absolute": "task.observation.absolute",
    "normalize": "task.observation.normalize",
    "see_behind": "task.observation.see_behind",
}
# Keys that are converted, and what they become part of.
_CONVERTED = {
    "policy_frequency": "task.steps_per_decision",
    "duration": "task.duration_s",
    "vehicles_density": "traffic.density_veh_per_km_lane",
    "reward_speed_range": "task.reward_max_speed_mps",
}
# Keys with the values that mean something here.
_FIXED = {
    "controlled_vehicles": (1,),
    "initial_lane_id": (None,),
    "ego_spacing": (1.5, 2),
    "offroad_terminal": (False, True),
    "other_vehicles_type": ("highway_env.vehicle.behavior.IDMVehicle",),
    "neighbour_vehicles_connected_lanes": (False, True),
    "manual_control": (False,),
}
_OBSERVATION_FIXED = {
    "type": ("Kinematics",),
    "order": ("sorted",),
    "clip": (True,),
    "features_range": (None,),
    "observe_intentions": (False,),
    "include_obstacles": (True, False),
}
_ACTION_FIXED = {"type": ("DiscreteMetaAction",), "longitudinal": (True,), "lateral": (True,)}
#: Keys that say how to draw; of these only the size of the screen is read.
_DRAWING = {
    "screen_width": 600,
    "screen_height": 150,
    "centering_position": [0.3, 0.5],
    "scaling": 5.5,
    "show_trajectories": False,
    "render_agent": True,
    "offscreen_rendering": None,
    "real_time_rendering": False,
}


class HighwayEnv(gymnasium.Env[NDArray[np.float32], Any]):
    """``highway-v0``: 50 vehicles on four lanes, 15 simulation steps a decision, 40 decisions.

    Observations are rows of features, shape ``(vehicles_count, len(features))``; actions are those of :data:`ACTIONS`. ``info`` has
    highway-env's ``speed`` (m/s), ``crashed``, ``action`` and ``rewards`` beside everything that :class:`lanecraft.Env` tells.

    Args:
        config: laid over :meth:`default_config` key by key, as by :meth:`configure`.
        render_mode: ``"rgb_array"`` or ``None``.

    Raises:
        ConfigError: a key or value that means nothing here; keys about drawing are accepted.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 1}

    def __init__(self, config: Mapping[str, Any] | None = None, render_mode: str | None = None) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ConfigError(f"there is no render mode `{render_mode}`; allowed is rgb_array, which needs no display")
        self.render_mode = render_mode
        self.config = self.default_config()
        self.configure(config)
        self._open()

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        """Every key with its default value, a new dictionary."""
        return {
            "observation": {"type": "Kinematics"},
            "action": {"type": "DiscreteMetaAction"},
            "simulation_frequency": 15,
            "policy_frequency": 1,
            "other_vehicles_type": "highway_env.vehicle.behavior.IDMVehicle",
            **copy.deepcopy(_DRAWING),
            "manual_control": False,
            "neighbour_vehicles_connected_lanes": False,
            "lanes_count": 4,
            "vehicles_count": 50,
            "controlled_vehicles": 1,
            "initial_lane_id": None,
            "duration": 40,
            "ego_spacing": 2,
            "vehicles_density": 1,
            "collision_reward": -1,
            "right_lane_reward": 0.1,
            "high_speed_reward": 0.4,
            "lane_change_reward": 0,
            "reward_speed_range": [20, 30],
            "normalize_reward": True,
            "offroad_terminal": False,
        }

    def configure(self, config: Mapping[str, Any] | None) -> None:
        """Replaces these keys of ``config``, from the next reset on. As in highway-env, a section is replaced as a whole."""
        if config:
            laid_over = {**self.config, **_mapping("config", config)}
            to_lanecraft(laid_over)
            self.config.update(config)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begins an episode, with ``options["config"]`` configured first. For seeds, see :meth:`lanecraft.Env.reset`."""
        super().reset(seed=seed)
        self.configure((options or {}).get("config"))
        if self._open() and seed is None:
            seed = int(self.np_random.integers(2**53))
        observation, info = self._env.reset(seed=seed)
        self._target_lane = info["lane"]
        return self._seen(observation, info, _IDLE)

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One decision; one that is not available changes nothing."""
        observation, reward, terminated, truncated, info = self._env.step(action)
        self._target_lane += _LANES_TO_THE_LEFT.get(info["action"], 0)
        observation, info = self._seen(observation, info, action)
        return observation, reward, terminated, truncated, info

    def get_available_actions(self) -> list[int]:
        """The actions that change something, and ``IDLE``."""
        allowed = self._env.action_masks()
        return [action for action in (_IDLE, 0, 2, 3, 4) if allowed[action]]

    def action_masks(self) -> NDArray[np.bool_]:
        """The same as booleans, one for each action."""
        return self._env.action_masks()

    @property
    def action_type(self) -> DiscreteMetaAction:
        """The actions by name, as highway-env's scripts look them up."""
        return DiscreteMetaAction(self)

    def render(self) -> Any:
        """The scene, shape (``screen_height``, ``screen_width``, 3), if ``render_mode`` is ``"rgb_array"``."""
        if self.render_mode is None:
            return None
        return self._env._rgb(int(self.config["screen_width"]), int(self.config["screen_height"]))

    def set_record_video_wrapper(self, wrapper: Any) -> None:
        """Nothing: videos have one picture a decision. Here because highway-env's scripts call it."""

    def close(self) -> None:
        """Lets go of the episode."""
        self._env.close()

    def _open(self) -> bool:
        """Takes on the configuration if it has changed; whether it has."""
        config = to_lanecraft(self.config)
        if config == getattr(self, "_opened", None):
            return False
        features = config["task.observation.features"]
        # The ego's own heading is part of its reward: forward speed is what counts.
        watched = features if "cos_h" in features else [*features, "cos_h"]
        try:
            self._env = Env(preset="fast", config={**config, "task.observation.features": watched})
        except ConfigError as error:
            raise ConfigError(_in_their_words(str(error))) from None
        self._opened = config
        self._cosine = watched.index("cos_h")
        self.metadata = {**type(self).metadata, "render_fps": self._env.metadata["render_fps"]}
        shape = (config["task.observation.observed_vehicles"], len(features))
        # Without bounds, as in highway-env: stored policies check that spaces are equal.
        self.observation_space = spaces.Box(-np.inf, np.inf, shape, np.float32)
        self.action_space = spaces.Discrete(len(ACTIONS))
        return True

    def _seen(
        self, observation: NDArray[np.float32], info: dict[str, Any], action: Any
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        forward_mps = info["speed_mps"] * float(observation[0, self._cosine])
        low_mps, high_mps = self.config["reward_speed_range"]
        last_lane = self._opened["road.lanes"] - 1
        rewards = {
            "collision_reward": float(info["collided"]),
            "right_lane_reward": (last_lane - self._target_lane) / max(last_lane, 1),
            "high_speed_reward": min(max((forward_mps - low_mps) / (high_mps - low_mps), 0.0), 1.0),
            "on_road_reward": 1.0,
        }
        theirs = {"speed": info["speed_mps"], "crashed": info["collided"], "action": action, "rewards": rewards}
        columns = len(self._opened["task.observation.features"])
        return np.ascontiguousarray(observation[:, :columns]), {**info, **theirs}


class HighwayEnvFast(HighwayEnv):
    """``highway-fast-v0``: 20 vehicles on three lanes, 5 simulation steps a decision, 30 decisions."""

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        """Every key with its default value, a new dictionary."""
        fast = {"simulation_frequency": 5, "lanes_count": 3, "vehicles_count": 20, "duration": 30, "ego_spacing": 1.5}
        return {**super().default_config(), **fast}


class DiscreteMetaAction:
    """The actions of an environment by name."""

    actions: ClassVar[dict[int, str]] = ACTIONS
    actions_indexes: ClassVar[dict[str, int]] = {name: index for index, name in ACTIONS.items()}

    def __init__(self, env: HighwayEnv) -> None:
        self._env = env

    def get_available_actions(self) -> list[int]:
        """The actions that change something, and ``IDLE``."""
        return self._env.get_available_actions()


def to_lanecraft(config: Mapping[str, Any], base: type[HighwayEnv] = HighwayEnvFast) -> dict[str, Any]:
    """Highway-env's configuration as one of the preset ``"fast"``, for :class:`lanecraft.Env` and :class:`lanecraft.VectorEnv`.

    Args:
        config: highway-env's keys; those left out are as in ``base``.
        base: :class:`HighwayEnvFast` or :class:`HighwayEnv`.

    Raises:
        ConfigError: a key or value that means nothing here.

    >>> to_lanecraft({"vehicles_count": 30})["task.vehicles"]
    30
    """
    config = {**base.default_config(), **_mapping("config", config)}
    _check("", config, {**_KEYS, **_CONVERTED, **_DRAWING, "observation": None, "action": None}, _FIXED)
    observation = {"vehicles_count": 5, "absolute": False, "normalize": True, "see_behind": False}
    observation |= _mapping("observation", config["observation"])
    features = observation.get("features")
    observation["features"] = _FEATURES if features is None else _list("observation.features", features)
    _check("observation.", observation, _OBSERVATION_KEYS, _OBSERVATION_FIXED)
    for key in ("screen_width", "screen_height"):
        _number(key, config[key], 1.0)
    action = _mapping("action", config["action"])
    _check("action.", action, ["target_speeds"], _ACTION_FIXED)
    target_speeds = action.get("target_speeds")
    target_speeds = _TARGET_SPEEDS_MPS if target_speeds is None else target_speeds
    direct = {ours: config[theirs] for theirs, ours in _KEYS.items()}
    seen = {ours: observation[theirs] for theirs, ours in _OBSERVATION_KEYS.items()}
    speeds_mps = _numbers("action.target_speeds", target_speeds)
    return {**direct, **seen, **_converted(config), "task.target_speeds_mps": speeds_mps}


def register(override: bool = False) -> None:
    """Registers ``highway-v0`` and ``highway-fast-v0``, and both under ``lanecraft/``. Importing the module calls it once.

    Args:
        override: whether to take the place of environments of these names that somebody else, highway-env above all, has registered.
            Without, they stay and a warning says so.
    """
    taken = []
    for name, kind in [("highway-v0", HighwayEnv), ("highway-fast-v0", HighwayEnvFast)]:
        entry_point = f"{__name__}:{kind.__name__}"
        known = gymnasium.registry.get(name)
        if known is not None and known.entry_point != entry_point and not override:
            taken.append(name)
        for free in {f"lanecraft/{name}", name} - set(taken):
            gymnasium.registry.pop(free, None)
            gymnasium.register(id=free, entry_point=entry_point, disable_env_checker=True)
    if taken:
        warnings.warn(
            f"{' and '.join(taken)} stay those of highway-env, which was imported first; those of Lanecraft are "
            f"{' and '.join(f'lanecraft/{name}' for name in taken)} (lanecraft.highway_env.register(override=True) exchanges them)",
            stacklevel=2,
        )


def _converted(config: Mapping[str, Any]) -> dict[str, Any]:
    """The keys that do not stand for one of ours alone."""
    keys = ("simulation_frequency", "policy_frequency", "duration", "vehicles_density", "lanes_count")
    simulation_hz, policy_hz, duration_s, density, lanes = (_number(key, config[key], _LEAST) for key in keys)
    if policy_hz > simulation_hz:
        raise ConfigError(f"`policy_frequency` is {policy_hz:g}, but must be at most `simulation_frequency`, {simulation_hz:g}")
    speed_range_mps = _numbers("reward_speed_range", config["reward_speed_range"])
    if len(speed_range_mps) != 2:
        raise ConfigError(f"`reward_speed_range` has {len(speed_range_mps)} values, but must have the lowest and the highest speed")
    steps = int(simulation_hz // policy_hz)
    return {
        "task.steps_per_decision": steps,
        # There the clock goes by the policy's frequency, whatever the steps add up to.
        "task.duration_s": math.ceil(duration_s * policy_hz - 1e-9) * steps / simulation_hz,
        "traffic.density_veh_per_km_lane": density * round(1000.0 / (_spacing_m(lanes) * lanes)),
        "task.reward_min_speed_mps": speed_range_mps[0],
        "task.reward_max_speed_mps": speed_range_mps[1],
    }


def _spacing_m(lanes: float) -> float:
    """The mean distance from one vehicle to the next, whatever its lane, that highway-env places at density 1: 12 m and a second at the
    speed of others, 22.5 m/s on average, less on many lanes."""
    return (12.0 + 22.5) * math.exp(-min(lanes, _MOST_LANES) / 8.0)


def _number(key: str, value: Any, least: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        raise TypeError(f"`{key}` must be a number, not {type(value).__name__}")
    if not least <= value <= _MOST:
        raise ConfigError(f"`{key}` is {value}, but must be in {least:g}..={_MOST:g}")
    return float(value)


def _numbers(key: str, values: Any) -> list[float]:
    return [_number(key, value, 0.0) for value in _list(key, values)]


def _list(key: str, values: Any) -> list[Any]:
    if isinstance(values, str | bytes | Mapping) or not isinstance(values, Collection):
        raise TypeError(f"`{key}` must be a list, not {type(values).__name__}")
    return list(values)


def _mapping(name: str, value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} must be a mapping of keys to values, not {type(value).__name__}")
    return value


def _check(section: str, given: Mapping[str, Any], free: Collection[str], fixed: Mapping[str, tuple[Any, ...]]) -> None:
    """That there are only keys which mean something, with values that do."""
    for key, value in given.items():
        if key in fixed:
            allowed = fixed[key]
            if not any(value is one or (type(value) is not bool and value == one) for one in allowed):
                raise ConfigError(f"`{section}{key}` is {value!r}, but allowed here is {' or '.join(map(repr, allowed))}")
        elif key not in free:
            known = sorted([*free, *fixed])
            nearest = difflib.get_close_matches(str(key), known, n=1, cutoff=0.0)[0]
            raise ConfigError(f"there is no key `{section}{key}`; the nearest is `{section}{nearest}`; allowed are {', '.join(known)}")


def _in_their_words(message: str) -> str:
    """A message about our keys as one about highway-env's."""
    observation = {f"observation.{theirs}": ours for theirs, ours in _OBSERVATION_KEYS.items()}
    all_keys = {**observation, **_KEYS, **_CONVERTED, "action.target_speeds": "task.target_speeds_mps"}
    for theirs, ours in all_keys.items():
        message = message.replace(f"`{ours}`", f"`{theirs}`")
    return message.replace("`task.reward_min_speed_mps`", "`reward_speed_range`")


register()
