//! Decisions: what can be decided, what is observed, what is rewarded and what is allowed.

mod action_set;
mod observation;
mod reward;
mod shield;

pub use action_set::{ActionMask, ActionSet, ActionsConfig, Decision, LaneChangeActions, Maneuver};
pub use observation::{ObservationConfig, ObservationForm, Situation, observe};
pub use reward::{CollisionForm, LaneForm, RewardConfig, RewardTerms, TickQuality, score};
pub use shield::{ShieldCause, ShieldConfig, check_lane_change};
