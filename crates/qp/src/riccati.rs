//! Riccati factorization of the cost in the inputs, and the sweeps that use it (docs/qp.md, Eqs. 3 to 8).

// Left to itself the compiler inlines a step of the recursion in one program and not in another, which costs a quarter of a solve
// whose matrices are new.
#![allow(clippy::inline_always)]

use crate::linalg::{Block, Matrix, Vector, add_product, add_scaled, inner, larger, product, transpose_product};
use crate::mirror::StageMirror;
use crate::problem::{Problem, Row, Stage};
use crate::terminal::with_diagonal;

/// Violation that counts as none, relative to the terms a constraint is summed from: some thousand rounding errors.
pub(crate) const TOLERANCE: f64 = 1e-12;

/// What the backward recursion leaves at stage k.
#[derive(Clone, Debug)]
struct StageFactor<const NX: usize> {
    /// P at the next stage: curvature of the cost from x_{k+1} on.
    cost_to_go: Matrix<NX, NX>,
    /// Gain of u = -K x + feedforward.
    gain: Vector<NX>,
    /// A - B K.
    closed_loop: Matrix<NX, NX>,
    /// 1 / √S with S = R + B'P B at this stage.
    inverse_root: f64,
    /// B / √S.
    scaled_b: Vector<NX>,
}

/// Minimizer of the Lagrangian, and what the rows make of it.
#[derive(Clone, Debug)]
pub(crate) struct Trajectory<const NX: usize, const NS: usize> {
    /// `u_0` to u_{N-1}.
    pub(crate) inputs: Vec<f64>,
    /// `x_0` to `x_N`.
    pub(crate) states: Vec<Vector<NX>>,
    /// Values of the rows of each stage.
    pub(crate) values: Vec<[f64; NS]>,
    /// Whether a stage keeps all its bounds but for rounding, and whether all do.
    pub(crate) kept: Vec<bool>,
    pub(crate) all_kept: bool,
    /// Whether all inputs are finite.
    pub(crate) finite: bool,
    /// Largest violation of a row; 0 if there is none.
    pub(crate) slack_max: f64,
    /// Largest magnitude of each state from `x_0` to x_{N-1}, and of the inputs.
    pub(crate) state_scale: Vector<NX>,
    pub(crate) input_scale: f64,
}

impl<const NX: usize, const NS: usize> Trajectory<NX, NS> {
    pub(crate) fn new(horizon: usize) -> Self {
        Self {
            inputs: vec![0.0; horizon],
            states: vec![[0.0; NX]; horizon + 1],
            values: vec![[0.0; NS]; horizon],
            kept: vec![true; horizon],
            all_kept: true,
            finite: true,
            slack_max: 0.0,
            state_scale: [0.0; NX],
            input_scale: 0.0,
        }
    }
}

/// Factorization of one problem's A, B, Q and R.
#[derive(Clone, Debug)]
pub(crate) struct Riccati<const NX: usize> {
    stages: Vec<StageFactor<NX>>,
}

impl<const NX: usize> Riccati<NX> {
    pub(crate) fn new(horizon: usize) -> Self {
        let zero = [[0.0; NX]; NX];
        let stage = StageFactor {
            cost_to_go: zero,
            gain: [0.0; NX],
            closed_loop: zero,
            inverse_root: 0.0,
            scaled_b: [0.0; NX],
        };
        Self { stages: vec![stage; horizon] }
    }

    /// Eq. 3, from the last stage to the first.
    pub(crate) fn factor<const NS: usize>(&mut self, problem: &Problem<NX, NS>) {
        let mut next = problem.terminal_weight;
        for (factor, stage) in self.stages.iter_mut().zip(&problem.stages).rev() {
            let cost_to_go = with_diagonal(next, &stage.state_weight);
            let (step, cost) = backward_step((&stage.a, &stage.b), &cost_to_go, stage.input_weight);
            let inverse_root = (1.0 / step.curvature).sqrt();
            let scaled_b = stage.b.map(|v| v * inverse_root);
            let BackwardStep { gain, closed_loop, .. } = step;
            *factor = StageFactor { cost_to_go, gain, closed_loop, inverse_root, scaled_b };
            next = cost;
        }
    }

    /// ρ / √S of each stage without multipliers (Eq. 4); `terminal` is the slope of the terminal cost at `x_N` = 0.
    pub(crate) fn sweep_back<const NS: usize>(
        &self,
        mirror: &[StageMirror<NX, NS>],
        terminal: Vector<NX>,
        out: &mut [Block],
    ) {
        let mut p = terminal;
        let out = out.as_flattened_mut()[..mirror.len()].iter_mut();
        for ((factor, stage), out) in self.stages.iter().zip(mirror).zip(out).rev() {
            let mut h = add_scaled(p, -1.0, &stage.state_pull);
            for (column, c) in factor.cost_to_go.iter().zip(&stage.c) {
                // P is symmetric: its rows are its columns.
                h = add_scaled(h, *c, column);
            }
            *out = inner(&factor.scaled_b, &h) - stage.input_pull * factor.inverse_root;
            p = factor.gain.map(|v| v * stage.input_pull);
            for (line, h) in factor.closed_loop.iter().zip(&h) {
                p = add_scaled(p, *h, line);
            }
        }
    }

