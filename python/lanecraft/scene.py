"""What the ego car knows at one instant, made of plain numbers and arrays: the input of :mod:`lanecraft.mpc` and :mod:`lanecraft.plan`.

Positions are along the road (s) and to the left of its reference line (d), which is the center of lane 0, the rightmost one; lane i has
its center at i times ``road.lane_width_m``. The road itself is part of the configuration.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays
from ._arrays import Floats

FORECAST_STEP_S = 0.1
"""Time between two points of a forecast, s."""

FORECAST_POINTS = 51
"""Points of a forecast, the first one now: 5 s."""

LARGEST_SPEED_MPS = 150.0


@dataclass(frozen=True)
class Ego:
    """The state of a single-track car in the road frame.

    Args:
        speed_mps: longitudinal speed in the body frame V_x, 0 to 150 m/s.
        d_m: position to the left of the reference line, m.
        s_m: position along the road, m.
        heading_rad: heading relative to the road's tangent φ, positive to the left.
        lateral_speed_mps: lateral speed in the body frame V_y, m/s, positive to the left.
        yaw_rate_radps: yaw rate γ.
        steer_rad: front road-wheel angle δ.
        accel_mps2: longitudinal acceleration.
    """

    speed_mps: float
    d_m: float = 0.0
    s_m: float = 0.0
    heading_rad: float = 0.0
    lateral_speed_mps: float = 0.0
    yaw_rate_radps: float = 0.0
    steer_rad: float = 0.0
    accel_mps2: float = 0.0


_EGO_BOUNDS = {
    "speed_mps": (0.0, LARGEST_SPEED_MPS),
    "heading_rad": (-np.pi, np.pi),
    "lateral_speed_mps": (-LARGEST_SPEED_MPS, LARGEST_SPEED_MPS),
    "yaw_rate_radps": (-100.0, 100.0),
    "steer_rad": (-np.pi / 2, np.pi / 2),
    "accel_mps2": (-100.0, 100.0),
}


@dataclass(frozen=True)
class Neighbors:
    """The other vehicles, one number each; a single number stands for all of them.

    Args:
        ahead_m: shape (N,), from the ego's center to theirs along the road, negative behind.
        speed_mps: speed along the road.
        lane: index of the lane each is in, or leaves.
        d_m: lateral position of their centers; the centers of their lanes by default.
        target_lane: the lane each changes into; ``lane`` by default.
        lateral_speed_mps: speed to the left.
        accel_mps2: acceleration along the road.
        length_m: length.
        width_m: width.
    """

    ahead_m: ArrayLike
    speed_mps: ArrayLike
    lane: ArrayLike
    d_m: ArrayLike | None = None
    target_lane: ArrayLike | None = None
    lateral_speed_mps: ArrayLike = 0.0
    accel_mps2: ArrayLike = 0.0
    length_m: ArrayLike = 4.8
    width_m: ArrayLike = 1.9

    def __len__(self) -> int:
        return int(np.size(np.asarray(self.ahead_m)))


@dataclass(frozen=True)
class Scene:
    """The ego car among its neighbors.

    Args:
        ego: the ego car's state.
        neighbors: the other vehicles, at most 1000.
        ego_lane: index of the ego's lane; the one whose center is nearest by default.
        length_m: the ego's length.
        width_m: the ego's width.
        forecast: your own forecast in place of the configured predictor's: shape (N, 51, 3), each neighbor's distance along the road from
            the ego's *present* position (m), lateral position (m) and speed (m/s), every 0.1 s from now on.

    Example:
        >>> scene = Scene(Ego(speed_mps=28.0, d_m=3.75), Neighbors(ahead_m=[40.0, -25.0], speed_mps=[22.0, 30.0], lane=[1, 2]))
    """

    ego: Ego
    neighbors: Neighbors = field(default_factory=lambda: Neighbors([], [], []))
    ego_lane: int | None = None
    length_m: float = 4.8
    width_m: float = 1.9
    forecast: ArrayLike | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.ego, Ego) or not isinstance(self.neighbors, Neighbors):
            raise TypeError("a Scene is made of an Ego and of Neighbors")
        if self.ego_lane is not None:
            object.__setattr__(self, "ego_lane", _arrays.whole("ego_lane", self.ego_lane, 0, 7))
        ahead_m = _arrays.numbers("neighbors.ahead_m", self.neighbors.ahead_m)
        if ahead_m.ndim != 1:
            raise _arrays.ConfigError(f"`neighbors.ahead_m` has shape {ahead_m.shape}, but must have (N,)")
        if self.forecast is not None:
            shape = (len(ahead_m), FORECAST_POINTS, 3)
            found = _arrays.numbers("forecast", self.forecast)
            if found.shape != shape:
                raise _arrays.ConfigError(f"`forecast` has shape {found.shape}, but must have {shape}")
            object.__setattr__(self, "forecast", _arrays.bounded("forecast", found, shape))

    def _packed(self, lane_width_m: float) -> PackedScene:
        """The scene as the compiled half reads it."""
        values = {name: getattr(self.ego, name) for name in _EGO_ORDER}
        ego = [_arrays.number(f"ego.{name}", value, *_EGO_BOUNDS.get(name, ())) for name, value in values.items()]
        length_m = _arrays.number("length_m", self.length_m, 0.5, 30.0)
        width_m = _arrays.number("width_m", self.width_m, 0.5, 5.0)
        n = self.neighbors
        count = len(n)
        lane = _arrays.indices("neighbors.lane", n.lane, count)
        target = lane if n.target_lane is None else _arrays.indices("neighbors.target_lane", n.target_lane, count)
        d_m = lane * lane_width_m if n.d_m is None else n.d_m
        speed = (0.0, LARGEST_SPEED_MPS)
        columns = [
            _arrays.bounded("neighbors.ahead_m", n.ahead_m, (count,)),
            _arrays.bounded("neighbors.d_m", d_m, (count,)),
            _arrays.bounded("neighbors.speed_mps", n.speed_mps, (count,), *speed),
            _arrays.bounded("neighbors.lateral_speed_mps", n.lateral_speed_mps, (count,), -LARGEST_SPEED_MPS, LARGEST_SPEED_MPS),
            _arrays.bounded("neighbors.accel_mps2", n.accel_mps2, (count,), -100.0, 100.0),
            _arrays.bounded("neighbors.length_m", n.length_m, (count,), 0.1, 50.0),
            _arrays.bounded("neighbors.width_m", n.width_m, (count,), 0.1, 10.0),
        ]
        forecast = None if self.forecast is None else np.asarray(self.forecast)
        return PackedScene(
            np.array(ego), (length_m, width_m), self.ego_lane, np.stack(columns, axis=1), np.stack([lane, target], axis=1), forecast
        )


_EGO_ORDER = ("s_m", "d_m", "heading_rad", "speed_mps", "lateral_speed_mps", "yaw_rate_radps", "steer_rad", "accel_mps2")


@dataclass(frozen=True)
class PackedScene:
    """A scene for the compiled half: see ``SceneArrays`` there."""

    _ego: Floats
    _size_m: tuple[float, float]
    ego_lane: int | None
    _neighbors: Floats
    _lanes: NDArray[np.int64]
    forecast: Floats | None


def packed(scene: Any, lane_width_m: float) -> PackedScene:
    """The scene as the compiled half reads it, or an exception if it is none."""
    if not isinstance(scene, Scene):
        raise TypeError(f"`scene` is a lanecraft.scene.Scene, not {type(scene).__name__}")
    return scene._packed(lane_width_m)
