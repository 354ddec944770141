//! What the driver is at: keeping its lane, changing lane, or doing as it is told from another seat.
//!
//! Whoever sits in the seat that plans hands in paths ([`PathCommand`]), whoever sits in the seat that controls hands in commands. Both
//! take the place of the decision; the guard stays the last check before the plant.

use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_range};
use crate::control::ControlWeights;
use crate::plan::{LaneChangePath, Quintic};
use crate::vehicle::ControlInput;

/// What the driver does at present.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum Activity {
    /// Keeps its lane.
    Keeping { accel_mps2: f64, weights: ControlWeights },
    /// Changes lane.
    Changing(Change),
    /// Follows a path that was handed in.
    Following(HandedPath),
    /// Does exactly this.
    Obeying(ControlInput),
}

/// A lane change under way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// The path.
    pub path: LaneChangePath,
    /// Control steps since it began.
    pub elapsed_steps: u32,
    /// Speed at the begin, m/s.
    pub entry_speed_mps: f64,
    /// Weights of the controllers.
    pub weights: ControlWeights,
    /// Whether it is a return to the lane that the car had not left.
    pub aborted: bool,
}

/// A path from the seat that plans, as it is driven.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct HandedPath {
    pub(super) quintic: Quintic,
    pub(super) elapsed_steps: u32,
    pub(super) speed_mps: f64,
}

/// What the seat that plans hands in: where the car shall be across the road, how soon, and how fast it shall go.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathCommand {
    /// Lateral position at the end of the path, m to the left of the reference line.
    pub end_d_m: f64,
    /// Time to get there, s; what the car cannot drive within its lateral bounds takes longer.
    pub duration_s: f64,
    /// Speed to aim at, m/s; speed limits and the vehicles ahead come first.
    pub speed_mps: f64,
}

/// The largest and the smallest path that may be handed in, key by key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathBounds {
    /// The smallest of each.
    pub low: PathCommand,
    /// The largest of each.
    pub high: PathCommand,
}

impl PathBounds {
    /// Checks that `command` lies within.
    pub(super) fn check(&self, command: &PathCommand) -> Result<(), ConfigError> {
        let Self { low, high } = self;
        check_range("path.end_d_m", command.end_d_m, low.end_d_m, high.end_d_m)?;
        check_range("path.duration_s", command.duration_s, low.duration_s, high.duration_s)?;
        check_range("path.speed_mps", command.speed_mps, low.speed_mps, high.speed_mps)
    }
}
