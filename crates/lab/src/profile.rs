//! Where the time of the closed loop goes.

use std::sync::Arc;
use std::time::{Duration, Instant};

use lanecraft_drive::driver::Part;
use lanecraft_drive::env::{Config, Env};

use crate::evaluate::EvaluateError;
use crate::policy::{Pilot, Policy};

/// Time spent in each part of the loop, on one core.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Profile {
    /// Ticks driven.
    pub ticks: u32,
    /// Control steps driven.
    pub control_steps: u64,
    /// Vehicles beside the ego car.
    pub vehicles: usize,
    /// Time by part, in the order of [`Part::ALL`].
    pub parts: [Duration; Part::ALL.len()],
    /// Time in the policy.
    pub policy: Duration,
}

impl Profile {
    /// All of it.
    pub fn total(&self) -> Duration {
        self.parts.iter().sum::<Duration>() + self.policy
    }

    /// The parts and the policy with their names.
    pub fn rows(&self) -> impl Iterator<Item = (&'static str, Duration)> + '_ {
        let parts = Part::ALL.into_iter().map(Part::name).zip(self.parts);
        parts.chain([("decision", self.policy)])
    }
}

/// Drives the scenarios of `seeds` with a clock in hand.
pub fn profile(
    policy: &Policy,
    config: &Arc<Config>,
    seeds: impl IntoIterator<Item = u64>,
) -> Result<Profile, EvaluateError> {
    let mut profile = Profile::default();
    let mut pilot = Pilot::new(policy);
    for seed in seeds {
        let mut env = Env::new(config, seed)?;
        profile.vehicles = env.world().len();
        while !env.is_over() {
            let mut last = Instant::now();
            let fail = |source| EvaluateError::Act { policy: policy.name(), source };
            let action = pilot.act(&env, seed).map_err(fail)?;
            let mut lap = |slot: &mut Duration| {
                let now = Instant::now();
                *slot += now - last;
                last = now;
            };
            lap(&mut profile.policy);
            let parts = &mut profile.parts;
            let step = env.step_timed(action, &mut |part| lap(&mut parts[part as usize]));
            let _ = step.map_err(|source| EvaluateError::Step { policy: policy.name(), source })?;
        }
        profile.ticks += env.episode().ticks;
        profile.control_steps += env.episode().control_steps;
    }
    Ok(profile)
}
