//! What is counted of a drive.

use serde::{Deserialize, Serialize};

use crate::control::GuardCause;

/// What did not go as planned since the start of the episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DriverCounts {
    /// Lane changes begun.
    pub lane_changes: u32,
    /// Lane changes aborted.
    pub aborts: u32,
    /// Lane changes asked for and refused by the planner.
    pub refusals: u32,
    /// Ticks in which the shield forbade a lane change that the planner allowed.
    pub shield: u32,
    /// Control steps in which the guard changed the command or called off a lane change, by [`GuardCause`].
    pub guard: [u32; GuardCause::ALL.len()],
    /// Control steps by the rung of the ladder of fall-backs that the worse controller ended on, beyond `Solved`.
    pub fallbacks: [u32; 4],
}

impl DriverCounts {
    /// Control steps in which the guard braked in place of the command.
    pub fn guard_interventions(&self) -> u32 {
        GuardCause::ALL.into_iter().filter(|cause| cause.brakes()).map(|cause| self.guard[cause as usize]).sum()
    }
}
