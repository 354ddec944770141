//! A solve that is stopped: labeled, usable, and as good as the time allowed.

use crate::common::{FAR, Random, bits, random_problem, rollout};
use lanecraft_qp::{Problem, Solver, Start, Status};

const HORIZON: usize = 40;

/// True from the call after `count` calls on.
fn after(count: usize) -> impl FnMut() -> bool {
    let mut calls = 0;
    move || {
        calls += 1;
        calls > count
    }
}

fn problems() -> Vec<Problem<4, 3>> {
    let mut random = Random(51);
    (0..12).map(|_| random_problem(&mut random, HORIZON, FAR)).collect()
}

#[test]
fn a_stopped_solve_is_labeled_and_its_inputs_are_usable() {
    let mut stopped = 0;
    for problem in problems() {
        for count in [0, 1, 2, 5, 12, 30] {
            let mut solver = Solver::new(HORIZON);
            let verdict = solver.solve_until(&problem, Start::Cold, after(count));
            assert_eq!(verdict.status == Status::Solved, verdict.kkt_residual <= 1e-6);
            assert!(matches!(verdict.status, Status::Solved | Status::OutOfTime), "{verdict:?}");
            stopped += usize::from(verdict.status == Status::OutOfTime);
            assert!(verdict.slack_max.is_finite() && solver.inputs().iter().all(|u| u.is_finite()));
            assert!(solver.inputs().iter().all(|u| (problem.input_min..=problem.input_max).contains(u)));
            // The states belong to these inputs, not to those before they were moved into their bounds.
            for (state, own) in solver.states().iter().zip(&rollout(&problem, solver.inputs())[1..]) {
                for (x, y) in state.iter().zip(own) {
                    assert!((x - y).abs() <= 1e-9 * (1.0 + y.abs()), "{x} is not {y}");
                }
            }
        }
    }
    assert!(stopped > 40, "only {stopped} solves were stopped: no test");
}

#[test]
fn time_enough_changes_no_bit_and_a_stopped_solver_goes_on_to_the_optimum() {
    for problem in problems() {
        let (mut free, mut limited) = (Solver::new(HORIZON), Solver::new(HORIZON));
        let (expected, found) =
            (free.solve(&problem, Start::Cold), limited.solve_until(&problem, Start::Cold, || false));
        assert_eq!(bits(&mut limited, &found), bits(&mut free, &expected));
        let _ = limited.solve_until(&problem, Start::Cold, after(4));
        assert_eq!(limited.solve(&problem, Start::Shifted(0)).status, Status::Solved);
        for (a, b) in limited.inputs().iter().zip(free.inputs()) {
            assert!((a - b).abs() < 1e-9, "stopped and resumed {a}, at once {b}");
        }
    }
}
