//! The fast environment: a decision of random driving with its observation, and a new episode, in the tasks of highway-env's
//! `highway-fast-v0` (21 vehicles, 5 steps a decision) and `highway-v0` (51 vehicles, 15 steps).

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use lanecraft_drive::env::EnvError;
use lanecraft_drive::kinematic::{KinematicConfig, KinematicEnv, MetaAction};
use lanecraft_net::random::Stream;

use super::{BenchError, BenchRow, MEASURED};

pub(super) fn run(found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
    let mut large = KinematicConfig::default();
    (large.road.lanes, large.task.vehicles, large.task.duration_s) = (4, 50, 40.0);
    (large.task.simulation_hz, large.task.steps_per_decision) = (15.0, 15);
    for config in [KinematicConfig::default(), large] {
        let vehicles = config.task.vehicles + 1;
        let [step_us, new_us] = episodes(&Arc::new(config))?;
        found(BenchRow { bench: format!("kinematic/step/{vehicles}"), value: step_us, unit: "us" });
        found(BenchRow { bench: format!("kinematic/new/{vehicles}"), value: new_us, unit: "us" });
    }
    Ok(())
}

/// Mean time of a decision and of a start, us.
fn episodes(config: &Arc<KinematicConfig>) -> Result<[f64; 2], BenchError> {
    let mut observation = vec![0.0; config.task.observation.size()];
    let mut stream = Stream::new(0, "bench.kinematic");
    let (mut driving, mut starting) = (Duration::ZERO, Duration::ZERO);
    let (mut steps, mut starts) = (0_u32, 0_u32);
    while driving < MEASURED {
        let begun = Instant::now();
        let mut env = KinematicEnv::new(config, u64::from(starts)).map_err(EnvError::from)?;
        starting += begun.elapsed();
        let begun = Instant::now();
        while black_box(env.step(stream.below(MetaAction::ALL.len()))).is_ok() {
            env.observe(black_box(&mut observation));
        }
        driving += begun.elapsed();
        (steps, starts) = (steps + env.steps(), starts + 1);
    }
    Ok([1e6 * driving.as_secs_f64() / f64::from(steps), 1e6 * starting.as_secs_f64() / f64::from(starts)])
}
