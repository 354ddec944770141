//! Training: mini-batches of samples, a robust loss of the error at each horizon, Adam with a rate that falls to zero.
//!
//! The loss of an error e at the horizon h is Huber's (1964) of e/h, a mean speed error in m/s: quadratic only near zero, so that what falls
//! is the mean distance, by which forecasts are judged, and the rare driver who brakes hard does not outweigh all others. Each sample is drawn with left and right exchanged in half of the cases, and in
//! some with its history cut short, as at the start of an episode.

use lanecraft_drive::predict::lstm::{FEATURES, FRAMES, LstmModel, OUTPUTS};
use lanecraft_net::random::Stream;
use lanecraft_net::{Adam, Lstm, LstmWorkspace, ShapeError};
use serde::{Deserialize, Serialize};

use super::PredictorConfig;
use super::samples::{HORIZONS_S, Sample, TOLD, effects};

/// Errors across the road are a tenth of those along it, and matter as much.
const ACROSS_WEIGHT: f32 = 4.0;
/// Mean speed error above which the loss is linear, m/s: a tenth of that of constant velocity on a freeway.
const BEND_MPS: f32 = 0.05;
/// Share of the draws whose history is cut short.
const SHORTENED: f64 = 0.25;
/// Features that change their sign when left and right are exchanged: lateral offset, lateral speed and signal.
const SIDED: [usize; 3] = [7, 8, 9];
/// Half of the outputs are accelerations along the road, half across it.
const HALF: usize = OUTPUTS / 2;

/// A point of the learning curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpochPoint {
    /// Epochs so far.
    pub epoch: u32,
    /// Mean loss of the epoch's batches, as they were drawn.
    pub loss: f64,
    /// Mean loss of samples that are not learned from, as they are.
    pub validation_loss: f64,
}

/// Trains a network on `samples` and hands each point of the curve on as it comes.
///
/// # Errors
/// If the configuration's shape is none.
pub(super) fn train(
    config: &PredictorConfig,
    seed: u64,
    [samples, validation]: [&[Sample]; 2],
    point: &mut dyn FnMut(EpochPoint),
) -> Result<LstmModel, ShapeError> {
    let shape = LstmModel::shape(config.hidden);
    let mut network = Lstm::new(shape, &mut Stream::new(seed, "predictor.init"))?;
    let mut learner = Learner::new(&network, config.batch);
    let mut adam = Adam::new(network.parameters().len());
    let batches = samples.len().div_ceil(config.batch) as u64;
    let total = batches * u64::from(config.epochs);
    for epoch in 0..config.epochs {
        let mut stream = Stream::keyed(seed, "predictor.epoch", u64::from(epoch), 0);
        let order = shuffled(samples.len(), &mut stream);
        let mut sum = 0.0;
        for batch in order.chunks(config.batch) {
            let drawn: Vec<Sample> = batch.iter().map(|&index| varied(&samples[index], &mut stream)).collect();
            sum += learner.loss(&network, &drawn) * drawn.len() as f64;
            learner.gradient(&network);
            let left = 1.0 - adam.steps() as f64 / total as f64;
            adam.step(network.parameters_mut(), &learner.gradient, config.learning_rate * left);
        }
        let judged = validation.chunks(config.batch).map(|batch| learner.loss(&network, batch) * batch.len() as f64);
        let validation_loss = judged.sum::<f64>() / validation.len().max(1) as f64;
        point(EpochPoint { epoch: epoch + 1, loss: sum / samples.len().max(1) as f64, validation_loss });
    }
    LstmModel::new(network)
}

/// 0 to `count` − 1 in random order (Fisher and Yates, 1938).
fn shuffled(count: usize, stream: &mut Stream) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    for last in (1..count).rev() {
        order.swap(last, stream.below(last + 1));
    }
    order
}

/// A sample as it might have been, too.
fn varied(sample: &Sample, stream: &mut Stream) -> Sample {
    let mut sample = sample.clone();
    if stream.bernoulli(0.5) {
        exchange_sides(&mut sample);
    }
    if stream.bernoulli(SHORTENED) {
        let first = FEATURES * (1 + stream.below(FRAMES - 1));
        let (before, known) = sample.told.split_at_mut(first);
        before.chunks_exact_mut(FEATURES).for_each(|instant| instant.copy_from_slice(&known[..FEATURES]));
    }
    sample
}

fn exchange_sides(sample: &mut Sample) {
    for instant in sample.told.chunks_exact_mut(FEATURES) {
        for feature in SIDED {
            instant[feature] = -instant[feature];
        }
    }
    sample.off_m.iter_mut().flatten().for_each(|off_m| off_m[1] = -off_m[1]);
}

/// Loss and gradient of batches, with the room they need.
struct Learner {
    told: Vec<f32>,
    workspace: LstmWorkspace,
    output_gradient: Vec<f32>,
    gradient: Vec<f32>,
    effects: [[f32; HALF]; HORIZONS_S.len()],
}

impl Learner {
    fn new(network: &Lstm, batch: usize) -> Self {
        Self {
            told: Vec::with_capacity(batch * TOLD),
            workspace: LstmWorkspace::new(network.shape(), batch, FRAMES),
            output_gradient: Vec::with_capacity(batch * OUTPUTS),
            gradient: vec![0.0; network.parameters().len()],
            effects: effects(),
        }
    }

