//! The training step that all value learners share (Algorithm 1 without the environment).
//!
//! One update draws a batch from the replay buffer, forms targets from the target network, takes the Huber loss of each
//! head's error, passes it back and lets Adam step. Departures from the paper: updates start at `learning_starts` instead of
//! at a full buffer; the target network follows a count of updates over the whole training, since the printed step within
//! an episode never reaches the period; loss and optimizer, which the paper does not name, are Huber and Adam.

use std::sync::Arc;

use lanecraft_net::random::Stream;
use lanecraft_net::{Adam, Ensemble, Workspace};

use crate::algorithm::Next;
use crate::config::{MAX_INPUTS, MAX_MASK_BITS, count};
use crate::{Algorithm, ConfigError, LearnerConfig, Policy, ReplayBuffer};

/// A Q-network in training.
#[derive(Clone, Debug)]
pub struct Learner {
    pub(crate) config: LearnerConfig,
    pub(crate) inputs: usize,
    pub(crate) actions: usize,
    pub(crate) seed: u64,
    pub(crate) network: Arc<Ensemble>,
    pub(crate) target: Ensemble,
    pub(crate) adam: Adam,
    scratch: Scratch,
}

/// Memory of one update, allocated once.
#[derive(Clone, Debug)]
struct Scratch {
    workspace: Workspace,
    /// Slots of the replay buffer in the batch, and the heads that learn from each.
    slots: Vec<usize>,
    head_masks: Vec<u32>,
    /// batch × inputs.
    observation: Vec<f32>,
    next_observation: Vec<f32>,
    /// For each head the rows that it learns from, × A; at most K × batch × A.
    online_next: Vec<f32>,
    target_next: Vec<f32>,
    q: Vec<f32>,
    output_gradient: Vec<f32>,
    gradient: Vec<f32>,
}

/// What one update tells about training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpdateStats {
    /// Huber loss, the mean over the heads and the transitions each learned from.
    pub loss: f64,
    /// Value of the actions taken, the mean over the same.
    pub mean_q: f64,
}

/// An update that was not made; the learner is as before.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum UpdateError {
    /// Fewer transitions than `learner.learning_starts`.
    #[error("the replay buffer holds {found} transitions, but learning starts at {needed}")]
    TooFew {
        /// Transitions held.
        found: usize,
        /// Transitions needed.
        needed: usize,
    },
    /// A buffer made for other observations or actions.
    #[error("the replay buffer has {found:?} inputs and actions, but the learner has {expected:?}")]
    Dimensions {
        /// Inputs and actions of the learner.
        expected: (usize, usize),
        /// Inputs and actions of the buffer.
        found: (usize, usize),
    },
    /// A learning rate that is no rate.
    #[error("the learning rate is {value}, but must be finite and not negative")]
    LearningRate {
        /// The value found.
        value: f64,
    },
    /// Training has diverged.
    #[error("update {update} has a loss of {loss} or a gradient that is not finite; lower `learner.learning_rate`")]
    NotFinite {
        /// Number of the update, from 1.
        update: u64,
        /// The loss.
        loss: f64,
    },
}

impl Learner {
    /// A new learner for observations of `inputs` numbers and `actions` actions (at most 32).
    pub fn new(config: &LearnerConfig, inputs: usize, actions: usize, seed: u64) -> Result<Self, ConfigError> {
        config.validate()?;
        count("inputs", inputs, 1, MAX_INPUTS)?;
        count("actions", actions, 1, MAX_MASK_BITS)?;
        let shape = config.net_shape(inputs, actions);
        let network = Ensemble::new(shape, &mut Stream::new(seed, "learn.weights"))
            .expect("validated settings make a valid shape");
        let adam = Adam::new(network.parameters().len());
        Ok(Self::from_parts(config.clone(), seed, network.clone(), network, adam))
    }

    pub(crate) fn from_parts(
        config: LearnerConfig,
        seed: u64,
        network: Ensemble,
        target: Ensemble,
        adam: Adam,
    ) -> Self {
        let (inputs, actions) = (network.shape().inputs, network.shape().outputs);
        let scratch = Scratch::new(&network, config.batch);
        Self { config, inputs, actions, seed, network: Arc::new(network), target, adam, scratch }
    }

    /// The settings.
    pub fn config(&self) -> &LearnerConfig {
        &self.config
    }

