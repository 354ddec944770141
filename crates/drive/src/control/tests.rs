//! Both controllers, the guard and the plant in a closed loop.

use std::sync::Arc;

use super::*;
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
    Neighbor {
        id: VehicleId(7),
        ahead_m: gap_m + 4.8,
        d_m: 0.0,
        speed_mps,
        lateral_speed_mps: 0.0,
        accel_mps2: 0.0,
        length_m: 4.8,
        width_m: 1.9,
        lane: LaneIndex(0),
        target_lane: LaneIndex(0),
    }
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
        let contact =
            Contact { adhesion: scene.road.adhesion(), curvature_radpm: scene.road.curvature_radpm(scene.ego.s_m) };
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
        seen.interventions += u32::from(matches!(cause, Some(GuardCause::SafeDistance { .. })));
        seen.worst = seen.worst.max(plan.rung);
    }
    seen
}

#[test]
fn the_decision_is_obeyed_at_small_q1_and_drowned_at_the_printed_ratio() {
    // First accelerations of the optimum at 22 m/s over 2 s, to two digits, from an independent solver of the problem without jerk.
    let params = ideal_car(TireModel::Linear);
    let config = ControlConfig {
        jerk_weight_s2: 1e-6,
        jerk_max_mps3: 100.0,
        accel_max_mps2: 6.0,
        longitudinal_horizon: 20,
        ..ControlConfig::default()
    };
    for (q1, expected) in [(0.25, [5.51, 4.23, 2.96]), (0.025, [2.45, 0.55, -1.35]), (0.0025, [2.05, 0.06, -1.93])] {
        for (reference, expected) in [2.0, 0.0, -2.0].into_iter().zip(expected) {
            let mut mpc = LongitudinalMpc::new(&config, &params, 0.1);
            let plan = mpc.plan(&scene(22.0, 0.85), &Forecast::default(), &keep(reference), q1);
            assert_eq!(plan.rung, Rung::Solved);
            // The jerk within a step makes the mean of two accelerations count where the study has one.
            assert!((plan.accel_mps2 - expected).abs() < 0.15, "q1 {q1} a_ref {reference}: {}", plan.accel_mps2);
        }
    }
}

#[test]
fn it_stops_for_a_standing_car_seen_at_150_m() {
    for (config, guarded) in
        [(ControlConfig { guard: false, ..ControlConfig::default() }, false), (ControlConfig::default(), true)]
    {
        let mut scene = scene(33.0, 0.85);
        scene.neighbors = vec![leader(150.0, 0.0)];
        let seen = follow(&mut scene, 0.0, &config, &keep(0.0));
        assert_eq!(scene.ego.speed_mps, 0.0, "guard {guarded}");
        assert!(seen.smallest_gap_m > 4.0, "guard {guarded}: {} m", seen.smallest_gap_m);
        assert!(seen.final_gap_m < 12.0, "guard {guarded}: {} m", seen.final_gap_m);
        assert_eq!(seen.worst, Rung::Solved);
    }
}

#[test]
fn a_wet_road_is_braked_on_in_time() {
    let mut scene = scene(25.0, 0.4);
    scene.neighbors = vec![leader(150.0, 0.0)];
    let seen = follow(&mut scene, 0.0, &ControlConfig::default(), &keep(0.0));
    assert!(scene.ego.speed_mps == 0.0 && seen.smallest_gap_m > 4.0, "{} m", seen.smallest_gap_m);
    assert_eq!(seen.interventions, 0);
}

#[test]
fn following_settles_at_the_spacing() {
    let mut scene = scene(25.0, 0.85);
    scene.neighbors = vec![leader(60.0, 20.0)];
    let seen = follow(&mut scene, 0.0, &ControlConfig::default(), &keep(2.0));
    // The plan keeps some room for the two seconds in which it would rather accelerate.
    assert!((15.0..16.5).contains(&seen.final_gap_m), "{} m", seen.final_gap_m);
    assert!((scene.ego.speed_mps - 20.0).abs() < 0.01 && scene.ego.accel_mps2.abs() < 0.01);
    assert_eq!((seen.interventions, seen.worst), (0, Rung::Solved));
}

