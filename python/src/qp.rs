//! Quadratic programs of optimal control of any small size: the solver's sizes are fixed, and smaller problems are padded with states
//! that stay 0 and rows without bounds, which change nothing.

use lanecraft_qp::{
    ActiveRow, Constraint, Problem, Row, Side, Solver, Start, Status, Verdict, infinite_horizon_weight, zero_order_hold,
};
use numpy::ndarray::s;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::errors::{self, ConfigError};
use crate::parts::shaped;

/// Largest sizes: memory grows with the square of horizon × (rows + 1).
pub(crate) const MAX_HORIZON: usize = 256;
pub(crate) const MAX_STATES: usize = 8;
pub(crate) const MAX_ROWS: usize = 8;

/// Inputs, states, status, (iterations, largest slack, residual), active rows, feedback.
type Answer<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    &'static str,
    (u32, f64, f64),
    Vec<ActiveParts>,
    Bound<'py, PyArray1<f64>>,
);
/// Stage, row (none: the input), whether it is the upper bound, multiplier, slack.
type ActiveParts = (usize, Option<usize>, bool, f64, f64);

/// Two matrices.
type Matrices<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// What `lanecraft.qp.Problem` holds: horizon N, n states, m rows.
#[derive(FromPyObject)]
struct Arrays<'py> {
    initial_state: PyReadonlyArray1<'py, f64>,
    input_min: f64,
    input_max: f64,
    terminal_weight: PyReadonlyArray2<'py, f64>,
    a: PyReadonlyArray3<'py, f64>,
    b: PyReadonlyArray2<'py, f64>,
    c: PyReadonlyArray2<'py, f64>,
    state_weight: PyReadonlyArray2<'py, f64>,
    state_reference: PyReadonlyArray2<'py, f64>,
    input_weight: PyReadonlyArray1<'py, f64>,
    input_reference: PyReadonlyArray1<'py, f64>,
    row_state: PyReadonlyArray3<'py, f64>,
    row_input: PyReadonlyArray2<'py, f64>,
    row_lower: PyReadonlyArray2<'py, f64>,
    row_upper: PyReadonlyArray2<'py, f64>,
    row_l1_weight: PyReadonlyArray2<'py, f64>,
    row_l2_weight: PyReadonlyArray2<'py, f64>,
}

impl Arrays<'_> {
    /// Refuses arrays that are not of one horizon, number of states and number of rows.
    fn check(&self, (horizon, states, rows): (usize, usize, usize)) -> PyResult<()> {
        shaped("initial_state", &self.initial_state.as_array(), &[states])?;
        shaped("terminal_weight", &self.terminal_weight.as_array(), &[states, states])?;
        shaped("a", &self.a.as_array(), &[horizon, states, states])?;
        shaped("b", &self.b.as_array(), &[horizon, states])?;
        shaped("c", &self.c.as_array(), &[horizon, states])?;
        shaped("state_weight", &self.state_weight.as_array(), &[horizon, states])?;
        shaped("state_reference", &self.state_reference.as_array(), &[horizon, states])?;
        shaped("input_weight", &self.input_weight.as_array(), &[horizon])?;
        shaped("input_reference", &self.input_reference.as_array(), &[horizon])?;
        shaped("row_state", &self.row_state.as_array(), &[horizon, rows, states])?;
        shaped("row_input", &self.row_input.as_array(), &[horizon, rows])?;
        shaped("row_lower", &self.row_lower.as_array(), &[horizon, rows])?;
        shaped("row_upper", &self.row_upper.as_array(), &[horizon, rows])?;
        shaped("row_l1_weight", &self.row_l1_weight.as_array(), &[horizon, rows])?;
        shaped("row_l2_weight", &self.row_l2_weight.as_array(), &[horizon, rows])
    }
}

