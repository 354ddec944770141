//! The meta-actions, in the order of highway-env's `DiscreteMetaAction`.

use super::ego::EgoState;
use crate::decide::ActionMask;
use crate::road::{Road, Side};

/// What the ego is told at a decision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MetaAction {
    /// Change to the lane on the left of the target lane.
    LaneLeft,
    /// Keep target lane and target speed.
    Idle,
    /// Change to the lane on the right of the target lane.
    LaneRight,
    /// The target speed above the one nearest to the present speed.
    Faster,
    /// The target speed below the one nearest to the present speed.
    Slower,
}

impl MetaAction {
    /// All of them; an action's index is its place here.
    pub const ALL: [Self; 5] = [Self::LaneLeft, Self::Idle, Self::LaneRight, Self::Faster, Self::Slower];

    /// Its name in highway-env.
    pub fn name(self) -> &'static str {
        match self {
            Self::LaneLeft => "LANE_LEFT",
            Self::Idle => "IDLE",
            Self::LaneRight => "LANE_RIGHT",
            Self::Faster => "FASTER",
            Self::Slower => "SLOWER",
        }
    }

    /// The side that a lane change goes to.
    pub fn side(self) -> Option<Side> {
        match self {
            Self::LaneLeft => Some(Side::Left),
            Self::LaneRight => Some(Side::Right),
            Self::Idle | Self::Faster | Self::Slower => None,
        }
    }

    /// Whether there is such a lane or such a target speed.
    fn is_available(self, ego: &EgoState, road: &Road, speeds: usize) -> bool {
        match self {
            Self::Idle => true,
            Self::Faster => ego.speed_index + 1 < speeds,
            Self::Slower => ego.speed_index > 0,
            Self::LaneLeft | Self::LaneRight => {
                self.side().is_some_and(|side| road.beside(ego.target_lane, side).is_some())
            }
        }
    }

    /// The available ones of all.
    pub(super) fn mask(ego: &EgoState, road: &Road, speeds: usize) -> ActionMask {
        let available = Self::ALL.iter().enumerate().filter(|(_, action)| action.is_available(ego, road, speeds));
        ActionMask(available.fold(0, |bits, (index, _)| bits | 1 << index))
    }
}
