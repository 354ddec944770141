//! What happens in a scenario after its start: events do what they say when they say, flows bring as many as they say, recorded
//! vehicles stay on their tracks, and among human drivers nobody touches anybody through any of it.

use std::sync::Arc;

use lanecraft_drive::road::{LaneIndex, RoadConfig, Topology};
use lanecraft_drive::scenario::{
    Action, EgoStart, Event, Flow, RecordedTraffic, Recording, ScenarioFile, Track, TrackSample, TrafficConfig,
    Trigger, VehicleKind, VehicleStart,
};
use lanecraft_drive::scene::VehicleId;
use lanecraft_drive::traffic::{ExternalBody, Vehicle, World};

const DT_S: f64 = 0.05;

fn car(name: &str, lane: u8, s_m: f64, speed_mps: f64) -> VehicleStart {
    VehicleStart {
        name: name.to_owned(),
        lane: LaneIndex(lane),
        s_m,
        speed_mps,
        desired_speed_mps: speed_mps.max(1.0),
        kind: VehicleKind::Car,
    }
}

fn event(vehicle: &str, trigger: Trigger, action: Action) -> Event {
    Event { vehicle: vehicle.to_owned(), trigger, action }
}

/// Two lanes on an open road, on which nobody changes lane on his own.
fn file(vehicles: Vec<VehicleStart>, events: Vec<Event>) -> ScenarioFile {
    ScenarioFile {
        road: RoadConfig { lanes: 2, topology: Topology::Open, ..RoadConfig::default() },
        traffic: TrafficConfig { accel_gain_threshold_mps2: 100.0, ..TrafficConfig::default() },
        ego: EgoStart::At { lane: LaneIndex(1), s_m: 0.0, speed_mps: 20.0 },
        vehicles,
        events,
        ..ScenarioFile::default()
    }
}

fn ego(s_m: f64, speed_mps: f64) -> ExternalBody {
    ExternalBody {
        s_m,
        d_m: 3.75,
        heading_rad: 0.0,
        speed_mps,
        accel_mps2: 0.0,
        length_m: 4.8,
        width_m: 1.9,
        target_lane: LaneIndex(1),
    }
}

/// Drives with an ego at constant speed; what vehicle 0 was like after each step.
fn drive(file: &ScenarioFile, seconds: f64, speed_mps: f64) -> Vec<Vehicle> {
    let mut world = World::new(&file.scenario(1).expect("valid")).expect("possible");
    world.set_ego(ego(0.0, speed_mps));
    let steps = (seconds / DT_S).round() as u32;
    let step = |k: u32| {
        let events = world.step(ego(speed_mps * DT_S * f64::from(k), speed_mps), DT_S);
        assert_eq!(events.hdv_overlaps, 0, "step {k}");
        world.vehicle(VehicleId(0)).expect("it stays")
    };
    (1..=steps).map(step).collect()
}

fn at(states: &[Vehicle], time_s: f64) -> Vehicle {
    states[(time_s / DT_S).round() as usize - 1]
}

#[test]
fn a_brake_begins_at_its_time_lasts_and_ends() {
    let brake = Action::Brake { decel_mps2: 4.0, duration_s: 2.0 };
    let states = drive(
        &file(vec![car("a", 0, 50.0, 20.0)], vec![event("a", Trigger::AtTime { time_s: 3.0 }, brake)]),
        8.0,
        20.0,
    );
    assert!((at(&states, 3.0).speed_mps - 20.0).abs() < 1e-9);
    assert!((at(&states, 4.0).speed_mps - 16.0).abs() < 1e-9);
    assert!((at(&states, 5.0).speed_mps - 12.0).abs() < 1e-9);
    assert!(at(&states, 6.0).speed_mps > 12.5, "it drives on");
}

/// A brake that is weaker than what the vehicle ahead asks for does not keep anybody from braking harder.
#[test]
fn a_gentle_brake_behind_a_standing_car_stays_safe() {
    let gentle = Action::Brake { decel_mps2: 0.1, duration_s: 60.0 };
    let stop = Action::Stop { decel_mps2: 5.0 };
    let vehicles = vec![car("a", 0, 0.0, 25.0), car("b", 0, 120.0, 0.0)];
    let events =
        vec![event("a", Trigger::AtTime { time_s: 0.0 }, gentle), event("b", Trigger::AtTime { time_s: 0.0 }, stop)];
    let states = drive(&file(vehicles, events), 20.0, 20.0);
    assert!(at(&states, 20.0).speed_mps < 0.1);
}

