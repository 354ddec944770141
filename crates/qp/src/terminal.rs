//! The terminal weight that stands for all the time after the horizon.

use crate::linalg::{Matrix, Vector};
use crate::riccati::backward_step;

/// Steps of the recursion at most: a mode that decays by less than 0.5 % a step has not settled by then.
const STEPS: u32 = 10_000;
/// Change of a step, relative to the largest entry, that counts as none: rounding keeps a few hundred times 1e-16 alive.
const SETTLED: f64 = 1e-13;

/// T for [`crate::Problem::terminal_weight`] with which a problem costs what it would cost on an infinite horizon under the last
/// stage's A, B, Q and R, as long as no constraint is active after the horizon: P − Q, where P solves the discrete algebraic Riccati
/// equation P = Q + A'P A − A'P B (R + B'P B)⁻¹ B'P A.
///
/// P is the fixed point of the Riccati recursion (docs/qp.md, Eq. 3), begun at 0. `None` if it does not settle: some state that
/// costs neither decays nor can be moved by the input, or a number is not finite.
pub fn infinite_horizon_weight<const NX: usize>(
    a: &[[f64; NX]; NX],
    b: &[f64; NX],
    state_weight: &[f64; NX],
    input_weight: f64,
) -> Option<[[f64; NX]; NX]> {
    let mut terminal = [[0.0; NX]; NX];
    for _ in 0..STEPS {
        let next = backward_step((a, b), &with_diagonal(terminal, state_weight), input_weight).1;
        let (change, size) = distance(&next, &terminal);
        terminal = next;
        if !size.is_finite() {
            return None;
        }
        if change <= SETTLED * size {
            return Some(terminal);
        }
    }
    None
}

/// M + diag(weights).
#[allow(clippy::inline_always)] // as in `riccati.rs`, which calls it at each stage
#[inline(always)]
pub(crate) fn with_diagonal<const N: usize>(mut matrix: Matrix<N, N>, weights: &Vector<N>) -> Matrix<N, N> {
    for (i, weight) in weights.iter().enumerate() {
        matrix[i][i] += weight;
    }
    matrix
}

/// Largest difference of two entries, and the largest entry of the first; infinite if a number is not finite.
fn distance<const N: usize>(a: &Matrix<N, N>, b: &Matrix<N, N>) -> (f64, f64) {
    let (mut change, mut size) = (0.0_f64, 0.0_f64);
    for (a, b) in a.as_flattened().iter().zip(b.as_flattened()) {
        if !a.is_finite() {
            return (f64::INFINITY, f64::INFINITY);
        }
        change = change.max((a - b).abs());
        size = size.max(a.abs());
    }
    (change, size)
}
