//! Events made ready once, to be fitted as a whole, in parts or resampled.
//!
//! The events of a group (a site, a driver) are left out or drawn together, because they share more than the weights.

use lanecraft_net::random::Stream;
use serde::{Deserialize, Serialize};

use super::objective::{Choices, Objective};
use super::solve;
use super::symmetric::eigenvalues;
use super::{CandidateSet, IrlConfig, IrlError, IrlFit, IrlMethod, IrlVerdict, RidgeChoice, check};

/// Seed of the bootstrap's draws.
const BOOTSTRAP_SEED: u64 = 1;

/// What a ridge is worth on events left out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RidgeScore {
    /// The penalty.
    pub ridge: f64,
    /// Mean log-likelihood of an event whose fold was left out.
    pub log_likelihood: f64,
}

/// How far the candidates let the weights be told apart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identifiability {
    /// Correlations of the features within events, F rows; 0 with a feature that never varies within one.
    pub correlations: Vec<Vec<f64>>,
    /// Singular values of the normalized features, centered within events, by falling size. The smallest says how well the worst
    /// known direction of the weights is seen: an error there of about 1/value costs one unit of log-likelihood.
    pub singular_values: Vec<f64>,
}

/// Events in normalized features, with their groups.
pub struct Problem {
    choices: Choices,
    /// Index of each event's group among the groups.
    groups: Vec<usize>,
    group_count: usize,
    /// Mean of −log of the number of candidates.
    uniform: f64,
}

impl Problem {
    /// Checks and normalizes `events`; `groups` has a label for each of them, equal for those of one group.
    ///
    /// # Errors
    /// If a setting is out of range, or an event cannot be fitted.
    ///
    /// # Panics
    /// If there are not as many labels as events.
    pub fn new<L: Ord>(events: &[CandidateSet], groups: &[L], config: &IrlConfig) -> Result<Self, IrlError> {
        assert_eq!(events.len(), groups.len(), "one label for each event");
        config.validate()?;
        check(events)?;
        let mut labels: Vec<&L> = groups.iter().collect();
        labels.sort_unstable();
        labels.dedup();
        let index = |label: &L| labels.partition_point(|other| *other < label);
        let uniform = events.iter().map(|event| -libm::log(event.features.len() as f64)).sum::<f64>();
        Ok(Self {
            choices: Choices::new(events, config.normalization),
            groups: groups.iter().map(index).collect(),
            group_count: labels.len(),
            uniform: uniform / events.len() as f64,
        })
    }

    /// Fits all events, with the ridge that `config` gives or lets choose.
    ///
    /// # Errors
    /// If the weights grow beyond all numbers.
    pub fn fit(&self, config: &IrlConfig) -> Result<IrlFit, IrlError> {
        let ridge = match config.ridge_choice {
            RidgeChoice::CrossValidation if self.group_count > 1 => best(&self.cross_validate(config)),
            RidgeChoice::Fixed | RidgeChoice::CrossValidation => config.ridge,
        };
        let counts = vec![1.0; self.choices.events()];
        let objective = Objective::new(&self.choices, &counts, ridge);
        let found = maximize(&objective, vec![0.0; self.choices.features()], config);
        let count = counts.len() as f64;
        let at = objective.evaluate(&found.weights);
        let gradient_norm = at.gradient_norm() / count;
        if !(gradient_norm.is_finite() && at.log_likelihood.is_finite()) {
            return Err(IrlError::Diverged { iteration: found.iterations });
        }
        let converged = gradient_norm <= config.gradient_tolerance;
        Ok(IrlFit {
            weights: self.choices.raw_weights(&found.weights),
            normalized_weights: found.weights,
            means: self.choices.mean.clone(),
            scales: self.choices.scale.clone(),
            ridge,
            log_likelihood_per_event: at.log_likelihood / count,
            uniform_log_likelihood_per_event: self.uniform,
            gradient_norm,
            iterations: found.iterations,
            verdict: if converged { IrlVerdict::Converged } else { IrlVerdict::NotConverged },
        })
    }

