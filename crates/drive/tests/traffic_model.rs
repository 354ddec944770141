//! The traffic as a model: convergence in the time step, the ego's place, courtesy.

use lanecraft_drive::road::{LaneIndex, RoadConfig, Topology};
use lanecraft_drive::scenario::{ScenarioDistribution, ScenarioFile, TrafficConfig, VehicleKind, VehicleStart};
use lanecraft_drive::scene::VehicleId;
use lanecraft_drive::traffic::{ExternalBody, World};

/// An ego that stands beside the road and concerns nobody.
const ABSENT: ExternalBody = ExternalBody {
    s_m: 0.0,
    d_m: 1000.0,
    heading_rad: 0.0,
    speed_mps: 0.0,
    accel_mps2: 0.0,
    length_m: 4.8,
    width_m: 1.9,
    target_lane: LaneIndex(7),
};

fn sampled(density_veh_per_km_lane: f64, seed: u64) -> World {
    let traffic = TrafficConfig { density_veh_per_km_lane, ..TrafficConfig::default() };
    let distribution = ScenarioDistribution { road: RoadConfig::default(), traffic };
    World::new(&distribution.sample(seed).expect("fits")).expect("possible")
}

/// Mean speed over 60 s of all vehicles of some scenes, m/s.
fn mean_speed_mps(density_veh_per_km_lane: f64, dt_s: f64) -> f64 {
    let (mut sum_mps, mut count) = (0.0, 0.0);
    for seed in 0..4 {
        let mut world = sampled(density_veh_per_km_lane, seed);
        for step in 0..(60.0 / dt_s).round() as u32 {
            let _ = world.step(ABSENT, dt_s);
            if f64::from(step) * dt_s % 1.0 < 0.5 * dt_s {
                sum_mps += world.vehicles().map(|vehicle| vehicle.speed_mps).sum::<f64>();
                count += world.len() as f64;
            }
        }
    }
    sum_mps / count
}

#[test]
fn flow_does_not_depend_on_the_time_step() {
    let mut last_flow = 0.0;
    for density in [8.0, 14.0, 20.0, 28.0, 36.0] {
        let speeds_mps = [0.1, 0.05, 0.025].map(|dt_s| mean_speed_mps(density, dt_s));
        for pair in speeds_mps.windows(2) {
            // 2 % per halving: lane changes differ, so that microscopic states do, too.
            assert!((pair[1] / pair[0] - 1.0).abs() < 0.02, "{speeds_mps:?} at {density}");
        }
        let flow_veh_per_h_lane = 3.6 * density * speeds_mps[1];
        // The free branch up to capacity: more vehicles, more flow, each slower.
        assert!(flow_veh_per_h_lane > last_flow);
        last_flow = flow_veh_per_h_lane;
    }
    // Capacity of a motorway lane with headways of 1 to 1.8 s.
    assert!((1500.0..2500.0).contains(&last_flow), "{last_flow} veh/h/lane");
}

/// Positions of a platoon of ten after 60 s behind a slow leader that it first has to catch up with.
fn platoon_m(steps_per_s: u32) -> Vec<f64> {
    let vehicles = (0..10).map(|k| {
        let speed_mps = if k == 9 { 15.0 } else { 25.0 };
        let s_m = 60.0 * f64::from(k);
        VehicleStart {
            name: String::new(),
            lane: LaneIndex(0),
            s_m,
            speed_mps,
            desired_speed_mps: speed_mps,
            kind: VehicleKind::Car,
        }
    });
    let file = ScenarioFile {
        name: "platoon".to_owned(),
        description: "ten cars in one lane".to_owned(),
        road: RoadConfig { lanes: 1, topology: Topology::Open, ..RoadConfig::default() },
        vehicles: vehicles.collect(),
        ..ScenarioFile::default()
    };
    let mut world = World::new(&file.scenario(0).expect("valid")).expect("possible");
    for _ in 0..60 * steps_per_s {
        let _ = world.step(ABSENT, 1.0 / f64::from(steps_per_s));
    }
    world.vehicles().map(|vehicle| vehicle.s_m).collect()
}

