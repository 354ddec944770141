//! Judging a run: its policy beside every rule on the same scenarios, an episode to watch, and where the time goes.

use std::path::Path;
use std::time::Instant;

use lanecraft_drive::env::Trace;

use crate::baselines::Rule;
use crate::config::{RunConfig, SeedRole};
use crate::evaluate::{EpisodeResult, EvaluateError, PolicyEpisodes, evaluate, evaluation_environment, record_episode};
use crate::policy::Policy;
use crate::profile::profile;
use crate::progress::Progress;
use crate::run_dir::{RunDir, RunDirError, RunLog};
use crate::runs::{self, RunError};
use crate::stats::StatsError;
use crate::trace_file::{TraceFileError, write_trace};

/// The results, one JSON object a line.
pub const RESULTS: &str = "results.jsonl";
/// Every episode of every policy.
pub const EPISODES: &str = "episodes.csv";
/// The recorded episode.
pub const TRACE: &str = "episode.jsonl.gz";
/// Seconds by part of the work.
pub const TIMES: &str = "times.json";

/// Scenarios in which the time of the loop's parts is taken.
const PROFILED_SCENARIOS: u64 = 2;

/// Why a run could not be judged.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
#[non_exhaustive]
pub enum JudgeError {
    /// The run.
    Run(#[from] RunError),
    /// Its folder.
    Dir(#[from] RunDirError),
    /// The evaluation.
    Evaluate(#[from] EvaluateError),
    /// The intervals.
    Stats(#[from] StatsError),
    /// The recorded episode.
    Trace(#[from] TraceFileError),
}

/// Drives the policy of the finished `run` and every rule, and writes results, episodes, a recorded episode and times into the run.
/// `training` is the wall time of its training and of the updates alone, s, if it has just been trained.
pub fn judge(
    run: &RunDir,
    config: &RunConfig,
    training: Option<(f64, f64)>,
    progress: &Progress,
) -> Result<(), JudgeError> {
    let begun = Instant::now();
    let mut policies = vec![runs::read_policy(run.path())?];
    policies.extend(Rule::all().map(Policy::Rule));
    let steps = policies.len() * config.evaluation.episodes;
    let episodes = progress.stage("evaluate", steps as u64, |progress| {
        let evaluate = |policy| evaluate(policy, &config.environment, &config.evaluation, SeedRole::Test, progress);
        policies.iter().map(evaluate).collect::<Result<Vec<_>, _>>()
    })?;
    let evaluation_s = begun.elapsed().as_secs_f64();
    let trace = overtaking(&policies[0], &episodes, config)?;
    write_trace(&run.path().join(TRACE), &trace)?;
    let times = times(&policies[0], config, training.unwrap_or_default(), evaluation_s)?;
    run.write(TIMES, &serde_json::to_vec(&times).expect("names and numbers serialize"))?;
    write_logs(run, &episodes)
}

/// The episodes of a judged run by policy, its own first; none if it has not been judged.
pub fn read_episodes(run: &Path) -> Result<Vec<PolicyEpisodes>, RunDirError> {
    let path = run.join(EPISODES);
    if !path.exists() {
        return Ok(Vec::new());
    }
    let broken = |error: csv::Error| RunDirError::Broken { path: path.clone(), message: error.to_string() };
    let mut policies: Vec<PolicyEpisodes> = Vec::new();
    for episode in csv::Reader::from_path(&path).map_err(broken)?.deserialize() {
        let episode: EpisodeResult = episode.map_err(broken)?;
        match policies.last_mut().filter(|last| last.policy == episode.policy) {
            Some(last) => last.episodes.push(episode),
            None => policies.push(PolicyEpisodes { policy: episode.policy.clone(), episodes: vec![episode] }),
        }
    }
    Ok(policies)
}

/// The evaluated episode in which overtaking gained most: the largest lead in reward over the rule that keeps its lane, among those
/// with two lane changes or more and no collision.
fn overtaking(policy: &Policy, episodes: &[PolicyEpisodes], config: &RunConfig) -> Result<Trace, EvaluateError> {
    let keeper = episodes.iter().find(|of| of.policy == Policy::Rule(Rule::KeepLane).name());
    let mut best = (f64::NEG_INFINITY, SeedRole::Test.scenario_seed(config.evaluation.seed, 0));
    for (own, kept) in episodes[0].episodes.iter().zip(keeper.map_or(&episodes[0].episodes, |of| &of.episodes)) {
        let gain = own.reward_per_tick - kept.reward_per_tick;
        if own.collision.is_empty() && own.lane_changes >= 2 && gain > best.0 {
            best = (gain, own.scenario_seed);
        }
    }
    record_episode(policy, &evaluation_environment(&config.environment, &config.evaluation), best.1)
}

fn write_logs(run: &RunDir, episodes: &[PolicyEpisodes]) -> Result<(), JudgeError> {
    let mut log = RunLog::create(&run.path().join(RESULTS))?;
    for of in episodes {
        log.json(&of.result()?)?;
    }
    log.sync()?;
    let mut log = RunLog::create(&run.path().join(EPISODES))?;
    episodes.iter().flat_map(|of| &of.episodes).try_for_each(|episode| log.csv(episode))?;
    Ok(log.sync()?)
}

/// Seconds of wall time by part: the updates, and the driving of training and evaluation split as a profile says.
fn times(
    policy: &Policy,
    config: &RunConfig,
    (training_s, updates_s): (f64, f64),
    evaluation_s: f64,
) -> Result<Vec<(String, f64)>, EvaluateError> {
    let environment = evaluation_environment(&config.environment, &config.evaluation);
    let seeds = (0..PROFILED_SCENARIOS).map(|index| SeedRole::Tuning.scenario_seed(config.evaluation.seed, index));
    let profile = profile(policy, &environment, seeds)?;
    // Updates and driving run side by side; what the updates leave of the training is driving alone.
    let driving_s = (training_s - updates_s).max(0.0) + evaluation_s;
    let total_s = profile.total().as_secs_f64();
    let parts = profile.rows().map(|(part, time)| (part.to_owned(), driving_s * time.as_secs_f64() / total_s));
    let updates = (updates_s > 0.0).then(|| ("learner updates".to_owned(), updates_s));
    Ok(updates.into_iter().chain(parts).collect())
}
