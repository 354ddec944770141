//! The traffic as a data structure: vehicles that come and go, commands, obstacles.

use std::sync::Arc;

use lanecraft_drive::road::{LaneIndex, RoadConfig, Topology};
use lanecraft_drive::scenario::{Scenario, ScenarioDistribution, ScenarioFile, TrafficConfig, VehicleSpec};
use lanecraft_drive::scene::VehicleId;
use lanecraft_drive::traffic::{Command, ExternalBody, Obstacle, TrackPoint, Vehicle, World};
use lanecraft_net::random::Stream;

const DT_S: f64 = 0.05;

fn scenario(topology: Topology, seed: u64) -> Scenario {
    let road = RoadConfig { topology, lanes: 4, ..RoadConfig::default() };
    let traffic = TrafficConfig { truck_share: 0.2, ..TrafficConfig::default() };
    ScenarioDistribution { road, traffic }.sample(seed).expect("fits")
}

fn alone(topology: &str, vehicles: &[(u8, f64, f64)]) -> Scenario {
    let vehicles = vehicles.iter().map(|(lane, s_m, speed_mps)| {
        format!(
            "{{ lane = {lane}, s_m = {s_m:?}, speed_mps = {speed_mps:?}, desired_speed_mps = 25.0, kind = \"car\" }},"
        )
    });
    let vehicles: String = vehicles.collect();
    let text =
        format!("name = \"n\"\ndescription = \"d\"\nroad = {{ topology = \"{topology}\" }}\nvehicles = [{vehicles}]");
    ScenarioFile::from_toml(&text).and_then(|file| file.scenario(0)).expect("valid")
}

fn gap_m(world: &World, follower: &Vehicle, leader: &Vehicle) -> f64 {
    world.road().ahead_m(follower.s_m, leader.s_m) - 0.5 * (follower.length_m + leader.length_m)
}

fn id_of(world: &World, id: u32) -> Vehicle {
    world.vehicle(VehicleId(id)).expect("on the road")
}

/// A minute in which vehicles enter wherever there is room and leave at random: ids stay, nobody touches anybody.
fn come_and_go(topology: Topology, seed: u64) -> (u64, usize) {
    let scenario = scenario(topology, seed);
    let mut world = World::new(&scenario).expect("possible");
    let mut stream = Stream::new(seed, "test.flow");
    let mut expected: Vec<VehicleId> = world.vehicles().map(|vehicle| vehicle.id).collect();
    let mut entered = 0;
    for _ in 0..1200 {
        let spec = VehicleSpec {
            s_m: stream.range(0.0, 1000.0),
            lane: LaneIndex(stream.below(4) as u8),
            ..scenario.vehicles[stream.below(scenario.vehicles.len())]
        };
        if world.has_room_for(&spec) {
            let id = world.insert(&spec, DT_S);
            assert!(expected.last().is_none_or(|last| *last < id), "{id:?} was another's");
            expected.push(id);
            entered += 1;
        }
        if !expected.is_empty() && stream.bernoulli(0.5) {
            let left = expected.remove(stream.below(expected.len()));
            assert!(world.remove(left) && !world.remove(left));
            assert_eq!(world.vehicle(left), None);
        }
        assert_eq!(world.step_alone(DT_S).hdv_overlaps, 0);
        assert!(world.vehicles().map(|vehicle| vehicle.id).eq(expected.iter().copied()));
        assert!(world.vehicles().all(|vehicle| world.vehicle(vehicle.id) == Some(vehicle)));
    }
    (world.digest(), entered)
}

#[test]
fn vehicles_come_and_go_and_nobody_touches_anybody() {
    for topology in [Topology::Ring, Topology::Open] {
        for seed in 0..4 {
            let (digest, entered) = come_and_go(topology, seed);
            assert!(entered > 300, "{entered}");
            assert_eq!((digest, entered), come_and_go(topology, seed));
        }
    }
}

#[test]
fn the_near_ones_are_those_within_range() {
    for topology in [Topology::Ring, Topology::Open] {
        let world = World::new(&scenario(topology, 9)).expect("possible");
        for (s_m, range_m) in [(3.0, 100.0), (500.0, 100.0), (995.0, 30.0), (250.0, 600.0), (1200.0, 150.0)] {
            let distance_m = |vehicle: &Vehicle| world.road().ahead_m(s_m, vehicle.s_m).abs();
            let mut near: Vec<_> = world.vehicles_near(s_m, range_m).map(|vehicle| vehicle.id).collect();
            near.sort();
            let expected = world.vehicles().filter(|vehicle| distance_m(vehicle) <= range_m);
            assert_eq!(near, expected.map(|vehicle| vehicle.id).collect::<Vec<_>>(), "{s_m} ± {range_m}");
        }
    }
}

