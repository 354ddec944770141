"""Whatever is handed in, a documented exception comes back: nothing aborts, nothing moves, and no NaN gets through."""

from __future__ import annotations

import os
import threading

import gymnasium
import numpy as np
import pytest

import lanecraft

REFUSALS = (TypeError, ValueError)
NAN, INF = float("nan"), float("inf")
HUGE = 10**30
STRANGE = [None, "0", b"0", [], {}, object(), 1j, [None], ["a"], np.array([]), np.array(["a"]), np.zeros((0, 3))]
NO_WHOLE_NUMBER = [NAN, INF, -INF, 0.5, np.float32(1), HUGE, -HUGE, -1, 17, *STRANGE]
#: Two numbers make a command.
NO_COMMAND = [
    [NAN, 0.0],
    [0.0, INF],
    [-INF, 0.0],
    [1.5, 0.0],
    [HUGE, 0],
    [0.0],
    [0.0, 0.0, 0.0],
    [[0.0, 0.0]],
    np.zeros((2, 1)),
    np.full(2, NAN, dtype=np.float16),
    0.0,
    *STRANGE,
]


def refuses(job, *refusals) -> None:
    with pytest.raises(refusals or REFUSALS) as caught:
        job()
    assert str(caught.value), "a refusal says why"


@pytest.fixture
def decide():
    env = lanecraft.Env()
    env.reset(seed=1)
    return env


@pytest.fixture
def control():
    env = lanecraft.Env(seat="control")
    env.reset(seed=1)
    return env


@pytest.mark.parametrize("action", NO_WHOLE_NUMBER, ids=repr)
def test_no_whole_number_is_an_action(decide, action):
    digest = decide.digest()
    refuses(lambda: decide.step(action))
    assert decide.digest() == digest


@pytest.mark.parametrize("action", NO_COMMAND, ids=repr)
def test_no_command_is_an_action(control, action):
    digest = control.digest()
    refuses(lambda: control.step(action))
    assert control.digest() == digest


@pytest.mark.parametrize(
    "action",
    [
        np.zeros(4)[::2],
        np.zeros((2, 2))[:, 0],
        np.zeros(2, dtype=np.float16),
        np.zeros(2, dtype=">f8"),
        np.zeros(2, dtype=np.int8),
        [0, 0],
        (0.0, -0.0),
    ],
    ids=repr,
)
def test_any_layout_of_the_right_numbers_will_do(control, action):
    if isinstance(action, np.ndarray):
        action.flags.writeable = False
    assert np.isfinite(control.step(action)[0]).all()


@pytest.mark.parametrize("actions", [[0], [0, 0, 0], [[0, 0]], [0.0, 1.0], [NAN, 0], [0, 99], [-1, 0], [HUGE, 0], 0, *STRANGE], ids=repr)
def test_no_actions_for_two(actions):
    env = lanecraft.VectorEnv(2)
    env.reset(seed=1)
    digests = env.digests()
    refuses(lambda: env.step(actions))
    assert env.digests() == digests


@pytest.mark.parametrize("seat", ["plan", "control"])
@pytest.mark.parametrize("bad", [NAN, INF, -INF, 1.001, -2.0])
def test_no_number_of_a_batch_of_vectors_may_be_bad(seat, bad):
    env = lanecraft.VectorEnv(3, seat=seat)
    env.reset(seed=1)
    digests = env.digests()
    for at in np.ndindex(env.action_space.shape):
        actions = np.zeros(env.action_space.shape)
        actions[at] = bad
        with pytest.raises(lanecraft.ActionError, match=f"environment {at[0]}: number {at[1]}"):
            env.step(actions)
    assert env.digests() == digests


@pytest.mark.parametrize("seed", [-1, 2**64, HUGE, 0.0, NAN, "1", [1], b""], ids=repr)
def test_no_seed(seed):
    refuses(lambda: lanecraft.Env().reset(seed=seed))
    refuses(lambda: lanecraft.VectorEnv(2).reset(seed=seed))


