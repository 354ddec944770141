//! The traffic as a whole: safety by construction, reproducibility, scenario files.

use lanecraft_drive::models::idm::{IdmParams, idm_accel};
use lanecraft_drive::road::{LaneIndex, RoadConfig, Topology};
use lanecraft_drive::scenario::{
    Distribution, EgoStart, Scenario, ScenarioDistribution, ScenarioError, ScenarioFile, TrafficConfig, VehicleKind,
};
use lanecraft_drive::traffic::{ExternalBody, FaultClass, World};
use lanecraft_net::random::Stream;

const DT_S: f64 = 0.05;

/// The ego where the scenario puts it.
fn body_at((s_m, lane, speed_mps): (f64, LaneIndex, f64), world: &World) -> ExternalBody {
    ExternalBody {
        s_m,
        d_m: world.road().lane_center_m(lane),
        heading_rad: 0.0,
        speed_mps,
        accel_mps2: 0.0,
        length_m: 4.8,
        width_m: 1.9,
        target_lane: lane,
    }
}

/// A world with its ego in place.
fn start(scenario: &Scenario) -> (World, ExternalBody) {
    let mut world = World::new(scenario).expect("a possible scenario");
    let body = body_at(world.ego_start(), &world);
    world.set_ego(body);
    (world, body)
}

/// An ego that keeps its lane and follows by IDM with the law's braking as its limit.
fn following(world: &World, body: ExternalBody) -> ExternalBody {
    let driver = IdmParams {
        desired_speed_mps: 30.0,
        time_headway_s: 1.2,
        min_gap_m: 2.0,
        max_accel_mps2: 1.5,
        comfort_decel_mps2: 2.0,
    };
    let mut accel_mps2 = idm_accel(f64::INFINITY, body.speed_mps, 0.0, &driver);
    for vehicle in world.vehicles() {
        let ahead_m = world.road().ahead_m(body.s_m, vehicle.s_m);
        if ahead_m > 0.0 && (vehicle.lane == body.target_lane || vehicle.target_lane == body.target_lane) {
            let gap_m = ahead_m - 0.5 * (vehicle.length_m + body.length_m);
            accel_mps2 = accel_mps2.min(idm_accel(gap_m, body.speed_mps, body.speed_mps - vehicle.speed_mps, &driver));
        }
    }
    let accel_mps2 = accel_mps2.max(-7.5);
    let speed_mps = (body.speed_mps + accel_mps2 * DT_S).max(0.0);
    let s_m = body.s_m + 0.5 * (body.speed_mps + speed_mps) * DT_S;
    ExternalBody { s_m, speed_mps, accel_mps2, ..body }
}

fn distribution(density_veh_per_km_lane: f64, truck_share: f64) -> ScenarioDistribution {
    ScenarioDistribution {
        road: RoadConfig::default(),
        traffic: TrafficConfig { density_veh_per_km_lane, truck_share, ..TrafficConfig::default() },
    }
}

/// What a long run must not exceed.
#[derive(Default)]
struct Tally {
    vehicle_steps: u64,
    overlaps: u32,
    lane_changes: u32,
    below_4: u64,
    below_6: u64,
    too_hard: u64,
    reversing: u64,
    off_road: u64,
}

impl Tally {
    fn add(&mut self, world: &World, hardest_mps2: f64) {
        let (right_m, left_m) = world.road().edges_m();
        for vehicle in world.vehicles() {
            self.vehicle_steps += 1;
            self.below_4 += u64::from(vehicle.accel_mps2 < -4.0);
            self.below_6 += u64::from(vehicle.accel_mps2 < -6.0);
            // Rounding of one subtraction and one division; a NaN is in no range.
            self.too_hard += u64::from(!(-hardest_mps2 - 1e-9..10.0).contains(&vehicle.accel_mps2));
            self.reversing += u64::from(!(0.0..60.0).contains(&vehicle.speed_mps));
            let half_m = 0.5 * vehicle.width_m;
            self.off_road += u64::from(!(right_m + half_m..=left_m - half_m).contains(&vehicle.d_m));
        }
    }

    fn assert_safe(&self) {
        assert_eq!((self.overlaps, self.too_hard, self.reversing, self.off_road), (0, 0, 0, 0));
    }
}

