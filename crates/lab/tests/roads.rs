//! The ego car on roads whose lanes begin and end, with speed limits and slippery stretches: whoever decides, it is never at fault,
//! never drives past the end of a lane, keeps the limits and gets through.

use std::sync::Arc;

use lanecraft_drive::env::{Config, Env};
use lanecraft_drive::road::{LaneIndex, Road};
use lanecraft_drive::scenario::ScenarioFile;
use lanecraft_lab::baselines::Rule;

const POLICIES: [&str; 4] = ["best-lane", "idm-mobil", "random", "proposals"];

/// 200 episodes of each kind in the long form.
fn episodes() -> u64 {
    if std::env::var_os("LANECRAFT_LONG").is_some() { 200 } else { 2 }
}

fn scenario_file(name: &str) -> ScenarioFile {
    let path = format!("{}/../../scenarios/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    ScenarioFile::from_toml(&std::fs::read_to_string(path).expect("readable")).expect("valid")
}

fn config(episode_s: f64) -> Arc<Config> {
    let mut config = Config::default();
    config.env.episode_s = episode_s;
    Arc::new(config)
}

/// What an episode must not have, and how many had a lane to leave.
#[derive(Debug, Default)]
struct Tally {
    episodes: u32,
    at_fault: u32,
    /// Ticks in which the car was, in part, where its lane does not exist.
    off_lane: u32,
    over_limit: u32,
    /// Still on the ending lane, or standing, when the episode ends.
    stuck: u32,
    began_on_ending_lane: u32,
}

fn ending_lane(road: &Road) -> Option<LaneIndex> {
    road.config().lanes_open.first().map(|stretch| stretch.lane)
}

fn drive(file: &ScenarioFile, rule: Rule, seed: u64, tally: &mut Tally) {
    // Long enough to pass the bottleneck from any start; rings are driven once around.
    let config = config(if file.road.lanes_open.is_empty() { 40.0 } else { 100.0 });
    let mut env = Env::in_scenario(&config, &file.scenario(seed).expect("fits")).expect("there is room");
    let ending = ending_lane(env.world().road());
    tally.episodes += 1;
    tally.began_on_ending_lane += u32::from(Some(env.scene().ego_lane) == ending);
    while !env.is_over() {
        let action = if env.decision_due() { rule.act(&env, seed) } else { env.actions().continue_action() };
        let _ = env.step(action).expect("rules obey the mask");
        check_place(&env, tally);
    }
    let collision = env.episode().collision;
    tally.at_fault += u32::from(collision.is_some_and(|collision| collision.fault.at_fault()));
    let waits = ending == Some(env.scene().ego_lane) || env.ego().speed_mps < 3.0;
    tally.stuck += u32::from(collision.is_none() && waits);
}

fn check_place(env: &Env, tally: &mut Tally) {
    let (road, ego) = (env.world().road(), env.ego());
    let on_lane = road.lane_holds(road.nearest_lane(ego.d_m), ego.s_m, 0.5 * env.config().vehicle.length_m);
    tally.off_lane += u32::from(!on_lane);
    // An episode begins at the speed of the traffic, which may be leaving a limit; 0.5 m/s: the limits are soft.
    let over_mps = ego.speed_mps - road.speed_limit_mps(ego.s_m);
    tally.over_limit += u32::from(env.episode().ticks > 10 && over_mps > 0.5);
}

#[test]
fn whoever_drives_gets_through() {
    for name in ["merge", "lane-drop", "speed-limit", "wet-patch"] {
        let file = scenario_file(name);
        for policy in POLICIES {
            let mut tally = Tally::default();
            (0..episodes()).for_each(|seed| drive(&file, policy.parse().expect("a rule"), seed, &mut tally));
            println!("{name}, {policy}: {tally:?}");
            let failures = (tally.at_fault, tally.off_lane, tally.over_limit, tally.stuck);
            assert_eq!(failures, (0, 0, 0, 0), "{name}, {policy}: {tally:?}");
        }
    }
}
