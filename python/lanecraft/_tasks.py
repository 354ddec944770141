"""From the keyword arguments that all environments share to a task and its spaces."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike, fspath
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from . import _arrays
from ._lanecraft import Task

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
    return _arrays.settings(config), None if scenario is None else fspath(scenario)


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


def checked_seed(seed: Any) -> int:
    return _arrays.whole("seed", seed, 0, LARGEST_SEED)


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
