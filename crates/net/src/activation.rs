//! The logistic function and the hyperbolic tangent of f32, from operations that have the same bits on any processor and that fit
//! into vectors.
//!
//! Both rest on e^x = 2^k e^r with k = round(x / ln 2) and |r| ≤ ½ ln 2: Taylor's series of e^r up to r⁷, whose remainder is below 6·10⁻⁹
//! of it, and 2^k put together from its bits. tanh x = 2σ(2x) − 1 is right to about 10⁻⁷ in absolute terms, not in relative terms near zero.

// Must be inlined into the loops that `pulp` compiles for the processor's instruction set.
#![allow(clippy::inline_always)]

/// Adding this to a small f32 leaves its nearest integer in the lowest bits: 1.5 · 2²³.
const ROUNDER: f32 = 12_582_912.0;
/// ln 2, in a part whose products with k are exact and the rest.
const LN_2: [f32; 2] = [355.0 / 512.0, -2.121_944_4e-4];
/// Beyond this the logistic function is 0 or 1 to the last bit of f32, or nearly: e^−40 = 4·10⁻¹⁸.
const FAR: f32 = 40.0;
/// 1/n! for n = 7 down to 0.
const TAYLOR: [f32; 8] = [1.0 / 5040.0, 1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];

/// e^x for |x| ≤ 80; NaN stays NaN.
#[inline(always)]
fn exp(x: f32) -> f32 {
    let shifted = x * core::f32::consts::LOG2_E + ROUNDER;
    let k = shifted - ROUNDER;
    let r = x - k * LN_2[0] - k * LN_2[1];
    let mut sum = TAYLOR[0];
    for coefficient in &TAYLOR[1..] {
        sum = sum * r + coefficient;
    }
    // The exponent's bits of 2^k; 127 is their bias.
    sum * f32::from_bits((shifted.to_bits().wrapping_add(127)) << 23)
}

/// 1 / (1 + e^−x).
#[inline(always)]
pub(crate) fn logistic(x: f32) -> f32 {
    1.0 / (1.0 + exp((-x).clamp(-FAR, FAR)))
}

/// tanh x.
#[inline(always)]
pub(crate) fn tanh(x: f32) -> f32 {
    2.0 * logistic(2.0 * x) - 1.0
}

#[cfg(test)]
mod tests {
    use super::{logistic, tanh};

    #[test]
    fn both_are_those_of_libm_to_single_precision() {
        // Two roundings of f32 at values of at most 1 are 1.2e-7; tanh doubles the error of the logistic function.
        for step in -200_000..=200_000 {
            let x = step as f32 * 2.5e-4;
            let wide = f64::from(x);
            assert!((f64::from(logistic(x)) - 1.0 / (1.0 + libm::exp(-wide))).abs() < 1.5e-7, "{x}");
            assert!((f64::from(tanh(x)) - libm::tanh(wide)).abs() < 3e-7, "{x}");
        }
    }

    #[test]
    fn the_ends_are_flat_and_nan_is_passed_on() {
        assert_eq!((logistic(f32::INFINITY), tanh(1e30), tanh(f32::NEG_INFINITY)), (1.0, 1.0, -1.0));
        assert!(logistic(f32::NEG_INFINITY) < 1e-17);
        assert_eq!((tanh(0.0), logistic(0.0)), (0.0, 0.5));
        assert!(tanh(f32::NAN).is_nan() && logistic(f32::NAN).is_nan());
    }
}
