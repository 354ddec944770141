//! The solver: a dual active-set method on the Riccati factorization (docs/qp.md, the loop).

use crate::active::{Active, ActiveSet, Walk};
use crate::interior::Interior;
use crate::linalg::{Block, LANES, add_scaled_blocks};
use crate::mirror::{Mirror, Sameness};
use crate::problem::{Problem, Row};
use crate::responses::{Place, Responses};
use crate::riccati::{Riccati, TOLERANCE, Trajectory, row_value, step};
use crate::saved::Saved;
use crate::validate::validate;
use crate::verdict::{ActiveRow, Constraint, Side, Start, Status, Verdict};
use crate::watch::Watch;

/// Newton steps of one solve. Sequences of control problems stay below 30; the hardest made-up ones need some hundred.
const ITERATION_BUDGET: u32 = 600;
/// Sum of the sizes of the active sets of all Newton steps after which the interior point is asked for a better one: about the
/// time that it takes.
const WORK_BUDGET: usize = 1000;
/// How much stiffer than the cost a barrier must have become to count as active.
const STIFF: f64 = 3e4;
/// Violation of the active constraints that counts as none if another step leaves it as it is.
const SETTLED: f64 = 1e-10;
/// A solve ends as solved below this residual: rounding can keep ill-scaled problems above `TOLERANCE`.
const ACCEPTED: f64 = 1e-6;
/// Residual of the active constraints below which others may enter.
const SETTLING: f64 = 1e-6;
/// How often a factor that brings no progress is made anew, as it may have lost digits by many changes.
const RENEWALS: u32 = 2;
/// Candidates that gain less than this share of the best one wait for a later round.
const ENTRY_SHARE: f64 = 0.05;
/// Constraints to change beyond which the interior point is asked at once.
const HOPELESS: usize = 24;
/// Steps before which nothing is hopeless that begins without active set.
const FIRST_STEPS: u32 = 8;
/// Number of constraints taken over from the last solve, times the largest relative violation among them, beyond which it is
/// asked at once, too.
const FAR_OFF: f64 = 20.0;
/// Candidates that enter in one round at most.
const ENTRIES: usize = 2;
/// Newton steps after which only the best one enters.
const PATIENCE: u32 = 150;

/// A violated constraint that is not in the active set: the best of its stage.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    index: usize,
    sign: f64,
    excess: f64,
    /// 0 if the stage has none.
    gain: f64,
}

const NO_CANDIDATE: Candidate = Candidate { index: 0, sign: 0.0, excess: 0.0, gain: 0.0 };

/// The best there is outside the active set.
#[derive(Clone, Copy, Debug)]
struct Price {
    /// Largest relative violation.
    violation: f64,
    /// Largest gain of a candidate.
    gain: f64,
    /// Largest violation of a soft row, active or not; infinity if nobody looked.
    slack_max: f64,
}

const NOT_PRICED: Price = Price { violation: 0.0, gain: 0.0, slack_max: f64::INFINITY };

/// Solver of problems with NX states, NS soft rows per stage and a fixed horizon. A clone goes on exactly as the original.
#[derive(Clone, Debug)]
pub struct Solver<const NX: usize, const NS: usize> {
    horizon: usize,
    mirror: Mirror<NX, NS>,
    riccati: Riccati<NX>,
    responses: Responses<NX>,
    active: ActiveSet,
    /// ρ / √S of each stage, without multipliers and with those at hand.
    free: Vec<Block>,
    driven: Vec<Block>,
    trajectory: Trajectory<NX, NS>,
    candidates: Vec<Candidate>,
    scratch: Vec<Block>,
    interior: Interior<NX, NS>,
    iterations: u32,
    /// What is left of the work before the interior point is asked, and whether it was.
    work: usize,
    asked: bool,
}

impl<const NX: usize, const NS: usize> Solver<NX, NS> {
    /// A solver for `horizon` stages. All its memory is allocated here.
    pub fn new(horizon: usize) -> Self {
        let capacity = horizon * (NS + 1);
        Self {
            horizon,
            mirror: Mirror::new(horizon),
            riccati: Riccati::new(horizon),
            responses: Responses::new(horizon, NS + 1),
            active: ActiveSet::new(capacity),
            free: vec![[0.0; LANES]; horizon.div_ceil(LANES)],
            driven: vec![[0.0; LANES]; horizon.div_ceil(LANES)],
            trajectory: Trajectory::new(horizon),
            candidates: vec![NO_CANDIDATE; horizon],
            scratch: vec![[0.0; LANES]; capacity.div_ceil(LANES)],
            interior: Interior::new(horizon),
            iterations: 0,
            work: 0,
            asked: false,
        }
    }

