"""DAQP (PyPI `daqp`, class `Model`) on the sequences written by `cargo xtask bench qp --dump DIR`.

Usage: daqp_qp.py DIR. Needs daqp 0.11 and numpy.

The states are eliminated, the rows are DAQP's own soft constraints with linear and quadratic weights, and each solve starts
warm from the one before. Its time is the solve time that DAQP reports, plus the wall time of `update` where H or A change;
where only vectors change, the time of their update is left out, in DAQP's favor (a second figure counts all updates). The
elimination of the states is left out, too. Shortest of three passes for each problem.
"""

import sys
import time
from pathlib import Path

import daqp
import numpy as np

SOFT = 8  # bit of `sense`
UNBOUNDED = 1e30
PASSES = 3


def load(path):
    """Problems as dictionaries, and for each the first input and the time in us of our solver."""
    numbers = np.fromfile(path)
    count, horizon, nx, ns = numbers[:4].astype(int)
    stage = nx * nx + 4 * nx + 2 + ns * (nx + 5)
    size = nx + 2 + horizon * stage
    problems = [unpack(row, horizon, nx, ns) for row in numbers[4 : 4 + count * size].reshape(count, size)]
    return problems, numbers[4 + count * size :].reshape(count, 2)


def unpack(row, horizon, nx, ns):
    stages = row[nx + 2 :].reshape(horizon, -1)
    a, b, c, q, xr, u, rows = np.split(stages, np.cumsum([nx * nx, nx, nx, nx, nx, 2]), axis=1)
    rows = rows.reshape(horizon, ns, nx + 5)
    return {
        "x0": row[:nx], "bounds": row[nx : nx + 2], "a": a.reshape(horizon, nx, nx), "b": b, "c": c, "q": q, "xr": xr,
        "r": u[:, 0], "ur": u[:, 1], "rows": rows,
    }  # fmt: skip


def condense(p):
    """H, f, A and both bounds in the inputs alone; the first constraints are the bounds of the inputs."""
    horizon, nx = p["b"].shape
    gain, free = np.zeros((nx, horizon)), p["x0"].copy()
    hessian, gradient = np.diag(p["r"]), -p["r"] * p["ur"]
    matrix, offset = [], []
    for k in range(horizon):
        c, d = p["rows"][k, :, :nx], p["rows"][k, :, nx]
        row = c @ gain
        row[:, k] += d
        matrix.append(row)
        offset.append(c @ free)
        gain = p["a"][k] @ gain
        gain[:, k] += p["b"][k]
        free = p["a"][k] @ free + p["c"][k]
        hessian += gain.T @ (p["q"][k][:, None] * gain)
        gradient += gain.T @ (p["q"][k] * (free - p["xr"][k]))
    rows, offset = p["rows"].reshape(-1, nx + 5), np.concatenate(offset)
    lower = np.concatenate([np.full(horizon, p["bounds"][0]), rows[:, nx + 1] - offset])
    upper = np.concatenate([np.full(horizon, p["bounds"][1]), rows[:, nx + 2] - offset])
    lower, upper = np.maximum(lower, -UNBOUNDED), np.minimum(upper, UNBOUNDED)
    return {"H": hessian, "f": gradient, "A": np.vstack(matrix), "bupper": upper, "blower": lower}


def weights(p):
    """Quadratic (reciprocal) and linear weights of all constraints."""
    horizon, nx = p["b"].shape
    rows = p["rows"].reshape(-1, nx + 5)
    pad = np.zeros(horizon)
    rho, w = np.concatenate([pad, 1 / rows[:, nx + 4]]), np.concatenate([pad, rows[:, nx + 3]])
    return {"rho_l": rho, "rho_u": rho, "w_l": w, "w_u": w}


def run(problems):
    """Times in us (solve alone, with the updates of matrices, with all updates), first inputs, and failures."""
    programs = [condense(p) for p in problems]
    solve_us, update_us = np.full(len(programs), np.inf), np.full(len(programs), np.inf)
    anew = np.zeros(len(programs), dtype=bool)
    first, failed = np.zeros(len(programs)), 0
    horizon = len(problems[0]["b"])
    for _ in range(PASSES):
        model, failed = daqp.Model(), 0
        for i, program in enumerate(programs):
            if i == 0:
                sense = np.zeros(len(program["bupper"]), dtype=np.int32)
                sense[horizon:] = SOFT
                model.setup(**program, sense=sense)
                model.soft_weights(**weights(problems[0]))
                wall = 0.0
            else:
                before = programs[i - 1]
                anew[i] = any(not np.array_equal(program[k], before[k]) for k in ("H", "A"))
                data = program if anew[i] else {k: program[k] for k in ("f", "bupper", "blower")}
                start = time.perf_counter()
                model.update(**data)
                wall = 1e6 * (time.perf_counter() - start)
            x, _, flag, info = model.solve()
            failed += flag < 1
            first[i] = x[0]
            solve_us[i] = min(solve_us[i], 1e6 * info["solve_time"])
            update_us[i] = min(update_us[i], wall)
    return solve_us, solve_us + anew * update_us, solve_us + update_us, first, failed


def main(folder):
    for path in sorted(Path(folder).glob("*.bin")):
        problems, ours = load(path)
        solve, total, updated, first, failed = run(problems)
        low, high = problems[0]["bounds"]
        apart = np.abs(first - ours[:, 0]).max() / (high - low)
        print(
            f"{path.stem:10} daqp mean {total.mean():8.2f} (solve alone {solve.mean():.2f}, all updates {updated.mean():.2f}) max {total.max():8.2f} us, "
            f"{failed} failed | ours mean {ours[:, 1].mean():8.2f} max {ours[:, 1].max():8.2f} us | "
            f"ours/daqp mean {ours[:, 1].mean() / total.mean():.3f} | first inputs apart by {apart:.1e} of the range",
            flush=True,
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
