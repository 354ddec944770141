"""From the keyword arguments that all environments share to a task and its spaces."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from os import PathLike, fspath
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ._lanecraft import Task
from .errors import ConfigError

LARGEST_SEED = 2**64 - 1


def make_task(
    preset: str,
    config: Mapping[str, Any] | None,
    scenario: str | PathLike[str] | None,
    seat: str,
    masked_actions: str,
    units: str,
) -> Task:
    return Task(preset, *checked_scene(config, scenario), seat, masked_actions, units)


def checked_scene(config: Mapping[str, Any] | None, scenario: str | PathLike[str] | None) -> tuple[dict[str, Any], str | None]:
    if config is not None and not isinstance(config, Mapping):
        raise TypeError(f"config is a mapping of keys to values, not {type(config).__name__}")
    return dict(config or {}), None if scenario is None else fspath(scenario)


def action_space(task: Task, units: str) -> spaces.Discrete | spaces.Box:
    if task.action_bounds is None:
        return spaces.Discrete(task.actions or 0)
    low, _, high = (np.array(bound, dtype=np.float32) for bound in task.action_bounds)
    if units == "normalized":
        return spaces.Box(-1.0, 1.0, low.shape, dtype=np.float32)
    return spaces.Box(low, high, dtype=np.float32)


def observation_space(task: Task) -> Any:
    low, high = (np.array(bound, dtype=np.float32).reshape(task.observation_shape) for bound in task.observation_bounds)
    return spaces.Box(low, high, dtype=np.float32)


def checked_whole(name: str, value: Any, least: int, most: int) -> int:
    """``value`` as a Python integer within these bounds."""
    try:
        whole = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} is a whole number, not {type(value).__name__}") from None
    if not least <= whole <= most:
        raise ConfigError(f"{name} is {whole}, but must be in {least}..={most}")
    return whole


def checked_seed(seed: Any) -> int:
    return checked_whole("a seed", seed, 0, LARGEST_SEED)


def checked_real(name: str, value: Any) -> float:
    array = checked_reals(name, value)
    if array.ndim:
        raise TypeError(f"{name} is one number, not an array of shape {array.shape}")
    return float(array)


def checked_reals(name: str, values: Any) -> NDArray[np.float64]:
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name} is of real numbers, not of {array.dtype}")
    return array.astype(np.float64)