#[test]
fn a_leader_that_brakes_is_never_touched() {
    for (speed, gap, brake) in [(30.0, 25.0, 5.0), (25.0, 20.0, 7.0), (33.0, 30.0, 3.0), (15.0, 13.0, 7.0)] {
        let mut scene = scene(speed, 0.85);
        scene.neighbors = vec![leader(gap, speed)];
        let seen = follow(&mut scene, brake, &ControlConfig::default(), &keep(0.0));
        assert!(seen.smallest_gap_m > 0.9, "{speed} {gap} {brake}: {} m", seen.smallest_gap_m);
        assert_eq!(scene.ego.speed_mps, 0.0);
    }
}

#[test]
fn the_guard_saves_a_car_that_only_accelerates() {
    for adhesion in [0.85, 0.4] {
        for brake in [0.0, 2.0, 5.0, 7.0] {
            let params = VehicleParams::default();
            let guard = Guard::new(&ControlConfig::default(), &params, PERIOD_S);
            let mut scene = scene(20.0, adhesion);
            scene.neighbors = vec![leader(60.0, 22.0)];
            // No car brakes harder than the road allows.
            let brake = ControlConfig::default().braking(adhesion).leader_brake_mps2.min(brake);
            let mut smallest = f64::INFINITY;
            for k in 0..1200 {
                let wanted = ControlInput { accel_mps2: 2.0, steer_rad: 0.0 };
                let (input, _) = guard.check(&scene, [Some(LaneIndex(0)), None], wanted);
                let before_m = scene.ego.s_m;
                drive(&params, &mut scene, &input);
                let travelled_m = scene.ego.s_m - before_m;
                move_leader(&mut scene, if k >= 400 { -brake } else { 0.0 }, travelled_m);
                smallest = smallest.min(scene.neighbors[0].gap_m(4.8));
            }
            assert!(smallest > 0.5, "adhesion {adhesion} brake {brake}: {smallest} m");
        }
    }
}

/// What a lane change of 3.75 m along a quintic came to, 2 s of settling included.
struct LaneChange {
    rms_m: f64,
    overshoot_m: f64,
    sideslip_max_rad: f64,
    slip_use_max: f64,
    steer_max_rad: f64,
    worst: Rung,
}

fn change_lane(
    params: &VehicleParams,
    config: &ControlConfig,
    (speed_mps, adhesion): (f64, f64),
    duration_s: f64,
    path_ratio: f64,
) -> LaneChange {
    let (t, t3) = (duration_s, duration_s * duration_s * duration_s);
    let coefficients = [0.0, 0.0, 0.0, 37.5 / t3, -56.25 / (t3 * t), 22.5 / (t3 * t * t)];
    let mut scene = scene(speed_mps, adhesion);
    let mut mpc = LateralMpc::new(config, params, PERIOD_S);
    let mut seen = LaneChange {
        rms_m: 0.0,
        overshoot_m: 0.0,
        sideslip_max_rad: 0.0,
        slip_use_max: 0.0,
        steer_max_rad: 0.0,
        worst: Rung::Solved,
    };
    let steps = ((duration_s + 2.0) / PERIOD_S).round() as u32;
    for k in 0..steps {
        let elapsed_s = f64::from(k) * PERIOD_S;
        let reference = LateralReference::Path { coefficients: &coefficients, duration_s, elapsed_s };
        let plan = mpc.plan(&scene, reference, &[speed_mps; 11], path_ratio);
        drive(params, &mut scene, &ControlInput { accel_mps2: 0.0, steer_rad: plan.steer_rad });
        let tau = ((elapsed_s + PERIOD_S) / duration_s).min(1.0);
        let d_m = 3.75 * tau * tau * tau * (10.0 - 15.0 * tau + 6.0 * tau * tau);
        let error = scene.ego.d_m - d_m;
        seen.rms_m += error * error / f64::from(steps);
        seen.overshoot_m = seen.overshoot_m.max(scene.ego.d_m - 3.75);
        seen.sideslip_max_rad = seen.sideslip_max_rad.max((scene.ego.lateral_speed_mps / scene.ego.speed_mps).abs());
        seen.slip_use_max = seen.slip_use_max.max(plan.front_slip_use).max(plan.rear_slip_use);
        seen.steer_max_rad = seen.steer_max_rad.max(scene.ego.steer_rad.abs());
        seen.worst = seen.worst.max(plan.rung);
    }
    seen.rms_m = seen.rms_m.sqrt();
    seen
}

