//! The solver against Clarabel, an interior-point method that shares nothing with it.

use crate::common::{FAR, MILD, Random, Recipe, cost, random_problem};
use crate::oracle::clarabel;
use lanecraft_qp::{Problem, Row, Solver, Start, Status, zero_order_hold};

/// Of the input range. Clarabel at 1e-10 itself leaves about 1e-6.
const INPUT_TOLERANCE: f64 = 1e-5;
/// Relative. Ours must not be worse than theirs by more than rounding.
const COST_TOLERANCE: f64 = 1e-9;

fn assert_agreement<const NX: usize, const NS: usize>(problem: &Problem<NX, NS>, case: usize) {
    let mut solver = Solver::new(problem.stages.len());
    let verdict = solver.solve(problem, Start::Cold);
    assert_eq!(verdict.status, Status::Solved, "case {case}: {verdict:?}");
    let oracle = clarabel(problem, 1e-10).expect("solved");
    let error = (solver.inputs()[0] - oracle[0]).abs() / (problem.input_max - problem.input_min);
    assert!(error < INPUT_TOLERANCE, "case {case}: first input off by {error}");
    let (ours, theirs) = (cost(problem, solver.inputs()), cost(problem, &oracle));
    assert!(ours <= theirs + COST_TOLERANCE * theirs.abs(), "case {case}: cost {ours}, Clarabel {theirs}");
}

fn compare<const NX: usize, const NS: usize>(recipe: Recipe, horizons: &[usize], seed: u64) {
    let mut random = Random(seed);
    for (case, &horizon) in horizons.iter().cycle().take(60).enumerate() {
        assert_agreement(&random_problem::<NX, NS>(&mut random, horizon, recipe), case);
    }
}

#[test]
fn agrees_with_clarabel_on_mild_problems() {
    compare::<4, 3>(MILD, &[1, 2, 7, 20, 40], 1);
    compare::<6, 2>(MILD, &[3, 25], 2);
    compare::<1, 1>(MILD, &[1, 5, 50], 3);
}

#[test]
fn agrees_with_clarabel_far_out_of_range_where_rows_conflict() {
    compare::<4, 3>(FAR, &[1, 2, 7, 20, 40], 4);
    compare::<2, 5>(FAR, &[3, 25], 5);
}

/// A fast, stiff lateral motion (sideslip speed, heading, yaw rate, offset) under a steering angle, with tire limits a few
/// hundredths of a radian wide: the scaling of the real thing.
fn steering_problem(random: &mut Random, horizon: usize) -> Problem<4, 2> {
    let mut problem = Problem::new(horizon);
    problem.initial_state =
        [random.range(-1.0, 1.0), random.range(-0.1, 0.1), random.range(-0.3, 0.3), random.range(-3.0, 3.0)];
    (problem.input_min, problem.input_max) = (-0.14, 0.14);
    for (k, stage) in problem.stages.iter_mut().enumerate() {
        let speed = 28.0 - 0.05 * k as f64;
        let a = [
            [-309.0 / speed, 0.0, -speed + 139.0 / speed, 0.0],
            [0.0, 0.0, 1.0, 0.0],
            [292.0 / speed, 0.0, -1191.0 / speed, 0.0],
            [1.0, speed, 0.0, 0.0],
        ];
        let (transition, input) = zero_order_hold(&a, &[[133.0], [0.0], [285.0], [0.0]], 0.05);
        stage.a = transition;
        stage.b = input.map(|[b]| b);
        stage.state_weight = [0.0, 2.0, 0.0, 20.0];
        stage.input_weight = 20.0;
        let limit = |state: [f64; 4], input: f64, width: f64| Row {
            state,
            input,
            lower: -width,
            upper: width,
            l1_weight: 2e4,
            l2_weight: 1e6,
        };
        let front = limit([1.0 / speed, 0.0, 1.016 / speed, 0.0], -1.0, 0.0378);
        stage.rows = [front, limit([1.0 / speed, 0.0, -1.562 / speed, 0.0], 0.0, 0.0187)];
    }
    problem
}

#[test]
fn agrees_with_clarabel_on_steering() {
    let mut random = Random(6);
    for case in 0..40 {
        assert_agreement(&steering_problem(&mut random, 20 + 10 * (case % 4)), case);
    }
}
