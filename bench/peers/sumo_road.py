"""A one-edge road for SUMO, straight or closed to a ring, shared by the scripts beside it."""

import math
import os
import subprocess

import sumo


def write(path, text):
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


def vehicle_type(name, car, model="IDM", lane_change="LC2013", **more):
    """`car`: desired speed, time headway, least gap, acceleration, comfortable deceleration (SI units)."""
    v0, headway, gap, accel, decel = car
    attributes = {
        "id": name, "carFollowModel": model, "laneChangeModel": lane_change, "length": 4.8, "width": 1.9,
        "maxSpeed": v0, "tau": headway, "minGap": gap, "accel": accel, "decel": decel, "speedFactor": 1, "speedDev": 0,
    }  # fmt: skip
    return "<vType " + " ".join(f'{key}="{value!r}"'.replace("'", "") for key, value in (attributes | more).items()) + "/>"


def vehicle(name, kind, lane, front_m, speed, route):
    place = f'depart="0" departLane="{lane}" departPos="{front_m:.6f}" departSpeed="{speed:.6f}"'
    return f'<vehicle id="{name}" type="{kind}" route="{route}" {place} insertionChecks="none"/>'


def netconvert(folder, nodes, edges, lanes):
    """Builds `folder`/net.xml from (name, x, y) and (name, from, to, shape or None); no speed limit that matters."""
    write(f"{folder}/nodes.xml", "<nodes>" + "".join(f'<node id="{n}" x="{x:.3f}" y="{y:.3f}"/>' for n, x, y in nodes) + "</nodes>")
    text = "<edges>"
    for name, begin, end, shape in edges:
        shape = f' shape="{" ".join(f"{x:.4f},{y:.4f}" for x, y in shape)}"' if shape else ""
        text += f'<edge id="{name}" from="{begin}" to="{end}" numLanes="{lanes}" speed="60"{shape}/>'
    write(f"{folder}/edges.xml", text + "</edges>")
    program = os.path.join(sumo.SUMO_HOME, "bin", "netconvert")
    command = [program, "-n", f"{folder}/nodes.xml", "-e", f"{folder}/edges.xml", "-o", f"{folder}/net.xml"]
    subprocess.run([*command, "--no-turnarounds", "true", "--no-internal-links", "true"], check=True, capture_output=True)


def straight(folder, length_m, lanes):
    netconvert(folder, [("a", 0, 0), ("b", length_m, 0)], [("e0", "a", "b", None)], lanes)


def ring(folder, length_m, lanes, turns):
    """Two half circles, e0 and e1, without inner lanes where they meet; gives the route r, which goes round `turns` times."""
    radius = length_m / (2 * math.pi)

    def arc(first):
        angles = [first + math.pi * k / 60 for k in range(61)]
        return [(radius * math.cos(a), radius * math.sin(a)) for a in angles]

    netconvert(folder, [("a", radius, 0), ("b", -radius, 0)], [("e0", "a", "b", arc(0)), ("e1", "b", "a", arc(math.pi))], lanes)
    return f'<route id="r" edges="{" ".join(["e0 e1"] * turns)}"/>'


def options(folder, step_s, *more):
    files = ["-n", f"{folder}/net.xml", "-r", f"{folder}/routes.xml"]
    quiet = ["--no-step-log", "--no-warnings", "--time-to-teleport", "-1", "--max-depart-delay", "-1", "--collision.action", "warn"]
    return ["sumo", *files, *quiet, "--step-length", repr(step_s), "--seed", "1", *more]
