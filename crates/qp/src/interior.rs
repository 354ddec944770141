//! An interior point on the Riccati recursion (docs/qp.md, Eqs. 14 to 17): it finds out which constraints hold the optimum back
//! in a number of iterations that hardly depends on how many they are.
//!
//! Predictor and corrector after Mehrotra (1992); the recursion after Rao, Wright and Rawlings (1998).

use crate::barrier::Barriers;
use crate::linalg::{Matrix, Vector, add_product, add_scaled, inner, larger, transpose_product};
use crate::mirror::StageMirror;
use crate::problem::{Problem, Stage};
use crate::responses::Place;
use crate::riccati::symmetric_step;
use crate::terminal::with_diagonal;
use crate::watch::Watch;

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
    /// Of the upper and of the lower bounds.
    rows: [Barriers<NS, true>; 2],
    /// Upper, lower.
    input_bounds: Barriers<2, false>,
    /// Weights of the values of the rows and of the input in the Newton system, and their linear terms.
    weights: [f64; NS],
    input_weight: f64,
    pulls: [f64; NS],
    input_pull: f64,
    state: Vector<NX>,
    input: f64,
    values: [f64; NS],
    new_state: Vector<NX>,
    new_input: f64,
    new_values: [f64; NS],
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
            rows: [Barriers::none(); 2],
            input_bounds: Barriers::none(),
            weights: [0.0; NS],
            input_weight: 0.0,
            pulls: [0.0; NS],
            input_pull: 0.0,
            state: [0.0; NX],
            input: 0.0,
            values: [0.0; NS],
            new_state: [0.0; NX],
            new_input: 0.0,
            new_values: [0.0; NS],
            cost_to_go: [[0.0; NX]; NX],
            gain: [0.0; NX],
            closed_loop: [[0.0; NX]; NX],
            inverse_curvature: 0.0,
            feedforward: 0.0,
        };
        Self { stages: vec![stage; horizon] }
    }

    /// Iterates from these inputs; whether it came to its tolerance.
    pub(crate) fn solve(
        &mut self,
        (problem, mirror): (&Problem<NX, NS>, &[StageMirror<NX, NS>]),
        inputs: &[f64],
        watch: &mut Watch,
    ) -> bool {
        let range = problem.input_max - problem.input_min;
        if range <= 0.0 {
            return false;
        }
        self.start((problem, mirror), inputs);
        let count = self.stages.iter().map(StageState::count).sum::<f64>().max(1.0);
        let mut first_gap = f64::INFINITY;
        for iteration in 0..ITERATION_BUDGET {
            let gap = self.gap_after(0.0) / count;
            if iteration == 0 {
                first_gap = gap;
            }
            if gap <= GAP_TOLERANCE * first_gap {
                return true;
            }
            if watch.is_over() {
                return false;
            }
            self.stages.iter_mut().for_each(StageState::linearize);
            self.factor(problem);
            let affine = self.find_direction((problem, mirror), 0.0).min(1.0);
            let shrunk = self.gap_after(affine) / (count * gap);
            self.stages.iter_mut().for_each(StageState::keep_cross);
            let target = shrunk * shrunk * shrunk * gap;
            let length = (SHY * self.find_direction((problem, mirror), target)).min(1.0);
            if length.is_nan() || length <= SHORTEST {
                return false;
            }
            self.stages.iter_mut().for_each(|stage| stage.advance(length));
        }
        false
    }

    /// Sets all barriers up at the trajectory of `inputs`, drawn inside the bounds.
    fn start(&mut self, (problem, mirror): (&Problem<NX, NS>, &[StageMirror<NX, NS>]), inputs: &[f64]) {
        let margin = MARGIN * (problem.input_max - problem.input_min).min(f64::MAX);
        let mut x = problem.initial_state;
        let (mut cost, mut count) = (0.0, 1.0);
        for (((own, stage), mirror), u) in self.stages.iter_mut().zip(&problem.stages).zip(mirror).zip(inputs) {
            own.state = x;
            own.input = u.clamp(problem.input_min + margin, problem.input_max - margin);
            own.values = mirror.values(&x, own.input);
            x = mirror.step(&x, own.input);
            cost += own.cost(stage, &x);
            count += 1.0 + NS as f64;
        }
        let gap = (START_GAP * cost / count).max(f64::MIN_POSITIVE);
        let bounds = (problem.input_min, problem.input_max);
        for (own, stage) in self.stages.iter_mut().zip(&problem.stages) {
            own.set_barriers(stage, bounds, gap);
        }
    }

    /// Sum of all products that are to vanish, after a step along the direction.
    fn gap_after(&self, step: f64) -> f64 {
        self.stages.iter().map(|stage| stage.gap_after(step)).sum()
    }

    fn factor(&mut self, problem: &Problem<NX, NS>) {
        let mut next = problem.terminal_weight;
        for (own, stage) in self.stages.iter_mut().zip(&problem.stages).rev() {
            own.cost_to_go = with_diagonal(next, &stage.state_weight);
            let pb = add_product([0.0; NX], &own.cost_to_go, &stage.b);
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
            next = own.value(stage);
        }
    }

    /// The direction toward complementarity `target`; returns the longest step along it.
    fn find_direction(&mut self, (problem, mirror): (&Problem<NX, NS>, &[StageMirror<NX, NS>]), target: f64) -> f64 {
        self.sweep_back(problem, mirror, target);
        let mut x = problem.initial_state;
        let (mut limit, mut input_limit) = ([0.0; NS], [0.0; 2]);
        for (own, mirror) in self.stages.iter_mut().zip(mirror) {
            own.new_state = x;
            own.new_input = own.feedforward - inner(&own.gain, &x);
            own.new_values = mirror.values(&x, own.new_input);
            (limit, input_limit) = own.aim(limit, input_limit);
            x = mirror.step(&x, own.new_input);
        }
        1.0 / limit.into_iter().chain(input_limit).fold(0.0, larger)
    }

    fn sweep_back(&mut self, problem: &Problem<NX, NS>, mirror: &[StageMirror<NX, NS>], target: f64) {
        let mut p = problem.terminal_slope();
        for ((own, stage), mirror) in self.stages.iter_mut().zip(&problem.stages).zip(mirror).rev() {
            own.set_pulls(target);
            let mut h = add_scaled(p, -1.0, &mirror.state_pull);
            for (column, c) in own.cost_to_go.iter().zip(&mirror.c) {
                h = add_scaled(h, *c, column);
            }
            let mut outer = own.input_pull - mirror.input_pull;
            p = [0.0; NX];
            for (row, pull) in stage.rows.iter().zip(own.pulls) {
                outer += pull * row.input;
                p = add_scaled(p, pull, &row.state);
            }
            own.feedforward = -(inner(&stage.b, &h) + outer) * own.inverse_curvature;
            p = add_scaled(p, -outer, &own.gain);
            for (line, h) in own.closed_loop.iter().zip(&h) {
                p = add_scaled(p, *h, line);
            }
        }
    }

    /// Sign, multiplier and stiffness λ/t of the side of a constraint that presses more.
    pub(crate) fn pressure(&self, place: Place) -> (f64, f64, f64) {
        let own = &self.stages[place.stage];
        let [upper, lower] = if place.index < NS {
            own.rows.each_ref().map(|side| side.pressure(place.index))
        } else {
            [0, 1].map(|side| own.input_bounds.pressure(side))
        };
        if upper.1 > lower.1 { upper } else { lower }
    }
}

