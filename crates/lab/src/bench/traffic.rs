//! The human drivers alone: 4 straight lanes, lane changes and collision check on, 15 steps a second.
//!
//! All sizes are measured in turns, so that a change of the machine's load hits them alike. Besides the rate per second of time
//! there is one per second of processor time, which is steadier where other programs run, and which is compared with peers.

use std::hint::black_box;
use std::time::{Duration, Instant};

use lanecraft_drive::env::EnvError;
use lanecraft_drive::scenario::ScenarioDistribution;
use lanecraft_drive::traffic::World;
use rayon::prelude::*;

use super::{BenchError, BenchRow};
use crate::config::{RunConfig, SeedRole};

const STEP_S: f64 = 1.0 / 15.0;
const LANES: u8 = 4;
const SIZES: [u32; 5] = [50, 200, 1000, 10_000, 100_000];
/// The two sizes of [`SIZES`] whose rates make the flatness.
const FLAT: [usize; 2] = [0, 2];
const ROUNDS: usize = 5;
const ROUND: Duration = Duration::from_millis(200);
/// Independent worlds of the smallest size, stepped on one thread and on two.
const WORLDS: u64 = 64;
/// Steps that a thread takes with a world before the next one.
const STEPS_IN_A_ROW: u32 = 150;

pub(super) fn run(config: &RunConfig, found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
    rates(config, found)?;
    worlds(config, found)?;
    memory(config, found)
}

/// A ring of so many vehicles, `index` of its kind, at the configuration's density.
fn world(config: &RunConfig, vehicles: u32, index: u64) -> Result<World, BenchError> {
    let (mut road, traffic) = (config.environment.road.clone(), config.environment.traffic.clone());
    road.lanes = LANES;
    road.curvature.clear();
    // Each lane gets a whole number, so that up to two vehicles have to go again.
    let per_lane = vehicles.div_ceil(u32::from(LANES));
    road.length_m = 1000.0 * f64::from(per_lane) / traffic.density_veh_per_km_lane;
    let seed = SeedRole::Tuning.scenario_seed(0, index);
    let mut scenario = ScenarioDistribution { road, traffic }.sample(seed).map_err(EnvError::from)?;
    scenario.vehicles.truncate(vehicles as usize);
    Ok(World::new(&scenario).map_err(EnvError::from)?)
}

/// What a world did in all its rounds.
#[derive(Clone, Default)]
struct Course {
    /// Updates per second of each round: of time, of processor time.
    rates: [Vec<f64>; 2],
    steps: u64,
    lane_changes: u64,
}

impl Course {
    /// Steps `world` for a round.
    fn round(&mut self, world: &mut World) {
        let clock = Clock::start();
        let before = self.steps;
        while clock.passed() < ROUND {
            let events = black_box(world.step_alone(STEP_S));
            self.lane_changes += u64::from(events.lane_changes);
            self.steps += 1;
        }
        let updates = ((self.steps - before) * world.len() as u64) as f64;
        self.rates[0].push(updates / clock.passed().as_secs_f64());
        self.rates[1].push(updates / clock.computed().as_secs_f64());
    }
}

/// Time since its start, and what this thread has had of a processor meanwhile.
struct Clock {
    begun: Instant,
    computed: Option<Duration>,
}

impl Clock {
    fn start() -> Self {
        Self { begun: Instant::now(), computed: processor_time() }
    }

    fn passed(&self) -> Duration {
        self.begun.elapsed()
    }

    /// All of the time where the system does not tell.
    fn computed(&self) -> Duration {
        processor_time().zip(self.computed).map_or_else(|| self.passed(), |(end, start)| end.saturating_sub(start))
    }
}

/// Time that this thread has spent on a processor, if the system tells.
fn processor_time() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    text.split_whitespace().next()?.parse().ok().map(Duration::from_nanos)
}

