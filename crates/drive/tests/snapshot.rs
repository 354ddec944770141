//! A stored episode goes on with the same bits, whatever is under way in it, and nothing else is ever taken for one.
//!
//! What is compared at the end is not the physical state alone but every stored bit, warm starts included.

use std::collections::BTreeMap;
use std::sync::Arc;

use lanecraft_drive::control::TerminalCost;
use lanecraft_drive::env::{Config, Env, Order, StepOutcome};
use lanecraft_drive::predict::lstm::LstmModel;
use lanecraft_drive::predict::{ModelSource, PredictionConfig, Predictor};
use lanecraft_drive::road::{LaneIndex, RoadConfig, Topology};
use lanecraft_drive::scenario::{EgoStart, RecordedTraffic, Recording, ScenarioFile, Track, TrackSample};
use lanecraft_drive::snapshot::{SNAPSHOT_SCHEMA, Snapshot, SnapshotError};
use lanecraft_drive::traffic::World;
use lanecraft_drive::vehicle::{Contact, ControlInput, ExternalPlant, Plant, VehicleState};
use lanecraft_net::Lstm;
use lanecraft_net::random::Stream;

/// Ticks of each episode.
const TICKS: u32 = 24;

/// Everything that can be switched on, in turn.
fn configs() -> Vec<Config> {
    let changed = |change: &dyn Fn(&mut Config)| {
        let mut config = Config::default();
        config.env.episode_s = 0.5 * f64::from(TICKS);
        change(&mut config);
        config
    };
    let scenario = |text: &str| changed(&|config| text.clone_into(&mut config.env.scenario));
    vec![
        changed(&|_| ()),
        changed(&everything),
        changed(&|config| config.env.order = Order::DecideFirst),
        changed(&|config| config.prediction = talkative()),
        scenario(include_str!("../../../scenarios/merge.toml")),
        scenario(include_str!("../../../scenarios/stress.toml")),
        scenario(include_str!("../../../scenarios/cut-in.toml")),
        scenario(include_str!("../../../scenarios/emergency-brake.toml")),
        scenario(include_str!("../../../scenarios/rush-hour.toml")),
        scenario(include_str!("../../../scenarios/wet-patch.toml")),
    ]
}

/// A recurrent predictor of weights that no file holds: what it says depends on all that it remembers.
fn talkative() -> PredictionConfig {
    let mut stream = Stream::new(9, "snapshot.model");
    let mut network = Lstm::new(LstmModel::shape(6), &mut stream).expect("a shape");
    network.parameters_mut().iter_mut().for_each(|parameter| *parameter += 0.3 * stream.normal() as f32);
    let mut model = ModelSource::from("in memory".to_owned());
    model.attach(Arc::new(LstmModel::new(network).expect("the predictor's shape")));
    PredictionConfig { predictor: Predictor::Lstm, model }
}

fn everything(config: &mut Config) {
    (config.vehicle.steer_delay_s, config.vehicle.drive_delay_s) = (0.12, 0.1);
    (config.control.observer, config.control.delay_compensation) = (true, true);
    config.control.terminal_cost = TerminalCost::Riccati;
    config.plant.mass_factor = 1.1;
    config.prediction.predictor = Predictor::IdmRollout;
    (config.perception.position_noise_m, config.perception.speed_noise_mps) = (0.3, 0.2);
    config.traffic.stress_brake_rate_hz = 0.05;
}

/// What a tick shows of itself: digest, outcome, and the observation after it.
type Seen = (u64, StepOutcome, Vec<f32>);

/// Takes an allowed action that depends on nothing but seed and tick.
fn step(env: &mut Env, seed: u64) -> Seen {
    let mut stream = Stream::keyed(seed, "snapshot.drive", u64::from(env.episode().ticks), 0);
    let allowed: Vec<usize> = (0..32).filter(|&action| env.mask().allows(action)).collect();
    let outcome = env.step(allowed[stream.below(allowed.len())]).expect("allowed");
    let mut observation = vec![0.0; env.config().observation.size()];
    env.observe(&mut observation);
    (env.digest(), outcome, observation)
}

fn bytes(env: &Env) -> Vec<u8> {
    env.snapshot().expect("can be stored").as_bytes().to_vec()
}

fn restored(bytes: &[u8]) -> Env {
    Env::restore(&Snapshot::from_bytes(bytes.to_vec()).expect("whole")).expect("the same version")
}

/// Drives an episode, stores it at random ticks and holds what comes of each snapshot against it; returns how many of them fell into a
/// lane change.
fn cut_at_random(config: &Arc<Config>, seed: u64, cuts: u32) -> usize {
    let mut env = Env::new(config, seed).expect("can be built");
    let mut stream = Stream::new(seed, "snapshot.cuts");
    let wanted: Vec<u32> = (0..cuts).map(|_| stream.below(TICKS as usize) as u32).collect();
    let (mut stored, mut seen, mut changing) = (BTreeMap::new(), Vec::new(), 0);
    while !env.is_over() {
        let tick = env.episode().ticks;
        if wanted.contains(&tick) {
            stored.insert(tick, bytes(&env));
            changing += usize::from(env.driver().change().is_some());
        }
        seen.push(step(&mut env, seed));
    }
    let end = bytes(&env);
    for (tick, snapshot) in stored {
        let mut again = restored(&snapshot);
        assert_eq!(bytes(&again), snapshot, "seed {seed}, tick {tick}");
        for before in &seen[tick as usize..] {
            assert_eq!(step(&mut again, seed), *before, "seed {seed}, stored at tick {tick}");
        }
        assert!(again.is_over() && bytes(&again) == end, "seed {seed}, stored at tick {tick}");
    }
    changing
}