    /// What the next solves depend on: all else follows from it.
    pub(crate) fn to_saved(&self) -> Saved<NX, NS> {
        let inputs = self.trajectory.inputs.clone();
        Saved { inputs, problem: self.mirror.problem(), active: self.active.to_saved() }
    }

    /// The solver that was saved; none if the parts do not fit each other.
    pub(crate) fn restored(saved: Saved<NX, NS>) -> Option<Self> {
        let horizon = saved.inputs.len();
        let mut solver = Self::new(horizon);
        if let Some(problem) = &saved.problem {
            validate(problem, horizon, Sameness::NONE).ok()?;
            solver.prepare(problem, Sameness::NONE);
        }
        solver.trajectory.inputs = saved.inputs;
        let Self { active, responses, .. } = &mut solver;
        let id = |place: Place| (place.stage < horizon && place.index <= NS).then(|| responses.id(place));
        active.restore(saved.active, id).then_some(solver)
    }

    /// Forgets all earlier solves.
    pub fn reset(&mut self) {
        self.mirror.forget();
        self.responses.forget();
        self.active.clear();
        self.trajectory.inputs.fill(0.0);
        self.trajectory.states.fill([0.0; NX]);
    }

    /// `u_0` to u_{N-1} of the last solve: finite and within the input bounds, whatever its status.
    pub fn inputs(&self) -> &[f64] {
        &self.trajectory.inputs
    }

    /// `x_1` to `x_N` under [`Self::inputs`].
    pub fn states(&self) -> &[[f64; NX]] {
        &self.trajectory.states[1..]
    }

    /// The active constraints of the last solve, in the order in which they entered.
    pub fn active_rows(&self) -> impl Iterator<Item = ActiveRow> {
        self.active.items.iter().map(|item| ActiveRow {
            stage: item.place.stage,
            constraint: if item.place.index == NS { Constraint::Input } else { Constraint::Row(item.place.index) },
            side: if item.sign > 0.0 { Side::Upper } else { Side::Lower },
            multiplier: item.multiplier(),
            slack: item.slack(),
        })
    }

    /// Slope of `u_0` in `x_0` while the active set stays as it is after the last solve (docs/qp.md, Eq. 13); zeros if there
    /// was none.
    pub fn feedback(&mut self) -> [f64; NX] {
        let Some((mut feedback, root)) = self.riccati.first_gain().filter(|_| self.mirror.is_valid()) else {
            return [0.0; NX];
        };
        self.active.factor(&mut self.responses);
        for (weight, item) in self.scratch.as_flattened_mut().iter_mut().zip(&self.active.items) {
            *weight = item.sign * self.responses.response(item.place)[0][0];
        }
        self.active.solve(&mut self.scratch);
        for (weight, item) in self.scratch.as_flattened().iter().zip(&self.active.items) {
            for (f, slope) in feedback.iter_mut().zip(self.responses.initial_slope(item.place)) {
                *f -= root * weight * item.sign * slope;
            }
        }
        if feedback.iter().all(|f| f.is_finite()) { feedback } else { [0.0; NX] }
    }

    /// Solves `problem`. Invalid input is detected before any arithmetic and leaves the solver as after [`Self::reset`].
    pub fn solve(&mut self, problem: &Problem<NX, NS>, start: Start) -> Verdict {
        self.solve_until(problem, start, || false)
    }

    /// The same, but ends as [`Status::OutOfTime`] once `out_of_time` says so, which is asked before every step of the active set
    /// and every iteration of the interior point; one sweep over the stages comes first. With a clock behind it the answer
    /// depends on the machine; with a counter it is the same everywhere.
    pub fn solve_until(
        &mut self,
        problem: &Problem<NX, NS>,
        start: Start,
        mut out_of_time: impl FnMut() -> bool,
    ) -> Verdict {
        self.iterations = 0;
        self.work = WORK_BUDGET;
        self.asked = false;
        let same = self.mirror.compare(problem);
        if let Err(error) = validate(problem, self.horizon, same) {
            self.reset();
            return self.verdict(Status::InvalidInput(error), f64::INFINITY);
        }
        self.prepare(problem, same);
        self.carry(problem, start);
        let mut watch = Watch::new(&mut out_of_time);
        let rest = self.maximize_dual(problem, &mut watch);
        self.finish(problem, &rest, watch.was_over())
    }

