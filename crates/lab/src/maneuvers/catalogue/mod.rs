//! The suite: every maneuver with its start, script and checks.

mod collision_avoidance;
mod disturbed;
mod following;
mod handling;
mod lane_changes;

use super::{Check, Maneuver, Measure};

/// All maneuvers in the order in which they are printed; names are unique.
pub fn catalogue() -> Vec<Maneuver> {
    let mut all = following::maneuvers();
    all.extend(collision_avoidance::maneuvers());
    all.extend(lane_changes::maneuvers());
    all.extend(handling::maneuvers());
    all.extend(disturbed::maneuvers());
    all
}

/// Largest distance from the reference that still counts as staying in the lane, m.
const LANE_ERROR_MAX_M: f64 = 0.2;

/// No body touches another.
fn no_collision() -> Check {
    Check::at_least("no collision", Measure::Clearance, 0.0)
}

/// The car stays within 0.2 m of its reference.
fn in_lane() -> Check {
    Check::at_most("stays in lane", Measure::LaneError, LANE_ERROR_MAX_M)
}

/// No controller needs a fall-back.
fn no_fallback() -> Check {
    Check::at_most("no fall-back", Measure::FallbackSteps, 0.0)
}

/// The guard has nothing to do.
fn no_guard() -> Check {
    Check::at_most("guard idle", Measure::GuardSteps, 0.0)
}
