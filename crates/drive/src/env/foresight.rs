//! What the others will truly do, found by letting a copy of the world run ahead.

use crate::predict::{FORECAST_STEP_S, FORECAST_STEPS, Forecast, ForecastPoint, Predictor, control_steps_per_point};
use crate::scene::Scene;
use crate::traffic::{ExternalBody, World};

/// Fills `forecast` with where each neighbor of `scene` will be if `ego` keeps its speed and its place across the road. Who is no vehicle
/// (the end of a lane), or leaves the road, goes on at constant velocity.
pub(super) fn foresee(world: &World, mut ego: ExternalBody, period_s: f64, scene: &Scene, forecast: &mut Forecast) {
    Predictor::ConstantVelocity.forecast(scene, forecast);
    let steps = control_steps_per_point(period_s).expect("a configuration that was validated");
    let (mut world, road) = (world.clone(), world.road());
    (ego.accel_mps2, ego.heading_rad) = (0.0, 0.0);
    let mut positions_m: Vec<Option<f64>> =
        scene.neighbors.iter().map(|neighbor| world.vehicle(neighbor.id).map(|vehicle| vehicle.s_m)).collect();
    for point in 1..=FORECAST_STEPS {
        for _ in 0..steps {
            ego.s_m = road.wrap_m(ego.s_m + ego.speed_mps * period_s);
            let _ = world.step(ego, period_s);
        }
        for (index, (neighbor, last_m)) in scene.neighbors.iter().zip(&mut positions_m).enumerate() {
            let track = forecast.track_mut(index);
            let before = track[point - 1];
            let now = last_m.and_then(|last_m| Some((last_m, world.vehicle(neighbor.id)?)));
            track[point] = match now {
                Some((last_m, vehicle)) => ForecastPoint {
                    ahead_m: before.ahead_m + road.ahead_m(last_m, vehicle.s_m),
                    d_m: vehicle.d_m,
                    speed_mps: vehicle.speed_mps,
                },
                None => ForecastPoint { ahead_m: before.ahead_m + before.speed_mps * FORECAST_STEP_S, ..before },
            };
            *last_m = now.map(|(_, vehicle)| vehicle.s_m);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::{Config, Env};
    use super::*;
    use crate::decide::Maneuver;

    /// The future that was foretold comes true if the ego keeps its speed; held by its controllers, it does so to a few centimeters.
    #[test]
    fn the_future_comes_true() {
        let mut config = Config::default();
        config.prediction.predictor = Predictor::TrueFuture;
        config.traffic.density_veh_per_km_lane = 8.0;
        let mut env = Env::new(&Arc::new(config), 5).unwrap();
        let (foretold, scene) = (env.driver().forecast().clone(), env.scene().clone());
        let hold = env.actions().plain(Maneuver::Keep { accel_mps2: 0.0 }).unwrap();
        for _ in 0..4 {
            let _ = env.step(hold).unwrap();
        }
        let mut plain = Forecast::default();
        Predictor::ConstantVelocity.forecast(&scene, &mut plain);
        let (mut errors_m, mut plain_errors_m) = (Vec::new(), Vec::new());
        for (index, neighbor) in scene.neighbors.iter().enumerate() {
            let Some(then) = env.scene().neighbors.iter().find(|other| other.id == neighbor.id) else { continue };
            let ahead_m = then.ahead_m + env.driven_m();
            errors_m.push((foretold.track(index)[20].ahead_m - ahead_m).abs());
            plain_errors_m.push((plain.track(index)[20].ahead_m - ahead_m).abs());
        }
        let worst = |errors: &[f64]| errors.iter().copied().fold(0.0, f64::max);
        assert!(errors_m.len() > 5);
        assert!(worst(&errors_m) < 0.05 && worst(&plain_errors_m) > 0.2, "{errors_m:?} {plain_errors_m:?}");
    }

    #[test]
    fn a_period_that_does_not_divide_the_forecasts_is_refused() {
        let mut config = Config::default();
        config.prediction.predictor = Predictor::TrueFuture;
        assert!(config.prediction.validate(0.05).is_ok() && config.prediction.validate(0.04).is_err());
    }
}