def test_the_largest_seed_is_one():
    lanecraft.Env(preset="fast").reset(seed=2**64 - 1)
    lanecraft.Env(preset="fast").reset(seed=np.uint64(2**64 - 1))
    refuses(lambda: lanecraft.VectorEnv(2, preset="fast").reset(seed=2**64 - 1))
    refuses(lambda: lanecraft.VectorEnv(2, preset="fast").reset(seed=[1, None]))


CONFIGS = [
    ({"traffic.densty_veh_per_km_lane": 5}, "did you mean `traffic.density_veh_per_km_lane`"),
    ({"traffic": {"density_veh_per_km_lane": NAN}}, "density_veh_per_km_lane"),
    ({"traffic": {"density_veh_per_km_lane": INF}}, "density_veh_per_km_lane"),
    ({"traffic.density_veh_per_km_lane": -3.0}, "must be in"),
    ({"traffic.density_veh_per_km_lane": HUGE}, "does not fit 64 bits"),
    ({"traffic.density_veh_per_km_lane": "many"}, "must be"),
    ({"road": 5}, "road"),
    ({"env.scenario": "x"}, "scenario"),
    ({"observation.form": "gird"}, "did you mean `grid`"),
    ({"env.decision_period_s": 0.07}, "no whole multiple"),
]


@pytest.mark.parametrize("make", [lanecraft.Env, lambda **kind: lanecraft.VectorEnv(2, **kind)])
@pytest.mark.parametrize(("config", "message"), CONFIGS, ids=repr)
def test_no_configuration(make, config, message):
    with pytest.raises(lanecraft.ConfigError, match=message):
        make(config=config)


@pytest.mark.parametrize(
    ("config", "message"),
    [({"task.vehicles": -1}, "vehicles"), ({"task.vehicle": 3}, "did you mean `task.vehicles`"), ({"task.duration_s": NAN}, "duration_s")],
    ids=repr,
)
def test_no_configuration_of_the_fast_environment(config, message):
    with pytest.raises(lanecraft.ConfigError, match=message):
        lanecraft.Env(preset="fast", config=config)


@pytest.mark.parametrize("config", [[], "x", 3, {1: 2}, {"road.lanes": None}, {"road.lanes": object()}, {"road.lanes": b"3"}], ids=repr)
def test_no_configuration_at_all(config):
    refuses(lambda: lanecraft.Env(config=config))


def test_a_configuration_that_holds_itself():
    config: dict = {}
    config["road"] = config
    with pytest.raises(lanecraft.ConfigError, match="nested too deeply"):
        lanecraft.Env(config=config)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"preset": "defualt"}, "did you mean `default`"),
        ({"seat": "controll"}, "did you mean `control`"),
        ({"scenario": "mergee"}, "did you mean `merge`"),
        ({"scenario": "no/such/file.toml"}, "cannot read"),
        ({"scenario": ""}, "no scenario"),
        ({"scenario": "recorded-freeway"}, "recording"),
        ({"masked_actions": "refuse"}, "raise"),
        ({"units": "imperial"}, "si"),
        ({"render_mode": "human"}, "rgb_array"),
        ({"preset": "fast", "seat": "plan"}, "fast"),
        ({"preset": "fast", "scenario": "merge"}, "fast"),
    ],
    ids=repr,
)
def test_no_such_name(arguments, message):
    with pytest.raises(lanecraft.ConfigError, match=message):
        lanecraft.Env(**arguments)


@pytest.mark.parametrize("name", ["preset", "seat", "scenario", "masked_actions", "units"])
@pytest.mark.parametrize("value", [3, NAN, b"default", ["default"]], ids=repr)
def test_no_name_at_all(name, value):
    refuses(lambda: lanecraft.Env(**{name: value}))


