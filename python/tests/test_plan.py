"""Polynomials, candidates and the planner alone."""

import doctest

import numpy as np
import pytest

from lanecraft import ConfigError, plan
from lanecraft.plan import FEATURE_NAMES, Planner, Quintic
from lanecraft.scene import Ego, Neighbors, Scene

MIDDLE = Ego(speed_mps=25.0, d_m=3.75)


def test_a_quintic_keeps_its_ends_and_its_derivatives():
    path = Quintic.between((1.0, 0.5, -0.3), 4.75, 3.0)
    for time_s, expected in [(0.0, (1.0, 0.5, -0.3)), (3.0, (4.75, 0.0, 0.0))]:
        motion = path.at(time_s)
        np.testing.assert_allclose([motion.d_m, motion.speed_mps, motion.accel_mps2], expected, atol=1e-12)
    times = np.linspace(0.0, 3.0, 30_001)
    motion = path.at(times)
    for value, slope in zip(motion, motion[1:], strict=False):
        np.testing.assert_allclose(np.gradient(value, times)[1:-1], slope[1:-1], atol=1e-5)
    maxima = (path.max_speed_mps, path.max_accel_mps2, path.max_jerk_mps3)
    for largest, sampled in zip(maxima, motion[1:], strict=True):
        assert largest == pytest.approx(np.abs(sampled).max(), abs=1e-5)
        assert largest >= np.abs(sampled).max() - 1e-12
    assert path.at(9.0).d_m == pytest.approx(4.75) and path.at(9.0).speed_mps == 0.0
    assert path.at(np.zeros((2, 3))).d_m.shape == (2, 3)


def test_a_change_from_rest_has_its_closed_form():
    # |d''| reaches (10 / sqrt 3) shift / duration².
    path = Quintic.between((0.0, 0.0, 0.0), 3.75, 4.0)
    assert path.max_accel_mps2 == pytest.approx(10.0 / np.sqrt(3.0) * 3.75 / 16.0, rel=1e-12)
    assert path.max_speed_mps == pytest.approx(1.875 * 3.75 / 4.0, rel=1e-12)


def test_an_empty_road_offers_all_durations_and_the_best_is_chosen():
    outcome = Planner().plan(Scene(MIDDLE), "left")
    assert outcome and outcome.refusal is None
    assert (outcome.from_lane, outcome.to_lane) == (1, 2)
    assert outcome.window_s == pytest.approx((2.4, 4.0))
    assert [path.duration_s for path in outcome.candidates] == pytest.approx(np.arange(24, 41) / 10.0)
    assert outcome.features.shape == (17, len(FEATURE_NAMES)) and outcome.rewards.shape == (17,)
    assert outcome.chosen == np.argmax(outcome.rewards)
    assert outcome.path is not None and outcome.path.at(100.0).d_m == pytest.approx(7.5)
    # Travel is 0.05 s times the duration, and no one is near.
    np.testing.assert_allclose(outcome.features[:, 3], 0.05 * np.arange(24, 41) / 10.0)
    assert (outcome.features[:, 1] == 0.0).all()


@pytest.mark.parametrize(
    ("neighbors", "name"),
    [
        (Neighbors([3.0], [25.0], [2]), "occupied"),
        (Neighbors([15.0], [20.0], [2]), "target-leader"),
        (Neighbors([12.0], [20.0], [1]), "current-leader"),
        (Neighbors([-20.0], [33.0], [2]), "follower"),
        (Neighbors([23.0], [20.0], [2]), "empty-window"),
    ],
)
def test_refusals_come_in_words(neighbors, name):
    outcome = Planner().plan(Scene(MIDDLE, neighbors), "left")
    assert not outcome and outcome.path is None and outcome.candidates == ()
    assert outcome.refusal is not None and outcome.refusal.name == name and " " in outcome.refusal.words


def test_road_and_rewards_follow_the_configuration():
    assert Planner({"road.lanes": 2}).plan(Scene(MIDDLE), "left").refusal.name == "no-lane"
    hasty = Planner({"planner": {"cost_weights": [0.0, 0.0, 0.0, 1.0] + 5 * [0.0]}}).plan(Scene(MIDDLE), "left")
    calm = Planner({"planner.cost_weights": [1.0, 0.0, 1.0, 0.0] + 5 * [0.0]}).plan(Scene(MIDDLE), "left")
    assert hasty.path.duration_s < calm.path.duration_s
    ending = {"road.lanes_open": [{"lane": 2, "from_m": 0.0, "to_m": 200.0}], "road.topology": "open"}
    assert Planner(ending).plan(Scene(Ego(25.0, d_m=3.75, s_m=50.0)), "left").refusal.name == "lane-ends"
    assert "cost_weights" in Planner().config_toml


