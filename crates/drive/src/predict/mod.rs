//! What the other vehicles will do: from a scene to a forecast.

mod config;
mod constant;
mod idm_rollout;
pub mod lstm;

pub(crate) use idm_rollout::NOMINAL;

use serde::{Deserialize, Serialize};

pub(crate) use self::config::control_steps_per_point;
pub use self::config::{Forecaster, ModelSource, PredictionConfig};
use self::lstm::{LstmForecaster, LstmModel};
use crate::scene::Scene;

/// Time between two points of a forecast, s.
pub const FORECAST_STEP_S: f64 = 0.1;
/// Points of a forecast after the present one: 5 s, the longest horizon of the controllers.
pub const FORECAST_STEPS: usize = 50;

/// A predicted instant of one vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ForecastPoint {
    /// Distance along the road from the ego's position *now* to this vehicle's center then, m.
    pub ahead_m: f64,
    /// Lateral position of its center, m.
    pub d_m: f64,
    /// Speed along the road, m/s.
    pub speed_mps: f64,
}

/// Predicted motion of every neighbor of a scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Forecast {
    points: Vec<ForecastPoint>,
}

impl Forecast {
    /// Makes room for `neighbors` vehicles, all points zero; keeps its allocation.
    pub fn reset(&mut self, neighbors: usize) {
        self.points.clear();
        self.points.resize(neighbors * (FORECAST_STEPS + 1), ForecastPoint::default());
    }

    /// The track of neighbor `index` (its index in the scene): `FORECAST_STEPS + 1` points, the first one now.
    pub fn track(&self, index: usize) -> &[ForecastPoint] {
        &self.points[index * (FORECAST_STEPS + 1)..(index + 1) * (FORECAST_STEPS + 1)]
    }

    /// The same track, to be written.
    pub fn track_mut(&mut self, index: usize) -> &mut [ForecastPoint] {
        &mut self.points[index * (FORECAST_STEPS + 1)..(index + 1) * (FORECAST_STEPS + 1)]
    }

    /// Neighbor `index` at `time_s`, between points by linear interpolation, after the last point at constant speed.
    pub fn at(&self, index: usize, time_s: f64) -> ForecastPoint {
        let track = self.track(index);
        let position = (time_s / FORECAST_STEP_S).max(0.0);
        if position >= FORECAST_STEPS as f64 {
            let last = track[FORECAST_STEPS];
            let beyond_s = time_s - FORECAST_STEPS as f64 * FORECAST_STEP_S;
            return ForecastPoint { ahead_m: last.ahead_m + beyond_s * last.speed_mps, ..last };
        }
        let before = position as u32;
        let (a, b) = (track[before as usize], track[before as usize + 1]);
        let share = position - f64::from(before);
        ForecastPoint {
            ahead_m: a.ahead_m + share * (b.ahead_m - a.ahead_m),
            d_m: a.d_m + share * (b.d_m - a.d_m),
            speed_mps: a.speed_mps + share * (b.speed_mps - a.speed_mps),
        }
    }
}

/// How the forecast is made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Predictor {
    /// Constant speed along the road.
    #[default]
    ConstantVelocity,
    /// Constant acceleration along the road, until it stands.
    ConstantAcceleration,
    /// Each follows its predecessor by the Intelligent Driver Model with nominal parameters.
    IdmRollout,
    /// A recurrent network that has learned from tracks how vehicles go on.
    Lstm,
    /// What the simulator will do if the ego car keeps its speed and its place across the road. No car can know it: it tells how much there is
    /// to gain by better forecasts.
    TrueFuture,
}

