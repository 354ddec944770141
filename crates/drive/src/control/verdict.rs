//! What the controllers say about their answers: the rung of the ladder of fall-backs, and how the solve went.

use lanecraft_qp::{Status, Verdict};
use serde::{Deserialize, Serialize};

/// Weights of the two controllers' costs, chosen with the maneuver. Only the ratios matter: scaling a whole cost
/// changes nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlWeights {
    /// q_1 = P_1 / R_1 of Eq. 25: squared speed error against squared acceleration error, 1/s².
    pub speed_ratio: f64,
    /// q_2 = P_21 / R_2 of Eq. 26: squared heading error against squared steering angle; P_22 = 10 P_21 weighs the
    /// lateral error.
    pub path_ratio: f64,
}

/// The ladder of fall-backs, from the best answer to the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rung {
    /// The optimum.
    Solved,
    /// The plan of an earlier step, moved on.
    ShiftedPlan,
    /// A clipped feedback law, without a plan.
    FeedbackLaw,
    /// The scene cannot be used: brake as hard as the controller may, hold the steering.
    BrakeInLane,
    /// Not even the own speed is known: brake in full.
    FullBrake,
}

/// Residual up to which a solve stopped at its iteration budget counts as solved; a steering angle is about 0.01 rad.
const ACCEPTED_RESIDUAL: f64 = 1e-6;

/// How a solve went.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SolveSummary {
    /// Whether the optimum was reached, to 1e-6 at least.
    pub solved: bool,
    /// Steps of the solver.
    pub iterations: u32,
    /// Constraints active at the end.
    pub active: u32,
    /// Largest violation of a soft constraint, in its own unit.
    pub slack_max: f64,
    /// Residual of the optimality conditions, relative.
    pub kkt_residual: f64,
}

impl SolveSummary {
    pub(crate) fn new(verdict: &Verdict) -> Self {
        Self {
            // Where many constraints meet in one point the last digits may stay open at the iteration budget.
            solved: verdict.status == Status::Solved || verdict.kkt_residual <= ACCEPTED_RESIDUAL,
            iterations: verdict.iterations,
            active: verdict.active,
            slack_max: verdict.slack_max,
            kkt_residual: verdict.kkt_residual,
        }
    }
}
