//! The speed behind leaders.

use super::*;

#[test]
fn the_decision_is_obeyed_at_small_q1_and_drowned_at_the_printed_ratio() {
    // First accelerations of the optimum at 22 m/s over 2 s, to two digits, from an independent solver of the problem
    // without jerk.
    let params = ideal_car(TireModel::Linear);
    let config = ControlConfig {
        jerk_weight_s2: 1e-6,
        jerk_max_mps3: 100.0,
        accel_max_mps2: 6.0,
        longitudinal_horizon: 20,
        longitudinal_step_s: 0.1,
        goal_steps: 20,
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
fn a_standing_car_waits_without_a_solve_until_there_is_room() {
    // 1 m behind a leader that drives off: every bound is broken at once, and no plan could mend it.
    let mut scene = scene(0.0, 0.85);
    scene.neighbors = vec![leader(1.0, 0.0)];
    let params = VehicleParams::default();
    let mut mpc = LongitudinalMpc::new(&ControlConfig::default(), &params, PERIOD_S);
    for k in 0..400 {
        let plan = mpc.plan(&scene, &constant_speed(&scene), &keep(2.0), 0.025);
        assert_eq!(plan.rung, Rung::Solved, "step {k}");
        let before_m = scene.ego.s_m;
        drive(&params, &mut scene, &ControlInput { accel_mps2: plan.accel_mps2, steer_rad: 0.0 });
        let travelled_m = scene.ego.s_m - before_m;
        let accel_mps2 = if scene.neighbors[0].speed_mps < 10.0 { 1.5 } else { 0.0 };
        move_leader(&mut scene, accel_mps2, travelled_m);
        assert!(scene.neighbors[0].gap_m(4.8) >= 0.99, "step {k}");
    }
    assert!(scene.ego.speed_mps > 9.0, "{} m/s", scene.ego.speed_mps);
}
