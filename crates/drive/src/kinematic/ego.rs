//! The ego car: a kinematic bicycle behind proportional controllers of speed and lateral position.
//!
//! The law is that of highway-env's `MDPVehicle` (Leurent, 2018), here with d and heading positive to the left: a lateral position error
//! asks for a lateral speed, that for a heading, that for a yaw rate, and that for a slip angle β of the bicycle,
//! `ẋ = v cos(ψ + β), ḋ = v sin(ψ + β), ψ̇ = v sin β / (L/2), v̇ = K (v* − v)`, by Euler's explicit rule. Commands are constant in a step.

use serde::{Deserialize, Serialize};

use super::action::MetaAction;
use crate::road::{LaneIndex, Road};

/// Gain of the speed controller, 1/s (highway-env: a time constant of 0.6 s).
const SPEED_GAIN_HZ: f64 = 1.0 / 0.6;
/// Gain from lateral position to lateral speed, 1/s (0.6 s).
const LATERAL_GAIN_HZ: f64 = 1.0 / 0.6;
/// Gain from heading to yaw rate, 1/s (0.2 s).
const HEADING_GAIN_HZ: f64 = 1.0 / 0.2;
/// Distance from the center to either axle, m (half of highway-env's vehicle length of 5 m).
const HALF_BASE_M: f64 = 2.5;
/// Largest heading that the controller asks for, rad.
const MAX_HEADING_RAD: f64 = std::f64::consts::FRAC_PI_4;
/// Smallest speed that is divided by, m/s.
const MIN_SPEED_MPS: f64 = 0.01;

/// The ego car's state and what it is heading for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EgoState {
    /// Position of its center along the road, m; it grows without end, on a ring, too.
    pub s_m: f64,
    /// Position of its center to the left of the reference line, m.
    pub d_m: f64,
    /// Heading relative to the road, rad, positive to the left.
    pub heading_rad: f64,
    /// Speed, m/s.
    pub speed_mps: f64,
    /// Acceleration over the last step, m/s².
    pub accel_mps2: f64,
    /// The lane it keeps or changes into.
    pub target_lane: LaneIndex,
    /// The target speed's place in the list.
    pub speed_index: usize,
}

impl EgoState {
    /// In the middle of `lane`, with the target speed nearest to its speed.
    pub(super) fn new(road: &Road, s_m: f64, lane: LaneIndex, speed_mps: f64, speeds_mps: &[f64]) -> Self {
        let speed_index = nearest(speeds_mps, speed_mps);
        let d_m = road.lane_center_m(lane);
        Self { s_m, d_m, heading_rad: 0.0, speed_mps, accel_mps2: 0.0, target_lane: lane, speed_index }
    }

    /// Sets target lane or target speed; what is not available changes nothing.
    pub(super) fn take(&mut self, action: MetaAction, road: &Road, speeds_mps: &[f64]) {
        let nearest = || nearest(speeds_mps, self.speed_mps);
        match action {
            MetaAction::Idle => {}
            MetaAction::Faster => self.speed_index = (nearest() + 1).min(speeds_mps.len() - 1),
            MetaAction::Slower => self.speed_index = nearest().saturating_sub(1),
            MetaAction::LaneLeft | MetaAction::LaneRight => {
                let beside = action.side().and_then(|side| road.beside(self.target_lane, side));
                self.target_lane = beside.unwrap_or(self.target_lane);
            }
        }
    }

    /// Moves through a step towards the middle of the target lane and `target_mps`.
    pub(super) fn step(&mut self, lane_center_m: f64, target_mps: f64, dt_s: f64) {
        let v = self.speed_mps;
        let divisor_mps = v.max(MIN_SPEED_MPS);
        let lateral_mps = LATERAL_GAIN_HZ * (lane_center_m - self.d_m);
        let wanted_rad = libm::asin((lateral_mps / divisor_mps).clamp(-1.0, 1.0));
        let heading_rad = wanted_rad.clamp(-MAX_HEADING_RAD, MAX_HEADING_RAD);
        let yaw_rate_radps = HEADING_GAIN_HZ * (heading_rad - self.heading_rad);
        // tan β = tan δ / 2 and |δ| ≤ π/3 bound sin β by √(3/7).
        let most = (3.0_f64 / 7.0).sqrt();
        let sin_slip = (HALF_BASE_M / divisor_mps * yaw_rate_radps).clamp(-most, most);
        let (sin, cos) = libm::sincos(self.heading_rad + libm::asin(sin_slip));
        self.accel_mps2 = SPEED_GAIN_HZ * (target_mps - v);
        self.s_m += v * cos * dt_s;
        self.d_m += v * sin * dt_s;
        self.heading_rad += v * sin_slip / HALF_BASE_M * dt_s;
        self.speed_mps += self.accel_mps2 * dt_s;
    }

    /// Speed along the road and to the left, m/s.
    pub fn velocity_mps(&self) -> (f64, f64) {
        let (sin, cos) = libm::sincos(self.heading_rad);
        (self.speed_mps * cos, self.speed_mps * sin)
    }

    pub(super) fn digest_words(&self) -> [u64; 6] {
        [
            self.s_m.to_bits(),
            self.d_m.to_bits(),
            self.heading_rad.to_bits(),
            self.speed_mps.to_bits(),
            self.accel_mps2.to_bits(),
            (self.speed_index as u64) << 8 | u64::from(self.target_lane.0),
        ]
    }
}

/// The place of the value nearest to `speed_mps`, the lower one of two.
fn nearest(speeds_mps: &[f64], speed_mps: f64) -> usize {
    let mut best = 0;
    for (index, speed) in speeds_mps.iter().enumerate() {
        if (speed - speed_mps).abs() < (speeds_mps[best] - speed_mps).abs() {
            best = index;
        }
    }
    best
}
