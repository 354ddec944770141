//! Learning the planner's reward from demonstrations, and judging it on drivers it has not seen (Eqs. 20–24, Table IV).
//!
//! Candidates that differ in duration alone leave the weights hardly identifiable, so that a fit is judged by what it predicts, not
//! by its weights; a report on identifiability stands beside them. The "average learning errors" of the paper are errors of the
//! columns' means, in which signs cancel; the mean absolute error stands beside them. Intervals come from drawing whole groups
//! (sites, drivers) with replacement.

mod judgment;
pub mod page;
pub mod planners;
pub mod table_iv;

pub use judgment::{Calibration, Fan, FanCurve, FeatureError, Judgment, Outcome, gain};

use lanecraft_drive::plan::RewardModel;
use lanecraft_learn::irl::{Identifiability, IrlConfig, IrlError, IrlFit, Problem, RidgeChoice, RidgeScore};
use serde::{Deserialize, Serialize};

use crate::candidates::Choices;
use crate::metrics::Interval;
use judgment::percentiles;

/// A reward that cannot be learned or judged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LearnError {
    /// No lane change to learn from or to be judged by.
    #[error("there are no lane changes of freeways to learn from or to judge by")]
    Empty,
    /// Leaving out the only group leaves nothing to learn from.
    #[error(
        "all lane changes are of one group, `{group}`: at least two are needed, to judge by one what was learned from others"
    )]
    OneGroup {
        /// The group.
        group: String,
    },
    /// The fit failed.
    #[error(transparent)]
    Fit(#[from] IrlError),
}

/// A reward, how it was found and what it is worth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IrlReport {
    /// The reward learned from all drivers of the training set.
    pub model: RewardModel,
    /// The fit behind it.
    pub fit: IrlFit,
    /// The normalized weights with their 95 % intervals.
    pub weights: Vec<Interval>,
    /// Each ridge that was tried; empty if it was given.
    pub ridges: Vec<RidgeScore>,
    /// How far the candidates let the weights be told apart.
    pub identifiability: Identifiability,
    /// On drivers that were not in training.
    pub unseen: Judgment,
}

/// Learns from all choices; judged by leaving out each group in turn.
///
/// # Errors
/// If there are fewer than two groups, or a fit fails.
pub fn fit(choices: &Choices, config: &IrlConfig) -> Result<IrlReport, LearnError> {
    let outcomes = leave_one_group_out(choices, config)?;
    report(choices, config, &outcomes)
}

/// Learns from `train`; judged on `test`.
///
/// # Errors
/// If either is empty, or the fit fails.
pub fn fit_and_test(train: &Choices, test: &Choices, config: &IrlConfig) -> Result<IrlReport, LearnError> {
    let model = learn(train, config)?.0;
    report(train, config, &outcomes(&model, train, test)?)
}

fn report(train: &Choices, config: &IrlConfig, outcomes: &[Outcome]) -> Result<IrlReport, LearnError> {
    let (model, fit, problem) = learn(train, config)?;
    let replicates = problem.bootstrap(&fit, config);
    let weight = |index: usize| {
        let drawn = replicates.iter().map(|weights| weights[index]).collect();
        percentiles(fit.normalized_weights[index], drawn)
    };
    Ok(IrlReport {
        weights: (0..fit.normalized_weights.len()).map(weight).collect(),
        ridges: match config.ridge_choice {
            RidgeChoice::CrossValidation => problem.cross_validate(config),
            RidgeChoice::Fixed => Vec::new(),
        },
        identifiability: problem.identifiability(),
        unseen: Judgment::new(&train.config, outcomes),
        model,
        fit,
    })
}

/// What came of every driver, with a reward learned from the other groups.
///
/// # Errors
/// If there are fewer than two groups, or a fit fails.
pub fn leave_one_group_out(choices: &Choices, config: &IrlConfig) -> Result<Vec<Outcome>, LearnError> {
    let groups = choices.groups();
    if let [group] = groups[..] {
        return Err(LearnError::OneGroup { group: group.to_owned() });
    }
    let mut outcomes = Vec::new();
    for group in groups {
        let train = choices.filtered(|item| item.group != group);
        let (model, ..) = learn(&train, config)?;
        let tested = choices.items.iter().filter(|item| item.group == group);
        outcomes.extend(tested.map(|item| Outcome::new(&model, &train, item)));
    }
    if outcomes.is_empty() { Err(LearnError::Empty) } else { Ok(outcomes) }
}

/// What comes of the drivers of `test` by `model`, learned from `train`.
///
/// # Errors
/// If `test` is empty.
pub fn outcomes(model: &RewardModel, train: &Choices, test: &Choices) -> Result<Vec<Outcome>, LearnError> {
    if test.items.is_empty() {
        return Err(LearnError::Empty);
    }
    Ok(test.items.iter().map(|item| Outcome::new(model, train, item)).collect())
}

/// The reward that explains `train` best.
fn learn(train: &Choices, config: &IrlConfig) -> Result<(RewardModel, IrlFit, Problem), LearnError> {
    if train.items.is_empty() {
        return Err(LearnError::Empty);
    }
    let problem = Problem::new(&train.sets(), &train.labels(), config)?;
    let fit = problem.fit(config)?;
    // A feature that never varies has the weight 0, whatever its scale.
    let scale = |scale: &f64| if *scale > 0.0 { *scale } else { 1.0 };
    let model = RewardModel {
        features: train.config.features.clone(),
        definition: train.config.definition.clone(),
        mean: fit.means.clone(),
        scale: fit.scales.iter().map(scale).collect(),
        weights: fit.normalized_weights.clone(),
        source: train.source.clone(),
    };
    Ok((model, fit, problem))
}

#[cfg(test)]
mod tests;