def test_a_forecast_of_ones_own_counts():
    neighbors = Neighbors([60.0], [25.0], [2])
    points = np.zeros((1, 51, 3))
    times = 0.1 * np.arange(51)
    points[0] = np.stack([60.0 + 25.0 * times, np.full(51, 7.5), np.full(51, 25.0)], axis=1)
    calm, own = Planner().plan(Scene(MIDDLE, neighbors), "left"), Planner().plan(Scene(MIDDLE, neighbors, forecast=points), "left")
    np.testing.assert_allclose(own.features, calm.features, atol=1e-12)
    # One that stands from now on is met within (40 − 4.8 − 5) m / (25 m/s), less than the shortest change.
    points[0, :, 0] = 40.0
    assert Planner().plan(Scene(MIDDLE, neighbors, forecast=points), "left").refusal.name == "target-leader"


def test_a_path_to_any_place():
    path = Planner().path_to(Scene(MIDDLE), 5.0, 1.5)
    assert path is not None and path.duration_s >= 1.5 and path.at(99.0).d_m == pytest.approx(5.0)
    assert Planner().path_to(Scene(Ego(0.0, d_m=3.75)), 5.0, 1.5) is None


BAD = [np.nan, np.inf, -np.inf, None, "1", 10**400, [], [1.0, 2.0], 1j, 1e300]


@pytest.mark.parametrize("bad", BAD)
def test_bad_numbers_are_refused(bad):
    calls = [
        lambda: Quintic.between((bad, 0.0, 0.0), 3.75, 4.0),
        lambda: Quintic.between((0.0, 0.0, 0.0), bad, 4.0),
        lambda: Quintic.between((0.0, 0.0, 0.0), 3.75, bad),
        lambda: Quintic((bad, 0.0, 0.0, 0.0, 0.0, 0.0), 1.0),
        lambda: Planner().path_to(Scene(MIDDLE), bad, 3.0),
        lambda: Planner().path_to(Scene(MIDDLE), 5.0, bad),
        lambda: Planner().plan(Scene(Ego(bad)), "left"),
        lambda: Planner().plan(Scene(Ego(25.0, heading_rad=bad)), "left"),
        lambda: Planner().plan(Scene(MIDDLE, Neighbors([10.0], bad, [1])), "left"),
        lambda: Planner().plan(Scene(MIDDLE, Neighbors([bad], [20.0], [1])), "left"),
        lambda: Planner().plan(Scene(MIDDLE, Neighbors([10.0], [20.0], [bad])), "left"),
        lambda: Planner().plan(Scene(MIDDLE, length_m=bad), "left"),
    ]
    for number, call in enumerate(calls):
        with pytest.raises((ConfigError, TypeError)):
            call()
            pytest.fail(f"call {number} took {bad!r}")
    if bad is not None:
        with pytest.raises((ConfigError, TypeError)):
            Planner().plan(Scene(MIDDLE, ego_lane=bad), "left")
        with pytest.raises((ConfigError, TypeError)):
            Planner().plan(Scene(MIDDLE, forecast=bad), "left")


def test_bad_names_and_lanes_are_refused():
    with pytest.raises(ConfigError, match="left"):
        Planner().plan(Scene(MIDDLE), "lefft")
    with pytest.raises(ConfigError, match="lanes are 0 to 2"):
        Planner().plan(Scene(MIDDLE, Neighbors([10.0], [20.0], [3])), "left")
    with pytest.raises(ConfigError, match="lane"):
        Planner().plan(Scene(MIDDLE, Neighbors([10.0], [20.0], [-1])), "left")
    with pytest.raises(ConfigError, match="at most 1000"):
        Planner().plan(Scene(MIDDLE, Neighbors(np.arange(1001.0), 20.0, 0)), "left")
    with pytest.raises(ConfigError, match="planner.duration_min_s"):
        Planner({"planner.duration_min": 1.5})
    with pytest.raises(TypeError):
        Planner(3)
    with pytest.raises(TypeError):
        Planner().plan("scene", "left")


def test_the_examples_are_true():
    assert doctest.testmod(plan, optionflags=doctest.ELLIPSIS).failed == 0
