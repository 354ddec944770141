//! From a source of demonstrations to a judged reward, in one call.

use std::path::PathBuf;

use lanecraft_learn::irl::IrlConfig;

use crate::candidates::{CandidateConfig, Choices};
use crate::data::TableError;
use crate::data::events::read_events;
use crate::demonstrations::file::{self, FileError};
use crate::demonstrations::synthetic::{SyntheticConfig, synthetic};
use crate::demonstrations::{Demonstrations, Device, Kind};
use crate::irl::page::figures;
use crate::irl::{IrlReport, LearnError, fit, fit_and_test};
use crate::report::{IrlFeature, IrlSummary};

/// Synthetic drivers to learn from, and others to be judged on: ten times the paper's 50 and 10.
const SYNTHETIC_TRAIN: u32 = 500;
const SYNTHETIC_TEST: u32 = 100;
/// Seeds of the two sets.
const SYNTHETIC_SEEDS: [u64; 2] = [1, 2];

/// The learned reward and what it is worth, in a run.
pub const HUMAN_REWARD: &str = "human-reward.json";

/// Where demonstrations come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Source {
    /// The built-in synthetic drivers, whose reward is known.
    Synthetic,
    /// A file of demonstrations, or a folder with the tables of recorded lane changes.
    At(PathBuf),
}

/// Why a reward could not be learned.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HumanRewardError {
    /// The tables cannot be read.
    #[error(transparent)]
    Data(#[from] TableError),
    /// The file cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// Demonstrations of several kinds in one file.
    #[error("{} holds demonstrations of several kinds ({kinds:?}); split them", path.display())]
    Kinds {
        /// The file.
        path: PathBuf,
        /// The kinds.
        kinds: Vec<Kind>,
    },
    /// The fit failed.
    #[error(transparent)]
    Fit(#[from] LearnError),
}

/// The demonstrations of `source`; of synthetic drivers those to learn from.
///
/// # Errors
/// If they cannot be read, or are of several kinds.
pub fn demonstrations(source: &Source, config: &CandidateConfig) -> Result<Demonstrations, HumanRewardError> {
    let Source::At(path) = source else {
        return Ok(synthetic(&SyntheticConfig::default(), config, SYNTHETIC_SEEDS[0], SYNTHETIC_TRAIN));
    };
    if path.is_dir() {
        return Ok(Demonstrations::recorded(&read_events(path)?));
    }
    let found = file::read(path)?;
    let mut kinds: Vec<Kind> = found.devices().into_iter().map(Device::kind).collect();
    kinds.dedup();
    if kinds.len() > 1 {
        return Err(HumanRewardError::Kinds { path: path.clone(), kinds });
    }
    Ok(found)
}

/// Learns the reward of the drivers of `source`: those of a file or a folder are judged by leaving out one group (site, driver) in turn,
/// the built-in ones on others.
///
/// # Errors
/// If the demonstrations cannot be read or fitted.
pub fn learn_human_reward(
    source: &Source,
    config: &CandidateConfig,
    irl: &IrlConfig,
) -> Result<IrlReport, HumanRewardError> {
    let train = Choices::new(&demonstrations(source, config)?, config);
    if let Source::At(_) = source {
        return Ok(fit(&train, irl)?);
    }
    let test = synthetic(&SyntheticConfig::default(), config, SYNTHETIC_SEEDS[1], SYNTHETIC_TEST);
    Ok(fit_and_test(&train, &Choices::new(&test, config), irl)?)
}

/// What a report shows of it.
pub fn summary(report: &IrlReport) -> IrlSummary {
    let feature = |(index, name): (usize, &String)| IrlFeature {
        name: name.clone(),
        weight: report.model.weights[index],
        interval: report.weights.get(index).copied(),
        ratio_of_means_error: report.unseen.features[index].ratio_of_means_error,
        mean_absolute_error: report.unseen.features[index].mean_absolute_error,
    };
    let unseen = &report.unseen;
    IrlSummary {
        source: report.model.source.clone(),
        features: report.model.features.iter().enumerate().map(feature).collect(),
        log_likelihood: unseen.duration_log_likelihood.mean,
        uniform_log_likelihood: unseen.uniform_duration,
        duration_density_log_likelihood: unseen.duration_density,
        duration_errors_s: [unseen.duration_error_s.mean, unseen.constant_duration_error_s.mean],
        figures: figures(unseen),
    }
}
