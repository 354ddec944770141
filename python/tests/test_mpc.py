"""The two controllers alone."""

import doctest

import numpy as np
import pytest

from lanecraft import ConfigError, mpc
from lanecraft.mpc import LateralController, LongitudinalController
from lanecraft.plan import Quintic
from lanecraft.scene import Ego, Neighbors, Scene

MIDDLE = Ego(speed_mps=25.0, d_m=3.75)
RUNGS = {"solved", "shifted-plan", "feedback-law", "brake-in-lane", "full-brake"}


def test_on_a_free_road_the_reference_is_followed():
    controller = LongitudinalController()
    plan = controller.plan(Scene(MIDDLE), reference_accel_mps2=1.0, speed_ratio=0.0)
    assert plan.rung == "solved" and plan.solve.solved and plan.solve.slack_max == 0.0
    assert plan.speeds_mps.shape == (26,) and plan.states.shape == (25, 3)
    np.testing.assert_allclose(plan.speeds_mps[1:], plan.states[:, 1], atol=1e-12)
    # The reference counts for 10 stages of 0.2 s; the jerk's own weight lets it fall short by little.
    assert plan.states[8, 2] == pytest.approx(1.0, abs=0.15)
    # Position, speed and acceleration are those of a constant jerk in each stage.
    before = np.vstack([[0.0, 25.0, 0.0], plan.states[:-1]])
    jerk = np.diff(np.concatenate([[0.0], plan.states[:, 2]])) / 0.2
    np.testing.assert_allclose(plan.states[:, 1], before[:, 1] + 0.2 * before[:, 2] + 0.02 * jerk, atol=1e-9)
    assert jerk[0] == pytest.approx(plan.jerk_mps3, abs=1e-9)


def test_a_slow_leader_is_braked_for_and_only_in_ones_lane():
    ahead = Neighbors([35.0], [15.0], [1])
    controller = LongitudinalController()
    assert controller.plan(Scene(MIDDLE, ahead)).accel_mps2 < -0.5
    free = LongitudinalController().plan(Scene(MIDDLE)).accel_mps2
    assert LongitudinalController().plan(Scene(MIDDLE, ahead), lane=2).accel_mps2 == free
    assert LongitudinalController().plan(Scene(MIDDLE, ahead), lane=2, other_lane=1).accel_mps2 < -0.5


def test_in_closed_loop_the_gap_settles_above_the_spacing():
    controller = LongitudinalController({"env.control_period_s": 0.1})
    gap_m, speed_mps, accel_mps2 = 60.0, 28.0, 0.0
    for _ in range(300):
        scene = Scene(Ego(speed_mps, d_m=3.75, accel_mps2=accel_mps2), Neighbors([gap_m + 4.8], [22.0], [1]))
        accel_mps2 = controller.plan(scene).accel_mps2
        gap_m += (22.0 - speed_mps) * 0.1 - 0.005 * accel_mps2
        speed_mps += 0.1 * accel_mps2
        assert gap_m > 5.0
    assert speed_mps == pytest.approx(22.0, abs=0.3)


def test_a_standing_car_with_no_room_is_held_without_a_plan():
    plan = LongitudinalController().plan(Scene(Ego(0.0, d_m=3.75), Neighbors([8.0], [0.0], [1])))
    assert plan.accel_mps2 < 0.0 and plan.states is None and (plan.speeds_mps == 0.0).all()


def test_steering_goes_to_the_reference():
    for d_m, sign in [(3.0, 1.0), (3.75, 0.0), (4.5, -1.0)]:
        plan = LateralController().plan(Scene(Ego(25.0, d_m=d_m)), d_m=3.75)
        assert plan.rung == "solved" and np.sign(round(plan.steer_rad, 9)) == sign
        assert plan.states.shape == (20, 5)
        assert abs(plan.states[-1, 0] - 3.75) <= abs(d_m - 3.75) + 1e-9
    mirrored = [LateralController().plan(Scene(Ego(25.0, d_m=3.75 + side)), d_m=3.75).steer_rad for side in (-0.5, 0.5)]
    assert mirrored[0] == pytest.approx(-mirrored[1], abs=1e-9)


