//! Policies without learning, to be printed beside every result.

mod proposals;
mod rules;

pub use proposals::Proposals;
pub use rules::{BestLane, Rule, UnknownRule};
