//! Environments as the interfaces of reinforcement learning ask for them: numbers in, numbers out, one at a time or many at once.
//!
//! A [`Task`] says what is simulated and who acts in it; a [`Gym`] is one environment of a task; a [`VectorGym`] is many, stepped on
//! several threads with the same bits at any number of them. Every episode is that of its seed: the first one of the seed given at
//! reset, later ones of seeds that follow from it ([`episode_seed`]).

mod metrics;
mod single;
mod task;
mod vector;

use lanecraft_net::random::Stream;

pub use metrics::{Metric, MetricKind};
pub use single::{Actions, Command, Gym, GymError, legal_action};
pub use task::{ActionSpace, MaskedActions, ObservationSpace, Range, Seat, Task, TaskError, Units};
pub use vector::{Autoreset, Outputs, VectorGym};

/// The seed of the episode with this number after a reset with `seed`: that one itself first, then such as fit the 53 bits that every
/// reader of numbers keeps.
pub fn episode_seed(seed: u64, episode: u64) -> u64 {
    if episode == 0 { seed } else { Stream::keyed(seed, "gym.episode", episode, 0).next_u64() >> 11 }
}