    /// Mean loss of `batch`; leaves its gradient with respect to the outputs.
    fn loss(&mut self, network: &Lstm, batch: &[Sample]) -> f64 {
        self.told.clear();
        for instant in 0..FRAMES {
            let start = instant * FEATURES;
            for sample in batch {
                self.told.extend(&sample.told[start..start + FEATURES]);
            }
        }
        let outputs = network.forward(&self.told, FRAMES, &mut self.workspace);
        self.output_gradient.clear();
        self.output_gradient.resize(outputs.len(), 0.0);
        let scale = 1.0 / (batch.len() * HORIZONS_S.len()) as f32;
        let mut sum = 0.0;
        let rows = outputs.chunks_exact(OUTPUTS).zip(self.output_gradient.chunks_exact_mut(OUTPUTS));
        for (sample, (said, delta)) in batch.iter().zip(rows) {
            for ((off_m, effects), horizon_s) in sample.off_m.iter().zip(&self.effects).zip(HORIZONS_S) {
                let Some(off_m) = off_m else { continue };
                for (side, weight) in [1.0, ACROSS_WEIGHT].into_iter().enumerate() {
                    let half = side * HALF..(side + 1) * HALF;
                    let said_m: f32 = said[half.clone()].iter().zip(effects).map(|(said, effect)| said * effect).sum();
                    let (loss, slope) = huber(weight * (said_m - off_m[side]) / horizon_s as f32);
                    sum += f64::from(scale * loss);
                    let slope = scale * slope * weight / horizon_s as f32;
                    delta[half].iter_mut().zip(effects).for_each(|(delta, effect)| *delta += slope * effect);
                }
            }
        }
        sum
    }

    /// The gradient of the last batch's loss.
    fn gradient(&mut self, network: &Lstm) {
        network.backward(&self.told, &self.output_gradient, &mut self.workspace, &mut self.gradient);
    }
}

/// Huber's loss, and its slope.
fn huber(error_mps: f32) -> (f32, f32) {
    if error_mps.abs() <= BEND_MPS {
        (0.5 * error_mps * error_mps / BEND_MPS, error_mps / BEND_MPS)
    } else {
        (error_mps.abs() - 0.5 * BEND_MPS, error_mps.signum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(stream: &mut Stream) -> Sample {
        let mut told = [0.0; TOLD];
        for value in &mut told {
            *value = stream.range(-1.0, 1.0) as f32;
        }
        // Who goes faster than others in the last instant brakes, beyond sight for the last two horizons.
        let brake_mps2 = 0.5 * f64::from(told[TOLD - FEATURES]);
        let mut off_m = HORIZONS_S.map(|horizon_s| Some([(-0.5 * brake_mps2 * horizon_s * horizon_s) as f32, 0.0]));
        off_m[5..].fill(None);
        Sample { told, off_m }
    }

    #[test]
    fn the_gradient_is_that_of_central_differences_of_the_loss() {
        let mut stream = Stream::new(1, "predictor.test");
        let samples: Vec<Sample> = (0..5).map(|_| sample(&mut stream)).collect();
        let mut network = Lstm::new(LstmModel::shape(4), &mut stream).unwrap();
        network.parameters_mut().iter_mut().for_each(|parameter| *parameter += 0.3 * stream.normal() as f32);
        let mut learner = Learner::new(&network, 5);
        let _ = learner.loss(&network, &samples);
        learner.gradient(&network);
        let gradient = learner.gradient.clone();
        // A step of 2⁻⁸: rounding of the sums near 1e-4 of the quotient.
        let step = 1.0 / 256.0_f32;
        for (index, analytic) in gradient.iter().enumerate() {
            let mut at = |shift: f32| {
                let mut moved = network.clone();
                moved.parameters_mut()[index] += shift;
                learner.loss(&moved, &samples)
            };
            let numeric = (at(step) - at(-step)) / (2.0 * f64::from(step));
            assert!((numeric - f64::from(*analytic)).abs() < 2e-3 * (1.0 + numeric.abs()), "{numeric} {analytic}");
        }
    }

    #[test]
    fn a_law_is_learned_and_a_seed_repeats() {
        let mut stream = Stream::new(2, "predictor.test");
        let samples: Vec<Sample> = (0..600).map(|_| sample(&mut stream)).collect();
        let config = PredictorConfig { hidden: 8, epochs: 12, learning_rate: 1e-2, ..PredictorConfig::default() };
        let run = || {
            let mut points = Vec::new();
            let model = train(&config, 3, [&samples[..500], &samples[500..]], &mut |point| points.push(point)).unwrap();
            (model, points)
        };
        let (model, points) = run();
        assert_eq!((model.clone(), points.clone()), run());
        assert!(points[11].validation_loss < 0.2 * points[0].loss, "{points:?}");
    }

    #[test]
    fn exchanging_sides_twice_changes_nothing_and_a_short_history_repeats() {
        let mut stream = Stream::new(4, "predictor.test");
        let original = sample(&mut stream);
        let mut twice = original.clone();
        exchange_sides(&mut twice);
        assert_ne!(twice, original);
        exchange_sides(&mut twice);
        assert_eq!(twice, original);
        for _ in 0..50 {
            let varied = varied(&original, &mut stream);
            // The present is never lost.
            let present = TOLD - FEATURES;
            assert_eq!(varied.told[present..present + 7], original.told[present..present + 7]);
        }
    }

    #[test]
    fn a_shuffle_is_a_permutation() {
        let mut order = shuffled(100, &mut Stream::new(1, "shuffle"));
        assert_ne!(order, (0..100).collect::<Vec<_>>());
        order.sort_unstable();
        assert_eq!(order, (0..100).collect::<Vec<_>>());
    }
}
