"""Paired evaluation of rules and of policies written in Python."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import lanecraft

SHORT = {"episodes": 3, "config": {"evaluation.episode_s": 6}}


class Recorder:
    """Takes the first action that is allowed and writes down what it was told."""

    def __init__(self):
        self.told = []

    def __call__(self, observation, info):
        self.told.append((observation, info))
        return int(np.flatnonzero(info["action_mask"])[0])


def test_the_same_scenarios_give_the_same_figures_at_any_number_of_threads():
    one = lanecraft.evaluate(["rule:best-lane", "rule:random"], threads=1, **SHORT)
    many = lanecraft.evaluate(["rule:best-lane", "rule:random"], threads=4, **SHORT)
    assert one.rows == many.rows
    assert one.episodes == many.episodes
    assert [episode["scenario_seed"] for episode in one.episodes[:3]] == [episode["scenario_seed"] for episode in one.episodes[3:]]
    assert lanecraft.evaluate("rule:random", seed=1, **SHORT).rows != lanecraft.evaluate("rule:random", **SHORT).rows


def test_a_policy_that_does_as_a_rule_does_gets_its_figures_to_the_bit():
    env = lanecraft.Env()
    env.reset(seed=1)
    # The rule always takes the same action.
    keep = lanecraft.policies.load("rule:keep-lane").act(env)
    results = lanecraft.evaluate({"rule:keep-lane": lambda observation, info: keep, "": "rule:keep-lane"}, **SHORT)
    own, rule = results.rows
    assert own == rule
    assert results.episodes[:3] == results.episodes[3:]


def test_a_policy_is_asked_where_a_decision_is_due_episode_by_episode():
    recorder = Recorder()
    results = lanecraft.evaluate(recorder, **SHORT)
    assert results.rows[0]["policy"] == "Recorder"
    env = lanecraft.Env()
    for observation, info in recorder.told:
        assert observation.shape == env.observation_space.shape and observation.dtype == np.float32
        assert not info["action_mask"][-2], "no lane change is under way"
    begins = [info["scenario_seed"] for _, info in recorder.told if info["tick"] == 0]
    assert begins == [episode["scenario_seed"] for episode in results.episodes]


def test_what_a_policy_raises_comes_out_as_it_is():
    class Lost(Exception):
        pass

    lost = Lost("here")

    def policy(observation, info):
        raise lost

    with pytest.raises(Lost) as raised:
        lanecraft.evaluate(policy, **SHORT)
    assert raised.value is lost


@pytest.mark.parametrize(
    ("action", "error"),
    [
        (99, lanecraft.ActionError),
        (-1, lanecraft.ActionError),
        (2**70, lanecraft.ActionError),
        (1.5, TypeError),
        (None, TypeError),
        (float("nan"), TypeError),
    ],
)
def test_an_action_that_is_none_is_refused(action, error):
    with pytest.raises(error):
        lanecraft.evaluate(lambda observation, info: action, **SHORT)


def test_forbidden_actions_are_replaced_or_refused():
    def forbidden(observation, info):
        return int(np.flatnonzero(info["action_mask"] == 0)[0])

    assert len(lanecraft.evaluate(forbidden, **SHORT).rows) == 1
    with pytest.raises(lanecraft.ActionError):
        lanecraft.evaluate(forbidden, masked_actions="raise", **SHORT)


def test_results_print_and_compare():
    results = lanecraft.evaluate({"a": Recorder(), "b": "rule:keep-lane"}, **SHORT)
    assert [row["policy"] for row in results.rows] == ["a", "rule:keep-lane"]
    (comparison,) = results.compare()
    rewards = [[e["reward_per_tick"] for e in results.episodes if e["policy"] == name] for name in ("a", "rule:keep-lane")]
    assert comparison.mean == pytest.approx(np.mean(np.subtract(*rewards)), abs=1e-12)
    assert comparison.low <= comparison.mean <= comparison.high
    assert repr(results).splitlines()[0].startswith("policy")
    assert comparison.text in repr(results)


def test_without_pandas_the_error_names_the_extra(monkeypatch):
    results = lanecraft.evaluate("rule:keep-lane", **SHORT)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r"lanecraft\[frames\]"):
        results.to_pandas()


def test_frames_have_a_row_for_each_policy_or_episode():
    pytest.importorskip("pandas")
    results = lanecraft.evaluate("rule:keep-lane", **SHORT)
    frame = results.to_pandas()
    assert frame.loc[0, "speed_mps_low"] == results.rows[0]["speed_mps"]["low"]
    assert len(results.to_pandas(episodes=True)) == 3


@pytest.mark.parametrize(
    ("kwargs", "error"),
    [
        ({"policies": None}, TypeError),
        ({"policies": [3]}, TypeError),
        ({"policies": []}, lanecraft.ConfigError),
        ({"policies": ["rule:nobody"]}, lanecraft.ConfigError),
        ({"episodes": 1}, lanecraft.ConfigError),
        ({"episodes": 2**70}, lanecraft.ConfigError),
        ({"episodes": 2.0}, TypeError),
        ({"seed": 2**40}, lanecraft.ConfigError),
        ({"seed": -1}, lanecraft.ConfigError),
        ({"threads": 2**70}, lanecraft.ConfigError),
        ({"preset": "fast"}, lanecraft.ConfigError),
        ({"masked_actions": "ignore"}, lanecraft.ConfigError),
        ({"scenario": "nowhere"}, lanecraft.ConfigError),
    ],
)
def test_an_evaluation_that_cannot_be_is_refused(kwargs, error):
    with pytest.raises(error):
        lanecraft.evaluate(**({"policies": "rule:keep-lane"} | SHORT | kwargs))
