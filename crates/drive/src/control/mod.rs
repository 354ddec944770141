//! The two model-predictive controllers, their limits, fall-backs and the guard behind them; classical
//! controllers as baselines.

pub mod classical;
mod config;
mod delay;
mod guard;
mod lateral;
mod longitudinal;
mod observer;
#[cfg(test)]
mod tests;
mod verdict;
mod worst_case;

pub use config::{ControlConfig, Footing, HeadingReference, MAX_HORIZON, TerminalCost};
pub use guard::{Guard, GuardCause};
pub use lateral::{LateralMpc, LateralReference, SteerPlan};
pub use longitudinal::{LongitudinalMpc, SPEED_POINTS, SpeedGoal, SpeedPlan};
pub use verdict::{ControlWeights, Rung, SolveSummary};
