//! Weights over sixteen decades, and numbers at the ends of f64.

use crate::common::{MILD, Random, Recipe, cost, random_problem};
use crate::oracle::clarabel;
use lanecraft_qp::{Problem, Solver, Start, Status};

const WILD: Recipe = Recipe { weights: (-8.0, 8.0), initial: 3.0, modes: (0.6, 1.02) };

fn assert_usable<const NX: usize, const NS: usize>(problem: &Problem<NX, NS>, solver: &Solver<NX, NS>) {
    for u in solver.inputs() {
        assert!(u.is_finite() && *u >= problem.input_min && *u <= problem.input_max, "input {u}");
    }
}

/// A multiplier of 1e8 over a curvature of 1e-8 leaves no digit of an input: such problems may end above the accepted
/// residual, but not many, and never without a usable answer.
#[test]
fn weights_of_any_size_give_usable_inputs_and_nearly_always_the_optimum() {
    const CASES: usize = 3000;
    let mut random = Random(41);
    let mut unsolved = 0;
    for case in 0..CASES {
        let horizon = 1 + case % 25;
        let problem = random_problem::<3, 2>(&mut random, horizon, WILD);
        let mut solver = Solver::new(horizon);
        let verdict = solver.solve(&problem, Start::Cold);
        assert_usable(&problem, &solver);
        if verdict.status != Status::Solved {
            unsolved += 1;
        } else if case % 20 == 0
            && let Some(oracle) = clarabel(&problem, 1e-10)
        {
            let (ours, theirs) = (cost(&problem, solver.inputs()), cost(&problem, &oracle));
            assert!(ours <= theirs * (1.0 + 1e-5) + 1e-9, "case {case}: cost {ours}, Clarabel {theirs}, {verdict:?}");
        }
    }
    assert!(unsolved <= CASES / 25, "{unsolved} of {CASES} unsolved");
}

#[test]
fn numbers_at_the_ends_of_f64_give_usable_inputs_and_no_bad_memory() {
    let good = random_problem::<3, 2>(&mut Random(42), 9, MILD);
    let mut fresh = Solver::new(9);
    let expected = fresh.solve(&good, Start::Cold);
    let mut solver = Solver::new(9);
    for size in [1e-320, 1e-200, 1e100, 1e160, 1e300, f64::MAX] {
        let changes: [fn(&mut Problem<3, 2>, f64); 8] = [
            |p, v| p.initial_state[1] = v,
            |p, v| p.stages[3].a[0][2] = v,
            |p, v| p.stages[3].b[1] = v,
            |p, v| p.stages[8].c[2] = -v,
            |p, v| p.stages[5].state_weight[1] = v,
            |p, v| p.stages[2].input_weight = v,
            |p, v| (p.stages[2].rows[1].l1_weight, p.stages[2].rows[1].l2_weight) = (v, v),
            |p, v| p.stages[6].rows[0].state = [v, -v, v],
        ];
        for change in changes {
            let mut problem = good.clone();
            change(&mut problem, size);
            let _ = solver.solve(&problem, Start::Shifted(0));
            assert_usable(&problem, &solver);
            let _ = solver.solve(&problem, Start::Shifted(1));
            assert_usable(&problem, &solver);
            assert_eq!(solver.solve(&good, Start::Cold), expected);
        }
    }
}
