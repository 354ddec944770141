//! Optimal-control quadratic programs of model-predictive-control size, with one input and soft constraints.
//!
//! ```
//! use lanecraft_qp::{Problem, Solver, Start, Status};
//! let mut problem = Problem::<1, 0>::new(10); // x_{k+1} = x_k + u_k from 1 to 0, |u_k| <= 0.3
//! problem.initial_state = [1.0];
//! (problem.input_min, problem.input_max) = (-0.3, 0.3);
//! for stage in &mut problem.stages {
//!     (stage.b, stage.state_weight) = ([1.0], [1.0]);
//! }
//! let mut solver = Solver::new(10);
//! let verdict = solver.solve(&problem, Start::Cold);
//! assert_eq!(verdict.status, Status::Solved);
//! assert_eq!(solver.inputs()[0], -0.3);
//! ```

mod active;
mod barrier;
mod hold;
mod interior;
mod linalg;
mod mirror;
mod problem;
mod responses;
mod riccati;
mod saved;
mod solver;
mod terminal;
mod validate;
mod verdict;
mod watch;

pub use hold::zero_order_hold;
pub use problem::{Problem, Row, Stage};
pub use solver::Solver;
pub use terminal::infinite_horizon_weight;
pub use validate::{Field, InvalidInput};
pub use verdict::{ActiveRow, Constraint, Side, Start, Status, Verdict};