impl<const NX: usize, const NS: usize> StageState<NX, NS> {
    fn count(&self) -> f64 {
        self.rows[0].count() + self.rows[1].count() + self.input_bounds.count()
    }

    fn gap_after(&self, step: f64) -> f64 {
        self.rows[0].gap_after(step) + self.rows[1].gap_after(step) + self.input_bounds.gap_after(step)
    }

    /// Cost of this stage, with the slacks that its rows need.
    fn cost(&self, stage: &Stage<NX, NS>, next: &Vector<NX>) -> f64 {
        let error = self.input - stage.input_reference;
        let mut cost = 0.5 * stage.input_weight * error * error;
        for ((x, weight), reference) in next.iter().zip(&stage.state_weight).zip(&stage.state_reference) {
            cost += 0.5 * weight * (x - reference) * (x - reference);
        }
        for (row, value) in stage.rows.iter().zip(self.values) {
            let slack = (value - row.upper).max(row.lower - value).max(0.0);
            cost += slack * (row.l1_weight + 0.5 * row.l2_weight * slack);
        }
        cost
    }

    fn set_barriers(&mut self, stage: &Stage<NX, NS>, (input_min, input_max): (f64, f64), gap: f64) {
        self.rows = [Barriers::none(); 2];
        for (i, row) in stage.rows.iter().enumerate() {
            let (weights, at) = ((row.l1_weight, row.l2_weight), (self.values[i], gap));
            self.rows[0].set(i, (1.0, row.upper), weights, at);
            self.rows[1].set(i, (-1.0, -row.lower), weights, at);
        }
        self.input_bounds = Barriers::none();
        self.input_bounds.set(0, (1.0, input_max), (0.0, 0.0), (self.input, gap));
        self.input_bounds.set(1, (-1.0, -input_min), (0.0, 0.0), (self.input, gap));
    }

    fn linearize(&mut self) {
        let [upper, lower] = self.rows.each_mut().map(|side| side.linearize(&self.values));
        for i in 0..NS {
            self.weights[i] = upper[i] + lower[i];
        }
        self.input_weight = self.input_bounds.linearize(&[self.input; 2]).iter().sum();
    }

    fn keep_cross(&mut self) {
        self.rows.iter_mut().for_each(Barriers::keep_cross);
        self.input_bounds.keep_cross();
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

    fn set_pulls(&mut self, target: f64) {
        let [upper, lower] = self.rows.each_mut().map(|side| side.pull(&self.values, target));
        for i in 0..NS {
            self.pulls[i] = upper[i] + lower[i];
        }
        self.input_pull = self.input_bounds.pull(&[self.input; 2], target).iter().sum();
    }

    /// Directions of all barriers toward the new values; returns the limits of the step, as [`Barriers::aim_at`].
    fn aim(&mut self, limit: [f64; NS], input_limit: [f64; 2]) -> ([f64; NS], [f64; 2]) {
        let changes = add_scaled(self.new_values, -1.0, &self.values);
        let [upper, lower] = &mut self.rows;
        let limit = lower.aim_at(&changes, upper.aim_at(&changes, limit));
        (limit, self.input_bounds.aim_at(&[self.new_input - self.input; 2], input_limit))
    }

    fn advance(&mut self, length: f64) {
        self.rows.iter_mut().for_each(|side| side.advance(length));
        self.input_bounds.advance(length);
        self.input += length * (self.new_input - self.input);
        for (x, new) in self.state.iter_mut().zip(&self.new_state) {
            *x += length * (new - *x);
        }
        for (value, new) in self.values.iter_mut().zip(&self.new_values) {
            *value += length * (new - *value);
        }
    }
}