#[test]
fn a_stored_episode_goes_on_bit_for_bit_whatever_is_under_way() {
    let (episodes, cuts) = if std::env::var_os("LANECRAFT_LONG").is_some() { (14, 12) } else { (1, 16) };
    let cut = |config| {
        let config = Arc::new(config);
        (0..episodes).map(|seed| cut_at_random(&config, seed, cuts)).sum::<usize>()
    };
    let changing: usize = configs().into_iter().map(cut).sum();
    assert!(changing >= 5, "only {changing} snapshots fell into a lane change");
}

/// A recorded car behind the ego, which follows it once it is ahead.
fn recorded() -> World {
    let config = RecordedTraffic {
        file: "none".to_owned(),
        site: "none".to_owned(),
        start_s: 0.0,
        s_offset_m: 0.0,
        d_offset_m: 0.0,
        reactive: true,
    };
    let sample =
        |k: u32| TrackSample { s_m: 40.0 + 2.0 * f64::from(k), d_m: 3.75, speed_mps: 20.0, lateral_speed_mps: 0.0 };
    let track = Track { length_m: 4.5, width_m: 1.8, first_s: 0.0, samples: (0..=100).map(sample).collect() };
    let scene = ScenarioFile {
        road: RoadConfig { topology: Topology::Open, ..RoadConfig::default() },
        recording: Some(config),
        ego: EgoStart::At { lane: LaneIndex(1), s_m: 500.0, speed_mps: 20.0 },
        ..ScenarioFile::default()
    };
    let recording = Arc::new(Recording { period_s: 0.1, tracks: vec![track] });
    World::new(&scene.scenario_with(recording, 1).expect("valid")).expect("possible")
}

/// The traffic of a scenario file.
fn traffic(text: &str) -> World {
    let file = ScenarioFile::from_toml(text).expect("valid");
    World::new(&file.scenario(3).expect("possible")).expect("safe")
}

#[test]
fn a_stored_world_goes_on_bit_for_bit_with_its_flows_and_recordings() {
    let merge = include_str!("../../../scenarios/merge.toml");
    let jam = include_str!("../../../scenarios/phantom-jam.toml");
    for mut world in [recorded(), traffic(merge), traffic(jam)] {
        for _ in 0..12 {
            let snapshot = world.snapshot().expect("can be stored");
            let mut again = World::restore(&snapshot).expect("whole");
            assert!(again == world && again.snapshot().expect("can be stored") == snapshot);
            for _ in 0..15 {
                assert_eq!(again.step_alone(0.05), world.step_alone(0.05));
            }
            assert!(again == world);
        }
    }
}

fn first_bytes() -> Vec<u8> {
    bytes(&Env::new(&Arc::new(Config::default()), 1).expect("can be built"))
}

fn read(bytes: &[u8]) -> Result<Snapshot, SnapshotError> {
    Snapshot::from_bytes(bytes.to_vec())
}

#[test]
fn a_changed_or_shortened_snapshot_is_refused() {
    let whole = first_bytes();
    let mut changed = whole.clone();
    for bit in (0..8 * whole.len()).step_by(997).chain(0..8 * 32) {
        changed[bit / 8] ^= 1 << (bit % 8);
        assert!(read(&changed).is_err(), "bit {bit}");
        changed[bit / 8] = whole[bit / 8];
    }
    for length in (0..whole.len()).step_by(499).chain(0..64) {
        assert!(matches!(read(&whole[..length]), Err(SnapshotError::Length { .. })), "{length} bytes");
    }
    assert!(matches!(read(&[&whole[..], &[0]].concat()), Err(SnapshotError::Length { .. })));
}

#[test]
fn what_is_no_snapshot_of_this_version_and_kind_is_refused_by_name() {
    for foreign in [&b"[env]\nepisode_s = 40.0\n"[..], b"PK\x03\x04", &[0; 64]] {
        assert!(matches!(read(foreign), Err(SnapshotError::Foreign)));
    }
    let mut newer = first_bytes();
    newer[8..12].copy_from_slice(&(SNAPSHOT_SCHEMA + 1).to_le_bytes());
    let refusal = read(&newer).expect_err("it is newer");
    assert!(matches!(refusal, SnapshotError::Version { found } if found == SNAPSHOT_SCHEMA + 1));
    assert!(refusal.to_string().contains(&format!("version {}", SNAPSHOT_SCHEMA + 1)));
    let episode = read(&first_bytes()).expect("whole");
    assert!(matches!(World::restore(&episode), Err(SnapshotError::Kind { .. })));
}

/// A car that stays where it is.
struct Parked;

impl ExternalPlant for Parked {
    fn step(&mut self, state: &VehicleState, _: &ControlInput, _: &Contact, _: f64) -> VehicleState {
        *state
    }

    fn clone_box(&self) -> Box<dyn ExternalPlant> {
        Box::new(Self)
    }
}

#[test]
fn an_external_plant_is_refused() {
    let mut env = Env::new(&Arc::new(Config::default()), 1).expect("can be built");
    env.set_plant(Plant::External(Box::new(Parked)));
    assert!(matches!(env.snapshot(), Err(SnapshotError::ExternalPlant)));
}
