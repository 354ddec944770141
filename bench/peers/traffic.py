"""Our traffic beside its peers: vehicle updates per second of processor time, in turns.

Usage: traffic.py --ours PROGRAM [--limit SOURCE] [--rounds N] [--seconds S] [--python NAME=PROGRAM ...] [PEER ...]

Runs `PROGRAM bench traffic --json` and each peer alternately and prints, for each number of vehicles, our rate over the peer's:
the median over the rounds and the range. Each peer runs in a process of its own, by this Python or by the one named for it:

    highway-env    highway-env 1.12.1, `road.act` and `road.step` only, its collision checks on
    highjax        highjax 0.1.0 (asks for Python 3.14, runs on 3.13), one environment, 15 substeps a call
    lc2013, sl2015 eclipse-sumo and libsumo 1.28.0, bare steps, IDM with that lane-change model

All drive four straight lanes with steps of 1/15 s (SUMO: 67 ms), lane changes and collision checks on. `--limit` is the source
of a yardstick, one Rust file that prints lines with `mode`, `vehicles`, `envs` and `ns_per_update`; as a peer it is named `limit`.
"""

import argparse
import json
import os
import random
import resource
import statistics
import subprocess
import sys
import tempfile
import time

from timing import answer, rate

SIZES = [50, 200, 1000]
STEP_S = 1 / 15
# Vehicles per kilometer and lane of our default preset.
DENSITY = 14
PEERS = ["highway-env", "highjax", "lc2013", "sl2015"]


def highway_env(size, seconds):
    import gymnasium
    import highway_env  # noqa: F401  registers its environments

    config = {"vehicles_count": size - 1, "lanes_count": 4, "simulation_frequency": 15}
    env = gymnasium.make("highway-v0", config=config).unwrapped
    env.reset(seed=0)
    assert len(env.road.vehicles) == size

    def step():
        env.road.act()
        env.road.step(STEP_S)

    return rate(step, size, seconds)


def highjax(size, seconds):
    # XLA starts as many threads as it sees cores.
    os.sched_setaffinity(0, set(list(os.sched_getaffinity(0))[:1]))
    import highjax as package
    import jax

    substeps = 15
    env, params = package.make("highjax-v0", n_npcs=size - 1, n_lanes=4)
    advance = jax.jit(env.step_env)
    key = jax.random.PRNGKey(0)
    state = jax.jit(env.reset)(key, params)[1]

    def step():
        nonlocal state
        state = jax.block_until_ready(advance(key, state, 1, params)[1])

    return rate(step, size * substeps, seconds)


def sumo(size, seconds, model):
    import libsumo
    import sumo_road

    stream = random.Random(0)
    with tempfile.TemporaryDirectory() as folder:
        # So long that nobody leaves it.
        sumo_road.straight(folder, 2_000_000, 4)
        lines, cars = ['<route id="r" edges="e0"/>'], []
        for k in range(size):
            driver = (stream.uniform(19, 27), stream.uniform(1.0, 1.8), 2.0, 1.5, 2.0)
            lines.append(sumo_road.vehicle_type(f"t{k}", driver, lane_change=model))
            # As dense as ours.
            at = 100 + 1000 / DENSITY * (k // 4 + 0.3 * stream.random())
            cars.append(sumo_road.vehicle(f"v{k}", f"t{k}", k % 4, at, 18, "r"))
        sumo_road.write(f"{folder}/routes.xml", "<routes>" + "\n".join(lines + cars) + "</routes>")
        more = ["--lateral-resolution", "0.8"] if model == "SL2015" else []
        libsumo.start(sumo_road.options(folder, 0.067, *more))
        for _ in range(75):
            libsumo.simulationStep()
        found = rate(libsumo.simulationStep, size, seconds)
        assert libsumo.vehicle.getIDCount() == size, "a vehicle has left the road"
        libsumo.close()
    return found


def measure(peer, size, seconds):
    """One peer in this process."""
    found = {
        "highway-env": lambda: highway_env(size, seconds),
        "highjax": lambda: highjax(size, seconds),
        "lc2013": lambda: sumo(size, seconds, "LC2013"),
        "sl2015": lambda: sumo(size, seconds, "SL2015"),
    }[peer]()
    print(json.dumps({"rate": found}))


def ours(program):
    names = {f"traffic/idm-mobil/{size}/processor": size for size in SIZES}
    found = {names[row["bench"]]: row["value"] for row in answer([program, "bench", "traffic", "--json"]) if row["bench"] in names}
    assert len(found) == len(SIZES), "the program did not measure all sizes"
    return found


def limit(source, folder):
    """Rates of the yardstick's modes, by number of vehicles in one world; its times are scaled by the share of a processor it got."""
    program = os.path.join(folder, "limit")
    if not os.path.exists(program):
        subprocess.run(["rustc", "-O", "-C", "target-cpu=native", source, "-o", program], check=True, capture_output=True)
    begun, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    rows = [row for row in answer([program]) if row["envs"] == 1]
    passed, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    share = (after.ru_utime - before.ru_utime) / passed
    found = {f"limit, mode {mode}": {} for mode in range(3)}
    for row in rows:
        found[f"limit, mode {row['mode']}"][row["vehicles"]] = 1e9 / (row["ns_per_update"] * share)
    return found


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("peers", nargs="*", metavar="PEER")
    parser.add_argument("--ours", required=True)
    parser.add_argument("--limit")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--python", action="append", default=[], metavar="NAME=PROGRAM")
    arguments = parser.parse_args()
    pythons = dict(text.split("=", 1) for text in arguments.python)
    peers = arguments.peers or PEERS + ["limit"] * bool(arguments.limit)
    rates = {}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(arguments.rounds):
            for peer in peers:
                mine = ours(arguments.ours)
                if peer == "limit":
                    found = limit(arguments.limit, folder)
                else:
                    command = [pythons.get(peer, sys.executable), os.path.abspath(__file__), "--measure", peer]
                    found = {peer: {size: answer([*command, str(size), str(arguments.seconds)])[0]["rate"] for size in SIZES}}
                for name, by_size in found.items():
                    for size in SIZES:
                        rates.setdefault((name, size), []).append((mine[size], by_size[size]))
                        print(f"{name}, {size}: {mine[size]:.4g} over {by_size[size]:.4g}", file=sys.stderr, flush=True)
    print("| peer | vehicles | ours, M/s | peer, M/s | ours over peer, median | range |\n| --- | --- | --- | --- | --- | --- |")
    for (name, size), pairs in rates.items():
        ratios = [mine / theirs for mine, theirs in pairs]
        mine, theirs = (statistics.median(values) / 1e6 for values in zip(*pairs))
        spread = f"{min(ratios):.3g} to {max(ratios):.3g}"
        print(f"| {name} | {size} | {mine:.1f} | {theirs:.3g} | {statistics.median(ratios):.3g} | {spread} |")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--measure"]:
        measure(sys.argv[2], int(sys.argv[3]), float(sys.argv[4]))
    else:
        main()
