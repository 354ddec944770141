//! The same problems handed to Clarabel, over z = (input, next state, slacks) of all stages.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT};
use lanecraft_qp::Problem;

/// A sparse matrix under construction, and a right-hand side.
#[derive(Default)]
struct Triplets {
    entries: Vec<(usize, usize, f64)>,
    right: Vec<f64>,
}

impl Triplets {
    fn row(&mut self, entries: &[(usize, f64)], right: f64) {
        let row = self.right.len();
        self.entries.extend(entries.iter().filter(|e| e.1 != 0.0).map(|&(column, value)| (row, column, value)));
        self.right.push(right);
    }

    fn append(&mut self, other: &Self) {
        let shift = self.right.len();
        self.entries.extend(other.entries.iter().map(|&(row, column, value)| (row + shift, column, value)));
        self.right.extend(&other.right);
    }

    fn matrix(&self, rows: usize, columns: usize) -> CscMatrix<f64> {
        let rows_of = self.entries.iter().map(|e| e.0).collect();
        let columns_of = self.entries.iter().map(|e| e.1).collect();
        let values = self.entries.iter().map(|e| e.2).collect();
        CscMatrix::new_from_triplets(rows, columns, rows_of, columns_of, values)
    }
}

/// min ½ z'Pz + q'z with equations and inequalities.
struct Program<'a, const NX: usize, const NS: usize> {
    problem: &'a Problem<NX, NS>,
    curvature: Triplets,
    gradient: Vec<f64>,
    equal: Triplets,
    below: Triplets,
}

impl<'a, const NX: usize, const NS: usize> Program<'a, NX, NS> {
    const WIDTH: usize = 1 + NX + NS;

    fn new(problem: &'a Problem<NX, NS>) -> Self {
        let gradient = vec![0.0; problem.stages.len() * Self::WIDTH];
        let (curvature, equal, below) = Default::default();
        let mut program = Self { problem, curvature, gradient, equal, below };
        for k in 0..problem.stages.len() {
            program.cost(k);
            program.dynamics(k);
            program.bounds(k);
        }
        program
    }

    fn cost(&mut self, k: usize) {
        let (stage, u) = (&self.problem.stages[k], k * Self::WIDTH);
        let mut weigh = |column: usize, weight: f64, gradient: f64| {
            self.curvature.entries.push((column, column, weight));
            self.gradient[column] = gradient;
        };
        weigh(u, stage.input_weight, -stage.input_weight * stage.input_reference);
        for i in 0..NX {
            weigh(u + 1 + i, stage.state_weight[i], -stage.state_weight[i] * stage.state_reference[i]);
        }
        for (i, row) in stage.rows.iter().enumerate() {
            weigh(u + 1 + NX + i, row.l2_weight, row.l1_weight);
        }
    }

    fn dynamics(&mut self, k: usize) {
        let (stage, u) = (&self.problem.stages[k], k * Self::WIDTH);
        for i in 0..NX {
            let (mut row, constant) = self.state_terms(k, &stage.a[i].map(|v| -v));
            row.extend([(u, -stage.b[i]), (u + 1 + i, 1.0)]);
            self.equal.row(&row, stage.c[i] - constant);
        }
    }

    fn bounds(&mut self, k: usize) {
        let (stage, u) = (&self.problem.stages[k], k * Self::WIDTH);
        self.below.row(&[(u, 1.0)], self.problem.input_max);
        self.below.row(&[(u, -1.0)], -self.problem.input_min);
        for (i, row) in stage.rows.iter().enumerate() {
            let slack = (u + 1 + NX + i, -1.0);
            self.below.row(&[slack], 0.0);
            for (sign, bound) in [(1.0, row.upper), (-1.0, row.lower)] {
                if bound.is_finite() {
                    let (mut entries, constant) = self.state_terms(k, &row.state.map(|v| sign * v));
                    entries.extend([(u, sign * row.input), slack]);
                    self.below.row(&entries, sign * bound - constant);
                }
            }
        }
    }

    /// The coefficients times the state: a constant at stage 0, columns of the stage before later.
    fn state_terms(&self, k: usize, coefficients: &[f64; NX]) -> (Vec<(usize, f64)>, f64) {
        if k == 0 {
            return (vec![], coefficients.iter().zip(&self.problem.initial_state).map(|(c, x)| c * x).sum());
        }
        let first = (k - 1) * Self::WIDTH + 1;
        ((first..).zip(coefficients.iter().copied()).collect(), 0.0)
    }
}

/// The inputs; none if Clarabel did not converge to `tolerance`.
pub(crate) fn clarabel<const NX: usize, const NS: usize>(
    problem: &Problem<NX, NS>,
    tolerance: f64,
) -> Option<Vec<f64>> {
    let mut program = Program::new(problem);
    let cones = [ZeroConeT(program.equal.right.len()), NonnegativeConeT(program.below.right.len())];
    program.equal.append(&program.below);
    let settings = DefaultSettings {
        verbose: false,
        tol_gap_abs: tolerance,
        tol_gap_rel: tolerance,
        tol_feas: tolerance,
        ..DefaultSettings::default()
    };
    let (size, constraints) = (program.gradient.len(), &program.equal);
    let (p, a) = (program.curvature.matrix(size, size), constraints.matrix(constraints.right.len(), size));
    let mut solver = DefaultSolver::new(&p, &program.gradient, &a, &constraints.right, &cones, settings)
        .expect("the matrices fit each other");
    solver.solve();
    let inputs = solver.solution.x.chunks_exact(1 + NX + NS).map(|stage| stage[0]).collect();
    (solver.solution.status == SolverStatus::Solved).then_some(inputs)
}
