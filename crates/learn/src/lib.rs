//! Value learners, replay and maximum-entropy inverse reinforcement learning.
//!
//! Observations are vectors of numbers, actions are indices with a mask of those allowed; what they stand for is the
//! caller's. All randomness is keyed by seed, purpose and index, so that any decision or update can be repeated alone.
//!
//! - [`Learner`] trains a Q-network by one of the [`Algorithm`]s; each has a file of its own, and they differ in targets, in masks and
//!   in what the network's outputs mean ([`Readout`]) only.
//! - [`OptionAccumulator`] makes transitions of ticks, [`NStepQueue`] returns over several of them.
//! - [`Policy`] is a snapshot of the network, [`Actor`] takes decisions with it.
//! - [`irl`] fits the weights of a linear cost to choices among candidates.
//!
//! ```
//! use lanecraft_learn::{Learner, LearnerConfig, OptionAccumulator, ReplayBuffer};
//!
//! let config = LearnerConfig { learning_starts: 1, batch: 4, replay_capacity: 100, ..LearnerConfig::default() };
//! let mut learner = Learner::new(&config, 2, 3, 7)?;
//! let mut replay = ReplayBuffer::new(config.replay_capacity, 2, 3);
//! let mut option = OptionAccumulator::start(vec![0.0, 1.0], 2, &config);
//! option.tick(1.5);
//! let bootstrap_mask = learner.bootstrap_mask(replay.pushed());
//! replay.push(&option.finish(vec![1.0, 0.0], 0b111, false, bootstrap_mask))?;
//! let stats = learner.update(&replay, learner.learning_rate(0, 1000))?;
//! assert!(stats.loss.is_finite());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod algorithm;
mod bootstrapped_dqn;
mod checkpoint;
mod config;
mod double_dqn;
mod dqn;
mod dueling_dqn;
pub mod irl;
mod learner;
mod loss;
mod n_step;
mod onnx;
mod policy;
mod prior;
mod q_network;
mod quantile_dqn;
mod readout;
mod replay;
mod transition;

pub use algorithm::Algorithm;
pub use checkpoint::{CheckpointError, LearnerMetadata, PolicyMetadata};
pub use config::{ConfigError, LearnerConfig};
pub use learner::{Learner, UpdateError, UpdateStats};
pub use n_step::NStepQueue;
pub use policy::{ActError, Actor, Choice, Exploration, Policy};
pub use readout::Readout;
pub use replay::{ReplayBuffer, ReplayError};
pub use transition::{OptionAccumulator, Transition};