#[test]
fn a_breakdown_stays_where_it_stops() {
    let stop = Action::Stop { decel_mps2: 5.0 };
    let states = drive(
        &file(vec![car("a", 0, 50.0, 20.0)], vec![event("a", Trigger::AtTime { time_s: 1.0 }, stop)]),
        60.0,
        20.0,
    );
    // v²/2a after 1 s at 20 m/s.
    assert!((at(&states, 60.0).s_m - (50.0 + 20.0 + 40.0)).abs() < 1e-6);
    assert_eq!(at(&states, 60.0).speed_mps, 0.0);
}

#[test]
fn another_desired_speed_is_reached() {
    let faster = Action::SetSpeed { speed_mps: 26.0 };
    let states = drive(
        &file(vec![car("a", 0, 50.0, 20.0)], vec![event("a", Trigger::AtTime { time_s: 1.0 }, faster)]),
        60.0,
        20.0,
    );
    assert!((at(&states, 1.0).speed_mps - 20.0).abs() < 1e-9);
    assert!((at(&states, 60.0).speed_mps - 26.0).abs() < 0.2);
}

/// The ego at 25 m/s comes up behind a car at 20 m/s: 5 m/s of approach tell when each trigger must be met.
#[test]
fn triggers_are_met_when_the_ego_is_where_they_say() {
    let cases = [
        // 100 m between the centers.
        (Trigger::EgoWithin { distance_m: 40.0 }, 12.0),
        // 40 m are 1.6 s at 25 m/s, and the cars are 4.8 m long.
        (Trigger::TimeGap { time_gap_s: 1.6 }, (100.0 - 4.8 - 40.0) / 5.0),
        (Trigger::EgoReaches { s_m: 250.0 }, 10.0),
    ];
    for (trigger, expected_s) in cases {
        let stop = Action::Brake { decel_mps2: 5.0, duration_s: 1.0 };
        // The car drives beside the ego's lane, so that nothing else makes it brake.
        let states = drive(&file(vec![car("a", 0, 100.0, 20.0)], vec![event("a", trigger, stop)]), 20.0, 25.0);
        let begins = states.iter().position(|state| state.accel_mps2 < -1.0).expect("it brakes") as f64 * DT_S;
        assert!(
            (begins - expected_s).abs() <= 2.0 * DT_S,
            "{trigger:?} is met at {begins} s instead of {expected_s} s"
        );
    }
}

#[test]
fn a_forced_change_waits_for_human_drivers_but_not_for_the_ego() {
    let begins = |courteous, beside: Vec<VehicleStart>| {
        let change = Action::ChangeLane { lane: LaneIndex(1), courteous };
        let vehicles = [car("a", 0, 20.0, 20.0)].into_iter().chain(beside).collect();
        let mut scene = file(vehicles, vec![event("a", Trigger::AtTime { time_s: 1.0 }, change)]);
        scene.ego = EgoStart::At { lane: LaneIndex(1), s_m: 0.0, speed_mps: 20.0 };
        drive(&scene, 8.0, 20.0).iter().position(|state| state.target_lane == LaneIndex(1))
    };
    let free = begins(false, Vec::new()).expect("the ego does not keep it");
    assert!((free as f64 * DT_S - 1.0).abs() < 2.0 * DT_S);
    // 15 m before an ego of the same speed is safe by the law; beside another driver there is no room at all.
    assert_eq!(begins(false, vec![car("", 1, 22.0, 20.0)]), None);
    assert!(begins(true, Vec::new()).is_some());
}

fn flow(inflow_veh_per_h: f64) -> ScenarioFile {
    let flows = vec![Flow { lane: LaneIndex(0), inflow_veh_per_h, enter_s_m: 0.0 }];
    ScenarioFile {
        traffic: TrafficConfig { density_veh_per_km_lane: 1.0, warm_up_s: 0.0, ..TrafficConfig::default() },
        flows,
        ..file(Vec::new(), Vec::new())
    }
}

/// Vehicles that have entered and left in `seconds` without an ego, and the largest position of any.
fn pass(file: &ScenarioFile, seconds: f64) -> (u32, f64) {
    let mut scene = file.clone();
    scene.ego = EgoStart::At { lane: LaneIndex(1), s_m: 900.0, speed_mps: 20.0 };
    let mut world = World::new(&scene.scenario(3).expect("valid")).expect("possible");
    let (mut highest, mut last_m) = (0, 0.0_f64);
    for _ in 0..(seconds / DT_S) as u32 {
        assert_eq!(world.step_alone(DT_S).hdv_overlaps, 0);
        highest = world.vehicles().map(|vehicle| vehicle.id.0).fold(highest, u32::max);
        last_m = world.vehicles().map(|vehicle| vehicle.s_m).fold(last_m, f64::max);
    }
    (highest + 1, last_m)
}