#[test]
fn q2_trades_tracking_for_effort_as_in_the_trial_study() {
    // Root mean squares and largest steering of the study: 27.8 m/s, 2.5 s, μ 0.85, Pacejka, no lag, cost on δ only.
    let config = ControlConfig { steer_change_weight: 1e-3, ..ControlConfig::default() };
    let params = ideal_car(TireModel::Pacejka);
    for (q2, rms_m, steer_deg) in [(1e-4, 0.111, 0.82), (1e-3, 0.036, 0.99), (1e-2, 0.003, 1.14)] {
        let seen = change_lane(&params, &config, (27.8, 0.85), 2.5, q2);
        assert_eq!(seen.worst, Rung::Solved);
        // The study shared neither the actuator's rate nor the change's cost.
        let allowed = 0.15 * rms_m + 0.002;
        assert!((seen.rms_m - rms_m).abs() < allowed, "q2 {q2}: rms {} m", seen.rms_m);
        let steer = seen.steer_max_rad.to_degrees();
        assert!((steer / steer_deg - 1.0).abs() < 0.1, "q2 {q2}: {steer} degrees");
    }
}

#[test]
fn stability_bounds_keep_a_wet_lane_change_in_hand() {
    // 3.75 m in 2 s at 33.3 m/s on μ = 0.4. In the trial study the car without bounds spins (sideslip 19° and more); with the
    // untightened ones it keeps 0.31° and uses 1.15 of the slip limits. (Its overshoot of 0.52 m is smaller than the one here.)
    let params = ideal_car(TireModel::Pacejka);
    let tight = ControlConfig::default();
    let full = ControlConfig { stability_tightening: 1.0, yaw_rate_factor: 1.0, ..tight.clone() };
    let off = ControlConfig { stability_constraints: false, ..tight.clone() };
    let change = |config| change_lane(&params, config, (33.3, 0.4), 2.0, 1e-2);
    let (tight, full, off) = (change(&tight), change(&full), change(&off));
    for seen in [&tight, &full] {
        assert_eq!(seen.worst, Rung::Solved);
        assert!(seen.sideslip_max_rad.to_degrees() < 0.4, "{} degrees", seen.sideslip_max_rad.to_degrees());
    }
    assert!(full.overshoot_m < 0.9, "{} m", full.overshoot_m);
    assert!((full.slip_use_max - 1.15).abs() < 0.05, "{}", full.slip_use_max);
    assert!(tight.slip_use_max < 1.0 && tight.overshoot_m < 1.0, "{} {}", tight.slip_use_max, tight.overshoot_m);
    assert!(off.sideslip_max_rad.to_degrees() > 10.0, "{} degrees", off.sideslip_max_rad.to_degrees());
}

#[test]
fn the_default_car_changes_lane_through_its_lags() {
    for speed_mps in [15.0, 22.0, 33.0] {
        let seen = change_lane(&VehicleParams::default(), &ControlConfig::default(), (speed_mps, 0.85), 3.0, 1e-3);
        assert_eq!(seen.worst, Rung::Solved);
        assert!(seen.rms_m < 0.1 && seen.overshoot_m < 0.1, "{speed_mps}: {} {}", seen.rms_m, seen.overshoot_m);
    }
}

#[test]
fn a_bend_is_followed_without_offset() {
    // 1000 m radius: the steady steering and sideslip are references, so that no weight pulls the car off the center.
    let params = ideal_car(TireModel::Linear);
    let bend = crate::road::CurvaturePoint { s_m: 0.0, curvature_radpm: 1e-3 };
    let config = RoadConfig { topology: Topology::Open, curvature: vec![bend], ..RoadConfig::default() };
    let mut scene = scene(30.0, 0.85);
    scene.road = Arc::new(Road::new(config).unwrap());
    let mut mpc = LateralMpc::new(&ControlConfig::default(), &params, PERIOD_S);
    for _ in 0..200 {
        let plan = mpc.plan(&scene, LateralReference::LaneCenter { d_m: 0.0 }, &[30.0], 1e-3);
        drive(&params, &mut scene, &ControlInput { accel_mps2: 0.0, steer_rad: plan.steer_rad });
    }
    // Left: the plant's speed falls slightly in the bend, and d appears in its ṡ.
    assert!(scene.ego.d_m.abs() < 0.01, "{} m", scene.ego.d_m);
    assert!((scene.ego.yaw_rate_radps - 0.03).abs() < 1e-3);
}