    /// Each ridge of `config`, judged on folds of whole groups: group g is in fold g modulo the number of folds.
    pub fn cross_validate(&self, config: &IrlConfig) -> Vec<RidgeScore> {
        let folds = config.folds.min(self.group_count);
        let mut scores: Vec<RidgeScore> =
            config.ridges.iter().map(|&ridge| RidgeScore { ridge, log_likelihood: 0.0 }).collect();
        for fold in 0..folds {
            let left_out = |event: usize| self.groups[event] % folds == fold;
            let counts: Vec<f64> = (0..self.groups.len()).map(|event| f64::from(u8::from(!left_out(event)))).collect();
            let mut weights = vec![0.0; self.choices.features()];
            for score in &mut scores {
                // The solution for one ridge is a good start for the next one.
                weights = maximize(&Objective::new(&self.choices, &counts, score.ridge), weights, config).weights;
                let tested = (0..counts.len()).filter(|event| left_out(*event));
                let sum: f64 = tested.map(|event| self.choices.log_likelihood(event, &weights)).sum();
                score.log_likelihood += sum / counts.len() as f64;
            }
        }
        scores
    }

    /// Normalized weights fitted with `ridge` to as many groups as there are, drawn with replacement; one vector for each of the
    /// replicates that `config` asks for.
    pub fn bootstrap(&self, fit: &IrlFit, config: &IrlConfig) -> Vec<Vec<f64>> {
        let replicate = |number: usize| {
            let mut stream = Stream::keyed(BOOTSTRAP_SEED, "irl.bootstrap", number as u64, 0);
            let mut drawn = vec![0.0; self.group_count];
            for _ in 0..self.group_count {
                drawn[stream.below(self.group_count)] += 1.0;
            }
            let counts: Vec<f64> = self.groups.iter().map(|group| drawn[*group]).collect();
            let start = match config.method {
                IrlMethod::Newton => fit.normalized_weights.clone(),
                IrlMethod::GradientAscent => vec![0.0; self.choices.features()],
            };
            maximize(&Objective::new(&self.choices, &counts, fit.ridge), start, config).weights
        };
        (0..config.bootstrap_replicates).map(replicate).collect()
    }

    /// Correlations and singular values of the features within events.
    pub fn identifiability(&self) -> Identifiability {
        let n = self.choices.features();
        let mut scatter = vec![0.0; n * n];
        for event in 0..self.choices.events() {
            let count = self.choices.candidates(event).count() as f64;
            let mut mean = vec![0.0; n];
            for h in self.choices.candidates(event) {
                mean.iter_mut().zip(h).for_each(|(mean, x)| *mean += x / count);
            }
            for h in self.choices.candidates(event) {
                for i in 0..n {
                    for j in 0..n {
                        scatter[i * n + j] += (h[i] - mean[i]) * (h[j] - mean[j]);
                    }
                }
            }
        }
        // Normalized features have the size 1: below this there is only the rounding of the means.
        let varies = |i: usize| scatter[i * n + i] > 1e-20 * self.groups.len() as f64;
        let correlation = |i: usize, j: usize| {
            let size = (scatter[i * n + i] * scatter[j * n + j]).sqrt();
            if varies(i) && varies(j) { scatter[i * n + j] / size } else { 0.0 }
        };
        let correlations = (0..n).map(|i| (0..n).map(|j| correlation(i, j)).collect()).collect();
        let mut singular_values: Vec<f64> =
            eigenvalues(scatter, n).into_iter().map(|value| value.max(0.0).sqrt()).collect();
        singular_values.sort_by(|a, b| b.total_cmp(a));
        Identifiability { correlations, singular_values }
    }
}

/// The ridge with the highest likelihood; the largest of equals.
fn best(scores: &[RidgeScore]) -> f64 {
    let better = |a: &RidgeScore, b: &RidgeScore| (b.log_likelihood, b.ridge) > (a.log_likelihood, a.ridge);
    scores.iter().fold(scores[0], |best, score| if better(&best, score) { *score } else { best }).ridge
}

fn maximize(objective: &Objective, start: Vec<f64>, config: &IrlConfig) -> solve::Found {
    match config.method {
        IrlMethod::Newton => solve::newton(objective, start, config.max_iterations, config.gradient_tolerance),
        IrlMethod::GradientAscent => solve::gradient_ascent(objective, config.learning_rate, config.episodes),
    }
}
