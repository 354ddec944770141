//! A recurrent network that corrects the forecast of constant speed by what it has learned of how vehicles go on.
//!
//! For each vehicle it is told ten instants, 0.2 s apart (`features`), and says how its acceleration along and its acceleration across the
//! road will differ from the plain forecast's: the values at six times, between which they are linear. Integrated twice they are what is
//! added to the plain forecast, so that speeds and positions fit together and a network that says nothing leaves it as it is. Who would
//! drive backwards stands.

mod features;
mod model;
mod tracks;

use std::sync::Arc;

use lanecraft_net::LstmWorkspace;
use serde::{Deserialize, Serialize};

pub use self::features::{FEATURES, Features};
pub use self::model::{LstmModel, ModelError};
pub use self::tracks::Tracks;
use super::{FORECAST_STEP_S, FORECAST_STEPS, Forecast, ForecastPoint, constant};
use crate::scene::Scene;

/// Instants that the network is told of, the present one included.
pub const FRAMES: usize = 10;
/// Time between two of them, s.
pub const FRAME_PERIOD_S: f64 = 0.2;
/// Times at which the network gives accelerations, in steps of the forecast.
const NODES: [usize; 6] = [0, 5, 10, 20, 35, FORECAST_STEPS];
/// Accelerations along the road at all of these times, then those across it.
pub const OUTPUTS: usize = 2 * NODES.len();

/// The predictor with its memory.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LstmForecaster {
    model: Arc<LstmModel>,
    tracks: Tracks,
    /// What is written and read within one forecast only.
    #[serde(skip)]
    room: Option<Room>,
}

#[derive(Clone, Debug)]
struct Room {
    inputs: Vec<f32>,
    workspace: LstmWorkspace,
}

impl Room {
    fn new(model: &LstmModel, vehicles: usize) -> Self {
        let workspace = LstmWorkspace::new(model.network().shape(), vehicles, FRAMES);
        Self { inputs: Vec::with_capacity(FRAMES * vehicles * FEATURES), workspace }
    }
}

impl LstmForecaster {
    /// A predictor that has seen nothing yet; it will see a scene every `1 / stride` of [`FRAME_PERIOD_S`].
    pub fn new(model: Arc<LstmModel>, stride: usize) -> Self {
        Self { model, tracks: Tracks::new(stride), room: None }
    }

    /// The weights.
    pub fn model(&self) -> &Arc<LstmModel> {
        &self.model
    }

    /// Takes `scene` into the tracks, once for each step.
    pub fn remember(&mut self, scene: &Scene) {
        self.tracks.remember(scene);
    }

    /// Forecasts every neighbor of `scene`, which follows on what was remembered, into `forecast`, which has room for them.
    pub fn forecast(&mut self, scene: &Scene, forecast: &mut Forecast) {
        constant::forecast(scene, forecast);
        let vehicles = scene.neighbors.iter().filter(|neighbor| !neighbor.is_lane_end()).count();
        if vehicles == 0 {
            return;
        }
        let room = match &mut self.room {
            Some(room) if room.workspace.capacity() >= vehicles => room,
            // Twice as many, so that it is not made anew for every vehicle that comes into sight.
            room => room.insert(Room::new(&self.model, 2 * vehicles)),
        };
        self.tracks.inputs(scene, &mut room.inputs);
        let outputs = self.model.network().forward(&room.inputs, FRAMES, &mut room.workspace);
        let moving = scene.neighbors.iter().enumerate().filter(|(_, neighbor)| !neighbor.is_lane_end());
        for ((index, _), said) in moving.zip(outputs.chunks_exact(OUTPUTS)) {
            correct(forecast.track_mut(index), said);
        }
    }
}

/// Adds what the network said to a plain forecast.
fn correct(track: &mut [ForecastPoint], said: &[f32]) {
    let (along, across) = said.split_at(NODES.len());
    let mut stands_at_m = None;
    let corrections = correction(along).zip(correction(across));
    for (point, ((ahead_m, speed_mps), (left_m, _))) in track.iter_mut().zip(corrections) {
        point.ahead_m += ahead_m;
        point.speed_mps += speed_mps;
        point.d_m += left_m;
        if point.speed_mps < 0.0 || stands_at_m.is_some() {
            point.ahead_m = *stands_at_m.get_or_insert(point.ahead_m);
            point.speed_mps = 0.0;
        }
    }
}

/// Displacement in m and speed in m/s at each step of a forecast from rest, by accelerations in m/s² at the nodes; `said` are six values.
///
/// A linear map of them, exact because nodes fall on steps.
pub fn correction(said: &[f32]) -> impl Iterator<Item = (f64, f64)> + '_ {
    let accel_mps2 = |step: usize| {
        let last = NODES.partition_point(|&node| node <= step).clamp(1, NODES.len() - 1);
        let (before, after) = (NODES[last - 1], NODES[last]);
        let share = (step - before) as f64 / (after - before) as f64;
        f64::from(said[last - 1]) * (1.0 - share) + f64::from(said[last]) * share
    };
    let (mut moved_m, mut speed_mps) = (0.0, 0.0);
    (0..=FORECAST_STEPS).map(move |step| {
        let at = (moved_m, speed_mps);
        if step < FORECAST_STEPS {
            let (a, b) = (accel_mps2(step), accel_mps2(step + 1));
            moved_m += FORECAST_STEP_S * (speed_mps + FORECAST_STEP_S * (2.0 * a + b) / 6.0);
            speed_mps += FORECAST_STEP_S * 0.5 * (a + b);
        }
        at
    })
}

