//! The compiled half of the Python package `lanecraft`: thin bindings, no logic of their own.
//!
//! Users never see these classes: the package wraps them (`lanecraft/env.py`, `lanecraft/vector.py`), and its stubs
//! (`lanecraft/_lanecraft.pyi`) document them.

#![expect(clippy::needless_pass_by_value, reason = "arrays of Python can be arguments by value alone")]

mod env;
mod errors;
mod evaluate;
mod irl;
mod mpc;
mod parts;
mod plan;
mod policy;
mod qp;
mod task;
mod traffic;
mod vector;

use pyo3::prelude::*;

/// The compiled half of `lanecraft`.
#[pymodule]
mod _lanecraft {
    #[pymodule_export]
    use super::env::EnvCore;
    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "Python's name for it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
    #[pymodule_export]
    use super::evaluate::ResultsCore;
    #[pymodule_export]
    use super::evaluate::evaluate;
    #[pymodule_export]
    use super::policy::PolicyCore;
    #[pymodule_export]
    use super::task::Task;
    #[pymodule_export]
    use super::task::scenarios;
    #[pymodule_export]
    use super::traffic::WorldCore;
    #[pymodule_export]
    use super::traffic::idm;
    #[pymodule_export]
    use super::traffic::safe_gap;
    #[pymodule_export]
    use super::traffic::safe_speed;
    #[pymodule_export]
    use super::vector::VectorCore;

    #[pymodule_export]
    use super::irl::IrlCore;
    #[pymodule_export]
    use super::mpc::{LateralCore, LongitudinalCore};
    #[pymodule_export]
    use super::parts::Parts;
    #[pymodule_export]
    use super::plan::{PlannerCore, quintic_at, quintic_between, quintic_maxima};
    #[pymodule_export]
    use super::qp::{QpCore, qp_infinite_horizon_weight, qp_zero_order_hold};
}
