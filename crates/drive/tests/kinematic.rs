//! The fast environment: its laws, its ends, its bits, and highway-env's own ego as a second source.

use std::sync::Arc;

use lanecraft_drive::kinematic::{
    EgoState, Feature, KinematicConfig, KinematicEnv, KinematicsConfig, MetaAction, Outcome, StepError,
};
use lanecraft_drive::road::{LaneIndex, Topology};
use lanecraft_drive::snapshot::{Snapshot, SnapshotError};
use lanecraft_drive::traffic::World;
use lanecraft_net::random::Stream;

const IDLE: usize = MetaAction::Idle as usize;
const LEFT: usize = MetaAction::LaneLeft as usize;
const RIGHT: usize = MetaAction::LaneRight as usize;
const FASTER: usize = MetaAction::Faster as usize;
const SLOWER: usize = MetaAction::Slower as usize;

fn env(change: impl Fn(&mut KinematicConfig), seed: u64) -> KinematicEnv {
    let mut config = KinematicConfig::default();
    change(&mut config);
    KinematicEnv::new(&Arc::new(config), seed).expect("a valid configuration")
}

/// One other vehicle, on a road without end: after a short while it is far from who drives slower or faster.
fn nearly_alone(config: &mut KinematicConfig) {
    (config.road.topology, config.task.vehicles) = (Topology::Ring, 1);
    config.traffic.density_veh_per_km_lane = 0.01;
    config.task.duration_s = 1000.0;
}

fn observation(env: &KinematicEnv) -> Vec<f32> {
    let mut out = vec![f32::NAN; env.config().task.observation.size()];
    env.observe(&mut out);
    out
}

/// A random action that depends on nothing but seed and step.
fn random_action(env: &KinematicEnv, seed: u64) -> usize {
    Stream::keyed(seed, "kinematic.test", u64::from(env.steps()), 0).below(MetaAction::ALL.len())
}

fn random_episode(env: &mut KinematicEnv, seed: u64) -> Vec<(u64, Outcome, Vec<f32>)> {
    let mut seen = Vec::new();
    while !env.is_over() {
        let outcome = env.step(random_action(env, seed)).expect("not over");
        seen.push((env.digest(), outcome, observation(env)));
    }
    seen
}

#[test]
fn there_are_exactly_as_many_vehicles_as_wanted_wherever_the_road() {
    for topology in [Topology::Ring, Topology::Open] {
        for (lanes, vehicles) in [(3, 20), (4, 50), (1, 7), (2, 4)] {
            let env = env(
                |config| {
                    (config.road.topology, config.road.lanes, config.task.vehicles) = (topology, lanes, vehicles);
                },
                5,
            );
            assert_eq!(env.world().len(), vehicles as usize);
        }
    }
}

