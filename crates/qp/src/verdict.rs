//! What a solve is asked for and what it answers.

use crate::validate::InvalidInput;

/// Where a solve begins. The optimum is unique, so this changes the time and the last digits, not the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// With no active constraint.
    Cold,
    /// With the active set of the last solve, moved this many stages earlier.
    Shifted(usize),
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Status {
    /// At the optimum.
    Solved,
    /// At the iteration budget, or where numbers left the range of f64 (the KKT residual is infinite then).
    /// The inputs are the last iterate, moved into the input bounds.
    IterationLimit,
    /// Where the time was up ([`crate::Solver::solve_until`]), before the optimum. The inputs are the last iterate, moved into
    /// the input bounds.
    OutOfTime,
    /// Nowhere: the problem was refused, and the solver is as after [`crate::Solver::reset`].
    InvalidInput(InvalidInput),
}

/// The outcome of a solve.
#[derive(Clone, Copy, Debug, PartialEq)]
#[must_use]
pub struct Verdict {
    /// How the solve ended.
    pub status: Status,
    /// Steps along the dual; those of the interior point are not among them.
    pub iterations: u32,
    /// Constraints active at the end.
    pub active: u32,
    /// Largest violation of a soft row under the returned inputs.
    pub slack_max: f64,
    /// Largest violation of a constraint beyond its slack, relative to the size of the terms it is made of. The other
    /// optimality conditions hold by construction.
    pub kkt_residual: f64,
}

/// Which constraint of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Constraint {
    /// The bounds of the input.
    Input,
    /// The soft row with this index.
    Row(usize),
}

/// Which bound of a constraint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The lower bound.
    Lower,
    /// The upper bound.
    Upper,
}

/// A constraint that holds the optimum back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActiveRow {
    /// Its stage.
    pub stage: usize,
    /// Which constraint of the stage.
    pub constraint: Constraint,
    /// Which bound.
    pub side: Side,
    /// Its multiplier, at least 0: how fast the cost falls as the bound is widened.
    pub multiplier: f64,
    /// By how much the bound is exceeded; 0 as long as the multiplier is within the L1 weight.
    pub slack: f64,
}
