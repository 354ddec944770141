//! The fast environment: this crate's traffic and an ego car with a kinematic model and meta-actions, without planner, controllers or
//! shield.
//!
//! The task is that of `highway-fast-v0` of highway-env (Leurent, 2018, <https://github.com/Farama-Foundation/HighwayEnv>): drive fast and
//! on the right, and do not collide. Actions, observation, reward and the ego's motion follow its definitions and names; the other
//! vehicles are those of [`crate::traffic`]. `docs/kinematic.md` numbers the differences.

mod action;
mod config;
mod ego;
mod environment;
mod observation;
mod snapshot;

pub use action::MetaAction;
pub use config::{Feature, KinematicConfig, KinematicTask, KinematicsConfig};
pub use ego::EgoState;
pub use environment::{KinematicEnv, Outcome, StepError};
