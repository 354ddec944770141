//! Bad input, snapshots and limits.

use super::*;

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

#[test]
fn the_feedback_laws_alone_keep_lane_and_distance() {
    // Weights that are not numbers: no problem can ever be solved, the scene is good.
    let (config, params) = (ControlConfig::default(), VehicleParams::default());
    let mut speed = LongitudinalMpc::new(&config, &params, PERIOD_S);
    let mut steer = LateralMpc::new(&config, &params, PERIOD_S);
    let guard = Guard::new(&config, &params, PERIOD_S);
    let mut scene = scene(28.0, 0.85);
    scene.ego.d_m = 0.8;
    scene.neighbors = vec![leader(60.0, 22.0)];
    for k in 0..600 {
        let forecast = constant_speed(&scene);
        let plan = speed.plan(&scene, &forecast, &keep(2.0), f64::NAN);
        let turn = steer.plan(&scene, LateralReference::LaneCenter { d_m: 0.0 }, &plan.speeds_mps, f64::NAN);
        assert_eq!((plan.rung, turn.rung), (Rung::FeedbackLaw, Rung::FeedbackLaw));
        let wanted = ControlInput { accel_mps2: plan.accel_mps2, steer_rad: turn.steer_rad };
        let (input, _) = guard.check(&scene, [Some(LaneIndex(0)), None], wanted);
        let before_m = scene.ego.s_m;
        drive(&params, &mut scene, &input);
        let travelled_m = scene.ego.s_m - before_m;
        move_leader(&mut scene, if (300..360).contains(&k) { -5.0 } else { 0.0 }, travelled_m);
        assert!(scene.neighbors[0].gap_m(4.8) > 4.0, "step {k}");
    }
    assert!(scene.ego.d_m.abs() < 0.01, "{} m", scene.ego.d_m);
    assert!((scene.ego.speed_mps - 7.0).abs() < 0.1, "{} m/s", scene.ego.speed_mps);
}
