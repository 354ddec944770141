//! Disturbance observers: what the controllers' models leave out, estimated so that no offset remains.
//!
//! Constant disturbances are added to the models (Muske and Badgwell, 2002; Maeder, Borrelli and Morari, 2009) and
//! estimated with a constant gain from how far each step ended from its prediction. All states are measured, so the
//! estimates need no filter of the states beside them. Side wind, bank, and tires unlike the linear ones show as a
//! lateral and a yaw acceleration, a grade as an acceleration, an unknown mass as an offset of the drive train.

use serde::{Deserialize, Serialize};

use crate::control::delay::SentCommands;
use crate::vehicle::bicycle::{DiscreteBicycle, lateral_dynamics};
use crate::vehicle::{VehicleParams, lag_response, lagged};

/// Bounds of the estimates: far beyond any wind or bank, for what follows a bad measurement.
const LATERAL_MAX_MPS2: f64 = 3.0;
const YAW_MAX_RADPS2: f64 = 3.0;
const SPEED_MAX_MPS2: f64 = 2.0;
const DRIVE_MAX_MPS2: f64 = 1.5;

fn stepped(estimate: f64, gain: f64, seen: f64, most: f64) -> f64 {
    let next = estimate + gain * (seen - estimate);
    if next.is_finite() { next.clamp(-most, most) } else { 0.0 }
}

/// Constant lateral and yaw acceleration that the linear model lacks.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct LateralObserver {
    gain: f64,
    last: Option<[f64; 5]>,
    /// (m/s², rad/s²).
    estimate: [f64; 2],
}

impl LateralObserver {
    /// Estimates that follow with a time constant of `time_s`.
    pub(crate) fn new(time_s: f64, period_s: f64) -> Self {
        Self { gain: lag_response(time_s, period_s), last: None, estimate: [0.0; 2] }
    }

    /// Lateral (m/s²) and yaw acceleration (rad/s²).
    pub(crate) fn estimate(&self) -> [f64; 2] {
        self.estimate
    }

    /// The next call of [`Self::observe`] is the first of a new series.
    pub(crate) fn interrupt(&mut self) {
        self.last = None;
    }

    /// Takes the state [d, `V_y`, φ, γ, δ] one period after the last one; `model` is that of the speed in between.
    pub(crate) fn observe(&mut self, state: &[f64; 5], model: &DiscreteBicycle) {
        let Some(last) = self.last.replace(*state) else { return };
        let change = state[4] - last[4];
        let missed = |i: usize| {
            let predicted: f64 = model.a[i].iter().zip(&last).map(|(a, x)| a * x).sum();
            state[i] - predicted - model.b[i] * change
        };
        let (lateral, yaw) = solve([model.disturbance[1], model.disturbance[3]], [missed(1), missed(3)]);
        self.estimate = [
            stepped(self.estimate[0], self.gain, lateral, LATERAL_MAX_MPS2),
            stepped(self.estimate[1], self.gain, yaw, YAW_MAX_RADPS2),
        ];
    }

    /// Road-wheel angle, rad, and lateral speed, m/s, at which the disturbance moves the car neither sideways nor about.
    pub(crate) fn steady(&self, params: &VehicleParams, speed_mps: f64) -> (f64, f64) {
        let (a, b) = lateral_dynamics(params, speed_mps);
        let (lateral_speed_mps, steer_rad) =
            solve([[a[0][0], b[0]], [a[1][0], b[1]]], [-self.estimate[0], -self.estimate[1]]);
        (steer_rad, lateral_speed_mps)
    }
}

/// Cramer's rule.
fn solve(m: [[f64; 2]; 2], right: [f64; 2]) -> (f64, f64) {
    let determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    let first = (right[0] * m[1][1] - m[0][1] * right[1]) / determinant;
    (first, (m[0][0] * right[1] - right[0] * m[1][0]) / determinant)
}

/// Constant acceleration of the car beyond that of its tires, and constant offset of the drive train's answer.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct SpeedObserver {
    gain: f64,
    period_s: f64,
    lag_s: f64,
    last: Option<(f64, f64)>,
    accel_mps2: f64,
    drive_mps2: f64,
}

impl SpeedObserver {
    /// Estimates that follow with a time constant of `time_s`.
    pub(crate) fn new(time_s: f64, period_s: f64, lag_s: f64) -> Self {
        let gain = lag_response(time_s, period_s);
        Self { gain, period_s, lag_s, last: None, accel_mps2: 0.0, drive_mps2: 0.0 }
    }

    /// How much faster the car gains speed than its tires push, m/s²: positive downhill.
    pub(crate) fn accel_mps2(&self) -> f64 {
        self.accel_mps2
    }

    /// How much more the drive train gives than is asked of it, m/s².
    pub(crate) fn drive_mps2(&self) -> f64 {
        self.drive_mps2
    }

    /// The next call of [`Self::observe`] is the first of a new series.
    pub(crate) fn interrupt(&mut self) {
        self.last = None;
    }

    /// Takes speed and acceleration one period after the last ones. `limits_mps2`: between these the drive train does
    /// what it is asked; beyond them it cannot, which is no offset.
    pub(crate) fn observe(&mut self, speed: f64, accel: f64, sent: &SentCommands, limits_mps2: (f64, f64)) {
        let Some((last_speed, last_accel)) = self.last.replace((speed, accel)) else { return };
        let (h, response) = (self.period_s, lag_response(self.lag_s, self.period_s));
        // The command that explains the change of the acceleration, and the speed gained under it.
        let command = last_accel + (accel - last_accel) / response;
        let gained = command * h + (last_accel - command) * self.lag_s * response;
        let missed = (speed - last_speed - gained) / h;
        self.accel_mps2 = stepped(self.accel_mps2, self.gain, missed, SPEED_MAX_MPS2);
        let acted = sent.acted();
        if acted.iter().all(|(_, command)| *command > limits_mps2.0 && *command < limits_mps2.1) {
            let answer = |accel, (time_s, command)| lagged(accel, command, self.lag_s, f64::INFINITY, time_s);
            let offset = (accel - acted.into_iter().fold(last_accel, answer)) / response;
            self.drive_mps2 = stepped(self.drive_mps2, self.gain, offset, DRIVE_MAX_MPS2);
        }
    }
}
