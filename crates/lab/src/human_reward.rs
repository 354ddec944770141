//! From a source of demonstrations to a judged reward, in one call.

use std::path::PathBuf;

use lanecraft_learn::irl::{IrlConfig, IrlError};

use crate::data::TableError;
use crate::data::events::read_events;
use crate::demonstrations::{RecordedConfig, SyntheticConfig, recorded, synthetic};
use crate::irl::{IrlReport, fit, fit_and_test};
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
    /// Recorded lane changes in this folder.
    Recorded(PathBuf),
}

/// Why a reward could not be learned.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HumanRewardError {
    /// The recordings cannot be read.
    #[error(transparent)]
    Data(#[from] TableError),
    /// The fit failed.
    #[error(transparent)]
    Fit(#[from] IrlError),
}

/// Learns the reward of the drivers of `source`: recorded ones are judged by leaving out one site in turn, synthetic ones on others.
pub fn learn_human_reward(source: &Source, config: &IrlConfig) -> Result<IrlReport, HumanRewardError> {
    match source {
        Source::Synthetic => {
            let drivers = SyntheticConfig::default();
            let [train, test] = SYNTHETIC_SEEDS;
            let (train, test) =
                (synthetic(&drivers, train, SYNTHETIC_TRAIN), synthetic(&drivers, test, SYNTHETIC_TEST));
            Ok(fit_and_test(&train, &test, config)?)
        }
        Source::Recorded(folder) => Ok(fit(&recorded(&read_events(folder)?, &RecordedConfig::default()), config)?),
    }
}

/// What a report shows of it.
pub fn summary(report: &IrlReport) -> IrlSummary {
    let feature = |(index, name): (usize, &String)| IrlFeature {
        name: name.clone(),
        weight: report.model.weights[index],
        interval: None,
        ratio_of_means_error: report.unseen.features[index].ratio_of_means_error,
        mean_absolute_error: report.unseen.features[index].mean_absolute_error,
    };
    IrlSummary {
        source: report.model.source.clone(),
        features: report.model.features.iter().enumerate().map(feature).collect(),
        log_likelihood: report.unseen.log_likelihood,
        uniform_log_likelihood: report.unseen.uniform,
        duration_density_log_likelihood: report.unseen.duration_density,
    }
}
