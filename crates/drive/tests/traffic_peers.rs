//! The car following beside two peers: highway-env's `IDMVehicle` and SUMO's IDM.
//!
//! Their values are in `data/`, written by `bench/peers/idm_reference.py`. Formula and parameters are the same; what differs is
//! named in each test.

use lanecraft_drive::models::idm::{IdmParams, idm_accel};
use lanecraft_drive::road::{LaneIndex, RoadConfig, Topology};
use lanecraft_drive::scenario::{EgoStart, Scenario, ScenarioDistribution, VehicleKind, VehicleSpec};
use lanecraft_drive::traffic::{ExternalBody, World};

/// The fields of each line but the first.
fn rows(text: &'static str) -> impl Iterator<Item = Vec<&'static str>> {
    text.lines().skip(1).map(|line| line.split(',').collect())
}

fn number(text: &str) -> f64 {
    text.parse().expect("a number")
}

/// Step over which SUMO turned its speeds into accelerations, s.
const SUMO_TABLE_STEP_S: f64 = 0.001;

#[test]
fn accelerations_are_those_of_both_peers() {
    let mut unclipped = 0;
    for row in rows(include_str!("data/idm_accel.csv")) {
        let values: Vec<f64> = row.into_iter().map(number).collect();
        let driver = IdmParams {
            desired_speed_mps: values[0],
            time_headway_s: values[1],
            min_gap_m: values[2],
            max_accel_mps2: values[3],
            comfort_decel_mps2: values[4],
        };
        let (speed_mps, leader_mps, gap_m) = (values[5], values[6], values[7]);
        let ours_mps2 = idm_accel(gap_m, speed_mps, speed_mps - leader_mps, &driver);
        // SUMO never reverses. 1e-8 of the value: it is written with nine digits.
        let standing_mps2 = -speed_mps / SUMO_TABLE_STEP_S;
        assert_close(ours_mps2.max(standing_mps2), values[9], 1e-8);
        // highway-env lets a leader that pulls away shorten the wanted gap below the least one, even below zero, and squares that.
        let braking_scale_mps2 = 2.0 * (driver.max_accel_mps2 * driver.comfort_decel_mps2).sqrt();
        let dynamic_m = speed_mps * driver.time_headway_s + speed_mps * (speed_mps - leader_mps) / braking_scale_mps2;
        let interaction_mps2 = |wanted_m: f64| driver.max_accel_mps2 * (wanted_m / gap_m) * (wanted_m / gap_m);
        let excess_mps2 = interaction_mps2(driver.min_gap_m + dynamic_m.min(0.0)) - interaction_mps2(driver.min_gap_m);
        unclipped += u32::from(excess_mps2 != 0.0);
        // Twelve digits.
        assert_close(ours_mps2 - excess_mps2, values[8], 1e-11);
    }
    assert!(unclipped > 10, "only {unclipped} states tell the two wanted gaps apart");
}

/// `tolerance` is relative, and absolute below 1.
fn assert_close(ours: f64, theirs: f64, tolerance: f64) {
    assert!((ours - theirs).abs() <= tolerance * theirs.abs().max(1.0), "{ours} against {theirs}");
}

const FOLLOWERS: usize = 10;
const LEADER_S_M: f64 = 10_000.0;
const START_SPEED_MPS: f64 = 25.0;
const START_GAP_M: f64 = 50.0;
/// The leader's acceleration in m/s² from each time in s on.
const LEADER: [(f64, f64); 7] =
    [(0.0, 0.0), (5.0, -2.0), (10.0, 0.0), (20.0, 1.0), (30.0, -3.0), (35.0, 0.0), (45.0, 1.0)];

/// Ten equal drivers behind the ego, who is scripted.
fn platoon() -> (World, ExternalBody) {
    let length_m = VehicleKind::Car.length_m();
    let driver = IdmParams {
        desired_speed_mps: 30.0,
        time_headway_s: 1.5,
        min_gap_m: 2.0,
        max_accel_mps2: 1.5,
        comfort_decel_mps2: 2.0,
    };
    let road = RoadConfig { lanes: 1, topology: Topology::Open, ..RoadConfig::default() };
    let (lane, speed_mps) = (LaneIndex(0), START_SPEED_MPS);
    let any = ScenarioDistribution { road, ..ScenarioDistribution::default() }.sample(0).expect("fits");
    let spec = |k: usize| {
        let s_m = LEADER_S_M - (START_GAP_M + length_m) * (k + 1) as f64;
        VehicleSpec { kind: VehicleKind::Car, lane, s_m, speed_mps, driver, ..any.vehicles[0] }
    };
    let vehicles = (0..FOLLOWERS).map(spec).collect();
    let scenario = Scenario { vehicles, ego: EgoStart::At { lane, s_m: LEADER_S_M, speed_mps }, warm_up_s: 0.0, ..any };
    let mut world = World::new(&scenario).expect("possible");
    let leader = ExternalBody {
        s_m: LEADER_S_M,
        d_m: 0.0,
        heading_rad: 0.0,
        speed_mps,
        accel_mps2: 0.0,
        length_m,
        width_m: VehicleKind::Car.width_m(),
        target_lane: lane,
    };
    world.set_ego(leader);
    (world, leader)
}

/// How far the leader and its followers have moved at each of `times_s`, m.
fn moved_m(step_s: f64, times_s: &[f64]) -> Vec<Vec<f64>> {
    let (mut world, mut leader) = platoon();
    let starts_m: Vec<f64> = world.vehicles().map(|vehicle| vehicle.s_m).collect();
    let mut step = 0;
    times_s
        .iter()
        .map(|time_s| {
            while f64::from(step) * step_s < time_s - 0.5 * step_s {
                // Half a step keeps the comparison away from rounding.
                let now_s = (f64::from(step) + 0.5) * step_s;
                let accel_mps2 = LEADER.iter().rfind(|(begin_s, _)| *begin_s < now_s).expect("from 0 on").1;
                let speed_mps = leader.speed_mps + accel_mps2 * step_s;
                leader.s_m += 0.5 * (leader.speed_mps + speed_mps) * step_s;
                (leader.speed_mps, leader.accel_mps2) = (speed_mps, accel_mps2);
                let _ = world.step(leader, step_s);
                step += 1;
            }
            let followers = world.vehicles().zip(&starts_m).map(|(vehicle, start_m)| vehicle.s_m - start_m);
            std::iter::once(leader.s_m - LEADER_S_M).chain(followers).collect()
        })
        .collect()
}

/// What a peer wrote for a step.
fn platoon_of(peer: &str, step_s: f64) -> (Vec<f64>, Vec<Vec<f64>>) {
    rows(include_str!("data/platoon.csv"))
        .filter(|row| row[0] == peer && number(row[1]) == step_s)
        .map(|row| (number(row[2]), row[3..].iter().map(|field| number(field)).collect()))
        .unzip()
}

/// Largest difference of the followers' positions, m.
fn largest_m(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    assert!(a.len() == b.len() && a.len() == 13);
    let pairs = a.iter().zip(b).flat_map(|(a, b)| a[1..].iter().zip(&b[1..]));
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn a_platoon_is_that_of_sumo_with_the_same_update() {
    for step_s in [0.1, 0.05] {
        let (times_s, theirs_m) = platoon_of("sumo-ballistic", step_s);
        let ours_m = moved_m(step_s, &times_s);
        let difference_m = largest_m(&ours_m, &theirs_m);
        println!("step {step_s} s: {difference_m:e} m from sumo-ballistic");
        // Their positions are written to 1e-6 m.
        assert!(difference_m < 2e-6, "{difference_m} m at {step_s} s");
    }
}

/// Explicit Euler (highway-env) moves at the speed of the step's start, semi-implicit Euler (SUMO's default) at that of its end, ours
/// at their mean. So each differs by the first order of the step, to opposite sides, and halfway between them lies ours up to the
/// second order.
#[test]
fn a_platoon_differs_from_either_euler_update_by_its_first_order() {
    let differences = [0.1, 0.05].map(|step_s| {
        let (times_s, explicit_m) = platoon_of("highway-env", step_s);
        let (_, implicit_m) = platoon_of("sumo-euler", step_s);
        let ours_m = moved_m(step_s, &times_s);
        let halfway_m: Vec<Vec<f64>> = explicit_m
            .iter()
            .zip(&implicit_m)
            .map(|(a, b)| a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect())
            .collect();
        let found = [&explicit_m, &implicit_m, &halfway_m].map(|theirs_m| largest_m(&ours_m, theirs_m));
        println!("step {step_s} s: {found:?} m from highway-env, sumo-euler, halfway");
        found
    });
    let [long, short] = differences;
    for scheme in 0..2 {
        // Speeds change by 15 m/s, so Euler's sum alone is off by up to 7.5 m/s times the step; measured are 1.0 m and 1.0 m.
        assert!(long[scheme] < 1.2, "{long:?}");
        let ratio = long[scheme] / short[scheme];
        assert!((1.7..2.3).contains(&ratio), "{ratio} from {long:?} to {short:?}");
    }
    // Second order, and small against the first.
    assert!((3.4..4.6).contains(&(long[2] / short[2])) && long[2] < 0.02, "{long:?} to {short:?}");
}
