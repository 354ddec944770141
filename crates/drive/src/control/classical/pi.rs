//! Proportional-integral control of the speed, with a constant time gap behind a leader.
//!
//! a = k_p (V_ref − V) + k_i ∫ (V_ref − V) dt, with V_ref the goal's speed or, if smaller, the one that closes on the
//! desired distance s_0 + T V to the leader: V_l + (gap − s_0 − T V) / τ (the constant-time-gap policy of Ioannou and
//! Chien, 1993). The integral stops where the command is at a limit.

use crate::control::{ControlConfig, SpeedGoal};
use crate::scene::Scene;

/// Gains of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PiConfig {
    /// k_p, 1/s.
    pub speed_gain_per_s: f64,
    /// k_i, 1/s².
    pub integral_gain_per_s2: f64,
    /// T, s.
    pub time_gap_s: f64,
    /// τ: time in which a wrong distance is to be made up, s.
    pub spacing_time_s: f64,
}

impl Default for PiConfig {
    fn default() -> Self {
        Self { speed_gain_per_s: 0.8, integral_gain_per_s2: 0.04, time_gap_s: 1.2, spacing_time_s: 3.0 }
    }
}

/// The law with its integral.
#[derive(Clone, Debug)]
pub struct PiSpeed {
    config: PiConfig,
    limits: ControlConfig,
    period_s: f64,
    integral_m: f64,
}

impl PiSpeed {
    /// The law with these gains; limits and the distance at standstill are those of `limits`. `control_period_s`: time
    /// between two commands.
    pub fn new(config: PiConfig, limits: &ControlConfig, control_period_s: f64) -> Self {
        Self { config, limits: limits.clone(), period_s: control_period_s, integral_m: 0.0 }
    }

    /// Acceleration to command, m/s².
    pub fn accel_mps2(&mut self, scene: &Scene, goal: &SpeedGoal) -> f64 {
        let (c, speed_mps) = (&self.config, scene.ego.road_speed_mps());
        let mut wanted_mps = goal.target_speed_mps.min(self.limits.speed_max_mps);
        for leader in goal.lanes.into_iter().flatten().filter_map(|lane| scene.leader(lane)) {
            let spare_m = leader.gap_m(scene.ego_length_m) - self.limits.spacing_min_m - c.time_gap_s * speed_mps;
            wanted_mps = wanted_mps.min(leader.speed_mps + spare_m / c.spacing_time_s);
        }
        let error = wanted_mps.max(0.0) - speed_mps;
        let command = c.speed_gain_per_s * error + c.integral_gain_per_s2 * self.integral_m;
        let limited = command.clamp(self.limits.accel_min_mps2, self.limits.accel_max_mps2);
        if command == limited {
            self.integral_m += error * self.period_s;
        }
        limited
    }
}
