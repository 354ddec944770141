"""The traffic alone, and its formulas."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import lanecraft
from lanecraft.traffic import ExternalVehicle, World, idm, safe_gap, safe_speed

DRIVER = {
    "desired_speed_mps": 30.0,
    "time_headway_s": 1.5,
    "min_gap_m": 2.0,
    "max_accel_mps2": 1.5,
    "comfort_decel_mps2": 2.0,
}
LIMITS = {"braking_mps2": 6.0, "leader_braking_mps2": 7.0, "margin_m": 1.0}
COLUMNS = ("id", "s_m", "d_m", "speed_mps", "lateral_speed_mps", "accel_mps2", "length_m", "width_m", "lane", "target_lane")


def digest_after(steps: int, **kwargs) -> int:
    world = World(**kwargs)
    world.step(steps)
    return world.digest()


def ego_at_start(world: World, **kwargs) -> ExternalVehicle:
    s_m, lane, speed_mps = world.ego_start
    return ExternalVehicle(s_m, world.lane_centers_m[lane], speed_mps, lane, **kwargs)


def test_the_same_seed_gives_the_same_bits_and_another_does_not():
    assert digest_after(100, seed=3) == digest_after(100, seed=3)
    assert digest_after(100, seed=3) != digest_after(100, seed=4)


def test_many_steps_are_as_many_single_ones():
    world, other = World(seed=1), World(seed=1)
    total = world.step(250)
    single = [other.step() for _ in range(250)]
    assert world.digest() == other.digest()
    assert total.lane_changes == sum(events.lane_changes for events in single) > 0
    assert total.overlaps == 0
    assert world.time_s == pytest.approx(250 * world.step_s)


def test_the_state_is_arrays_of_ones_own():
    world = World(seed=1)
    assert all(getattr(world, name).shape == (len(world),) for name in COLUMNS)
    assert (np.diff(world.id) > 0).all()
    before, now = world.s_m, world.digest()
    world.s_m[:] = 0.0
    assert world.digest() == now
    world.step()
    assert (before != world.s_m).any()
    assert np.isin(world.lane, range(len(world.lane_centers_m))).all()


def test_a_snapshot_goes_on_with_the_same_bits():
    world = World(seed=2)
    world.step(50)
    stored = world.snapshot()
    world.step(50)
    other = World(seed=9)
    other.restore(stored)
    other.step(50)
    assert other.digest() == world.digest()
    assert other.seed == 2
    with pytest.raises(lanecraft.SnapshotError):
        other.restore(stored[:-1])
    with pytest.raises(lanecraft.SnapshotError):
        other.restore(b"")


def test_an_external_vehicle_is_hit_and_followed():
    world = World(seed=1)
    ego = ego_at_start(world)
    world.place(ego)
    # It stands still in the middle of the traffic.
    stopped = ExternalVehicle(ego.s_m, ego.d_m, 0.0, ego.target_lane)
    overlaps = sum(world.step(ego=stopped).overlaps for _ in range(200))
    assert overlaps == 0
    world = World(seed=1)
    on_top = ExternalVehicle(world.s_m[0], world.d_m[0], world.speed_mps[0], int(world.lane[0]))
    world.place(on_top)
    collision = world.step(ego=on_top).collision
    assert collision is not None and collision.id in world.id


def test_scenarios_and_configurations_are_driven_in():
    assert len(World(scenario="merge").lane_centers_m) > 1
    sparse = World(config={"traffic.density_veh_per_km_lane": 5})
    dense = World(config={"traffic": {"density_veh_per_km_lane": 20}})
    assert len(sparse) < len(dense)


def test_the_lock_is_let_go_of_while_the_traffic_drives():
    world = World(seed=1)
    driver = threading.Thread(target=world.step, args=(20_000,))
    driver.start()
    refused = 0
    while driver.is_alive():
        try:
            world.digest()
        except RuntimeError:
            refused += 1
    # A world that is being stepped is refused to other threads, which could not even have asked with the lock held.
    assert refused > 0


@pytest.mark.parametrize(
    ("kwargs", "error"),
    [
        ({"seed": -1}, lanecraft.ConfigError),
        ({"seed": 2**64}, lanecraft.ConfigError),
        ({"seed": 1.0}, TypeError),
        ({"seed": None}, TypeError),
        ({"preset": "fast"}, lanecraft.ConfigError),
        ({"preset": "defualt"}, lanecraft.ConfigError),
        ({"preset": None}, TypeError),
        ({"config": {"traffic.density": 3}}, lanecraft.ConfigError),
        ({"config": {"traffic.density_veh_per_km_lane": float("nan")}}, lanecraft.ConfigError),
        ({"config": 3}, TypeError),
        ({"scenario": "mrege"}, lanecraft.ConfigError),
        ({"scenario": 3}, TypeError),
    ],
)
def test_a_world_that_cannot_be_is_refused(kwargs, error):
    with pytest.raises(error):
        World(**kwargs)


@pytest.mark.parametrize(
    ("steps", "error"),
    [(-1, lanecraft.ConfigError), (2**70, lanecraft.ConfigError), (1.5, TypeError), (None, TypeError), ("1", TypeError)],
)
def test_a_number_of_steps_that_is_none_is_refused(steps, error):
    with pytest.raises(error):
        World(seed=1).step(steps)


@pytest.mark.parametrize("name", ["s_m", "d_m", "speed_mps", "accel_mps2", "heading_rad", "length_m", "width_m"])
@pytest.mark.parametrize(
    ("value", "error"),
    [
        (float("nan"), lanecraft.ConfigError),
        (float("inf"), lanecraft.ConfigError),
        (-1e300, lanecraft.ConfigError),
        (10**400, TypeError),
        (None, TypeError),
        ("1", TypeError),
        (np.ones(2), TypeError),
    ],
)
def test_an_ego_that_cannot_be_is_refused_and_nothing_moves(name, value, error):
    world = World(seed=1)
    numbers = {"s_m": 0.0, "d_m": 0.0, "speed_mps": 0.0, "target_lane": 0, name: value}
    before = world.digest()
    with pytest.raises(error):
        world.place(ExternalVehicle(**numbers))
    with pytest.raises(error):
        world.step(ego=ExternalVehicle(**numbers))
    assert world.digest() == before


def test_other_egos_are_refused():
    world = World(seed=1)
    for ego, error in [(3, TypeError), (ExternalVehicle(0, 0, 0, 200), ValueError), (ExternalVehicle(0, 0, 0, -1), ValueError)]:
        with pytest.raises(error):
            world.step(ego=ego)
    with pytest.raises(lanecraft.ConfigError):
        world.step(2, ego=ego_at_start(world))


def test_idm_is_the_printed_formula():
    random = np.random.default_rng(0)
    gap, speed, approach = random.uniform(1, 100, 50), random.uniform(0, 40, (20, 1)), random.uniform(-10, 10, 50)
    v0, headway, s0, a, b = DRIVER.values()
    wanted = s0 + np.maximum(0, speed * headway + speed * approach / (2 * np.sqrt(a * b)))
    expected = a * (1 - (speed / v0) ** 4 - (wanted / gap) ** 2)
    found = idm(gap, speed, approach, **DRIVER)
    assert found.shape == (20, 50)
    # Rounding of a few operations on numbers up to some thousands.
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-10)


def test_safe_distances_are_the_printed_formula_and_each_other():
    speed, leader = np.linspace(20, 40, 5)[:, None], np.linspace(0, 20, 4)
    gap = safe_gap(speed, leader, **LIMITS)
    np.testing.assert_allclose(gap, 1.0 + np.maximum(0, speed**2 / 12 - leader**2 / 14), rtol=1e-12)
    np.testing.assert_allclose(safe_speed(gap, leader, **LIMITS), np.broadcast_to(speed, gap.shape), rtol=1e-12)
    assert safe_speed(0.5, 10.0, **LIMITS) == -1.0


def test_formulas_take_any_layout_and_give_numbers_for_numbers():
    speed = np.linspace(0, 30, 12, dtype=np.float32).reshape(3, 4)
    found = idm(20, speed.T[::-1], 0, **DRIVER)
    np.testing.assert_array_equal(found, idm(20, np.ascontiguousarray(speed.T[::-1]), 0, **DRIVER))
    assert isinstance(idm(20, 10, 0, **DRIVER), float)
    assert idm([], 10, 0, **DRIVER).shape == (0,)
    speed.flags.writeable = False
    idm(20, speed, 0, **DRIVER)


@pytest.mark.parametrize(
    ("value", "error"),
    [
        (float("nan"), lanecraft.ConfigError),
        ([1.0, float("nan")], lanecraft.ConfigError),
        (-1.0, lanecraft.ConfigError),
        (None, TypeError),
        ("1", TypeError),
        (10**400, TypeError),
        (1j, TypeError),
        (np.ones(3, dtype=complex), TypeError),
        ([True], TypeError),
        (np.ones((2, 3)), ValueError),
    ],
)
def test_numbers_that_are_none_are_refused(value, error):
    with pytest.raises(error):
        idm(value, np.ones(2), 0, **DRIVER)
    with pytest.raises(error):
        safe_gap(value, np.ones(2), **LIMITS)
    with pytest.raises(error):
        safe_speed(value, np.ones(2), **LIMITS)
