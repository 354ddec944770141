//! The seats beside the one that decides: paths and commands handed in.

use std::sync::Arc;

use lanecraft_drive::driver::PathCommand;
use lanecraft_drive::env::{Config, Env, StepError};
use lanecraft_drive::vehicle::ControlInput;
use lanecraft_net::random::Stream;

/// A road with this density of other cars, in vehicles per kilometer and lane.
fn env(density: f64, episode_s: f64, seed: u64) -> Env {
    let mut config = Config::default();
    config.env.episode_s = episode_s;
    config.traffic.density_veh_per_km_lane = density;
    Env::new(&Arc::new(config), seed).expect("the scenario can be built")
}

/// As good as empty: 3 cars on 3 km of lanes.
const LONELY: f64 = 1.0;

fn path(end_d_m: f64, speed_mps: f64) -> PathCommand {
    PathCommand { end_d_m, duration_s: 3.0, speed_mps }
}

#[test]
fn a_path_that_is_handed_in_ends_where_and_as_fast_as_it_says() {
    let mut env = env(LONELY, 20.0, 3);
    let start_m = env.ego().d_m;
    let end_m = if start_m > 3.0 { start_m - 3.75 } else { start_m + 3.75 };
    for _ in 0..7 {
        let _ = env.step_path(&path(end_m, 26.0)).expect("it can be driven");
    }
    // A lane's center to the accuracy that the maneuvers ask of a lane change.
    assert!((env.ego().d_m - end_m).abs() < 0.1, "{}", env.ego().d_m);
    for _ in 0..20 {
        let _ = env.step_path(&path(end_m, 26.0)).expect("it can be driven");
    }
    assert!((env.ego().d_m - end_m).abs() < 0.02, "{}", env.ego().d_m);
    assert!((env.ego().speed_mps - 26.0).abs() < 0.5, "{}", env.ego().speed_mps);
}

#[test]
fn a_path_handed_in_again_goes_on_and_a_short_one_takes_the_time_that_the_car_needs() {
    let mut env = env(LONELY, 20.0, 3);
    let end_m = if env.ego().d_m > 3.0 { env.ego().d_m - 3.75 } else { env.ego().d_m + 3.75 };
    let hasty = PathCommand { duration_s: env.driver().path_bounds().low.duration_s, ..path(end_m, 30.0) };
    let _ = env.step_path(&hasty).expect("it can be driven");
    let (first, _) = env.driver().path().expect("it follows a path");
    let first = *first;
    assert!(first.duration_s > hasty.duration_s, "4 m/s² allow no change within {} s", hasty.duration_s);
    let _ = env.step_path(&PathCommand { speed_mps: 25.0, ..hasty }).expect("it can be driven");
    let (second, elapsed_s) = env.driver().path().expect("it follows a path");
    assert_eq!(*second, first);
    assert!((elapsed_s - 1.0).abs() < 1e-9);
}

#[test]
fn a_command_that_is_handed_in_is_what_the_car_does() {
    let mut env = env(LONELY, 20.0, 3);
    let before = *env.ego();
    for _ in 0..20 {
        let _ = env.step_control(&ControlInput { accel_mps2: -1.0, steer_rad: 0.0 }).expect("it can be driven");
    }
    // One second at −1 m/s² behind a first-order lag, whose area is missing.
    let lag_s = env.config().vehicle.drive_lag_s;
    assert!((env.ego().speed_mps - (before.speed_mps - 1.0 + lag_s)).abs() < 0.1, "{}", env.ego().speed_mps);
    assert_eq!(env.ego().d_m, before.d_m, "it goes straight on");
}