def test_a_path_is_followed_and_may_be_a_line():
    path = Quintic.between((3.75, 0.0, 0.0), 7.5, 4.0)
    scene = Scene(MIDDLE)
    wanted_m = path.at(0.05 * np.arange(1, 21)).d_m

    def error_m(ratio):
        plan = LateralController().plan(scene, path=path, speeds_mps=np.full(10, 25.0), path_ratio=ratio)
        assert plan.rung == "solved" and plan.steer_rad > 0.0
        return np.abs(plan.states[:, 0] - wanted_m).max()

    # The more the path counts against the steering, the closer it is followed.
    assert error_m(0.01) > error_m(1.0) > error_m(100.0) and error_m(1e4) < 0.01
    line = LateralController().plan(scene, d_m=7.5)
    assert line.steer_rad == LateralController().plan(scene, path=path, elapsed_s=50.0).steer_rad


def test_the_same_calls_give_the_same_bits_and_configuration_counts():
    def answers(config=None):
        speed, steer = LongitudinalController(config), LateralController(config)
        scenes = [Scene(Ego(25.0 - 0.1 * k, d_m=3.5), Neighbors([40.0 - k], [20.0], [1])) for k in range(5)]
        return [(speed.plan(scene).accel_mps2, steer.plan(scene, d_m=3.75).steer_rad) for scene in scenes]

    assert answers() == answers()
    assert answers() != answers({"control.jerk_max_mps3": 1.0})
    speed = LongitudinalController(preset="paper")
    assert speed.plan(Scene(MIDDLE)).speeds_mps.shape == (21,)
    assert "longitudinal_horizon = 20" in speed.config_toml


def test_commands_sent_by_others_are_taken():
    config = {"vehicle.drive_delay_s": 0.1, "vehicle.steer_delay_s": 0.1}
    speed, told = LongitudinalController(config), LongitudinalController(config)
    scene = Scene(MIDDLE)
    assert speed.plan(scene).accel_mps2 == told.plan(scene).accel_mps2
    told.sent(-6.0)
    assert speed.plan(scene).accel_mps2 != told.plan(scene).accel_mps2
    LateralController(config).sent(0.01)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, None, "1", 10**400, [], [[1.0]], 1j, 1e300])
def test_bad_numbers_are_refused(bad):
    speed, steer, scene = LongitudinalController(), LateralController(), Scene(MIDDLE)
    calls = [
        lambda: speed.plan(scene, reference_accel_mps2=bad),
        lambda: speed.plan(Scene(Ego(bad))),
        lambda: speed.sent(bad),
        lambda: steer.plan(scene, d_m=bad),
        lambda: steer.plan(scene, d_m=3.75, elapsed_s=bad),
        lambda: steer.plan(scene, d_m=3.75, speeds_mps=[bad]),
        lambda: steer.plan(Scene(Ego(25.0, yaw_rate_radps=bad)), d_m=3.75),
        lambda: steer.sent(bad),
    ]
    if bad is not None:
        calls += [
            lambda: speed.plan(scene, target_speed_mps=bad),
            lambda: speed.plan(scene, speed_ratio=bad),
            lambda: speed.plan(scene, lane=bad),
            lambda: steer.plan(scene, d_m=3.75, path_ratio=bad),
            lambda: steer.plan(scene, d_m=3.75, speeds_mps=bad),
            lambda: steer.plan(scene, path=bad),
        ]
    for number, call in enumerate(calls):
        with pytest.raises((ConfigError, TypeError)):
            call()
            pytest.fail(f"call {number} took {bad!r}")


def test_extreme_scenes_are_answered_within_the_limits():
    rng = np.random.default_rng(0)
    speed, steer = LongitudinalController(), LateralController()
    for _ in range(20):
        neighbors = Neighbors(rng.uniform(-60, 60, 6), rng.uniform(0, 150, 6), rng.integers(0, 3, 6), rng.uniform(-4, 12, 6))
        ego = Ego(rng.uniform(0, 150), *rng.uniform(-3, 3, 5), rng.uniform(-1, 1), rng.uniform(-20, 20))
        plan, turn = speed.plan(Scene(ego, neighbors)), steer.plan(Scene(ego, neighbors), d_m=3.75)
        assert np.isfinite([plan.accel_mps2, turn.steer_rad]).all() and {plan.rung, turn.rung} <= RUNGS
        assert -8.0 <= plan.accel_mps2 <= 2.0


def test_one_reference_is_asked_for():
    with pytest.raises(ConfigError, match="either"):
        LateralController().plan(Scene(MIDDLE))
    with pytest.raises(ConfigError, match="either"):
        LateralController().plan(Scene(MIDDLE), d_m=3.75, path=Quintic.between((0, 0, 0), 1.0, 2.0))
    with pytest.raises(ConfigError, match="did you mean"):
        LongitudinalController({"control.jerk_max": 3.0})


def test_the_examples_are_true():
    assert doctest.testmod(mpc, optionflags=doctest.ELLIPSIS).failed == 0
