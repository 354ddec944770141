//! The log-likelihood of choices, its gradient and its curvature, in normalized features.

use super::{CandidateSet, IrlNormalization};

/// Ω(ϖ) − ridge · ‖ϖ‖² over normalized features.
pub(super) struct Objective {
    /// For each event its candidates' normalized features.
    events: Vec<CandidateSet>,
    /// What each feature was divided by; 0 for one that never varies.
    scale: Vec<f64>,
    ridge: f64,
}

/// The objective at one point.
pub(super) struct Evaluation {
    /// Ω alone.
    pub(super) log_likelihood: f64,
    /// The objective: Ω minus the penalty.
    pub(super) value: f64,
    /// Its gradient.
    pub(super) gradient: Vec<f64>,
    /// Minus its second derivatives, F × F row-major; positive semidefinite.
    pub(super) curvature: Vec<f64>,
}

impl Evaluation {
    pub(super) fn gradient_norm(&self) -> f64 {
        self.gradient.iter().map(|g| g * g).sum::<f64>().sqrt()
    }
}

impl Objective {
    pub(super) fn new(events: &[CandidateSet], normalization: IrlNormalization, ridge: f64) -> Self {
        let Moments { mean, magnitude, deviation } = moments(events);
        let sizes = magnitude.iter().zip(&deviation);
        let scale: Vec<f64> = sizes.map(|(size, deviation)| scale(normalization, *size, *deviation)).collect();
        let normalized = |features: &Vec<f64>| {
            // Both normalizations subtract the mean: a shift common to all candidates changes no probability.
            let parts = features.iter().zip(&mean).zip(&scale);
            parts.map(|((x, mean), scale)| if *scale > 0.0 { (x - mean) / scale } else { 0.0 }).collect()
        };
        let events = events.iter();
        let events = events
            .map(|event| CandidateSet {
                features: event.features.iter().map(normalized).collect(),
                chosen: event.chosen,
            })
            .collect();
        Self { events, scale, ridge }
    }

    /// Number of features F.
    pub(super) fn features(&self) -> usize {
        self.scale.len()
    }

    /// Weights of the features as they came.
    pub(super) fn raw_weights(&self, weights: &[f64]) -> Vec<f64> {
        weights.iter().zip(&self.scale).map(|(w, scale)| if *scale > 0.0 { w / scale } else { 0.0 }).collect()
    }

    /// Value, gradient (Eq. 24's: chosen minus expected features) and curvature (the features' covariance).
    pub(super) fn evaluate(&self, weights: &[f64]) -> Evaluation {
        let n = weights.len();
        let squared = weights.iter().map(|w| w * w).sum::<f64>();
        let mut at = Evaluation {
            log_likelihood: 0.0,
            value: 0.0,
            gradient: weights.iter().map(|w| -2.0 * self.ridge * w).collect(),
            curvature: vec![0.0; n * n],
        };
        for event in &self.events {
            at.add_event(event, weights);
        }
        for i in 0..n {
            at.curvature[i * n + i] += 2.0 * self.ridge;
        }
        at.value = at.log_likelihood - self.ridge * squared;
        at
    }
}

impl Evaluation {
    fn add_event(&mut self, event: &CandidateSet, weights: &[f64]) {
        let n = weights.len();
        let scores = scores(weights, &event.features);
        let log_sum = log_sum_exp(&scores);
        self.log_likelihood += scores[event.chosen] - log_sum;
        let mut expected = vec![0.0; n];
        for (score, h) in scores.iter().zip(&event.features) {
            let probability = libm::exp(score - log_sum);
            for i in 0..n {
                expected[i] += probability * h[i];
                for j in 0..n {
                    self.curvature[i * n + j] += probability * h[i] * h[j];
                }
            }
        }
        for i in 0..n {
            self.gradient[i] += event.features[event.chosen][i] - expected[i];
            for j in 0..n {
                self.curvature[i * n + j] -= expected[i] * expected[j];
            }
        }
    }
}

/// ϖᵀH of each candidate.
pub(super) fn scores(weights: &[f64], features: &[Vec<f64>]) -> Vec<f64> {
    features.iter().map(|h| weights.iter().zip(h).map(|(w, h)| w * h).sum()).collect()
}

/// log Σ exp, shifted by the maximum so that nothing overflows.
pub(super) fn log_sum_exp(scores: &[f64]) -> f64 {
    let largest = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    largest + libm::log(scores.iter().map(|score| libm::exp(score - largest)).sum())
}

/// Mean, mean magnitude and standard deviation of each feature over all candidates of all events.
struct Moments {
    mean: Vec<f64>,
    magnitude: Vec<f64>,
    deviation: Vec<f64>,
}

fn moments(events: &[CandidateSet]) -> Moments {
    let n = events[0].features[0].len();
    let rows = || events.iter().flat_map(|event| &event.features);
    let count = rows().count() as f64;
    let (mut mean, mut magnitude) = (vec![0.0; n], vec![0.0; n]);
    for row in rows() {
        for ((mean, magnitude), x) in mean.iter_mut().zip(&mut magnitude).zip(row) {
            *mean += x / count;
            *magnitude += x.abs() / count;
        }
    }
    let mut variance = vec![0.0; n];
    for row in rows() {
        for ((sum, x), mean) in variance.iter_mut().zip(row).zip(&mean) {
            *sum += (x - mean) * (x - mean) / count;
        }
    }
    Moments { mean, magnitude, deviation: variance.into_iter().map(f64::sqrt).collect() }
}

/// What to divide a feature by; 0 marks a feature whose spread is only the rounding of its mean.
fn scale(normalization: IrlNormalization, magnitude: f64, deviation: f64) -> f64 {
    let varies = deviation > 1e-12 * magnitude;
    match normalization {
        IrlNormalization::ZScore if varies => deviation,
        IrlNormalization::Mean if varies => magnitude,
        IrlNormalization::ZScore | IrlNormalization::Mean => 0.0,
    }
}