#[test]
fn a_platoon_converges_with_the_order_of_the_scheme() {
    let exact_m = platoon_m(1280);
    let error_m = |steps_per_s: u32| {
        let positions_m = platoon_m(steps_per_s);
        positions_m.iter().zip(&exact_m).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    let errors_m = [10, 20, 40].map(error_m);
    // The acceleration of the step's start holds through the step: first order, which halves the error.
    for pair in errors_m.windows(2) {
        assert!((1.7..2.3).contains(&(pair[0] / pair[1])), "{errors_m:?}");
    }
    assert!(errors_m[1] < 0.2, "{errors_m:?} m at the usual step");
}

#[test]
fn the_ego_finds_a_safe_place_in_every_ordinary_scene() {
    for density in [4.0, 8.0, 14.0, 20.0, 28.0, 36.0] {
        for seed in 0..30 {
            let road = RoadConfig {
                topology: if seed % 2 == 0 { Topology::Ring } else { Topology::Open },
                adhesion: if seed % 3 == 0 { 0.4 } else { 0.85 },
                ..RoadConfig::default()
            };
            let traffic = TrafficConfig {
                density_veh_per_km_lane: density,
                density_spread_veh_per_km_lane: 2.0,
                truck_share: 0.2,
                ..TrafficConfig::default()
            };
            let scenario = ScenarioDistribution { road, traffic }.sample(seed).expect("fits");
            let world = World::new(&scenario).unwrap_or_else(|error| panic!("{density}, {seed}: {error}"));
            let (s_m, lane, _) = world.ego_start();
            for vehicle in world.vehicles().filter(|vehicle| vehicle.lane == lane || vehicle.target_lane == lane) {
                let gap_m = world.road().ahead_m(s_m, vehicle.s_m).abs() - 0.5 * (4.8 + vehicle.length_m);
                assert!(gap_m >= 1.0, "{gap_m} m at {density}, {seed}");
            }
        }
    }
}

#[test]
fn the_seed_moves_everything_that_is_drawn() {
    let distribution = ScenarioDistribution {
        traffic: TrafficConfig { density_spread_veh_per_km_lane: 4.0, truck_share: 0.3, ..TrafficConfig::default() },
        ..ScenarioDistribution::default()
    };
    let scenarios: Vec<_> = (0..40).map(|seed| distribution.sample(seed).expect("fits")).collect();
    let counts = scenarios.iter().map(|scenario| scenario.vehicles.len() / 3);
    let (fewest, most) = counts.fold((usize::MAX, 0), |(low, high), count| (low.min(count), high.max(count)));
    assert!((10..=12).contains(&fewest) && (16..=18).contains(&most), "{fewest} to {most} per lane");
    let lanes: Vec<u8> = scenarios.iter().map(|s| World::new(s).expect("possible").ego_start().1.0).collect();
    assert!((0..3).all(|lane| lanes.contains(&lane)));
    for vehicle in scenarios.iter().flat_map(|scenario| &scenario.vehicles) {
        assert!((19.0..27.0).contains(&vehicle.driver.desired_speed_mps));
        assert!((1.0..1.8).contains(&vehicle.driver.time_headway_s));
    }
}

/// Whether a driver stuck behind a standing truck cuts in 22 m before an ego that is 5 m/s faster.
fn cuts_in(courteous: bool) -> bool {
    let text = format!(
        r#"
name = "cut"
description = "one car, one truck"
traffic = {{ courteous = {courteous}, safe_decel_mps2 = 9.0, time_headway_s = {{ kind = "fixed", value = 0.1 }} }}
road = {{ topology = "open", lanes = 2 }}
vehicles = [
    {{ lane = 0, s_m = 100.0, speed_mps = 20.0, desired_speed_mps = 20.0, kind = "car" }},
    {{ lane = 0, s_m = 160.0, speed_mps = 10.0, desired_speed_mps = 10.0, kind = "truck" }},
]
"#
    );
    let file = ScenarioFile::from_toml(&text).expect("valid");
    let mut world = World::new(&file.scenario(0).expect("valid")).expect("possible");
    let mut body = ExternalBody { d_m: 3.75, speed_mps: 25.0, target_lane: LaneIndex(1), ..ABSENT };
    (0..80).any(|_| {
        body.s_m = world.vehicle(VehicleId(0)).expect("on the road").s_m - 22.0 - 4.8;
        body.speed_mps = world.vehicle(VehicleId(0)).expect("on the road").speed_mps + 5.0;
        world.set_ego(body);
        world.step(body, 0.05).lane_changes > 0
    })
}

#[test]
fn a_courteous_driver_grants_the_ego_its_reaction() {
    assert!(cuts_in(false));
    assert!(!cuts_in(true));
}
