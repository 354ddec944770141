//! Problems small enough to be solved by hand.

use lanecraft_qp::{Constraint, Problem, Row, Side, Solver, Start, Status};

/// A few rounding errors of numbers near 1.
const ROUNDING: f64 = 1e-14;

fn solved<const NX: usize, const NS: usize>(problem: &Problem<NX, NS>) -> Solver<NX, NS> {
    let mut solver = Solver::new(problem.stages.len());
    let verdict = solver.solve(problem, Start::Cold);
    assert_eq!(verdict.status, Status::Solved, "{verdict:?}");
    solver
}

/// min ½ q (a x + b u + c - xr)² + ½ r (u - ur)² has u = (r ur + b q (xr - a x - c)) / (r + b² q).
#[test]
fn one_step_is_a_clipped_quotient() {
    let mut problem = Problem::<1, 0>::new(1);
    let stage = &mut problem.stages[0];
    (stage.a, stage.b, stage.c) = ([[0.9]], [0.5], [0.2]);
    (stage.state_weight, stage.state_reference) = ([3.0], [2.0]);
    (stage.input_weight, stage.input_reference) = (0.7, -0.1);
    problem.initial_state = [1.5];
    let free = (0.7 * -0.1 + 0.5 * 3.0 * (2.0 - 0.9 * 1.5 - 0.2)) / (0.7 + 0.25 * 3.0);
    assert!((solved(&problem).inputs()[0] - free).abs() < ROUNDING);
    problem.input_max = 0.2;
    let solver = solved(&problem);
    assert_eq!(solver.inputs(), [0.2]);
    assert!((solver.states()[0][0] - (0.9 * 1.5 + 0.5 * 0.2 + 0.2)).abs() < ROUNDING);
    // The multiplier is the slope of the cost that the bound cuts off.
    let active: Vec<_> = solver.active_rows().collect();
    assert_eq!((active.len(), active[0].constraint, active[0].side), (1, Constraint::Input, Side::Upper));
    assert!((active[0].multiplier - (0.7 + 0.75) * (free - 0.2)).abs() < ROUNDING);
}

/// min ½ r u² with u >= 1 - s: u = 1 as long as w1 >= r, else r u = w1 + w2 (1 - u).
#[test]
fn a_soft_row_is_exact_below_its_l1_weight_and_yields_above() {
    let mut problem = Problem::<1, 1>::new(1);
    problem.stages[0].input_weight = 4.0;
    let row = Row { input: 1.0, lower: 1.0, l1_weight: 5.0, l2_weight: 2.0, ..Row::unbounded() };
    problem.stages[0].rows[0] = row;
    let solver = solved(&problem);
    assert!((solver.inputs()[0] - 1.0).abs() < ROUNDING);
    assert!(solver.active_rows().all(|active| active.slack == 0.0 && (active.multiplier - 4.0).abs() < ROUNDING));
    problem.stages[0].rows[0].l1_weight = 1.0;
    let solver = solved(&problem);
    let yielding = (1.0 + 2.0) / (4.0 + 2.0);
    assert!((solver.inputs()[0] - yielding).abs() < ROUNDING);
    assert!(solver.active_rows().all(|active| (active.slack - (1.0 - yielding)).abs() < ROUNDING));
}

/// x' = x + u, q = r = 1: the Riccati equation is P² = P + 1, so P is the golden ratio and the gain P / (1 + P) = 1 / P.
#[test]
fn a_long_horizon_has_the_stationary_gain() {
    let mut problem = Problem::<1, 0>::new(60);
    problem.initial_state = [1.0];
    for stage in &mut problem.stages {
        (stage.b, stage.state_weight) = ([1.0], [1.0]);
    }
    let mut solver = Solver::new(60);
    let _ = solver.solve(&problem, Start::Cold);
    let golden = f64::midpoint(1.0, 5f64.sqrt());
    assert!((solver.feedback()[0] + 1.0 / golden).abs() < ROUNDING);
    assert!((solver.inputs()[0] + 1.0 / golden).abs() < ROUNDING);
    let decay = (0..10).fold(1.0, |product, _| product * (1.0 - 1.0 / golden));
    assert!((solver.states()[9][0] - decay).abs() < ROUNDING);
}

/// No input can move `x_0`: the violation is what it is, and the rest of the problem does not suffer.
#[test]
fn a_row_on_the_initial_state_alone_costs_only_its_slack() {
    let mut problem = Problem::<1, 1>::new(5);
    problem.initial_state = [3.0];
    for stage in &mut problem.stages {
        (stage.b, stage.state_weight) = ([1.0], [1.0]);
    }
    let free = solved(&problem).inputs().to_vec();
    problem.stages[0].rows[0] = Row { state: [1.0], upper: 1.0, ..Row::unbounded() };
    let mut solver = Solver::new(5);
    for start in [Start::Cold, Start::Shifted(0), Start::Shifted(1)] {
        let verdict = solver.solve(&problem, start);
        assert_eq!((verdict.status, verdict.slack_max), (Status::Solved, 2.0));
        assert_eq!(solver.inputs(), free);
    }
}

#[test]
fn equal_bounds_fix_all_inputs_and_equal_row_bounds_are_equations() {
    let mut problem = Problem::<2, 1>::new(12);
    problem.initial_state = [1.0, -1.0];
    for stage in &mut problem.stages {
        stage.a = [[1.0, 0.1], [0.0, 0.9]];
        (stage.b, stage.state_weight) = ([0.0, 1.0], [1.0, 0.1]);
    }
    (problem.input_min, problem.input_max) = (0.25, 0.25);
    assert_eq!(solved(&problem).inputs(), [0.25; 12]);
    (problem.input_min, problem.input_max) = (-10.0, 10.0);
    let equation = Row { state: [0.0, 0.9], input: 1.0, lower: 0.3, upper: 0.3, l1_weight: 1e4, ..Row::unbounded() };
    problem.stages[4].rows[0] = equation;
    assert!((solved(&problem).states()[4][1] - 0.3).abs() < 1e-12);
}

#[test]
fn a_horizon_of_zero_is_solved() {
    let mut solver = Solver::<2, 1>::new(0);
    assert_eq!(solver.solve(&Problem::new(0), Start::Shifted(1)).status, Status::Solved);
    assert!(solver.inputs().is_empty() && solver.states().is_empty());
}
