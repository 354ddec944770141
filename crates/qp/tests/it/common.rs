//! What the test binaries share: random problems, a rollout that knows nothing of the solver, and Clarabel.
// Indices as in the equations.
#![allow(clippy::needless_range_loop)]

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT};
use lanecraft_qp::{Problem, Row};

/// `SplitMix64`, so that the tests need no crate for it.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Log-uniform between two powers of ten.
    pub(crate) fn decade(&mut self, low: f64, high: f64) -> f64 {
        libm::exp10(self.range(low, high))
    }
}

/// Ranges of a random problem.
#[derive(Clone, Copy)]
pub(crate) struct Recipe {
    /// Decades of the weights of states, inputs and slacks.
    pub(crate) weights: (f64, f64),
    /// Size of the initial state; the rows bound combinations of states by about 1.
    pub(crate) initial: f64,
    /// Least and largest diagonal of A.
    pub(crate) modes: (f64, f64),
}

pub(crate) const MILD: Recipe = Recipe { weights: (-1.0, 1.0), initial: 1.0, modes: (0.6, 1.02) };
pub(crate) const FAR: Recipe = Recipe { weights: (-1.0, 2.0), initial: 100.0, modes: (0.8, 1.05) };

pub(crate) fn random_problem<const NX: usize, const NS: usize>(
    random: &mut Random,
    horizon: usize,
    recipe: Recipe,
) -> Problem<NX, NS> {
    let mut problem = Problem::new(horizon);
    let (low, high) = recipe.weights;
    let weights: [f64; NX] = std::array::from_fn(|_| random.decade(low, high));
    let input_weight = random.decade(low, high);
    let slack_weights: [(f64, f64); NS] = std::array::from_fn(|_| (random.decade(low, high), random.decade(low, high)));
    problem.initial_state = std::array::from_fn(|_| recipe.initial * random.range(-1.0, 1.0));
    (problem.input_min, problem.input_max) = (-random.range(0.2, 1.5), random.range(0.2, 1.5));
    for stage in &mut problem.stages {
        for i in 0..NX {
            stage.a[i] = std::array::from_fn(|_| 0.15 * random.range(-1.0, 1.0));
            stage.a[i][i] = random.range(recipe.modes.0, recipe.modes.1);
            stage.b[i] = random.range(-1.0, 1.0);
            stage.c[i] = 0.1 * random.range(-1.0, 1.0);
            stage.state_weight[i] = if random.uniform() < 0.3 { 0.0 } else { weights[i] };
            stage.state_reference[i] = random.range(-1.0, 1.0);
        }
        stage.input_weight = input_weight;
        stage.input_reference = random.range(-1.0, 1.0);
        for (row, (l1, l2)) in stage.rows.iter_mut().zip(slack_weights) {
            *row = random_row(random, l1, l2);
        }
    }
    problem
}

fn random_row<const NX: usize>(random: &mut Random, l1_weight: f64, l2_weight: f64) -> Row<NX> {
    let center = 0.3 * random.range(-1.0, 1.0);
    let (mut lower, mut upper) = (center - random.range(0.0, 1.0), center + random.range(0.0, 1.0));
    match random.uniform() {
        p if p < 0.2 => lower = f64::NEG_INFINITY,
        p if p < 0.4 => upper = f64::INFINITY,
        _ => {}
    }
    Row {
        state: std::array::from_fn(|_| random.range(-1.0, 1.0)),
        input: random.range(-1.0, 1.0),
        lower,
        upper,
        l1_weight,
        l2_weight,
    }
}

/// `x_0` to `x_N` under the inputs.
pub(crate) fn rollout<const NX: usize, const NS: usize>(problem: &Problem<NX, NS>, inputs: &[f64]) -> Vec<[f64; NX]> {
    let mut states = vec![problem.initial_state];
    for (stage, u) in problem.stages.iter().zip(inputs) {
        let x = states[states.len() - 1];
        states.push(std::array::from_fn(|i| {
            stage.c[i] + stage.b[i] * u + (0..NX).map(|j| stage.a[i][j] * x[j]).sum::<f64>()
        }));
    }
    states
}

