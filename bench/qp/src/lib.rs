//! The quadratic-program solver on sequences of a car's control problems, beside a peer that shares nothing with it.
//!
//! All sequences are seeded and come from closed loops: each problem starts from the state to which the answer of the one
//! before has led. [`sequences`] names the cases, [`measure`] times them, [`long`] tries to break the solver.

pub mod dump;
pub mod keeping;
pub mod long;
pub mod measure;
pub mod peer;
pub mod sequences;
pub mod steering;
