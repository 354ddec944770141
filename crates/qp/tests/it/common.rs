//! What the tests share: random problems, and a rollout and a cost that know nothing of the solver.
// Indices as in the equations.
#![allow(clippy::needless_range_loop)]

use lanecraft_qp::{Problem, Row, Solver, Verdict};

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

/// Everything that an answer consists of.
pub(crate) fn bits<const NX: usize, const NS: usize>(solver: &mut Solver<NX, NS>, verdict: &Verdict) -> Vec<u64> {
    let feedback = solver.feedback();
    let states = solver.states().iter().flatten();
    let active = solver.active_rows().flat_map(|a| [a.stage as f64, a.multiplier, a.slack]).collect::<Vec<_>>();
    let numbers = solver.inputs().iter().chain(states).chain(&active).chain(&feedback).map(|v| v.to_bits());
    let judged = [u64::from(verdict.iterations), verdict.kkt_residual.to_bits(), verdict.slack_max.to_bits()];
    numbers.chain(judged).collect()
}