#[test]
fn every_seed_finds_room_for_the_ego() {
    let config = Arc::new(KinematicConfig::default());
    for seed in 0..2000 {
        assert!(KinematicEnv::new(&config, seed).is_ok(), "seed {seed}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_one_others() {
    for seed in 0..20 {
        let (mut one, mut two) = (env(|_| (), seed), env(|_| (), seed));
        assert_eq!(random_episode(&mut one, seed), random_episode(&mut two, seed));
        assert_ne!(one.digest(), env(|_| (), seed + 1).digest());
    }
}

#[test]
fn rewards_stay_in_their_range_and_collisions_earn_the_least() {
    let mut collisions = 0;
    for seed in 0..100 {
        for (_, outcome, seen) in random_episode(&mut env(|_| (), seed), seed) {
            assert!((0.0..=1.0).contains(&outcome.reward), "reward {}", outcome.reward);
            assert!(seen.iter().all(|value| (-1.0..=1.0).contains(value)));
            // 0 at worst and then what speed and lane still earn, a third of the range.
            assert!(outcome.terminated == (outcome.reward <= 0.5 / 1.5), "{outcome:?}");
            collisions += u32::from(outcome.terminated);
        }
    }
    assert!(collisions > 10, "random driving collides, so that the test sees both");
}

#[test]
fn the_reward_is_the_sum_of_its_terms() {
    // Fast in the rightmost of three lanes: 0.4 + 0.1; normalized the most there is.
    let drive = |normalize| {
        let mut env = env(
            |config| {
                nearly_alone(config);
                config.task.normalize_reward = normalize;
                config.task.lane_change_reward = -0.05;
            },
            1,
        );
        while env.ego().target_lane != LaneIndex(0) {
            let _ = env.step(RIGHT).expect("not over");
        }
        (0..10).for_each(|_| {
            let _ = env.step(FASTER).expect("not over");
        });
        let fast = env.step(IDLE).expect("not over").reward;
        (fast, env.step(LEFT).expect("not over").reward)
    };
    let (plain, normalized) = (drive(false), drive(true));
    // The speed comes within a thousandth of its target in ten seconds.
    assert!((plain.0 - 0.5).abs() < 1e-3 && (normalized.0 - 1.0).abs() < 1e-3, "{plain:?} {normalized:?}");
    // The middle lane earns half, the change costs, and driving askew takes a little speed along the road.
    assert!((plain.1 - 0.4).abs() < 5e-3 && (normalized.1 - 1.4 / 1.5).abs() < 5e-3, "{plain:?} {normalized:?}");
}

#[test]
fn the_mask_has_what_changes_something() {
    let mut env = env(nearly_alone, 2);
    while env.ego().target_lane != LaneIndex(2) {
        let _ = env.step(LEFT).expect("not over");
    }
    for _ in 0..12 {
        let _ = env.step(FASTER).expect("not over");
    }
    let allowed = |env: &KinematicEnv| (0..8).filter(|&action| env.mask().allows(action)).collect::<Vec<_>>();
    assert_eq!(allowed(&env), [IDLE, RIGHT, SLOWER]);
    let before = *env.ego();
    let _ = env.step(LEFT).expect("masked actions do nothing");
    assert_eq!((env.ego().target_lane, env.ego().speed_index), (before.target_lane, before.speed_index));
    let _ = env.step(RIGHT).expect("not over");
    assert_eq!(allowed(&env), [LEFT, IDLE, RIGHT, SLOWER]);
    for _ in 0..12 {
        let _ = env.step(SLOWER).expect("not over");
    }
    let _ = env.step(RIGHT).expect("not over");
    assert_eq!(allowed(&env), [LEFT, IDLE, FASTER]);
}

#[test]
fn episodes_end_by_collision_or_at_their_length_and_then_refuse_to_go_on() {
    let mut ends = [0, 0];
    for seed in 0..40 {
        let mut env = env(|_| (), seed);
        let seen = random_episode(&mut env, seed);
        let (last, before) = seen.split_last().expect("at least one step");
        assert!(before.iter().all(|(_, outcome, _)| !outcome.terminated && !outcome.truncated));
        assert!(last.1.terminated || last.1.truncated);
        assert_eq!(last.1.truncated, env.steps() == 30);
        assert!(last.1.terminated || (env.time_s() - 30.0).abs() < 1e-9);
        ends[usize::from(last.1.terminated)] += 1;
        assert_eq!(env.step(IDLE), Err(StepError::Over));
    }
    assert!(ends.iter().all(|&count| count > 0), "{ends:?}");
    assert_eq!(env(|_| (), 0).step(5), Err(StepError::NoSuchAction { action: 5 }));
}

#[test]
fn speeds_are_reached_and_lane_changes_completed_without_leaving_the_road() {
    for seed in 0..10 {
        let mut env = env(nearly_alone, seed);
        let (right_m, left_m) = env.world().road().edges_m();
        for (action, speed_mps) in [(FASTER, 30.0), (SLOWER, 20.0)] {
            for _ in 0..10 {
                let _ = env.step(action).expect("not over");
            }
            // Ten seconds are sixteen time constants of 0.6 s, the last steps of the way ones of 5 m/s.
            assert!((env.ego().speed_mps - speed_mps).abs() < 1e-3, "{:?}", env.ego());
        }
        for lane_change in [LEFT, LEFT, RIGHT, RIGHT, LEFT] {
            let _ = env.step(lane_change).expect("not over");
            let target_m = env.world().road().lane_center_m(env.ego().target_lane);
            for _ in 0..6 {
                let _ = env.step(IDLE).expect("not over");
                assert!((right_m..=left_m).contains(&env.ego().d_m));
            }
            assert!((env.ego().d_m - target_m).abs() < 0.01, "{:?}", env.ego());
        }
    }
}

#[test]
fn the_ego_moves_as_that_of_highway_env() {
    let rows = include_str!("data/highway_env_ego.csv").lines().skip(1).map(|line| {
        let mut values = line.split(',').map(|value| value.parse::<f64>().expect("a number"));
        std::array::from_fn::<f64, 5, _>(|_| values.next().expect("five columns"))
    });
    let rows: Vec<_> = rows.collect();
    let mut env = env(
        |config| {
            nearly_alone(config);
            config.task.steps_per_decision = 1;
        },
        3,
    );
    // To where that one starts: the middle lane at 25 m/s, straight and steady.
    let steer = if env.ego().target_lane == LaneIndex(0) { LEFT } else { RIGHT };
    if env.ego().target_lane != LaneIndex(1) {
        let _ = env.step(steer).expect("not over");
    }
    while env.ego().speed_index != 1 {
        let _ = env.step(if env.ego().speed_index < 1 { FASTER } else { SLOWER }).expect("not over");
    }
    for _ in 0..500 {
        let _ = env.step(IDLE).expect("not over");
    }
    let start_m = env.ego().s_m;
    for (step, [action, x_m, y_m, heading_rad, speed_mps]) in rows.into_iter().enumerate() {
        let action = if step % 5 == 0 { action as usize } else { IDLE };
        let _ = env.step(action).expect("not over");
        let EgoState { s_m, d_m, heading_rad: own_rad, speed_mps: own_mps, .. } = *env.ego();
        let differences = [s_m - start_m - x_m, 8.0 - d_m - y_m, -own_rad - heading_rad, own_mps - speed_mps];
        // Positions of some thousand meters in f64, fed back through sixty steps of a contracting law.
        assert!(differences.iter().all(|difference| difference.abs() < 1e-8), "step {step}: {differences:?}");
    }
}

#[test]
fn who_keeps_its_lane_no_faster_than_the_traffic_is_hit_by_nobody() {
    for seed in 0..100 {
        let slow = |config: &mut KinematicConfig| config.task.target_speeds_mps = vec![15.0];
        let mut env = env(slow, seed);
        while !env.is_over() {
            let outcome = env.step(IDLE).expect("not over");
            assert!(!outcome.terminated, "seed {seed}, {} s", env.time_s());
        }
    }
}

#[test]
fn the_observation_is_that_of_a_hand_calculation() {
    let all = vec![
        Feature::Presence,
        Feature::X,
        Feature::Y,
        Feature::Vx,
        Feature::Vy,
        Feature::Heading,
        Feature::CosH,
        Feature::SinH,
    ];
    for (absolute, normalize, see_behind) in [(false, false, true), (true, false, false), (false, true, false)] {
        let observation_config =
            KinematicsConfig { observed_vehicles: 9, features: all.clone(), absolute, normalize, see_behind };
        let mut env = env(|config| config.task.observation = observation_config.clone(), 11);
        for action in [LEFT, FASTER, RIGHT] {
            let _ = env.step(action).expect("not over");
            check_rows(&env, &expected_rows(&env));
        }
    }
}

/// The rows from the vehicles alone: x, y, speeds, heading, all but scaled.
fn expected_rows(env: &KinematicEnv) -> Vec<[f64; 5]> {
    let config = &env.config().task.observation;
    let (ego, road) = (env.ego(), env.world().road());
    let (along_mps, left_mps) = ego.velocity_mps();
    let own = [ego.s_m, 8.0 - ego.d_m, along_mps, -left_mps, -ego.heading_rad];
    let mut others: Vec<_> = env.world().vehicles().map(|other| (road.ahead_m(ego.s_m, other.s_m), other)).collect();
    others.sort_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    others.retain(|(ahead_m, other)| {
        libm::hypot(*ahead_m, other.d_m - ego.d_m) < 200.0 && (config.see_behind || *ahead_m > -10.0)
    });
    let rows = others.iter().map(|(ahead_m, other)| {
        let origin = if config.absolute { [0.0; 4] } else { [own[0], own[1], own[2], own[3]] };
        let heading_rad = libm::atan2(-other.lateral_speed_mps, other.speed_mps);
        [
            ego.s_m + ahead_m - origin[0],
            8.0 - other.d_m - origin[1],
            other.speed_mps - origin[2],
            -other.lateral_speed_mps - origin[3],
            heading_rad,
        ]
    });
    std::iter::once(own).chain(rows).take(config.observed_vehicles).collect()
}

fn check_rows(env: &KinematicEnv, expected: &[[f64; 5]]) {
    let scales = if env.config().task.observation.normalize { [200.0, 12.0, 80.0, 80.0] } else { [1.0; 4] };
    let limit = if env.config().task.observation.normalize { 1.0 } else { f64::INFINITY };
    let seen = observation(env);
    for (index, row) in seen.chunks(8).enumerate() {
        let Some([x, y, vx, vy, heading]) = expected.get(index).copied() else {
            assert!(row.iter().all(|&value| value == 0.0));
            continue;
        };
        let scaled = [x, y, vx, vy].into_iter().zip(scales).map(|(value, scale)| (value / scale).clamp(-limit, limit));
        let wanted = [1.0].into_iter().chain(scaled).chain([heading, libm::cos(heading), libm::sin(heading)]);
        for (value, wanted) in row.iter().zip(wanted) {
            // A rounding to f32 of positions up to some hundred meters.
            assert!((f64::from(*value) - wanted).abs() < 1e-4, "row {index}: {row:?}, wanted {wanted}");
        }
    }
}

#[test]
fn a_stored_episode_goes_on_with_the_same_bits() {
    for seed in 0..10 {
        let mut env = env(|config| config.traffic.truck_share = 0.2, seed);
        for _ in 0..3 {
            if !env.is_over() {
                let _ = env.step(random_action(&env, seed)).expect("not over");
            }
        }
        let stored = env.snapshot().expect("it can be stored").as_bytes().to_vec();
        let stored = Snapshot::from_bytes(stored).expect("whole");
        let mut restored = KinematicEnv::restore(&stored).expect("it can be restored");
        assert_eq!(random_episode(&mut restored, seed), random_episode(&mut env, seed));
        assert!(restored == env);
        assert!(matches!(World::restore(&stored), Err(SnapshotError::Kind { .. })));
    }
}

#[test]
fn text_is_laid_over_the_defaults_key_by_key_and_bad_values_are_refused() {
    let text = "[road]\nlanes = 4\n[traffic]\npoliteness = { kind = \"uniform\", min = 0.0, max = 0.5 }\n[task]\nvehicles = 50\n\
                observation.features = [\"presence\", \"cos_h\"]\n";
    let config = KinematicConfig::from_toml(text).expect("valid");
    assert_eq!((config.road.lanes, config.road.lane_width_m, config.task.vehicles), (4, 4.0, 50));
    assert_eq!(config.task.observation.features, [Feature::Presence, Feature::CosH]);
    assert_eq!(config.traffic.min_gap_m, KinematicConfig::default().traffic.min_gap_m);
    let again = KinematicConfig::from_toml(&toml::to_string(&config).expect("it can be written"));
    assert_eq!(again, Ok(config));
    assert!(KinematicConfig::from_toml("[task]\nvehicle = 3").is_err());
    for (text, key) in [
        ("[task]\nvehicles = 0", "task.vehicles"),
        ("[task]\ntarget_speeds_mps = [20.0, 10.0]", "task.target_speeds_mps"),
        ("[task]\nreward_max_speed_mps = 20.0", "task.reward_max_speed_mps"),
        ("[task.observation]\nfeatures = []", "task.observation.features"),
        ("[task]\ncollision_reward = 2.0", "task.collision_reward"),
        ("[road]\nlanes = 9", "road.lanes"),
        ("[[road.lanes_open]]\nlane = 0\nfrom_m = 0.0\nto_m = 900.0", "road.lanes_open"),
    ] {
        let refusal = KinematicConfig::from_toml(text).expect("well-formed").validate().expect_err(text);
        assert_eq!(refusal.key(), key);
    }
}
