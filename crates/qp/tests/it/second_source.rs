//! The solver against Clarabel, an interior-point method that shares nothing with it.

use crate::common::{FAR, MILD, Random, Recipe, cost, random_problem};
use crate::oracle::clarabel;
use lanecraft_qp::{Solver, Start, Status};

/// Of the input range. Clarabel at 1e-10 itself leaves about 1e-6.
const INPUT_TOLERANCE: f64 = 1e-5;
/// Relative. Ours must not be worse than theirs by more than rounding.
const COST_TOLERANCE: f64 = 1e-9;

fn compare<const NX: usize, const NS: usize>(recipe: Recipe, horizons: &[usize], seed: u64) {
    let mut random = Random(seed);
    for (case, &horizon) in horizons.iter().cycle().take(60).enumerate() {
        let problem = random_problem::<NX, NS>(&mut random, horizon, recipe);
        let mut solver = Solver::new(horizon);
        let verdict = solver.solve(&problem, Start::Cold);
        assert_eq!(verdict.status, Status::Solved, "case {case}: {verdict:?}");
        let oracle = clarabel(&problem, 1e-10).expect("solved");
        let error = (solver.inputs()[0] - oracle[0]).abs() / (problem.input_max - problem.input_min);
        assert!(error < INPUT_TOLERANCE, "case {case}: first input off by {error}");
        let (ours, theirs) = (cost(&problem, solver.inputs()), cost(&problem, &oracle));
        assert!(ours <= theirs + COST_TOLERANCE * theirs.abs(), "case {case}: cost {ours}, Clarabel {theirs}");
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
