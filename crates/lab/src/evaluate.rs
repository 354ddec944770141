//! Paired evaluation: every policy drives the same scenarios, and every figure comes with its interval.

use std::collections::BTreeMap;
use std::sync::Arc;

use lanecraft_drive::control::GuardCause;
use lanecraft_drive::env::{Config, Env, EnvError, Episode, StepError, Trace};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::{EvaluationConfig, SeedRole};
use crate::metrics::{Interval, PolicyResult};
use crate::policy::{DecideError, Pilot, Policy};
use crate::progress::Progress;
use crate::stats::{StatsError, mean_interval, paired_difference, rate_interval};

/// Why an evaluation stopped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvaluateError {
    /// A scenario could not be built.
    #[error(transparent)]
    Env(#[from] EnvError),
    /// A policy could not decide.
    #[error("policy `{policy}`: {source}")]
    Act {
        /// The policy.
        policy: String,
        /// Why.
        source: DecideError,
    },
    /// A policy chose an action that is not allowed.
    #[error("policy `{policy}`: {source}")]
    Step {
        /// The policy.
        policy: String,
        /// Why.
        source: StepError,
    },
    /// Too few episodes for an interval.
    #[error(transparent)]
    Stats(#[from] StatsError),
}

/// One episode of one policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeResult {
    /// Who drove.
    pub policy: String,
    /// Seed of the scenario.
    pub scenario_seed: u64,
    /// Length, s.
    pub duration_s: f64,
    /// Time mean of the speed, m/s.
    pub speed_mps: f64,
    /// Mean score of a tick.
    pub reward_per_tick: f64,
    /// Fault class of the collision that ended it, or an empty string.
    pub collision: String,
    /// Whether that collision was the ego's fault.
    pub at_fault: bool,
    /// Lane changes begun.
    pub lane_changes: u32,
    /// Lane changes aborted.
    pub aborts: u32,
    /// Smallest time to collision, s, capped.
    pub min_time_to_collision_s: f64,
    /// Refused lane changes.
    pub refusals: u32,
    /// Control steps with a fall-back.
    pub fallbacks: u32,
    /// Control steps in which the guard braked in place of the command.
    pub guard_interventions: u32,
    /// Control steps in which the guard changed the command or called off a lane change, by cause; JSON in one cell of the table.
    #[serde(with = "in_one_cell")]
    pub guard_causes: BTreeMap<GuardCause, u32>,
    /// Ticks in which the shield forbade a lane change.
    pub shield_interventions: u32,
    /// Mean absolute jerk, m/s³.
    pub jerk_mps3: f64,
}

/// A map as text, for tables have no room for more.
mod in_one_cell {
    use std::collections::BTreeMap;

    use lanecraft_drive::control::GuardCause;
    use serde::{Deserialize as _, Deserializer, Serializer, de, ser};

    pub(super) fn serialize<S: Serializer>(map: &BTreeMap<GuardCause, u32>, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(&serde_json::to_string(map).map_err(ser::Error::custom)?)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<BTreeMap<GuardCause, u32>, D::Error> {
        serde_json::from_str(&String::deserialize(from)?).map_err(de::Error::custom)
    }
}

impl EpisodeResult {
    fn new(policy: String, scenario_seed: u64, episode: &Episode, control_period_s: f64) -> Self {
        let counts = &episode.counts;
        Self {
            policy,
            scenario_seed,
            duration_s: episode.control_steps as f64 * control_period_s,
            speed_mps: episode.mean_speed_mps(),
            reward_per_tick: episode.mean_score(),
            collision: episode.collision.map_or_else(String::new, |collision| collision.fault.name().to_owned()),
            at_fault: episode.collision.is_some_and(|collision| collision.fault.at_fault()),
            lane_changes: counts.lane_changes,
            aborts: counts.aborts,
            min_time_to_collision_s: episode.min_time_to_collision_s,
            refusals: counts.refusals,
            fallbacks: counts.fallbacks.iter().sum(),
            guard_interventions: counts.guard_interventions(),
            guard_causes: GuardCause::ALL.into_iter().zip(counts.guard).filter(|(_, steps)| *steps > 0).collect(),
            shield_interventions: counts.shield,
            jerk_mps3: episode.mean_jerk_mps3(),
        }
    }

    fn per_minute(&self, count: u32) -> f64 {
        60.0 * f64::from(count) / self.duration_s.max(1e-9)
    }
}

/// All episodes of one policy, in the order of the scenarios.
#[derive(Clone, Debug, PartialEq)]
pub struct PolicyEpisodes {
    /// The policy's name.
    pub policy: String,
    /// Its episodes.
    pub episodes: Vec<EpisodeResult>,
}

impl PolicyEpisodes {
    /// The figures of all tables. Needs at least two episodes.
    pub fn result(&self) -> Result<PolicyResult, StatsError> {
        let mean = |value: &dyn Fn(&EpisodeResult) -> f64| -> Result<Interval, StatsError> {
            mean_interval(&self.episodes.iter().map(value).collect::<Vec<_>>())
        };
        let rate = |event: &dyn Fn(&EpisodeResult) -> bool| {
            rate_interval(self.episodes.iter().filter(|e| event(e)).count(), self.episodes.len())
        };
        Ok(PolicyResult {
            policy: self.policy.clone(),
            episodes: self.episodes.len(),
            speed_mps: mean(&|e| e.speed_mps)?,
            reward_per_tick: mean(&|e| e.reward_per_tick)?,
            collisions_per_episode: rate(&|e| !e.collision.is_empty())?,
            at_fault_collisions_per_episode: rate(&|e| e.at_fault)?,
            lane_changes_per_min: mean(&|e| e.per_minute(e.lane_changes))?,
            min_time_to_collision_s: mean(&|e| e.min_time_to_collision_s)?,
            refusals_per_min: mean(&|e| e.per_minute(e.refusals))?,
            fallbacks_per_min: mean(&|e| e.per_minute(e.fallbacks))?,
            guard_interventions_per_min: mean(&|e| e.per_minute(e.guard_interventions))?,
            guard_causes_per_min: GuardCause::ALL
                .into_iter()
                .map(|cause| Ok((cause, mean(&|e| e.per_minute(e.guard_causes.get(&cause).copied().unwrap_or(0)))?)))
                .collect::<Result<_, StatsError>>()?,
            shield_interventions_per_min: mean(&|e| e.per_minute(e.shield_interventions))?,
            jerk_mps3: mean(&|e| e.jerk_mps3)?,
        })
    }

