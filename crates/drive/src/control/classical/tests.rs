//! Laws of the classical controllers, and that they drive.

use std::sync::Arc;

use super::lqr::riccati;
use super::*;
use crate::control::ControlConfig;
use crate::road::{CurvaturePoint, LaneIndex, Road, RoadConfig, Topology};
use crate::scene::{Neighbor, VehicleId};
use crate::vehicle::bicycle::DiscreteBicycle;
use crate::vehicle::{self, Contact, ControlInput, VehicleState};

const PERIOD_S: f64 = 0.05;

fn scene(speed_mps: f64, curvature_radpm: f64) -> Scene {
    let curvature = vec![CurvaturePoint { s_m: 0.0, curvature_radpm }];
    let config = RoadConfig { topology: Topology::Open, curvature, ..RoadConfig::default() };
    Scene {
        road: Arc::new(Road::new(config).unwrap()),
        ego: VehicleState { speed_mps, ..VehicleState::default() },
        ego_length_m: 4.8,
        ego_width_m: 1.9,
        ego_lane: LaneIndex(0),
        neighbors: Vec::new(),
    }
}

fn step(params: &VehicleParams, scene: &mut Scene, input: &ControlInput) {
    for _ in 0..5 {
        let contact = Contact::at(&scene.road, scene.ego.s_m);
        scene.ego = vehicle::step(params, &scene.ego, input, &contact, 0.01);
    }
}

#[test]
fn the_riccati_gain_is_optimal() {
    const START: [f64; 5] = [0.5, 0.1, 0.01, 0.02, 0.001];
    // No other linear feedback costs less: perturbing any gain raises the cost of a long roll-out.
    let model = DiscreteBicycle::new(&VehicleParams::default(), 25.0, PERIOD_S);
    let (weights, input_weight) = ([10.0, 0.0, 1.0, 0.0, 1e3], 1e3);
    let cost = |gain: &[f64; 5]| {
        let mut x: [f64; 5] = START;
        let mut sum = 0.0;
        for _ in 0..2000 {
            let u: f64 = -gain.iter().zip(&x).map(|(k, x)| k * x).sum::<f64>();
            sum += input_weight * u * u + weights.iter().zip(&x).map(|(w, x)| w * x * x).sum::<f64>();
            let mut next = [0.0; 5];
            for (i, value) in next.iter_mut().enumerate() {
                *value = model.b[i] * u + (0..5).map(|j| model.a[i][j] * x[j]).sum::<f64>();
            }
            x = next;
        }
        sum
    };
    let (to_go, gain) = riccati(&model, &weights, input_weight);
    let best = cost(&gain);
    let promised: f64 = (0..5).map(|i| (0..5).map(|j| START[i] * to_go[i][j] * START[j]).sum::<f64>()).sum();
    assert!((best / promised - 1.0).abs() < 1e-9, "{best}, but the cost-to-go is {promised}");
    for i in 0..5 {
        for factor in [0.95, 1.05] {
            let mut other = gain;
            other[i] *= factor;
            assert!(cost(&other) > best, "gain {i} times {factor}");
        }
    }
}

#[test]
fn both_laws_settle_in_the_lane_at_all_speeds() {
    let params = VehicleParams::default();
    for speed_mps in [8.0, 15.0, 25.0, 33.0] {
        let laws = [
            LateralController::Lqr(Box::new(Lqr::new(&params, PERIOD_S, 1e-3, 1.0))),
            LateralController::Stanley(Box::new(Stanley::new(StanleyConfig::default(), &params))),
        ];
        for mut law in laws {
            // A bend of 1000 m: feed-forward leaves no offset but the small one of the plant's tires and of its falling speed.
            let mut scene = scene(speed_mps, 1e-3);
            scene.ego.d_m = 0.5;
            for _ in 0..400 {
                let command = law.steer(&scene, LateralReference::LaneCenter { d_m: 0.0 }, &[speed_mps], 1e-3);
                step(&params, &mut scene, &ControlInput { accel_mps2: 0.0, steer_rad: command.steer_rad });
            }
            assert!(scene.ego.d_m.abs() < 0.05, "{speed_mps} m/s: {} m, {law:?}", scene.ego.d_m);
        }
    }
}

#[test]
fn pi_control_holds_speed_and_time_gap() {
    let (params, config) = (VehicleParams::default(), ControlConfig::default());
    let goal = SpeedGoal { reference_accel_mps2: 0.0, target_speed_mps: 28.0, lanes: [Some(LaneIndex(0)), None] };
    for (leader_mps, expected_mps) in [(40.0, 28.0), (20.0, 20.0)] {
        let mut law = SpeedController::Pi(Box::new(PiSpeed::new(PiConfig::default(), &config, PERIOD_S)));
        let mut scene = scene(22.0, 0.0);
        let mut leader_s_m = 60.0;
        for _ in 0..1600 {
            leader_s_m += leader_mps * PERIOD_S;
            scene.neighbors =
                vec![Neighbor::car(VehicleId(1), LaneIndex(0), 0.0, leader_s_m - scene.ego.s_m, leader_mps)];
            let command = law.drive(&scene, &Forecast::default(), &goal, 0.0);
            step(&params, &mut scene, &ControlInput { accel_mps2: command.accel_mps2, steer_rad: 0.0 });
        }
        assert!((scene.ego.speed_mps - expected_mps).abs() < 0.1, "{} m/s", scene.ego.speed_mps);
        if leader_mps < 28.0 {
            let gap_m = scene.neighbors[0].gap_m(4.8);
            assert!((gap_m - 29.0).abs() < 1.0, "{gap_m} m, not 5 m + 1.2 s");
        }
    }
}
