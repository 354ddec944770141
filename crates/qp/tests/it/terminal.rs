//! The terminal weight: it stands for the time after the horizon, and solves the equation that it is named after.
// Indices as in the equations.
#![allow(clippy::needless_range_loop)]

use crate::common::{MILD, Random, random_problem};
use lanecraft_qp::{Field, InvalidInput, Problem, Solver, Start, Status, infinite_horizon_weight};

/// Relative: the fixed point of a recursion that contracts by a tenth of a percent a step or more.
const TOLERANCE: f64 = 1e-10;

type Plant = ([[f64; 3]; 3], [f64; 3], [f64; 3], f64);

/// Random, up to slightly unstable, with one state that costs nothing.
fn plant(random: &mut Random) -> Plant {
    let mut a: [[f64; 3]; 3] = [[0; 3]; 3].map(|line| line.map(|_| 0.15 * random.range(-1.0, 1.0)));
    for i in 0..3 {
        a[i][i] = random.range(0.7, 1.05);
    }
    let b = [0; 3].map(|_| random.range(-1.0, 1.0));
    (a, b, [random.decade(-1.0, 1.0), random.decade(-1.0, 1.0), 0.0], random.decade(-1.0, 1.0))
}

/// Largest entry of Q + A'PA - A'PB (R + B'PB)⁻¹ B'PA - P, written out as it stands, and of P.
fn residual((a, b, q, r): &Plant, p: &[[f64; 3]; 3]) -> (f64, f64) {
    let mut pa = [[0.0; 3]; 3];
    let (mut s, mut bpa, mut worst, mut size) = (*r, [0.0; 3], 0.0_f64, 0.0_f64);
    for i in 0..3 {
        for j in 0..3 {
            pa[i][j] = (0..3).map(|l| p[i][l] * a[l][j]).sum();
            bpa[j] += b[i] * pa[i][j];
            s += b[i] * p[i][j] * b[j];
        }
    }
    for i in 0..3 {
        for j in 0..3 {
            let moved: f64 = (0..3).map(|l| a[l][i] * pa[l][j]).sum();
            let own = if i == j { q[i] } else { 0.0 };
            worst = worst.max((own + moved - bpa[i] * bpa[j] / s - p[i][j]).abs());
            size = size.max(p[i][j].abs());
        }
    }
    (worst, size)
}

#[test]
fn the_weight_solves_the_algebraic_riccati_equation() {
    let mut random = Random(61);
    for _ in 0..200 {
        let plant = plant(&mut random);
        let (a, b, q, r) = plant;
        let mut p = infinite_horizon_weight(&a, &b, &q, r).expect("it settles");
        for i in 0..3 {
            p[i][i] += q[i];
        }
        let (worst, size) = residual(&plant, &p);
        assert!(worst <= TOLERANCE * size, "residual {worst} of {size}");
    }
}

/// One stage with the weight is the first of very many without.
#[test]
fn a_short_horizon_with_the_weight_is_a_long_one() {
    let mut random = Random(62);
    for _ in 0..50 {
        let (a, b, state_weight, input_weight) = plant(&mut random);
        let solve = |horizon: usize, weight: [[f64; 3]; 3]| {
            let mut problem = Problem::<3, 0>::new(horizon);
            problem.initial_state = [1.0, -2.0, 0.5];
            problem.terminal_weight = weight;
            for stage in &mut problem.stages {
                (stage.a, stage.b) = (a, b);
                (stage.state_weight, stage.input_weight) = (state_weight, input_weight);
            }
            let mut solver = Solver::new(horizon);
            assert_eq!(solver.solve(&problem, Start::Cold).status, Status::Solved);
            (solver.inputs()[0], solver.feedback())
        };
        let weight = infinite_horizon_weight(&a, &b, &state_weight, input_weight).expect("it settles");
        let (short, long) = (solve(1, weight), solve(2000, [[0.0; 3]; 3]));
        assert!((short.0 - long.0).abs() < 1e-8, "{} is not {}", short.0, long.0);
        for (s, l) in short.1.iter().zip(long.1) {
            assert!((s - l).abs() < 1e-8, "{s} is not {l}");
        }
    }
}

/// The weight times the error is the slope of its cost: x = r / (r + t) of the way from the reference of the input to that of
/// the state, as with a weight of the last stage. With bounds, the interior point has to see it, too.
#[test]
fn a_diagonal_weight_is_one_of_the_last_stage() {
    let mut random = Random(63);
    for _ in 0..20 {
        let mut problem = random_problem::<3, 2>(&mut random, 30, MILD);
        problem.initial_state = problem.initial_state.map(|x| 40.0 * x);
        let mut moved = problem.clone();
        for i in 0..3 {
            problem.terminal_weight[i][i] = 2.0;
            moved.stages[29].state_weight[i] += 2.0;
        }
        let (mut with, mut without) = (Solver::new(30), Solver::new(30));
        assert_eq!(with.solve(&problem, Start::Cold).status, Status::Solved);
        assert_eq!(without.solve(&moved, Start::Cold).status, Status::Solved);
        for (a, b) in with.inputs().iter().zip(without.inputs()) {
            assert!((a - b).abs() < 1e-9, "{a} is not {b}");
        }
    }
}

#[test]
fn a_state_that_nothing_can_stop_has_no_weight() {
    let unmoved = |decay: f64, weight: f64| infinite_horizon_weight(&[[decay]], &[0.0], &[weight], 1.0);
    assert_eq!(unmoved(1.0, 1.0), None);
    assert_eq!(unmoved(2.0, 1.0), None);
    assert_eq!(unmoved(f64::NAN, 1.0), None);
    // Σ decay^2k from k = 1 on, and nothing for what costs nothing.
    assert!((unmoved(0.5, 3.0).expect("it decays")[0][0] - 1.0).abs() < 1e-12);
    assert_eq!(unmoved(2.0, 0.0), Some([[0.0]]));
}

#[test]
fn a_weight_that_is_no_cost_is_refused() {
    let refusal = |weight: [[f64; 2]; 2]| {
        let mut problem = Problem::<2, 0>::new(3);
        problem.terminal_weight = weight;
        Solver::new(3).solve(&problem, Start::Cold).status
    };
    let indefinite = Status::InvalidInput(InvalidInput::Indefinite { field: Field::TerminalWeight });
    for weight in
        [[[1.0, 0.5], [0.4, 1.0]], [[1.0, 2.0], [2.0, 1.0]], [[-1.0, 0.0], [0.0, 0.0]], [[0.0, 1.0], [1.0, 5.0]]]
    {
        assert_eq!(refusal(weight), indefinite, "{weight:?}");
    }
    let infinite = Status::InvalidInput(InvalidInput::NotFinite { field: Field::TerminalWeight, stage: 0 });
    assert_eq!(refusal([[f64::NAN, 0.0], [0.0, 1.0]]), infinite);
    for weight in [[[0.0; 2]; 2], [[1.0, 1.0], [1.0, 1.0]], [[4.0, -2.0], [-2.0, 1.0]]] {
        assert_eq!(refusal(weight), Status::Solved, "{weight:?}");
    }
}
