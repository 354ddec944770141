"""Points of the fundamental diagram from SUMO and from a recording, for `lanecraft study fundamental-diagram`.

Usage: fundamental_diagram.py sumo FILE | fundamental_diagram.py recording TRAFFIC_CSV_GZ FILE. The first needs eclipse-sumo and
libsumo 1.28.0.

SUMO drives the study's ring with the study's drivers: three lanes, 1 km, IDM with the default preset's ranges, a step of 0.1 s
and the ballistic update; its lane-change model is LC2013, without and with its wish to keep right.

The recording is NGSIM's US-101. Its scenes see no fixed stretch of road, so Edie's region is bounded by trajectories: for each
site, lane and 5 s, the strips between all followers and the leaders that they are seen behind.
"""

import bisect
import csv
import gzip
import math
import random
import sys
import tempfile
from collections import defaultdict

RING_M, LANES, LENGTH = 1000.0, 3, 4.8
DENSITIES = [6, 10, 14, 20, 26, 34, 44, 60, 80]
SEEDS = 2
STEP_S, SETTLE_S, WATCHED_S = 0.1, 120, 480
KEEP_RIGHT = {"sumo-lc2013": 0, "sumo-lc2013-keep-right": 1}


def drivers(count, stream):
    """The default preset's drivers."""
    return [(stream.uniform(19, 27), stream.uniform(1.0, 1.8), 2.0, 1.5, 2.0) for _ in range(count)]


def sumo_run(density, seed, keep_right):
    """Mean speed in m/s and lane changes per vehicle-kilometer."""
    import libsumo
    import sumo_road

    stream = random.Random(1000 * density + seed)
    per_lane = round(density * RING_M / 1000)
    pitch = RING_M / per_lane
    with tempfile.TemporaryDirectory() as folder:
        lines = [sumo_road.ring(folder, RING_M, LANES, 40)]
        cars = []
        for k, car in enumerate(drivers(per_lane * LANES, stream)):
            lane, at = k % LANES, (k // LANES + 0.5) * pitch
            speed = min(0.95 * car[0], max(0.0, (pitch - LENGTH - car[2]) / car[1]))
            lines.append(sumo_road.vehicle_type(f"t{k}", car, lcKeepRight=keep_right))
            half = RING_M / 2
            route = "r" if at < half else "s"
            cars.append(sumo_road.vehicle(f"v{k}", f"t{k}", lane, at % half, speed, route))
        edges = " ".join(["e1 e0"] * 40)
        lines += [f'<route id="s" edges="{edges}"/>', *cars]
        sumo_road.write(f"{folder}/routes.xml", "<routes>" + "\n".join(lines) + "</routes>")
        more = ["--step-method.ballistic", "true", "--lanechange-output", f"{folder}/changes.xml"]
        libsumo.start(sumo_road.options(folder, STEP_S, *more))
        speeds = []
        for second in range(SETTLE_S + WATCHED_S):
            for _ in range(round(1 / STEP_S)):
                libsumo.simulationStep()
            ids = libsumo.vehicle.getIDList()
            assert len(ids) == len(cars), "a vehicle has left the ring"
            if second >= SETTLE_S:
                speeds.append(sum(libsumo.vehicle.getSpeed(name) for name in ids) / len(ids))
        libsumo.close()
        with open(f"{folder}/changes.xml", encoding="utf-8") as file:
            times = [float(line.split(' time="')[1].split('"')[0]) for line in file if "<change " in line]
    speed = sum(speeds) / len(speeds)
    changes = sum(time >= SETTLE_S for time in times)
    return speed, changes / (len(cars) * speed * WATCHED_S / 1000)


def sumo(path):
    rows = []
    for name, keep_right in KEEP_RIGHT.items():
        for density in DENSITIES:
            runs = [sumo_run(density, seed, keep_right) for seed in range(SEEDS)]
            speed, changes = (sum(values) / SEEDS for values in zip(*runs))
            rows.append([name, density, f"{speed:.4f}", f"{changes:.4f}"])
    write_rows(path, ["series", "density_veh_per_km_lane", "speed_mps", "changes_per_veh_km"], rows)


BLOCK_S = 5.0
FRAME_S = 0.1
# A longer distance to the leader may hide a vehicle that was not recorded.
FARTHEST_M = 100.0
# A region of fewer vehicle-seconds says little.
SHORTEST_S = 10.0
# A lane is held this long before and after a change.
HELD_FRAMES = 10
# The auxiliary lane between the ramps is left out.
FREEWAY_LANES = range(1, 6)


def recording(source, path):
    scenes = defaultdict(list)
    tracks = defaultdict(list)
    with gzip.open(source, "rt", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            lane = int(row["lane"])
            if row["site"].startswith("us101") and lane in FREEWAY_LANES:
                frame, s, v = int(row["frame"]), float(row["s_m"]), float(row["vs_mps"])
                scenes[row["site"], lane, frame].append((s, v))
                tracks[row["site"], row["vehicle_id"]].append((frame, lane, s))
    regions = defaultdict(lambda: [0.0, 0.0, 0.0])
    for (site, lane, frame), vehicles in scenes.items():
        vehicles.sort()
        region = regions[site, lane, math.floor(frame * FRAME_S / BLOCK_S)]
        for (s, v), (ahead, _) in zip(vehicles, vehicles[1:]):
            if ahead - s <= FARTHEST_M:
                for k, value in enumerate([1.0, v, ahead - s]):
                    region[k] += value * FRAME_S
    rows = []
    for (site, lane, block), (time, way, area) in sorted(regions.items()):
        if time >= SHORTEST_S:
            rows.append([site, lane, block, f"{1000 * time / area:.3f}", f"{way / time:.4f}"])
    write_rows(path, ["site", "lane", "block", "density_veh_per_km_lane", "speed_mps"], rows)
    changes, way = lane_changes(tracks.values())
    print(f"{changes} lane changes on {way / 1000:.1f} vehicle-kilometers")


def lane_changes(tracks):
    """Changes with the lane held before and after, and the way driven in m."""
    changes, way = 0, 0.0
    for track in tracks:
        track.sort()
        frames = [point[0] for point in track]
        way += track[-1][2] - track[0][2]
        for k in range(1, len(track)):
            if track[k][1] != track[k - 1][1]:
                before = track[bisect.bisect_left(frames, frames[k] - HELD_FRAMES) : k]
                after = track[k : bisect.bisect_left(frames, frames[k] + HELD_FRAMES)]
                changes += all(len({p[1] for p in side}) == 1 and len(side) == HELD_FRAMES for side in [before, after])
    return changes, way


def write_rows(path, head, rows):
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head)
        writer.writerows(rows)


if __name__ == "__main__":
    {"sumo": sumo, "recording": recording}[sys.argv[1]](*sys.argv[2:])
