"""Scripts for highway-env run with one line changed."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import lanecraft
import lanecraft.highway_env as compat

IDS = ["highway-v0", "highway-fast-v0"]

#: What highway-env 1.12.1 says: lanes, vehicles, simulation frequency, duration, spacing of the ego.
THEIRS = {"highway-v0": (4, 50, 15, 40, 2), "highway-fast-v0": (3, 20, 5, 30, 1.5)}
#: ... and what both of its environments share.
SHARED = {
    "action": {"type": "DiscreteMetaAction"},
    "centering_position": [0.3, 0.5],
    "collision_reward": -1,
    "controlled_vehicles": 1,
    "high_speed_reward": 0.4,
    "initial_lane_id": None,
    "lane_change_reward": 0,
    "manual_control": False,
    "neighbour_vehicles_connected_lanes": False,
    "normalize_reward": True,
    "observation": {"type": "Kinematics"},
    "offroad_terminal": False,
    "offscreen_rendering": None,
    "other_vehicles_type": "highway_env.vehicle.behavior.IDMVehicle",
    "policy_frequency": 1,
    "real_time_rendering": False,
    "render_agent": True,
    "reward_speed_range": [20, 30],
    "right_lane_reward": 0.1,
    "scaling": 5.5,
    "screen_height": 150,
    "screen_width": 600,
    "show_trajectories": False,
    "vehicles_density": 1,
}


def make(name: str = "highway-fast-v0", **kwargs) -> compat.HighwayEnv:
    return gymnasium.make(name, **kwargs).unwrapped


@pytest.mark.parametrize("name", IDS)
def test_defaults_are_highway_envs(name):
    lanes, vehicles, simulation_hz, duration_s, spacing = THEIRS[name]
    own = {"lanes_count": lanes, "vehicles_count": vehicles, "simulation_frequency": simulation_hz, "duration": duration_s}
    assert make(name).config == {**SHARED, **own, "ego_spacing": spacing}


@pytest.mark.parametrize("name", IDS)
def test_spaces_and_actions_are_highway_envs(name):
    env = make(name)
    assert env.observation_space == gymnasium.spaces.Box(-np.inf, np.inf, (5, 5), np.float32)
    assert env.action_space == gymnasium.spaces.Discrete(5)
    assert compat.ACTIONS == {0: "LANE_LEFT", 1: "IDLE", 2: "LANE_RIGHT", 3: "FASTER", 4: "SLOWER"}


@pytest.mark.parametrize("name", IDS)
def test_highway_env_itself_agrees(name):
    theirs = pytest.importorskip("highway_env.envs", exc_type=ImportError)
    real = {"highway-v0": theirs.HighwayEnv, "highway-fast-v0": theirs.HighwayEnvFast}[name]()
    ours = make(name)
    assert real.default_config() == ours.default_config()
    assert (real.observation_space, real.action_space) == (ours.observation_space, ours.action_space)
    observation, info = real.reset(seed=0)
    other_observation, other_info = ours.reset(seed=0)
    assert (observation.shape, observation.dtype) == (other_observation.shape, other_observation.dtype)
    assert set(info) <= set(other_info)
    assert set(info["rewards"]) == set(other_info["rewards"])
    assert real.action_type.actions_indexes == ours.action_type.actions_indexes
    real.close()


@pytest.mark.parametrize("name", IDS)
def test_gymnasium_finds_nothing_to_say(name):
    with warnings.catch_warnings():
        # The space has no bounds, as in highway-env.
        warnings.filterwarnings("ignore", message=".*Box observation space m.*imum value is -?infinity.*")
        check_env(make(name, render_mode="rgb_array"))


def test_the_defaults_are_those_of_the_fast_preset():
    env = make()
    env.reset(seed=4)
    plain = lanecraft.Env(preset="fast")
    plain.reset(seed=4)
    for action in [4, 1, 1, 4]:
        observation, reward, *_ = env.step(action)
        same, same_reward, *_ = plain.step(action)
        np.testing.assert_array_equal(observation, same)
        assert reward == same_reward


def test_configurations_come_from_all_three_places():
    first = {"observation": {"type": "Kinematics", "vehicles_count": 7, "features": ["x", "y", "cos_h"]}}
    env = make(config=first)
    assert env.reset(seed=0)[0].shape == (7, 3)
    env.configure({"lanes_count": 2, "action": {"type": "DiscreteMetaAction", "target_speeds": [15, 20]}})
    env.config["vehicles_count"] = 8
    env.reset(seed=0)
    _, info = env.reset(seed=0, options={"config": {"observation": {"type": "Kinematics", "vehicles_count": 3}}})
    assert env.observation_space.shape == (3, 5)
    assert "lanes = 2" in env._env.config_toml
    assert "vehicles = 8" in env._env.config_toml


def test_a_new_configuration_keeps_the_series_reproducible():
    digests = []
    for _ in range(2):
        env = make()
        env.reset(seed=7)
        env.configure({"vehicles_count": 10})
        env.reset()
        digests.append(env._env.digest())
    assert digests[0] == digests[1]


def test_an_episode_ends_when_its_duration_is_reached():
    env = make(config={"duration": 10, "policy_frequency": 2, "simulation_frequency": 10, "action": {"type": "DiscreteMetaAction"}})
    env.reset(seed=0)
    ends = [env.step(4)[2:4] for _ in range(20)]
    assert ends == [(False, False)] * 19 + [(False, True)]


@pytest.mark.parametrize("normalize", [True, False])
def test_the_rewards_add_up(normalize):
    env = make(config={"normalize_reward": normalize, "lanes_count": 4})
    weights = {name: env.config.get(name, 0) for name in ["collision_reward", "right_lane_reward", "high_speed_reward"]}
    best = weights["high_speed_reward"] + weights["right_lane_reward"]
    env.action_space.seed(0)
    crashes = 0
    for seed in range(20):
        env.reset(seed=seed)
        over = False
        while not over:
            _, reward, terminated, truncated, info = env.step(env.action_space.sample())
            sum_ = sum(weight * info["rewards"][name] for name, weight in weights.items())
            expected = (sum_ + 1.0) / (best + 1.0) if normalize else sum_
            # The heading comes out of an observation of single precision.
            assert reward == pytest.approx(expected, abs=1e-6)
            assert info["crashed"] == terminated
            over = terminated or truncated
            crashes += terminated
    assert crashes > 0


def test_info_tells_speed_and_the_action_as_given():
    env = make()
    _, info = env.reset(seed=0)
    assert info["rewards"]["on_road_reward"] == 1.0
    *_, info = env.step(np.int64(3))
    assert info["speed"] == info["speed_mps"] > 20.0
    assert info["action"] == 3


def test_available_actions_keep_to_the_road_and_the_target_speeds():
    env = make(config={"lanes_count": 1, "vehicles_count": 1})
    env.reset(seed=0)
    assert set(env.get_available_actions()) <= {1, 3, 4}
    assert env.action_type.get_available_actions() == env.get_available_actions()
    for _ in range(3):
        env.step(3)
    assert env.action_type.actions_indexes["FASTER"] not in env.get_available_actions()
    np.testing.assert_array_equal(np.flatnonzero(env.action_masks()), sorted(env.get_available_actions()))


def test_the_screen_has_the_size_asked_for():
    env = make(render_mode="rgb_array", config={"screen_width": 300, "screen_height": 100, "scaling": 3, "offscreen_rendering": True})
    env.reset(seed=0)
    picture = env.render()
    assert (picture.shape, picture.dtype) == ((100, 300, 3), np.uint8)
    assert len(np.unique(picture)) > 3
    assert make().render() is None


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_on_its_own(copied):
    env = make()
    env.reset(seed=0)
    env.step(0)
    twin = copied(env)
    first, second = (one.step(2) for one in (env, twin))
    np.testing.assert_array_equal(first[0], second[0])
    assert first[1] == second[1]
    assert first[4]["rewards"] == second[4]["rewards"]


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({"vehicle_count": 3}, ["`vehicle_count`", "nearest is `vehicles_count`", "allowed are", "duration"]),
        ({"vehicles_count": 0}, ["`vehicles_count` is 0", "1..="]),
        ({"lanes_count": 2.5}, ["`lanes_count` is 2.5"]),
        ({"lanes_count": 10**5}, ["`lanes_count` is 100000"]),
        ({"vehicles_density": 0}, ["`vehicles_density` is 0"]),
        ({"vehicles_density": float("inf")}, ["`vehicles_density` is inf"]),
        ({"duration": float("nan")}, ["`duration` is nan"]),
        ({"collision_reward": float("nan")}, ["`collision_reward`"]),
        ({"policy_frequency": 20}, ["`policy_frequency` is 20", "`simulation_frequency`, 5"]),
        ({"reward_speed_range": [30, 20]}, ["`reward_speed_range`"]),
        ({"reward_speed_range": [20]}, ["`reward_speed_range` has 1"]),
        ({"vehicles_count": 10**30}, ["64 bits"]),
        ({"controlled_vehicles": 2}, ["`controlled_vehicles` is 2", "allowed here is 1"]),
        ({"screen_width": -3}, ["`screen_width` is -3"]),
        ({"observation": {"type": "OccupancyGrid"}}, ["`observation.type` is 'OccupancyGrid'", "'Kinematics'"]),
        ({"observation": {"type": "Kinematics", "vehicle_count": 5}}, ["nearest is `observation.vehicles_count`"]),
        ({"observation": {"type": "Kinematics", "vehicles_count": 10**9}}, ["`observation.vehicles_count`", "1..=64"]),
        ({"observation": {"type": "Kinematics", "features": ["vz"]}}, ["`observation.features`", "`vx`"]),
        ({"action": {"type": "ContinuousAction"}}, ["`action.type`", "'DiscreteMetaAction'"]),
        ({"action": {"type": "DiscreteMetaAction", "target_speeds": [30, 20]}}, ["`action.target_speeds`"]),
    ],
)
def test_what_means_nothing_here_is_named(config, words):
    with pytest.raises(lanecraft.ConfigError) as error:
        make(config=config)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    "config",
    [
        3,
        {"duration": None},
        {"duration": True},
        {"lanes_count": "3"},
        {"reward_speed_range": None},
        {"observation": None},
        {"observation": {"type": "Kinematics", "features": 3}},
        {"action": {"type": "DiscreteMetaAction", "target_speeds": "fast"}},
    ],
)
def test_wrong_types_are_type_errors(config):
    with pytest.raises(TypeError):
        make(config=config)


def test_a_refused_configuration_changes_nothing():
    env = make()
    before = copy.deepcopy(env.config)
    with pytest.raises(lanecraft.ConfigError):
        env.configure({"lanes_count": 2, "lane_count": 2})
    assert env.config == before


def test_other_render_modes_are_refused():
    with pytest.raises(lanecraft.ConfigError, match="rgb_array"):
        compat.HighwayEnv(render_mode="human")


def test_a_configuration_serves_vectors_too():
    config = {"vehicles_count": 12, "lanes_count": 2, "vehicles_density": 1.5, "duration": 7}
    env = make(config=config)
    observation, _ = env.reset(seed=3)
    envs = lanecraft.VectorEnv(2, preset="fast", config=compat.to_lanecraft(config))
    observations, _ = envs.reset(seed=3)
    np.testing.assert_array_equal(observations[0], observation)


#: Density at which highway-env places vehicles, vehicles per kilometer and lane, on roads without end.
@pytest.mark.parametrize(("lanes", "veh_per_km_lane"), [(1, 33), (2, 19), (3, 14), (4, 12), (5, 11)])
def test_density_is_that_of_highway_envs_start(lanes, veh_per_km_lane):
    density = compat.to_lanecraft({"lanes_count": lanes, "vehicles_density": 2})["traffic.density_veh_per_km_lane"]
    assert density == 2 * veh_per_km_lane


IN_ORDER = """
import sys, types, warnings, gymnasium
gymnasium.register(id="highway-v0", entry_point="highway_env.envs.highway_env:HighwayEnv")
with warnings.catch_warnings(record=True) as seen:
    warnings.simplefilter("always")
    import lanecraft.highway_env as compat
assert "lanecraft/highway-v0" in str(seen[0].message), seen
assert "highway_env.envs" in gymnasium.spec("highway-v0").entry_point
assert isinstance(gymnasium.make("lanecraft/highway-v0").unwrapped, compat.HighwayEnv)
assert isinstance(gymnasium.make("highway-fast-v0").unwrapped, compat.HighwayEnvFast)
compat.register(override=True)
assert isinstance(gymnasium.make("highway-v0").unwrapped, compat.HighwayEnv)
"""


def test_ids_of_highway_env_stay_until_told():
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", IN_ORDER], check=True, env=environment)