    /// Brings everything that does not depend on the active set up to date with `problem`.
    fn prepare(&mut self, problem: &Problem<NX, NS>, same: Sameness) {
        self.mirror.update(problem, same);
        if same.is_whole() {
            self.responses.remember_couplings();
        } else {
            self.responses.forget();
            self.active.forget_factor();
        }
        if !same.matrices {
            self.riccati.factor(problem);
        }
        self.riccati.sweep_back(&self.mirror.stages, problem.terminal_slope(), &mut self.free);
        self.trajectory.states[0] = problem.initial_state;
    }

    /// Takes over the active set of the last solve, as far as it has a meaning in this one. Its factor stays where nothing
    /// that it follows from has changed.
    fn carry(&mut self, problem: &Problem<NX, NS>, start: Start) {
        match start {
            Start::Cold => self.active.clear(),
            Start::Shifted(0) => {}
            Start::Shifted(stages) => self.active.shift(stages, NS + 1),
        }
        for i in (0..self.active.items.len()).rev() {
            self.renew(problem, i);
        }
        self.active.requeue_bent();
    }

    /// Brings active constraint `i` up to date with `problem`; removes it if it has no bound or no input can move it.
    fn renew(&mut self, problem: &Problem<NX, NS>, i: usize) {
        let item = self.active.items[i];
        let fresh = self.item(problem, item.place, item.sign);
        if fresh.curvature == 0.0 || !fresh.bound.is_finite() {
            return self.active.remove(i);
        }
        let fresh = fresh.with_multiplier(item.multiplier());
        let bent = item.diagonal() != fresh.diagonal();
        self.active.items[i] = Active { bent, ..fresh };
    }

    /// Adds a constraint with a multiplier, if it has a bound and inputs can move it.
    fn resume(&mut self, problem: &Problem<NX, NS>, place: Place, sign: f64, multiplier: f64) {
        let item = self.item(problem, place, sign);
        if item.curvature > 0.0 && item.bound.is_finite() {
            self.active.push(item.with_multiplier(multiplier));
        }
    }

    /// A constraint with multiplier 0.
    fn item(&mut self, problem: &Problem<NX, NS>, place: Place, sign: f64) -> Active {
        let curvature = self.responses.learn(&self.riccati, problem, place);
        let row = problem.stages[place.stage].rows.get(place.index);
        let (lower, upper) = row.map_or((problem.input_min, problem.input_max), |row| (row.lower, row.upper));
        Active {
            place,
            id: self.responses.id(place),
            sign,
            bound: if sign > 0.0 { upper } else { -lower },
            l1_weight: row.map_or(f64::INFINITY, |row| row.l1_weight),
            compliance: row.map_or(0.0, |row| 1.0 / row.l2_weight),
            curvature,
            // No input can help a row without response: only its slack can.
            soft: curvature == 0.0,
            amount: 0.0,
            slope: 0.0,
            fall: 0.0,
            bent: false,
        }
    }

    /// Raises the dual until no constraint is violated; returns what is left, active constraints included.
    fn maximize_dual(&mut self, problem: &Problem<NX, NS>, watch: &mut Watch) -> Price {
        let mut before = f64::INFINITY;
        let mut renewals = 0;
        loop {
            self.minimize_lagrangian(problem);
            let held = self.measure_slopes(problem);
            if !held.is_finite() {
                return Price { violation: f64::INFINITY, ..NOT_PRICED };
            }
            let stalled = held > 0.5 * before;
            before = held;
            // While Newton steps still improve the set at hand, the violations of the others say little.
            let price = if stalled || held <= SETTLING { self.price(problem, held) } else { NOT_PRICED };
            let optimal =
                price.gain == 0.0 && (held <= TOLERANCE || (stalled && (held <= SETTLED || renewals == RENEWALS)));
            if !optimal && !self.asked && (self.work == 0 || self.is_hopeless(held, &price)) {
                self.asked = true;
                if self.propose(problem, watch) {
                    before = f64::INFINITY;
                    continue;
                }
            }
            if optimal || self.iterations >= ITERATION_BUDGET || watch.is_over() {
                let price = if price.slack_max.is_finite() { price } else { self.price(problem, held) };
                return Price { violation: held.max(price.violation), ..price };
            }
            if price.gain > 0.0 {
                self.enter_candidates(problem, price.gain);
                before = f64::INFINITY;
            } else if stalled {
                self.active.forget_factor();
                renewals += 1;
                before = f64::INFINITY;
            }
            self.ascend(watch);
        }
    }

