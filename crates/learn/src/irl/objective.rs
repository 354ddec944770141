//! The log-likelihood of choices, its gradient and its curvature, in normalized features.

use super::{CandidateSet, IrlNormalization};

/// The candidates of all events in one block, normalized.
pub(super) struct Choices {
    /// Normalized features, candidates × F row-major, event by event.
    rows: Vec<f64>,
    events: Vec<Event>,
    /// What was subtracted from each feature.
    pub(super) mean: Vec<f64>,
    /// What each feature was divided by; 0 for one that never varies.
    pub(super) scale: Vec<f64>,
}

/// Where an event's candidates lie in the block, in candidates.
#[derive(Clone, Copy)]
struct Event {
    begin: usize,
    end: usize,
    chosen: usize,
}

/// Σ counts · log P(choice) − ridge · ‖ϖ‖² over normalized features.
pub(super) struct Objective<'a> {
    choices: &'a Choices,
    /// How often each event counts: 1 for all of them in a fit, 0 for those left out.
    counts: &'a [f64],
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

impl Choices {
    pub(super) fn new(events: &[CandidateSet], normalization: IrlNormalization) -> Self {
        let Moments { mean, magnitude, deviation } = moments(events);
        let sizes = magnitude.iter().zip(&deviation);
        let scale: Vec<f64> = sizes.map(|(size, deviation)| scale(normalization, *size, *deviation)).collect();
        let mut rows = Vec::new();
        let mut spans = Vec::with_capacity(events.len());
        let mut begin = 0;
        for event in events {
            for features in &event.features {
                // All normalizations subtract the mean: a shift common to all candidates changes no probability.
                let parts = features.iter().zip(&mean).zip(&scale);
                rows.extend(parts.map(|((x, mean), scale)| if *scale > 0.0 { (x - mean) / scale } else { 0.0 }));
            }
            let end = begin + event.features.len();
            spans.push(Event { begin, end, chosen: begin + event.chosen });
            begin = end;
        }
        Self { rows, events: spans, mean, scale }
    }

    /// Number of features F.
    pub(super) fn features(&self) -> usize {
        self.scale.len()
    }

    /// Number of events.
    pub(super) fn events(&self) -> usize {
        self.events.len()
    }

    /// Normalized features of each candidate of one event.
    pub(super) fn candidates(&self, event: usize) -> impl Iterator<Item = &[f64]> {
        let (n, Event { begin, end, .. }) = (self.features(), self.events[event]);
        self.rows[begin * n..end * n].chunks_exact(n)
    }

    /// Log-probability of an event's choice.
    pub(super) fn log_likelihood(&self, event: usize, weights: &[f64]) -> f64 {
        let scores: Vec<f64> = self.candidates(event).map(|h| dot(weights, h)).collect();
        scores[self.events[event].chosen - self.events[event].begin] - log_sum_exp(&scores)
    }

    /// Weights of the features as they came.
    pub(super) fn raw_weights(&self, weights: &[f64]) -> Vec<f64> {
        weights.iter().zip(&self.scale).map(|(w, scale)| if *scale > 0.0 { w / scale } else { 0.0 }).collect()
    }
}

impl<'a> Objective<'a> {
    pub(super) fn new(choices: &'a Choices, counts: &'a [f64], ridge: f64) -> Self {
        Self { choices, counts, ridge }
    }

    /// Number of features F.
    pub(super) fn features(&self) -> usize {
        self.choices.features()
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
        let mut sums = EventSums::new(n);
        for (event, &count) in self.counts.iter().enumerate().filter(|(_, count)| **count > 0.0) {
            sums.take(self.choices, event, weights);
            sums.add_to(&mut at, count);
        }
        for i in 0..n {
            at.curvature[i * n + i] += 2.0 * self.ridge;
            for j in 0..i {
                at.curvature[j * n + i] = at.curvature[i * n + j];
            }
        }
        at.value = at.log_likelihood - self.ridge * squared;
        at
    }
}

/// What one event adds, with room that is used again.
struct EventSums {
    scores: Vec<f64>,
    log_likelihood: f64,
    /// Chosen minus expected features.
    gradient: Vec<f64>,
    expected: Vec<f64>,
    /// Lower triangle of the features' covariance.
    covariance: Vec<f64>,
}

impl EventSums {
    fn new(n: usize) -> Self {
        let zeros = || vec![0.0; n];
        Self {
            scores: Vec::new(),
            log_likelihood: 0.0,
            gradient: zeros(),
            expected: zeros(),
            covariance: vec![0.0; n * n],
        }
    }

    fn take(&mut self, choices: &Choices, event: usize, weights: &[f64]) {
        let n = weights.len();
        self.scores.clear();
        self.scores.extend(choices.candidates(event).map(|h| dot(weights, h)));
        let chosen = choices.events[event].chosen - choices.events[event].begin;
        let largest = self.scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        self.expected.fill(0.0);
        self.covariance.fill(0.0);
        let (mut sum, chosen_score) = (0.0, self.scores[chosen]);
        for (score, h) in self.scores.iter().zip(choices.candidates(event)) {
            let share = libm::exp(score - largest);
            sum += share;
            for i in 0..n {
                let part = share * h[i];
                self.expected[i] += part;
                let row = &mut self.covariance[i * n..][..=i];
                row.iter_mut().zip(h).for_each(|(sum, other)| *sum += part * other);
            }
        }
        let h = &choices.rows[choices.events[event].chosen * n..][..n];
        for (i, chosen) in h.iter().enumerate() {
            self.expected[i] /= sum;
            self.gradient[i] = chosen - self.expected[i];
            for j in 0..=i {
                self.covariance[i * n + j] = self.covariance[i * n + j] / sum - self.expected[i] * self.expected[j];
            }
        }
        self.log_likelihood = chosen_score - largest - libm::log(sum);
    }

    fn add_to(&self, at: &mut Evaluation, count: f64) {
        at.log_likelihood += count * self.log_likelihood;
        for (sum, x) in at.gradient.iter_mut().zip(&self.gradient) {
            *sum += count * x;
        }
        for (sum, x) in at.curvature.iter_mut().zip(&self.covariance) {
            *sum += count * x;
        }
    }
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

/// ϖᵀH of each candidate.
pub(super) fn scores(weights: &[f64], features: &[Vec<f64>]) -> Vec<f64> {
    features.iter().map(|h| dot(weights, h)).collect()
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
        IrlNormalization::None if varies => 1.0,
        IrlNormalization::ZScore | IrlNormalization::Mean | IrlNormalization::None => 0.0,
    }
}
