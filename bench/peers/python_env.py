"""The Python environments beside their peers: steps per second, in turns.

Usage: python_env.py --ours PYTHON [--program PROGRAM] [--wheel FILE] [--rounds N] [--seconds S] [--python NAME=PYTHON ...] [PEER ...]

`--ours` is a Python that has `lanecraft` installed from a release build (`maturin build --release`). Each measurement runs in a
process of its own, ours and the peer's alternately; the table has our rate over the peer's, the median over the rounds and the range:

    highway-env   highway-env 1.12.1: one `highway-fast-v0` (21 vehicles, 5 Hz, one decision a second) beside one
                  `lanecraft/HighwayFast-v0`; both by `gymnasium.make`, random actions, episodes begun anew; per second of processor time
    libsumo       libsumo 1.28.0: 50 vehicles, 15 steps of 67 ms a decision, the ego's surroundings read by subscription, beside one
                  `lanecraft/HighwayFast-v0` of 50 vehicles and 15 steps; per second of processor time
    highjax       highjax 0.1.0 (asks for Python 3.14, runs on 3.13): 51 vehicles, 15 steps a decision, its best batch of 8, 64 and 256
                  on two threads, beside a `VectorEnv` of 64 on two threads; per second of wall time

Beside that: what a step costs beyond the program's own (`lanecraft bench kinematic`), import times, steps of the whole loop, the wheel.
"""

import argparse
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time

from timing import answer, rate

PEERS = ["highway-env", "libsumo", "highjax"]
BATCHES = [8, 64, 256]
#: Of the whole loop, one and many.
LOOP = ["loop", "loops"]


def single(make, seconds):
    """Steps per second of processor time of one environment, its resets included."""
    env = make()
    env.reset(seed=0)
    stream = random.Random(0)
    actions = [stream.randrange(5) for _ in range(10_000)]
    at = 0

    def step():
        nonlocal at
        at = (at + 1) % len(actions)
        *_, terminated, truncated, _ = env.step(actions[at])
        if terminated or truncated:
            env.reset()

    return rate(step, 1, seconds)


def fast(seconds, **task):
    import gymnasium
    import lanecraft  # noqa: F401  registers its environments

    return single(lambda: gymnasium.make("lanecraft/HighwayFast-v0", config={"task": task}), seconds)


def highway_env(seconds):
    import gymnasium
    import highway_env  # noqa: F401  registers its environments

    return single(lambda: gymnasium.make("highway-fast-v0"), seconds)


