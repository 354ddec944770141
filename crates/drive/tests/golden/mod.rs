//! A minute of traffic and a minute of the whole loop, each with the digest of the state in which it must end: on every target, in
//! every build, at any number of threads. The digests change whenever a single bit of what happens does: on purpose only.

use std::sync::Arc;

use lanecraft_drive::env::{Config, Env};
use lanecraft_drive::road::RoadConfig;
use lanecraft_drive::scenario::{ScenarioDistribution, TrafficConfig};
use lanecraft_drive::traffic::{ExternalBody, World};
use lanecraft_net::random::Stream;

pub(crate) const TRAFFIC_DIGEST: u64 = 0xa101_ec2a_2e95_0162;
pub(crate) const CLOSED_LOOP_DIGEST: u64 = 0x7b75_14b6_adbf_5594;

/// Cars and trucks around an ego that drives straight on, some of them braking in full.
pub(crate) fn traffic_digest() -> u64 {
    let traffic = TrafficConfig {
        density_veh_per_km_lane: 16.0,
        truck_share: 0.2,
        stress_brake_rate_hz: 0.05,
        ..TrafficConfig::default()
    };
    let distribution = ScenarioDistribution { road: RoadConfig::default(), traffic };
    let mut world = World::new(&distribution.sample(7).expect("it fits")).expect("it can be built");
    let (s_m, lane, speed_mps) = world.ego_start();
    let mut ego = ExternalBody {
        s_m,
        d_m: world.road().lane_center_m(lane),
        heading_rad: 0.0,
        speed_mps,
        accel_mps2: 0.0,
        length_m: 4.8,
        width_m: 1.9,
        target_lane: lane,
    };
    world.set_ego(ego);
    for _ in 0..1200 {
        ego.s_m += 0.05 * speed_mps;
        let _ = world.step(ego, 0.05);
    }
    world.digest()
}

/// The default preset, driven at random.
pub(crate) fn closed_loop_digest() -> u64 {
    let mut config = Config::default();
    config.env.episode_s = 60.0;
    let mut env = Env::new(&Arc::new(config), 1).expect("the default scenario can be built");
    let mut stream = Stream::new(1, "golden");
    for _ in 0..120 {
        if !env.is_over() {
            let action = random_action(&env, &mut stream);
            let _ = env.step(action).expect("allowed actions are accepted");
        }
    }
    env.digest()
}

/// A random allowed action, *continue* and *abort* included.
pub(crate) fn random_action(env: &Env, stream: &mut Stream) -> usize {
    let allowed: Vec<usize> = (0..32).filter(|&action| env.mask().allows(action)).collect();
    allowed[stream.below(allowed.len())]
}
