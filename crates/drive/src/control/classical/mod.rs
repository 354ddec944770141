//! Classical controllers as baselines for the model-predictive ones, and a seat that takes either.
//!
//! Lateral: a linear-quadratic regulator with curvature feed-forward ([`Lqr`]) and the law of the robot Stanley
//! ([`Stanley`]). Longitudinal: proportional-integral control of the speed ([`PiSpeed`]). They see the same scene and the
//! same reference as the model-predictive controllers, but know no constraints.

mod lqr;
mod pi;
mod stanley;
#[cfg(test)]
mod tests;

pub use lqr::Lqr;
pub use pi::{PiConfig, PiSpeed};
pub use stanley::{Stanley, StanleyConfig};

use crate::control::{LateralMpc, LateralReference, LongitudinalMpc, Rung, SPEED_POINTS, SpeedGoal};
use crate::predict::Forecast;
use crate::scene::Scene;
use crate::vehicle::VehicleParams;
use crate::vehicle::bicycle::{steady_sideslip_rad, steady_steer_rad};

/// What a lateral controller asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteerCommand {
    /// Road-wheel angle to command now, rad.
    pub steer_rad: f64,
    /// Where it comes from; a classical law always counts as `Solved`.
    pub rung: Rung,
}

/// What a speed controller asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedCommand {
    /// Acceleration to command now, m/s².
    pub accel_mps2: f64,
    /// Planned speeds, m/s: the first one now, then one for each longitudinal step; a classical law plans none and holds
    /// the present one.
    pub speeds_mps: [f64; SPEED_POINTS],
    /// Where it comes from; a classical law always counts as `Solved`.
    pub rung: Rung,
}

/// Whoever steers.
#[derive(Clone, Debug)]
pub enum LateralController {
    /// Eq. 26.
    Mpc(Box<LateralMpc>),
    /// Linear-quadratic regulator.
    Lqr(Box<Lqr>),
    /// The law of Stanley.
    Stanley(Box<Stanley>),
}

impl LateralController {
    /// The command for this scene. `speeds_mps`: the planned speeds; `path_ratio`: q_2, which only the model-predictive
    /// controller takes at each step.
    pub fn steer(
        &mut self,
        scene: &Scene,
        reference: LateralReference<'_>,
        speeds_mps: &[f64],
        path_ratio: f64,
    ) -> SteerCommand {
        match self {
            Self::Mpc(mpc) => {
                let plan = mpc.plan(scene, reference, speeds_mps, path_ratio);
                SteerCommand { steer_rad: plan.steer_rad, rung: plan.rung }
            }
            Self::Lqr(lqr) => SteerCommand { steer_rad: lqr.steer_rad(scene, reference), rung: Rung::Solved },
            Self::Stanley(stanley) => {
                SteerCommand { steer_rad: stanley.steer_rad(scene, reference), rung: Rung::Solved }
            }
        }
    }

    /// The steering is sent this command in place of the last one asked for.
    pub fn sent(&mut self, steer_rad: f64) {
        if let Self::Mpc(mpc) = self {
            mpc.sent(steer_rad);
        }
    }
}

/// Whoever drives and brakes.
#[derive(Clone, Debug)]
pub enum SpeedController {
    /// Eq. 25.
    Mpc(Box<LongitudinalMpc>),
    /// Proportional-integral control of the speed.
    Pi(Box<PiSpeed>),
}

impl SpeedController {
    /// The command for this scene. `speed_ratio`: q_1, which only the model-predictive controller takes.
    pub fn drive(&mut self, scene: &Scene, forecast: &Forecast, goal: &SpeedGoal, speed_ratio: f64) -> SpeedCommand {
        match self {
            Self::Mpc(mpc) => {
                let plan = mpc.plan(scene, forecast, goal, speed_ratio);
                SpeedCommand { accel_mps2: plan.accel_mps2, speeds_mps: plan.speeds_mps, rung: plan.rung }
            }
            Self::Pi(pi) => SpeedCommand {
                accel_mps2: pi.accel_mps2(scene, goal),
                speeds_mps: [scene.ego.speed_mps; SPEED_POINTS],
                rung: Rung::Solved,
            },
        }
    }

    /// The drive train is sent this command in place of the last one asked for.
    pub fn sent(&mut self, accel_mps2: f64) {
        if let Self::Mpc(mpc) = self {
            mpc.sent(accel_mps2);
        }
    }
}

/// The steady motion along the reference's present curvature: what feed-forward asks for.
pub(super) struct Steady {
    pub(super) d_m: f64,
    /// V_y, m/s.
    pub(super) lateral_speed_mps: f64,
    /// φ, rad.
    pub(super) heading_rad: f64,
    /// γ, rad/s.
    pub(super) yaw_rate_radps: f64,
    /// δ, rad.
    pub(super) steer_rad: f64,
}

impl Steady {
    /// `ahead_s` from now, at a constant `speed_mps` > 0.
    pub(super) fn new(
        params: &VehicleParams,
        scene: &Scene,
        reference: LateralReference<'_>,
        speed_mps: f64,
        ahead_s: f64,
    ) -> Self {
        let (d_m, rate_mps, accel_mps2) = derivatives(reference, ahead_s);
        let road = scene.road.curvature_radpm(scene.ego.s_m + speed_mps * ahead_s);
        // Of the path over ground, road and reference together.
        let curvature = road + accel_mps2 / (speed_mps * speed_mps);
        let sideslip = steady_sideslip_rad(params, speed_mps, curvature);
        Self {
            d_m,
            lateral_speed_mps: speed_mps * sideslip,
            heading_rad: rate_mps / speed_mps - sideslip,
            yaw_rate_radps: speed_mps * curvature,
            steer_rad: steady_steer_rad(params, speed_mps, curvature),
        }
    }
}

/// (d, ḋ, d̈) of the reference `ahead_s` from now.
fn derivatives(reference: LateralReference<'_>, ahead_s: f64) -> (f64, f64, f64) {
    match reference {
        LateralReference::LaneCenter { d_m } => (d_m, 0.0, 0.0),
        LateralReference::Path { coefficients: c, duration_s, elapsed_s } => {
            let beyond = elapsed_s + ahead_s >= duration_s;
            let t = if beyond { duration_s } else { elapsed_s + ahead_s };
            let d_m = c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
            if beyond {
                return (d_m, 0.0, 0.0);
            }
            let rate = c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * (4.0 * c[4] + t * 5.0 * c[5])));
            (d_m, rate, 2.0 * c[2] + t * (6.0 * c[3] + t * (12.0 * c[4] + t * 20.0 * c[5])))
        }
    }
}
