//! Who drives in the traffic: car-following models, the rule of the road, drivers that differ.

use lanecraft_drive::models::car_following::CarFollowing;
use lanecraft_drive::road::LaneIndex;
use lanecraft_drive::scenario::{Distribution, ScenarioDistribution, ScenarioFile, TrafficConfig};
use lanecraft_drive::traffic::World;

const DT_S: f64 = 0.05;

fn world(traffic: TrafficConfig, seed: u64) -> World {
    let distribution = ScenarioDistribution { traffic, ..ScenarioDistribution::default() };
    World::new(&distribution.sample(seed).expect("fits")).expect("possible")
}

/// Share of vehicles in each lane, from the right, over the last of two minutes.
fn lane_shares(traffic: &TrafficConfig) -> [f64; 3] {
    let (mut counts, mut all) = ([0.0; 3], 0.0);
    for seed in 0..3 {
        let mut world = world(traffic.clone(), seed);
        for step in 0..2400 {
            let _ = world.step_alone(DT_S);
            if step >= 1200 {
                world.vehicles().for_each(|vehicle| counts[usize::from(vehicle.lane.0)] += 1.0);
                all += world.len() as f64;
            }
        }
    }
    counts.map(|count| count / all)
}

#[test]
fn free_traffic_that_keeps_right_sits_in_the_right_lane() {
    let free = TrafficConfig { density_veh_per_km_lane: 2.0, ..TrafficConfig::default() };
    let symmetric = lane_shares(&free);
    let asymmetric = lane_shares(&TrafficConfig { keep_right: true, ..free });
    assert!(asymmetric[0] > 0.6 && asymmetric[0] > asymmetric[1] && asymmetric[1] > asymmetric[2], "{asymmetric:?}");
    assert!(symmetric[0] < 0.5, "{symmetric:?}");
}

/// Hardest braking of a car at 25 m/s before which another, as fast, has cut in 12 m ahead, and the smallest gap.
fn after_a_cut_in(car_following: CarFollowing) -> (f64, f64) {
    let text = r#"
name = "cut-in"
description = "two cars at equal speed, nearer than they like"
road = { topology = "open", lanes = 1 }
vehicles = [
    { lane = 0, s_m = 100.0, speed_mps = 25.0, desired_speed_mps = 30.0, kind = "car" },
    { lane = 0, s_m = 116.8, speed_mps = 25.0, desired_speed_mps = 25.0, kind = "car" },
]
"#;
    let mut file = ScenarioFile::from_toml(text).expect("valid");
    file.traffic.car_following = car_following;
    let mut world = World::new(&file.scenario(0).expect("valid")).expect("possible");
    let (mut hardest_mps2, mut smallest_m) = (0.0_f64, f64::INFINITY);
    for _ in 0..600 {
        let events = world.step_alone(DT_S);
        assert_eq!(events.hdv_overlaps, 0);
        let [rear, front] = [0, 1].map(|k| world.vehicles().nth(k).expect("two cars"));
        hardest_mps2 = hardest_mps2.min(rear.accel_mps2);
        smallest_m = smallest_m.min(front.s_m - rear.s_m - rear.length_m);
    }
    (hardest_mps2, smallest_m)
}

#[test]
fn the_enhanced_model_stays_calm_behind_a_cut_in() {
    let (idm_mps2, idm_m) = after_a_cut_in(CarFollowing::Idm);
    let (enhanced_mps2, enhanced_m) = after_a_cut_in(CarFollowing::EnhancedIdm);
    // IDM brakes in full, the enhanced one with little more than the comfortable 2 m/s².
    assert!(idm_mps2 < -6.9 && enhanced_mps2 > -2.5, "{idm_mps2} and {enhanced_mps2} m/s²");
    // Neither comes nearer than it was.
    assert!(idm_m > 11.9 && enhanced_m > 11.9, "{idm_m} and {enhanced_m} m");
}

/// Drivers of every temper, who want to be nearer than the law lets them.
#[test]
fn the_law_of_the_safe_distance_holds_for_every_model_rule_and_temper() {
    let wide = |mean, sd, min, max| Distribution::Normal { mean, sd, min, max };
    for car_following in [CarFollowing::Idm, CarFollowing::EnhancedIdm] {
        for (seed, density_veh_per_km_lane) in (0..).zip([8.0, 20.0, 36.0, 50.0]) {
            let traffic = TrafficConfig {
                car_following,
                density_veh_per_km_lane,
                truck_share: 0.2,
                keep_right: seed % 2 == 0,
                desired_speed_mps: wide(25.0, 8.0, 15.0, 45.0),
                time_headway_s: wide(0.6, 0.5, 0.1, 2.0),
                min_gap_m: Distribution::uniform(0.0, 4.0),
                max_accel_mps2: wide(1.5, 1.0, 0.3, 4.0),
                comfort_decel_mps2: wide(2.0, 1.5, 0.3, 6.0),
                politeness: Distribution::uniform(-0.5, 1.0),
                safe_decel_mps2: 9.0,
                ..TrafficConfig::default()
            };
            let mut world = world(traffic, seed);
            for _ in 0..1200 {
                assert_eq!(world.step_alone(DT_S).hdv_overlaps, 0);
            }
        }
    }
}

#[test]
fn drivers_differ_as_their_distributions_say() {
    let traffic = TrafficConfig {
        min_gap_m: Distribution::uniform(1.0, 3.0),
        max_accel_mps2: Distribution::Normal { mean: 1.5, sd: 0.3, min: 1.0, max: 2.0 },
        politeness: Distribution::uniform(0.0, 0.5),
        ..TrafficConfig::default()
    };
    let sample = |traffic: &TrafficConfig| {
        let distribution = ScenarioDistribution { traffic: traffic.clone(), ..ScenarioDistribution::default() };
        distribution.sample(3).expect("fits").vehicles
    };
    let (differing, default) = (sample(&traffic), sample(&TrafficConfig::default()));
    for (a, b) in differing.iter().zip(&default) {
        assert!((1.0..3.0).contains(&a.driver.min_gap_m) && (1.0..=2.0).contains(&a.driver.max_accel_mps2));
        assert!((0.0..0.5).contains(&a.politeness) && b.politeness == 0.3 && b.lane == LaneIndex(a.lane.0));
        // What was drawn before they differed is drawn as it was.
        assert_eq!((a.driver.desired_speed_mps, a.cooldown_s), (b.driver.desired_speed_mps, b.cooldown_s));
        assert_eq!(a.driver.time_headway_s, b.driver.time_headway_s);
    }
    assert!(differing.windows(2).all(|pair| pair[0].driver.min_gap_m != pair[1].driver.min_gap_m));
}
