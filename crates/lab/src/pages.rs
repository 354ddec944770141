//! Report pages from run folders: whatever a run has to show, alone or beside others.

use std::fs;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use crate::config::{RunConfig, SeedRole};
use crate::evaluate::{Comparison, PolicyEpisodes, compare};
use crate::human_reward::{HUMAN_REWARD, summary};
use crate::irl::IrlReport;
use crate::judge::{EPISODES, JudgeError, TIMES, TRACE, judge, read_episodes};
use crate::metrics::PolicyResult;
use crate::policy::run_name;
use crate::progress::Progress;
use crate::report::{ReportData, render};
use crate::run_dir::{RunDir, RunDirError, atomic};
use crate::runs;
use crate::trace_file::read_trace;

/// The page.
pub const REPORT: &str = "report.html";

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PageError {
    /// A run could not be judged or read.
    #[error(transparent)]
    Judge(#[from] JudgeError),
    /// Runs that were judged in different scenarios.
    #[error(
        "{} and {} were judged in different scenarios, so they cannot stand in one table; give them the same road, traffic and evaluation",
        first.display(),
        other.display()
    )]
    NotPaired {
        /// The first run.
        first: PathBuf,
        /// The other one.
        other: PathBuf,
    },
}

/// Writes one page on all of `paths` into the first of them and returns where it is. A run that was not judged yet is judged first.
pub fn report(paths: &[PathBuf], progress: &Progress) -> Result<PathBuf, PageError> {
    let mut data = ReportData { title: title(paths), ..ReportData::default() };
    let mut episodes: Vec<PolicyEpisodes> = Vec::new();
    for path in paths {
        let (run, _) = RunDir::open(path).map_err(JudgeError::from)?;
        let config = runs::read_config(path).map_err(JudgeError::from)?;
        if !path.join(EPISODES).exists() {
            judge(&run, &config, None, progress)?;
        }
        let found = read_episodes(path).map_err(JudgeError::from)?;
        if !paired(&episodes, &found) {
            return Err(PageError::NotPaired { first: paths[0].clone(), other: path.clone() });
        }
        // Rules drive alike in paired scenarios; once is enough.
        for of in found {
            if !episodes.iter().any(|known| known.policy == of.policy) {
                episodes.push(of);
            }
        }
        add_run(&mut data, path, &config)?;
    }
    runs_first(&mut episodes);
    let results =
        episodes.iter().map(PolicyEpisodes::result).collect::<Result<Vec<_>, _>>().map_err(JudgeError::from)?;
    let comparisons = compare(&episodes).map_err(JudgeError::from)?;
    data.summary = reading(&results[0], &comparisons);
    data.statements = comparisons.iter().map(Comparison::to_string).collect();
    data.results = results;
    let path = paths[0].join(REPORT);
    atomic::write(&path, render(&data).as_bytes()).map_err(JudgeError::from)?;
    Ok(path)
}

/// The first policy's results in two sentences; its order among the others comes from the paired differences, which tell more than
/// intervals that overlap.
fn reading(first: &PolicyResult, comparisons: &[Comparison]) -> Vec<String> {
    let names = |beats: bool| {
        let names = comparisons.iter().filter(|c| c.beats() == beats).map(|c| c.other.as_str()).collect::<Vec<_>>();
        (!names.is_empty()).then(|| names.join(", "))
    };
    let order = match (names(true), names(false)) {
        (Some(beaten), None) => format!("In reward, scenario by scenario, it beats all others: {beaten}."),
        (Some(beaten), Some(rest)) => format!("In reward, scenario by scenario, it beats {beaten}, but not {rest}."),
        (None, Some(rest)) => format!("In reward, scenario by scenario, it beats none of the others: {rest}."),
        (None, None) => String::new(),
    };
    let speed_kmph = 3.6 * first.speed_mps.mean;
    let collisions = 100.0 * first.collisions_per_episode.mean;
    let most = 100.0 * first.collisions_per_episode.high;
    vec![
        format!(
            "The policy {} drives {speed_kmph:.1} km/h on average and earns {:.2} per tick; {collisions:.1} % of {} episodes end in a collision (at most {most:.1} % with 95 % confidence).",
            first.policy, first.reward_per_tick.mean, first.episodes
        ),
        order,
    ]
}

fn title(paths: &[PathBuf]) -> String {
    let names: Vec<String> = paths.iter().map(|path| run_name(path)).collect();
    format!("Lanecraft: {}", names.join(", "))
}

/// Runs before rules, else in the order given.
fn runs_first(episodes: &mut [PolicyEpisodes]) {
    episodes.sort_by_key(|of| of.policy.starts_with("rule:"));
}

fn paired(known: &[PolicyEpisodes], found: &[PolicyEpisodes]) -> bool {
    let seeds = |of: &PolicyEpisodes| of.episodes.iter().map(|episode| episode.scenario_seed).collect::<Vec<_>>();
    known.first().is_none_or(|first| found.iter().all(|of| seeds(of) == seeds(first)))
}

/// Adds what a run has beside its results; of episode, reward and times the first run's.
fn add_run(data: &mut ReportData, path: &Path, config: &RunConfig) -> Result<(), JudgeError> {
    let name = run_name(path);
    data.curves.push((name.clone(), runs::read_curve(path)?));
    if data.trace.is_none() && path.join(TRACE).exists() {
        data.trace = Some(read_trace(&path.join(TRACE))?);
    }
    if data.irl.is_none() {
        data.irl = read_json::<IrlReport>(&path.join(HUMAN_REWARD))?.as_ref().map(summary);
    }
    if data.time_shares.is_empty() {
        data.time_shares = read_json(&path.join(TIMES))?.unwrap_or_default();
    }
    data.config_toml.extend(["# ", &name, "\n", &config.to_toml(), "\n"]);
    let seed = |role: SeedRole, seed| format!("{} and on", role.scenario_seed(seed, 0));
    data.seeds.extend([
        (format!("{name}: run"), config.training.seed.to_string()),
        (format!("{name}: training scenarios"), seed(SeedRole::Training, config.training.seed)),
        (format!("{name}: test scenarios"), seed(SeedRole::Test, config.evaluation.seed)),
    ]);
    Ok(())
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, RunDirError> {
    if !path.exists() {
        return Ok(None);
    }
    let text = fs::read(path).map_err(RunDirError::io("read", path))?;
    let broken = |error: serde_json::Error| RunDirError::Broken { path: path.to_owned(), message: error.to_string() };
    serde_json::from_slice(&text).map(Some).map_err(broken)
}

#[cfg(test)]
mod tests {
    use super::{PolicyEpisodes, runs_first};

    #[test]
    fn runs_stand_before_rules_in_the_order_given() {
        let of = |policy: &str| PolicyEpisodes { policy: policy.to_owned(), episodes: Vec::new() };
        let mut episodes = ["b", "rule:random", "rule:best-lane", "a"].map(of);
        runs_first(&mut episodes);
        assert_eq!(episodes.map(|of| of.policy), ["b", "a", "rule:random", "rule:best-lane"]);
    }
}