    /// Updates made.
    pub fn updates(&self) -> u64 {
        self.adam.steps()
    }

    /// The network as it is now; later updates do not change it.
    pub fn policy(&self) -> Policy {
        Policy { network: Arc::clone(&self.network) }
    }

    /// An empty replay buffer of the size and for the dimensions of this learner.
    pub fn empty_replay(&self) -> ReplayBuffer {
        ReplayBuffer::new(self.config.replay_capacity, self.inputs, self.actions)
    }

    /// Share of random decisions at `decision` of `total`.
    pub fn epsilon(&self, decision: u64, total: u64) -> f64 {
        let config = &self.config;
        if config.algorithm == Algorithm::BootstrappedDqn {
            return config.bootstrapped_epsilon;
        }
        let span = config.epsilon_fraction * total as f64;
        let progress = if span > 0.0 { (decision as f64 / span).min(1.0) } else { 1.0 };
        config.epsilon_start + progress * (config.epsilon_end - config.epsilon_start)
    }

    /// Learning rate at `decision` of `total`.
    pub fn learning_rate(&self, decision: u64, total: u64) -> f64 {
        let progress = if total > 0 { (decision as f64 / total as f64).min(1.0) } else { 0.0 };
        self.config.learning_rate * (1.0 - progress * (1.0 - self.config.learning_rate_end_fraction))
    }

    /// Whether an update follows the decision numbered `decision` (from 1).
    pub fn is_update_due(&self, decision: u64, replay: &ReplayBuffer) -> bool {
        replay.len() >= self.config.learning_starts && decision.is_multiple_of(self.config.decisions_per_update)
    }

    /// The head that drives an episode.
    pub fn head(&self, episode: u64) -> usize {
        Stream::keyed(self.seed, "learn.head", episode, 0).below(self.config.head_count())
    }

    /// The stream of the random part of one decision.
    pub fn exploration_stream(&self, decision: u64) -> Stream {
        Stream::keyed(self.seed, "learn.explore", decision, 0)
    }

    /// The heads that learn from the transition of this number ([`ReplayBuffer::pushed`] before it is pushed).
    pub fn bootstrap_mask(&self, transition: u64) -> u32 {
        let mut stream = Stream::keyed(self.seed, "learn.mask", transition, 0);
        let probability = self.config.mask_probability;
        (0..self.config.head_count()).fold(0, |mask, head| mask | u32::from(stream.bernoulli(probability)) << head)
    }

    /// One update with a batch that depends on the seed, the number of the update and the buffer alone.
    pub fn update(&mut self, replay: &ReplayBuffer, learning_rate: f64) -> Result<UpdateStats, UpdateError> {
        if !(learning_rate.is_finite() && learning_rate >= 0.0) {
            return Err(UpdateError::LearningRate { value: learning_rate });
        }
        self.check(replay)?;
        self.sample(replay);
        self.evaluate();
        let stats = self.output_gradient(replay);
        let Scratch { workspace, observation, output_gradient, gradient, .. } = &mut self.scratch;
        self.network.backward(observation, output_gradient, workspace, gradient);
        if !stats.loss.is_finite() || !all_finite(gradient) {
            return Err(UpdateError::NotFinite { update: self.updates() + 1, loss: stats.loss });
        }
        // Copies the network first if a policy still shares it.
        let network = Arc::make_mut(&mut self.network);
        self.adam.step(network.parameters_mut(), gradient, learning_rate);
        if self.adam.steps().is_multiple_of(self.config.target_update_period) {
            self.target.parameters_mut().copy_from_slice(network.parameters());
        }
        Ok(stats)
    }

    fn check(&self, replay: &ReplayBuffer) -> Result<(), UpdateError> {
        let (expected, found) = ((self.inputs, self.actions), (replay.inputs, replay.actions));
        if expected != found {
            return Err(UpdateError::Dimensions { expected, found });
        }
        let (found, needed) = (replay.len(), self.config.learning_starts);
        if found < needed { Err(UpdateError::TooFew { found, needed }) } else { Ok(()) }
    }

