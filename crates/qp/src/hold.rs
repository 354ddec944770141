//! Zero-order hold: the exact step of x' = A x + B u under a constant input.
//!
//! exp([[A, B], [0, 0]] h) = [[Φ, Γ], [0, 1]] with Φ = 1 + Z φ(Z), Γ = φ(Z) B h, Z = A h and φ(Z) = Σ Z^j / (j + 1)!.
//! The series is summed at h = dt / 2^s, where it is short; then the augmented matrix is squared s times
//! (scaling and squaring; Moler and Van Loan, 2003, method 3). The blocks are kept apart, so no size needs NX + NU.

use crate::linalg::{Matrix, product};

/// Terms of φ. The first one left out is below 2⁻¹⁴ / 15!, less than 1e-16, at the norm bound.
const TERMS: u32 = 14;
/// Bound of the norm of Z: half of 1 keeps the series short, and each halving costs one squaring.
const NORM_BOUND: f64 = 0.5;

/// Discrete (Φ, Γ) with x(t + dt) = Φ x(t) + Γ u for the continuous (A, B) and a constant u.
///
/// `a`, `b`: row by row, per second; `dt_s`: the step, s. NaN or infinite numbers give matrices of NaN.
pub fn zero_order_hold<const NX: usize, const NU: usize>(
    a: &[[f64; NX]; NX],
    b: &[[f64; NU]; NX],
    dt_s: f64,
) -> ([[f64; NX]; NX], [[f64; NU]; NX]) {
    let mut norm = row_sum_norm(a) * dt_s.abs();
    if !norm.is_finite() || !dt_s.is_finite() {
        return ([[f64::NAN; NX]; NX], [[f64::NAN; NU]; NX]);
    }
    let mut step_s = dt_s;
    let mut squarings = 0;
    while norm > NORM_BOUND {
        norm *= 0.5;
        step_s *= 0.5;
        squarings += 1;
    }
    let z = scaled(a, step_s);
    let phi = phi_series(&z);
    let mut transition = add_identity(product(&z, &phi));
    let mut input = product(&phi, &scaled(b, step_s));
    for _ in 0..squarings {
        input = add(&product(&transition, &input), &input);
        transition = product(&transition, &transition);
    }
    (transition, input)
}

/// φ(Z) by Horner's rule: 1 + Z/2 (1 + Z/3 (1 + ...)).
fn phi_series<const N: usize>(z: &Matrix<N, N>) -> Matrix<N, N> {
    let mut phi = add_identity([[0.0; N]; N]);
    for j in (2..=TERMS).rev() {
        phi = add_identity(scaled(&product(z, &phi), 1.0 / f64::from(j)));
    }
    phi
}

/// Largest row sum of magnitudes; NaN if any number is.
fn row_sum_norm<const N: usize>(a: &Matrix<N, N>) -> f64 {
    let mut norm = 0.0;
    for row in a {
        let sum: f64 = row.iter().map(|v| v.abs()).sum();
        if sum > norm || sum.is_nan() {
            norm = sum;
        }
    }
    norm
}

fn scaled<const N: usize, const M: usize>(a: &Matrix<N, M>, factor: f64) -> Matrix<N, M> {
    a.map(|row| row.map(|v| v * factor))
}

fn add<const N: usize, const M: usize>(a: &Matrix<N, M>, b: &Matrix<N, M>) -> Matrix<N, M> {
    let mut sum = *a;
    for i in 0..N {
        for j in 0..M {
            sum[i][j] += b[i][j];
        }
    }
    sum
}

fn add_identity<const N: usize>(mut a: Matrix<N, N>) -> Matrix<N, N> {
    for (i, row) in a.iter_mut().enumerate() {
        row[i] += 1.0;
    }
    a
}

#[cfg(test)]
mod tests {
    use super::zero_order_hold;

    #[test]
    fn of_a_double_integrator_is_its_closed_form() {
        let (transition, input) = zero_order_hold(&[[0.0, 1.0], [0.0, 0.0]], &[[0.0], [1.0]], 0.1);
        assert_eq!(transition, [[1.0, 0.1], [0.0, 1.0]]);
        assert!((input[0][0] - 0.005).abs() < 1e-17 && (input[1][0] - 0.1).abs() < 1e-16);
    }
}
