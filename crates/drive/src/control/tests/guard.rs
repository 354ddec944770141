//! The guard alone, and against any command.

use super::*;

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
fn the_guard_refuses_what_is_not_finite_or_out_of_reach() {
    let params = VehicleParams::default();
    let guard = Guard::new(&ControlConfig::default(), &params, PERIOD_S);
    let scene = scene(25.0, 0.85);
    let lanes = [Some(LaneIndex(0)), None];
    let (input, cause) = guard.check(&scene, lanes, ControlInput { accel_mps2: f64::NAN, steer_rad: 0.01 });
    assert_eq!(cause, Some(GuardCause::NotFinite));
    assert!(input.accel_mps2 < -7.9 && input.steer_rad == 0.01);
    let (input, cause) = guard.check(&scene, lanes, ControlInput { accel_mps2: 1e9, steer_rad: -5.0 });
    assert_eq!(cause, Some(GuardCause::AccelLimit));
    assert!(input.accel_mps2 == 2.0 && input.steer_rad.abs() < 0.1);
    let (_, cause) = guard.check(&scene, lanes, ControlInput { accel_mps2: 0.0, steer_rad: -5.0 });
    assert_eq!(cause, Some(GuardCause::SteerLimit));
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
    assert_eq!(cause, Some(GuardCause::OtherLane));
    assert!(input.accel_mps2 < -4.0);
    assert_eq!(guard.check(&scene, [Some(LaneIndex(0)), None], wanted).1, None);
    // Between the lanes it matters whatever lane it claims.
    scene.neighbors[1].d_m = 2.3;
    assert_eq!(guard.check(&scene, [Some(LaneIndex(0)), None], wanted).1, Some(GuardCause::Beside));
    scene.neighbors[1].target_lane = LaneIndex(0);
    assert_eq!(guard.check(&scene, [Some(LaneIndex(0)), None], wanted).1, Some(GuardCause::OwnLane));
}

#[test]
fn a_leader_that_brakes_harder_than_expected_is_believed() {
    // 120 km/h, 1.7 s behind: room enough to stop behind any of them, but not for who goes on expecting 7 m/s².
    let (config, params) = (ControlConfig::default(), VehicleParams::default());
    let guard = Guard::new(&config, &params, PERIOD_S);
    for brake in [7.0, 8.0, 12.0] {
        let mut scene = scene(33.0, 0.85);
        scene.neighbors = vec![leader(56.0, 33.0)];
        let mut smallest = f64::INFINITY;
        for _ in 0..400 {
            let (input, _) = guard.check(&scene, [Some(LaneIndex(0)), None], ControlInput::default());
            let before_m = scene.ego.s_m;
            drive(&params, &mut scene, &input);
            let travelled_m = scene.ego.s_m - before_m;
            move_leader(&mut scene, -brake, travelled_m);
            smallest = smallest.min(scene.neighbors[0].gap_m(4.8));
        }
        assert!(smallest > 0.9, "{brake} m/s²: {smallest} m");
    }
}

#[test]
fn a_lane_change_is_given_up_only_while_that_helps() {
    let guard = Guard::new(&ControlConfig::default(), &VehicleParams::default(), PERIOD_S);
    let mut scene = scene(30.0, 0.85);
    scene.ego.d_m = 0.5;
    let beside = |n: Neighbor| Neighbor { lane: LaneIndex(1), target_lane: LaneIndex(1), d_m: 3.75, ..n };
    scene.neighbors = vec![beside(leader(20.0, 10.0))];
    assert_eq!(guard.abort_advised(&scene, LaneIndex(0), LaneIndex(1)), Some(GuardCause::AbortLeader));
    let off = Guard::new(&ControlConfig { guard: false, ..Default::default() }, &VehicleParams::default(), PERIOD_S);
    assert_eq!(off.abort_advised(&scene, LaneIndex(0), LaneIndex(1)), None, "it is switched off");
    scene.neighbors = vec![beside(leader(-20.0, 40.0))];
    assert_eq!(guard.abort_advised(&scene, LaneIndex(0), LaneIndex(1)), Some(GuardCause::AbortFollower));
    scene.neighbors = vec![beside(leader(20.0, 10.0))];
    scene.neighbors.push(leader(25.0, 10.0));
    assert_eq!(guard.abort_advised(&scene, LaneIndex(0), LaneIndex(1)), None, "the old lane is no better");
}
