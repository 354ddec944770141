//! Maximum-entropy inverse reinforcement learning over finite candidate sets (Eqs. 20 to 24, Algorithm 2).
//!
//! A driver chose one of a set of candidates, each described by features H. With rewards ϖᵀH the probability of a candidate
//! is `P = exp(ϖᵀH) / Σ exp(ϖᵀH_j)` (Ziebart et al., 2008, on discrete sets as Kuderer et al., 2015), and the weights ϖ maximize
//! the log-likelihood of the choices, `Ω = Σ (ϖᵀH_chosen − log Σ exp(ϖᵀH_j))`, whose gradient is the features chosen minus the
//! features expected. Features that are costs get negative weights; their cost weights are −ϖ.
//!
//! Departures from the paper:
//! - The printed denominator of P has another letter for ϖ, read as a slip.
//! - Features are normalized first; on raw features of different sizes the printed learning rate diverges.
//! - The objective is concave, so the default is Newton's method with a line search; Algorithm 2's gradient ascent remains.
//! - A ridge penalty `ridge · ‖ϖ‖²` on the normalized weights keeps them finite where the choices could be explained
//!   perfectly, and decides between weights that the choices cannot tell apart. Cross-validation over groups of events chooses it.
//! - The candidate set contains the choice itself (or the candidate nearest to it), else Ω can be unbounded.
//!
//! ```
//! use lanecraft_learn::irl::{CandidateSet, IrlConfig, fit};
//!
//! // Twice the cheaper of two candidates was chosen, once the dearer.
//! let event = |chosen| CandidateSet { features: vec![vec![1.0], vec![2.0]], chosen };
//! let found = fit(&[event(0), event(0), event(1)], &IrlConfig { ridge: 0.0, ..IrlConfig::default() })?;
//! assert!((found.probabilities(&event(0))?[0] - 2.0 / 3.0).abs() < 1e-6);
//! # Ok::<(), lanecraft_learn::irl::IrlError>(())
//! ```

mod objective;
mod problem;
mod solve;
mod symmetric;

pub use problem::{Identifiability, Problem, RidgeScore};

use serde::{Deserialize, Serialize};

use crate::ConfigError;
use crate::config::{above_zero, count};
use objective::{log_sum_exp, scores};

/// Sums of squares of features up to this size stay finite.
const MAX_FEATURE: f64 = 1e100;

/// How the weights are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IrlMethod {
    /// Newton's method with a line search.
    Newton,
    /// Gradient ascent with the gradient summed over all events: Algorithm 2.
    GradientAscent,
}

/// Where the ridge comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RidgeChoice {
    /// The one given.
    Fixed,
    /// The one of several under which groups left out are most likely; the one given where there is a single group.
    CrossValidation,
}

/// How features are made comparable; means and deviations are those of all candidates of all sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IrlNormalization {
    /// Minus the mean, divided by the standard deviation.
    ZScore,
    /// Divided by the mean magnitude; with it the printed learning rate converges on about 50 events.
    Mean,
    /// Left as they come, to the letter of Algorithm 2; on features of different sizes the printed learning rate diverges.
    None,
}

/// Settings of a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct IrlConfig {
    /// How the weights are found. Paper: gradient ascent.
    pub method: IrlMethod,
    /// How features are made comparable. Preset `paper`: `mean`; the paper is silent.
    pub normalization: IrlNormalization,
    /// Where the ridge comes from.
    pub ridge_choice: RidgeChoice,
    /// Penalty for each unit of squared normalized weight, in units of log-likelihood summed over events. Preset `paper`: 0.
    pub ridge: f64,
    /// Ridges to choose from by cross-validation, rising.
    pub ridges: Vec<f64>,
    /// Folds of the cross-validation, at most one for each group.
    pub folds: usize,
    /// Resamplings behind the intervals of the weights.
    pub bootstrap_replicates: usize,
    /// Iterations of Newton's method at most.
    pub max_iterations: usize,
    /// Norm of the gradient for each event at which a fit has converged.
    pub gradient_tolerance: f64,
    /// Learning rate ρ of gradient ascent. Paper: 0.08.
    pub learning_rate: f64,
    /// Episodes E of gradient ascent. Paper: 150.
    pub episodes: usize,
}

impl Default for IrlConfig {
    fn default() -> Self {
        Self {
            method: IrlMethod::Newton,
            normalization: IrlNormalization::ZScore,
            ridge_choice: RidgeChoice::Fixed,
            ridge: 0.1,
            ridges: vec![0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0],
            folds: 5,
            bootstrap_replicates: 200,
            max_iterations: 100,
            gradient_tolerance: 1e-6,
            learning_rate: 0.08,
            episodes: 150,
        }
    }
}

impl IrlConfig {
    /// Checks every setting; NaN is outside every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let refuse = |key, value, allowed: &str| Err(ConfigError { key, value, allowed: allowed.to_owned() });
        if !(0.0..=1e9).contains(&self.ridge) {
            return refuse("irl.ridge", self.ridge.to_string(), "in 0..=1e9");
        }
        let rising = self.ridges.windows(2).all(|pair| pair[0] < pair[1]);
        if self.ridges.is_empty() || !rising || !self.ridges.iter().all(|ridge| (0.0..=1e9).contains(ridge)) {
            return refuse("irl.ridges", format!("{:?}", self.ridges), "at least one, rising, in 0..=1e9");
        }
        count("irl.folds", self.folds, 2, 1000)?;
        count("irl.bootstrap_replicates", self.bootstrap_replicates, 2, 100_000)?;
        count("irl.max_iterations", self.max_iterations, 1, 100_000)?;
        above_zero("irl.gradient_tolerance", self.gradient_tolerance, 1.0)?;
        above_zero("irl.learning_rate", self.learning_rate, 1e6)?;
        count("irl.episodes", self.episodes, 1, 10_000_000)
    }
}

