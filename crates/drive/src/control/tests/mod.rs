//! Both controllers, the guard and the plant in a closed loop.

mod disturbance;
mod guard;
mod ladder;
mod lateral;
mod longitudinal;
mod stress;

use std::sync::Arc;

use crate::control::*;
use crate::predict::{FORECAST_STEP_S, FORECAST_STEPS, Forecast, ForecastPoint};
use crate::road::{LaneIndex, Road, RoadConfig, Topology};
use crate::scene::{Neighbor, Scene, VehicleId};
use crate::vehicle::{self, Contact, ControlInput, TireModel, VehicleParams, VehicleState};

const PERIOD_S: f64 = 0.05;

fn scene(speed_mps: f64, adhesion: f64) -> Scene {
    let config = RoadConfig { topology: Topology::Open, adhesion, ..RoadConfig::default() };
    Scene {
        road: Arc::new(Road::new(config).unwrap()),
        ego: VehicleState { speed_mps, ..VehicleState::default() },
        ego_length_m: 4.8,
        ego_width_m: 1.9,
        ego_lane: LaneIndex(0),
        neighbors: Vec::new(),
    }
}

fn leader(gap_m: f64, speed_mps: f64) -> Neighbor {
    Neighbor::car(VehicleId(7), LaneIndex(0), 0.0, gap_m + 4.8, speed_mps)
}

/// Every neighbor keeps its speed.
fn constant_speed(scene: &Scene) -> Forecast {
    let mut forecast = Forecast::default();
    forecast.reset(scene.neighbors.len());
    for (index, n) in scene.neighbors.iter().enumerate() {
        for (k, point) in forecast.track_mut(index).iter_mut().enumerate().take(FORECAST_STEPS + 1) {
            let ahead_m = n.ahead_m + k as f64 * FORECAST_STEP_S * n.speed_mps;
            *point = ForecastPoint { ahead_m, d_m: n.d_m, speed_mps: n.speed_mps };
        }
    }
    forecast
}

fn keep(reference_accel_mps2: f64) -> SpeedGoal {
    SpeedGoal { reference_accel_mps2, target_speed_mps: 33.333, lanes: [Some(LaneIndex(0)), None] }
}

/// The car of the trial study: no lags, the paper's yaw inertia in plant and model.
fn ideal_car(tires: TireModel) -> VehicleParams {
    VehicleParams { tires, ..VehicleParams::preset(vehicle::VehiclePreset::Paper) }
}

fn drive(params: &VehicleParams, scene: &mut Scene, input: &ControlInput) {
    for _ in 0..5 {
        let contact = Contact::at(&scene.road, scene.ego.s_m);
        scene.ego = vehicle::step(params, &scene.ego, input, &contact, 0.01);
    }
}

/// Moves the only neighbor by one control step at this acceleration, relative to an ego that moved by `travelled_m`.
fn move_leader(scene: &mut Scene, accel_mps2: f64, travelled_m: f64) {
    let n = &mut scene.neighbors[0];
    let next = (n.speed_mps + accel_mps2 * PERIOD_S).max(0.0);
    n.ahead_m += 0.5 * (n.speed_mps + next) * PERIOD_S - travelled_m;
    (n.speed_mps, n.accel_mps2) = (next, accel_mps2);
}

/// What a closed loop behind one leader came to.
struct Following {
    smallest_gap_m: f64,
    final_gap_m: f64,
    hardest_mps2: f64,
    interventions: u32,
    worst: Rung,
}

/// 40 s behind a leader that brakes at `brake_mps2` to standstill from 2 s on.
fn follow(scene: &mut Scene, brake_mps2: f64, config: &ControlConfig, goal: &SpeedGoal) -> Following {
    let params = VehicleParams::default();
    let mut mpc = LongitudinalMpc::new(config, &params, PERIOD_S);
    let guard = Guard::new(config, &params, PERIOD_S);
    let mut seen = Following {
        smallest_gap_m: f64::INFINITY,
        final_gap_m: 0.0,
        hardest_mps2: 0.0,
        interventions: 0,
        worst: Rung::Solved,
    };
    for k in 0..800 {
        let forecast = constant_speed(scene);
        let plan = mpc.plan(scene, &forecast, goal, 0.025);
        let wanted = ControlInput { accel_mps2: plan.accel_mps2, steer_rad: 0.0 };
        let (input, cause) = guard.check(scene, goal.lanes, wanted);
        let before_m = scene.ego.s_m;
        drive(&params, scene, &input);
        let travelled_m = scene.ego.s_m - before_m;
        move_leader(scene, if k >= 40 { -brake_mps2 } else { 0.0 }, travelled_m);
        seen.final_gap_m = scene.neighbors[0].gap_m(4.8);
        seen.smallest_gap_m = seen.smallest_gap_m.min(seen.final_gap_m);
        seen.hardest_mps2 = seen.hardest_mps2.min(scene.ego.accel_mps2);
        seen.interventions += u32::from(cause.is_some_and(GuardCause::brakes));
        seen.worst = seen.worst.max(plan.rung);
    }
    seen
}
