//! Human drivers on roads whose lanes begin and end, with speed limits and slippery stretches.

use lanecraft_drive::road::{AdhesionPatch, LaneIndex, LaneStretch, RoadConfig, SolidLine};
use lanecraft_drive::scenario::{Distribution, ScenarioDistribution, ScenarioFile, TrafficConfig};
use lanecraft_drive::traffic::World;

const DT_S: f64 = 0.05;

fn is_long() -> bool {
    std::env::var_os("LANECRAFT_LONG").is_some()
}

/// The third lane of a ring is missing on 600 of 3000 m.
fn drop_ring() -> RoadConfig {
    let stretch = |from_m, to_m| LaneStretch { lane: LaneIndex(2), from_m, to_m };
    RoadConfig {
        length_m: 3000.0,
        lanes_open: vec![stretch(0.0, 2000.0), stretch(2600.0, 3000.0)],
        ..RoadConfig::default()
    }
}

/// A lane joins a ring from the right, first behind a solid line.
fn merge_ring() -> RoadConfig {
    RoadConfig {
        length_m: 3000.0,
        lanes_open: vec![LaneStretch { lane: LaneIndex(0), from_m: 0.0, to_m: 1500.0 }],
        solid_lines: vec![SolidLine { right_lane: LaneIndex(0), from_m: 900.0, to_m: 1200.0 }],
        ..RoadConfig::default()
    }
}

/// Default drivers with some trucks.
fn traffic(density_veh_per_km_lane: f64) -> TrafficConfig {
    TrafficConfig { density_veh_per_km_lane, truck_share: 0.1, ..TrafficConfig::default() }
}

fn start(road: &RoadConfig, traffic: &TrafficConfig, seed: u64) -> World {
    let distribution = ScenarioDistribution { road: road.clone(), traffic: traffic.clone() };
    World::new(&distribution.sample(seed).expect("fits")).expect("possible")
}

/// What is measured of a bottleneck.
#[derive(Default)]
struct Tally {
    vehicle_s: f64,
    overlaps: u32,
    /// Vehicle steps with a body outside its lane's stretches.
    off_lane: u64,
    /// Changes across a solid line.
    over_line: u64,
    lane_changes: u32,
    /// Longest time that anybody has stood, s.
    longest_stand_s: f64,
    /// Vehicles that passed the place of measurement.
    passed: u64,
    /// Vehicle steps with harder braking than the road allows.
    too_hard: u64,
}

impl Tally {
    fn flow_veh_per_h(&self, duration_s: f64, lanes: f64) -> f64 {
        self.passed as f64 / duration_s * 3600.0 / lanes
    }

    fn assert_safe(&self) {
        assert_eq!((self.overlaps, self.off_lane, self.over_line, self.too_hard), (0, 0, 0, 0));
    }
}

/// Hardest braking of a car on this road's most slippery place.
fn hardest_mps2(world: &World) -> f64 {
    TrafficConfig::default().hardest_brake_mps2(world.road().adhesion_range().0)
}

/// Drives for `duration_s`, counting who passes `at_m`.
fn drive(world: &mut World, duration_s: f64, at_m: f64, tally: &mut Tally) {
    // Rounding of one division.
    let hardest_mps2 = hardest_mps2(world) + 1e-9;
    let mut standing_s = vec![0.0; world.len()];
    let mut last: Vec<_> = world.vehicles().collect();
    for _ in 0..(duration_s / DT_S) as u64 {
        let events = world.step_alone(DT_S);
        tally.overlaps += events.hdv_overlaps;
        tally.lane_changes += events.lane_changes;
        for (i, vehicle) in world.vehicles().enumerate() {
            let road = world.road();
            let half_m = 0.5 * vehicle.length_m;
            let on = |lane| road.lane_holds(lane, vehicle.s_m, half_m);
            tally.off_lane += u64::from(!on(vehicle.lane) || !on(vehicle.target_lane));
            if vehicle.target_lane != last[i].target_lane && last[i].target_lane == last[i].lane {
                let solid = |line: &SolidLine| {
                    line.right_lane == vehicle.lane.min(vehicle.target_lane)
                        && (line.from_m..line.to_m).contains(&last[i].s_m)
                };
                tally.over_line += u64::from(road.config().solid_lines.iter().any(solid));
            }
            tally.too_hard += u64::from(vehicle.accel_mps2 < -hardest_mps2);
            standing_s[i] = if vehicle.speed_mps < 0.5 { standing_s[i] + DT_S } else { 0.0 };
            tally.longest_stand_s = tally.longest_stand_s.max(standing_s[i]);
            let moved_m = road.ahead_m(last[i].s_m, vehicle.s_m);
            let before_m = road.ahead_m(last[i].s_m, at_m);
            tally.passed += u64::from(before_m > 0.0 && before_m <= moved_m);
            last[i] = vehicle;
        }
    }
    tally.vehicle_s += duration_s * world.len() as f64;
}