/// A solver of some size.
trait Engine: Send + Sync {
    fn fill(&mut self, arrays: &Arrays<'_>);
    fn solve(&mut self, start: Start, steps: u64) -> Verdict;
    fn reset(&mut self);
    fn inputs(&self) -> &[f64];
    /// The first `states` of each state.
    fn states(&self, states: usize) -> Vec<Vec<f64>>;
    fn active(&self) -> Vec<ActiveRow>;
    fn feedback(&mut self, states: usize) -> Vec<f64>;
}

/// One of the fixed sizes.
struct Fixed<const NX: usize, const NS: usize> {
    problem: Problem<NX, NS>,
    solver: Solver<NX, NS>,
}

impl<const NX: usize, const NS: usize> Fixed<NX, NS> {
    fn boxed(horizon: usize) -> Box<dyn Engine> {
        let mut problem = Problem::new(horizon);
        for stage in &mut problem.stages {
            stage.a = [[0.0; NX]; NX];
        }
        Box::new(Self { problem, solver: Solver::new(horizon) })
    }
}

impl<const NX: usize, const NS: usize> Engine for Fixed<NX, NS> {
    fn fill(&mut self, arrays: &Arrays<'_>) {
        let problem = &mut self.problem;
        copy(&mut problem.initial_state, arrays.initial_state.as_array());
        (problem.input_min, problem.input_max) = (arrays.input_min, arrays.input_max);
        for (line, row) in problem.terminal_weight.iter_mut().zip(arrays.terminal_weight.as_array().rows()) {
            copy(line, row);
        }
        for (k, stage) in problem.stages.iter_mut().enumerate() {
            for (i, line) in stage.a.iter_mut().enumerate().take(arrays.a.as_array().shape()[1]) {
                copy(line, arrays.a.as_array().slice(s![k, i, ..]));
            }
            copy(&mut stage.b, arrays.b.as_array().row(k));
            copy(&mut stage.c, arrays.c.as_array().row(k));
            copy(&mut stage.state_weight, arrays.state_weight.as_array().row(k));
            copy(&mut stage.state_reference, arrays.state_reference.as_array().row(k));
            stage.input_weight = arrays.input_weight.as_array()[k];
            stage.input_reference = arrays.input_reference.as_array()[k];
            for (i, row) in stage.rows.iter_mut().enumerate().take(arrays.row_input.as_array().shape()[1]) {
                *row = Row {
                    state: row.state,
                    input: arrays.row_input.as_array()[[k, i]],
                    lower: arrays.row_lower.as_array()[[k, i]],
                    upper: arrays.row_upper.as_array()[[k, i]],
                    l1_weight: arrays.row_l1_weight.as_array()[[k, i]],
                    l2_weight: arrays.row_l2_weight.as_array()[[k, i]],
                };
                copy(&mut row.state, arrays.row_state.as_array().slice(s![k, i, ..]));
            }
        }
    }

    fn solve(&mut self, start: Start, steps: u64) -> Verdict {
        let mut left = steps;
        self.solver.solve_until(&self.problem, start, || {
            let over = left == 0;
            left = left.saturating_sub(1);
            over
        })
    }

    fn reset(&mut self) {
        self.solver.reset();
    }

    fn inputs(&self) -> &[f64] {
        self.solver.inputs()
    }

    fn states(&self, states: usize) -> Vec<Vec<f64>> {
        let first = std::iter::once(&self.problem.initial_state);
        first.chain(self.solver.states()).map(|state| state[..states].to_vec()).collect()
    }

    fn active(&self) -> Vec<ActiveRow> {
        self.solver.active_rows().collect()
    }

    fn feedback(&mut self, states: usize) -> Vec<f64> {
        self.solver.feedback()[..states].to_vec()
    }
}

/// The numbers of `from` into the first places of `to`.
fn copy<'a>(to: &mut [f64], from: impl IntoIterator<Item = &'a f64>) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
}

/// The smallest of the fixed sizes that holds `states` and `rows`.
fn engine(horizon: usize, states: usize, rows: usize) -> Box<dyn Engine> {
    match (states, rows) {
        (..=2, 0) => Fixed::<2, 0>::boxed(horizon),
        (..=2, ..=2) => Fixed::<2, 2>::boxed(horizon),
        (..=2, ..=4) => Fixed::<2, 4>::boxed(horizon),
        (..=2, _) => Fixed::<2, 8>::boxed(horizon),
        (..=4, 0) => Fixed::<4, 0>::boxed(horizon),
        (..=4, ..=2) => Fixed::<4, 2>::boxed(horizon),
        (..=4, ..=4) => Fixed::<4, 4>::boxed(horizon),
        (..=4, _) => Fixed::<4, 8>::boxed(horizon),
        (_, 0) => Fixed::<8, 0>::boxed(horizon),
        (_, ..=2) => Fixed::<8, 2>::boxed(horizon),
        (_, ..=4) => Fixed::<8, 4>::boxed(horizon),
        _ => Fixed::<8, 8>::boxed(horizon),
    }
}

/// A solver of one size with its warm start.
#[pyclass(module = "lanecraft._lanecraft")]
pub(crate) struct QpCore {
    /// Horizon, states, rows.
    size: (usize, usize, usize),
    engine: Box<dyn Engine>,
}

#[pymethods]
impl QpCore {
    #[new]
    fn new(horizon: usize, states: usize, rows: usize) -> PyResult<Self> {
        let sizes =
            [("horizon", horizon, 1, MAX_HORIZON), ("states", states, 1, MAX_STATES), ("rows", rows, 0, MAX_ROWS)];
        for (what, found, least, most) in sizes {
            if !(least..=most).contains(&found) {
                return Err(ConfigError::new_err(format!("`{what}` is {found}, but must be in {least}..={most}")));
            }
        }
        Ok(Self { size: (horizon, states, rows), engine: engine(horizon, states, rows) })
    }

