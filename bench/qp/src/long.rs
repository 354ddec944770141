//! Random problems by the million, many of them broken or far out of range: no panic, no number that is not finite, inputs
//! within their bounds, and a label on every answer that is not the optimum.

use std::fmt;

use lanecraft_net::random::Stream;
use lanecraft_qp::{Problem, Row, Solver, Start, Status};

const NX: usize = 3;
const NS: usize = 2;
const HORIZONS: [usize; 4] = [1, 5, 12, 30];
/// Share of the problems of which one number is replaced by one that is not finite.
const POISONED: f64 = 0.2;
/// Residual, relative to the terms, up to which an answer may be called solved.
const SOLVED_RESIDUAL: f64 = 1e-6;

/// What came of a long run.
#[derive(Clone, Copy, Debug, Default)]
pub struct Report {
    /// Problems.
    pub count: usize,
    /// Answers called solved.
    pub solved: usize,
    /// Answers called the last iterate.
    pub limited: usize,
    /// Problems refused.
    pub refused: usize,
    /// Answers that break a promise.
    pub failures: usize,
}

impl fmt::Display for Report {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { count, solved, limited, refused, failures } = self;
        write!(out, "{count} problems: {solved} solved, {limited} at the limit, {refused} refused, {failures} wrong")
    }
}

/// Solves `count` random problems and checks every answer.
pub fn run(count: usize) -> Report {
    let mut solvers = HORIZONS.map(Solver::new);
    let mut report = Report { count, ..Report::default() };
    for index in 0..count {
        let mut stream = Stream::keyed(1, "bench.long", index as u64, 0);
        let which = stream.below(HORIZONS.len());
        let mut problem = random_problem(&mut stream, HORIZONS[which]);
        let poisoned = stream.bernoulli(POISONED) && poison(&mut problem, &mut stream);
        let start = if stream.bernoulli(0.5) { Start::Cold } else { Start::Shifted(stream.below(3)) };
        let solver = &mut solvers[which];
        let verdict = solver.solve(&problem, start);
        let feedback = solver.feedback();
        let numbers = solver.states().as_flattened().iter().chain(&feedback).chain([&verdict.slack_max]);
        let mut sound = numbers.chain(solver.inputs()).all(|v| v.is_finite());
        match verdict.status {
            Status::Solved => report.solved += 1,
            Status::IterationLimit | Status::OutOfTime => report.limited += 1,
            Status::InvalidInput(_) => report.refused += 1,
        }
        if matches!(verdict.status, Status::InvalidInput(_)) {
            sound &= poisoned && verdict.kkt_residual == f64::INFINITY;
        } else {
            sound &= !poisoned && within_bounds(&problem, solver.inputs());
            sound &= (verdict.status == Status::Solved) == (verdict.kkt_residual <= SOLVED_RESIDUAL);
        }
        report.failures += usize::from(!sound);
    }
    report
}

fn within_bounds(problem: &Problem<NX, NS>, inputs: &[f64]) -> bool {
    inputs.iter().all(|u| (problem.input_min..=problem.input_max).contains(u))
}

/// Log-uniform over sixteen decades.
fn weight(stream: &mut Stream) -> f64 {
    libm::exp10(stream.range(-8.0, 8.0))
}

fn random_problem(stream: &mut Stream, horizon: usize) -> Problem<NX, NS> {
    let mut problem = Problem::new(horizon);
    let spread = libm::exp10(stream.range(-1.0, 4.0));
    problem.initial_state = std::array::from_fn(|_| spread * stream.range(-1.0, 1.0));
    (problem.input_min, problem.input_max) = (-stream.range(0.0, 2.0), stream.range(0.0, 2.0));
    let state_weight = std::array::from_fn(|_| if stream.bernoulli(0.2) { 0.0 } else { weight(stream) });
    let (input_weight, l1_weight, l2_weight) = (weight(stream), weight(stream), weight(stream));
    for stage in &mut problem.stages {
        for i in 0..NX {
            stage.a[i] = std::array::from_fn(|j| stream.range(-0.15, 0.15) + if i == j { 0.85 } else { 0.0 });
            stage.b[i] = stream.range(-1.0, 1.0);
            stage.c[i] = stream.range(-0.1, 0.1);
            stage.state_reference[i] = stream.range(-1.0, 1.0);
        }
        stage.state_weight = state_weight;
        (stage.input_weight, stage.input_reference) = (input_weight, stream.range(-1.0, 1.0));
        for row in &mut stage.rows {
            let center = stream.range(-0.5, 0.5);
            *row = Row {
                state: std::array::from_fn(|_| stream.range(-1.0, 1.0)),
                input: stream.range(-1.0, 1.0),
                lower: if stream.bernoulli(0.2) { f64::NEG_INFINITY } else { center - stream.range(0.0, 1.0) },
                upper: if stream.bernoulli(0.2) { f64::INFINITY } else { center + stream.range(0.0, 1.0) },
                l1_weight,
                l2_weight,
            };
        }
    }
    problem
}

/// Replaces one number, of any field, by NaN or an infinity; false if that infinity is a bound that means "none".
fn poison(problem: &mut Problem<NX, NS>, stream: &mut Stream) -> bool {
    let value = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][stream.below(3)];
    let stage = stream.below(problem.stages.len());
    let (i, j, r) = (stream.below(NX), stream.below(NX), stream.below(NS));
    let field = stream.below(16);
    let stage = &mut problem.stages[stage];
    let row = &mut stage.rows[r];
    let place = match field {
        0 => &mut problem.initial_state[i],
        1 => &mut problem.input_min,
        2 => &mut problem.input_max,
        3 => &mut stage.a[i][j],
        4 => &mut stage.b[i],
        5 => &mut stage.c[i],
        6 => &mut stage.state_weight[i],
        7 => &mut stage.state_reference[i],
        8 => &mut stage.input_weight,
        9 => &mut stage.input_reference,
        10 => &mut row.state[i],
        11 => &mut row.input,
        12 => &mut row.lower,
        13 => &mut row.upper,
        14 => &mut row.l1_weight,
        _ => &mut row.l2_weight,
    };
    *place = value;
    let unbounded = match field {
        1 | 12 => value == f64::NEG_INFINITY,
        2 | 13 => value == f64::INFINITY,
        _ => false,
    };
    !unbounded
}
