//! Lane-change paths: candidates, features and choice (Eqs. 12–20).
//!
//! [`Planner::window`] says for one side which durations are allowed (Eq. 15), or why none is; [`Planner::choose`] generates the
//! candidates of that window (Eqs. 12–14), computes their features (Eqs. 18–19) and takes the one with the highest learned reward
//! (Eq. 20).

mod candidates;
mod features;
mod interaction;
mod motion;
mod planner;
mod quintic;
mod reward;
mod samples;
mod window;

pub use candidates::{LateralBound, PlannerConfig};
pub use features::{
    FEATURE_NAMES, FEATURES, FeatureConfig, FeatureUnits, PAPER_FEATURES, PAPER_SELECTION, Selection, Surroundings,
    features, features_of_set,
};
pub use motion::{Course, Motion};
pub use planner::{LaneChangePath, Planner};
pub use quintic::{LateralState, Quintic};
pub use reward::{RewardError, RewardModel, feature_index};
pub use window::{Refusal, Window};