    /// Whether so much is wrong that the active set would have to change nearly everywhere.
    fn is_hopeless(&self, held: f64, price: &Price) -> bool {
        if price.gain > 0.0 {
            // The first that enter may settle most of the others.
            let violated = self.candidates.iter().filter(|candidate| candidate.gain > 0.0).count();
            return self.iterations >= FIRST_STEPS && violated > HOPELESS;
        }
        self.iterations == 0 && held * self.active.items.len() as f64 > FAR_OFF
    }

    /// Replaces the active set by the one that the interior point finds; false if it finds none.
    fn propose(&mut self, problem: &Problem<NX, NS>, watch: &mut Watch) -> bool {
        if !self.interior.solve((problem, &self.mirror.stages), &self.trajectory.inputs, watch) {
            return false;
        }
        self.active.clear();
        for id in 0..self.horizon * (NS + 1) {
            let place = self.responses.place(id);
            let (sign, multiplier, stiffness) = self.interior.pressure(place);
            if stiffness > 0.0 && stiffness * self.responses.learn(&self.riccati, problem, place) > STIFF {
                self.resume(problem, place, sign, multiplier);
            }
        }
        true
    }

    /// Newton steps on the dual until one ends at the maximum over the active set.
    fn ascend(&mut self, watch: &mut Watch) {
        while self.iterations < ITERATION_BUDGET && (self.asked || self.work > 0) {
            self.iterations += 1;
            self.work = self.work.saturating_sub(self.active.items.len());
            self.active.factor(&mut self.responses);
            if self.active.walk() == Walk::Full || watch.is_over() {
                return;
            }
        }
    }

    fn minimize_lagrangian(&mut self, problem: &Problem<NX, NS>) {
        self.driven.copy_from_slice(&self.free);
        for item in &self.active.items {
            let response = self.responses.response(item.place);
            add_scaled_blocks(&mut self.driven, item.sign * item.multiplier(), response);
        }
        let bounds = (problem.input_min, problem.input_max);
        self.riccati.sweep_forward(&self.mirror.stages, bounds, &self.driven, &mut self.trajectory);
    }

    /// Slopes of the dual in the active multipliers; returns the largest relative one, or infinity if a number is not finite.
    fn measure_slopes(&mut self, problem: &Problem<NX, NS>) -> f64 {
        let mut worst: f64 = 0.0;
        for i in 0..self.active.items.len() {
            let item = &self.active.items[i];
            let Place { stage, index } = item.place;
            let row = problem.stages[stage].rows.get(index);
            let value = self.value(item.place);
            let slope = item.sign * value - item.bound - item.slack();
            let scale = self.scale(row) + item.bound.abs() + item.slack();
            self.active.items[i].slope = slope;
            if slope != 0.0 {
                worst = worst.max(slope.abs() / scale);
            }
            if !(slope / scale).is_finite() && slope != 0.0 {
                return f64::INFINITY;
            }
        }
        if self.trajectory.finite { worst } else { f64::INFINITY }
    }

    /// Value of a constraint on the present trajectory.
    fn value(&self, place: Place) -> f64 {
        let rows = &self.trajectory.values[place.stage];
        rows.get(place.index).copied().unwrap_or(self.trajectory.inputs[place.stage])
    }

    /// Size of the terms a constraint is summed from.
    fn scale(&self, row: Option<&Row<NX>>) -> f64 {
        let Some(row) = row else { return self.trajectory.input_scale };
        let terms = row.state.iter().zip(&self.trajectory.state_scale).map(|(c, x)| c.abs() * x);
        terms.sum::<f64>() + row.input.abs() * self.trajectory.input_scale
    }

    /// Finds the best candidate of each stage, among violations that stand out from the rounding in `held`.
    fn price(&mut self, problem: &Problem<NX, NS>, held: f64) -> Price {
        let threshold = TOLERANCE.max(10.0 * held);
        let mut price = Price { slack_max: self.trajectory.slack_max, ..NOT_PRICED };
        if self.trajectory.all_kept {
            return price;
        }
        for stage in 0..self.horizon {
            self.candidates[stage].gain = 0.0;
            if !self.trajectory.kept[stage] {
                self.price_stage(problem, stage, threshold, &mut price);
            }
        }
        price
    }

