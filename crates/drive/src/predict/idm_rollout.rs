//! Every neighbor follows its predecessor by the Intelligent Driver Model with nominal parameters, the ego by constant speed.
//!
//! From front to back, so that each is rolled out against tracks that are already known. Lateral motion as in
//! [`constant`](super::constant). Who leads whom is that of the present moment; a vehicle that changes lanes follows the leaders of
//! both.

use super::{FORECAST_STEP_S, Forecast, ForecastPoint, constant};
use crate::models::idm::{IdmParams, idm_accel};
use crate::scene::{Neighbor, Scene};

/// An average driver: middle of the ranges from which the traffic draws (Treiber et al., 2000; Kesting et al., 2007).
pub(crate) const NOMINAL: IdmParams = IdmParams {
    desired_speed_mps: 23.0,
    time_headway_s: 1.4,
    min_gap_m: 2.0,
    max_accel_mps2: 1.5,
    comfort_decel_mps2: 2.0,
};

/// Hardest braking that is foreseen, m/s²: about what tires give on a dry road.
const MAX_BRAKE_MPS2: f64 = 8.0;

/// A road has at most this many lanes.
const MAX_LANES: usize = 8;

/// Somebody who is followed.
#[derive(Clone, Copy)]
enum Leader {
    Ego,
    Neighbor(usize),
}

pub(super) fn forecast(scene: &Scene, forecast: &mut Forecast) {
    let mut leaders: [Option<Leader>; MAX_LANES] = [None; MAX_LANES];
    let mut ego_passed = false;
    for (index, neighbor) in scene.neighbors.iter().enumerate().rev() {
        if neighbor.ahead_m < 0.0 && !ego_passed {
            leaders[lane_slot(scene.ego_lane.0)] = Some(Leader::Ego);
            ego_passed = true;
        }
        let lanes = [lane_slot(neighbor.lane.0), lane_slot(neighbor.target_lane.0)];
        let followed = lanes.map(|lane| leaders[lane]);
        roll_out(scene, forecast, index, if lanes[0] == lanes[1] { &followed[..1] } else { &followed });
        constant::lateral(scene, neighbor, forecast.track_mut(index));
        for lane in lanes {
            leaders[lane] = Some(Leader::Neighbor(index));
        }
    }
}

fn lane_slot(lane: u8) -> usize {
    usize::from(lane).min(MAX_LANES - 1)
}

/// Positions and speeds of neighbor `index` behind `leaders`, by the ballistic step: the acceleration of the step's begin held for
/// its length, a stop at the moment where the speed reaches zero.
fn roll_out(scene: &Scene, forecast: &mut Forecast, index: usize, leaders: &[Option<Leader>]) {
    let neighbor = &scene.neighbors[index];
    let driver = IdmParams { desired_speed_mps: NOMINAL.desired_speed_mps.max(neighbor.speed_mps), ..NOMINAL };
    let mut point = ForecastPoint { ahead_m: neighbor.ahead_m, d_m: neighbor.d_m, speed_mps: neighbor.speed_mps };
    if neighbor.is_lane_end() {
        forecast.track_mut(index).fill(point);
        return;
    }
    for step in 0..forecast.track(index).len() {
        forecast.track_mut(index)[step] = point;
        let accel_mps2 = leaders
            .iter()
            .map(|&leader| accel_mps2((scene, forecast), (neighbor, point), leader, (step, &driver)))
            .fold(f64::INFINITY, f64::min)
            .max(-MAX_BRAKE_MPS2);
        let speed_mps = point.speed_mps + accel_mps2 * FORECAST_STEP_S;
        point.ahead_m += if speed_mps >= 0.0 {
            0.5 * (point.speed_mps + speed_mps) * FORECAST_STEP_S
        } else {
            -0.5 * point.speed_mps * point.speed_mps / accel_mps2
        };
        point.speed_mps = speed_mps.max(0.0);
    }
}

