//! The main job: learn how people change lanes, train a driver, compare it, and put it all on one page.

use std::path::PathBuf;
use std::time::Instant;

use crate::config::RunConfig;
use crate::human_reward::{HUMAN_REWARD, HumanRewardError, Source, learn_human_reward};
use crate::irl::IrlReport;
use crate::judge::{JudgeError, judge};
use crate::pages::{PageError, report};
use crate::progress::Progress;
use crate::run_dir::RunDir;
use crate::runs;

/// Decisions of the quick start's training: enough to overtake the rules, and done in well under a minute on two cores.
pub const QUICKSTART_DECISIONS: u64 = 60_000;

/// Learns the human reward and lays it into the planner of `config`.
pub fn with_human_reward(source: &Source, config: &mut RunConfig) -> Result<IrlReport, HumanRewardError> {
    let report = learn_human_reward(source, &config.candidates, &config.irl)?;
    let planner = &mut config.environment.planner;
    *planner = planner.clone().with_reward(&report.model);
    Ok(report)
}

/// Trains, judges and reports in `run`, whose configuration is `config` with the reward of `irl` in its planner. Returns where the
/// page is.
pub fn quickstart(
    run: &RunDir,
    config: &RunConfig,
    irl: &IrlReport,
    progress: &Progress,
) -> Result<PathBuf, PageError> {
    let text = serde_json::to_vec_pretty(irl).expect("plain numbers and names serialize");
    run.write(HUMAN_REWARD, &text).map_err(JudgeError::from)?;
    let begun = Instant::now();
    let updates_s = runs::train(run, config, progress).map_err(JudgeError::from)?;
    judge(run, config, Some((begun.elapsed().as_secs_f64(), updates_s)), progress)?;
    Ok(report(&[run.path().to_owned()], progress)?.path)
}