/// The candidates of one event and which of them was chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct CandidateSet {
    /// Features of each candidate, in the same order and number for all.
    pub features: Vec<Vec<f64>>,
    /// Index of the chosen candidate.
    pub chosen: usize,
}

/// Events that cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IrlError {
    /// No event at all.
    #[error("there are no events to fit")]
    NoEvents,
    /// An event without candidates.
    #[error("event {event} has no candidates")]
    EmptySet {
        /// Index of the event.
        event: usize,
    },
    /// A choice that is none of the candidates.
    #[error("event {event} chose candidate {chosen}, but has {count}")]
    Chosen {
        /// Index of the event.
        event: usize,
        /// The choice found.
        chosen: usize,
        /// Number of candidates.
        count: usize,
    },
    /// A candidate with another number of features than the first one, or with none.
    #[error("event {event}, candidate {candidate} has {found} features, but must have {expected} (at least 1)")]
    FeatureCount {
        /// Index of the event.
        event: usize,
        /// Index of the candidate.
        candidate: usize,
        /// Number of features required.
        expected: usize,
        /// Number of features found.
        found: usize,
    },
    /// A feature that is not a number, infinite or so large that its square is.
    #[error("event {event}, candidate {candidate}, feature {feature} is {value}, but must be a number within ±1e100")]
    Feature {
        /// Index of the event.
        event: usize,
        /// Index of the candidate.
        candidate: usize,
        /// Index of the feature.
        feature: usize,
        /// The value found.
        value: f64,
    },
    /// The weights grew beyond all numbers.
    #[error("the fit diverged in iteration {iteration}; lower `irl.learning_rate` or scale the features")]
    Diverged {
        /// Iterations made.
        iteration: usize,
    },
    /// Settings outside their range.
    #[error(transparent)]
    Config(#[from] ConfigError),
}

/// Whether a fit may be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IrlVerdict {
    /// The gradient is below its tolerance.
    Converged,
    /// The iterations, or the digits of the numbers, ended first.
    NotConverged,
}

/// Fitted weights, one for each feature, and how good they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IrlFit {
    /// Weights of normalized features, comparable with each other.
    pub normalized_weights: Vec<f64>,
    /// Weights of the features as they came; 0 for a feature that never varies.
    pub weights: Vec<f64>,
    /// Mean of each feature over all candidates.
    pub means: Vec<f64>,
    /// What each feature was divided by; 0 for one that never varies.
    pub scales: Vec<f64>,
    /// The penalty used.
    pub ridge: f64,
    /// Log-likelihood of the choices, the mean over the events, without the penalty.
    pub log_likelihood_per_event: f64,
    /// The same of choices at random, −log of the number of candidates.
    pub uniform_log_likelihood_per_event: f64,
    /// Norm of the objective's gradient in normalized weights, penalty included, for each event.
    pub gradient_norm: f64,
    /// Iterations made.
    pub iterations: usize,
    /// Whether the weights maximize the objective.
    pub verdict: IrlVerdict,
}

/// Fits weights to the choices of all events, each a group of its own.
pub fn fit(events: &[CandidateSet], config: &IrlConfig) -> Result<IrlFit, IrlError> {
    let groups: Vec<usize> = (0..events.len()).collect();
    Problem::new(events, &groups, config)?.fit(config)
}

impl IrlFit {
    /// Probability of each candidate of a set; its `chosen` does not matter.
    pub fn probabilities(&self, set: &CandidateSet) -> Result<Vec<f64>, IrlError> {
        self.check_set(set)?;
        let scores = scores(&self.weights, &set.features);
        let log_sum = log_sum_exp(&scores);
        Ok(scores.iter().map(|score| libm::exp(score - log_sum)).collect())
    }

    /// The most probable candidate, the lowest index of equals.
    pub fn best(&self, set: &CandidateSet) -> Result<usize, IrlError> {
        self.check_set(set)?;
        let scores = scores(&self.weights, &set.features);
        Ok((1..scores.len()).fold(0, |best, index| if scores[index] > scores[best] { index } else { best }))
    }

    /// Log-probability of the chosen candidate of a set, as for events left out of the fit.
    pub fn log_likelihood(&self, set: &CandidateSet) -> Result<f64, IrlError> {
        self.check_set(set)?;
        let scores = scores(&self.weights, &set.features);
        Ok(scores[set.chosen] - log_sum_exp(&scores))
    }

    fn check_set(&self, set: &CandidateSet) -> Result<(), IrlError> {
        check_event(0, set, self.weights.len())
    }
}

fn check(events: &[CandidateSet]) -> Result<(), IrlError> {
    let first = events.first().ok_or(IrlError::NoEvents)?;
    let expected = first.features.first().map_or(1, Vec::len).max(1);
    events.iter().enumerate().try_for_each(|(event, set)| check_event(event, set, expected))
}

fn check_event(event: usize, set: &CandidateSet, expected: usize) -> Result<(), IrlError> {
    let count = set.features.len();
    if count == 0 {
        return Err(IrlError::EmptySet { event });
    }
    if set.chosen >= count {
        return Err(IrlError::Chosen { event, chosen: set.chosen, count });
    }
    for (candidate, features) in set.features.iter().enumerate() {
        if features.len() != expected {
            return Err(IrlError::FeatureCount { event, candidate, expected, found: features.len() });
        }
        if let Some(feature) = features.iter().position(|value| value.is_nan() || value.abs() > MAX_FEATURE) {
            return Err(IrlError::Feature { event, candidate, feature, value: features[feature] });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
