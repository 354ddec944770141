//! Judged runs from their folders, each whole or with the reason why not.

use std::path::{Path, PathBuf};

use crate::config::RunConfig;
use crate::evaluate::{EpisodeResult, PolicyEpisodes};
use crate::judge::{EPISODES, JudgeError, judge, read_episodes};
use crate::metrics::CurvePoint;
use crate::pairing::same_scenarios;
use crate::policy::run_name;
use crate::progress::Progress;
use crate::run_dir::{RunDir, RunDirError};
use crate::runs;

/// A run with what it did in its test scenarios.
pub(super) struct JudgedRun {
    pub(super) path: PathBuf,
    /// Its folder's name, or its whole path if another run has that name.
    pub(super) name: String,
    pub(super) config: RunConfig,
    pub(super) curve: Vec<CurvePoint>,
    /// Its own policy's episodes first, then those of the rules.
    pub(super) episodes: Vec<PolicyEpisodes>,
}

impl JudgedRun {
    /// Reads a run; one that was not judged yet is judged first.
    pub(super) fn read(path: &Path, name: String, progress: &Progress) -> Result<Self, JudgeError> {
        let (run, _) = RunDir::open(path)?;
        let config = runs::read_config(path)?;
        // What is read here is what a finished run must have, so that one that lacks it is refused before anything is drawn.
        runs::read_policy(path)?;
        let curve = runs::read_curve(path)?;
        if !path.join(EPISODES).exists() {
            judge(&run, &config, None, progress)?;
        }
        let mut episodes = read_episodes(path)?;
        check_whole(path, &episodes, config.evaluation.episodes)?;
        // The folder may have been renamed since.
        name.clone_into(&mut episodes[0].policy);
        Ok(Self { path: path.to_owned(), name, config, curve, episodes })
    }

    /// The episodes of the run's own policy.
    pub(super) fn own(&self) -> &[EpisodeResult] {
        &self.episodes[0].episodes
    }

    /// Whether both were judged in the same test scenarios, so that their episodes can be paired.
    pub(super) fn same_tests(&self, other: &Self) -> bool {
        seeds(self.own()).eq(seeds(other.own()))
            && self.config.evaluation.episode_s == other.config.evaluation.episode_s
            && same_scenarios(&self.config.environment, &other.config.environment)
    }
}

fn seeds(episodes: &[EpisodeResult]) -> impl Iterator<Item = u64> {
    episodes.iter().map(|episode| episode.scenario_seed)
}

/// A judgment that was cut short has fewer episodes, or other ones for some of the policies.
fn check_whole(path: &Path, episodes: &[PolicyEpisodes], expected: usize) -> Result<(), RunDirError> {
    let short = episodes
        .iter()
        .find(|of| of.episodes.len() != expected || !seeds(&of.episodes).eq(seeds(&episodes[0].episodes)));
    let message = match (episodes.is_empty(), short) {
        (false, None) => return Ok(()),
        (true, _) => "it has no episode".to_owned(),
        (false, Some(of)) => {
            format!("it has {} of {expected} episodes of {}", of.episodes.len(), of.policy)
        }
    };
    Err(RunDirError::Broken { path: path.join(EPISODES), message: message + "; remove it to judge the run anew" })
}

/// The names of runs: of their folders, or their paths where folders of one name lie in different places.
pub(super) fn names(paths: &[PathBuf]) -> Vec<String> {
    let short: Vec<String> = paths.iter().map(|path| run_name(path)).collect();
    let unique = |name: &String| short.iter().filter(|other| *other == name).count() == 1;
    let name = |(path, name): (&PathBuf, &String)| if unique(name) { name.clone() } else { path.display().to_string() };
    paths.iter().zip(&short).map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::names;

    #[test]
    fn folders_of_one_name_are_told_apart() {
        let paths = ["x/seed-0", "y/seed-0", "y/seed-1"].map(Into::into);
        assert_eq!(names(&paths), ["x/seed-0", "y/seed-0", "seed-1"]);
    }
}
