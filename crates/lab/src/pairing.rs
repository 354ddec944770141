//! Which environment each policy drives in, so that results can be paired: the same seeds must give the same scenarios.

use std::path::{Path, PathBuf};

use lanecraft_drive::env::Config;

use crate::config::{ConfigFileError, RunConfig};
use crate::policy::Policy;
use crate::run_dir::CONFIG;
use crate::runs::{RunError, read_policy};

/// A policy, and the run that it comes from, if any.
#[derive(Clone, Debug)]
pub struct Entrant {
    /// Who drives.
    pub policy: Policy,
    /// The folder of its run.
    pub run: Option<PathBuf>,
}

impl Entrant {
    /// The policy of a finished run.
    pub fn of_run(run: &Path) -> Result<Self, RunError> {
        Ok(Self { policy: read_policy(run)?, run: Some(run.to_owned()) })
    }
}

impl From<Policy> for Entrant {
    fn from(policy: Policy) -> Self {
        Self { policy, run: None }
    }
}

/// Why policies cannot drive side by side.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PairingError {
    /// The configuration of a run cannot be used.
    #[error(transparent)]
    Config(#[from] ConfigFileError),
    /// Two runs know different scenarios.
    #[error(
        "{} and {} were trained on other roads or in other traffic, so their scenarios cannot be paired",
        first.display(),
        other.display()
    )]
    OtherScenarios {
        /// The first run.
        first: PathBuf,
        /// The one that differs from it.
        other: PathBuf,
    },
}

/// The environment of each entrant: that of its run, which `of_run` reads from the configuration file of the run; for those without, that
/// of the first run, or else `without_run`.
///
/// # Errors
/// If a configuration cannot be used, or the scenarios of two runs differ.
pub fn environments(
    entrants: &[Entrant],
    without_run: &Config,
    of_run: impl Fn(&Path) -> Result<RunConfig, ConfigFileError>,
) -> Result<Vec<Config>, PairingError> {
    let mut first: Option<(&Path, Config)> = None;
    let mut own = Vec::new();
    for entrant in entrants {
        let Some(run) = entrant.run.as_deref() else {
            own.push(None);
            continue;
        };
        let environment = of_run(&run.join(CONFIG))?.environment;
        let (path, expected) = first.get_or_insert_with(|| (run, environment.clone()));
        if !same_scenarios(&environment, expected) {
            return Err(PairingError::OtherScenarios { first: path.to_path_buf(), other: run.to_owned() });
        }
        own.push(Some(environment));
    }
    let others = first.map_or_else(|| without_run.clone(), |(_, environment)| environment);
    Ok(own.into_iter().map(|environment| environment.unwrap_or_else(|| others.clone())).collect())
}

/// Whether the same seeds give the same scenarios in both: a scenario file stands for road and traffic.
pub(crate) fn same_scenarios(a: &Config, b: &Config) -> bool {
    a.env.scenario == b.env.scenario && (!a.env.scenario.is_empty() || (&a.road, &a.traffic) == (&b.road, &b.traffic))
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use super::{Entrant, PairingError, environments};
    use crate::baselines::Rule;
    use crate::config::{Preset, RunConfig};
    use crate::policy::Policy;

    fn entrants(runs: &[Option<&str>]) -> Vec<Entrant> {
        let policy = Policy::Rule(Rule::KeepLane);
        runs.iter().map(|run| Entrant { policy: policy.clone(), run: run.map(PathBuf::from) }).collect()
    }

    /// Runs whose folders' names are their lanes' widths.
    fn environment(path: &Path) -> RunConfig {
        let width_m = path.parent().and_then(Path::to_str).expect("a folder");
        RunConfig::resolve(Preset::Default, None, &[format!("road.lane_width_m={width_m}")]).expect("in range")
    }

    #[test]
    fn who_has_no_run_drives_in_the_environment_of_the_first_one() {
        let without = RunConfig::default().environment;
        let widths = |runs: &[Option<&str>]| {
            let found = environments(&entrants(runs), &without, |path| Ok(environment(path))).expect("all fit");
            found.into_iter().map(|config| config.road.lane_width_m).collect::<Vec<_>>()
        };
        assert_eq!(widths(&[None, None]), [without.road.lane_width_m; 2]);
        assert_eq!(widths(&[None, Some("3.5"), None]), [3.5; 3]);
    }

    #[test]
    fn runs_on_different_roads_cannot_be_paired() {
        let without = RunConfig::default().environment;
        let found = environments(&entrants(&[Some("3.5"), Some("3.9")]), &without, |path| Ok(environment(path)));
        assert!(matches!(found, Err(PairingError::OtherScenarios { .. })));
    }
}