/// Cost of the inputs with the best slacks.
pub(crate) fn cost<const NX: usize, const NS: usize>(problem: &Problem<NX, NS>, inputs: &[f64]) -> f64 {
    let states = rollout(problem, inputs);
    let mut cost = 0.0;
    for (k, (stage, u)) in problem.stages.iter().zip(inputs).enumerate() {
        for i in 0..NX {
            let error = states[k + 1][i] - stage.state_reference[i];
            cost += 0.5 * stage.state_weight[i] * error * error;
        }
        cost += 0.5 * stage.input_weight * (u - stage.input_reference) * (u - stage.input_reference);
        for row in &stage.rows {
            let value = row.input * u + (0..NX).map(|j| row.state[j] * states[k][j]).sum::<f64>();
            let slack = (value - row.upper).max(row.lower - value).max(0.0);
            cost += row.l1_weight * slack + 0.5 * row.l2_weight * slack * slack;
        }
    }
    cost
}

/// A sparse matrix under construction, and a right-hand side.
#[derive(Default)]
struct Triplets {
    entries: Vec<(usize, usize, f64)>,
    right: Vec<f64>,
}

impl Triplets {
    fn row(&mut self, entries: &[(usize, f64)], right: f64) {
        let row = self.right.len();
        self.entries.extend(entries.iter().filter(|e| e.1 != 0.0).map(|&(column, value)| (row, column, value)));
        self.right.push(right);
    }

    fn matrix(&self, rows: usize, columns: usize) -> CscMatrix<f64> {
        let (i, (j, v)) = self.entries.iter().map(|e| (e.0, (e.1, e.2))).unzip::<_, _, Vec<_>, (Vec<_>, Vec<_>)>();
        CscMatrix::new_from_triplets(rows, columns, i, j, v)
    }
}

/// The inputs by Clarabel, over z = (input, next state, slacks) of all stages; none if it did not converge to `tolerance`.
pub(crate) fn clarabel<const NX: usize, const NS: usize>(
    problem: &Problem<NX, NS>,
    tolerance: f64,
) -> Option<Vec<f64>> {
    let width = 1 + NX + NS;
    let size = problem.stages.len() * width;
    let (mut curvature, mut gradient) = (Triplets::default(), vec![0.0; size]);
    let (mut equal, mut below) = (Triplets::default(), Triplets::default());
    for (k, stage) in problem.stages.iter().enumerate() {
        let (u, x, s) = (k * width, k * width + 1, k * width + 1 + NX);
        curvature.entries.push((u, u, stage.input_weight));
        gradient[u] = -stage.input_weight * stage.input_reference;
        // x_k as terms: a constant at stage 0, columns later.
        let terms = |coefficients: &[f64; NX]| -> (Vec<(usize, f64)>, f64) {
            if k == 0 {
                (vec![], coefficients.iter().zip(&problem.initial_state).map(|(c, x)| c * x).sum())
            } else {
                ((0..NX).map(|j| (x - width + j, coefficients[j])).collect(), 0.0)
            }
        };
        for i in 0..NX {
            curvature.entries.push((x + i, x + i, stage.state_weight[i]));
            gradient[x + i] = -stage.state_weight[i] * stage.state_reference[i];
            let (mut row, constant) = terms(&stage.a[i].map(|v| -v));
            row.extend([(u, -stage.b[i]), (x + i, 1.0)]);
            equal.row(&row, stage.c[i] - constant);
        }
        below.row(&[(u, 1.0)], problem.input_max);
        below.row(&[(u, -1.0)], -problem.input_min);
        for (i, row) in stage.rows.iter().enumerate() {
            curvature.entries.push((s + i, s + i, row.l2_weight));
            gradient[s + i] = row.l1_weight;
            below.row(&[(s + i, -1.0)], 0.0);
            for (sign, bound) in [(1.0, row.upper), (-1.0, row.lower)] {
                if bound.is_finite() {
                    let (mut entries, constant) = terms(&row.state.map(|v| sign * v));
                    entries.extend([(u, sign * row.input), (s + i, -1.0)]);
                    below.row(&entries, sign * bound - constant);
                }
            }
        }
    }
    let cones = [ZeroConeT(equal.right.len()), NonnegativeConeT(below.right.len())];
    for (row, column, value) in below.entries {
        equal.entries.push((row + equal.right.len(), column, value));
    }
    equal.right.extend(below.right);
    let settings = DefaultSettings {
        verbose: false,
        tol_gap_abs: tolerance,
        tol_gap_rel: tolerance,
        tol_feas: tolerance,
        ..DefaultSettings::default()
    };
    let (p, a) = (curvature.matrix(size, size), equal.matrix(equal.right.len(), size));
    let mut solver = DefaultSolver::new(&p, &gradient, &a, &equal.right, &cones, settings).expect("well-formed data");
    solver.solve();
    (solver.solution.status == SolverStatus::Solved)
        .then(|| solver.solution.x.chunks_exact(width).map(|stage| stage[0]).collect())
}