#[test]
fn a_flow_brings_as_many_as_it_says_and_everybody_leaves_at_the_end() {
    let seconds = 1800.0;
    let (entered, last_m) = pass(&flow(720.0), seconds);
    // Two of the density stand there at the start; a Poisson count has its mean as variance: four deviations.
    let expected = 720.0 * seconds / 3600.0 + 2.0;
    assert!((f64::from(entered) - expected).abs() < 4.0 * expected.sqrt(), "{entered} instead of {expected}");
    // A step of 27 m/s past the end at most.
    assert!(last_m < 1000.0 + 2.0, "{last_m}");
}

#[test]
fn who_finds_no_room_waits_outside() {
    // More than a lane can take, which is about 1800 in an hour at these headways.
    let (entered, _) = pass(&flow(3600.0), 600.0);
    assert!((150..450).contains(&entered), "{entered}");
}

#[test]
fn ranges_draw_the_same_numbers_for_the_same_seed_within_their_ends() {
    let text = "name = \"r\"\ndescription = \"d\"\n[ranges]\nroad.adhesion = [0.3, 0.9]\nroad.lanes = [2, 4]\n";
    let file = ScenarioFile::from_toml(text).expect("valid");
    let draw = |seed| {
        let scenario = file.scenario(seed).expect("possible");
        (scenario.road.adhesion(), scenario.road.config().lanes)
    };
    let drawn: Vec<(f64, u8)> = (0..50).map(draw).collect();
    assert_eq!(drawn, (0..50).map(draw).collect::<Vec<_>>());
    assert!(drawn.iter().all(|(adhesion, _)| (0.3..0.9).contains(adhesion)));
    for lanes in 2..=4 {
        assert!(drawn.iter().any(|drawn| drawn.1 == lanes), "{lanes} lanes are never drawn");
    }
    let spread = drawn.iter().map(|drawn| drawn.0).fold(f64::INFINITY, f64::min);
    assert!(spread < 0.4, "the whole range is used");
}

/// One recorded car at constant speed, 60 m behind the ego's start, in the ego's lane.
fn recorded(reactive: bool) -> World {
    let config = RecordedTraffic {
        file: "none".to_owned(),
        site: "none".to_owned(),
        start_s: 0.0,
        s_offset_m: 0.0,
        d_offset_m: 0.0,
        reactive,
    };
    let sample =
        |k: u32| TrackSample { s_m: 40.0 + 2.0 * f64::from(k), d_m: 3.75, speed_mps: 20.0, lateral_speed_mps: 0.0 };
    let track = Track { length_m: 4.5, width_m: 1.8, first_s: 0.0, samples: (0..=100).map(sample).collect() };
    let scene = ScenarioFile {
        recording: Some(config),
        ego: EgoStart::At { lane: LaneIndex(1), s_m: 100.0, speed_mps: 20.0 },
        ..file(Vec::new(), Vec::new())
    };
    let recording = Arc::new(Recording { period_s: 0.1, tracks: vec![track] });
    let mut world = World::new(&scene.scenario_with(recording, 1).expect("valid")).expect("possible");
    world.set_ego(ego(100.0, 20.0));
    world
}

/// The ego brakes with 4 m/s² to a standstill at 150 m.
fn brake_before(world: &mut World) -> bool {
    (1..=190).any(|k| {
        let time_s = DT_S * f64::from(k);
        let moving_s = time_s.min(5.0);
        let body = ego(100.0 + 20.0 * moving_s - 2.0 * moving_s * moving_s, 20.0 - 4.0 * moving_s);
        world.step(body, DT_S).collision.is_some()
    })
}

#[test]
fn a_recorded_vehicle_drives_into_the_ego_unless_it_reacts() {
    assert!(brake_before(&mut recorded(false)));
    let mut world = recorded(true);
    assert!(!brake_before(&mut world));
    assert_eq!(world.len(), 1, "who left the track stays on the road");
}

#[test]
fn a_copy_of_a_world_with_a_script_goes_on_bit_for_bit() {
    let mut file = flow(1200.0);
    file.ego = EgoStart::At { lane: LaneIndex(1), s_m: 900.0, speed_mps: 20.0 };
    let mut world = World::new(&file.scenario(5).expect("valid")).expect("possible");
    for _ in 0..400 {
        let _ = world.step_alone(DT_S);
    }
    let mut copy = world.clone();
    for _ in 0..400 {
        let _ = (world.step_alone(DT_S), copy.step_alone(DT_S));
        assert_eq!(world.digest(), copy.digest());
    }
}