    /// The trajectory for given ρ / √S (Eq. 5), the values of its rows, and which stages keep their bounds.
    pub(crate) fn sweep_forward<const NS: usize>(
        &self,
        mirror: &[StageMirror<NX, NS>],
        (input_min, input_max): (f64, f64),
        rho: &[Block],
        out: &mut Trajectory<NX, NS>,
    ) {
        let mut x = out.states[0];
        let (mut state_scale, mut input_scale, mut excess_max, mut taint) = ([0.0; NX], 0.0, [0.0; NS], 0.0);
        let mut all_kept = true;
        let outputs = out.inputs.iter_mut().zip(&mut out.states[1..]).zip(out.values.iter_mut().zip(&mut out.kept));
        let inputs = self.stages.iter().zip(mirror).zip(rho.as_flattened());
        for (((factor, stage), rho), ((input, next), (values, kept))) in inputs.zip(outputs) {
            let u = -rho * factor.inverse_root - inner(&factor.gain, &x);
            *input = u;
            *values = stage.values(&x, u);
            let mut keeps = u <= input_max;
            keeps &= u >= input_min;
            for i in 0..NS {
                let excess = larger(values[i] - stage.upper[i], stage.lower[i] - values[i]);
                keeps &= excess <= stage.rounding[i];
                excess_max[i] = larger(excess, excess_max[i]);
            }
            *kept = keeps;
            all_kept &= keeps;
            taint += u * 0.0;
            for i in 0..NX {
                state_scale[i] = larger(x[i].abs(), state_scale[i]);
            }
            input_scale = larger(u.abs(), input_scale);
            x = stage.step(&x, u);
            *next = x;
        }
        (out.state_scale, out.input_scale) = (state_scale, input_scale);
        out.all_kept = all_kept;
        out.finite = taint == 0.0;
        out.slack_max = excess_max.into_iter().fold(0.0, larger);
    }

    /// Response z of a constraint on (`x_k`, `u_k`), k = `out.len() - 1`, and the slope of its value in `x_0` (Eqs. 6 to 8).
    pub(crate) fn respond(&self, constraint: (&Vector<NX>, f64), out: &mut [f64]) -> Vector<NX> {
        let (state, input) = constraint;
        let Some((last, earlier)) = out.split_last_mut() else { return *state };
        let factor = &self.stages[earlier.len()];
        *last = input * factor.inverse_root;
        let mut p = add_scaled(*state, -input, &factor.gain);
        for (factor, z) in self.stages.iter().zip(earlier).rev() {
            *z = inner(&factor.scaled_b, &p);
            p = transpose_product(&factor.closed_loop, &p);
        }
        p
    }

    /// -`K_0` and `1/√S_0`, from which the slope of `u_0` in `x_0` follows.
    pub(crate) fn first_gain(&self) -> Option<(Vector<NX>, f64)> {
        self.stages.first().map(|s| (s.gain.map(|v| -v), s.inverse_root))
    }
}

impl<const NX: usize, const NS: usize> StageMirror<NX, NS> {
    /// Values of the rows at (x, u), all side by side.
    pub(crate) fn values(&self, x: &Vector<NX>, u: f64) -> [f64; NS] {
        let mut values = self.row_inputs.map(|d| d * u);
        for (column, x) in self.row_columns.iter().zip(x) {
            values = add_scaled(values, *x, column);
        }
        values
    }

    /// A x + B u + c, with the bits of [`step`].
    pub(crate) fn step(&self, x: &Vector<NX>, u: f64) -> Vector<NX> {
        let mut next = self.c;
        for (column, x) in self.a_columns.iter().zip(x) {
            next = add_scaled(next, *x, column);
        }
        add_scaled(next, u, &self.b)
    }
}

/// What one step of the backward recursion finds beside the cost.
pub(crate) struct BackwardStep<const NX: usize> {
    curvature: f64,
    gain: Vector<NX>,
    closed_loop: Matrix<NX, NX>,
}

/// Eq. 3: S, K and L, and the cost L'P L + K'R K at the start of the step, for (A, B), P and R.
#[inline(always)]
pub(crate) fn backward_step<const NX: usize>(
    (a, b): (&Matrix<NX, NX>, &Vector<NX>),
    cost_to_go: &Matrix<NX, NX>,
    input_weight: f64,
) -> (BackwardStep<NX>, Matrix<NX, NX>) {
    let pb = add_product([0.0; NX], cost_to_go, b);
    let curvature = input_weight + inner(b, &pb);
    let gain = transpose_product(a, &pb).map(|v| v / curvature);
    let mut closed_loop = *a;
    for (row, b) in closed_loop.iter_mut().zip(b) {
        *row = add_scaled(*row, -b, &gain);
    }
    let cost = symmetric_step(cost_to_go, &closed_loop, &gain, input_weight);
    (BackwardStep { curvature, gain, closed_loop }, cost)
}

/// L'P L + K'R K with L = A - B K: a sum of squares, so that rounding cannot make it indefinite (Joseph's form).
#[inline(always)]
pub(crate) fn symmetric_step<const NX: usize>(
    cost_to_go: &Matrix<NX, NX>,
    closed_loop: &Matrix<NX, NX>,
    gain: &Vector<NX>,
    input_weight: f64,
) -> Matrix<NX, NX> {
    let pl = product(cost_to_go, closed_loop);
    let mut next = [[0.0; NX]; NX];
    for i in 0..NX {
        for j in 0..=i {
            let mut sum = gain[i] * input_weight * gain[j];
            for l in 0..NX {
                sum += closed_loop[l][i] * pl[l][j];
            }
            next[i][j] = sum;
            next[j][i] = sum;
        }
    }
    next
}

/// A x + B u + c.
pub(crate) fn step<const NX: usize, const NS: usize>(stage: &Stage<NX, NS>, x: &Vector<NX>, u: f64) -> Vector<NX> {
    add_scaled(add_product(stage.c, &stage.a, x), u, &stage.b)
}

/// Value of a row at (x, u).
pub(crate) fn row_value<const NX: usize>(row: &Row<NX>, x: &Vector<NX>, u: f64) -> f64 {
    inner(&row.state, x) + row.input * u
}