#[test]
fn a_car_that_cuts_in_is_given_room_without_hard_braking() {
    // 12 m bumper to bumper at equal speeds of 25 m/s: safe, but 5.5 m less than the spacing.
    let mut scene = scene(25.0, 0.85);
    scene.neighbors = vec![leader(12.0, 25.0)];
    let seen = follow(&mut scene, 0.0, &ControlConfig::default(), &keep(0.0));
    assert!(seen.hardest_mps2 > -3.0, "{} m/s²", seen.hardest_mps2);
    assert!(seen.final_gap_m > 17.0, "{} m", seen.final_gap_m);
    assert_eq!(seen.worst, Rung::Solved);
}

#[test]
fn bad_numbers_go_down_the_ladder_and_recover() {
    let (config, params) = (ControlConfig::default(), VehicleParams::default());
    let mut good = scene(25.0, 0.85);
    good.neighbors = vec![leader(40.0, 24.0)];
    let forecast = constant_speed(&good);
    let mut speed = LongitudinalMpc::new(&config, &params, PERIOD_S);
    let mut steer = LateralMpc::new(&config, &params, PERIOD_S);
    let center = LateralReference::LaneCenter { d_m: 0.3 };
    let fresh = speed.clone().plan(&good, &forecast, &keep(0.0), 0.025);
    assert_eq!(speed.plan(&good, &forecast, &keep(0.0), 0.025), fresh);
    assert_eq!(steer.plan(&good, center, &[25.0], 1e-3).rung, Rung::Solved);

    let mut bad = good.clone();
    bad.neighbors[0].speed_mps = f64::NAN;
    let broken = constant_speed(&bad);
    bad.ego.yaw_rate_radps = f64::NAN;
    let mut rungs = Vec::new();
    for _ in 0..7 {
        let plan = speed.plan(&bad, &broken, &keep(0.0), 0.025);
        let turn = steer.plan(&bad, center, &[f64::NAN], 1e-3);
        assert!((-6.0..=2.0).contains(&plan.accel_mps2) && turn.steer_rad.abs() <= params.max_steer_rad);
        rungs.push((plan.rung, turn.rung));
    }
    assert_eq!(rungs[0], (Rung::ShiftedPlan, Rung::ShiftedPlan));
    assert_eq!(rungs[6].0, Rung::BrakeInLane);
    assert!(rungs[6].1 > Rung::ShiftedPlan);

    bad.ego.speed_mps = f64::NAN;
    let plan = speed.plan(&bad, &broken, &keep(0.0), 0.025);
    assert_eq!((plan.rung, plan.accel_mps2), (Rung::FullBrake, -8.0));
    // A good scene after bad ones gets what a fresh controller answers.
    assert_eq!(speed.plan(&good, &forecast, &keep(0.0), 0.025), fresh);
}