/// Runs `vehicle_seconds` of ordinary traffic at each of the densities of the acceptance bars, with and without trucks.
fn run_unforced(vehicle_seconds: f64, first_seed: u64) {
    let mut gentle = Tally::default();
    for (seed, density) in (first_seed..).zip([8.0, 16.0, 24.0, 36.0]) {
        for truck_share in [0.0, 0.2] {
            let scenario = distribution(density, truck_share).sample(seed).expect("fits");
            let (mut world, mut body) = start(&scenario);
            let mut tally = Tally::default();
            for step in 0..(0.125 * vehicle_seconds / DT_S / world.len() as f64).ceil() as u64 {
                body = following(&world, body);
                let events = world.step(body, DT_S);
                tally.overlaps += events.hdv_overlaps;
                tally.lane_changes += events.lane_changes;
                tally.add(&world, 7.0);
                if step % 50 == 0 {
                    assert_law(&world, &scenario.traffic);
                }
            }
            tally.assert_safe();
            // From some density on no gap is long enough to change into.
            assert!(tally.lane_changes > 0 || density > 16.0, "at {density}");
            if density <= 24.0 {
                gentle.vehicle_steps += tally.vehicle_steps;
                gentle.below_4 += tally.below_4;
                gentle.below_6 += tally.below_6;
            }
        }
    }
    let share = |count: u64| count as f64 / gentle.vehicle_steps as f64;
    let shares = (share(gentle.below_4), share(gentle.below_6));
    assert!(shares.0 <= 1e-3 && shares.1 <= 1e-5, "harder than 4 and 6 m/s²: {shares:?}");
}

/// The long form, `cargo xtask test --long`, drives ten million vehicle seconds.
#[test]
fn unforced_traffic_is_safe_and_gentle() {
    for round in 0..if is_long() { 100 } else { 1 } {
        run_unforced(1.2e5, 10 * round);
    }
}

fn is_long() -> bool {
    std::env::var_os("LANECRAFT_LONG").is_some()
}

/// Every vehicle keeps the safe distance to every other ahead of it with which it shares a lane, hence to the nearest.
fn assert_law(world: &World, traffic: &TrafficConfig) {
    let adhesion = world.road().adhesion_range().0;
    let truck_mps2 = traffic.truck_max_brake_mps2.min(traffic.hardest_brake_mps2(adhesion));
    let vehicles: Vec<_> = world.vehicles().collect();
    for follower in &vehicles {
        let car = follower.length_m == VehicleKind::Car.length_m();
        let brake_mps2 = if car { traffic.hardest_brake_mps2(adhesion) } else { truck_mps2 };
        let limits = traffic.braking_limits(brake_mps2, false, world.road());
        for leader in vehicles.iter().filter(|leader| leader.id != follower.id) {
            let lanes = [follower.lane, follower.target_lane];
            let ahead_m = world.road().ahead_m(follower.s_m, leader.s_m);
            if ahead_m >= 0.0 && (lanes.contains(&leader.lane) || lanes.contains(&leader.target_lane)) {
                let gap_m = ahead_m - 0.5 * (follower.length_m + leader.length_m);
                let required_m = limits.required_gap_m(follower.speed_mps, leader.speed_mps);
                // 1e-9 m: rounding of positions up to 1e4 m.
                assert!(gap_m >= required_m - 1e-9, "{gap_m} of {required_m} m from {follower:?} to {leader:?}");
            }
        }
    }
}

/// Drivers whom only the law keeps from touching each other.
fn reckless(traffic: &TrafficConfig) -> TrafficConfig {
    TrafficConfig {
        time_headway_s: Distribution::uniform(0.1, 0.4),
        min_gap_m: Distribution::fixed(0.0),
        max_accel_mps2: Distribution::fixed(4.0),
        truck_max_accel_mps2: Distribution::fixed(3.0),
        comfort_decel_mps2: Distribution::fixed(6.0),
        desired_speed_mps: Distribution::uniform(19.0, 40.0),
        politeness: Distribution::fixed(0.0),
        accel_gain_threshold_mps2: 0.0,
        safe_decel_mps2: 9.0,
        lane_change_cooldown_s: 0.0,
        lane_change_duration_s: 1.5,
        ..traffic.clone()
    }
}

/// A hostile ego: random speeds, random sideways jumps into any lane, standing, driving through others.
struct Hostile {
    stream: Stream,
    accel_mps2: f64,
    lane: LaneIndex,
}