    fn price_stage(&mut self, problem: &Problem<NX, NS>, stage: usize, threshold: f64, price: &mut Price) {
        let mut best = NO_CANDIDATE;
        for (index, row) in problem.stages[stage].rows.iter().map(Some).chain([None]).enumerate() {
            let place = Place { stage, index };
            let value = self.value(place);
            let (lower, upper) = row.map_or((problem.input_min, problem.input_max), |row| (row.lower, row.upper));
            let (sign, bound) = if value > upper { (1.0, upper) } else { (-1.0, -lower) };
            let excess = sign * value - bound;
            if excess <= 0.0 || self.active.contains(self.responses.id(place)) {
                continue;
            }
            let violation = excess / (self.scale(row) + bound.abs());
            // Not a number where the terms overflow: no answer then, rather than a wrong one.
            price.violation = price.violation.max(if violation.is_nan() { f64::INFINITY } else { violation });
            if violation > threshold {
                let gain = self.gain(problem, place, excess);
                if gain > best.gain {
                    best = Candidate { index, sign, excess, gain };
                }
            }
        }
        self.candidates[stage] = best;
        price.gain = price.gain.max(best.gain);
    }

    /// Twice what the dual would gain by this constraint alone.
    fn gain(&mut self, problem: &Problem<NX, NS>, place: Place, excess: f64) -> f64 {
        // Without response the gain is without bound.
        (excess * excess / self.responses.learn(&self.riccati, problem, place)).min(f64::MAX)
    }

    /// Enters the best candidate, and with it good ones that are peaks along the horizon.
    fn enter_candidates(&mut self, problem: &Problem<NX, NS>, best: f64) {
        // Constraints that enter together may push each other out again; the best one alone stays.
        let limit = if self.iterations < PATIENCE { ENTRIES } else { 0 };
        let mut entered = 0;
        for stage in 0..self.horizon {
            let candidate = self.candidates[stage];
            let above = |k: Option<usize>| {
                let neighbor = k.and_then(|k| self.candidates.get(k)).unwrap_or(&NO_CANDIDATE);
                neighbor.index == candidate.index && neighbor.gain > candidate.gain
            };
            let peak = !above(stage.checked_sub(1)) && !above(Some(stage + 1));
            let good = peak && entered < limit && candidate.gain > ENTRY_SHARE * best;
            if good || candidate.gain == best {
                let item = self.item(problem, Place { stage, index: candidate.index }, candidate.sign);
                // With multiplier 0 the slope of the dual is the violation.
                self.active.push(Active { slope: candidate.excess, ..item });
                entered += 1;
            }
        }
    }

    /// Moves the inputs into their bounds and judges what has been reached.
    fn finish(&mut self, problem: &Problem<NX, NS>, rest: &Price, out_of_time: bool) -> Verdict {
        let residual = rest.violation;
        if !residual.is_finite() {
            self.active.clear();
        }
        let mut slack_max = rest.slack_max;
        if self.project(problem) || slack_max.is_infinite() {
            self.roll_out(problem);
            slack_max = self.slack_max(problem);
        }
        let status = match (residual <= ACCEPTED, out_of_time) {
            (true, _) => Status::Solved,
            (false, true) => Status::OutOfTime,
            (false, false) => Status::IterationLimit,
        };
        Verdict { slack_max, ..self.verdict(status, residual) }
    }

    /// Moves the inputs to their active bounds, which they meet but for rounding, and within the others; true if one moved.
    fn project(&mut self, problem: &Problem<NX, NS>) -> bool {
        let mut moved = false;
        for item in self.active.items.iter().filter(|item| item.place.index == NS) {
            let u = &mut self.trajectory.inputs[item.place.stage];
            moved |= *u != item.sign * item.bound;
            *u = item.sign * item.bound;
        }
        for (u, stage) in self.trajectory.inputs.iter_mut().zip(&problem.stages) {
            let finite = if u.is_finite() { *u } else { stage.input_reference };
            let inside = finite.clamp(problem.input_min, problem.input_max);
            moved |= inside.to_bits() != u.to_bits();
            *u = inside;
        }
        moved
    }

    fn roll_out(&mut self, problem: &Problem<NX, NS>) {
        let mut x = problem.initial_state;
        for (k, stage) in problem.stages.iter().enumerate() {
            x = step(stage, &x, self.trajectory.inputs[k]);
            self.trajectory.states[k + 1] = x;
        }
    }

    fn verdict(&self, status: Status, kkt_residual: f64) -> Verdict {
        Verdict {
            status,
            iterations: self.iterations,
            active: self.active.items.len() as u32,
            slack_max: 0.0,
            kkt_residual,
        }
    }

    fn slack_max(&self, problem: &Problem<NX, NS>) -> f64 {
        let mut worst: f64 = 0.0;
        for (k, stage) in problem.stages.iter().enumerate() {
            for row in &stage.rows {
                let value = row_value(row, &self.trajectory.states[k], self.trajectory.inputs[k]);
                worst = worst.max(value - row.upper).max(row.lower - value);
            }
        }
        worst
    }
}
