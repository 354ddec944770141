//! What makes a problem unusable, found before any arithmetic is done with it.

use crate::linalg::Matrix;
use crate::mirror::Sameness;
use crate::problem::{Problem, Row, Stage};

/// A field of the problem, as named in [`Problem`], [`Stage`] and [`Row`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Field {
    /// [`Problem::initial_state`]
    InitialState,
    /// [`Problem::input_min`] and [`Problem::input_max`]
    InputBounds,
    /// [`Problem::terminal_weight`]
    TerminalWeight,
    /// [`Stage::a`]
    A,
    /// [`Stage::b`]
    B,
    /// [`Stage::c`]
    C,
    /// [`Stage::state_weight`]
    StateWeight,
    /// [`Stage::state_reference`]
    StateReference,
    /// [`Stage::input_weight`]
    InputWeight,
    /// [`Stage::input_reference`]
    InputReference,
    /// [`Row::state`] of the row with this index
    RowState(usize),
    /// [`Row::input`] of the row with this index
    RowInput(usize),
    /// [`Row::lower`] and [`Row::upper`] of the row with this index
    RowBounds(usize),
    /// [`Row::l1_weight`] of the row with this index
    RowL1Weight(usize),
    /// [`Row::l2_weight`] of the row with this index
    RowL2Weight(usize),
}

/// Why a problem was refused. `stage` is 0 for the fields of the problem itself.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InvalidInput {
    /// The number of stages is not the horizon the solver was made for.
    #[error("the problem has {found} stages, but the solver was made for {expected}")]
    Horizon {
        /// Horizon of the solver.
        expected: usize,
        /// Stages of the problem.
        found: usize,
    },
    /// A number is NaN, or infinite where it must be finite.
    #[error("{field:?} of stage {stage} is NaN or infinite, but must be finite")]
    NotFinite {
        /// The field.
        field: Field,
        /// Its stage.
        stage: usize,
    },
    /// A number is below its range.
    #[error("{field:?} of stage {stage} is {value}, but must be above 0 (state and L1 weights: at least 0)")]
    NotPositive {
        /// The field.
        field: Field,
        /// Its stage.
        stage: usize,
        /// Its value.
        value: f64,
    },
    /// A matrix is not symmetric, or has a negative eigenvalue.
    #[error("{field:?} must be a symmetric matrix without negative eigenvalues")]
    Indefinite {
        /// The field.
        field: Field,
    },
    /// The two bounds are NaN, exclude each other, or are the same infinity.
    #[error(
        "{field:?} of stage {stage} are {lower} and {upper}, but must be lower <= upper, below +inf and above -inf"
    )]
    IllOrdered {
        /// The field.
        field: Field,
        /// Its stage.
        stage: usize,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
}

/// Share of its trace by which a terminal weight may be indefinite: rounding in the recursion that it comes from.
const DEFINITENESS_TOLERANCE: f64 = 1e-10;

/// Checks every number of `problem`; not those that are the `same` as in the last one, which was valid.
pub(crate) fn validate<const NX: usize, const NS: usize>(
    problem: &Problem<NX, NS>,
    horizon: usize,
    same: Sameness,
) -> Result<(), InvalidInput> {
    if problem.stages.len() != horizon {
        return Err(InvalidInput::Horizon { expected: horizon, found: problem.stages.len() });
    }
    finite(&problem.initial_state, Field::InitialState, 0)?;
    ordered(problem.input_min, problem.input_max, Field::InputBounds, 0)?;
    if !same.matrices {
        finite(problem.terminal_weight.as_flattened(), Field::TerminalWeight, 0)?;
        if !is_semidefinite(problem.terminal_weight) {
            return Err(InvalidInput::Indefinite { field: Field::TerminalWeight });
        }
    }
    let mut taint = Taint::default();
    let mut valid = true;
    for stage in &problem.stages {
        valid &= same.matrices || has_valid_matrices(stage, &mut taint);
        valid &= has_valid_vectors(stage, &mut taint);
        valid &= same.rows || has_valid_rows(stage, &mut taint);
    }
    if valid && taint.is_clean() {
        return Ok(());
    }
    problem.stages.iter().enumerate().try_for_each(|(k, stage)| validate_stage(stage, k))
}

/// Sums of zero times each number: 0 if all are finite, NaN otherwise. Four of them, so that they do not wait for each other.
#[derive(Default)]
struct Taint([f64; 4]);

impl Taint {
    fn add<const N: usize>(&mut self, values: &[f64; N]) {
        for (i, v) in values.iter().enumerate() {
            self.0[i % 4] += v * 0.0;
        }
    }

    fn is_clean(&self) -> bool {
        self.0 == [0.0; 4]
    }
}

/// The answer of [`validate_stage`] without its reason and nearly without branches, together with the next two: all stages
/// of all problems pass here.
fn has_valid_matrices<const NX: usize, const NS: usize>(stage: &Stage<NX, NS>, taint: &mut Taint) -> bool {
    for line in &stage.a {
        taint.add(line);
    }
    taint.add(&stage.b);
    taint.add(&stage.state_weight);
    taint.add(&[stage.input_weight]);
    let mut valid = stage.input_weight > 0.0;
    for weight in &stage.state_weight {
        valid &= *weight >= 0.0;
    }
    valid
}

