//! The numbers of a problem in the order in which the sweeps read them, and what of them is new since the last solve.

use crate::linalg::{Matrix, Vector, smaller};
use crate::problem::{Problem, Row, Stage};
use crate::riccati::TOLERANCE;

/// What of a problem has the bits of the last one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sameness {
    /// A, B, Q, R and the terminal weight: what the factorization follows from.
    pub(crate) matrices: bool,
    /// C, D and the slack weights: what, together with the factorization, the responses and the factor of M follow from.
    pub(crate) rows: bool,
}

impl Sameness {
    pub(crate) const NONE: Self = Self { matrices: false, rows: false };

    pub(crate) fn is_whole(self) -> bool {
        self.matrices && self.rows
    }
}

/// Bits in which numbers differ, collected in two words so that they are compared in pairs.
#[derive(Default)]
struct Difference([u64; 2]);

impl Difference {
    fn add<const N: usize>(&mut self, a: &[f64; N], b: &[f64; N]) {
        for i in 0..N {
            self.0[i % 2] |= a[i].to_bits() ^ b[i].to_bits();
        }
    }

    fn is_none(&self) -> bool {
        self.0 == [0; 2]
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
    /// D, w1 and w2.
    row_numbers: Matrix<NS, 3>,
}

/// The numbers of a row that stand with its C.
fn numbers<const NX: usize>(row: &Row<NX>) -> [f64; 3] {
    [row.input, row.l1_weight, row.l2_weight]
}

impl<const NX: usize, const NS: usize> Key<NX, NS> {
    const ZERO: Self = Self {
        a: [[0.0; NX]; NX],
        b: [0.0; NX],
        state_weight: [0.0; NX],
        input_weight: 0.0,
        row_states: [[0.0; NX]; NS],
        row_numbers: [[0.0; 3]; NS],
    };

    fn stage(&self) -> Stage<NX, NS> {
        let row = |i: usize| {
            let [input, l1_weight, l2_weight] = self.row_numbers[i];
            Row { state: self.row_states[i], input, l1_weight, l2_weight, ..Row::unbounded() }
        };
        Stage {
            a: self.a,
            b: self.b,
            state_weight: self.state_weight,
            input_weight: self.input_weight,
            rows: core::array::from_fn(row),
            ..Stage::neutral()
        }
    }

    fn compare_matrices(&self, stage: &Stage<NX, NS>, difference: &mut Difference) {
        for (line, other) in self.a.iter().zip(&stage.a) {
            difference.add(line, other);
        }
        difference.add(&self.b, &stage.b);
        difference.add(&self.state_weight, &stage.state_weight);
        difference.add(&[self.input_weight], &[stage.input_weight]);
    }

    fn compare_rows(&self, stage: &Stage<NX, NS>, difference: &mut Difference) {
        for (i, row) in stage.rows.iter().enumerate() {
            difference.add(&self.row_states[i], &row.state);
            difference.add(&self.row_numbers[i], &numbers(row));
        }
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
    /// Violation of each row that counts as none because it is that small beside both bounds.
    pub(crate) rounding: [f64; NS],
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
        rounding: [0.0; NS],
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
            self.rounding[i] = TOLERANCE * smaller(row.lower.abs(), row.upper.abs());
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

    /// Whether there is a last problem.
    pub(crate) fn is_valid(&self) -> bool {
        self.valid
    }

    pub(crate) fn forget(&mut self) {
        self.valid = false;
    }

    /// The last problem, if there is one: what stands in its matrices and rows, and neutral numbers for all else.
    pub(crate) fn problem(&self) -> Option<Problem<NX, NS>> {
        let stages = self.keys.iter().map(Key::stage).collect();
        self.valid.then(|| Problem { terminal_weight: self.terminal_weight, stages, ..Problem::new(0) })
    }

    /// Compares `problem` with the last one, bit by bit.
    pub(crate) fn compare(&self, problem: &Problem<NX, NS>) -> Sameness {
        if !self.valid || self.keys.len() != problem.stages.len() {
            return Sameness::NONE;
        }
        let (mut matrices, mut rows) = (Difference::default(), Difference::default());
        for (line, other) in self.terminal_weight.iter().zip(&problem.terminal_weight) {
            matrices.add(line, other);
        }
        for (key, stage) in self.keys.iter().zip(&problem.stages) {
            key.compare_matrices(stage, &mut matrices);
            key.compare_rows(stage, &mut rows);
            if !matrices.is_none() {
                return Sameness::NONE;
            }
        }
        Sameness { matrices: true, rows: rows.is_none() }
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
                row_numbers: stage.rows.map(|row| numbers(&row)),
            };
        }
        self.valid = true;
    }
}
