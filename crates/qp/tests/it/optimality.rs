//! The conditions of Karush, Kuhn and Tucker, recomputed from the answer alone.

use crate::common::{FAR, MILD, Random, Recipe, random_problem, rollout};
use lanecraft_qp::{ActiveRow, Constraint, Problem, Side, Solver, Start, Status};

/// Relative to the largest term of the condition.
const TOLERANCE: f64 = 1e-9;

/// Signed multipliers: those of the rows of each stage, and that of its input bounds.
type Multipliers<const NS: usize> = Vec<([f64; NS], f64)>;

fn signed<const NS: usize>(active: &[ActiveRow], horizon: usize) -> Multipliers<NS> {
    let mut multipliers = vec![([0.0; NS], 0.0); horizon];
    for row in active {
        let sign = if row.side == Side::Upper { 1.0 } else { -1.0 };
        match row.constraint {
            Constraint::Input => multipliers[row.stage].1 = sign * row.multiplier,
            Constraint::Row(i) => multipliers[row.stage].0[i] = sign * row.multiplier,
        }
    }
    multipliers
}

/// Gradient of the Lagrangian in the inputs by the adjoint, and the size of its terms.
fn gradient<const NX: usize, const NS: usize>(
    problem: &Problem<NX, NS>,
    inputs: &[f64],
    multipliers: &Multipliers<NS>,
) -> Vec<(f64, f64)> {
    let states = rollout(problem, inputs);
    let mut adjoint = [0.0; NX];
    let mut gradient = vec![];
    for (k, stage) in problem.stages.iter().enumerate().rev() {
        let (rows, bound) = &multipliers[k];
        for i in 0..NX {
            adjoint[i] += stage.state_weight[i] * (states[k + 1][i] - stage.state_reference[i]);
        }
        let mut terms = vec![stage.input_weight * (inputs[k] - stage.input_reference), *bound];
        terms.extend((0..NX).map(|i| stage.b[i] * adjoint[i]));
        terms.extend((0..NS).map(|i| stage.rows[i].input * rows[i]));
        gradient.push((terms.iter().sum(), terms.iter().fold(1.0, |m: f64, t| m.max(t.abs()))));
        adjoint = std::array::from_fn(|j| {
            (0..NX).map(|i| stage.a[i][j] * adjoint[i]).sum::<f64>()
                + (0..NS).map(|i| stage.rows[i].state[j] * rows[i]).sum::<f64>()
        });
    }
    gradient
}

fn check<const NX: usize, const NS: usize>(problem: &Problem<NX, NS>, solver: &Solver<NX, NS>) {
    let active: Vec<ActiveRow> = solver.active_rows().collect();
    let multipliers = signed::<NS>(&active, problem.stages.len());
    for (value, size) in gradient(problem, solver.inputs(), &multipliers) {
        assert!(value.abs() <= TOLERANCE * size, "the Lagrangian has slope {value} of terms up to {size}");
    }
    let states = rollout(problem, solver.inputs());
    for (k, (stage, u)) in problem.stages.iter().zip(solver.inputs()).enumerate() {
        assert!((problem.input_min..=problem.input_max).contains(u));
        for (i, row) in stage.rows.iter().enumerate() {
            let value = row.input * u + (0..NX).map(|j| row.state[j] * states[k][j]).sum::<f64>();
            let here = active.iter().find(|a| a.stage == k && a.constraint == Constraint::Row(i));
            let slack = here.map_or(0.0, |a| a.slack);
            let tolerance = TOLERANCE * (1.0 + value.abs() + states[k].iter().fold(0.0, |m: f64, x| m.max(x.abs())));
            assert!(value <= row.upper + slack + tolerance && value >= row.lower - slack - tolerance);
            if let Some(a) = here {
                let bound = if a.side == Side::Upper { row.upper + slack } else { row.lower - slack };
                assert!((value - bound).abs() < tolerance, "an active row is off its bound by {}", value - bound);
                // The multiplier is the slope of the slack's cost, and at most the L1 weight without slack.
                let cost_slope = row.l1_weight + row.l2_weight * slack;
                assert!(a.multiplier >= 0.0 && a.multiplier <= cost_slope * (1.0 + TOLERANCE));
                assert!(slack == 0.0 || a.multiplier >= cost_slope * (1.0 - TOLERANCE));
            }
        }
    }
    for a in active.iter().filter(|a| a.constraint == Constraint::Input) {
        let bound = if a.side == Side::Upper { problem.input_max } else { problem.input_min };
        assert!(a.multiplier >= 0.0 && a.slack == 0.0 && (solver.inputs()[a.stage] - bound).abs() < TOLERANCE);
    }
}

fn check_many<const NX: usize, const NS: usize>(recipe: Recipe, seed: u64) {
    let mut random = Random(seed);
    for case in 0..200 {
        let horizon = 1 + case % 40;
        let problem = random_problem::<NX, NS>(&mut random, horizon, recipe);
        let mut solver = Solver::new(horizon);
        assert_eq!(solver.solve(&problem, Start::Cold).status, Status::Solved);
        check(&problem, &solver);
    }
}

#[test]
fn mild_problems_end_at_kkt_points() {
    check_many::<3, 2>(MILD, 11);
    check_many::<6, 4>(MILD, 12);
}

#[test]
fn problems_far_out_of_range_end_at_kkt_points() {
    check_many::<3, 2>(FAR, 13);
    check_many::<5, 6>(FAR, 14);
}

/// Steps small enough to keep the active set, large enough to see the slope.
#[test]
fn the_feedback_is_the_slope_of_the_first_input() {
    const STEP: f64 = 1e-6;
    let mut random = Random(15);
    let mut sensitive = 0;
    for _ in 0..50 {
        let mut problem = random_problem::<3, 2>(&mut random, 15, MILD);
        let mut solver = Solver::new(15);
        let _ = solver.solve(&problem, Start::Cold);
        let feedback: [f64; 3] = solver.feedback();
        for (i, claimed) in feedback.iter().enumerate() {
            let start = problem.initial_state[i];
            let mut input_at = |x: f64| {
                problem.initial_state[i] = x;
                let _ = solver.solve(&problem, Start::Shifted(0));
                solver.inputs()[0]
            };
            let slope = (input_at(start + STEP) - input_at(start - STEP)) / (2.0 * STEP);
            problem.initial_state[i] = start;
            assert!((slope - claimed).abs() < 1e-5, "{slope} is not {claimed}");
            sensitive += usize::from(slope.abs() > 1e-3);
        }
    }
    assert!(sensitive > 20, "too few cases in which the first input is free: {sensitive}");
}