    /// This policy's reward per tick minus `other`'s, scenario by scenario.
    pub fn reward_difference(&self, other: &Self) -> Result<Interval, StatsError> {
        let rewards = |of: &Self| of.episodes.iter().map(|e| e.reward_per_tick).collect::<Vec<_>>();
        paired_difference(&rewards(self), &rewards(other))
    }
}

/// How a policy's reward compares with another's, scenario by scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The one.
    pub policy: String,
    /// The other.
    pub other: String,
    /// Its lead in reward per tick.
    pub lead: Interval,
}

impl Comparison {
    /// Whether the whole interval lies above zero.
    pub fn beats(&self) -> bool {
        self.lead.low > 0.0
    }
}

impl std::fmt::Display for Comparison {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { policy, other, lead: Interval { mean, low, high } } = self;
        let verdict = match self.lead {
            _ if self.beats() => "beats",
            Interval { high, .. } if high < 0.0 => "falls behind",
            _ => "does not beat, as far as these scenarios can tell,",
        };
        write!(f, "{policy} {verdict} {other}: {mean:+.2} reward per tick, interval {low:+.2} to {high:+.2}.")
    }
}

/// The first policy against each of the others.
pub fn compare(episodes: &[PolicyEpisodes]) -> Result<Vec<Comparison>, StatsError> {
    let Some((first, others)) = episodes.split_first() else { return Ok(Vec::new()) };
    let against = |other: &PolicyEpisodes| {
        let (policy, lead) = (first.policy.clone(), first.reward_difference(other)?);
        Ok(Comparison { policy, other: other.policy.clone(), lead })
    };
    others.iter().map(against).collect()
}

/// The environment of an evaluation: that of training but for the length of an episode.
pub fn evaluation_environment(config: &Config, evaluation: &EvaluationConfig) -> Arc<Config> {
    let mut config = config.clone();
    config.env.episode_s = evaluation.episode_s;
    Arc::new(config)
}

/// Drives `policy` through the scenarios of `role`, in parallel on the current thread pool; the result does not depend on it.
/// A caller's own policy may remember what it saw: it drives one scenario after the other on the caller's thread. Each episode is a step
/// of progress.
pub fn evaluate(
    policy: &Policy,
    config: &Config,
    evaluation: &EvaluationConfig,
    role: SeedRole,
    progress: &Progress,
) -> Result<PolicyEpisodes, EvaluateError> {
    let config = evaluation_environment(config, evaluation);
    let episode = |index: usize| {
        let seed = role.scenario_seed(evaluation.seed, index as u64);
        let env = drive_episode(policy, &config, seed)?;
        progress.advance(1);
        Ok(EpisodeResult::new(policy.name(), seed, env.episode(), config.env.control_period_s))
    };
    let episodes: Result<Vec<_>, EvaluateError> = match policy {
        Policy::Own(_) => (0..evaluation.episodes).map(episode).collect(),
        _ => (0..evaluation.episodes).into_par_iter().map(episode).collect(),
    };
    Ok(PolicyEpisodes { policy: policy.name(), episodes: episodes? })
}

fn drive_episode(policy: &Policy, config: &Arc<Config>, seed: u64) -> Result<Env, EvaluateError> {
    let mut env = Env::new(config, seed)?;
    let mut pilot = Pilot::new(policy);
    while !env.is_over() {
        let action = choose(policy, &mut pilot, &env, seed)?;
        let _ = env.step(action).map_err(|source| EvaluateError::Step { policy: policy.name(), source })?;
    }
    Ok(env)
}

fn choose(policy: &Policy, pilot: &mut Pilot, env: &Env, seed: u64) -> Result<usize, EvaluateError> {
    pilot.act(env, seed).map_err(|source| EvaluateError::Act { policy: policy.name(), source })
}

/// Drives one episode and records it. `config` must be the evaluation's environment.
pub fn record_episode(policy: &Policy, config: &Arc<Config>, seed: u64) -> Result<Trace, EvaluateError> {
    record(policy, &mut Env::new(config, seed)?, seed)
}

/// The figures of an episode that `policy` drove.
pub fn summarize(policy: &Policy, seed: u64, episode: &Episode, config: &Config) -> EpisodeResult {
    EpisodeResult::new(policy.name(), seed, episode, config.env.control_period_s)
}

/// Drives `env`, which was made with `seed`, to its end and records it; `env` then holds the figures.
pub fn record(policy: &Policy, env: &mut Env, seed: u64) -> Result<Trace, EvaluateError> {
    let mut pilot = Pilot::new(policy);
    let header = env.trace_header(&policy.name(), seed);
    let mut ticks = Vec::new();
    while !env.is_over() {
        let action = choose(policy, &mut pilot, env, seed)?;
        let step = env.step_recorded(action);
        let (_, tick) = step.map_err(|source| EvaluateError::Step { policy: policy.name(), source })?;
        ticks.push(tick);
    }
    Ok(Trace { header, ticks })
}