def libsumo(seconds):
    import libsumo as simulation
    import sumo_road
    import traci.constants as names

    wanted = [names.VAR_SPEED, names.VAR_LANEPOSITION, names.VAR_LANE_INDEX, names.VAR_POSITION]
    stream = random.Random(0)
    with tempfile.TemporaryDirectory() as folder:
        sumo_road.straight(folder, 2_000_000, 4)
        lines, cars = ['<route id="r" edges="e0"/>'], []
        for k in range(50):
            lines.append(sumo_road.vehicle_type(f"t{k}", (stream.uniform(21, 24), 1.5, 5.0, 3.0, 5.0)))
            cars.append(sumo_road.vehicle(f"v{k}", f"t{k}", k % 4, 100 + 70 * (k // 4 + 0.3 * stream.random()), 20, "r"))
        sumo_road.write(f"{folder}/routes.xml", "<routes>" + "\n".join(lines + cars) + "</routes>")
        simulation.start(sumo_road.options(folder, 0.067))
        for _ in range(30):
            simulation.simulationStep()
        ego, speed = "v25", 22.0
        simulation.vehicle.setSpeedMode(ego, 0)
        simulation.vehicle.setLaneChangeMode(ego, 0)
        simulation.vehicle.subscribeContext(ego, names.CMD_GET_VEHICLE_VARIABLE, 100.0, wanted)

        def step():
            nonlocal speed
            action = stream.randrange(5)
            if action < 2:
                lane = simulation.vehicle.getLaneIndex(ego) + (1 if action else -1)
                simulation.vehicle.changeLane(ego, min(max(lane, 0), 3), 2.0)
            else:
                speed = min(max(speed + action - 3, 18.0), 28.0)
                simulation.vehicle.setSpeed(ego, speed)
            for _ in range(15):
                simulation.simulationStep()
            simulation.vehicle.getContextSubscriptionResults(ego)

        found = rate(step, 1, seconds)
        assert simulation.vehicle.getIDCount() == 50, "a vehicle has left the road"
        simulation.close()
    return found


def wall_rate(step, steps, seconds):
    """Steps per second of wall time."""
    step()
    begun, count = time.perf_counter(), 0
    while time.perf_counter() - begun < seconds:
        step()
        count += 1
    return count * steps / (time.perf_counter() - begun)


def many(seconds, num_envs, preset, config):
    import lanecraft
    import numpy

    env = lanecraft.VectorEnv(num_envs, preset=preset, config=config, threads=2, copy=False)
    env.reset(seed=0)
    stream = numpy.random.default_rng(0)
    count = env.single_action_space.n
    actions = [stream.integers(count, size=num_envs) for _ in range(64)]
    at = 0

    def step():
        nonlocal at
        at = (at + 1) % len(actions)
        env.step(actions[at])

    return wall_rate(step, num_envs, seconds)


def fast_many(seconds):
    task = {"vehicles": 50, "simulation_hz": 15.0, "steps_per_decision": 15}
    return many(seconds, 64, "fast", {"task": task, "road.lanes": 4})


def highjax(seconds):
    # XLA starts as many threads as it sees cores.
    os.sched_setaffinity(0, set(list(os.sched_getaffinity(0))[:2]))
    import highjax as package
    import jax

    def of_batch(batch):
        env, params = package.make("highjax-v0", n_npcs=50, n_lanes=4)

        @jax.jit
        def roll(key, state):
            def one(carry, _):
                key, state = carry
                key, for_actions, for_steps = jax.random.split(key, 3)
                actions = jax.random.randint(for_actions, (batch,), 0, 5)
                keys = jax.random.split(for_steps, batch)
                observation, state, reward, _, _ = jax.vmap(env.step, in_axes=(0, 0, 0, None))(keys, state, actions, params)
                return (key, state), reward.sum() + observation.sum()

            return jax.lax.scan(one, (key, state), None, length=4)

        keys = jax.random.split(jax.random.PRNGKey(0), batch)
        state = jax.jit(jax.vmap(env.reset, in_axes=(0, None)))(keys, params)[1]
        key = jax.random.PRNGKey(1)

        def step():
            nonlocal key, state
            (key, state), sums = roll(key, state)
            jax.block_until_ready(sums)

        return wall_rate(step, 4 * batch, seconds)

    return max(of_batch(batch) for batch in BATCHES)


def loop(seconds):
    import lanecraft

    env = lanecraft.Env()
    _, info = env.reset(seed=0)
    stream = random.Random(0)

    def step():
        *_, terminated, truncated, _ = env.step(stream.randrange(15))
        if terminated or truncated:
            env.reset()

    return rate(step, 1, seconds)


MEASUREMENTS = {
    "highway-env": highway_env,
    "highway-env/ours": fast,
    "libsumo": libsumo,
    "libsumo/ours": lambda seconds: fast(seconds, vehicles=49, simulation_hz=15.0, steps_per_decision=15),
    "highjax": highjax,
    "highjax/ours": fast_many,
    "loop": loop,
    "loops": lambda seconds: many(seconds, 16, "default", {}),
}


def import_s(python, module):
    """Median wall time of a process that imports `module`."""
    times_s = []
    for _ in range(9):
        begun = time.perf_counter()
        subprocess.run([python, "-c", f"import {module}"], check=True)
        times_s.append(time.perf_counter() - begun)
    return statistics.median(times_s)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("peers", nargs="*", metavar="PEER", help=f"of {', '.join(PEERS)}; all, if none is named")
    parser.add_argument("--ours", required=True, metavar="PYTHON")
    parser.add_argument("--program", metavar="PROGRAM", help="the program `lanecraft`")
    parser.add_argument("--wheel", metavar="FILE")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--python", action="append", default=[], metavar="NAME=PYTHON")
    arguments = parser.parse_args()
    pythons = dict(text.split("=", 1) for text in arguments.python)

    def measure(python, name):
        return answer([python, os.path.abspath(__file__), "--measure", name, str(arguments.seconds)])[0]["rate"]

    print("| peer | ours, steps/s | peer, steps/s | ours over peer, median | range |\n| --- | --- | --- | --- | --- |", flush=True)
    one_s = []
    for peer in arguments.peers or PEERS:
        pairs = []
        for _ in range(arguments.rounds):
            pairs.append((measure(arguments.ours, f"{peer}/ours"), measure(pythons.get(peer, sys.executable), peer)))
        ours, theirs = (statistics.median(values) for values in zip(*pairs))
        ratios = [mine / other for mine, other in pairs]
        spread = f"{min(ratios):.4g} to {max(ratios):.4g}"
        print(f"| {peer} | {ours:,.0f} | {theirs:,.4g} | {statistics.median(ratios):.4g} | {spread} |", flush=True)
        one_s += [1 / ours] if peer == "highway-env" else []
    for name in LOOP:
        print(f"\nsteps of the whole loop a second, {name}: {measure(arguments.ours, name):,.0f}")
    if arguments.program and one_s:
        rows = answer([arguments.program, "bench", "kinematic", "--json"])
        values = {row["bench"]: row["value"] for row in rows}
        print(f"\na step of HighwayFast-v0: {1e6 * one_s[0]:.2f} µs with resets; the program's own benches: {values}")
    base_s, with_ours_s = import_s(arguments.ours, "gymnasium"), import_s(arguments.ours, "lanecraft")
    print(f"\nimport: gymnasium {base_s:.3f} s, lanecraft with it {with_ours_s:.3f} s")
    if arguments.wheel:
        print(f"\nwheel: {os.path.getsize(arguments.wheel) / 1e6:.2f} MB")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--measure"]:
        import json

        print(json.dumps({"rate": MEASUREMENTS[sys.argv[2]](float(sys.argv[3]))}))
    else:
        main()
