//! An interior point on the Riccati recursion (docs/qp.md, Eqs. 14 to 17): it finds out which constraints hold the optimum back
//! in a number of iterations that hardly depends on how many they are.
//!
//! Predictor and corrector after Mehrotra (1992); the recursion after Rao, Wright and Rawlings (1998).

use crate::barrier::Barrier;
use crate::linalg::{Matrix, Vector, add_product, add_scaled, inner, transpose_product};
use crate::problem::{Problem, Stage};
use crate::responses::Place;
use crate::riccati::{row_value, step, symmetric_step};

/// Iterations at most.
const ITERATION_BUDGET: usize = 40;
/// Mean complementarity at which the tight constraints stand out, relative to that of the start.
const GAP_TOLERANCE: f64 = 1e-10;
/// Complementarity of the start, relative to the cost of a stage there.
const START_GAP: f64 = 4.0;
/// Share of the way to the boundary.
const SHY: f64 = 0.995;
/// Share of the input range that the start keeps from both bounds.
const MARGIN: f64 = 0.1;
/// Step below which nothing more is to be hoped for.
const SHORTEST: f64 = 1e-8;

#[derive(Clone, Debug)]
struct StageState<const NX: usize, const NS: usize> {
    rows: [[Barrier; 2]; NS],
    input_bounds: [Barrier; 2],
    /// Weights of the values of the rows and of the input in the Newton system, and their linear terms.
    weights: [f64; NS],
    input_weight: f64,
    pulls: [f64; NS],
    input_pull: f64,
    state: Vector<NX>,
    input: f64,
    new_state: Vector<NX>,
    new_input: f64,
    /// Of the Newton system, as in the Riccati factorization.
    cost_to_go: Matrix<NX, NX>,
    gain: Vector<NX>,
    closed_loop: Matrix<NX, NX>,
    inverse_curvature: f64,
    feedforward: f64,
}

/// Memory and iterate of the interior point.
#[derive(Clone, Debug)]
pub(crate) struct Interior<const NX: usize, const NS: usize> {
    stages: Vec<StageState<NX, NS>>,
}

impl<const NX: usize, const NS: usize> Interior<NX, NS> {
    pub(crate) fn new(horizon: usize) -> Self {
        let stage = StageState {
            rows: [[Barrier::NONE; 2]; NS],
            input_bounds: [Barrier::NONE; 2],
            weights: [0.0; NS],
            input_weight: 0.0,
            pulls: [0.0; NS],
            input_pull: 0.0,
            state: [0.0; NX],
            input: 0.0,
            new_state: [0.0; NX],
            new_input: 0.0,
            cost_to_go: [[0.0; NX]; NX],
            gain: [0.0; NX],
            closed_loop: [[0.0; NX]; NX],
            inverse_curvature: 0.0,
            feedforward: 0.0,
        };
        Self { stages: vec![stage; horizon] }
    }

    /// Iterates from these inputs; whether it came to its tolerance.
    pub(crate) fn solve(&mut self, problem: &Problem<NX, NS>, inputs: &[f64]) -> bool {
        let range = problem.input_max - problem.input_min;
        if range <= 0.0 {
            return false;
        }
        self.start(problem, inputs);
        let count = self.sum(|barrier| f64::from(barrier.is_there()) + f64::from(barrier.is_soft())).max(1.0);
        let mut first_gap = f64::INFINITY;
        for iteration in 0..ITERATION_BUDGET {
            let gap = self.sum(Barrier::gap) / count;
            if iteration == 0 {
                first_gap = gap;
            }
            if gap <= GAP_TOLERANCE * first_gap {
                return true;
            }
            self.linearize();
            self.factor(problem);
            let affine = self.find_direction(problem, 0.0).min(1.0);
            let shrunk = self.sum(|barrier| barrier.gap_after(affine)) / (count * gap);
            for stage in &mut self.stages {
                stage.rows.as_flattened_mut().iter_mut().chain(&mut stage.input_bounds).for_each(Barrier::keep_cross);
            }
            let target = shrunk * shrunk * shrunk * gap;
            let length = (SHY * self.find_direction(problem, target)).min(1.0);
            if length.is_nan() || length <= SHORTEST {
                return false;
            }
            self.advance(length);
        }
        false
    }

