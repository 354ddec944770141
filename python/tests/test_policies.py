"""Rules, and networks that were trained."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import lanecraft
from lanecraft import policies


@pytest.mark.parametrize("name", ["keep-lane", "random", "idm-mobil", "best-lane"])
def test_rules_drive_an_environment(name):
    rule, env = policies.load(f"rule:{name}"), lanecraft.Env(config={"env.episode_s": 5})
    observation, info = env.reset(seed=1)
    for _ in range(10):
        action = rule.act(env)
        assert info["action_mask"][action]
        observation, _, _, _, info = env.step(action)
    assert rule.name == f"rule:{name}" and rule.actions is None and rule.observation_shape is None
    with pytest.raises(TypeError):
        rule.predict(observation)


@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("rule:best-lan", lanecraft.ConfigError),
        ("rule:", lanecraft.ConfigError),
        ("no/such/run", lanecraft.ConfigError),
        ("", lanecraft.ConfigError),
        ("nul\0", lanecraft.ConfigError),
        (None, TypeError),
        (3, TypeError),
    ],
)
def test_what_is_no_policy_is_refused(name, error):
    with pytest.raises(error):
        policies.load(name)


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(lanecraft.ConfigError, match=str(tmp_path)):
        policies.load(tmp_path)


def test_a_rule_acts_only_where_there_is_something_to_act_in():
    rule = policies.load("rule:best-lane")
    for env, error in [(None, TypeError), (3, TypeError), (lanecraft.Env(), ResetNeeded)]:
        with pytest.raises(error):
            rule.act(env)
    fast = lanecraft.Env(preset="fast")
    fast.reset(seed=1)
    with pytest.raises(TypeError):
        rule.act(fast)


def test_masks_and_observations_are_checked_before_a_network_sees_them():
    from lanecraft.policies import _masks

    assert _masks(None, (), 3).shape == (1, 3)
    assert _masks(np.ones((2, 5), dtype=np.int8), (2,), 3).shape == (2, 5)
    with pytest.raises(lanecraft.ActionError):
        _masks(np.ones(4, dtype=bool), (), 3)
    with pytest.raises(TypeError):
        _masks(np.ones(3), (), 3)
