"""The two model-predictive controllers alone (Eqs. 25, 26).

Example:
    >>> from lanecraft.mpc import LateralController, LongitudinalController
    >>> from lanecraft.scene import Ego, Neighbors, Scene
    >>> scene = Scene(Ego(speed_mps=28.0, d_m=3.5), Neighbors(ahead_m=[40.0], speed_mps=[22.0], lane=[1]))
    >>> speed = LongitudinalController().plan(scene)
    >>> steer = LateralController().plan(scene, d_m=3.75, speeds_mps=speed.speeds_mps)
    >>> round(speed.accel_mps2, 3), round(steer.steer_rad, 4), steer.rung
    (-1.19, 0.033, 'solved')
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import _arrays
from ._arrays import Floats
from ._lanecraft import LateralCore, LongitudinalCore, Parts
from .errors import ConfigError
from .plan import Quintic
from .scene import LARGEST_SPEED_MPS, Scene, packed

__all__ = ["LateralController", "LongitudinalController", "Solve", "SpeedPlan", "SteerPlan"]

LARGEST_PROFILE = 1000


class Solve(NamedTuple):
    """How a solve went."""

    solved: bool
    """Whether the optimum was reached."""
    iterations: int
    """Steps of the solver."""
    active: int
    """Constraints active at the end."""
    slack_max: float
    """Largest violation of a soft constraint, in its own unit."""
    kkt_residual: float
    """Residual of the optimality conditions, relative."""


@dataclass(frozen=True, eq=False)
class SpeedPlan:
    """The longitudinal controller's answer."""

    accel_mps2: float
    """Acceleration to command now, m/s²."""
    jerk_mps3: float
    """Planned jerk of the car, m/s³."""
    speeds_mps: Floats
    """Planned speeds, m/s, shape (N + 1,): the first one now, then one every ``control.longitudinal_step_s``."""
    states: Floats | None
    """Planned distance from here (m), speed (m/s) and acceleration (m/s²) at the end of each stage, shape (N, 3); ``None`` if the
    answer is none of a solve."""
    rung: str
    """Where the answer comes from: ``"solved"``, ``"shifted-plan"``, ``"feedback-law"``, ``"brake-in-lane"`` or ``"full-brake"``."""
    solve: Solve
    """How the solve went."""


@dataclass(frozen=True, eq=False)
class SteerPlan:
    """The lateral controller's answer."""

    steer_rad: float
    """Road-wheel angle to command now, rad."""
    states: Floats | None
    """Planned d (m), V_y (m/s), heading (rad), yaw rate (rad/s) and road-wheel angle (rad) at the end of each stage, shape (N, 5);
    ``None`` if the answer is none of a solve."""
    rung: str
    """Where the answer comes from, as in :class:`SpeedPlan`."""
    solve: Solve
    """How the solve went."""
    front_slip_use: float
    """Present front slip angle over its limit."""
    rear_slip_use: float
    """Present rear slip angle over its limit."""
    yaw_rate_use: float
    """Present yaw rate over μ g / V."""


class _Controller:
    def __init__(self, config: Mapping[str, Any] | None = None, *, preset: str = "default") -> None:
        self._parts = Parts(_arrays.text("preset", preset), _arrays.settings(config))
        self.speed_ratio, self.path_ratio = self._parts.plain_weights

    @property
    def config_toml(self) -> str:
        """The complete configuration, every key with its value."""
        return self._parts.config_toml