/// Both bottlenecks from free flow to far beyond their capacity: nobody touches anybody, leaves the road, drives past a lane's end or
/// over a solid line, and nobody waits for ever. The long form drives ten million vehicle seconds, this one half a million.
#[test]
fn bottlenecks_are_safe_and_nobody_is_stuck() {
    let mut vehicle_s = 0.0;
    for seed in 0..if is_long() { 20 } else { 1 } {
        for (road, at_m) in [(drop_ring(), 2300.0), (merge_ring(), 2000.0)] {
            for density in [8.0, 16.0, 24.0] {
                let mut world = start(&road, &traffic(density), seed);
                let mut tally = Tally::default();
                drive(&mut world, 700.0, at_m, &mut tally);
                tally.assert_safe();
                // A standing queue moves up by one vehicle every few seconds.
                assert!(tally.longest_stand_s < 20.0, "stuck for {} s at {density}", tally.longest_stand_s);
                assert!(tally.lane_changes > 100, "only {} lane changes", tally.lane_changes);
                vehicle_s += tally.vehicle_s;
            }
        }
    }
    assert!(vehicle_s > if is_long() { 1e7 } else { 5e5 }, "only {vehicle_s} vehicle seconds");
}

/// Usual drivers (headways about 1.1 s, 100 to 120 km/h) get about 1800 veh/h/lane through two lanes before the flow breaks down, and a
/// fifth less afterwards: the capacity and its drop as measured on freeways (Treiber and Kesting, 2013).
#[test]
fn the_flow_through_a_bottleneck_is_of_the_known_size() {
    let flow = |density| {
        let drivers = TrafficConfig {
            time_headway_s: Distribution::uniform(0.9, 1.3),
            desired_speed_mps: Distribution::uniform(27.0, 34.0),
            truck_share: 0.0,
            ..traffic(density)
        };
        let mut world = start(&drop_ring(), &drivers, 1);
        drive(&mut world, 200.0, 2300.0, &mut Tally::default());
        let mut tally = Tally::default();
        drive(&mut world, 300.0, 2300.0, &mut tally);
        tally.flow_veh_per_h(300.0, 2.0)
    };
    let (free, congested) = (flow(14.0), flow(24.0));
    assert!((1600.0..2200.0).contains(&free), "{free}");
    assert!((1300.0..0.95 * free).contains(&congested), "{congested} after {free}");
}

/// Everybody who starts on an open road's ending lane is off it in bounded time.
#[test]
fn everybody_gets_through_at_moderate_demand() {
    for (name, lane) in [("lane-drop", LaneIndex(2)), ("merge", LaneIndex(0))] {
        for seed in 0..if is_long() { 50 } else { 5 } {
            let mut world = World::new(&scenario_file(name).scenario(seed).expect("fits")).expect("possible");
            assert!(world.vehicles().any(|vehicle| vehicle.lane == lane), "nobody on the ending lane of {name}");
            let mut tally = Tally::default();
            // From the start to the end at 15 m/s, and half a minute.
            drive(&mut world, 130.0, 0.0, &mut tally);
            tally.assert_safe();
            assert!(world.vehicles().all(|vehicle| vehicle.lane != lane), "{name}, seed {seed}");
        }
    }
}