@pytest.mark.parametrize("arguments", [{"num_envs": 0}, {"num_envs": -1}, {"num_envs": HUGE}, {"num_envs": 1.5}, {"threads": -1},
                                       {"threads": 10**6}, {"autoreset_mode": "Never"}, {"autoreset_mode": None},
                                       {"render_mode": "rgb_array"}], ids=repr)  # fmt: skip
def test_no_vector(arguments):
    refuses(lambda: lanecraft.VectorEnv(**({"num_envs": 2} | arguments)))


@pytest.mark.parametrize("mask", [[1, 0], [True], np.ones((2, 1), dtype=bool), "no", [NAN, 1.0]], ids=repr)
def test_no_reset_mask(mask):
    env = lanecraft.VectorEnv(2)
    env.reset(seed=1)
    refuses(lambda: env.reset(options={"reset_mask": mask}))


@pytest.mark.parametrize("damage", [b"", b"LANESNAP", b"x" * 100, None, "text", 5], ids=repr)
def test_no_snapshot(decide, damage):
    digest = decide.digest()
    refuses(lambda: decide.restore(damage))
    assert decide.digest() == digest


def test_a_damaged_snapshot(decide):
    good = decide.snapshot()
    for at in np.linspace(0, len(good) - 1, 40).astype(int):
        bad = bytearray(good)
        bad[at] ^= 0x10
        refuses(lambda: decide.restore(bytes(bad)), lanecraft.SnapshotError)
        refuses(lambda: decide.restore(good[:at]), lanecraft.SnapshotError)


def test_a_snapshot_of_another_configuration(decide):
    for other in (lanecraft.Env(config={"road.lanes": 4}), lanecraft.Env(preset="fast")):
        refuses(lambda: other.restore(decide.snapshot()), lanecraft.SnapshotError)


@pytest.mark.parametrize("make", [lanecraft.Env, lambda: lanecraft.VectorEnv(2)])
def test_out_of_order(make):
    env = make()
    action = env.action_space.sample()
    refuses(lambda: env.step(action), gymnasium.error.ResetNeeded)
    env.reset(seed=1)
    env.close()
    env.close()
    refuses(lambda: env.step(action), gymnasium.error.ClosedEnvironmentError)
    refuses(env.reset, gymnasium.error.ClosedEnvironmentError)


def test_out_of_order_in_one():
    env = lanecraft.Env(render_mode="ansi")
    for call in (env.snapshot, env.digest, env.action_masks, env.render):
        refuses(call, gymnasium.error.ResetNeeded)
    env.reset(seed=1)
    env.close()
    for call in (env.snapshot, env.digest, env.action_masks, env.render):
        refuses(call, gymnasium.error.ClosedEnvironmentError)


def test_after_the_end():
    env = lanecraft.Env(config={"env.episode_s": 1.0})
    env.reset(seed=1)
    env.step(0)
    assert env.step(0)[3]
    refuses(lambda: env.step(0), gymnasium.error.ResetNeeded)


@pytest.mark.parametrize("make", [lanecraft.Env, lambda: lanecraft.VectorEnv(4, threads=2)])
def test_two_threads_at_once(make):
    env = make()
    env.reset(seed=1)
    action = env.action_space.sample()
    unexpected: list[BaseException] = []

    def drive():
        for _ in range(60):
            try:
                env.step(action)
            except (RuntimeError, gymnasium.error.ResetNeeded):
                pass
            except BaseException as error:
                unexpected.append(error)

    threads = [threading.Thread(target=drive) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not unexpected
    env.reset(seed=1)
    again = make()
    again.reset(seed=1)
    assert np.array_equal(env.step(action)[0], again.step(action)[0])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process(decide):
    child = os.fork()
    if child == 0:
        decide.step(0)
        os._exit(0 if decide.action_masks().any() else 1)
    assert os.waitpid(child, 0)[1] == 0
    decide.step(0)