#[test]
fn both_seats_reach_the_same_end_of_an_episode() {
    let (mut ticks, mut commands) = (env(LONELY, 4.0, 3), env(LONELY, 4.0, 3));
    let keep = path(ticks.ego().d_m, 25.0);
    let coast = ControlInput::default();
    let steps = (1..1000).find(|_| ticks.step_path(&keep).expect("it can be driven").truncated);
    assert_eq!(steps, Some(8));
    let steps = (1..1000).find(|_| commands.step_control(&coast).expect("it can be driven").truncated);
    assert_eq!(steps, Some(80));
    assert_eq!(commands.step_control(&coast), Err(StepError::Over));
    assert_eq!(ticks.step_path(&keep), Err(StepError::Over));
}

#[test]
fn ten_control_steps_are_worth_a_tick() {
    let (mut tick, mut steps) = (env(LONELY, 4.0, 3), env(LONELY, 4.0, 3));
    let whole = tick.step_path(&path(tick.ego().d_m, tick.ego().speed_mps)).expect("it can be driven");
    let coast = ControlInput::default();
    let parts: f64 = (0..10).map(|_| steps.step_control(&coast).expect("it can be driven").reward.sum()).sum();
    // Equal but for the path controller's corrections of a few cm/s².
    assert!((whole.reward.sum() - parts).abs() < 0.05 * parts.abs(), "{} against {parts}", whole.reward.sum());
}

#[test]
fn whatever_is_handed_in_nobody_is_run_into() {
    for seed in 0..20 {
        let (mut planned, mut steered) = (env(14.0, 20.0, seed), env(14.0, 20.0, seed));
        let mut stream = Stream::new(seed, "seats");
        while !planned.is_over() {
            let bounds = planned.driver().path_bounds();
            let command = PathCommand {
                end_d_m: planned.driver().reference_d_m(),
                duration_s: stream.range(bounds.low.duration_s, bounds.high.duration_s),
                speed_mps: stream.range(bounds.low.speed_mps, bounds.high.speed_mps),
            };
            let _ = planned.step_path(&command).expect("it is within the bounds");
        }
        while !steered.is_over() {
            let accel_mps2 = stream.range(-1.0, 2.0);
            let _ =
                steered.step_control(&ControlInput { accel_mps2, steer_rad: 0.0 }).expect("it is within the bounds");
        }
        for env in [&planned, &steered] {
            let at_fault = env.episode().collision.is_some_and(|collision| collision.fault.at_fault());
            assert!(!at_fault, "seed {seed}: {:?}", env.episode().collision);
        }
    }
}

#[test]
fn what_is_out_of_range_is_refused_and_changes_nothing() {
    let mut env = env(LONELY, 4.0, 3);
    let digest = env.digest();
    for bad in [f64::NAN, f64::INFINITY, -1e9, 1e9] {
        for command in [
            PathCommand { end_d_m: bad, ..path(0.0, 20.0) },
            PathCommand { duration_s: bad, ..path(0.0, 20.0) },
            PathCommand { speed_mps: bad, ..path(0.0, 20.0) },
        ] {
            assert!(matches!(env.step_path(&command), Err(StepError::OutOfRange(_))));
        }
        for (accel_mps2, steer_rad) in [(bad, 0.0), (0.0, bad)] {
            let refusal = env.step_control(&ControlInput { accel_mps2, steer_rad });
            assert!(matches!(refusal, Err(StepError::OutOfRange(_))));
        }
    }
    assert_eq!(env.digest(), digest);
}

#[test]
fn a_snapshot_on_a_path_that_was_handed_in_goes_on_bit_for_bit() {
    let mut env = env(14.0, 20.0, 4);
    let end_m = if env.ego().d_m > 3.0 { env.ego().d_m - 3.75 } else { env.ego().d_m + 3.75 };
    let _ = env.step_path(&path(end_m, 26.0)).expect("it can be driven");
    let mut restored = Env::restore(&env.snapshot().expect("it can be stored")).expect("it can be restored");
    for _ in 0..10 {
        let _ = env.step_path(&path(end_m, 26.0)).expect("it can be driven");
        let _ = restored.step_path(&path(end_m, 26.0)).expect("it can be driven");
        assert_eq!(env.digest(), restored.digest());
    }
}