fn rates(config: &RunConfig, found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
    let worlds: Result<Vec<World>, BenchError> = SIZES.iter().map(|&vehicles| world(config, vehicles, 0)).collect();
    let mut worlds = worlds?;
    let mut courses = vec![Course::default(); SIZES.len()];
    for _ in 0..ROUNDS {
        for (world, course) in worlds.iter_mut().zip(&mut courses) {
            course.round(world);
        }
    }
    for (course, vehicles) in courses.iter().zip(SIZES) {
        let bench = format!("traffic/idm-mobil/{vehicles}");
        let [time, processor] = course.rates.each_ref().map(|rates| median(rates));
        found(BenchRow { bench: bench.clone(), value: time, unit: "vehicle-updates/s" });
        found(BenchRow { bench: format!("{bench}/processor"), value: processor, unit: "vehicle-updates/CPU-s" });
        // Without lane changes the rate would be that of half the work.
        let minutes = course.steps as f64 * STEP_S / 60.0;
        let value = course.lane_changes as f64 / (minutes * f64::from(vehicles));
        found(BenchRow { bench: format!("{bench}/lane-changes"), value, unit: "per vehicle-minute" });
    }
    let [small, large] = FLAT.map(|size| &courses[size].rates[1]);
    let ratios: Vec<f64> = small.iter().zip(large).map(|(small, large)| large / small).collect();
    let bench = format!("traffic/flatness/{}-over-{}", SIZES[FLAT[1]], SIZES[FLAT[0]]);
    found(BenchRow { bench, value: median(&ratios), unit: "ratio" });
    Ok(())
}

/// Independent worlds on one thread and on two, in turns.
fn worlds(config: &RunConfig, found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
    let worlds: Result<Vec<World>, BenchError> = (0..WORLDS).map(|index| world(config, SIZES[0], index)).collect();
    let mut worlds = worlds?;
    let pools: Result<Vec<_>, _> =
        [1, 2].iter().map(|&threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build()).collect();
    let pools = pools?;
    let mut ratios = [Vec::new(), Vec::new()];
    for _ in 0..ROUNDS {
        let [one, two] = [0, 1].map(|pool: usize| pools[pool].install(|| rates_of_all(&mut worlds)));
        for (kind, ratios) in ratios.iter_mut().enumerate() {
            ratios.push(two[kind] / one[kind]);
        }
    }
    let bench = format!("traffic/worlds/{WORLDS}x{}/2-threads-over-1", SIZES[0]);
    let [time, processor] = ratios.each_ref().map(|ratios| median(ratios));
    found(BenchRow { bench: bench.clone(), value: time, unit: "ratio" });
    // 1 if the threads do not hinder each other, also where other programs take their processors.
    found(BenchRow { bench: format!("{bench}/processor"), value: processor, unit: "ratio per CPU-s" });
    Ok(())
}

/// Updates of all worlds together on the threads at hand, per second of time and of processor time.
fn rates_of_all(worlds: &mut [World]) -> [f64; 2] {
    let begun = Instant::now();
    let (mut updates, mut computed) = (0, Duration::ZERO);
    while begun.elapsed() < ROUND {
        let turn = worlds.par_iter_mut().map(|world| {
            let clock = Clock::start();
            for _ in 0..STEPS_IN_A_ROW {
                let _ = black_box(world.step_alone(STEP_S));
            }
            (world.len() * STEPS_IN_A_ROW as usize, clock.computed())
        });
        let turn = turn.reduce(|| (0, Duration::ZERO), |a, b| (a.0 + b.0, a.1 + b.1));
        (updates, computed) = (updates + turn.0, computed + turn.1);
    }
    [begun.elapsed(), computed].map(|time| updates as f64 / time.as_secs_f64())
}

/// Growth of the resident memory with each copy of the largest world, where the system tells.
fn memory(config: &RunConfig, found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
    let largest = world(config, SIZES[SIZES.len() - 1], 0)?;
    // The first copy fills what has been freed before.
    let mut copies = vec![largest.clone()];
    let Some(before) = resident_bytes() else { return Ok(()) };
    copies.extend((0..4).map(|_| largest.clone()));
    let Some(after) = resident_bytes() else { return Ok(()) };
    let vehicles: usize = black_box(&copies)[1..].iter().map(World::len).sum();
    let value = after.saturating_sub(before) as f64 / vehicles as f64;
    found(BenchRow { bench: format!("traffic/memory/{}", largest.len()), value, unit: "bytes/vehicle" });
    Ok(())
}

fn resident_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(1024 * kilobytes)
}

/// The middle one of an odd number of values.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}
