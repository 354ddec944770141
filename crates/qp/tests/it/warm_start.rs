//! A warm start may change the time of a solve, not its answer.

use crate::common::{FAR, MILD, Random, Recipe, random_problem};
use lanecraft_qp::{Problem, Solver, Start, Status, Verdict};

const HORIZON: usize = 25;
/// The optimum is unique: what is left is rounding, times the conditioning of these problems.
const AGREEMENT: f64 = 1e-9;

/// A sequence in which the state follows the first input, is pushed, and the stages move on.
fn sequence(recipe: Recipe, seed: u64) -> Vec<Problem<4, 3>> {
    let mut random = Random(seed);
    let mut problem = random_problem::<4, 3>(&mut random, HORIZON, recipe);
    let mut solver = Solver::new(HORIZON);
    (0..60)
        .map(|_| {
            let now = problem.clone();
            let _ = solver.solve(&now, Start::Cold);
            problem.initial_state = solver.states()[0].map(|x| x + 0.05 * recipe.initial * random.range(-1.0, 1.0));
            problem.stages.rotate_left(1);
            now
        })
        .collect()
}

fn bits(solver: &Solver<4, 3>, verdict: &Verdict<4>) -> Vec<u64> {
    let states = solver.states().iter().flatten();
    let active = solver.active_rows().flat_map(|a| [a.stage as f64, a.multiplier, a.slack]).collect::<Vec<_>>();
    let numbers = solver.inputs().iter().chain(states).chain(&active).chain(&verdict.feedback).map(|v| v.to_bits());
    numbers.chain([u64::from(verdict.iterations), verdict.kkt_residual.to_bits()]).collect()
}

#[test]
fn warm_and_cold_agree() {
    for (recipe, seed) in [(MILD, 21), (MILD, 22), (FAR, 23)] {
        let (mut warm, mut cold) = (Solver::new(HORIZON), Solver::new(HORIZON));
        let (mut warm_iterations, mut cold_iterations) = (0, 0);
        for problem in sequence(recipe, seed) {
            let (w, c) = (warm.solve(&problem, Start::Shifted(1)), cold.solve(&problem, Start::Cold));
            assert_eq!((w.status, c.status), (Status::Solved, Status::Solved));
            for (a, b) in warm.inputs().iter().zip(cold.inputs()) {
                assert!((a - b).abs() < AGREEMENT, "warm {a}, cold {b}");
            }
            warm_iterations += w.iterations;
            cold_iterations += c.iterations;
        }
        assert!(warm_iterations < cold_iterations, "{warm_iterations} steps warm, {cold_iterations} cold");
    }
}

#[test]
fn one_sequence_of_calls_gives_the_same_bits_and_a_clone_goes_on_as_the_original() {
    let problems = sequence(MILD, 24);
    let (mut first, mut second) = (Solver::new(HORIZON), Solver::new(HORIZON));
    for (i, problem) in problems.iter().enumerate() {
        let start = if i % 7 == 3 { Start::Cold } else { Start::Shifted(i % 3) };
        let (v, w) = (first.solve(problem, start), second.solve(problem, start));
        assert_eq!(bits(&first, &v), bits(&second, &w));
        second = first.clone();
    }
}

#[test]
fn a_reset_solver_and_one_shifted_off_the_horizon_are_as_new() {
    let problems = sequence(MILD, 25);
    let mut fresh = Solver::new(HORIZON);
    let expected = fresh.solve(&problems[5], Start::Cold);
    let mut used = Solver::new(HORIZON);
    for forget in [true, false] {
        let _ = used.solve(&problems[0], Start::Cold);
        if forget {
            used.reset();
        }
        let start = if forget { Start::Shifted(1) } else { Start::Shifted(HORIZON) };
        let verdict = used.solve(&problems[5], start);
        assert_eq!(bits(&used, &verdict), bits(&fresh, &expected));
    }
}

/// Only vectors differ: the factorization is used again, and nobody can tell.
#[test]
fn a_kept_factorization_gives_the_bits_of_a_new_one() {
    let mut problem = sequence(FAR, 26).swap_remove(0);
    let mut kept = Solver::new(HORIZON);
    let _ = kept.solve(&problem, Start::Cold);
    problem.initial_state = [0.5, -0.5, 3.0, 0.0];
    problem.stages[3].state_reference = [1.0; 4];
    problem.stages[4].rows[1].upper = 0.0;
    problem.stages[4].rows[1].lower = -1.0;
    problem.stages[6].rows[2].state = [0.3; 4];
    let verdict = kept.solve(&problem, Start::Cold);
    let mut fresh = Solver::new(HORIZON);
    let expected = fresh.solve(&problem, Start::Cold);
    assert_eq!(bits(&kept, &verdict), bits(&fresh, &expected));
}
