"""What all tests share."""

from __future__ import annotations

import numpy as np
import pytest

import lanecraft

#: One of each kind of environment.
KINDS = {
    "default": {},
    "paper": {"preset": "paper"},
    "fast": {"preset": "fast"},
    "grid": {"config": {"observation.form": "grid"}},
    "raw": {"config": {"observation.form": "raw"}},
    "plan": {"seat": "plan"},
    "control": {"seat": "control"},
    "merge": {"scenario": "merge"},
}


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> dict:
    """The arguments of one kind of environment."""
    return KINDS[request.param]


@pytest.fixture
def env(kind: dict):
    """One environment of each kind, before its first episode."""
    with_mode = lanecraft.Env(**kind)
    yield with_mode
    with_mode.close()


def random_actions(space, count: int, seed: int = 0) -> list[np.ndarray]:
    """The same actions for the same seed."""
    space.seed(seed)
    return [space.sample() for _ in range(count)]
