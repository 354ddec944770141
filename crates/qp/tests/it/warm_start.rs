//! A warm start may change the time of a solve, not its answer.

use crate::common::{FAR, MILD, Random, Recipe, bits, random_problem};
use lanecraft_qp::{Problem, Solver, Start, Status};

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
        assert_eq!(bits(&mut first, &v), bits(&mut second, &w));
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
        assert_eq!(bits(&mut used, &verdict), bits(&mut fresh, &expected));
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
    assert_eq!(bits(&mut kept, &verdict), bits(&mut fresh, &expected));
}

/// Cold solves depend on nothing that came before: not on what a solver has kept of other problems, nor on what it remembers of
/// the same matrices. Warm ones depend on the active set alone, so that a clone without its memory cannot be told from it.
#[test]
fn what_is_kept_of_earlier_problems_changes_no_bit() {
    let (mut random, mut used) = (Random(27), Solver::new(HORIZON));
    let mut problem = random_problem::<4, 3>(&mut random, HORIZON, FAR);
    for change in 0..60 {
        let stage = &mut problem.stages[change % HORIZON];
        match change % 6 {
            0 => problem.initial_state = [0; 4].map(|_| 30.0 * random.range(-1.0, 1.0)),
            1 => stage.rows[change % 3].state[change % 4] += 0.1,
            2 => stage.rows[change % 3].l2_weight *= 1.5,
            3 => stage.a[change % 4][1] += 0.01,
            4 => problem.terminal_weight[2][2] += 0.1,
            _ => problem.stages[3].c[1] = f64::NAN,
        }
        let mut fresh = Solver::new(HORIZON);
        // The second and third time all inner products are known, the factor is kept, or neither.
        for start in [Start::Cold, Start::Cold, Start::Shifted(HORIZON)] {
            let (expected, found) = (fresh.solve(&problem, Start::Cold), used.solve(&problem, start));
            assert_eq!(bits(&mut used, &found), bits(&mut fresh, &expected), "after change {change}");
            assert_eq!(found.status, expected.status);
            fresh.reset();
        }
        let _ = used.solve(&problem, Start::Shifted(change % 3));
        problem.stages[3].c[1] = 0.05;
    }
}