#[test]
fn the_guard_holds_against_any_command_and_any_leader() {
    // The wanted acceleration and the leader's change at random; the leader never exceeds what the guard expects of it.
    let (config, params) = (ControlConfig::default(), VehicleParams::default());
    let guard = Guard::new(&config, &params, PERIOD_S);
    for seed in 0..60 {
        let mut draw = lanecraft_net::random::Stream::new(seed, "control.stress");
        let adhesion = if draw.bernoulli(0.3) { 0.4 } else { 0.85 };
        let hardest = config.braking(adhesion).leader_brake_mps2;
        let mut scene = scene(draw.range(0.0, 40.0), adhesion);
        let leader_speed = draw.range(0.0, 40.0);
        let gap = crate::models::rss::safe_gap_m(scene.ego.speed_mps, 0.0, leader_speed, &config.braking(adhesion));
        scene.neighbors = vec![leader(gap + 1.0, leader_speed)];
        let (mut wanted, mut leader_accel) = (0.0, 0.0);
        for k in 0..800 {
            if k % 10 == 0 {
                wanted = draw.range(-3.0, 4.0);
                let fast = scene.neighbors[0].speed_mps > 40.0;
                leader_accel = if draw.bernoulli(0.3) || fast { -hardest } else { draw.range(-2.0, 4.0) };
            }
            let command = ControlInput { accel_mps2: wanted, steer_rad: 0.0 };
            let (input, _) = guard.check(&scene, [Some(LaneIndex(0)), None], command);
            let before_m = scene.ego.s_m;
            drive(&params, &mut scene, &input);
            let travelled_m = scene.ego.s_m - before_m;
            move_leader(&mut scene, leader_accel, travelled_m);
            let gap_m = scene.neighbors[0].gap_m(4.8);
            // Of the margin of 1 m a little may go: the plant brakes in steps, the law in continuous time.
            assert!(gap_m > 0.9, "seed {seed}, step {k}: {gap_m} m");
        }
    }
}

#[test]
fn a_clone_goes_on_with_the_same_bits() {
    let params = VehicleParams::default();
    let mut speed = LongitudinalMpc::new(&ControlConfig::default(), &params, PERIOD_S);
    let mut steer = LateralMpc::new(&ControlConfig::default(), &params, PERIOD_S);
    let mut scene = scene(28.0, 0.85);
    scene.neighbors = vec![leader(45.0, 22.0)];
    scene.ego.d_m = 0.4;
    let mut copies = None;
    let mut seen = [Vec::new(), Vec::new()];
    for k in 0..60 {
        let forecast = constant_speed(&scene);
        let plan = speed.plan(&scene, &forecast, &keep(2.0), 0.025);
        let turn = steer.plan(&scene, LateralReference::LaneCenter { d_m: 0.0 }, &plan.speeds_mps, 1e-3);
        if let Some((speed, steer)) = &mut copies {
            let (speed, steer): (&mut LongitudinalMpc, &mut LateralMpc) = (speed, steer);
            let again = speed.plan(&scene, &forecast, &keep(2.0), 0.025);
            seen[0].push((plan, turn));
            let turn = steer.plan(&scene, LateralReference::LaneCenter { d_m: 0.0 }, &again.speeds_mps, 1e-3);
            seen[1].push((again, turn));
        }
        if k == 20 {
            copies = Some((speed.clone(), steer.clone()));
        }
        let before_m = scene.ego.s_m;
        drive(&params, &mut scene, &ControlInput { accel_mps2: plan.accel_mps2, steer_rad: turn.steer_rad });
        let travelled_m = scene.ego.s_m - before_m;
        move_leader(&mut scene, 0.0, travelled_m);
    }
    assert_eq!(seen[0], seen[1]);
}

#[test]
fn the_guard_refuses_what_is_not_finite_or_out_of_reach() {
    let params = VehicleParams::default();
    let guard = Guard::new(&ControlConfig::default(), &params, PERIOD_S);
    let scene = scene(25.0, 0.85);
    let lanes = [Some(LaneIndex(0)), None];
    let (input, cause) = guard.check(&scene, lanes, ControlInput { accel_mps2: f64::NAN, steer_rad: 0.01 });
    assert_eq!(cause, Some(GuardCause::NotFinite));
    assert!(input.accel_mps2 < -7.9 && input.steer_rad == 0.01);
    let (input, cause) = guard.check(&scene, lanes, ControlInput { accel_mps2: 1e9, steer_rad: -5.0 });
    assert_eq!(cause, Some(GuardCause::Limits));
    assert!(input.accel_mps2 == 2.0 && input.steer_rad.abs() < 0.1);
    let calm = ControlInput { accel_mps2: 1.0, steer_rad: 0.001 };
    assert_eq!(guard.check(&scene, lanes, calm), (calm, None));
}

