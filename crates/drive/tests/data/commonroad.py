"""Reference data of the plant from the single-track model of commonroad-vehicle-models (Althoff, Koschi and Manzinger, 2017).

Usage: commonroad.py, in a Python with commonroad-vehicle-models==3.0.2; writes the three CSV files beside itself.

That model has one cornering stiffness for both axles, per load and adhesion. Where the car needs two, their ratio comes from the
load that an acceleration moves: next to none, times the height that makes the ratio right.
"""

import csv
import math
from pathlib import Path

from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st

HERE = Path(__file__).parent
GRAVITY = 9.81
MASS, INERTIA, FRONT, REAR = 1274.0, 1536.7, 1.016, 1.562
FRONT_STIFFNESS, REAR_STIFFNESS = 2 * 85_000.0, 2 * 112_000.0  # of an axle, N/rad
WHEELBASE = FRONT + REAR
HEIGHT = 0.54
NEXT_TO_NONE = 1e-9  # m/s^2
SPEED = 25.0
STEP = 0.001
DURATION = 4.0
CHANGE = 3.0  # duration of the lane change's sine of steering, s
PEAK = 0.015704  # of that sine, rad: 3.5 m to the side


def car(stiffness_per_load, height):
    p = parameters_vehicle2()
    p.m, p.I_z, p.a, p.b, p.h_s = MASS, INERTIA, FRONT, REAR, height
    p.tire.p_dy1, p.tire.p_ky1 = 1.0, -stiffness_per_load
    return p


STIFFNESS_PER_LOAD = (FRONT_STIFFNESS + REAR_STIFFNESS) / (MASS * GRAVITY)
LOAD_HEIGHT = (GRAVITY * REAR - FRONT_STIFFNESS * WHEELBASE / (MASS * STIFFNESS_PER_LOAD)) / NEXT_TO_NONE
CAR = car(STIFFNESS_PER_LOAD, LOAD_HEIGHT)


def rate(state, steer_rate):
    return vehicle_dynamics_st(list(state), [steer_rate, NEXT_TO_NONE], CAR)


def along(state, slope, time):
    return [x + time * dx for x, dx in zip(state, slope)]


def runge_kutta(state, steer_rate, time):
    k1 = rate(state, steer_rate(time))
    k2 = rate(along(state, k1, 0.5 * STEP), steer_rate(time + 0.5 * STEP))
    k3 = rate(along(state, k2, 0.5 * STEP), steer_rate(time + 0.5 * STEP))
    k4 = rate(along(state, k3, STEP), steer_rate(time + STEP))
    return along(state, [(a + 2 * (b + c) + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4)], STEP)


def write(name, header, rows):
    with open(HERE / name, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows([[x if isinstance(x, str) else f"{x:.15g}" for x in row] for row in rows])


def sine(time):
    frequency = 2 * math.pi / CHANGE
    return PEAK * frequency * math.cos(frequency * time)


def trajectories():
    for name, start, steer_rate, until in [("step", 0.02, None, 0.0), ("lane-change", 0.0, sine, CHANGE)]:
        state = [0.0, 0.0, start, SPEED, 0.0, 0.0, 0.0]
        for k in range(round(DURATION / STEP) + 1):
            if k % 100 == 0:
                yield [name, k * STEP, *state]
            # Half a step of grace: the steering ends with a step, not within one.
            turning = k * STEP < until - 0.5 * STEP
            state = runge_kutta(state, steer_rate if turning else lambda time: 0.0, k * STEP)


def axles():
    """Sideslip and yaw accelerations at some states, of a car whose axles are as stiff as they are loaded."""
    p = car(STIFFNESS_PER_LOAD, HEIGHT)
    for k in range(24):
        v, accel = 8.0 + 1.1 * k, -6.0 + 0.34 * k
        steer, yaw_rate, sideslip = 0.03 * math.sin(k), 0.3 * math.sin(2.3 * k), 0.04 * math.sin(1.7 * k)
        f = vehicle_dynamics_st([0.0, 0.0, steer, v, 0.0, yaw_rate, sideslip], [0.0, accel], p)
        yield [v, accel, steer, yaw_rate, sideslip, f[5], f[6]]


def linear():
    """Eigenvalues of [sideslip, yaw rate] and the steady state at a road-wheel angle of 1 rad."""
    for v in [15.0, 25.0, 33.0]:
        # Columns of (sideslip rate, yaw acceleration): by sideslip, by yaw rate and by steering.
        unit = [rate([0.0, 0.0, steer, v, 0.0, yaw_rate, sideslip], 0.0) for sideslip, yaw_rate, steer in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
        (a, c), (b, d), (e, f) = [(f[6], f[5]) for f in unit]
        trace, determinant = a + d, a * d - b * c
        root = math.sqrt(abs(0.25 * trace * trace - determinant))
        split = (root, 0.0) if 0.25 * trace * trace >= determinant else (0.0, root)
        yield [v, 0.5 * trace, *split, (b * f - d * e) / determinant, (c * e - a * f) / determinant]


if __name__ == "__main__":
    state = ["x_m", "y_m", "steer_rad", "speed_mps", "heading_rad", "yaw_rate_radps", "sideslip_rad"]
    write("commonroad_trajectories.csv", ["case", "time_s", *state], trajectories())
    accelerations = ["yaw_accel_radps2", "sideslip_rate_radps"]
    write("commonroad_axles.csv", ["speed_mps", "accel_mps2", "steer_rad", "yaw_rate_radps", "sideslip_rad", *accelerations], axles())
    eigenvalues = ["eigenvalue_middle_per_s", "real_split_per_s", "imaginary_split_per_s"]
    write("commonroad_linear.csv", ["speed_mps", *eigenvalues, "sideslip_gain", "yaw_rate_gain_per_s"], linear())
