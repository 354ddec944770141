"""Checks of what users hand in: real numbers of a shape, without copies where none are needed."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import ConfigError

Floats = NDArray[np.float64]

LARGEST = 1e6


def numbers(name: str, values: Any, *, finite: bool = True) -> Floats:
    """``values`` as an array of float64; whole numbers and booleans become real."""
    try:
        found = np.asarray(values)
    except ValueError:
        raise ConfigError(f"`{name}` has rows of different lengths") from None
    if found.dtype.kind not in "biuf":
        raise TypeError(f"`{name}` holds real numbers, not {_described(values, found)}")
    found = found.astype(np.float64, copy=False)
    bad = ~np.isfinite(found) if finite else np.isnan(found)
    if bad.any():
        raise ConfigError(f"`{name}` holds {found[bad][0]}, but must be {'finite' if finite else 'no NaN'}")
    return found


def shaped(name: str, values: Any, shape: tuple[int, ...], *, finite: bool = True) -> Floats:
    """The same, broadcast to ``shape``."""
    found = numbers(name, values, finite=finite)
    try:
        return np.broadcast_to(found, shape)
    except ValueError:
        raise ConfigError(f"`{name}` has shape {found.shape}, but must have {shape} or broadcast to it") from None


def number(name: str, value: Any, low: float = -LARGEST, high: float = LARGEST) -> float:
    """One real number within bounds."""
    found = numbers(name, value)
    if found.ndim != 0:
        raise TypeError(f"`{name}` is one number, not an array of shape {found.shape}")
    if not low <= float(found) <= high:
        raise ConfigError(f"`{name}` is {float(found)}, but must be in {low:g}..={high:g}")
    return float(found)


def bounded(name: str, values: Any, shape: tuple[int, ...], low: float = -LARGEST, high: float = LARGEST) -> Floats:
    """Real numbers within bounds, broadcast to ``shape``."""
    found = shaped(name, values, shape)
    if found.size and not (low <= found.min() and found.max() <= high):
        worst = found.min() if found.min() < low else found.max()
        raise ConfigError(f"`{name}` holds {worst}, but must be in {low:g}..={high:g}")
    return found


def whole(name: str, value: Any, low: int, high: int) -> int:
    """One whole number within bounds."""
    try:
        found = operator.index(value)
    except TypeError:
        raise TypeError(f"`{name}` is a whole number, not {type(value).__name__}") from None
    if not low <= found <= high:
        raise ConfigError(f"`{name}` is {found}, but must be in {low}..={high}")
    return found


def indices(name: str, values: Any, count: int) -> NDArray[np.int64]:
    """``count`` whole numbers."""
    try:
        found = np.asarray(values)
    except ValueError:
        raise ConfigError(f"`{name}` has rows of different lengths") from None
    if found.size and found.dtype.kind not in "iu":
        raise TypeError(f"`{name}` holds whole numbers, not {_described(values, found)}")
    if found.dtype.kind == "u" and found.size and found.max() > np.iinfo(np.int64).max:
        raise ConfigError(f"`{name}` holds {found.max()}, which does not fit 64 bits")
    try:
        return np.ascontiguousarray(np.broadcast_to(found.astype(np.int64, copy=False), (count,)))
    except ValueError:
        raise ConfigError(f"`{name}` has shape {found.shape}, but must have ({count},)") from None


def settings(config: Any, name: str = "config") -> dict[str, Any]:
    """A mapping as a dictionary; ``None`` as an empty one."""
    if config is not None and not isinstance(config, Mapping):
        raise TypeError(f"`{name}` is a mapping of keys to values, not {type(config).__name__}")
    return dict(config or {})


def text(name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"`{name}` is a string, not {type(value).__name__}")
    return value


def _described(values: Any, found: NDArray[Any]) -> str:
    return f"an array of {found.dtype}" if isinstance(values, np.ndarray) else type(values).__name__

