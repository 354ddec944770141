//! The data of an optimal-control quadratic program with one input, stage by stage.
//!
//! The numbers carry the caller's units: this crate knows states, inputs and rows, not what they measure.

use serde::{Deserialize, Serialize};

use crate::linalg::add_product;

/// One soft constraint of a stage: `lower - s <= state'x_k + input u_k <= upper + s`, where the slack s >= 0 costs
/// `l1_weight s + l2_weight s²/2`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound(serialize = "[f64; NX]: Serialize", deserialize = "[f64; NX]: Deserialize<'de>"))]
pub struct Row<const NX: usize> {
    /// Coefficients of `x_k`. A limit on x_{k+1} is written as a row on (`x_k`, `u_k`), with the dynamics put in.
    pub state: [f64; NX],
    /// Coefficient of `u_k`.
    pub input: f64,
    /// Lower bound; negative infinity for none.
    pub lower: f64,
    /// Upper bound, at least `lower`; infinity for none.
    pub upper: f64,
    /// Linear cost of the slack, at least 0. The bound is met exactly wherever its multiplier stays below this weight.
    pub l1_weight: f64,
    /// Quadratic cost of the slack, above 0. It makes the multipliers unique.
    pub l2_weight: f64,
}

impl<const NX: usize> Row<NX> {
    /// A row of zeros without bounds, with both weights 1.
    pub const fn unbounded() -> Self {
        Self {
            state: [0.0; NX],
            input: 0.0,
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
            l1_weight: 1.0,
            l2_weight: 1.0,
        }
    }
}

/// Stage k: the step from `x_k` to x_{k+1}, the cost of x_{k+1} and `u_k`, and the soft constraints on (`x_k`, `u_k`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound(
    serialize = "[f64; NX]: Serialize, [[f64; NX]; NX]: Serialize, [Row<NX>; NS]: Serialize",
    deserialize = "[f64; NX]: Deserialize<'de>, [[f64; NX]; NX]: Deserialize<'de>, [Row<NX>; NS]: Deserialize<'de>"
))]
pub struct Stage<const NX: usize, const NS: usize> {
    /// A of x_{k+1} = A `x_k` + B `u_k` + c, row by row.
    pub a: [[f64; NX]; NX],
    /// B of x_{k+1} = A `x_k` + B `u_k` + c.
    pub b: [f64; NX],
    /// c of x_{k+1} = A `x_k` + B `u_k` + c.
    pub c: [f64; NX],
    /// Diagonal of Q_{k+1}, each at least 0.
    pub state_weight: [f64; NX],
    /// Reference of x_{k+1}.
    pub state_reference: [f64; NX],
    /// `R_k`, above 0.
    pub input_weight: f64,
    /// Reference of `u_k`.
    pub input_reference: f64,
    /// Soft constraints on (`x_k`, `u_k`).
    pub rows: [Row<NX>; NS],
}

impl<const NX: usize, const NS: usize> Stage<NX, NS> {
    /// A stage that keeps the state (A = 1, B = c = 0), weighs only the input (by 1), and bounds nothing.
    pub fn neutral() -> Self {
        let mut a = [[0.0; NX]; NX];
        for (i, row) in a.iter_mut().enumerate() {
            row[i] = 1.0;
        }
        Self {
            a,
            b: [0.0; NX],
            c: [0.0; NX],
            state_weight: [0.0; NX],
            state_reference: [0.0; NX],
            input_weight: 1.0,
            input_reference: 0.0,
            rows: [Row::unbounded(); NS],
        }
    }
}

/// A whole program: initial state, bounds of the input, and one [`Stage`] for each step of the horizon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound(
    serialize = "[f64; NX]: Serialize, [[f64; NX]; NX]: Serialize, Stage<NX, NS>: Serialize",
    deserialize = "[f64; NX]: Deserialize<'de>, [[f64; NX]; NX]: Deserialize<'de>, Stage<NX, NS>: Deserialize<'de>"
))]
pub struct Problem<const NX: usize, const NS: usize> {
    /// `x_0`.
    pub initial_state: [f64; NX],
    /// Hard lower bound of every input; negative infinity for none.
    pub input_min: f64,
    /// Hard upper bound of every input, at least `input_min`; infinity for none.
    pub input_max: f64,
    /// T of the terminal cost ½ (x_N − xr_N)' T (x_N − xr_N), which comes on top of Q_N: symmetric and at least 0; zero for
    /// none. [`crate::infinite_horizon_weight`] gives one that stands for all the time after the horizon.
    pub terminal_weight: [[f64; NX]; NX],
    /// Stages 0 to N-1.
    pub stages: Vec<Stage<NX, NS>>,
}

impl<const NX: usize, const NS: usize> Problem<NX, NS> {
    /// A problem of `horizon` neutral stages, from the zero state, without bounds.
    pub fn new(horizon: usize) -> Self {
        Self {
            initial_state: [0.0; NX],
            input_min: f64::NEG_INFINITY,
            input_max: f64::INFINITY,
            terminal_weight: [[0.0; NX]; NX],
            stages: vec![Stage::neutral(); horizon],
        }
    }

    /// -T xr_N, the slope of the terminal cost at `x_N` = 0.
    pub(crate) fn terminal_slope(&self) -> [f64; NX] {
        let reference = self.stages.last().map_or([0.0; NX], |stage| stage.state_reference);
        add_product([0.0; NX], &self.terminal_weight, &reference.map(|v| -v))
    }
}
