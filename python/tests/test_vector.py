"""Many environments at once are the same as one after the other, at any number of threads."""

from __future__ import annotations

import os

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.utils.env_match import check_environments_match
from gymnasium.vector import AutoresetMode

import lanecraft

MODES = list(AutoresetMode)
#: Short episodes, so that ends are met.
SHORT = {"config": {"env.episode_s": 4.0}}


class LaneZero(gymnasium.Env):
    """The first of many environments as one."""

    def __init__(self, vector: lanecraft.VectorEnv) -> None:
        self.vector = vector
        self.action_space = vector.single_action_space
        self.observation_space = vector.single_observation_space
        self.render_mode = None

    def reset(self, *, seed=None, options=None):
        observations, infos = self.vector.reset(seed=seed)
        return observations[0], self.first(infos)

    def step(self, action):
        actions = np.stack([np.asarray(action)] * self.vector.num_envs)
        observations, rewards, terminated, truncated, infos = self.vector.step(actions)
        return observations[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), self.first(infos)

    def first(self, infos):
        names = [name for name in infos if not name.startswith("_")]
        return {name: infos[name][0] if name == "action_mask" else infos[name][0].item() for name in names}


def test_the_first_of_many_is_the_one(kind):
    one, many = lanecraft.Env(**kind), lanecraft.VectorEnv(3, autoreset_mode="Disabled", **kind)
    check_environments_match(one, LaneZero(many), num_steps=30, seed=5)


def run(threads: int, mode: AutoresetMode = AutoresetMode.NEXT_STEP, steps: int = 12, **kind):
    env = lanecraft.VectorEnv(5, threads=threads, autoreset_mode=mode, **(kind or SHORT))
    seen = [env.reset(seed=9)]
    env.action_space.seed(1)
    for _ in range(steps):
        seen.append(env.step(env.action_space.sample()))
    return seen, env.digests()


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_any_number_of_threads_gives_the_same_bits(mode):
    first, digests = run(1, mode)
    for threads in (2, 8):
        again, others = run(threads, mode)
        assert digests == others
        assert data_equivalence(first, again, exact=True)


@pytest.mark.parametrize("kind", [{}, {"preset": "fast"}, {"seat": "control"}])
def test_each_environment_is_that_of_its_seed(kind):
    env = lanecraft.VectorEnv(4, **kind)
    env.reset(seed=20)
    alone = lanecraft.Env(**kind)
    digests = []
    for seed in range(20, 24):
        alone.reset(seed=seed)
        digests.append(alone.digest())
    assert env.digests() == digests
    env.reset(seed=[23, 22, 21, 20])
    assert env.digests() == digests[::-1]


def returns(mode: AutoresetMode, episodes: int) -> np.ndarray:
    """Returns of the first episodes of each environment, driven by the same action at every tick."""
    env = lanecraft.VectorEnv(3, autoreset_mode=mode, **SHORT)
    env.reset(seed=2)
    sums, found = np.zeros(3), [[] for _ in range(3)]
    for _ in range(10 * episodes):
        _, rewards, terminated, truncated, _ = env.step(np.zeros(3, dtype=np.int64))
        sums += rewards
        ended = terminated | truncated
        for index in np.flatnonzero(ended):
            found[index].append(sums[index])
            sums[index] = 0.0
        if mode is AutoresetMode.DISABLED and ended.any():
            env.reset(options={"reset_mask": ended})
    return np.array([one[:episodes] for one in found])


def test_returns_are_equal_in_all_modes():
    first, *others = [returns(mode, 3) for mode in MODES]
    assert first.shape == (3, 3)
    for other in others:
        assert (first == other).all()


def test_the_same_step_hands_over_the_last_observation():
    same = lanecraft.VectorEnv(2, autoreset_mode=AutoresetMode.SAME_STEP, **SHORT)
    none = lanecraft.VectorEnv(2, autoreset_mode=AutoresetMode.DISABLED, **SHORT)
    same.reset(seed=1)
    none.reset(seed=1)
    for _ in range(8):
        seen, *_, infos = same.step([0, 0])
        last, *_, ended, last_infos = none.step([0, 0])
    assert ended.all() and infos["_final_obs"].all()
    assert (infos["final_obs"] == last).all() and (seen != last).any()
    assert (infos["final_info"]["speed_mps"] == last_infos["speed_mps"]).all()
    assert (infos["time_s"] == 0.0).all()


def test_the_next_step_does_not_read_its_action():
    env = lanecraft.VectorEnv(2, **SHORT)
    env.reset(seed=1)
    for _ in range(8):
        *_, truncated, _ = env.step([0, 0])
    assert truncated.all()
    _, rewards, _, truncated, infos = env.step([10_000, -10_000])
    assert (rewards == 0.0).all() and not truncated.any() and (infos["time_s"] == 0.0).all()


def test_a_step_after_the_end_is_refused_where_nothing_resets():
    env = lanecraft.VectorEnv(2, autoreset_mode="Disabled", **SHORT)
    env.reset(seed=1)
    for _ in range(8):
        env.step([0, 0])
    with pytest.raises(gymnasium.error.ResetNeeded, match="environment 0"):
        env.step([0, 0])


def test_a_bad_action_moves_nobody():
    env = lanecraft.VectorEnv(3)
    env.reset(seed=1)
    digests = env.digests()
    with pytest.raises(lanecraft.ActionError, match="environment 2: action 99 does not exist; there are 0 to 16"):
        env.step([0, 0, 99])
    assert env.digests() == digests


def test_without_copies_arrays_are_written_anew():
    env = lanecraft.VectorEnv(2, copy=False)
    first, _ = env.reset(seed=1)
    before = first.copy()
    second, *_ = env.step([0, 0])
    assert np.shares_memory(first, second) and (first != before).any()
    kept = lanecraft.VectorEnv(2)
    first, _ = kept.reset(seed=1)
    second, *_ = kept.step([0, 0])
    assert not np.shares_memory(first, second)


def test_gymnasium_makes_them():
    env = gymnasium.make_vec("lanecraft/HighwayFast-v0", num_envs=3, vectorization_mode="vector_entry_point")
    assert isinstance(env.unwrapped, lanecraft.VectorEnv)
    observations, infos = env.reset(seed=1)
    assert observations.shape == (3, 5, 5) and infos["action_mask"].shape == (3, 5)
    env.close()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_goes_on_with_the_same_bits():
    env = lanecraft.VectorEnv(4, threads=2)
    env.reset(seed=1)
    env.step([0] * 4)
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        env.step([0] * 4)
        os.write(writing, repr(env.digests()).encode())
        os._exit(0)
    env.step([0] * 4)
    os.close(writing)
    with os.fdopen(reading) as pipe:
        assert pipe.read() == repr(env.digests())
    os.waitpid(child, 0)
