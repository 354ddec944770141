//! Report pages from run folders: whatever a run has to show, alone or beside others.

mod load;
mod methods;

use std::fs;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use crate::config::SeedRole;
use crate::evaluate::{Comparison, PolicyEpisodes, compare};
use crate::human_reward::{HUMAN_REWARD, summary};
use crate::irl::IrlReport;
use crate::judge::{JudgeError, TIMES, TRACE};
use crate::metrics::{Interval, PolicyResult};
use crate::progress::Progress;
use crate::report::{MethodResult, ReportData, ScenarioSet, render};
use crate::run_dir::{RunDirError, atomic};
use crate::stats::StatsError;
use crate::trace_file::read_trace;

use load::JudgedRun;
use methods::{Method, Pooled};

/// What the names of rules begin with.
const RULE: &str = "rule:";

/// The page.
pub const REPORT: &str = "report.html";

/// Seeds from which on a comparison of methods is worth its name.
const ENOUGH_SEEDS: usize = 10;

/// A page, and the runs that are not on it.
#[derive(Debug)]
pub struct Page {
    /// Where it is.
    pub path: PathBuf,
    /// The runs that could not be read or judged, each with its reason, which the page states, too.
    pub left_out: Vec<LeftOut>,
}

/// A run that is not on the page.
#[derive(Debug)]
pub struct LeftOut {
    /// Its folder.
    pub run: PathBuf,
    /// What is missing or broken.
    pub reason: JudgeError,
}

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
#[non_exhaustive]
pub enum PageError {
    /// None of the runs could be judged or read.
    Judge(#[from] JudgeError),
}

/// Writes one page on all of `paths` into the first of them that is whole. A run that was not judged yet is judged first; one that is
/// not finished or has a broken file is left out, and the page says so.
///
/// Runs in the same test scenarios stand in one table. Those that differ only in their training seed are pooled as one method. Runs in
/// other scenarios have tables of their own, and no difference between tables is taken.
///
/// # Errors
/// If there is no run that is whole.
pub fn report(paths: &[PathBuf], progress: &Progress) -> Result<Page, PageError> {
    let (mut runs, mut left_out) = (Vec::new(), Vec::new());
    for (path, name) in paths.iter().zip(load::names(paths)) {
        match JudgedRun::read(path, name, progress) {
            Ok(run) => runs.push(run),
            Err(reason) => left_out.push(LeftOut { run: path.clone(), reason }),
        }
    }
    if runs.is_empty() && !left_out.is_empty() {
        return Err(left_out.swap_remove(0).reason.into());
    }
    let mut data = ReportData { title: title(&runs), ..ReportData::default() };
    if !left_out.is_empty() {
        let reasons = left_out.iter().map(|of| of.reason.to_string()).collect::<Vec<_>>().join("; ");
        let (out, all) = (left_out.len(), paths.len());
        data.statements.push(format!("{out} of {all} runs failed or are incomplete and are left out: {reasons}."));
    }
    let sets = sets(&runs);
    if sets.len() > 1 {
        data.statements.push(format!(
            "These runs were judged in {} different sets of test scenarios. Runs of different sets are not paired, and no difference between \
             them is taken: what looks like a difference may be that of the scenarios.",
            sets.len()
        ));
    }
    for set in &sets {
        add_set(&mut data, set, sets.len() > 1).map_err(JudgeError::from)?;
    }
    for run in &runs {
        add_run(&mut data, run)?;
    }
    let path = runs[0].path.join(REPORT);
    atomic::write(&path, render(&data).as_bytes()).map_err(JudgeError::from)?;
    Ok(Page { path, left_out })
}

/// The runs by their test scenarios, in the order given.
fn sets(runs: &[JudgedRun]) -> Vec<Vec<&JudgedRun>> {
    let mut sets: Vec<Vec<&JudgedRun>> = Vec::new();
    for run in runs {
        match sets.iter_mut().find(|set| set[0].same_tests(run)) {
            Some(set) => set.push(run),
            None => sets.push(vec![run]),
        }
    }
    sets
}

/// Adds the results of runs in the same scenarios: of methods over their seeds, and of each policy alone.
fn add_set(data: &mut ReportData, runs: &[&JudgedRun], named: bool) -> Result<(), StatsError> {
    let mut episodes: Vec<PolicyEpisodes> = Vec::new();
    // Rules drive alike in paired scenarios; once is enough.
    for of in runs.iter().flat_map(|run| &run.episodes) {
        if !episodes.iter().any(|known| known.policy == of.policy) {
            episodes.push(of.clone());
        }
    }
    runs_first(&mut episodes);
    let results = episodes.iter().map(PolicyEpisodes::result).collect::<Result<Vec<_>, _>>()?;
    let Pooled { methods, statements } = methods::pool(runs);
    data.statements.extend(statements);
    let rules: Vec<&PolicyEpisodes> = episodes.iter().filter(|of| of.policy.starts_with(RULE)).collect();
    let set = ScenarioSet {
        name: if named { list(runs) } else { String::new() },
        methods: methods::results(&methods)?,
        differences: methods::differences(&methods, &rules)?,
        improvement: methods::improvement(&methods)?,
        results,
    };
    data.statements.extend(seeds_stated(&methods, runs, &set.methods));
    let summary = if let Some(first) = set.methods.first() {
        method_reading(first, &set)
    } else {
        let comparisons = compare(&episodes)?;
        data.statements.extend(comparisons.iter().map(Comparison::to_string));
        reading(&set.results[0], &comparisons)
    };
    data.summary.extend(summary);
    data.sets.push(set);
    Ok(())
}

/// How many trainings stand behind the figures, and what that means.
fn seeds_stated(methods: &[Method], runs: &[&JudgedRun], results: &[MethodResult]) -> Vec<String> {
    let mut statements = Vec::new();
    for (method, result) in methods.iter().zip(results) {
        let seeds = method.runs().len();
        if seeds < ENOUGH_SEEDS {
            statements.push(format!(
                "{} has {seeds} training seeds. With fewer than {ENOUGH_SEEDS} the intervals are wide, and small differences are not found.",
                result.name
            ));
        }
    }
    let pooled: usize = methods.iter().map(|method| method.runs().len()).sum();
    if runs.len() > 1 && pooled < runs.len() {
        statements.push(
            "Runs that stand alone have one training seed: their intervals and differences are those of these very policies over scenarios, \
             and say nothing of another training."
                .to_owned(),
        );
    }
    statements
}

/// What a lead in reward says of the first method's trainings.
const VERDICTS: [&str; 3] =
    ["In reward its trainings beat", "They fall behind", "These seeds do not settle the order with"];

/// The first method's results in words, collisions beside speed and reward.
fn method_reading(first: &MethodResult, set: &ScenarioSet) -> Vec<String> {
    let percent = |interval: Interval| {
        format!("{:.1} % ({:.1} to {:.1} %)", 100.0 * interval.mean, 100.0 * interval.low, 100.0 * interval.high)
    };
    let mut sentences = vec![format!(
        "Over {} training seeds, {} drives {:.1} km/h on average and earns {:.2} per tick ({:.2} to {:.2}); {} of its episodes end in a \
         collision, {} by its own fault.",
        first.runs.len(),
        first.name,
        3.6 * first.speed_mps.mean,
        first.reward_per_tick.mean,
        first.reward_per_tick.low,
        first.reward_per_tick.high,
        percent(first.collisions_per_episode),
        percent(first.at_fault_collisions_per_episode)
    )];
    let verdict = |lead: &Interval| match lead {
        lead if lead.low > 0.0 => VERDICTS[0],
        lead if lead.high < 0.0 => VERDICTS[1],
        _ => VERDICTS[2],
    };
    let own = || set.differences.iter().filter(|difference| difference.method == first.name);
    for said in VERDICTS {
        let others: Vec<&str> =
            own().filter(|d| verdict(&d.reward_per_tick) == said).map(|d| d.other.as_str()).collect();
        if !others.is_empty() {
            sentences.push(format!("{said} {}.", others.join(", ")));
        }
    }
    sentences
}

fn list(runs: &[&JudgedRun]) -> String {
    runs.iter().map(|run| run.name.as_str()).collect::<Vec<_>>().join(", ")
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

/// The names of a few runs; of more, how many.
fn title(runs: &[JudgedRun]) -> String {
    const NAMED: usize = 4;
    let names: Vec<&str> = runs.iter().take(NAMED).map(|run| run.name.as_str()).collect();
    let more = runs.len().saturating_sub(NAMED);
    format!("Lanecraft: {}{}", names.join(", "), if more > 0 { format!(" and {more} more") } else { String::new() })
}

/// Runs before rules, else in the order given.
fn runs_first(episodes: &mut [PolicyEpisodes]) {
    episodes.sort_by_key(|of| of.policy.starts_with(RULE));
}

/// Adds what a run has beside its results; of episode, reward and times the first run's.
fn add_run(data: &mut ReportData, run: &JudgedRun) -> Result<(), JudgeError> {
    let JudgedRun { path, name, config, curve, .. } = run;
    data.curves.push((name.clone(), curve.clone()));
    if data.trace.is_none() && path.join(TRACE).exists() {
        data.trace = Some(read_trace(&path.join(TRACE))?);
    }
    if data.irl.is_none() {
        data.irl = read_json::<IrlReport>(&path.join(HUMAN_REWARD))?.as_ref().map(summary);
    }
    if data.time_shares.is_empty() {
        data.time_shares = read_json(&path.join(TIMES))?.unwrap_or_default();
    }
    data.config_toml.extend(["# ", name, "\n", &config.to_toml(), "\n"]);
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
