"""Lanecraft: high-speed highway driving as fast, reproducible environments.

Importing the package registers ``lanecraft/Highway-v0``, ``lanecraft/HighwayPaper-v0`` and ``lanecraft/HighwayFast-v0`` with Gymnasium.
"""

from __future__ import annotations

from gymnasium.envs.registration import register as _register

from . import policies, traffic
from ._lanecraft import __version__, scenarios
from .env import Env
from .errors import ActionError, ConfigError, LanecraftError, SnapshotError
from .results import Results, evaluate
from .vector import VectorEnv
from .wrappers import DecisionPoints

__all__ = [
    "ActionError",
    "ConfigError",
    "DecisionPoints",
    "Env",
    "LanecraftError",
    "Results",
    "SnapshotError",
    "VectorEnv",
    "__version__",
    "evaluate",
    "policies",
    "scenarios",
    "traffic",
]

for _name, _preset in [("Highway-v0", "default"), ("HighwayPaper-v0", "paper"), ("HighwayFast-v0", "fast")]:
    _register(
        id=f"lanecraft/{_name}",
        entry_point="lanecraft:Env",
        vector_entry_point="lanecraft:VectorEnv",
        kwargs={"preset": _preset},
        # The environments check order, actions and observations themselves, at no cost.
        order_enforce=False,
        disable_env_checker=True,
    )