    /// Solves from nothing (`shift` none) or from the last solution, moved by `shift` stages, in at most `steps` steps.
    fn solve<'py>(
        &mut self,
        py: Python<'py>,
        problem: &Bound<'py, PyAny>,
        shift: Option<usize>,
        steps: Option<u64>,
    ) -> PyResult<Answer<'py>> {
        let arrays: Arrays<'_> = problem.extract()?;
        arrays.check(self.size)?;
        let engine = &mut self.engine;
        engine.fill(&arrays);
        let start = shift.map_or(Start::Cold, Start::Shifted);
        let verdict = py.detach(|| engine.solve(start, steps.unwrap_or(u64::MAX)));
        let status = match verdict.status {
            Status::Solved => "solved",
            Status::IterationLimit => "iteration-limit",
            Status::OutOfTime => "step-limit",
            Status::InvalidInput(error) => return Err(errors::config(&error)),
        };
        let numbers = (verdict.iterations, verdict.slack_max, verdict.kkt_residual);
        let active = engine.active().iter().map(active_parts).collect();
        let inputs = PyArray1::from_slice(py, engine.inputs());
        let states = PyArray2::from_vec2(py, &engine.states(self.size.1))?;
        let feedback = PyArray1::from_vec(py, engine.feedback(self.size.1));
        Ok((inputs, states, status, numbers, active, feedback))
    }

    /// Forgets all earlier solves.
    fn reset(&mut self) {
        self.engine.reset();
    }
}

fn active_parts(row: &ActiveRow) -> ActiveParts {
    let index = match row.constraint {
        Constraint::Input => None,
        Constraint::Row(index) => Some(index),
    };
    (row.stage, index, row.side == Side::Upper, row.multiplier, row.slack)
}

/// (Φ, Γ) of x' = A x + B u under an input that is held for `dt_s`: n × n and n × m.
#[pyfunction]
pub(crate) fn qp_zero_order_hold<'py>(
    py: Python<'py>,
    a: PyReadonlyArray2<'py, f64>,
    b: PyReadonlyArray2<'py, f64>,
    dt_s: f64,
) -> PyResult<Matrices<'py>> {
    let (n, m) = (a.as_array().shape()[0].min(MAX_STATES), b.as_array().shape()[1].min(MAX_STATES));
    shaped("a", &a.as_array(), &[n, n])?;
    shaped("b", &b.as_array(), &[n, m])?;
    let (transition, input) = zero_order_hold::<MAX_STATES, MAX_STATES>(&padded(&a), &padded(&b), dt_s);
    Ok((cut(py, &transition, (n, n))?, cut(py, &input, (n, m))?))
}

/// The terminal weight that stands for all the time after the horizon; none if there is none.
#[pyfunction]
pub(crate) fn qp_infinite_horizon_weight<'py>(
    py: Python<'py>,
    a: PyReadonlyArray2<'py, f64>,
    b: PyReadonlyArray1<'py, f64>,
    state_weight: PyReadonlyArray1<'py, f64>,
    input_weight: f64,
) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
    let n = a.as_array().shape()[0].min(MAX_STATES);
    shaped("a", &a.as_array(), &[n, n])?;
    shaped("b", &b.as_array(), &[n])?;
    shaped("state_weight", &state_weight.as_array(), &[n])?;
    let (mut input, mut weights) = ([0.0; MAX_STATES], [0.0; MAX_STATES]);
    copy(&mut input, b.as_array());
    copy(&mut weights, state_weight.as_array());
    let found = infinite_horizon_weight(&padded(&a), &input, &weights, input_weight);
    found.map(|weight| cut(py, &weight, (n, n))).transpose()
}

/// A small matrix in the corner of a large one of zeros.
fn padded(matrix: &PyReadonlyArray2<'_, f64>) -> [[f64; MAX_STATES]; MAX_STATES] {
    let mut large = [[0.0; MAX_STATES]; MAX_STATES];
    for (line, row) in large.iter_mut().zip(matrix.as_array().rows()) {
        copy(line, row);
    }
    large
}

/// The corner of a large matrix.
fn cut<'py, const N: usize>(
    py: Python<'py>,
    large: &[[f64; N]; N],
    (rows, columns): (usize, usize),
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let corner: Vec<Vec<f64>> = large[..rows].iter().map(|row| row[..columns].to_vec()).collect();
    Ok(PyArray2::from_vec2(py, &corner)?)
}