    /// Sets all barriers up at the trajectory of `inputs`, drawn inside the bounds.
    fn start(&mut self, problem: &Problem<NX, NS>, inputs: &[f64]) {
        let margin = MARGIN * (problem.input_max - problem.input_min).min(f64::MAX);
        let mut x = problem.initial_state;
        let (mut cost, mut count) = (0.0, 1.0);
        for ((own, stage), u) in self.stages.iter_mut().zip(&problem.stages).zip(inputs) {
            own.state = x;
            own.input = u.clamp(problem.input_min + margin, problem.input_max - margin);
            x = step(stage, &x, own.input);
            cost += own.cost(stage, &x);
            count += 1.0 + NS as f64;
        }
        let gap = (START_GAP * cost / count).max(f64::MIN_POSITIVE);
        let bounds = (problem.input_min, problem.input_max);
        for (own, stage) in self.stages.iter_mut().zip(&problem.stages) {
            own.set_barriers(stage, bounds, gap);
        }
    }

    /// Sum of a quantity over all barriers, of which those that are not there have none.
    fn sum(&self, quantity: impl Fn(&Barrier) -> f64) -> f64 {
        let mut sum = 0.0;
        for stage in &self.stages {
            for barrier in stage.rows.as_flattened().iter().chain(&stage.input_bounds) {
                sum += quantity(barrier);
            }
        }
        sum
    }

    fn linearize(&mut self) {
        for stage in &mut self.stages {
            for (weight, barriers) in stage.weights.iter_mut().zip(&mut stage.rows) {
                *weight = barriers.iter_mut().filter(|b| b.is_there()).map(Barrier::linearize).sum();
            }
            stage.input_weight = stage.input_bounds.iter_mut().filter(|b| b.is_there()).map(Barrier::linearize).sum();
        }
    }

    fn factor(&mut self, problem: &Problem<NX, NS>) {
        let mut cost_to_go = problem.terminal_weight;
        for (own, stage) in self.stages.iter_mut().zip(&problem.stages).rev() {
            for (i, weight) in stage.state_weight.iter().enumerate() {
                cost_to_go[i][i] += weight;
            }
            own.cost_to_go = cost_to_go;
            let pb = add_product([0.0; NX], &cost_to_go, &stage.b);
            let mut curvature = stage.input_weight + own.input_weight + inner(&stage.b, &pb);
            let mut coupling = transpose_product(&stage.a, &pb);
            for (row, weight) in stage.rows.iter().zip(own.weights) {
                curvature += weight * row.input * row.input;
                coupling = add_scaled(coupling, weight * row.input, &row.state);
            }
            own.inverse_curvature = 1.0 / curvature;
            own.gain = coupling.map(|v| v * own.inverse_curvature);
            own.closed_loop = stage.a;
            for (line, b) in own.closed_loop.iter_mut().zip(&stage.b) {
                *line = add_scaled(*line, -b, &own.gain);
            }
            cost_to_go = own.value(stage);
        }
    }

    /// The direction toward complementarity `target`; returns the longest step along it.
    fn find_direction(&mut self, problem: &Problem<NX, NS>, target: f64) -> f64 {
        for (own, stage) in self.stages.iter_mut().zip(&problem.stages) {
            own.set_pulls(stage, target);
        }
        self.sweep(problem);
        let mut longest = f64::INFINITY;
        for (own, stage) in self.stages.iter_mut().zip(&problem.stages) {
            longest = longest.min(own.aim(stage, target));
        }
        longest
    }

    fn sweep(&mut self, problem: &Problem<NX, NS>) {
        let mut p = problem.terminal_slope();
        for (own, stage) in self.stages.iter_mut().zip(&problem.stages).rev() {
            for ((p, weight), reference) in p.iter_mut().zip(&stage.state_weight).zip(&stage.state_reference) {
                *p -= weight * reference;
            }
            let h = add_product(p, &own.cost_to_go, &stage.c);
            let outer = own.input_pull - stage.input_weight * stage.input_reference;
            let mut slope = inner(&stage.b, &h) + outer;
            p = add_scaled(transpose_product(&own.closed_loop, &h), -outer, &own.gain);
            for (row, pull) in stage.rows.iter().zip(own.pulls) {
                slope += pull * row.input;
                p = add_scaled(p, pull, &add_scaled(row.state, -row.input, &own.gain));
            }
            own.feedforward = -slope * own.inverse_curvature;
        }
        let mut x = problem.initial_state;
        for (own, stage) in self.stages.iter_mut().zip(&problem.stages) {
            own.new_state = x;
            own.new_input = own.feedforward - inner(&own.gain, &x);
            x = step(stage, &x, own.new_input);
        }
    }

