//! What a better forecast does for the drive (X7): the same policies in the same scenarios, planner and controllers given one predictor after
//! the other.

use lanecraft_drive::predict::Predictor;
use serde::Serialize;

use super::PredictorError;
use crate::config::{RunConfig, SeedRole};
use crate::evaluate::evaluate;
use crate::metrics::{Interval, PolicyResult};
use crate::policy::Policy;
use crate::progress::Progress;

/// What is compared: the predictors that a car could have, and the truth.
pub const SWAPPED: [Predictor; Predictor::ALL.len() + 1] = {
    let [first, second, third, fourth] = Predictor::ALL;
    [first, second, third, fourth, Predictor::TrueFuture]
};

/// One predictor in the loop.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Swap {
    /// Which.
    pub predictor: &'static str,
    /// How the policy fared.
    pub result: PolicyResult,
    /// Its reward per tick minus that with constant velocity, scenario by scenario.
    pub reward_lead: Interval,
}

/// Drives each policy with each predictor; each episode is a step of progress.
///
/// # Errors
/// If a scenario cannot be built, or the policy fails.
pub fn swap(policies: &[Policy], config: &RunConfig, progress: &Progress) -> Result<Vec<Swap>, PredictorError> {
    let mut swaps = Vec::new();
    for policy in policies {
        let driven = SWAPPED.map(|predictor| {
            let mut environment = config.environment.clone();
            environment.prediction.predictor = predictor;
            Ok((predictor, evaluate(policy, &environment, &config.evaluation, SeedRole::Test, progress)?))
        });
        let driven = driven.into_iter().collect::<Result<Vec<_>, PredictorError>>()?;
        for (predictor, episodes) in &driven {
            let reward_lead = episodes.reward_difference(&driven[0].1)?;
            swaps.push(Swap { predictor: predictor.name(), result: episodes.result()?, reward_lead });
        }
    }
    Ok(swaps)
}
