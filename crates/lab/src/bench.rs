//! How fast the parts are on this machine.
//!
//! A timed part is repeated for a second in all; rates are of one core unless the name says otherwise.

mod kinematic;
mod planner;
mod traffic;

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use lanecraft_drive::driver::Part;
use lanecraft_drive::env::{Env, EnvError};
use lanecraft_learn::{ActError, Actor, Learner, Transition, UpdateError};
use lanecraft_net::random::Stream;
use lanecraft_net::{Adam, Lstm, LstmShape, LstmWorkspace, ShapeError};
use serde::Serialize;

use crate::baselines::{BestLane, Proposals, Rule};
use crate::config::{EvaluationConfig, RunConfig, SeedRole};
use crate::evaluate::{EvaluateError, evaluate, evaluation_environment};
use crate::metrics::Interval;
use crate::policy::Policy;
use crate::profile::profile;
use crate::progress::Progress;
use crate::quickstart::QUICKSTART_DECISIONS;
use crate::stats::StatsError;
use crate::train::{TrainError, Trainer};

/// A measurement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BenchRow {
    /// What, for example `traffic/idm-mobil/50`.
    pub bench: String,
    /// The figure.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
}

/// Why a measurement stopped.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
#[non_exhaustive]
pub enum BenchError {
    /// A scenario could not be built.
    Env(#[from] EnvError),
    /// A policy failed.
    Evaluate(#[from] EvaluateError),
    /// The learner's settings.
    Learner(#[from] lanecraft_learn::ConfigError),
    /// An update failed.
    Update(#[from] UpdateError),
    /// Acting failed.
    Act(#[from] ActError),
    /// Training stopped.
    Train(#[from] TrainError),
    /// Too few episodes for an interval.
    Stats(#[from] StatsError),
    /// The replay buffer refused a transition.
    Replay(#[from] lanecraft_learn::ReplayError),
    /// A network could not be built.
    Shape(#[from] ShapeError),
    /// The threads could not be started.
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// A group of measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// The human drivers alone.
    Traffic,
    /// The closed loop and the shares of its parts.
    Env,
    /// The fast environment.
    Kinematic,
    /// The planner, and the fit of a reward.
    Planner,
    /// The learner.
    Learner,
    /// The recurrent network.
    Lstm,
    /// The quick start's policy beside all rules on the evaluation's scenarios; trains first.
    Policies,
    /// The rule `best-lane` over a grid of its two numbers, on tuning scenarios.
    BestLane,
    /// The rule `proposals` over a grid of its numbers, on tuning scenarios, and the time of a decision.
    Proposals,
}

impl Group {
    /// All groups.
    pub const ALL: [Self; 9] = [
        Self::Traffic,
        Self::Env,
        Self::Kinematic,
        Self::Planner,
        Self::Learner,
        Self::Lstm,
        Self::Policies,
        Self::BestLane,
        Self::Proposals,
    ];
    /// Those that are done in seconds.
    pub const SHORT: [Self; 6] = [Self::Traffic, Self::Env, Self::Kinematic, Self::Planner, Self::Learner, Self::Lstm];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Traffic => "traffic",
            Self::Env => "env",
            Self::Kinematic => "kinematic",
            Self::Planner => "planner",
            Self::Learner => "learner",
            Self::Lstm => "lstm",
            Self::Policies => "policies",
            Self::BestLane => "best-lane",
            Self::Proposals => "proposals",
        }
    }

    /// Measures it and hands each row to `found` as it comes.
    pub fn run(self, config: &RunConfig, found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
        match self {
            Self::Traffic => traffic::run(config, found),
            Self::Env => env(config, found),
            Self::Kinematic => kinematic::run(found),
            Self::Planner => planner::run(config, found),
            Self::Learner => learner(config, found),
            Self::Lstm => lstm(found),
            Self::Policies => policies(config, found),
            Self::BestLane => best_lane(config, found),
            Self::Proposals => proposals(config, found),
        }
    }
}

/// How long a part is repeated.
const MEASURED: Duration = Duration::from_secs(1);

/// Calls `run` until a second has passed; returns how many of the units that it reports were done in a second.
fn rate(mut run: impl FnMut() -> u64) -> f64 {
    let begun = Instant::now();
    let mut done = 0;
    while begun.elapsed() < MEASURED {
        done += run();
    }
    done as f64 / begun.elapsed().as_secs_f64()
}

/// The whole loop behind the rule `best-lane`, both controllers on.
fn env(config: &RunConfig, found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
    let environment = evaluation_environment(&config.environment, &config.evaluation);
    let policy = Policy::Rule(Rule::BestLane(BestLane::default()));
    let seeds = (0..10).map(|index| SeedRole::Tuning.scenario_seed(config.evaluation.seed, index));
    let profile = profile(&policy, &environment, seeds)?;
    let total_s = profile.total().as_secs_f64();
    let vehicles = profile.vehicles;
    let value = f64::from(profile.ticks) / total_s;
    found(BenchRow { bench: format!("env/ticks/{vehicles}-vehicles"), value, unit: "ticks/s" });
    for (part, time) in profile.rows() {
        let value = time.as_secs_f64() / total_s;
        found(BenchRow { bench: format!("env/share/{}", part.replace(' ', "-")), value, unit: "share of time" });
    }
    for part in [Part::LongitudinalMpc, Part::LateralMpc] {
        let value = 1e6 * profile.parts[part as usize].as_secs_f64() / (profile.control_steps.max(1) as f64);
        found(BenchRow { bench: format!("env/solve/{}", part.name().replace(' ', "-")), value, unit: "us" });
    }
    Ok(())
}

/// Updates and decisions on random transitions.
fn learner(config: &RunConfig, found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
    let environment = Arc::new(config.environment.clone());
    let inputs = environment.observation.size();
    let actions = lanecraft_drive::decide::ActionSet::new(&environment.actions).map_err(EnvError::from)?.len();
    let mut learner = Learner::new(&config.learner, inputs, actions, 0)?;
    let mut replay = learner.empty_replay();
    let mut stream = Stream::new(0, "bench.learner");
    let mut observation = || (0..inputs).map(|_| stream.normal() as f32).collect::<Vec<_>>();
    for number in 0..config.learner.learning_starts {
        let transition = Transition {
            observation: observation(),
            action: number % actions,
            reward: 0.5,
            discount: 0.95,
            next_observation: observation(),
            next_action_mask: (1 << actions) - 1,
            bootstrap_mask: learner.bootstrap_mask(number as u64),
        };
        replay.push(&transition)?;
    }
    let begun = Instant::now();
    let mut updates = 0_u32;
    while begun.elapsed() < MEASURED {
        learner.update(&replay, 1e-4)?;
        updates += 1;
    }
    let name = format!("k{}-batch{}", config.learner.head_count(), config.learner.batch);
    let value = f64::from(updates) / begun.elapsed().as_secs_f64();
    found(BenchRow { bench: format!("learner/update/{name}"), value, unit: "updates/s" });
    let (mut actor, seen) = (Actor::new(learner.policy()), observation());
    actor.greedy(&seen, 1)?;
    let value = 1e6 / rate(|| u64::from(black_box(actor.greedy(&seen, u32::MAX)).is_ok()));
    found(BenchRow { bench: format!("learner/vote/{name}"), value, unit: "us" });
    Ok(())
}

/// An update of the recurrent network on random sequences: what `bench/peers/lstm.py` measures of PyTorch.
fn lstm(found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
    let (shape, batch, steps) = (LstmShape { inputs: 6, hidden: 64, outputs: 12 }, 64, 10);
    let mut stream = Stream::new(0, "bench.lstm");
    let mut network = Lstm::new(shape, &mut stream)?;
    let mut random = |count: usize| (0..count).map(|_| stream.normal() as f32).collect::<Vec<_>>();
    let (inputs, targets) = (random(steps * batch * shape.inputs), random(batch * shape.outputs));
    let mut adam = Adam::new(network.parameters().len());
    let mut workspace = LstmWorkspace::new(&shape, batch, steps);
    let (mut delta, mut gradient) = (targets.clone(), vec![0.0; network.parameters().len()]);
    let value = 1e3
        / rate(|| {
            let outputs = network.forward(&inputs, steps, &mut workspace);
            delta.iter_mut().zip(outputs.iter().zip(&targets)).for_each(|(delta, (y, target))| *delta = y - target);
            network.backward(&inputs, &delta, &mut workspace, &mut gradient);
            adam.step(network.parameters_mut(), &gradient, 1e-3);
            1
        });
    found(BenchRow { bench: "lstm/update/batch64-10x6-64".to_owned(), value, unit: "ms" });
    Ok(())
}

/// Reward and collisions with their intervals, paired.
fn policies(config: &RunConfig, found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
    let mut config = config.clone();
    config.training.decisions = QUICKSTART_DECISIONS;
    let mut trainer = Trainer::new(&config)?;
    while !trainer.is_finished() {
        trainer.round()?;
    }
    let mut policies = vec![Policy::Learned { name: "quickstart".to_owned(), network: trainer.policy() }];
    policies.extend(Rule::all().map(Policy::Rule));
    for policy in &policies {
        let episodes = evaluate(policy, &config.environment, &config.evaluation, SeedRole::Test, &Progress::silent())?;
        let result = episodes.result()?;
        let figures = [
            ("reward-per-tick", "paper's units", result.reward_per_tick),
            ("collisions", "per episode", result.collisions_per_episode),
            ("speed", "m/s", result.speed_mps),
        ];
        for (name, unit, Interval { mean, low, high }) in figures {
            for (end, value) in [("mean", mean), ("low", low), ("high", high)] {
                found(BenchRow { bench: format!("policies/{}/{name}/{end}", policy.name()), value, unit });
            }
        }
    }
    Ok(())
}

/// Episodes for each point of the grid.
const TUNING_EPISODES: usize = 400;

/// Mean reward per tick of `rule` over the tuning scenarios.
fn tuning_reward(config: &RunConfig, rule: Rule) -> Result<f64, BenchError> {
    let evaluation = EvaluationConfig {
        episodes: TUNING_EPISODES,
        episode_s: config.environment.env.episode_s,
        ..config.evaluation
    };
    let (policy, progress) = (Policy::Rule(rule), Progress::silent());
    let episodes = evaluate(&policy, &config.environment, &evaluation, SeedRole::Tuning, &progress)?;
    Ok(episodes.result()?.reward_per_tick.mean)
}

fn best_lane(config: &RunConfig, found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
    for gap_time_s in [1.0, 2.0, 4.0, 8.0, 16.0] {
        for gain_threshold_mps in [0.25, 0.5, 1.0, 2.0, 3.0] {
            let value = tuning_reward(config, Rule::BestLane(BestLane { gap_time_s, gain_threshold_mps }))?;
            let bench = format!("best-lane/gap-time-{gap_time_s}/threshold-{gain_threshold_mps}");
            found(BenchRow { bench, value, unit: "reward per tick" });
        }
    }
    Ok(())
}

fn proposals(config: &RunConfig, found: &mut dyn FnMut(BenchRow)) -> Result<(), BenchError> {
    let environment = evaluation_environment(&config.environment, &config.evaluation);
    let rule = Rule::Proposals(Proposals::default());
    let env = Env::new(&environment, SeedRole::Tuning.scenario_seed(config.evaluation.seed, 0))?;
    let value = 1e6 / rate(|| u64::from(black_box(rule.act(&env, 0)) < usize::MAX));
    found(BenchRow { bench: "proposals/decision".to_owned(), value, unit: "us" });
    for horizon_s in [6.0, 8.0, 12.0, 16.0, 20.0] {
        for restraint_threshold in [0.0, 0.5, 1.0, f64::INFINITY] {
            let rule = Proposals { horizon_s, restraint_threshold, ..Proposals::default() };
            let value = tuning_reward(config, Rule::Proposals(rule))?;
            let bench = format!("proposals/horizon-{horizon_s}/restraint-{restraint_threshold}");
            found(BenchRow { bench, value, unit: "reward per tick" });
        }
    }
    Ok(())
}
