//! Clarabel on the same problems, over z = (input, next state, slacks) of all stages. The object is re-used: all numbers are
//! written into the matrices whose pattern was analyzed once.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver as _, NonnegativeConeT, SolverStatus, SupportedConeT, ZeroConeT,
};
use lanecraft_qp::Problem;

/// A program in Clarabel's form. Zeros stay in the pattern, so that it is that of every problem with the same infinite bounds.
struct Program {
    curvature: Vec<f64>,
    gradient: Vec<f64>,
    /// (row, column, value).
    entries: Vec<(usize, usize, f64)>,
    right: Vec<f64>,
    equations: usize,
}

impl Program {
    fn new<const NX: usize, const NS: usize>(problem: &Problem<NX, NS>) -> Self {
        let mut program = Self { curvature: vec![], gradient: vec![], entries: vec![], right: vec![], equations: 0 };
        let width = 1 + NX + NS;
        for stage in &problem.stages {
            program.weigh(stage.input_weight, -stage.input_weight * stage.input_reference);
            for (weight, reference) in stage.state_weight.iter().zip(stage.state_reference) {
                program.weigh(*weight, -weight * reference);
            }
            for row in &stage.rows {
                program.weigh(row.l2_weight, row.l1_weight);
            }
        }
        for (k, stage) in problem.stages.iter().enumerate() {
            for i in 0..NX {
                let right = stage.c[i] + program.state_terms(problem, k, &stage.a[i].map(|v| -v));
                program.push(&[(k * width, -stage.b[i]), (k * width + 1 + i, 1.0)], right);
            }
        }
        program.equations = program.right.len();
        for k in 0..problem.stages.len() {
            program.bound(problem, k);
        }
        program
    }

    fn weigh(&mut self, weight: f64, slope: f64) {
        self.curvature.push(weight);
        self.gradient.push(slope);
    }

    fn bound<const NX: usize, const NS: usize>(&mut self, problem: &Problem<NX, NS>, k: usize) {
        let (stage, u) = (&problem.stages[k], k * (1 + NX + NS));
        self.push(&[(u, 1.0)], problem.input_max);
        self.push(&[(u, -1.0)], -problem.input_min);
        for (i, row) in stage.rows.iter().enumerate() {
            let slack = u + 1 + NX + i;
            self.push(&[(slack, -1.0)], 0.0);
            for (sign, bound) in [(1.0, row.upper), (-1.0, -row.lower)] {
                if bound.is_finite() {
                    let right = bound + self.state_terms(problem, k, &row.state.map(|v| sign * v));
                    self.push(&[(u, sign * row.input), (slack, -1.0)], right);
                }
            }
        }
    }

    /// Enters the coefficients of `x_k` into the row to come; at stage 0, where it is known, what they add to the right.
    fn state_terms<const NX: usize, const NS: usize>(
        &mut self,
        problem: &Problem<NX, NS>,
        k: usize,
        coefficients: &[f64; NX],
    ) -> f64 {
        if k == 0 {
            return coefficients.iter().zip(&problem.initial_state).map(|(c, x)| -c * x).sum();
        }
        let (row, first) = (self.right.len(), (k - 1) * (1 + NX + NS) + 1);
        self.entries.extend(coefficients.iter().enumerate().map(|(i, c)| (row, first + i, *c)));
        0.0
    }

    fn push(&mut self, entries: &[(usize, f64)], right: f64) {
        let row = self.right.len();
        self.entries.extend(entries.iter().map(|&(column, value)| (row, column, value)));
        self.right.push(right);
    }

    fn matrix(&self) -> CscMatrix<f64> {
        let column = |f: fn(&(usize, usize, f64)) -> usize| self.entries.iter().map(f).collect();
        let values = self.entries.iter().map(|e| e.2).collect();
        CscMatrix::new_from_triplets(self.right.len(), self.gradient.len(), column(|e| e.0), column(|e| e.1), values)
    }
}

/// A Clarabel solver for problems of one pattern.
pub struct Clarabel {
    solver: Option<DefaultSolver<f64>>,
    tolerance: f64,
}

impl Clarabel {
    /// A solver to this tolerance of gap and feasibility.
    pub fn new(tolerance: f64) -> Self {
        Self { solver: None, tolerance }
    }

    /// The inputs, and whether Clarabel calls them solved to its tolerance.
    pub fn solve<const NX: usize, const NS: usize>(&mut self, problem: &Problem<NX, NS>) -> (Vec<f64>, bool) {
        let program = Program::new(problem);
        let matrix = program.matrix();
        let solver = match self.solver.as_mut() {
            Some(solver) => {
                let updates = [
                    solver.update_P(&program.curvature),
                    solver.update_q(&program.gradient),
                    solver.update_A(&matrix.nzval),
                    solver.update_b(&program.right),
                ];
                assert!(updates.iter().all(Result::is_ok), "the pattern has changed");
                solver
            }
            None => self.solver.insert(setup(&program, &matrix, self.tolerance)),
        };
        solver.solve();
        let inputs = solver.solution.x.chunks_exact(1 + NX + NS).map(|stage| stage[0]).collect();
        (inputs, solver.solution.status == SolverStatus::Solved)
    }
}

fn setup(program: &Program, matrix: &CscMatrix<f64>, tolerance: f64) -> DefaultSolver<f64> {
    let size = program.gradient.len();
    let indices: Vec<usize> = (0..size).collect();
    let curvature = CscMatrix::new_from_triplets(size, size, indices.clone(), indices, program.curvature.clone());
    let bounds = program.right.len() - program.equations;
    let cones: [SupportedConeT<f64>; 2] = [ZeroConeT(program.equations), NonnegativeConeT(bounds)];
    let settings = DefaultSettings {
        verbose: false,
        max_threads: 1,
        // Rows that it takes out could not be updated.
        presolve_enable: false,
        tol_gap_abs: tolerance,
        tol_gap_rel: tolerance,
        tol_feas: tolerance,
        ..DefaultSettings::default()
    };
    DefaultSolver::new(&curvature, &program.gradient, matrix, &program.right, &cones, settings)
        .expect("the matrices fit each other")
}
