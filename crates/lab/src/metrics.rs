//! What an evaluation reports of a policy: a fixed set of metrics, each with its interval.

use std::collections::BTreeMap;

use lanecraft_drive::control::GuardCause;
use serde::{Deserialize, Serialize};

/// A mean with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// The mean.
    pub mean: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// A policy's results over paired scenarios. The fields are the columns of every table, in this order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PolicyResult {
    /// Who drove, for example `rule:best-lane`.
    pub policy: String,
    /// Number of episodes.
    pub episodes: usize,
    /// Time mean of the speed, m/s.
    pub speed_mps: Interval,
    /// Mean reward of a tick in its fixed scoring form, the paper's units.
    pub reward_per_tick: Interval,
    /// Share of episodes that ended in a collision.
    pub collisions_per_episode: Interval,
    /// Share of episodes that ended in a collision by the ego's own fault.
    pub at_fault_collisions_per_episode: Interval,
    /// Lane changes started per minute.
    pub lane_changes_per_min: Interval,
    /// Smallest time to collision of an episode, s, capped at 20 s; mean over episodes.
    pub min_time_to_collision_s: Interval,
    /// Lane changes asked for and refused by the planner, per minute.
    pub refusals_per_min: Interval,
    /// Control steps in which a fall-back of the controllers was used, per minute.
    pub fallbacks_per_min: Interval,
    /// Control steps in which the guard braked in place of the command, per minute.
    pub guard_interventions_per_min: Interval,
    /// Control steps in which the guard changed the command or called off a lane change, per minute and by cause.
    pub guard_causes_per_min: BTreeMap<GuardCause, Interval>,
    /// Decisions in which the shield forbade a lane change that the planner allowed, per minute.
    pub shield_interventions_per_min: Interval,
    /// Mean absolute jerk, m/s³.
    pub jerk_mps3: Interval,
}

/// A point of a learning curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Decisions taken so far.
    pub decisions: u64,
    /// Gradient updates so far.
    pub updates: u64,
    /// Mean score of a tick over the episodes that ended since the last point.
    pub reward_per_tick: f64,
    /// Mean speed over these episodes, m/s.
    pub speed_mps: f64,
    /// Share of these episodes that ended in a collision.
    pub collisions_per_episode: f64,
    /// Mean loss of an update since the last point.
    pub loss: f64,
    /// Mean share of heads that agree with the vote.
    pub agreement: f64,
    /// Probability of a random action.
    pub epsilon: f64,
}
