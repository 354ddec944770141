"""Reference values of the Intelligent Driver Model from highway-env and SUMO, for `crates/drive/tests/traffic_peers.rs`.

Usage: idm_reference.py DIR. Writes DIR/idm_accel.csv and DIR/platoon.csv. Needs highway-env 1.12.1, eclipse-sumo 1.28.0 and
libsumo 1.28.0.

highway-env measures distances from center to center, so its cars are shrunk to points: its distances are then gaps. SUMO's
accelerations come from the speed that it would choose for the next step, of 1 ms in the table.
"""

import csv
import itertools
import sys
import tempfile

import libsumo
import sumo_road
from highway_env.road.lane import StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle

# Desired speed, time headway, least gap, acceleration, comfortable deceleration.
DRIVERS = [(30.0, 1.5, 2.0, 1.5, 2.0), (25.0, 1.1, 3.0, 3.0, 5.0)]
SPEEDS = [0.0, 4.0, 12.0, 20.0, 24.5, 31.0]
APPROACHES = [-10.0, -2.0, 0.0, 3.0, 12.0]
GAPS = [0.5, 4.0, 15.0, 45.0, 200.0]
TABLE_STEP_S = 0.001

FOLLOWERS = 10
START_SPEED = 25.0
START_GAP = 50.0
LENGTH = 4.8
END_S = 60
EVERY_S = 5
# The leader's acceleration from each time on.
LEADER = [(0, 0.0), (5, -2.0), (10, 0.0), (20, 1.0), (30, -3.0), (35, 0.0), (45, 1.0)]


def leader_accel(step, step_s):
    # Half a step keeps the comparison away from rounding.
    return [accel for begin, accel in LEADER if begin < (step + 0.5) * step_s][-1]


def states():
    for driver, speed, approach, gap in itertools.product(DRIVERS, SPEEDS, APPROACHES, GAPS):
        if speed - approach >= 0:
            yield driver, speed, speed - approach, gap


# highway-env


def highway_road():
    network = RoadNetwork()
    network.add_lane("a", "b", StraightLane([0, 0], [1e5, 0], speed_limit=60))
    return Road(network)


def highway_car(road, driver, position, speed):
    kind = type("Driver", (IDMVehicle,), dict(zip(["TIME_WANTED", "DISTANCE_WANTED", "COMFORT_ACC_MAX"], driver[1:4])))
    kind.COMFORT_ACC_MIN = -driver[4]
    return kind(road, [position, 0], 0, speed, target_speed=driver[0], enable_lane_change=False)


def highway_accel(driver, speed, leader_speed, gap):
    road = highway_road()
    car = highway_car(road, driver, 0, speed)
    return car.acceleration(car, Vehicle(road, [gap, 0], 0, leader_speed))


def highway_platoon(step_s):
    """Positions at the asked times, the leader first."""
    road = highway_road()
    leader = Vehicle(road, [10_000, 0], 0, START_SPEED)
    cars = [highway_car(road, DRIVERS[0], 10_000 - START_GAP * (k + 1), START_SPEED) for k in range(FOLLOWERS)]
    road.vehicles = [leader, *cars]
    for car in road.vehicles:
        car.check_collisions = False
    starts = [car.position[0] for car in road.vehicles]
    rows = []
    for step in range(round(END_S / step_s) + 1):
        if step % round(EVERY_S / step_s) == 0:
            rows.append([car.position[0] - start for car, start in zip(road.vehicles, starts)])
        leader.act({"steering": 0, "acceleration": leader_accel(step, step_s)})
        road.act()
        road.step(step_s)
    return rows


# SUMO


def sumo_start(folder, types, vehicles, step_s, *options):
    sumo_road.straight(folder, 100_000, 1)
    lines = [*types, '<route id="r" edges="e0"/>', *vehicles]
    sumo_road.write(f"{folder}/routes.xml", "<routes>" + "\n".join(lines) + "</routes>")
    libsumo.start(sumo_road.options(folder, step_s, *options))
    # Puts the vehicles on the road; they do not move yet.
    libsumo.simulationStep()


def sumo_accels():
    with tempfile.TemporaryDirectory() as folder:
        types = [sumo_road.vehicle_type(f"t{k}", driver) for k, driver in enumerate(DRIVERS)]
        cars = [sumo_road.vehicle(f"v{k}", f"t{k}", 0, 1000.0 * (2 - k), 20, "r") for k in range(len(DRIVERS))]
        sumo_start(folder, types, cars, TABLE_STEP_S)
        found = []
        for driver, speed, leader_speed, gap in states():
            # SUMO's gap leaves out the least gap.
            name = f"v{DRIVERS.index(driver)}"
            follow = libsumo.vehicle.getFollowSpeed(name, speed, gap - driver[2], leader_speed, driver[4], "")
            found.append((follow - speed) / TABLE_STEP_S)
        libsumo.close()
    return found


def sumo_platoon(step_s, *options):
    with tempfile.TemporaryDirectory() as folder:
        front = [10_000 - (START_GAP + LENGTH) * k for k in range(FOLLOWERS + 1)]
        kind = sumo_road.vehicle_type("t", DRIVERS[0])
        cars = [sumo_road.vehicle(f"v{k}", "t", 0, at, START_SPEED, "r") for k, at in enumerate(front)]
        sumo_start(folder, [kind], cars, step_s, *options)
        libsumo.vehicle.setSpeedMode("v0", 0)
        speed, rows = START_SPEED, []
        for step in range(round(END_S / step_s) + 1):
            if step % round(EVERY_S / step_s) == 0:
                rows.append([libsumo.vehicle.getLanePosition(f"v{k}") - at for k, at in enumerate(front)])
            speed += leader_accel(step, step_s) * step_s
            libsumo.vehicle.setSpeed("v0", speed)
            libsumo.simulationStep()
        libsumo.close()
    return rows


def write_rows(path, head, rows):
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head)
        writer.writerows(rows)


def main(folder):
    head = ["desired_speed_mps", "time_headway_s", "min_gap_m", "max_accel_mps2", "comfort_decel_mps2"]
    head += ["speed_mps", "leader_speed_mps", "gap_m", "highway_env_mps2", "sumo_mps2"]
    rows = []
    for (driver, *state), accel in zip(states(), sumo_accels()):
        rows.append([*driver, *state, f"{highway_accel(driver, *state):.12g}", f"{accel:.9g}"])
    write_rows(f"{folder}/idm_accel.csv", head, rows)
    head = ["peer", "step_s", "time_s", *(f"moved_{k}_m" for k in range(FOLLOWERS + 1))]
    rows = []
    for step_s in [0.1, 0.05]:
        runs = {
            "highway-env": highway_platoon(step_s),
            "sumo-euler": sumo_platoon(step_s),
            "sumo-ballistic": sumo_platoon(step_s, "--step-method.ballistic", "true"),
        }
        for peer, run in runs.items():
            rows += [[peer, step_s, k * EVERY_S, *(f"{x:.6f}" for x in moved)] for k, moved in enumerate(run)]
    write_rows(f"{folder}/platoon.csv", head, rows)


if __name__ == "__main__":
    main(sys.argv[1])
