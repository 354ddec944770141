"""Stable-Baselines3 learns from our vectors."""

from __future__ import annotations

import numpy as np
import pytest

import lanecraft

pytest.importorskip("stable_baselines3")

from stable_baselines3 import DQN, PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from lanecraft.sb3 import VecEnv, make_vec_env

#: Episodes end every eight ticks, or three decisions.
SHORT = {"default": {"env.episode_s": 4.0}, "fast": {"task.duration_s": 3.0}}


def bare(preset: str = "default", num_envs: int = 3, **task) -> VecEnv:
    task.setdefault("config", SHORT[preset])
    return VecEnv(lanecraft.VectorEnv(num_envs, preset=preset, autoreset_mode="SameStep", **task))


@pytest.mark.parametrize("kind", [{}, {"preset": "fast"}, {"preset": "paper"}, {"seat": "plan"}, {"seat": "control"}])
@pytest.mark.filterwarnings("ignore:.*unconventional shape:UserWarning")
def test_sb3_finds_nothing_to_say_of_one(kind):
    check_env(lanecraft.Env(**kind))


@pytest.mark.parametrize("preset", SHORT)
def test_the_same_comes_out_as_of_sb3s_own_vector(preset):
    """Step by step, over ends of episodes."""
    ours = bare(preset)
    theirs = DummyVecEnv([lambda: lanecraft.Env(preset=preset, config=SHORT[preset])] * 3)
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    for env in (ours, theirs):
        env.seed(5)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    ours.action_space.seed(0)
    ends = 0
    for _ in range(20):
        actions = np.array([ours.action_space.sample() for _ in range(3)])
        masks = np.stack(ours.env_method("action_masks"))
        np.testing.assert_array_equal(masks, np.stack(theirs.env_method("action_masks")))
        (first, rewards, dones, infos), (second, others, other_dones, other_infos) = ours.step(actions), theirs.step(actions)
        np.testing.assert_array_equal(first, second)
        np.testing.assert_array_equal(rewards, others)
        assert rewards.dtype == others.dtype
        np.testing.assert_array_equal(dones, other_dones)
        for index, (info, other) in enumerate(zip(infos, other_infos, strict=True)):
            other.pop("action_mask")
            np.testing.assert_equal(info, other)
        ends += dones.sum()
    assert ends >= 6


def test_the_end_of_an_episode_is_told():
    env = bare(num_envs=2)
    env.seed(1)
    first = env.reset()
    for _ in range(8):
        observations, _, dones, infos = env.step([4, 4])
    assert dones.all()
    for index, info in enumerate(infos):
        assert info["TimeLimit.truncated"] is True
        assert info["time_s"] == 4.0
        assert env.reset_infos[index]["time_s"] == 0.0
        assert (info["terminal_observation"] != observations[index]).any()
    assert (observations != first).any()


def test_a_collision_is_no_time_limit():
    env = make_vec_env(8, preset="fast", seed=0)
    env.reset()
    ends = {True: set(), False: set()}
    for _ in range(60):
        *_, infos = env.step([3] * 8)
        for info in infos:
            if "terminal_observation" in info:
                ends[info["collided"]].add(info["TimeLimit.truncated"])
    assert ends[True] == {False}


def test_seeds_are_those_of_single_environments():
    env = make_vec_env(2, seed=[7, 9], preset="fast")
    np.testing.assert_array_equal(env.reset(), [lanecraft.Env(preset="fast").reset(seed=seed)[0] for seed in (7, 9)])


def test_attributes_and_methods_are_asked_for_by_index():
    env = make_vec_env(3, seed=1)
    env.reset()
    assert env.get_attr("render_mode") == [None] * 3
    assert len(env.get_attr("action_names", indices=[0, 2])) == 2
    assert len(set(env.env_method("digest"))) == 3
    np.testing.assert_array_equal(env.env_method("action_masks", indices=1)[0], env.get_attr("action_masks", 1)[0]())
    assert env.env_is_wrapped(VecMonitor) == [False] * 3
    assert not env.has_attr("vehicle")
    with pytest.raises(AttributeError, match="action_masks and digest"):
        env.env_method("render")
    with pytest.raises(AttributeError, match="single environments"):
        env.set_attr("render_mode", "rgb_array")


def test_other_vectors_are_refused():
    with pytest.raises(ValueError, match="SameStep"):
        VecEnv(lanecraft.VectorEnv(2))
    with pytest.raises(ValueError, match="copy=True"):
        VecEnv(lanecraft.VectorEnv(2, autoreset_mode="SameStep", copy=False))


def test_returns_and_lengths_are_recorded():
    env = make_vec_env(2, seed=1, config=SHORT["default"])
    env.reset()
    for _ in range(8):
        *_, infos = env.step([4, 4])
    for info in infos:
        assert info["episode"]["l"] == 8
        assert info["episode"]["collided"] is False


@pytest.mark.parametrize("algorithm", [PPO, DQN])
def test_algorithms_learn(algorithm):
    size = {"n_steps": 16, "batch_size": 32} if algorithm is PPO else {"learning_starts": 50, "train_freq": 4}
    model = algorithm("MlpPolicy", make_vec_env(4, seed=1, preset="fast"), device="cpu", seed=1, **size)
    model.learn(256)
    mean, _ = evaluate_policy(model, make_vec_env(2, seed=9, preset="fast"), n_eval_episodes=4)
    assert 0.0 < mean < 31.0


def test_maskable_ppo_takes_allowed_actions_alone():
    maskable = pytest.importorskip("sb3_contrib").MaskablePPO
    env = make_vec_env(4, seed=1, masked_actions="raise")
    model = maskable("MlpPolicy", env, device="cpu", seed=1, n_steps=16, batch_size=32)
    model.learn(128)
