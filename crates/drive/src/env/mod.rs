//! The closed loop.

mod record;

pub use record::{
    CandidateRecord, EgoFrame, Frame, PathRecord, TRACE_SCHEMA, TickRecord, Trace, TraceHeader, VehicleFrame,
};
