//! The steering law of the robot Stanley (Hoffmann, Tomlin, Montemerlo and Thrun, 2007).
//!
//! δ = (φ_ref − φ) + atan(k e / (k_s + V)) + k_γ (γ_ref − γ), with e the distance of the *front axle* to the reference.
//! The published law takes the steady sideslip out of the heading error and damps the yaw rate, as here; the steady
//! steering angle of the reference's curvature replaces its integral and its rate term.

use crate::control::LateralReference;
use crate::scene::Scene;
use crate::vehicle::VehicleParams;

use super::Steady;

/// Gains of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StanleyConfig {
    /// k, 1/s: how fast a small distance dies out at speed.
    pub position_gain_per_s: f64,
    /// k_s, m/s: keeps the law calm at low speed.
    pub softening_mps: f64,
    /// k_γ, s.
    pub yaw_damping_s: f64,
    /// Factor of the heading error: 1 as published; a car with a steering lag of 0.1 s oscillates with it at 33 m/s.
    pub heading_gain: f64,
}

impl Default for StanleyConfig {
    fn default() -> Self {
        Self { position_gain_per_s: 0.8, softening_mps: 1.0, yaw_damping_s: 0.06, heading_gain: 0.4 }
    }
}

/// Speed below which the law is that at this speed, m/s.
const SPEED_MIN_MPS: f64 = 2.0;

/// The law for one car.
#[derive(Clone, Debug)]
pub struct Stanley {
    config: StanleyConfig,
    params: VehicleParams,
}

impl Stanley {
    /// The law with these gains.
    pub fn new(config: StanleyConfig, params: &VehicleParams) -> Self {
        Self { config, params: params.clone() }
    }

    /// Road-wheel angle to command, rad.
    pub fn steer_rad(&self, scene: &Scene, reference: LateralReference<'_>) -> f64 {
        let (config, ego) = (&self.config, &scene.ego);
        let speed_mps = ego.speed_mps.max(SPEED_MIN_MPS);
        let steady = Steady::new(&self.params, scene, reference, speed_mps, 0.0);
        let course_error = ego.heading_rad - steady.heading_rad;
        let front_error_m = ego.d_m - steady.d_m + self.params.front_axle_m * course_error;
        let toward = libm::atan(config.position_gain_per_s * front_error_m / (config.softening_mps + speed_mps));
        let yaw_error = ego.yaw_rate_radps - steady.yaw_rate_radps;
        let feedback = config.heading_gain * course_error + toward + config.yaw_damping_s * yaw_error;
        let most = self.params.max_steer_rad;
        (steady.steer_rad - feedback).clamp(-most, most)
    }
}