class LongitudinalController(_Controller):
    """Speed and acceleration behind predicted leaders (Eq. 25), with its warm start: one object for one car, a call each control period.

    Args:
        config: your own numbers laid over the preset, as for :class:`lanecraft.Env`: the sections ``control``, ``road``, ``vehicle`` and
            ``prediction`` and ``env.control_period_s`` count.
        preset: ``"default"`` or ``"paper"``.
    """

    def __init__(self, config: Mapping[str, Any] | None = None, *, preset: str = "default") -> None:
        super().__init__(config, preset=preset)
        self._core = LongitudinalCore(self._parts)

    def plan(
        self,
        scene: Scene,
        *,
        reference_accel_mps2: float = 0.0,
        target_speed_mps: float | None = None,
        lane: int | None = None,
        other_lane: int | None = None,
        speed_ratio: float | None = None,
    ) -> SpeedPlan:
        """Plans from this scene.

        Args:
            scene: what is known now.
            reference_accel_mps2: a_ref, the acceleration that is wanted, −20 to 20.
            target_speed_mps: the speed whose error is weighed; ``control.speed_max_mps`` within the road's limit by default.
            lane: whose leader bounds the spacing; the ego's by default.
            other_lane: a second such lane: while changing, the one that is entered.
            speed_ratio: q_1, the weight of the squared speed error against that of the acceleration error, 1/s², 0 to 1e6;
                ``actions.change_speed_ratio`` by default.
        """
        accel = _arrays.number("reference_accel_mps2", reference_accel_mps2, -20.0, 20.0)
        target = None if target_speed_mps is None else _arrays.number("target_speed_mps", target_speed_mps, 0.0, LARGEST_SPEED_MPS)
        ratio = self.speed_ratio if speed_ratio is None else _arrays.number("speed_ratio", speed_ratio, 0.0, 1e6)
        lanes = (_lane("lane", lane), _lane("other_lane", other_lane))
        found = self._core.plan(packed(scene, self._parts.lane_width_m), (accel, target), lanes, ratio)
        accel_mps2, jerk_mps3, speeds_mps, states, rung, solve = found
        return SpeedPlan(accel_mps2, jerk_mps3, speeds_mps, states, rung, Solve(*solve))

    def sent(self, accel_mps2: float) -> None:
        """Tells that the drive train was sent this command (m/s²) in place of the last plan's."""
        self._core.sent(_arrays.number("accel_mps2", accel_mps2, -100.0, 100.0))


class LateralController(_Controller):
    """Steering along a line or a path within the limits of lateral stability (Eq. 26), with its warm start: one object for one car, a
    call each control period.

    Args:
        config: as for :class:`LongitudinalController`.
        preset: ``"default"`` or ``"paper"``.
    """

    def __init__(self, config: Mapping[str, Any] | None = None, *, preset: str = "default") -> None:
        super().__init__(config, preset=preset)
        self._core = LateralCore(self._parts)

    def plan(
        self,
        scene: Scene,
        *,
        d_m: float | None = None,
        path: Quintic | None = None,
        elapsed_s: float = 0.0,
        speeds_mps: ArrayLike | None = None,
        path_ratio: float | None = None,
    ) -> SteerPlan:
        """Plans from this scene along the line ``d_m`` or along ``path``, one of which must be given.

        Args:
            scene: what is known now; the other vehicles do not count.
            d_m: lateral position to be at, m, such as the center of a lane.
            path: lateral position over time.
            elapsed_s: time since the path began, s.
            speeds_mps: planned speeds, shape (K,), the first one now, one every ``control.longitudinal_step_s``
                (:attr:`SpeedPlan.speeds_mps`); the present speed by default.
            path_ratio: q_2, the weight of the squared heading error against that of the steering angle, 1e-8 to 1e8;
                ``actions.keep_path_ratio`` by default.
        """
        if (d_m is None) == (path is None):
            raise ConfigError("give either `d_m` or `path`")
        if path is None:
            path = Quintic((_arrays.number("d_m", d_m), 0.0, 0.0, 0.0, 0.0, 0.0), 1.0)
        if not isinstance(path, Quintic):
            raise TypeError(f"`path` is a lanecraft.plan.Quintic, not {type(path).__name__}")
        view = packed(scene, self._parts.lane_width_m)
        profile = _arrays.numbers("speeds_mps", [scene.ego.speed_mps] if speeds_mps is None else speeds_mps)
        if profile.ndim != 1 or not 1 <= len(profile) <= LARGEST_PROFILE:
            raise ConfigError(f"`speeds_mps` has shape {profile.shape}, but must have (K,) with K in 1..={LARGEST_PROFILE}")
        profile = _arrays.bounded("speeds_mps", profile, profile.shape, 0.0, LARGEST_SPEED_MPS)
        ratio = self.path_ratio if path_ratio is None else _arrays.number("path_ratio", path_ratio, 1e-8, 1e8)
        elapsed = _arrays.number("elapsed_s", elapsed_s, 0.0)
        steer_rad, states, rung, solve, uses = self._core.plan(
            view, (path.coefficients, path.duration_s, elapsed), np.ascontiguousarray(profile), ratio
        )
        return SteerPlan(steer_rad, states, rung, Solve(*solve), *uses)

    def sent(self, steer_rad: float) -> None:
        """Tells that the steering was sent this command (rad) in place of the last plan's."""
        self._core.sent(_arrays.number("steer_rad", steer_rad, -np.pi / 2, np.pi / 2))


def _lane(name: str, lane: Any) -> int | None:
    return None if lane is None else _arrays.whole(name, lane, 0, 7)
