//! The planner and the fit of a reward.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use lanecraft_drive::env::EnvError;
use lanecraft_drive::plan::Planner;
use lanecraft_drive::predict::{Forecast, Predictor};
use lanecraft_drive::road::{LaneIndex, Road, Side};
use lanecraft_drive::scene::{Neighbor, Scene, VehicleId};
use lanecraft_drive::vehicle::VehicleState;
use lanecraft_learn::irl::{IrlConfig, Problem};

use super::{BenchError, BenchRow, rate};
use crate::candidates::{CandidateConfig, Choices};
use crate::config::RunConfig;
use crate::demonstrations::synthetic::{SyntheticConfig, synthetic};

/// Drivers of the fit.
const DRIVERS: u32 = 5_000;

/// One request with six neighbors, and a fit of [`DRIVERS`] demonstrations; both on one core.
pub(super) fn run(config: &RunConfig, found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
    let environment = &config.environment;
    let planner = Planner::new(&environment.planner, &environment.vehicle).map_err(EnvError::from)?;
    let road = Road::new(environment.road.clone()).map_err(EnvError::from)?;
    let scene = scene(road);
    let mut forecast = Forecast::default();
    Predictor::ConstantVelocity.forecast(&scene, &mut forecast);
    let request = || {
        let window = planner.window(black_box(&scene), &forecast, Side::Left).ok()?;
        Some(planner.choose(&scene, &forecast, &window))
    };
    let window = planner.window(&scene, &forecast, Side::Left);
    let count = window.map_or(0, |window| planner.candidates(&scene, &forecast, &window).len());
    let value = 1e6 / rate(|| u64::from(black_box(request()).is_some()).max(1));
    found(BenchRow { bench: format!("planner/request/{count}-candidates-6-neighbors"), value, unit: "us" });
    fit(found);
    Ok(())
}

/// The ego in the middle lane with room for a change to the left.
fn scene(road: Road) -> Scene {
    let others =
        [(-45.0, 25.0, 1), (-40.0, 26.0, 2), (-30.0, 24.0, 0), (35.0, 23.0, 0), (40.0, 23.0, 1), (60.0, 27.0, 2)];
    let width_m = road.lane_width_m();
    let car = |(index, (ahead_m, speed_mps, lane)): (usize, (f64, f64, u8))| {
        let d_m = width_m * f64::from(lane);
        Neighbor::car(VehicleId(index as u32), LaneIndex(lane), d_m, ahead_m, speed_mps)
    };
    Scene {
        road: Arc::new(road),
        ego: VehicleState { d_m: width_m, speed_mps: 26.0, ..VehicleState::default() },
        ego_length_m: 4.8,
        ego_width_m: 1.9,
        ego_lane: LaneIndex(1),
        neighbors: others.into_iter().enumerate().map(car).collect(),
    }
}

/// The time of one fit of the paper's features and candidates, from the candidates' features to the weights.
fn fit(found: &mut dyn FnMut(BenchRow)) {
    let config = CandidateConfig::paper();
    let choices = Choices::new(&synthetic(&SyntheticConfig::default(), &config, 1, DRIVERS), &config);
    let (sets, labels) = (choices.sets(), choices.labels());
    let irl = IrlConfig::default();
    let begun = Instant::now();
    let fitted = Problem::new(&sets, &labels, &irl).and_then(|problem| problem.fit(&irl));
    let value = begun.elapsed().as_secs_f64();
    if black_box(fitted).is_ok() {
        found(BenchRow { bench: format!("irl/fit/{DRIVERS}x{}", config.durations_s().len()), value, unit: "s" });
    }
}
