//! The closed loop: a world, a car and its driver, one tick at a time.

mod config;
mod environment;
mod episode;
mod foresight;
mod record;
mod snapshot;
mod step;

pub use config::{Config, EnvConfig, Order, Periods};
pub use environment::{Env, EnvError};
pub use episode::{Episode, TIME_TO_COLLISION_CAP_S};
pub use record::{
    CandidateRecord, EgoFrame, Frame, PathRecord, TRACE_SCHEMA, TickRecord, Trace, TraceHeader, VehicleFrame,
};
pub use step::{StepError, StepOutcome};
