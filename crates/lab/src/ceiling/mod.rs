//! The ceiling: how much reward a scenario holds for whoever knows its future.
//!
//! A beam search drives each test scenario with the simulator itself as its model, through the same planner, controllers, shield and
//! guard as every policy. What it finds is a drive that was driven, so it bounds the optimum from below; how far below, the gain from
//! doubling the beam's width says. No policy can attain it, because it sees what others are about to do.

mod report;
mod search;

pub use report::report;
pub use search::{Drive, search};

use std::fs;
use std::path::Path;

use lanecraft_drive::env::{Env, EnvError};
use serde::{Deserialize, Serialize};

use crate::config::{RunConfig, SeedRole};
use crate::evaluate::evaluation_environment;
use crate::progress::Progress;
use crate::run_dir::{RunDir, RunDirError, RunLog};

/// The drives that were found, a row for each scenario and width.
pub const CEILING: &str = "ceiling.csv";

/// Why a ceiling cannot be found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CeilingError {
    /// A scenario could not be built.
    #[error(transparent)]
    Env(#[from] EnvError),
    /// The folder.
    #[error(transparent)]
    Dir(#[from] RunDirError),
    /// Every drive that was tried ends in a collision.
    #[error("a beam of {width} finds no drive without a collision in scenario {scenario_seed}; a wider one may")]
    NoWay {
        /// Seed of the scenario.
        scenario_seed: u64,
        /// Width of the beam.
        width: usize,
    },
}

/// The best drive that a beam of one width found in one scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CeilingRow {
    /// Seed of the scenario.
    pub scenario_seed: u64,
    /// Width of the beam.
    pub width: usize,
    /// Mean score of a tick.
    pub reward_per_tick: f64,
    /// Time mean of the speed, m/s.
    pub speed_mps: f64,
    /// Lane changes begun.
    pub lane_changes: u32,
    /// Smallest time to collision, s, capped.
    pub min_time_to_collision_s: f64,
    /// Mean absolute jerk, m/s³.
    pub jerk_mps3: f64,
    /// Ticks that were simulated to find it.
    pub simulated_ticks: u64,
    /// The action of each tick, by which anyone can drive it again.
    pub actions: String,
}

impl CeilingRow {
    fn new(scenario_seed: u64, width: usize, drive: &Drive) -> Self {
        let episode = &drive.episode;
        let actions: Vec<String> = drive.actions.iter().map(ToString::to_string).collect();
        Self {
            scenario_seed,
            width,
            reward_per_tick: episode.mean_score(),
            speed_mps: episode.mean_speed_mps(),
            lane_changes: episode.counts.lane_changes,
            min_time_to_collision_s: episode.min_time_to_collision_s,
            jerk_mps3: episode.mean_jerk_mps3(),
            simulated_ticks: drive.simulated_ticks,
            actions: actions.join(" "),
        }
    }
}

/// Finds the ceilings of the first `scenarios` test scenarios of `config` with beams of each of `widths`, and gives these rows by
/// scenario, then by width. Rows that `run` has are not computed again; new ones are written into it as they come.
pub fn ceilings(
    run: &RunDir,
    config: &RunConfig,
    (scenarios, widths): (usize, &[usize]),
    progress: &Progress,
) -> Result<Vec<CeilingRow>, CeilingError> {
    let environment = evaluation_environment(&config.environment, &config.evaluation);
    let (mut known, mut log) = reopen(&run.path().join(CEILING))?;
    let seeds = (0..scenarios).map(|index| SeedRole::Test.scenario_seed(config.evaluation.seed, index as u64));
    let wanted: Vec<_> = seeds.flat_map(|seed| widths.iter().map(move |&width| (seed, width))).collect();
    let has = |rows: &[CeilingRow], key| rows.iter().position(|row| (row.scenario_seed, row.width) == key);
    let missing: Vec<_> = wanted.iter().filter(|&&key| has(&known, key).is_none()).collect();
    let ticks = u64::from(environment.env.periods().map_err(EnvError::from)?.ticks);
    // A wider beam takes longer in proportion.
    let steps = missing.iter().map(|(_, width)| ticks * *width as u64).sum();
    progress.stage("ceiling", steps, |progress| {
        for &&(scenario_seed, width) in &missing {
            let env = Env::new(&environment, scenario_seed)?;
            let drive = search(&env, width, &|| progress.advance(width as u64));
            let drive = drive.ok_or(CeilingError::NoWay { scenario_seed, width })?;
            let row = CeilingRow::new(scenario_seed, width, &drive);
            log.csv(&row)?;
            known.push(row);
        }
        Ok::<(), CeilingError>(log.sync()?)
    })?;
    Ok(wanted.into_iter().filter_map(|key| has(&known, key).map(|index| known[index].clone())).collect())
}

/// The rows of a log and the log, to be gone on with after its last whole line.
fn reopen(path: &Path) -> Result<(Vec<CeilingRow>, RunLog), RunDirError> {
    if !path.exists() {
        return Ok((Vec::new(), RunLog::create(path)?));
    }
    let text = fs::read(path).map_err(RunDirError::io("read", path))?;
    let whole = text.iter().rposition(|byte| *byte == b'\n').map_or(0, |last| last + 1);
    let broken = |error: csv::Error| RunDirError::Broken { path: path.to_owned(), message: error.to_string() };
    let rows = csv::Reader::from_reader(&text[..whole]).deserialize().collect::<Result<_, _>>().map_err(broken)?;
    Ok((rows, RunLog::resume(path, whole as u64)?))
}

#[cfg(test)]
mod tests {
    use std::fs::{OpenOptions, read_to_string};
    use std::io::Write as _;

    use super::{CEILING, ceilings};
    use crate::config::{Preset, RunConfig};
    use crate::progress::Progress;
    use crate::run_dir::{Existing, Manifest, RunDir};

    #[test]
    fn rows_that_are_there_are_kept_and_a_torn_one_is_made_anew() {
        let config = RunConfig::resolve(Preset::Default, None, &["evaluation.episode_s=4".into()]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let manifest = Manifest::new("ceiling", "default", &config);
        let run = RunDir::create(&folder.path().join("run"), Existing::Refuse, &manifest, &config).unwrap();
        let rows =
            |scenarios, widths: &[usize]| ceilings(&run, &config, (scenarios, widths), &Progress::silent()).unwrap();
        let first = rows(1, &[1, 2]);
        let path = run.path().join(CEILING);
        let text = read_to_string(&path).unwrap();
        let row = text.lines().nth(1).unwrap();
        OpenOptions::new().append(true).open(&path).unwrap().write_all(&row.as_bytes()[..20]).unwrap();

        let all = rows(2, &[1, 2]);
        assert_eq!(all[..2], first[..]);
        assert_eq!(all.iter().map(|row| row.width).collect::<Vec<_>>(), [1, 2, 1, 2]);
        let log = read_to_string(&path).unwrap();
        assert!(log.starts_with(&text) && log.lines().count() == 5, "{log}");
    }
}
