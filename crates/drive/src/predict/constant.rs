//! Constant speed or constant acceleration along the road; a visible lane change is finished, and a vehicle off its lane's center returns to it.
//!
//! The lateral motion is that of a critically damped spring, (d − c)(t) = (A + B t) e^{−ωt}: smooth from the measured position and
//! speed, without overshoot from rest.

use super::{FORECAST_STEP_S, Forecast, ForecastPoint};
use crate::scene::{Neighbor, Scene};

/// ω of the lateral motion, 1/s: from rest 98 % of a lane change is done after 3 s, the usual duration.
const LATERAL_RATE_PER_S: f64 = 2.0;

pub(super) fn forecast(scene: &Scene, forecast: &mut Forecast) {
    for (index, neighbor) in scene.neighbors.iter().enumerate() {
        let track = forecast.track_mut(index);
        for (step, point) in track.iter_mut().enumerate() {
            point.ahead_m = neighbor.ahead_m + step as f64 * FORECAST_STEP_S * neighbor.speed_mps;
            point.speed_mps = neighbor.speed_mps;
        }
        lateral(scene, neighbor, track);
    }
}

/// The same with constant acceleration, until the vehicle stands.
pub(super) fn forecast_accelerating(scene: &Scene, forecast: &mut Forecast) {
    for (index, neighbor) in scene.neighbors.iter().enumerate() {
        let track = forecast.track_mut(index);
        let (speed_mps, accel_mps2) = (neighbor.speed_mps, neighbor.accel_mps2);
        let stop_s = if accel_mps2 < 0.0 { speed_mps / -accel_mps2 } else { f64::INFINITY };
        for (step, point) in track.iter_mut().enumerate() {
            let time_s = (step as f64 * FORECAST_STEP_S).min(stop_s);
            point.ahead_m = neighbor.ahead_m + time_s * (speed_mps + 0.5 * time_s * accel_mps2);
            point.speed_mps = (speed_mps + time_s * accel_mps2).max(0.0);
        }
        lateral(scene, neighbor, track);
    }
}

/// Fills in the lateral positions of `neighbor`.
pub(super) fn lateral(scene: &Scene, neighbor: &Neighbor, track: &mut [ForecastPoint]) {
    let center_m = scene.road.lane_center_m(neighbor.target_lane);
    let offset_m = neighbor.d_m - center_m;
    let slope_mps = neighbor.lateral_speed_mps + LATERAL_RATE_PER_S * offset_m;
    let decay_per_step = libm::exp(-LATERAL_RATE_PER_S * FORECAST_STEP_S);
    let mut decay = 1.0;
    for (step, point) in track.iter_mut().enumerate() {
        let time_s = step as f64 * FORECAST_STEP_S;
        point.d_m = center_m + (offset_m + slope_mps * time_s) * decay;
        decay *= decay_per_step;
    }
}
