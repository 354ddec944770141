"""Rules, and networks that were trained."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import lanecraft
from lanecraft import policies

INPUTS, ACTIONS = 46, 15


def tensor_file(tensors: dict[str, np.ndarray]) -> bytes:
    """The safetensors format: length of the header, header, values."""
    header, values = {}, b""
    for name, tensor in tensors.items():
        data = tensor.astype("<f4").tobytes()
        header[name] = {"dtype": "F32", "shape": tensor.shape, "data_offsets": [len(values), len(values) + len(data)]}
        values += data
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + values


@pytest.fixture
def network() -> tuple[np.ndarray, np.ndarray]:
    """Weights and biases of a linear network."""
    random = np.random.default_rng(0)
    return random.normal(size=(INPUTS, ACTIONS)), random.normal(size=ACTIONS)


@pytest.fixture
def run(tmp_path: Path, network) -> Path:
    """The folder of a finished run of the default environment with this network."""
    folder = tmp_path / "linear"
    folder.mkdir()
    weights, biases = network
    tensors = {"network.head.0.bias": biases[None], "network.head.0.weight": weights[None]}
    shape = {"format_version": 1, "inputs": INPUTS, "actions": ACTIONS, "core": [], "head": [], "heads": 1}
    manifest = {"schema": 1, "version": "0", "commit": "", "command": "train", "preset": "default", "seed": 0}
    manifest |= {"config_sha256": "", "finished": True, "files": {}}
    (folder / "policy.safetensors").write_bytes(tensor_file(tensors))
    (folder / "policy.json").write_text(json.dumps(shape))
    (folder / "manifest.json").write_text(json.dumps(manifest))
    (folder / "config.toml").write_text(lanecraft.Env().config_toml)
    return folder


def test_a_network_takes_the_best_of_the_allowed_actions(run, network):
    policy = policies.load(run)
    assert (policy.name, policy.observation_shape, policy.actions) == ("linear", [INPUTS], ACTIONS)
    random = np.random.default_rng(1)
    observations, masks = random.normal(size=(50, INPUTS)), random.random((50, ACTIONS)) < 0.5
    weights, biases = network
    values = observations @ weights + biases
    np.testing.assert_array_equal(policy.predict(observations), values.argmax(axis=1))
    found = policy.predict(observations, masks)
    np.testing.assert_array_equal(found, np.where(masks, values, -np.inf).argmax(axis=1))
    assert policy.predict(observations[0], masks[0]) == found[0]
    assert policy.predict(observations[:0]).shape == (0,)


def test_a_lane_change_under_way_goes_on(run):
    mask = np.zeros(ACTIONS + 2, dtype=np.int8)
    mask[ACTIONS:] = 1
    assert policies.load(run).predict(np.zeros(INPUTS), mask) == ACTIONS


def test_a_run_drives_as_its_predictions_do_and_as_it_acts(run):
    policy = policies.load(run)
    own = {"linear": lambda observation, info: policy.predict(observation, info["action_mask"])}
    short = {"episodes": 2, "config": {"evaluation.episode_s": 6}}
    assert lanecraft.evaluate(run, **short).episodes == lanecraft.evaluate(own, **short).episodes
    env = lanecraft.Env()
    observation, info = env.reset(seed=1)
    assert policy.act(env) == policy.predict(observation, info["action_mask"])


@pytest.mark.parametrize(
    ("observation", "mask", "error"),
    [
        (np.full(INPUTS, np.nan), None, lanecraft.ActionError),
        (np.full(INPUTS, np.inf), None, lanecraft.ActionError),
        (np.full(INPUTS, 1e300), None, lanecraft.ActionError),
        (np.zeros(3), None, lanecraft.ActionError),
        (np.zeros((2, 2, INPUTS)), None, lanecraft.ActionError),
        (None, None, TypeError),
        (["a"], None, TypeError),
        (np.zeros(INPUTS), np.zeros(ACTIONS, dtype=bool), lanecraft.ActionError),
        (np.zeros(INPUTS), np.ones(ACTIONS + 1, dtype=bool), lanecraft.ActionError),
        (np.zeros((2, INPUTS)), np.ones(ACTIONS, dtype=bool), lanecraft.ActionError),
        (np.zeros(INPUTS), np.ones(ACTIONS), TypeError),
    ],
)
def test_a_prediction_that_cannot_be_is_refused(run, observation, mask, error):
    with pytest.raises(error):
        policies.load(run).predict(observation, mask)


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


def test_the_driver_that_comes_with_the_package_drives():
    driver = policies.load("highway")
    env = lanecraft.Env(masked_actions="raise")
    observation, info = env.reset(seed=1)
    for _ in range(20):
        assert driver.predict(observation, info["action_mask"]) == driver.act(env)
        observation, *_, info = env.step(driver.act(env))
    assert info["speed_mps"] > 15.0


def test_heads_value_actions_as_the_vote_does() -> None:
    policy = policies.load("highway")
    observations = np.random.default_rng(1).normal(size=(50, INPUTS)).astype(np.float32)
    q = policy.q_heads(observations)
    assert q.shape == (50, 6, ACTIONS)
    np.testing.assert_array_equal(policy.q_heads(observations[3]), q[3])
    votes = np.array([np.bincount(q[row].argmax(axis=1), minlength=ACTIONS) for row in range(50)])
    clear = np.sort(votes, axis=1)[:, -1] > np.sort(votes, axis=1)[:, -2]
    assert clear.sum() > 10
    np.testing.assert_array_equal(policy.predict(observations)[clear], votes[clear].argmax(axis=1))
    with pytest.raises(TypeError):
        policies.load("rule:best-lane").q_heads(observations)
    with pytest.raises(lanecraft.ActionError):
        policy.q_heads(observations[:, 1:])


def test_the_onnx_model_is_the_policy() -> None:
    onnxruntime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx").checker.check_model(policies.load("highway").to_onnx(), full_check=True)
    policy = policies.load("highway")
    session = onnxruntime.InferenceSession(policy.to_onnx(), providers=["CPUExecutionProvider"])
    random = np.random.default_rng(2)
    observations = random.uniform(-1, 1, size=(500, INPUTS)).astype(np.float32)
    masks = random.random((500, ACTIONS)) < 0.6
    masks[:, 0] = True
    q_heads, q, action = session.run(None, {"observation": observations, "action_mask": masks})
    expected = policy.q_heads(observations)
    np.testing.assert_allclose(q_heads, expected, rtol=0, atol=1e-5)
    np.testing.assert_allclose(q, expected.mean(axis=1), rtol=0, atol=1e-5)
    np.testing.assert_array_equal(action, policy.predict(observations, masks))