fn scenario_file(name: &str) -> ScenarioFile {
    let path = format!("{}/../../scenarios/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    ScenarioFile::from_toml(&std::fs::read_to_string(path).expect("readable")).expect("valid")
}

#[test]
fn speed_limits_are_kept_and_reached_gently() {
    let mut world = World::new(&scenario_file("speed-limit").scenario(1).expect("fits")).expect("possible");
    let (mut within, mut fast_outside) = (0, 0);
    for _ in 0..2400 {
        let _ = world.step_alone(DT_S);
        for vehicle in world.vehicles() {
            let limit_mps = world.road().speed_limit_mps(vehicle.s_m);
            // Slowing down at 1 m/s² with a time constant of 1 s leaves 1/e m/s where the limit begins.
            assert!(vehicle.speed_mps < limit_mps + 0.37, "{vehicle:?} in {limit_mps} m/s");
            within += u32::from(limit_mps < 23.0 && vehicle.speed_mps > 0.9 * limit_mps);
            fast_outside += u32::from(limit_mps.is_infinite() && vehicle.speed_mps > 29.0);
        }
    }
    assert!(within > 10_000 && fast_outside > 1000, "{within}, {fast_outside}");
}

/// Over the patch and before it nobody brakes harder than it allows, nor has to.
#[test]
fn a_wet_patch_breaks_no_law() {
    let patches = [(0.4, false), (0.4, true), (0.2, false), (1.2, true)];
    for (seed, (adhesion, drop)) in (0..).zip(patches) {
        let road = if drop { drop_ring() } else { RoadConfig { length_m: 3000.0, ..RoadConfig::default() } };
        let patch = AdhesionPatch { s_m: 1800.0, length_m: 150.0, adhesion };
        let road = RoadConfig { adhesion_patches: vec![patch], ..road };
        let distribution = ScenarioDistribution { road, traffic: traffic(12.0) };
        let mut world = World::new(&distribution.sample(seed).expect("fits")).expect("possible");
        let mut tally = Tally::default();
        drive(&mut world, 200.0, 0.0, &mut tally);
        tally.assert_safe();
    }
}

#[test]
fn who_starts_where_no_lane_is_or_cannot_stop_is_refused() {
    let error = |ego: &str, vehicle: &str| {
        let text = format!(
            "name = \"x\"\ndescription = \"x\"\n{ego}\n[road]\nlanes_open = [{{ lane = 2, from_m = 0.0, to_m = 500.0 }}]\n\
             [[vehicles]]\n{vehicle}\ndesired_speed_mps = 25.0\nkind = \"car\"\n"
        );
        let scenario = ScenarioFile::from_toml(&text).expect("valid").scenario(1).expect("built");
        World::new(&scenario).expect_err("no such place").to_string()
    };
    let ego = |lane: u8, s_m: f64| format!("ego = {{ kind = \"at\", lane = {lane}, s_m = {s_m}, speed_mps = 30.0 }}");
    let vehicle = |lane: u8, s_m: f64| format!("lane = {lane}\ns_m = {s_m}\nspeed_mps = 20.0");
    let off = "vehicle 0 starts at 600 m, where lane 2 does not exist under all of it (see `road.lanes_open`)";
    assert_eq!(error(&ego(0, 0.0), &vehicle(2, 600.0)), off);
    assert!(error(&ego(0, 0.0), &vehicle(2, 499.0)).contains("does not exist under all of it"));
    assert!(error(&ego(2, 501.0), &vehicle(0, 300.0)).starts_with("the ego starts at 501 m"));
    let near = "vehicle 0 starts 17.60 m before the end of its lane, but could stop before it only from 29.57 m";
    assert_eq!(error(&ego(0, 0.0), &vehicle(2, 480.0)), near);
    assert!(error(&ego(2, 450.0), &vehicle(0, 300.0)).starts_with("the ego starts 47.60 m before the end of its lane"));
}
