//! The main job: learn how people change lanes, train a driver, compare it, and put it all on one page.

use std::time::Instant;

use lanecraft_drive::env::Trace;

use crate::baselines::Rule;
use crate::config::{RunConfig, SeedRole};
use crate::evaluate::{EvaluateError, EpisodeResult, PolicyEpisodes, evaluate, evaluation_environment, record_episode};
use crate::human_reward::{HumanRewardError, Source, learn_human_reward, summary};
use crate::irl::IrlReport;
use crate::metrics::PolicyResult;
use crate::policy::Policy;
use crate::profile::profile;
use crate::progress::Progress;
use crate::report::{ReportData, render};
use crate::run_dir::{RunDir, RunDirError, RunLog};
use crate::runs::{self, RunError};
use crate::stats::StatsError;
use crate::trace_file::{TraceFileError, write_trace};

/// The page.
pub const REPORT: &str = "report.html";
/// The results, one JSON object a line.
pub const RESULTS: &str = "results.jsonl";
/// Every episode of every policy.
pub const EPISODES: &str = "episodes.csv";
/// The recorded episode.
pub const TRACE: &str = "episode.jsonl.gz";
/// The learned reward and what it is worth.
pub const HUMAN_REWARD: &str = "human-reward.json";

/// Scenarios in which the time of the parts is taken.
const PROFILED_SCENARIOS: u64 = 2;

