//! The training step that all value learners share (Algorithm 1 without the environment).
//!
//! One update draws a batch from the replay buffer, forms targets from the target network, takes the loss of each head's error,
//! passes it back and lets Adam step. Departures from the paper: updates start at `learning_starts` instead of
//! at a full buffer; the target network follows a count of updates over the whole training, since the printed step within
//! an episode never reaches the period; loss and optimizer, which the paper does not name, are Huber and Adam.

use std::sync::Arc;

use lanecraft_net::random::Stream;
use lanecraft_net::{Adam, Ensemble};

use crate::algorithm::Next;
use crate::config::{MAX_INPUTS, MAX_MASK_BITS, count};
use crate::loss::all_finite;
use crate::q_network::{QNetwork, QWorkspace};
use crate::quantile_dqn::mean;
use crate::readout::Estimates;
use crate::{Algorithm, ConfigError, LearnerConfig, Policy, ReplayBuffer};

/// A Q-network in training.
#[derive(Clone, Debug)]
pub struct Learner {
    pub(crate) config: LearnerConfig,
    pub(crate) inputs: usize,
    pub(crate) actions: usize,
    pub(crate) seed: u64,
    pub(crate) network: QNetwork,
    pub(crate) target: QNetwork,
    pub(crate) adam: Adam,
    scratch: Scratch,
}

/// Memory of one update, allocated once.
#[derive(Clone, Debug)]
struct Scratch {
    workspace: QWorkspace,
    /// Slots of the replay buffer in the batch, and the heads that learn from each.
    slots: Vec<usize>,
    head_masks: Vec<u32>,
    /// batch × inputs.
    observation: Vec<f32>,
    next_observation: Vec<f32>,
    /// For each head the estimates of the rows that it learns from, rows × A × estimates of an action.
    online_next: Vec<f32>,
    target_next: Vec<f32>,
    estimates: Vec<f32>,
    /// ∂L/∂estimates.
    slopes: Vec<f32>,
    /// What the estimates of one action are drawn to.
    targets: Vec<f32>,
    gradient: Vec<f32>,
}

/// What one update tells about training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpdateStats {
    /// The loss, the mean over the heads and the transitions each learned from.
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
    #[error(
        "update {update} has a loss of {loss} or a gradient that is not finite, on the transitions {batch:?} of the replay buffer; lower \
         `learner.learning_rate`"
    )]
    NotFinite {
        /// Number of the update, from 1.
        update: u64,
        /// The loss.
        loss: f64,
        /// The batch: slots of the replay buffer, see [`ReplayBuffer::get`].
        batch: Vec<usize>,
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
        let network = QNetwork::new(&config, seed, network);
        let target = QNetwork { trained: Arc::new(target), ..network.clone() };
        let scratch = Scratch::new(&network, config.batch);
        Self { config, inputs: network.inputs(), actions: network.actions(), seed, network, target, adam, scratch }
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
        Policy { network: self.network.clone() }
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
        let stats = self.estimate_slopes(replay);
        let Scratch { workspace, slots, observation, slopes, gradient, .. } = &mut self.scratch;
        self.network.backward(observation, slopes, workspace, gradient);
        if !stats.loss.is_finite() || !all_finite(gradient) {
            return Err(UpdateError::NotFinite {
                update: self.adam.steps() + 1,
                loss: stats.loss,
                batch: slots.clone(),
            });
        }
        // Copies the network first if a policy still shares it.
        let network = Arc::make_mut(&mut self.network.trained);
        self.adam.step(network.parameters_mut(), gradient, learning_rate);
        if self.adam.steps().is_multiple_of(self.config.target_update_period) {
            Arc::make_mut(&mut self.target.trained).parameters_mut().copy_from_slice(network.parameters());
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
            self.network.estimates(next, masks, workspace, &mut scratch.online_next);
        }
        self.target.estimates(next, masks, workspace, &mut scratch.target_next);
        self.network.estimates(&scratch.observation, masks, workspace, &mut scratch.estimates);
    }

    /// Writes ∂L/∂estimates: zero but at the actions taken. L is the sum over the heads of the loss of the rows each learns from,
    /// divided by the batch size.
    fn estimate_slopes(&mut self, replay: &ReplayBuffer) -> UpdateStats {
        let (config, readout, fields) = (&self.config, self.network.readout, &replay.fields);
        let (scratch, delta, batch) = (&mut self.scratch, config.huber_delta as f32, config.batch as f32);
        let (per_action, width) = (readout.per_action(), self.actions * readout.per_action());
        let (mut loss, mut sum_q, mut start) = (0.0, 0.0, 0);
        scratch.slopes.clear();
        scratch.slopes.resize(scratch.estimates.len(), 0.0);
        for head in 0..config.head_count() {
            for &row in scratch.workspace.rows(head) {
                let slot = scratch.slots[row];
                let values = start..start + width;
                let next = Next {
                    reward: fields.reward[slot],
                    discount: fields.discount[slot],
                    allowed: fields.next_action_mask[slot],
                    online: Estimates::new(scratch.online_next.get(values.clone()).unwrap_or_default(), per_action),
                    target: Estimates::new(&scratch.target_next[values], per_action),
                };
                config.algorithm.targets(&next, config, &mut scratch.targets);
                let taken = start + fields.action[slot] as usize * per_action;
                let taken = taken..taken + per_action;
                let (estimates, slopes) = (&scratch.estimates[taken.clone()], &mut scratch.slopes[taken]);
                loss += f64::from(readout.loss(estimates, &scratch.targets, delta, slopes));
                for slope in slopes {
                    *slope /= batch;
                }
                sum_q += f64::from(mean(estimates));
                start += width;
            }
        }
        let count = (start / width).max(1) as f64;
        UpdateStats { loss: loss / count, mean_q: sum_q / count }
    }
}

impl Scratch {
    fn new(network: &QNetwork, batch: usize) -> Self {
        let estimates = network.heads() * batch * network.actions() * network.readout.per_action();
        Self {
            workspace: network.workspace(batch),
            slots: vec![0; batch],
            head_masks: vec![0; batch],
            observation: vec![0.0; batch * network.inputs()],
            next_observation: vec![0.0; batch * network.inputs()],
            online_next: Vec::with_capacity(estimates),
            target_next: Vec::with_capacity(estimates),
            estimates: Vec::with_capacity(estimates),
            slopes: Vec::with_capacity(estimates),
            targets: Vec::with_capacity(network.readout.per_action()),
            gradient: vec![0.0; network.trained.parameters().len()],
        }
    }
}

#[cfg(test)]
mod tests;