/// Acceleration of `follower` at `point` behind `leader` at `step`.
fn accel_mps2(
    (scene, forecast): (&Scene, &Forecast),
    (follower, point): (&Neighbor, ForecastPoint),
    leader: Option<Leader>,
    (step, driver): (usize, &IdmParams),
) -> f64 {
    let (ahead_m, speed_mps, length_m) = match leader {
        None => return idm_accel(f64::INFINITY, point.speed_mps, 0.0, driver),
        Some(Leader::Ego) => {
            let speed_mps = scene.ego.road_speed_mps();
            (step as f64 * FORECAST_STEP_S * speed_mps, speed_mps, scene.ego_length_m)
        }
        Some(Leader::Neighbor(index)) => {
            let leader = forecast.track(index)[step];
            (leader.ahead_m, leader.speed_mps, scene.neighbors[index].length_m)
        }
    };
    let gap_m = ahead_m - point.ahead_m - 0.5 * (length_m + follower.length_m);
    idm_accel(gap_m, point.speed_mps, point.speed_mps - speed_mps, driver)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::idm::idm_equilibrium_gap_m;
    use crate::predict::tests::{neighbor, scene};
    use crate::predict::{FORECAST_STEPS, Predictor};
    use crate::road::LaneIndex;

    fn predict(neighbors: Vec<Neighbor>) -> Forecast {
        let mut forecast = Forecast::default();
        Predictor::IdmRollout.forecast(&scene(neighbors), &mut forecast);
        forecast
    }

    #[test]
    fn equilibrium_behind_the_ego_is_kept() {
        // At 20 m/s, below the nominal desired speed, the gap of equilibrium is finite.
        let mut scene = scene(vec![neighbor(0.0, 20.0, 1)]);
        scene.ego.speed_mps = 20.0;
        scene.neighbors[0].ahead_m = -4.8 - idm_equilibrium_gap_m(20.0, &NOMINAL);
        let mut forecast = Forecast::default();
        Predictor::IdmRollout.forecast(&scene, &mut forecast);
        let last = forecast.track(0)[FORECAST_STEPS];
        assert!((last.speed_mps - 20.0).abs() < 1e-9);
        assert!((last.ahead_m - scene.neighbors[0].ahead_m - 100.0).abs() < 1e-9);
    }

    #[test]
    fn without_a_leader_the_speed_rises_to_the_wish_and_no_further() {
        let forecast = predict(vec![neighbor(50.0, 15.0, 0), neighbor(50.0, 30.0, 2)]);
        let speeds: Vec<f64> = forecast.track(0).iter().map(|point| point.speed_mps).collect();
        assert!(speeds.windows(2).all(|pair| pair[1] > pair[0]) && speeds[FORECAST_STEPS] < 23.0);
        assert_eq!(forecast.track(1)[FORECAST_STEPS].speed_mps, 30.0);
    }

    #[test]
    fn a_column_behind_a_standing_car_stops_without_contact() {
        let forecast = predict(vec![neighbor(30.0, 20.0, 0), neighbor(75.0, 20.0, 0), neighbor(120.0, 0.0, 0)]);
        for step in 0..=FORECAST_STEPS {
            let at = |index: usize| forecast.track(index)[step];
            assert!(at(1).ahead_m - at(0).ahead_m > 4.8 && at(2).ahead_m - at(1).ahead_m > 4.8);
            assert!((0..3).all(|index| at(index).speed_mps >= 0.0));
        }
        assert!(forecast.track(0)[FORECAST_STEPS].speed_mps < 15.0);
    }

    #[test]
    fn a_car_between_two_lanes_follows_the_leaders_of_both() {
        let changing = Neighbor { target_lane: LaneIndex(1), ..neighbor(20.0, 25.0, 0) };
        let end_mps = |lane: u8| {
            let forecast = predict(vec![changing, neighbor(50.0, 10.0, lane)]);
            forecast.track(0)[20].speed_mps
        };
        assert_eq!(end_mps(0), end_mps(1));
        assert!(end_mps(2) > end_mps(0) + 3.0);
        // It leads in both lanes as well.
        let behind = |lane: u8| {
            let forecast = predict(vec![neighbor(5.0, 25.0, lane), Neighbor { speed_mps: 15.0, ..changing }]);
            forecast.track(0)[20].speed_mps
        };
        assert_eq!(behind(0), behind(1));
        assert!(behind(2) > behind(0) + 3.0);
    }
}
