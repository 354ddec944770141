//! What the ego car makes of a lane that ends: seen by every layer as a standing leader, left by every policy, never entered.

use std::sync::Arc;

use lanecraft_drive::decide::Maneuver;
use lanecraft_drive::driver::Denial;
use lanecraft_drive::env::{Config, Env};
use lanecraft_drive::plan::Refusal;
use lanecraft_drive::road::{LaneIndex, Side};
use lanecraft_drive::scenario::ScenarioFile;

/// Three lanes without end but for these, a slow car far behind, and the ego at 20 m/s in `lane` at 0 m.
fn env(road: &str, lane: u8) -> Env {
    let text = format!(
        "name = \"x\"\ndescription = \"x\"\nego = {{ kind = \"at\", lane = {lane}, s_m = 0.0, speed_mps = 20.0 }}\n\
         [road]\ntopology = \"open\"\n{road}\n\
         [[vehicles]]\nlane = 1\ns_m = -500.0\nspeed_mps = 10.0\ndesired_speed_mps = 10.0\nkind = \"car\"\n"
    );
    let scenario = ScenarioFile::from_toml(&text).expect("valid").scenario(1).expect("built");
    let mut config = Config::default();
    config.env.episode_s = 120.0;
    Env::in_scenario(&Arc::new(config), &scenario).expect("possible")
}

fn open(lane: u8, to_m: f64) -> String {
    format!("lanes_open = [{{ lane = {lane}, from_m = -1000.0, to_m = {to_m} }}]")
}

fn keeps_allowed(env: &Env) -> bool {
    let keep = |index: &usize| matches!(env.actions().decode(*index).map(|d| d.maneuver), Some(Maneuver::Keep { .. }));
    (0..env.actions().len()).filter(keep).any(|action| env.mask().allows(action))
}

#[test]
fn the_end_is_seen_as_a_standing_leader() {
    let env = env(&open(2, 300.0), 2);
    let end = env.scene().leader(LaneIndex(2)).expect("the end is in sight");
    assert!(end.is_lane_end() && end.speed_mps == 0.0);
    // From the front bumper, 2.4 m ahead of the center, to the end.
    assert!((end.gap_m(4.8) - 297.6).abs() < 1e-9);
    assert_eq!(env.scene().lane_end_ahead_m(LaneIndex(2)), 300.0);
    assert_eq!(env.scene().way_out(), Some(Side::Right));
    let out_of_sight = self::env(&open(2, 500.0), 2);
    assert_eq!(out_of_sight.scene().leader(LaneIndex(2)), None);
    assert!(keeps_allowed(&out_of_sight));
}

#[test]
fn a_lane_that_ends_is_left_as_soon_as_there_is_room() {
    let env = env(&open(2, 300.0), 2);
    assert!(env.driver().offer(Side::Right).is_ok());
    assert!(!keeps_allowed(&env), "{:?}", env.mask());
    assert_eq!(*env.driver().offer(Side::Left), Err(Denial::Planner(Refusal::NoLane)));
}

#[test]
fn no_lane_is_entered_that_ends_soon_or_does_not_exist_or_lies_behind_a_solid_line() {
    let offer = |road: &str, side| *env(road, 1).driver().offer(side);
    let denied = |refusal| Err(Denial::Planner(refusal));
    assert_eq!(offer(&open(2, 300.0), Side::Left), denied(Refusal::LaneEnds));
    assert!(offer(&open(2, 500.0), Side::Left).is_ok());
    assert_eq!(offer(&open(0, -10.0), Side::Right), denied(Refusal::NoLane));
    let solid = "solid_lines = [{ right_lane = 0, from_m = -100.0, to_m = 100.0 }]";
    assert_eq!(offer(solid, Side::Right), denied(Refusal::NoLane));
    assert!(offer(solid, Side::Left).is_ok());
    // From a lane that ends there is only the way out.
    let middle_ends =
        "lanes_open = [{ lane = 0, from_m = -1000.0, to_m = 280.0 }, { lane = 1, from_m = -1000.0, to_m = 300.0 }]";
    assert_eq!(offer(middle_ends, Side::Right), denied(Refusal::LaneEnds));
    assert!(offer(middle_ends, Side::Left).is_ok());
}

/// Where nothing is on offer, whoever decides, the controllers slow the car to a crawl, from which it can still change in the end.
#[test]
fn behind_a_solid_line_the_car_slows_to_a_crawl_and_leaves_in_the_end() {
    let solid = "solid_lines = [{ right_lane = 1, from_m = -100.0, to_m = 240.0 }]";
    let mut env = env(&format!("{}\n{solid}", open(2, 300.0)), 2);
    let accelerate = env.actions().plain(Maneuver::Keep { accel_mps2: 2.0 }).expect("an action");
    let mut slowest_mps = f64::INFINITY;
    while env.ego().s_m < 235.0 {
        let _ = env.step(accelerate).expect("keeping is all there is");
        slowest_mps = slowest_mps.min(env.ego().speed_mps);
    }
    // At a crawl from which a change is still possible, as soon as the line allows it.
    assert!((3.0..6.0).contains(&env.ego().speed_mps), "{:?}", env.ego());
    for _ in 0..60 {
        let continue_action = env.actions().continue_action();
        let change = env.actions().plain(Maneuver::Change(Side::Right)).expect("an action");
        let actions = [continue_action, change, accelerate];
        let action = actions.into_iter().find(|&action| env.mask().allows(action)).expect("one of them");
        let _ = env.step(action).expect("allowed");
    }
    assert!(env.ego().s_m > 310.0 && env.scene().ego_lane < LaneIndex(2), "{:?}", env.ego());
    assert_eq!(env.episode().counts.guard.iter().sum::<u32>(), 0);
}

#[test]
fn a_lane_that_does_not_exist_here_is_observed_as_none() {
    let observe = |road: &str| {
        let env = env(road, 1);
        let mut out = vec![0.0_f32; env.config().observation.size()];
        env.observe(&mut out);
        out
    };
    let (all, without) = (observe(""), observe(&open(2, -10.0)));
    assert_eq!(all.len(), without.len());
    // The flags of a lane on the left and of a change into it that is allowed.
    assert_eq!((all[4], all[6]), (1.0, 1.0));
    assert_eq!((without[4], without[6]), (0.0, 0.0));
}
