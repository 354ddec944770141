//! The loss of one error, and whether numbers are finite.

/// Loss of Huber (1964): quadratic up to `delta`, then linear.
pub(crate) fn huber(error: f32, delta: f32) -> f32 {
    let size = error.abs();
    if size <= delta { 0.5 * error * error } else { delta * (size - 0.5 * delta) }
}

/// Its derivative. Written so that NaN stays NaN.
pub(crate) fn clip(error: f32, delta: f32) -> f32 {
    if error > delta {
        delta
    } else if error < -delta {
        -delta
    } else {
        error
    }
}

/// Whether all values are finite, by the largest magnitude as integer bits, which vectorizes.
pub(crate) fn all_finite(values: &[f32]) -> bool {
    values.iter().fold(0, |largest, value| largest.max(value.to_bits() & 0x7FFF_FFFF)) < f32::INFINITY.to_bits()
}

#[cfg(test)]
mod tests {
    use super::{all_finite, clip, huber};

    #[test]
    fn the_loss_is_huber_s_with_its_derivative() {
        for error in [-3.0_f32, -1.0, -0.4, 0.0, 0.7, 2.5] {
            let step = 1.0 / 256.0;
            let numeric = (huber(error + step, 1.0) - huber(error - step, 1.0)) / (2.0 * step);
            assert!((numeric - clip(error, 1.0)).abs() < 3e-3, "at {error}");
        }
        assert!(clip(f32::NAN, 1.0).is_nan());
        assert!(all_finite(&[0.0, -1e38]) && !all_finite(&[0.0, f32::NAN]) && !all_finite(&[f32::NEG_INFINITY]));
    }
}