/// Why the job stopped.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
#[non_exhaustive]
pub enum QuickstartError {
    /// The demonstrations or the fit.
    HumanReward(#[from] HumanRewardError),
    /// The training or its files.
    Run(#[from] RunError),
    /// The folder.
    Dir(#[from] RunDirError),
    /// The evaluation.
    Evaluate(#[from] EvaluateError),
    /// The intervals.
    Stats(#[from] StatsError),
    /// The recorded episode.
    Trace(#[from] TraceFileError),
}

/// What there is to print.
#[derive(Clone, Debug)]
pub struct QuickstartResult {
    /// A row for each policy, the learned one first.
    pub results: Vec<PolicyResult>,
    /// What must be said beside them.
    pub statements: Vec<String>,
}

/// Learns the human reward and lays it into the planner of `config`.
pub fn with_human_reward(source: &Source, config: &mut RunConfig) -> Result<IrlReport, HumanRewardError> {
    let report = learn_human_reward(source, &config.irl)?;
    let planner = &mut config.environment.planner;
    *planner = planner.clone().with_reward(&report.model);
    Ok(report)
}

/// Trains, evaluates and reports in `run`, whose configuration is `config` with the reward of `irl` in its planner.
pub fn quickstart(
    run: &RunDir,
    config: &RunConfig,
    irl: &IrlReport,
    progress: &Progress,
) -> Result<QuickstartResult, QuickstartError> {
    run.write(HUMAN_REWARD, &serde_json::to_vec_pretty(irl).expect("plain numbers and names serialize"))?;
    let begun = Instant::now();
    let learning_s = runs::train(run, config, progress)?;
    let trained_s = begun.elapsed().as_secs_f64();
    let policies = policies(run, config)?;
    let episodes = evaluate_all(&policies, config, progress)?;
    let evaluated_s = begun.elapsed().as_secs_f64() - trained_s;
    let results = episodes.iter().map(PolicyEpisodes::result).collect::<Result<Vec<_>, _>>()?;
    let statements = compare(&episodes)?;
    let trace = overtaking(&policies[0], &episodes[0], config)?;
    write_logs(run, &results, &episodes)?;
    write_trace(&run.path().join(TRACE), &trace)?;
    let stages = [("training: learning", learning_s), ("training: driving", trained_s - learning_s), ("evaluation", evaluated_s)];
    let data = ReportData {
        title: "Lanecraft quick start".to_owned(),
        summary: Vec::new(),
        results: results.clone(),
        curves: vec![(policies[0].name(), runs::read_curve(run.path())?)],
        irl: Some(summary(irl)),
        trace: Some(trace),
        time_shares: time_shares(&policies[0], config, stages)?,
        config_toml: config.to_toml(),
        seeds: seeds(config),
        statements: statements.clone(),
    };
    run.write(REPORT, render(&data).as_bytes())?;
    Ok(QuickstartResult { results, statements })
}

/// The trained policy and every rule.
fn policies(run: &RunDir, config: &RunConfig) -> Result<Vec<Policy>, RunError> {
    let mut policies = vec![runs::read_policy(run.path())?];
    if let Policy::Learned { name, .. } = &mut policies[0] {
        *name = serde_json::to_value(config.learner.algorithm)
            .ok()
            .and_then(|name| name.as_str().map(str::to_owned))
            .unwrap_or_default();
    }
    policies.extend(Rule::all().map(Policy::Rule));
    Ok(policies)
}

fn evaluate_all(
    policies: &[Policy],
    config: &RunConfig,
    progress: &Progress,
) -> Result<Vec<PolicyEpisodes>, EvaluateError> {
    let steps = policies.len() * config.evaluation.episodes;
    progress.stage("evaluate", steps as u64, |progress| {
        let evaluate = |policy| evaluate(policy, &config.environment, &config.evaluation, SeedRole::Test, progress);
        policies.iter().map(evaluate).collect()
    })
}

/// Says of each other policy whether the first one beats it in reward, scenario by scenario.
pub fn compare(episodes: &[PolicyEpisodes]) -> Result<Vec<String>, StatsError> {
    let Some((first, others)) = episodes.split_first() else { return Ok(Vec::new()) };
    let say = |other: &PolicyEpisodes| {
        let gain = first.reward_difference(other)?;
        let verdict = match gain {
            _ if gain.low > 0.0 => "beats",
            _ if gain.high < 0.0 => "does not beat: it falls behind",
            _ => "does not beat, as far as these scenarios can tell,",
        };
        let (a, b) = (&first.policy, &other.policy);
        let (mean, low, high) = (gain.mean, gain.low, gain.high);
        Ok(format!("{a} {verdict} {b}: {mean:+.2} reward per tick, interval {low:+.2} to {high:+.2}."))
    };
    others.iter().map(say).collect()
}

/// The evaluated episode with the most lane changes and no collision, recorded.
fn overtaking(policy: &Policy, episodes: &PolicyEpisodes, config: &RunConfig) -> Result<Trace, EvaluateError> {
    let whole = episodes.episodes.iter().filter(|episode| episode.collision.is_empty());
    let mut best: Option<&EpisodeResult> = None;
    for episode in whole {
        if best.is_none_or(|best| episode.lane_changes > best.lane_changes) {
            best = Some(episode);
        }
    }
    let seed = best.map_or(SeedRole::Test.scenario_seed(config.evaluation.seed, 0), |episode| episode.scenario_seed);
    record_episode(policy, &evaluation_environment(&config.environment, &config.evaluation), seed)
}

fn write_logs(run: &RunDir, results: &[PolicyResult], episodes: &[PolicyEpisodes]) -> Result<(), RunDirError> {
    let mut log = RunLog::create(&run.path().join(RESULTS))?;
    results.iter().try_for_each(|result| log.json(result))?;
    log.sync()?;
    let mut log = RunLog::create(&run.path().join(EPISODES))?;
    for of in episodes {
        of.episodes.iter().try_for_each(|episode| log.csv(episode))?;
    }
    log.sync()
}

/// Wall time of the stages, that of driving split by the parts of the loop.
fn time_shares(
    policy: &Policy,
    config: &RunConfig,
    stages: [(&str, f64); 3],
) -> Result<Vec<(String, f64)>, EvaluateError> {
    let environment = evaluation_environment(&config.environment, &config.evaluation);
    let seeds = (0..PROFILED_SCENARIOS).map(|index| SeedRole::Tuning.scenario_seed(config.evaluation.seed, index));
    let profile = profile(policy, &environment, seeds)?;
    let [learning, driving, evaluation] = stages;
    let driving_s = driving.1.max(0.0) + evaluation.1;
    let total_s = profile.total().as_secs_f64();
    let parts = profile.rows().map(|(part, time)| (part.to_owned(), driving_s * time.as_secs_f64() / total_s));
    Ok(std::iter::once(("learner".to_owned(), learning.1)).chain(parts).collect())
}

fn seeds(config: &RunConfig) -> Vec<(String, String)> {
    let range = |role: SeedRole, seed| format!("{} and on", role.scenario_seed(seed, 0));
    vec![
        ("run".to_owned(), config.training.seed.to_string()),
        ("training scenarios".to_owned(), range(SeedRole::Training, config.training.seed)),
        ("test scenarios".to_owned(), range(SeedRole::Test, config.evaluation.seed)),
    ]
}