    /// Draws the slots of the batch, with replacement, and gathers its observations.
    fn sample(&mut self, replay: &ReplayBuffer) {
        let mut stream = Stream::keyed(self.seed, "learn.replay", self.updates(), 0);
        let (scratch, inputs) = (&mut self.scratch, self.inputs);
        for (row, slot) in scratch.slots.iter_mut().enumerate() {
            *slot = stream.below(replay.len());
            let (to, from) = (row * inputs..(row + 1) * inputs, *slot * inputs..(*slot + 1) * inputs);
            scratch.observation[to.clone()].copy_from_slice(&replay.fields.observation[from.clone()]);
            scratch.next_observation[to].copy_from_slice(&replay.fields.next_observation[from]);
            scratch.head_masks[row] = self.config.algorithm.learning_heads(replay.fields.bootstrap_mask[*slot]);
        }
    }

    /// Forward passes; the one that the backward pass goes back through comes last.
    fn evaluate(&mut self) {
        let scratch = &mut self.scratch;
        let (workspace, masks, next) = (&mut scratch.workspace, &scratch.head_masks, &scratch.next_observation);
        if self.config.algorithm.needs_online_next(&self.config) {
            replace(&mut scratch.online_next, self.network.forward_masked(next, masks, workspace));
        }
        replace(&mut scratch.target_next, self.target.forward_masked(next, masks, workspace));
        replace(&mut scratch.q, self.network.forward_masked(&scratch.observation, masks, workspace));
    }

    /// Writes ∂L/∂q, laid out as the values: zero but at the actions taken. L is the sum over the heads of the Huber loss of
    /// the rows each learns from, divided by the batch size.
    fn output_gradient(&mut self, replay: &ReplayBuffer) -> UpdateStats {
        let (config, actions, fields) = (&self.config, self.actions, &replay.fields);
        let (scratch, delta) = (&mut self.scratch, config.huber_delta as f32);
        let (mut loss, mut sum_q, mut start) = (0.0, 0.0, 0);
        scratch.output_gradient.clear();
        scratch.output_gradient.resize(scratch.q.len(), 0.0);
        for head in 0..config.head_count() {
            for &row in scratch.workspace.rows(head) {
                let slot = scratch.slots[row];
                let next = Next {
                    reward: fields.reward[slot],
                    discount: fields.discount[slot],
                    allowed: fields.next_action_mask[slot],
                    online: scratch.online_next.get(start..start + actions).unwrap_or_default(),
                    target: &scratch.target_next[start..start + actions],
                };
                let taken = start + fields.action[slot] as usize;
                let error = scratch.q[taken] - config.algorithm.target(&next, config);
                scratch.output_gradient[taken] = clip(error, delta) / scratch.slots.len() as f32;
                loss += f64::from(huber(error, delta));
                sum_q += f64::from(scratch.q[taken]);
                start += actions;
            }
        }
        let count = (start / actions).max(1) as f64;
        UpdateStats { loss: loss / count, mean_q: sum_q / count }
    }
}

impl Scratch {
    fn new(network: &Ensemble, batch: usize) -> Self {
        let shape = network.shape();
        let (observations, values) = (batch * shape.inputs, shape.heads * batch * shape.outputs);
        Self {
            workspace: Workspace::new(network, batch),
            slots: vec![0; batch],
            head_masks: vec![0; batch],
            observation: vec![0.0; observations],
            next_observation: vec![0.0; observations],
            online_next: Vec::with_capacity(values),
            target_next: Vec::with_capacity(values),
            q: Vec::with_capacity(values),
            output_gradient: Vec::with_capacity(values),
            gradient: vec![0.0; network.parameters().len()],
        }
    }
}

/// Makes `to` a copy of `from` within the memory it has.
fn replace(to: &mut Vec<f32>, from: &[f32]) {
    to.clear();
    to.extend_from_slice(from);
}

/// Loss of Huber (1964): quadratic up to `delta`, then linear.
fn huber(error: f32, delta: f32) -> f32 {
    let size = error.abs();
    if size <= delta { 0.5 * error * error } else { delta * (size - 0.5 * delta) }
}

/// Its derivative. Written so that NaN stays NaN.
fn clip(error: f32, delta: f32) -> f32 {
    if error > delta {
        delta
    } else if error < -delta {
        -delta
    } else {
        error
    }
}

/// Whether all values are finite, by the largest magnitude as integer bits, which vectorizes.
fn all_finite(values: &[f32]) -> bool {
    values.iter().fold(0, |largest, value| largest.max(value.to_bits() & 0x7FFF_FFFF)) < f32::INFINITY.to_bits()
}

#[cfg(test)]
mod tests;
