"""How the scripts beside it take times: rates for a while, and programs that print them."""

import json
import os
import subprocess
import time


def rate(step, updates, seconds):
    """Updates per second of this process's time on a processor."""
    step()
    begun, computed, count = time.perf_counter(), time.process_time(), 0
    while time.perf_counter() - begun < seconds:
        step()
        count += 1
    return count * updates / (time.process_time() - computed)


def answer(command):
    environment = os.environ | {"OMP_NUM_THREADS": "1", "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stderr[-2000:]}")
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
