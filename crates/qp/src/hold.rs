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

    /// Some rounding errors of numbers near 1.
    const ROUNDING: f64 = 1e-14;

    fn assert_near<const N: usize, const M: usize>(found: &[[f64; M]; N], expected: &[[f64; M]; N], tolerance: f64) {
        for (f, e) in found.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((f - e).abs() <= tolerance, "{found:?} is not {expected:?}");
        }
    }

    #[test]
    fn of_a_double_integrator_is_its_closed_form() {
        for dt in [0.01, 0.1, 0.5, 3.0, -0.2] {
            let (transition, input) = zero_order_hold(&[[0.0, 1.0], [0.0, 0.0]], &[[0.0], [1.0]], dt);
            assert_near(&transition, &[[1.0, dt], [0.0, 1.0]], ROUNDING);
            assert_near(&input, &[[0.5 * dt * dt], [dt]], ROUNDING);
        }
    }

    #[test]
    fn of_a_lag_is_its_exponential_from_slow_to_stiff() {
        for rate in [1e-9, 0.1, 3.0, 40.0, 900.0] {
            let (transition, input) = zero_order_hold(&[[-rate]], &[[2.0 * rate]], 0.05);
            let decay = libm::exp(-rate * 0.05);
            assert_near(&transition, &[[decay]], ROUNDING);
            assert_near(&input, &[[-2.0 * libm::expm1(-rate * 0.05)]], ROUNDING);
        }
    }

    #[test]
    fn of_an_oscillator_is_a_rotation() {
        let (frequency, dt) = (7.0, 0.9);
        let a = [[0.0, frequency], [-frequency, 0.0]];
        let (transition, input) = zero_order_hold(&a, &[[frequency, 0.0], [0.0, frequency]], dt);
        let (sin, cos) = libm::sincos(frequency * dt);
        assert_near(&transition, &[[cos, sin], [-sin, cos]], 10.0 * ROUNDING);
        assert_near(&input, &[[sin, 1.0 - cos], [cos - 1.0, sin]], 10.0 * ROUNDING);
    }

    /// Two short steps under one input are one long step.
    #[test]
    fn composes() {
        let a = [[-24.0, 0.1, -27.0], [0.3, 0.0, 1.0], [2.0, -0.5, -30.0]];
        let b = [[1.0, 0.2], [0.0, 3.0], [20.0, -1.0]];
        let (half, half_input) = zero_order_hold(&a, &b, 0.025);
        let (whole, whole_input) = zero_order_hold(&a, &b, 0.05);
        let (mut transition, mut input) = ([[0.0; 3]; 3], half_input);
        for i in 0..3 {
            for l in 0..3 {
                for j in 0..3 {
                    transition[i][j] += half[i][l] * half[l][j];
                }
                for j in 0..2 {
                    input[i][j] += half[i][l] * half_input[l][j];
                }
            }
        }
        assert_near(&whole, &transition, ROUNDING);
        assert_near(&whole_input, &input, ROUNDING);
    }

    #[test]
    fn of_what_is_not_a_number_is_not_a_number() {
        for bad in [f64::NAN, f64::INFINITY] {
            let (transition, input) = zero_order_hold(&[[bad, 1.0], [0.0, 0.0]], &[[0.0], [1.0]], 0.1);
            assert!(transition.as_flattened().iter().chain(input.as_flattened()).all(|v| v.is_nan()));
            assert!(zero_order_hold(&[[0.0]], &[[1.0]], bad).1[0][0].is_nan());
        }
    }
}