impl Hostile {
    fn drive(&mut self, world: &World, body: ExternalBody) -> ExternalBody {
        if self.stream.bernoulli(0.02) {
            self.accel_mps2 = self.stream.range(-8.0, 6.0);
        }
        if self.stream.bernoulli(0.02) {
            self.lane = LaneIndex(self.stream.below(usize::from(world.road().config().lanes)) as u8);
        }
        let speed_mps = (body.speed_mps + self.accel_mps2 * DT_S).clamp(0.0, 45.0);
        let aside_m = world.road().lane_center_m(self.lane) - body.d_m;
        let d_m = body.d_m + aside_m.clamp(-4.0 * DT_S, 4.0 * DT_S);
        let s_m = body.s_m + 0.5 * (body.speed_mps + speed_mps) * DT_S;
        let heading_rad = if aside_m.abs() > 0.2 { 0.15 * aside_m.signum() } else { 0.0 };
        ExternalBody { s_m, d_m, heading_rad, speed_mps, target_lane: self.lane, ..body }
    }
}

/// Runs 60 s of each seed with a hostile ego and random full brakes.
fn run_stress(seeds: std::ops::Range<u64>) {
    let mut collisions = 0;
    let (mut hard, mut lane_changes) = (0, 0);
    for seed in seeds {
        let mut distribution = distribution([8.0, 16.0, 24.0, 36.0][seed as usize % 4], 0.2);
        distribution.traffic.stress_brake_rate_hz = 0.1;
        if seed % 3 == 0 {
            distribution.road.topology = Topology::Open;
        }
        if seed % 5 == 0 {
            distribution.road.adhesion = 0.4;
        }
        if seed % 8 < 4 {
            distribution.traffic = reckless(&distribution.traffic);
        }
        let scenario = distribution.sample(seed).expect("fits");
        let hardest_mps2 = scenario.traffic.hardest_brake_mps2(scenario.road.adhesion());
        let (mut world, mut body) = start(&scenario);
        let stream = Stream::keyed(seed, "test.hostile", 0, 0);
        let mut hostile = Hostile { stream, accel_mps2: 0.0, lane: body.target_lane };
        let mut tally = Tally::default();
        for step in 0..1200 {
            body = hostile.drive(&world, body);
            let events = world.step(body, DT_S);
            tally.overlaps += events.hdv_overlaps;
            tally.lane_changes += events.lane_changes;
            collisions += u32::from(events.collision.is_some());
            tally.add(&world, hardest_mps2);
            if step % 7 == 0 {
                assert_law(&world, &scenario.traffic);
            }
        }
        tally.assert_safe();
        hard += tally.below_6;
        lane_changes += tally.lane_changes;
    }
    // The test has teeth only if the ego really rams others and they really brake.
    let counts = (collisions, hard, lane_changes);
    assert!(collisions > 100 && hard > 1000 && lane_changes > 1000, "{counts:?}");
}

/// The long form drives a million vehicle seconds.
#[test]
fn stress_never_makes_human_drivers_touch() {
    run_stress(0..if is_long() { 400 } else { 40 });
}