fn has_valid_rows<const NX: usize, const NS: usize>(stage: &Stage<NX, NS>, taint: &mut Taint) -> bool {
    let mut valid = true;
    for row in &stage.rows {
        taint.add(&row.state);
        taint.add(&[row.input, row.l1_weight, row.l2_weight]);
        valid &= row.l1_weight >= 0.0;
        valid &= row.l2_weight > 0.0;
    }
    valid
}

fn has_valid_vectors<const NX: usize, const NS: usize>(stage: &Stage<NX, NS>, taint: &mut Taint) -> bool {
    taint.add(&stage.c);
    taint.add(&stage.state_reference);
    taint.add(&[stage.input_reference]);
    let mut valid = true;
    for row in &stage.rows {
        // The difference of two equal infinities is not a number, and that of two unequal ones of the wrong order negative.
        valid &= row.upper - row.lower >= 0.0;
    }
    valid
}

/// Whether elimination meets no pivot below zero, but for rounding.
// Indices as in the elimination.
#[allow(clippy::needless_range_loop)]
fn is_semidefinite<const N: usize>(mut matrix: Matrix<N, N>) -> bool {
    let trace: f64 = (0..N).map(|i| matrix[i][i]).sum();
    let tolerance = DEFINITENESS_TOLERANCE * trace;
    for i in 0..N {
        let pivot = matrix[i][i];
        for j in i + 1..N {
            // A semidefinite matrix has m_ij² ≤ m_ii m_jj: next to a pivot of 0, zeros.
            let most = tolerance * matrix[j][j].max(tolerance);
            let stray = matrix[i][j] != matrix[j][i] || (pivot <= tolerance && matrix[i][j] * matrix[i][j] > most);
            if stray {
                return false;
            }
        }
        if pivot < -tolerance || tolerance < 0.0 {
            return false;
        }
        if pivot > tolerance {
            for j in i + 1..N {
                let factor = matrix[i][j] / pivot;
                for l in j..N {
                    matrix[j][l] -= factor * matrix[i][l];
                    matrix[l][j] = matrix[j][l];
                }
            }
        }
    }
    true
}

fn validate_stage<const NX: usize, const NS: usize>(stage: &Stage<NX, NS>, k: usize) -> Result<(), InvalidInput> {
    finite(stage.a.as_flattened(), Field::A, k)?;
    finite(&stage.b, Field::B, k)?;
    finite(&stage.c, Field::C, k)?;
    finite(&stage.state_weight, Field::StateWeight, k)?;
    if let Some(&value) = stage.state_weight.iter().find(|w| **w < 0.0) {
        return Err(InvalidInput::NotPositive { field: Field::StateWeight, stage: k, value });
    }
    finite(&stage.state_reference, Field::StateReference, k)?;
    positive(stage.input_weight, Field::InputWeight, k)?;
    finite(&[stage.input_reference], Field::InputReference, k)?;
    stage.rows.iter().enumerate().try_for_each(|(i, row)| validate_row(row, i, k))
}

fn validate_row<const NX: usize>(row: &Row<NX>, i: usize, k: usize) -> Result<(), InvalidInput> {
    finite(&row.state, Field::RowState(i), k)?;
    finite(&[row.input], Field::RowInput(i), k)?;
    ordered(row.lower, row.upper, Field::RowBounds(i), k)?;
    finite(&[row.l1_weight], Field::RowL1Weight(i), k)?;
    if row.l1_weight < 0.0 {
        return Err(InvalidInput::NotPositive { field: Field::RowL1Weight(i), stage: k, value: row.l1_weight });
    }
    positive(row.l2_weight, Field::RowL2Weight(i), k)
}

fn finite(values: &[f64], field: Field, stage: usize) -> Result<(), InvalidInput> {
    if values.iter().all(|v| v.is_finite()) { Ok(()) } else { Err(InvalidInput::NotFinite { field, stage }) }
}

fn positive(value: f64, field: Field, stage: usize) -> Result<(), InvalidInput> {
    finite(&[value], field, stage)?;
    if value > 0.0 { Ok(()) } else { Err(InvalidInput::NotPositive { field, stage, value }) }
}

fn ordered(lower: f64, upper: f64, field: Field, stage: usize) -> Result<(), InvalidInput> {
    if lower <= upper && lower < f64::INFINITY && upper > f64::NEG_INFINITY {
        Ok(())
    } else {
        Err(InvalidInput::IllOrdered { field, stage, lower, upper })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn semidefinite_matrices_are_told_from_others() {
        // Of rank one, with a first pivot of next to nothing.
        assert!(is_semidefinite([[1e-12, 1e-6], [1e-6, 1.0]]));
        assert!(is_semidefinite([[0.0, 0.0], [0.0, 1.0]]) && is_semidefinite([[0.0; 2]; 2]));
        assert!(!is_semidefinite([[0.0, 1e-3], [1e-3, 1.0]]));
        assert!(!is_semidefinite([[1.0, 2.0], [2.0, 1.0]]));
        assert!(!is_semidefinite([[1.0, 0.5], [0.4, 1.0]]));
    }
}
