//! What a better forecast does for the drive (X7): the same policy in the same scenarios, planner and controllers given one predictor after
//! the other.

use lanecraft_drive::predict::Predictor;
use serde::Serialize;

use super::PredictorError;
use crate::config::{RunConfig, SeedRole};
use crate::evaluate::{PolicyEpisodes, evaluate};
use crate::metrics::{Interval, PolicyResult};
use crate::policy::Policy;
use crate::progress::Progress;

/// Number of predictors that are compared.
pub const PREDICTORS: usize = Predictor::ALL.len();

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

/// Drives `policy` with each predictor; each episode is a step of progress.
///
/// # Errors
/// If a scenario cannot be built, or the policy fails.
pub fn swap(policy: &Policy, config: &RunConfig, progress: &Progress) -> Result<Vec<Swap>, PredictorError> {
    let mut driven: Vec<(Predictor, PolicyEpisodes)> = Vec::new();
    for predictor in Predictor::ALL {
        let mut environment = config.environment.clone();
        environment.prediction.predictor = predictor;
        driven.push((predictor, evaluate(policy, &environment, &config.evaluation, SeedRole::Test, progress)?));
    }
    let swaps = driven.iter().map(|(predictor, episodes)| {
        Ok(Swap {
            predictor: predictor.name(),
            result: episodes.result()?,
            reward_lead: episodes.reward_difference(&driven[0].1)?,
        })
    });
    swaps.collect()
}
