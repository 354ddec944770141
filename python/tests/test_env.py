"""One environment keeps Gymnasium's contract, and its own."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence

import lanecraft
from conftest import random_actions

IDS = ["lanecraft/Highway-v0", "lanecraft/HighwayPaper-v0", "lanecraft/HighwayFast-v0"]


def drive(env, steps: int, seed: int = 5) -> list:
    """What comes of the same actions, over ends of episodes."""
    seen = [env.reset(seed=seed)]
    for action in random_actions(env.action_space, steps):
        seen.append(env.step(action))
        if seen[-1][2] or seen[-1][3]:
            seen.append(env.reset())
    return seen


@pytest.mark.parametrize("name", IDS)
def test_gymnasium_finds_nothing_to_say(name):
    check_env(gymnasium.make(name, render_mode="rgb_array").unwrapped)


def test_every_kind_keeps_the_contract(kind):
    check_env(lanecraft.Env(**kind), skip_render_check=True)


def test_the_same_seed_gives_the_same_episode(env):
    assert data_equivalence(drive(env, 30), drive(env, 30), exact=True)


def test_another_seed_gives_another_episode(env):
    env.reset(seed=1)
    first = env.digest()
    env.reset(seed=2)
    assert env.digest() != first


def test_observations_stay_within_their_space(env):
    for observation, *_ in drive(env, 60):
        assert env.observation_space.contains(observation)


def test_a_series_goes_on_with_episodes_of_its_own():
    env = lanecraft.Env()
    digests = []
    for _ in range(2):
        env.reset(seed=3)
        digests.append([env.reset() and env.digest() for _ in range(3)])
    assert digests[0] == digests[1]
    assert len(set(digests[0])) == 3


def test_without_a_seed_series_differ():
    envs = lanecraft.Env(), lanecraft.Env()
    assert len({env.reset() and env.digest() for env in envs}) == 2


def test_a_forbidden_action_is_replaced_and_told():
    env = lanecraft.Env()
    _, info = env.reset(seed=5)
    forbidden = int(np.flatnonzero(info["action_mask"] == 0)[0])
    *_, info = env.step(forbidden)
    assert info["action"] != forbidden
    assert "hold" in env.action_names[info["action"]]


def test_a_forbidden_action_is_refused_on_request():
    env = lanecraft.Env(masked_actions="raise")
    _, info = env.reset(seed=5)
    digest = env.digest()
    with pytest.raises(lanecraft.ActionError, match="not allowed now; allowed are"):
        env.step(int(np.flatnonzero(info["action_mask"] == 0)[0]))
    assert env.digest() == digest


def test_masks_agree_and_hold_what_they_say():
    env = lanecraft.Env(masked_actions="raise")
    _, info = env.reset(seed=7)
    for _ in range(40):
        assert info["action_mask"].dtype == np.int8
        assert (info["action_mask"] == env.action_masks()).all()
        *_, terminated, truncated, info = env.step(env.action_space.sample(info["action_mask"]))
        if terminated or truncated:
            _, info = env.reset()


def test_rewards_are_the_sum_of_their_terms():
    env = lanecraft.Env()
    for *_, reward, _, _, info in [step for step in drive(env, 20) if len(step) == 5]:
        terms = sum(value for name, value in info.items() if name.startswith("reward_"))
        assert reward == pytest.approx(terms, abs=1e-12)


def test_a_decision_point_is_every_step_at_which_there_is_a_choice():
    env = lanecraft.DecisionPoints(lanecraft.Env(), discount=0.9)
    _, info = env.reset(seed=4)
    ticks = []
    for _ in range(60):
        assert info["decision_due"]
        assert info["action_mask"].shape == env.action_masks().shape == (env.action_space.n,)
        # The last allowed decision is a lane change, if there is one.
        *_, terminated, truncated, info = env.step(np.flatnonzero(info["action_mask"])[-1])
        ticks.append(info["ticks"])
        if terminated or truncated:
            _, info = env.reset()
    assert max(ticks) > 3, "a lane change takes more than a tick"


def test_a_scenario_is_found_by_name_and_by_path():
    assert "merge" in lanecraft.scenarios()
    path = Path(__file__).parents[2] / "scenarios" / "merge.toml"
    named, read = lanecraft.Env(scenario="merge"), lanecraft.Env(scenario=path)
    named.reset(seed=1)
    read.reset(seed=1)
    assert named.digest() == read.digest()
    assert named.config_toml == read.config_toml


@pytest.mark.parametrize("kind", [{}, {"preset": "fast"}, {"seat": "plan"}])
def test_a_snapshot_goes_on_bit_for_bit(kind):
    env, other = lanecraft.Env(**kind), lanecraft.Env(**kind)
    env.reset(seed=6)
    actions = random_actions(env.action_space, 20)
    for action in actions[:10]:
        env.step(action)
    other.restore(env.snapshot())
    for action in actions[10:]:
        assert data_equivalence(env.step(action)[0], other.step(action)[0], exact=True)
        assert env.digest() == other.digest()


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_bit_for_bit(copied):
    env = lanecraft.Env(config={"traffic.density_veh_per_km_lane": 20})
    env.reset(seed=6)
    env.step(0)
    other = copied(env)
    for action in random_actions(env.action_space, 10):
        env.step(action)
        other.step(action)
        assert env.digest() == other.digest()
    assert data_equivalence(env.reset()[0], other.reset()[0], exact=True)


def test_pictures_need_no_display(kind):
    env = lanecraft.Env(render_mode="rgb_array", **kind)
    env.reset(seed=1)
    picture = env.render()
    assert picture.shape == (150, 600, 3) and picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 4
    text = lanecraft.Env(render_mode="ansi", **kind)
    text.reset(seed=1)
    assert "m/s" in text.render()


def test_si_units_and_normalized_ones_say_the_same():
    normalized, si = lanecraft.Env(seat="control"), lanecraft.Env(seat="control", units="si")
    low, middle, high = si.action_bounds
    assert middle == [0.0, 0.0]
    normalized.reset(seed=2)
    si.reset(seed=2)
    for share in (-1.0, -0.5, 0.0, 0.25, 1.0):
        value = share * (high[0] if share > 0 else -low[0])
        normalized.step([share, 0.0])
        si.step([value, 0.0])
        assert normalized.digest() == si.digest()


def test_control_steps_are_shares_of_a_tick():
    env = lanecraft.Env(seat="control")
    env.reset(seed=2)
    *_, info = env.step(np.zeros(2, dtype=np.float32))
    assert info["time_s"] == pytest.approx(0.05)
    assert env.metadata["render_fps"] == 20
