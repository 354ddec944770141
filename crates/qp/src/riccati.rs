//! Riccati factorization of the cost in the inputs, and the two sweeps that use it (docs/qp.md, Eqs. 3 to 8).

use crate::linalg::{Matrix, Vector, add_product, add_scaled, differing_bits, inner, product, transpose_product};
use crate::problem::{Problem, Row, Stage};

/// What the backward recursion leaves at stage k.
#[derive(Clone, Debug)]
struct StageFactor<const NX: usize> {
    /// P at the next stage: curvature of the cost from x_{k+1} on.
    cost_to_go: Matrix<NX, NX>,
    /// Gain of u = -K x + feedforward.
    gain: Vector<NX>,
    /// A - B K.
    closed_loop: Matrix<NX, NX>,
    /// 1 / S with S = R + B'P B at this stage.
    inverse_curvature: f64,
    /// Its square root.
    inverse_root: f64,
}

/// The matrices a factorization was made from.
#[derive(Clone, Debug)]
struct Key<const NX: usize> {
    a: Matrix<NX, NX>,
    b: Vector<NX>,
    state_weight: Vector<NX>,
    input_weight: f64,
}

/// Signed multipliers of the constraints of one stage: positive at an upper bound, negative at a lower one, 0 if inactive.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Multipliers<const NS: usize> {
    pub(crate) rows: [f64; NS],
    pub(crate) input: f64,
}

/// Minimizer of the Lagrangian.
#[derive(Clone, Debug)]
pub(crate) struct Trajectory<const NX: usize> {
    /// `u_0` to u_{N-1}.
    pub(crate) inputs: Vec<f64>,
    /// `x_0` to `x_N`.
    pub(crate) states: Vec<Vector<NX>>,
    /// Largest magnitude of each state from `x_0` to x_{N-1}, and of the inputs.
    pub(crate) state_scale: Vector<NX>,
    pub(crate) input_scale: f64,
    /// Feedforward of each stage, scratch of the sweep.
    feedforward: Vec<f64>,
}

impl<const NX: usize> Trajectory<NX> {
    pub(crate) fn new(horizon: usize) -> Self {
        Self {
            inputs: vec![0.0; horizon],
            states: vec![[0.0; NX]; horizon + 1],
            state_scale: [0.0; NX],
            input_scale: 0.0,
            feedforward: vec![0.0; horizon],
        }
    }
}

/// Factorization of one problem's A, B, Q and R.
#[derive(Clone, Debug)]
pub(crate) struct Riccati<const NX: usize> {
    stages: Vec<StageFactor<NX>>,
    keys: Vec<Key<NX>>,
    valid: bool,
}

impl<const NX: usize> Riccati<NX> {
    pub(crate) fn new(horizon: usize) -> Self {
        let zero = [[0.0; NX]; NX];
        let stage = StageFactor {
            cost_to_go: zero,
            gain: [0.0; NX],
            closed_loop: zero,
            inverse_curvature: 0.0,
            inverse_root: 0.0,
        };
        let key = Key { a: zero, b: [0.0; NX], state_weight: [0.0; NX], input_weight: 0.0 };
        Self { stages: vec![stage; horizon], keys: vec![key; horizon], valid: false }
    }

    pub(crate) fn forget(&mut self) {
        self.valid = false;
    }

    /// Whether A, B, Q and R of `problem` have the bits of those that were factored last.
    pub(crate) fn holds<const NS: usize>(&self, problem: &Problem<NX, NS>) -> bool {
        self.valid
            && self.keys.len() == problem.stages.len()
            && self.keys.iter().zip(&problem.stages).all(|(key, stage)| key.matches(stage))
    }

    /// Factors A, B, Q and R, and keeps them.
    pub(crate) fn update<const NS: usize>(&mut self, problem: &Problem<NX, NS>) {
        for (key, stage) in self.keys.iter_mut().zip(&problem.stages) {
            *key = Key { a: stage.a, b: stage.b, state_weight: stage.state_weight, input_weight: stage.input_weight };
        }
        self.factor(problem);
        self.valid = true;
    }

    /// Eq. 3, from the last stage to the first.
    fn factor<const NS: usize>(&mut self, problem: &Problem<NX, NS>) {
        let mut cost_to_go = [[0.0; NX]; NX];
        for (factor, stage) in self.stages.iter_mut().zip(&problem.stages).rev() {
            for (i, weight) in stage.state_weight.iter().enumerate() {
                cost_to_go[i][i] += weight;
            }
            let pb = add_product([0.0; NX], &cost_to_go, &stage.b);
            let curvature = stage.input_weight + inner(&stage.b, &pb);
            let gain = transpose_product(&stage.a, &pb).map(|v| v / curvature);
            let mut closed_loop = stage.a;
            for (row, b) in closed_loop.iter_mut().zip(&stage.b) {
                *row = add_scaled(*row, -b, &gain);
            }
            let next = symmetric_step(&cost_to_go, &closed_loop, &gain, stage.input_weight);
            let inverse_curvature = 1.0 / curvature;
            *factor = StageFactor {
                cost_to_go,
                gain,
                closed_loop,
                inverse_curvature,
                inverse_root: inverse_curvature.sqrt(),
            };
            cost_to_go = next;
        }
    }