#[test]
fn same_seed_same_bits_and_a_copy_continues() {
    let mut distribution = distribution(16.0, 0.2);
    distribution.traffic.stress_brake_rate_hz = 0.05;
    distribution.traffic.density_spread_veh_per_km_lane = 4.0;
    let run = |seed: u64| {
        let (mut world, mut body) = start(&distribution.sample(seed).expect("fits"));
        let mut copy = None;
        for step in 0..1200 {
            if step == 517 {
                copy = Some((world.clone(), body));
            }
            body = following(&world, body);
            let _ = world.step(body, DT_S);
        }
        let (mut copied, mut body) = copy.expect("made on the way");
        for _ in 517..1200 {
            body = following(&copied, body);
            let _ = copied.step(body, DT_S);
        }
        assert!(copied == world);
        assert_eq!(copied.digest(), world.digest());
        assert_eq!(world.time_step(), 1200);
        world.digest()
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn a_ring_has_no_seam() {
    let (mut world, mut body) = start(&distribution(20.0, 0.0).sample(3).expect("fits"));
    let mut passed = 0;
    let mut last: Vec<f64> = world.vehicles().map(|vehicle| vehicle.s_m).collect();
    for _ in 0..2000 {
        body = following(&world, body);
        let _ = world.step(body, DT_S);
        for (vehicle, last_m) in world.vehicles().zip(&mut last) {
            assert!((0.0..1000.0).contains(&vehicle.s_m));
            let moved_m = world.road().ahead_m(*last_m, vehicle.s_m);
            assert!((0.0..2.0).contains(&moved_m));
            passed += u32::from(vehicle.s_m < *last_m);
            // Nothing special happens where the ring closes.
            assert!(vehicle.accel_mps2 > -6.0);
            *last_m = vehicle.s_m;
        }
    }
    assert!(passed > 60, "only {passed} passed the ring's end");
}

#[test]
fn an_ego_that_stops_is_not_hit_and_one_that_rams_is_to_blame() {
    let (mut world, body) = start(&distribution(14.0, 0.0).sample(5).expect("fits"));
    let mut braking = body;
    for _ in 0..400 {
        let speed_mps = (braking.speed_mps - 7.9 * DT_S).max(0.0);
        braking = ExternalBody {
            s_m: braking.s_m + 0.5 * (braking.speed_mps + speed_mps) * DT_S,
            speed_mps,
            accel_mps2: -7.9,
            ..braking
        };
        assert_eq!(world.clone().step(braking, DT_S).collision, None);
        let _ = world.step(braking, DT_S);
    }
    let (mut world, mut ramming) = start(&distribution(14.0, 0.0).sample(5).expect("fits"));
    let collision = (0..400).find_map(|_| {
        ramming = ExternalBody { s_m: ramming.s_m + 40.0 * DT_S, speed_mps: 40.0, ..ramming };
        world.step(ramming, DT_S).collision
    });
    assert!(collision.is_some_and(|collision| collision.fault == FaultClass::EgoRearEnds), "{collision:?}");
}

const SCENARIOS: [(&str, &str); 6] = [
    ("ring-3-lanes", include_str!("../../../scenarios/ring-3-lanes.toml")),
    ("open-road", include_str!("../../../scenarios/open-road.toml")),
    ("gentle-curve", include_str!("../../../scenarios/gentle-curve.toml")),
    ("continuous-overtaking", include_str!("../../../scenarios/continuous-overtaking.toml")),
    ("dense", include_str!("../../../scenarios/dense.toml")),
    ("stress", include_str!("../../../scenarios/stress.toml")),
];

#[test]
fn every_scenario_file_runs() {
    for (name, text) in SCENARIOS {
        let file = ScenarioFile::from_toml(text).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(file.name, name);
        for seed in 0..5 {
            let (mut world, mut body) = start(&file.scenario(seed).expect("a possible scenario"));
            for _ in 0..400 {
                body = following(&world, body);
                let events = world.step(body, DT_S);
                assert_eq!(events.hdv_overlaps, 0, "{name}");
                assert_eq!(events.collision, None, "{name}");
            }
        }
    }
}

const TWO_CARS: &str = r#"
name = "two"
description = "two cars"
vehicles = [
    { lane = 0, s_m = 100.0, speed_mps = 20.0, desired_speed_mps = 25.0, kind = "car" },
    { lane = 0, s_m = 150.0, speed_mps = 20.0, desired_speed_mps = 25.0, kind = "truck" },
]
"#;

fn error_of(text: &str) -> ScenarioError {
    match ScenarioFile::from_toml(text) {
        Err(error) => error,
        Ok(file) => file.scenario(0).and_then(|scenario| World::new(&scenario)).expect_err("an impossible scenario"),
    }
}

#[test]
fn impossible_scenarios_are_refused_with_a_reason() {
    let file = ScenarioFile::from_toml(TWO_CARS).expect("valid");
    assert_eq!((file.vehicles[1].kind, file.ego), (VehicleKind::Truck, EgoStart::LargestGap));
    assert!(World::new(&file.scenario(0).expect("valid")).is_ok());
    let ego = "ego = { kind = \"at\", lane = 0, s_m = 101.0, speed_mps = 20.0 }\nvehicles";
    let cases = [
        (TWO_CARS.replace("speed_mps = 20.0, desired", "sped_mps = 20.0, desired"), "line 5"),
        (TWO_CARS.replace("s_m = 150.0", "s_m = 104.0"), "vehicle 0 and vehicle 1 overlap"),
        (
            TWO_CARS.replace("s_m = 150.0, speed_mps = 20.0", "s_m = 120.0, speed_mps = 0.0"),
            "vehicle 0 starts 11.60 m behind",
        ),
        (
            TWO_CARS.replace("lane = 0, s_m = 150", "lane = 3, s_m = 150"),
            "vehicle 1 is in lane 3, but the road has lanes 0 to 2",
        ),
        (TWO_CARS.replace("100.0", "nan"), "`vehicles.s_m` is NaN"),
        (TWO_CARS.replace("100.0", "1000.5"), "`vehicles.s_m` is 1000.5"),
        (TWO_CARS.replace("vehicles", ego), "vehicle 0 and the ego overlap"),
        ("name = \"n\"\ndescription = \"d\"\ntraffic.density = 3.0".to_owned(), "line 3"),
        (
            "name = \"n\"\ndescription = \"d\"\ntraffic.politeness = { kind = \"fixed\", value = nan }".to_owned(),
            "`traffic.politeness.value` is NaN",
        ),
        ("name = \"n\"\ndescription = \"d\"\ntraffic.density_veh_per_km_lane = 0.0".to_owned(), "the road is empty"),
        (
            "name = \"n\"\ndescription = \"d\"\ntraffic.density_veh_per_km_lane = 180.0".to_owned(),
            "180 vehicles in lane 0 take",
        ),
        ("name = \"n\"\ndescription = \"d\"\nego = { kind = \"near\" }".to_owned(), "line 3"),
    ];
    for (text, expected) in cases {
        let message = error_of(&text).to_string();
        assert!(message.contains(expected), "`{message}` does not say `{expected}`");
    }
}

#[test]
fn files_survive_a_round_trip() {
    for (_, text) in SCENARIOS {
        let file = ScenarioFile::from_toml(text).expect("valid");
        let written = toml::to_string(&file).expect("all keys serialize");
        assert_eq!(ScenarioFile::from_toml(&written).expect("valid"), file);
    }
}

/// The acceleration that IDM gives a fast driver in `lane`, and whether the vehicle behind would have to brake harder than 3 m/s².
fn view(world: &World, body: &ExternalBody, lane: LaneIndex, driver: &IdmParams) -> (f64, bool) {
    let (mut accel_mps2, mut free) = (idm_accel(f64::INFINITY, body.speed_mps, 0.0, driver), true);
    for vehicle in world.vehicles().filter(|vehicle| vehicle.lane == lane || vehicle.target_lane == lane) {
        let ahead_m = world.road().ahead_m(body.s_m, vehicle.s_m);
        let gap_m = ahead_m.abs() - 0.5 * (vehicle.length_m + body.length_m);
        if ahead_m >= 0.0 {
            accel_mps2 = accel_mps2.min(idm_accel(gap_m, body.speed_mps, body.speed_mps - vehicle.speed_mps, driver));
        } else {
            free &= idm_accel(gap_m, vehicle.speed_mps, vehicle.speed_mps - body.speed_mps, driver) > -3.0;
        }
    }
    (accel_mps2, free)
}

/// Times at which a fast driver changes lane because the acceleration there is larger by 0.3 m/s².
fn changes_of_a_fast_driver(world: &mut World, mut body: ExternalBody, steps: u32) -> Vec<f64> {
    let driver = IdmParams {
        desired_speed_mps: 33.3,
        time_headway_s: 0.8,
        min_gap_m: 2.0,
        max_accel_mps2: 2.0,
        comfort_decel_mps2: 3.0,
    };
    let mut times_s = Vec::new();
    let (mut from, mut change_step) = (body.target_lane, 50);
    for step in 0..steps {
        if change_step >= 50 && step % 10 == 0 {
            let (keep_mps2, _) = view(world, &body, body.target_lane, &driver);
            let beside = [1, -1].map(|side| LaneIndex((body.target_lane.0 as i8 + side).clamp(0, 2) as u8));
            let best = beside.into_iter().map(|lane| (view(world, &body, lane, &driver), lane));
            let best = best.filter(|((_, free), _)| *free).max_by(|a, b| a.0.0.total_cmp(&b.0.0));
            if let Some((_, lane)) = best.filter(|((accel_mps2, _), _)| *accel_mps2 > keep_mps2 + 0.3) {
                (from, change_step, body.target_lane) = (body.target_lane, 0, lane);
                times_s.push(f64::from(step) * DT_S);
            }
        }
        change_step = (change_step + 1).min(50);
        let t = f64::from(change_step) / 50.0;
        let (from_m, to_m) = (world.road().lane_center_m(from), world.road().lane_center_m(body.target_lane));
        body.d_m = from_m + (to_m - from_m) * t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
        let mut accel_mps2 = view(world, &body, body.target_lane, &driver).0;
        if change_step < 25 {
            accel_mps2 = accel_mps2.min(view(world, &body, from, &driver).0);
        }
        let speed_mps = (body.speed_mps + accel_mps2.max(-7.5) * DT_S).max(0.0);
        body.s_m += 0.5 * (body.speed_mps + speed_mps) * DT_S;
        body.speed_mps = speed_mps;
        assert_eq!(world.step(body, DT_S).collision, None);
    }
    times_s
}

#[test]
fn four_lane_changes_pay_in_the_overtaking_scene() {
    let file = ScenarioFile::from_toml(SCENARIOS[3].1).expect("valid");
    let (mut world, body) = start(&file.scenario(0).expect("possible"));
    let times_s = changes_of_a_fast_driver(&mut world, body, 500);
    assert!(times_s.len() >= 4, "changes at {times_s:?} s only");
    assert!(times_s[3] < 25.0, "{times_s:?}");
}
