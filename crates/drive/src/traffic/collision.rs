//! Contact between rectangles that move through a step, and whose fault it is.

use serde::{Deserialize, Serialize};

use crate::scene::VehicleId;

/// The ego changed lane this recently, s: a hit ahead follows from the change.
const EGO_CHANGE_MEMORY_S: f64 = 6.0;
/// A human driver changed lane this recently, s.
const OTHER_CHANGE_MEMORY_S: f64 = 4.0;

/// The ego has touched a vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Collision {
    /// Which one; the lowest id if there are several.
    pub with: VehicleId,
    /// How it came about.
    pub fault: FaultClass,
}

/// How a collision came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultClass {
    /// The ego hits the vehicle ahead, nobody having changed lane.
    EgoRearEnds,
    /// The ego changed lane less than 6 s before and hits the vehicle ahead, of the old lane or the new.
    EgoAfterChange,
    /// The ego changed lane less than 6 s before and is hit from behind or from the side.
    EgoCutsIn,
    /// The other changed lane into the ego's path less than 4 s before, and later than the ego if that changed, too.
    OtherCutsIn,
    /// The ego is hit from behind, nobody having changed lane.
    OtherRearEnds,
}

impl FaultClass {
    /// Its name in tables and logs.
    pub fn name(self) -> &'static str {
        match self {
            Self::EgoRearEnds => "ego-rear-ends",
            Self::EgoAfterChange => "ego-after-change",
            Self::EgoCutsIn => "ego-cuts-in",
            Self::OtherCutsIn => "other-cuts-in",
            Self::OtherRearEnds => "other-rear-ends",
        }
    }

    /// Whether the ego is to blame.
    pub fn at_fault(self) -> bool {
        matches!(self, Self::EgoRearEnds | Self::EgoAfterChange | Self::EgoCutsIn)
    }

    /// Judges a contact: is the other ahead of the ego, and how long ago did each change lane?
    pub(super) fn judge(other_ahead: bool, since_ego_change_s: f64, since_other_change_s: f64) -> Self {
        let ego_changed = since_ego_change_s < EGO_CHANGE_MEMORY_S;
        let other_changed = since_other_change_s < OTHER_CHANGE_MEMORY_S;
        // The later change is the cause; of two at the same time, the ego's.
        let other_later = other_changed && !(ego_changed && since_ego_change_s <= since_other_change_s);
        match (other_ahead, other_later, ego_changed) {
            (_, true, _) => Self::OtherCutsIn,
            (true, false, true) => Self::EgoAfterChange,
            (true, false, false) => Self::EgoRearEnds,
            (false, false, true) => Self::EgoCutsIn,
            (false, false, false) => Self::OtherRearEnds,
        }
    }
}

/// Whether two rectangles along the road touch inside a step.
///
/// `end_m`: from one center to the other at the end of the step, along the road and across; `moved_m`: how much that vector has
/// changed in the step, taken as a straight line; `reach_m`: sums of the half lengths and of the half widths. Edges that only
/// meet do not touch.
pub(super) fn touch_in_step(end_m: (f64, f64), moved_m: (f64, f64), reach_m: (f64, f64)) -> bool {
    // Most pairs are far apart, and division is slow.
    if end_m.0.abs() >= reach_m.0 + moved_m.0.abs() || end_m.1.abs() >= reach_m.1 + moved_m.1.abs() {
        return false;
    }
    let along = within(end_m.0, moved_m.0, reach_m.0);
    let across = within(end_m.1, moved_m.1, reach_m.1);
    along.0.max(across.0) < along.1.min(across.1)
}

/// The share of the step, as an interval before its end (0 = end, 1 = start), in which a straight line stays inside ±`reach_m`.
fn within(end_m: f64, moved_m: f64, reach_m: f64) -> (f64, f64) {
    if moved_m == 0.0 {
        return if end_m.abs() < reach_m { (0.0, 1.0) } else { (1.0, 0.0) };
    }
    let (a, b) = ((end_m - reach_m) / moved_m, (end_m + reach_m) / moved_m);
    (a.min(b).max(0.0), a.max(b).min(1.0))
}

#[cfg(test)]
mod tests {
    use super::{FaultClass, touch_in_step};

    #[test]
    fn contact_inside_a_step_is_seen() {
        let reach_m = (4.8, 1.9);
        // Apart at both ends, through each other in between.
        assert!(touch_in_step((6.0, 0.0), (12.0, 0.0), reach_m));
        // The same motion in the next lane.
        assert!(!touch_in_step((6.0, 3.75), (12.0, 0.0), reach_m));
        // Leaves the lane before it arrives.
        assert!(!touch_in_step((0.0, 2.5), (-9.7, 1.0), reach_m));
        assert!(touch_in_step((0.0, 2.5), (0.0, 5.0), reach_m));
        // Bumper against bumper.
        assert!(!touch_in_step((4.8, 0.0), (0.0, 0.0), reach_m));
        assert!(touch_in_step((4.79, 0.0), (0.0, 0.0), reach_m));
        assert!(!touch_in_step((4.8, 0.0), (-1.0, 0.0), reach_m));
    }

    #[test]
    fn the_later_change_is_to_blame() {
        use FaultClass::{EgoAfterChange, EgoCutsIn, EgoRearEnds, OtherCutsIn, OtherRearEnds};
        let never = f64::INFINITY;
        let rows = [
            (true, never, never, EgoRearEnds),
            (true, 2.0, never, EgoAfterChange),
            (true, 6.0, never, EgoRearEnds),
            (true, 2.0, 1.0, OtherCutsIn),
            (true, 1.0, 2.0, EgoAfterChange),
            (true, never, 3.9, OtherCutsIn),
            (true, never, 4.0, EgoRearEnds),
            (false, never, never, OtherRearEnds),
            (false, 2.0, never, EgoCutsIn),
            (false, 2.0, 1.0, OtherCutsIn),
            (false, 1.0, 1.0, EgoCutsIn),
        ];
        for (other_ahead, ego_s, other_s, expected) in rows {
            assert_eq!(FaultClass::judge(other_ahead, ego_s, other_s), expected);
        }
        assert!(EgoCutsIn.at_fault() && !OtherCutsIn.at_fault() && !OtherRearEnds.at_fault());
    }
}