#[test]
fn a_command_stands_in_the_place_of_the_will_for_as_long_as_it_says() {
    let mut world = World::new(&alone("ring", &[(1, 100.0, 20.0)])).expect("possible");
    let command = |accel_mps2| Command::Accelerate { accel_mps2, steps: 10 };
    world.command(VehicleId(0), command(-2.0));
    for _ in 0..10 {
        let _ = world.step_alone(DT_S);
        assert!(world.is_commanded(VehicleId(0)));
        assert_eq!(id_of(&world, 0).accel_mps2, -2.0);
    }
    let _ = world.step_alone(DT_S);
    assert!(!world.is_commanded(VehicleId(0)) && id_of(&world, 0).accel_mps2 > 0.0);
    // Nobody brakes harder than the vehicle can.
    world.command(VehicleId(0), command(-50.0));
    let _ = world.step_alone(DT_S);
    assert_eq!(id_of(&world, 0).accel_mps2, -7.0);
    world.command(VehicleId(7), command(1.0));
    assert!(!world.is_commanded(VehicleId(7)));
}

#[test]
fn a_recorded_track_is_followed_and_others_keep_behind_it() {
    let mut world = World::new(&alone("open", &[(1, 100.0, 20.0), (1, 160.0, 20.0)])).expect("possible");
    // Brakes from 20 m/s to 5 m/s at 3 m/s², then crawls on.
    let mut points = Vec::new();
    let (mut s_m, mut speed_mps) = (160.0, 20.0_f64);
    for _ in 0..400 {
        let next_mps = (speed_mps - 3.0 * DT_S).max(5.0);
        s_m += 0.5 * (speed_mps + next_mps) * DT_S;
        let accel_mps2 = (next_mps - speed_mps) / DT_S;
        speed_mps = next_mps;
        let lane = LaneIndex(1);
        points.push(TrackPoint {
            s_m,
            d_m: 3.6,
            speed_mps,
            lateral_speed_mps: 0.0,
            accel_mps2,
            lane,
            target_lane: lane,
        });
    }
    let points: Arc<[TrackPoint]> = points.into();
    world.command(VehicleId(1), Command::Follow(Arc::clone(&points)));
    for point in points.iter() {
        assert_eq!(world.step_alone(DT_S).hdv_overlaps, 0);
        let recorded = id_of(&world, 1);
        assert_eq!((recorded.s_m, recorded.d_m, recorded.speed_mps), (point.s_m, point.d_m, point.speed_mps));
    }
    let _ = world.step_alone(DT_S);
    let released = id_of(&world, 1);
    assert!(released.accel_mps2 > 0.0 && released.lane == released.target_lane, "it drives itself again: {released:?}");
}

#[test]
fn a_commanded_lane_change_ends_in_the_middle_of_the_lane() {
    let mut world = World::new(&alone("ring", &[(1, 100.0, 25.0)])).expect("possible");
    let change = |world: &mut World, lane| world.change_lane(VehicleId(0), LaneIndex(lane), DT_S);
    assert!(!change(&mut world, 1) && !change(&mut world, 3));
    assert!(change(&mut world, 2) && !change(&mut world, 1));
    for _ in 0..60 {
        assert_eq!(id_of(&world, 0).target_lane, LaneIndex(2));
        let _ = world.step_alone(DT_S);
    }
    let arrived = id_of(&world, 0);
    assert_eq!((arrived.lane, arrived.d_m, arrived.lateral_speed_mps), (LaneIndex(2), 7.5, 0.0));
}

#[test]
fn everybody_stops_before_an_obstacle() {
    for topology in ["ring", "open"] {
        let mut world = World::new(&alone(topology, &[(0, 700.0, 20.0), (0, 740.0, 20.0)])).expect("possible");
        let end_m = if topology == "ring" { 150.0 } else { 1150.0 };
        // All lanes end there, and there is nowhere to go.
        world.set_obstacles((0..3).map(|lane| Obstacle { lane: LaneIndex(lane), s_m: end_m }).collect());
        for _ in 0..2400 {
            assert_eq!(world.step_alone(DT_S).hdv_overlaps, 0);
        }
        for vehicle in world.vehicles() {
            let left_m = world.road().ahead_m(vehicle.s_m, end_m) - 0.5 * vehicle.length_m;
            // The safe distance leaves 1 m, the wish 2 m.
            assert!(vehicle.speed_mps < 0.1 && (0.9..12.0).contains(&left_m), "{left_m} m: {vehicle:?}");
        }
    }
}

#[test]
fn an_ego_in_the_road_of_many_is_the_leader_of_those_behind_it_only() {
    let mut world =
        World::new(&alone("ring", &[(0, 100.0, 20.0), (0, 50.0, 20.0), (1, 100.0, 20.0)])).expect("possible");
    let mut body = ExternalBody {
        s_m: 180.0,
        d_m: 0.0,
        heading_rad: 0.0,
        speed_mps: 10.0,
        accel_mps2: 0.0,
        length_m: 4.8,
        width_m: 1.9,
        target_lane: LaneIndex(0),
    };
    world.set_ego(body);
    for _ in 0..100 {
        body.s_m += body.speed_mps * DT_S;
        let events = world.step(body, DT_S);
        assert_eq!((events.collision, events.hdv_overlaps), (None, 0));
        let (first, second) = (id_of(&world, 0), id_of(&world, 1));
        assert!(first.target_lane != LaneIndex(0) || gap_m(&world, &second, &first) > 0.0);
    }
    assert!(id_of(&world, 2).speed_mps > 20.0);
}
