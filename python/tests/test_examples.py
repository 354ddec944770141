"""The examples run from the command line and tell what they have learned."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
SHORT = {
    "dqn": ["--steps", "1280", "--warm-up", "640", "--num-envs", "16", "--episodes", "20"],
    "ppo": ["--steps", "1024", "--num-envs", "16", "--rollout", "16", "--episodes", "20"],
}


@pytest.mark.parametrize("preset", ["fast", "default"])
@pytest.mark.parametrize("name", SHORT)
def test_examples_run(name, preset):
    pytest.importorskip("torch")
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), "--preset", preset, *SHORT[name]]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    rows = re.findall(r"^(\w+) +return +(\S+) ± \S+ +collisions +(\S+) % \[\S+, \S+\]", done.stdout, re.MULTILINE)
    assert [row[0] for row in rows] == ["random", "hold", "learned"]


@pytest.mark.parametrize("name", SHORT)
def test_every_setting_is_an_argument(name):
    pytest.importorskip("torch")
    help_ = subprocess.run([sys.executable, str(EXAMPLES / f"{name}.py"), "--help"], capture_output=True, text=True, check=True)
    assert "--seed" in help_.stdout and "--discount" in help_.stdout