    fn advance(&mut self, length: f64) {
        for own in &mut self.stages {
            for barrier in own.rows.as_flattened_mut().iter_mut().chain(&mut own.input_bounds) {
                barrier.advance(length);
            }
            own.input += length * (own.new_input - own.input);
            for (x, new) in own.state.iter_mut().zip(&own.new_state) {
                *x += length * (new - *x);
            }
        }
    }

    /// Sign, multiplier and stiffness λ/t of the side of a constraint that presses more.
    pub(crate) fn pressure(&self, place: Place) -> (f64, f64, f64) {
        let own = &self.stages[place.stage];
        let [upper, lower] = own.rows.get(place.index).unwrap_or(&own.input_bounds);
        let (upper, lower) = (upper.pressure(), lower.pressure());
        if upper.1 > lower.1 { upper } else { lower }
    }
}

impl<const NX: usize, const NS: usize> StageState<NX, NS> {
    /// Cost of this stage, with the slacks that its rows need.
    fn cost(&self, stage: &Stage<NX, NS>, next: &Vector<NX>) -> f64 {
        let error = self.input - stage.input_reference;
        let mut cost = 0.5 * stage.input_weight * error * error;
        for ((x, weight), reference) in next.iter().zip(&stage.state_weight).zip(&stage.state_reference) {
            cost += 0.5 * weight * (x - reference) * (x - reference);
        }
        for row in &stage.rows {
            let value = row_value(row, &self.state, self.input);
            let slack = (value - row.upper).max(row.lower - value).max(0.0);
            cost += slack * (row.l1_weight + 0.5 * row.l2_weight * slack);
        }
        cost
    }

    fn set_barriers(&mut self, stage: &Stage<NX, NS>, (input_min, input_max): (f64, f64), gap: f64) {
        for (barriers, row) in self.rows.iter_mut().zip(&stage.rows) {
            let value = row_value(row, &self.state, self.input);
            let sides = [(1.0, row.upper), (-1.0, -row.lower)];
            *barriers = sides.map(|side| Barrier::soft(side, (row.l1_weight, row.l2_weight), value, gap));
        }
        self.input_bounds = [(1.0, input_max), (-1.0, -input_min)].map(|side| Barrier::hard(side, self.input, gap));
    }

    /// Curvature of the cost from `x_k` on, as a sum of squares.
    fn value(&self, stage: &Stage<NX, NS>) -> Matrix<NX, NX> {
        let input_weight = stage.input_weight + self.input_weight;
        let mut value = symmetric_step(&self.cost_to_go, &self.closed_loop, &self.gain, input_weight);
        for (row, weight) in stage.rows.iter().zip(self.weights) {
            let closed_row = add_scaled(row.state, -row.input, &self.gain);
            for (line, c) in value.iter_mut().zip(&closed_row) {
                *line = add_scaled(*line, weight * c, &closed_row);
            }
        }
        value
    }

    fn set_pulls(&mut self, stage: &Stage<NX, NS>, target: f64) {
        for ((pull, barriers), row) in self.pulls.iter_mut().zip(&self.rows).zip(&stage.rows) {
            let value = row_value(row, &self.state, self.input);
            *pull = barriers.iter().filter(|b| b.is_there()).map(|b| b.pull(value, target)).sum();
        }
        self.input_pull = self.input_bounds.iter().filter(|b| b.is_there()).map(|b| b.pull(self.input, target)).sum();
    }

    fn aim(&mut self, stage: &Stage<NX, NS>, target: f64) -> f64 {
        let mut longest = f64::INFINITY;
        for (barriers, row) in self.rows.iter_mut().zip(&stage.rows) {
            let value = row_value(row, &self.state, self.input);
            let new_value = row_value(row, &self.new_state, self.new_input);
            for barrier in barriers.iter_mut().filter(|barrier| barrier.is_there()) {
                longest = longest.min(barrier.aim_at(value, new_value, target));
            }
        }
        for barrier in self.input_bounds.iter_mut().filter(|barrier| barrier.is_there()) {
            longest = longest.min(barrier.aim_at(self.input, self.new_input, target));
        }
        longest
    }
}