#[test]
fn the_guard_sees_behind_the_nearest_leader() {
    let guard = Guard::new(&ControlConfig::default(), &VehicleParams::default(), PERIOD_S);
    let mut scene = scene(30.0, 0.85);
    let wanted = ControlInput { accel_mps2: 0.0, steer_rad: 0.0 };
    // A fast one near, a standing one further on in the lane the ego enters.
    let standing =
        Neighbor { id: VehicleId(9), lane: LaneIndex(1), target_lane: LaneIndex(1), d_m: 3.75, ..leader(60.0, 0.0) };
    scene.neighbors = vec![leader(30.0, 33.0), standing];
    let both = [Some(LaneIndex(0)), Some(LaneIndex(1))];
    let (input, cause) = guard.check(&scene, both, wanted);
    assert_eq!(cause, Some(GuardCause::SafeDistance { id: VehicleId(9), full_brake: true }));
    assert!(input.accel_mps2 < -4.0);
    assert_eq!(guard.check(&scene, [Some(LaneIndex(0)), None], wanted).1, None);
    // Between the lanes it matters whatever lane it claims.
    scene.neighbors[1].d_m = 2.3;
    assert!(guard.check(&scene, [Some(LaneIndex(0)), None], wanted).1.is_some());
}

#[test]
fn a_lane_change_is_given_up_only_while_that_helps() {
    let guard = Guard::new(&ControlConfig::default(), &VehicleParams::default(), PERIOD_S);
    let mut scene = scene(30.0, 0.85);
    scene.ego.d_m = 0.5;
    let beside = |n: Neighbor| Neighbor { lane: LaneIndex(1), target_lane: LaneIndex(1), d_m: 3.75, ..n };
    scene.neighbors = vec![beside(leader(20.0, 10.0))];
    assert!(guard.abort_advised(&scene, LaneIndex(0), LaneIndex(1)));
    scene.ego.d_m = 1.0;
    assert!(!guard.abort_advised(&scene, LaneIndex(0), LaneIndex(1)), "too far over");
    scene.ego.d_m = 0.5;
    scene.neighbors.push(leader(25.0, 10.0));
    assert!(!guard.abort_advised(&scene, LaneIndex(0), LaneIndex(1)), "the old lane is no better");
}

#[test]
fn any_input_gets_an_answer_within_the_limits() {
    let (config, params) = (ControlConfig::default(), VehicleParams::default());
    let mut speed = LongitudinalMpc::new(&config, &params, PERIOD_S);
    let mut steer = LateralMpc::new(&config, &params, PERIOD_S);
    let guard = Guard::new(&config, &params, PERIOD_S);
    let mut draw = lanecraft_net::random::Stream::new(7, "control.fuzz");
    for _ in 0..300 {
        let mut any = |scale: f64| match draw.below(40) {
            0 => f64::NAN,
            1 => f64::INFINITY,
            2 => -1e300,
            _ => (draw.uniform() - 0.5) * 2.0 * scale,
        };
        let mut scene = scene(any(60.0), 0.85);
        scene.ego.d_m = any(10.0);
        scene.ego.heading_rad = any(0.5);
        scene.ego.lateral_speed_mps = any(3.0);
        scene.ego.yaw_rate_radps = any(1.0);
        scene.ego.steer_rad = any(0.2);
        scene.ego.accel_mps2 = any(9.0);
        scene.neighbors = vec![leader(any(120.0), any(40.0))];
        let ratio = libm::exp(any(18.0));
        let forecast = constant_speed(&scene);
        let plan = speed.plan(&scene, &forecast, &keep(any(3.0)), ratio);
        let turn = steer.plan(&scene, LateralReference::LaneCenter { d_m: any(8.0) }, &plan.speeds_mps, ratio);
        assert!((-8.0..=2.0).contains(&plan.accel_mps2), "{plan:?}");
        assert!(plan.speeds_mps.iter().all(|v| v.is_finite()));
        assert!(turn.steer_rad.abs() <= params.max_steer_rad, "{turn:?}");
        let input = ControlInput { accel_mps2: plan.accel_mps2, steer_rad: turn.steer_rad };
        let (input, _) = guard.check(&scene, [Some(LaneIndex(0)), None], input);
        assert!((-8.0..=2.0).contains(&input.accel_mps2) && input.steer_rad.abs() <= params.max_steer_rad);
    }
}
