//! Policies without learning, to be printed beside every result.

mod rules;

pub use rules::{BestLane, Rule, UnknownRule};