#[cfg(test)]
mod tests {
    use lanecraft_net::Lstm;
    use lanecraft_net::random::Stream;

    use super::*;
    use crate::predict::Predictor;
    use crate::predict::tests::{neighbor, scene};
    use crate::road::LaneIndex;
    use crate::scene::{Neighbor, VehicleId};

    fn forecaster(network: Lstm) -> LstmForecaster {
        LstmForecaster::new(Arc::new(LstmModel::new(network).unwrap()), 4)
    }

    fn untrained() -> Lstm {
        Lstm::new(LstmModel::shape(8), &mut Stream::new(1, "init")).unwrap()
    }

    fn busy() -> Scene {
        let changing = Neighbor { target_lane: LaneIndex(2), d_m: 4.5, id: VehicleId(2), ..neighbor(40.0, 20.0, 1) };
        scene(vec![Neighbor { id: VehicleId(3), ..neighbor(-20.0, 25.0, 1) }, changing, neighbor(80.0, 15.0, 2)])
    }

    fn forecast(forecaster: &mut LstmForecaster, scene: &Scene) -> Forecast {
        let mut forecast = Forecast::default();
        forecast.reset(scene.neighbors.len());
        forecaster.forecast(scene, &mut forecast);
        forecast
    }

    #[test]
    fn an_untrained_network_is_constant_velocity_to_the_bit() {
        let (scene, mut plain) = (busy(), Forecast::default());
        Predictor::ConstantVelocity.forecast(&scene, &mut plain);
        let mut forecaster = forecaster(untrained());
        for _ in 0..50 {
            assert_eq!(forecast(&mut forecaster, &scene), plain);
            forecaster.remember(&scene);
        }
    }

    #[test]
    fn what_is_said_is_integrated_twice() {
        // A constant acceleration has a closed form; a ramp from 0 to 1 m/s² over the first 0.5 s is ⅙ t³ / 0.5.
        for (step, (moved_m, speed_mps)) in correction(&[2.0; 6]).enumerate() {
            let time_s = step as f64 * FORECAST_STEP_S;
            assert!((moved_m - time_s * time_s).abs() < 1e-12 && (speed_mps - 2.0 * time_s).abs() < 1e-12);
        }
        let ramp: Vec<(f64, f64)> = correction(&[0.0, 1.0, 0.0, 0.0, 0.0, 0.0]).collect();
        assert!((ramp[5].0 - 0.125 / 3.0).abs() < 1e-12 && (ramp[5].1 - 0.25).abs() < 1e-12);
        assert!((ramp[10].1 - 0.5).abs() < 1e-12 && (ramp[50].1 - 0.5).abs() < 1e-12);
    }

    #[test]
    fn nobody_drives_backwards() {
        let mut braking = untrained();
        let bias = braking.shape().parameter_count() - OUTPUTS;
        braking.parameters_mut()[bias..bias + NODES.len()].fill(-8.0);
        let scene = scene(vec![neighbor(30.0, 16.0, 1)]);
        let track = forecast(&mut forecaster(braking), &scene).track(0).to_vec();
        // Two seconds and 16 m to a stop.
        assert!((track[20].ahead_m - 46.0).abs() < 1e-6 && track[21].speed_mps == 0.0);
        assert!(track.windows(2).all(|pair| pair[1].ahead_m >= pair[0].ahead_m - 0.05 && pair[1].speed_mps >= 0.0));
        assert_eq!(track[FORECAST_STEPS].ahead_m, track[22].ahead_m);
    }

    #[test]
    fn a_vehicle_is_forecast_the_same_whoever_else_is_in_sight_far_away() {
        let mut trained = untrained();
        let mut stream = Stream::new(2, "trained");
        trained.parameters_mut().iter_mut().for_each(|parameter| *parameter += 0.2 * stream.normal() as f32);
        let (all, mut one) = (busy(), busy());
        one.neighbors.truncate(2);
        let both = [all, one].map(|scene| forecast(&mut forecaster(trained.clone()), &scene).track(0).to_vec());
        // It follows the ego, and the ego the second one; the third is further away than it is told of.
        assert_eq!(both[0], both[1]);
    }

    #[test]
    fn a_lane_end_stays_where_it_is() {
        let mut scene = busy();
        let end = Neighbor::lane_end(&scene.road, LaneIndex(0), 90.0);
        scene.neighbors.push(end);
        let mut talking = untrained();
        talking.parameters_mut().fill(0.3);
        let said = forecast(&mut forecaster(talking), &scene);
        assert!(said.track(3).iter().all(|point| point.ahead_m == end.ahead_m && point.speed_mps == 0.0));
        assert!(said.track(2)[50].ahead_m > 80.0 + 5.0 * 15.0);
    }
}
