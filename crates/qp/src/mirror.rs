//! The numbers of a problem in the order in which the sweeps read them, and what of them is new since the last solve.

use crate::linalg::{Matrix, Vector, differing_bits};
use crate::problem::{Problem, Stage};

/// What of a problem has the bits of the last one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sameness {
    /// A, B, Q, R and the terminal weight: what the factorization follows from.
    pub(crate) matrices: bool,
    /// C and D: what, together with the factorization, the responses follow from.
    pub(crate) rows: bool,
}

impl Sameness {
    pub(crate) const NONE: Self = Self { matrices: false, rows: false };

    pub(crate) fn is_whole(self) -> bool {
        self.matrices && self.rows
    }
}

/// Matrices of a stage as the caller gave them.
#[derive(Clone, Debug)]
struct Key<const NX: usize, const NS: usize> {
    a: Matrix<NX, NX>,
    b: Vector<NX>,
    state_weight: Vector<NX>,
    input_weight: f64,
    row_states: Matrix<NS, NX>,
    row_inputs: [f64; NS],
}

impl<const NX: usize, const NS: usize> Key<NX, NS> {
    const ZERO: Self = Self {
        a: [[0.0; NX]; NX],
        b: [0.0; NX],
        state_weight: [0.0; NX],
        input_weight: 0.0,
        row_states: [[0.0; NX]; NS],
        row_inputs: [0.0; NS],
    };

    fn matrix_difference(&self, stage: &Stage<NX, NS>) -> u64 {
        let mut difference = self.input_weight.to_bits() ^ stage.input_weight.to_bits();
        for (line, other) in self.a.iter().zip(&stage.a) {
            difference |= differing_bits(line, other);
        }
        difference | differing_bits(&self.b, &stage.b) | differing_bits(&self.state_weight, &stage.state_weight)
    }

    fn row_difference(&self, stage: &Stage<NX, NS>) -> u64 {
        let mut difference = 0;
        for (i, row) in stage.rows.iter().enumerate() {
            difference |= differing_bits(&self.row_states[i], &row.state);
            difference |= self.row_inputs[i].to_bits() ^ row.input.to_bits();
        }
        difference
    }
}

/// Stage k, with its rows side by side.
#[derive(Clone, Debug)]
pub(crate) struct StageMirror<const NX: usize, const NS: usize> {
    /// A by columns.
    pub(crate) a_columns: Matrix<NX, NX>,
    pub(crate) b: Vector<NX>,
    pub(crate) c: Vector<NX>,
    /// Q xr and R ur.
    pub(crate) state_pull: Vector<NX>,
    pub(crate) input_pull: f64,
    /// C by columns: the coefficients of one state in all rows.
    pub(crate) row_columns: Matrix<NX, NS>,
    pub(crate) row_inputs: [f64; NS],
    pub(crate) lower: [f64; NS],
    pub(crate) upper: [f64; NS],
}

impl<const NX: usize, const NS: usize> StageMirror<NX, NS> {
    const ZERO: Self = Self {
        a_columns: [[0.0; NX]; NX],
        b: [0.0; NX],
        c: [0.0; NX],
        state_pull: [0.0; NX],
        input_pull: 0.0,
        row_columns: [[0.0; NS]; NX],
        row_inputs: [0.0; NS],
        lower: [0.0; NS],
        upper: [0.0; NS],
    };

    fn copy_vectors(&mut self, stage: &Stage<NX, NS>) {
        self.c = stage.c;
        for i in 0..NX {
            self.state_pull[i] = stage.state_weight[i] * stage.state_reference[i];
        }
        self.input_pull = stage.input_weight * stage.input_reference;
        for (i, row) in stage.rows.iter().enumerate() {
            self.lower[i] = row.lower;
            self.upper[i] = row.upper;
        }
    }

    fn copy_matrices(&mut self, stage: &Stage<NX, NS>) {
        for i in 0..NX {
            for j in 0..NX {
                self.a_columns[j][i] = stage.a[i][j];
            }
        }
        self.b = stage.b;
        for (i, row) in stage.rows.iter().enumerate() {
            for j in 0..NX {
                self.row_columns[j][i] = row.state[j];
            }
            self.row_inputs[i] = row.input;
        }
    }
}

/// A problem as the sweeps read it.
#[derive(Clone, Debug)]
pub(crate) struct Mirror<const NX: usize, const NS: usize> {
    pub(crate) stages: Vec<StageMirror<NX, NS>>,
    keys: Vec<Key<NX, NS>>,
    terminal_weight: Matrix<NX, NX>,
    valid: bool,
}

impl<const NX: usize, const NS: usize> Mirror<NX, NS> {
    pub(crate) fn new(horizon: usize) -> Self {
        Self {
            stages: vec![StageMirror::ZERO; horizon],
            keys: vec![Key::ZERO; horizon],
            terminal_weight: [[0.0; NX]; NX],
            valid: false,
        }
    }

    pub(crate) fn forget(&mut self) {
        self.valid = false;
    }

    /// Compares `problem` with the last one, bit by bit.
    pub(crate) fn compare(&self, problem: &Problem<NX, NS>) -> Sameness {
        if !self.valid || self.keys.len() != problem.stages.len() {
            return Sameness::NONE;
        }
        let (mut matrices, mut rows) = (0, 0);
        for (line, other) in self.terminal_weight.iter().zip(&problem.terminal_weight) {
            matrices |= differing_bits(line, other);
        }
        for (key, stage) in self.keys.iter().zip(&problem.stages) {
            matrices |= key.matrix_difference(stage);
            rows |= key.row_difference(stage);
            if matrices != 0 {
                return Sameness::NONE;
            }
        }
        Sameness { matrices: true, rows: rows == 0 }
    }

    /// Takes the problem over; its matrices only where they are not the `same`.
    pub(crate) fn update(&mut self, problem: &Problem<NX, NS>, same: Sameness) {
        for (mirror, stage) in self.stages.iter_mut().zip(&problem.stages) {
            mirror.copy_vectors(stage);
        }
        if same.is_whole() {
            return;
        }
        self.terminal_weight = problem.terminal_weight;
        for ((mirror, key), stage) in self.stages.iter_mut().zip(&mut self.keys).zip(&problem.stages) {
            mirror.copy_matrices(stage);
            *key = Key {
                a: stage.a,
                b: stage.b,
                state_weight: stage.state_weight,
                input_weight: stage.input_weight,
                row_states: stage.rows.map(|row| row.state),
                row_inputs: stage.rows.map(|row| row.input),
            };
        }
        self.valid = true;
    }
}