impl Predictor {
    /// All predictors that a car could have.
    pub const ALL: [Self; 4] = [Self::ConstantVelocity, Self::ConstantAcceleration, Self::IdmRollout, Self::Lstm];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::ConstantVelocity => "constant-velocity",
            Self::ConstantAcceleration => "constant-acceleration",
            Self::IdmRollout => "idm-rollout",
            Self::Lstm => "lstm",
            Self::TrueFuture => "true-future",
        }
    }

    /// Forecasts every neighbor of `scene` from this scene alone into `forecast`, whose room is used again. The recurrent network, with the
    /// weights that are built in, takes every vehicle to have moved as it does now: a [`Forecaster`] remembers. The true future is not in a
    /// scene: who has only that is given constant velocity.
    pub fn forecast(self, scene: &Scene, forecast: &mut Forecast) {
        forecast.reset(scene.neighbors.len());
        match self {
            Self::ConstantVelocity | Self::TrueFuture => constant::forecast(scene, forecast),
            Self::ConstantAcceleration => constant::forecast_accelerating(scene, forecast),
            Self::IdmRollout => idm_rollout::forecast(scene, forecast),
            Self::Lstm => LstmForecaster::new(LstmModel::built_in(), 1).forecast(scene, forecast),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::road::{LaneIndex, Road, RoadConfig};
    use crate::scene::{Neighbor, VehicleId};
    use crate::vehicle::VehicleState;

    pub(crate) fn neighbor(ahead_m: f64, speed_mps: f64, lane: u8) -> Neighbor {
        Neighbor::car(VehicleId(1), LaneIndex(lane), 3.75 * f64::from(lane), ahead_m, speed_mps)
    }

    pub(crate) fn scene(neighbors: Vec<Neighbor>) -> Scene {
        Scene {
            road: Arc::new(Road::new(RoadConfig::default()).unwrap()),
            ego: VehicleState { d_m: 3.75, speed_mps: 25.0, ..VehicleState::default() },
            ego_length_m: 4.8,
            ego_width_m: 1.9,
            ego_lane: LaneIndex(1),
            neighbors,
        }
    }

    #[test]
    fn constant_velocity_is_its_closed_form_at_any_time() {
        let scene = scene(vec![neighbor(-30.0, 22.0, 0), neighbor(40.0, 20.0, 1)]);
        let mut forecast = Forecast::default();
        Predictor::ConstantVelocity.forecast(&scene, &mut forecast);
        for time_s in [0.0, 0.03, 1.25, 4.99, 5.0, 7.5] {
            let point = forecast.at(1, time_s);
            assert!((point.ahead_m - (40.0 + 20.0 * time_s)).abs() < 1e-9);
            assert_eq!((point.d_m, point.speed_mps), (3.75, 20.0));
        }
    }

    #[test]
    fn constant_acceleration_is_its_closed_form_until_the_vehicle_stands() {
        let accelerating = |accel_mps2: f64| Neighbor { accel_mps2, ..neighbor(40.0, 20.0, 1) };
        let mut forecast = Forecast::default();
        Predictor::ConstantAcceleration.forecast(&scene(vec![accelerating(1.0), accelerating(-8.0)]), &mut forecast);
        let (faster, braking) = (forecast.track(0)[30], forecast.track(1));
        assert!((faster.ahead_m - (40.0 + 60.0 + 4.5)).abs() < 1e-9 && (faster.speed_mps - 23.0).abs() < 1e-9);
        // From 20 m/s with 8 m/s²: 25 m in 2.5 s, and not a step back.
        assert!((braking[25].ahead_m - 65.0).abs() < 1e-9 && braking[25].speed_mps.abs() < 1e-9);
        assert_eq!(braking[26], braking[FORECAST_STEPS]);
    }

    #[test]
    fn a_visible_lane_change_is_finished_smoothly() {
        let changing =
            Neighbor { target_lane: LaneIndex(2), lateral_speed_mps: 0.8, d_m: 4.5, ..neighbor(40.0, 20.0, 1) };
        let mut forecast = Forecast::default();
        Predictor::ConstantVelocity.forecast(&scene(vec![changing]), &mut forecast);
        let track = forecast.track(0);
        assert_eq!(track[0].d_m, 4.5);
        // The first step moves at about the measured lateral speed (it changes by at most ω² · 3 m · 0.1 s).
        assert!(((track[1].d_m - track[0].d_m) / FORECAST_STEP_S - 0.8).abs() < 0.6);
        assert!(track.windows(2).all(|pair| pair[1].d_m >= pair[0].d_m - 1e-12));
        assert!((track[FORECAST_STEPS].d_m - 7.5).abs() < 0.01);
    }

    #[test]
    fn a_warm_forecast_keeps_its_room() {
        let scene = scene(vec![neighbor(10.0, 20.0, 1), neighbor(40.0, 20.0, 1)]);
        let mut forecast = Forecast::default();
        Predictor::ConstantVelocity.forecast(&scene, &mut forecast);
        let (first, room) = (forecast.clone(), forecast.points.capacity());
        Predictor::ConstantVelocity.forecast(&scene, &mut forecast);
        assert_eq!((first, room), (forecast.clone(), forecast.points.capacity()));
    }
}