    /// Minimizes the Lagrangian for these multipliers (Eqs. 4 and 5).
    pub(crate) fn minimize<const NS: usize>(
        &self,
        problem: &Problem<NX, NS>,
        multipliers: &[Multipliers<NS>],
        out: &mut Trajectory<NX>,
    ) {
        self.sweep_back(problem, multipliers, &mut out.feedforward);
        let mut x = problem.initial_state;
        out.states[0] = x;
        out.state_scale = [0.0; NX];
        out.input_scale = 0.0;
        for (k, (factor, stage)) in self.stages.iter().zip(&problem.stages).enumerate() {
            for (scale, v) in out.state_scale.iter_mut().zip(&x) {
                *scale = scale.max(v.abs());
            }
            let u = out.feedforward[k] - inner(&factor.gain, &x);
            out.input_scale = out.input_scale.max(u.abs());
            x = step(stage, &x, u);
            out.inputs[k] = u;
            out.states[k + 1] = x;
        }
    }

    fn sweep_back<const NS: usize>(
        &self,
        problem: &Problem<NX, NS>,
        multipliers: &[Multipliers<NS>],
        feedforward: &mut [f64],
    ) {
        let mut p = [0.0; NX];
        for (k, (factor, stage)) in self.stages.iter().zip(&problem.stages).enumerate().rev() {
            for ((p, weight), reference) in p.iter_mut().zip(&stage.state_weight).zip(&stage.state_reference) {
                *p -= weight * reference;
            }
            let h = add_scaled(add_product([0.0; NX], &factor.cost_to_go, &stage.c), 1.0, &p);
            let mut own = multipliers[k].input - stage.input_weight * stage.input_reference;
            let mut pull = [0.0; NX];
            for (row, &multiplier) in stage.rows.iter().zip(&multipliers[k].rows) {
                if multiplier != 0.0 {
                    own += multiplier * row.input;
                    pull = add_scaled(pull, multiplier, &row.state);
                }
            }
            feedforward[k] = -(inner(&stage.b, &h) + own) * factor.inverse_curvature;
            p = add_scaled(pull, -own, &factor.gain);
            for (closed_loop, h) in factor.closed_loop.iter().zip(&h) {
                p = add_scaled(p, *h, closed_loop);
            }
        }
    }

    /// Response z of a constraint on (`x_k`, `u_k`), k = `out.len() - 1`, and the slope of its value in `x_0` (Eqs. 6 to 8).
    pub(crate) fn respond<const NS: usize>(
        &self,
        problem: &Problem<NX, NS>,
        constraint: (&Vector<NX>, f64),
        out: &mut [f64],
    ) -> Vector<NX> {
        let (state, input) = constraint;
        let Some((last, earlier)) = out.split_last_mut() else { return *state };
        let factor = &self.stages[earlier.len()];
        *last = input * factor.inverse_root;
        let mut p = add_scaled(*state, -input, &factor.gain);
        for (k, z) in earlier.iter_mut().enumerate().rev() {
            let factor = &self.stages[k];
            *z = inner(&problem.stages[k].b, &p) * factor.inverse_root;
            p = transpose_product(&factor.closed_loop, &p);
        }
        p
    }

    /// -`K_0` and `1/√S_0`, from which the slope of `u_0` in `x_0` follows.
    pub(crate) fn first_gain(&self) -> Option<(Vector<NX>, f64)> {
        self.stages.first().map(|s| (s.gain.map(|v| -v), s.inverse_root))
    }
}

impl<const NX: usize> Key<NX> {
    fn matches<const NS: usize>(&self, stage: &Stage<NX, NS>) -> bool {
        let mut difference = self.input_weight.to_bits() ^ stage.input_weight.to_bits();
        for (line, other) in self.a.iter().zip(&stage.a) {
            difference |= differing_bits(line, other);
        }
        difference |= differing_bits(&self.b, &stage.b) | differing_bits(&self.state_weight, &stage.state_weight);
        difference == 0
    }
}

/// L'P L + K'R K with L = A - B K: a sum of squares, so that rounding cannot make it indefinite (Joseph's form).
#[inline]
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
