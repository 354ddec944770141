//! Distribution functions and quantiles that the intervals and sample sizes are made of.

/// Share of each tail of a two-sided 95 % interval.
pub(super) const TAIL: f64 = 0.025;

/// Distribution function of the standard normal.
pub(super) fn normal_cdf(z: f64) -> f64 {
    0.5 * libm::erfc(-z / core::f64::consts::SQRT_2)
}

/// Standard normal quantile, by bisection: only a few are needed.
pub(super) fn normal_quantile(p: f64) -> f64 {
    bisect(-10.0, 10.0, |z| normal_cdf(z) < p)
}

/// The 97.5 % quantile of Student's t: t² = ν (1/x - 1) with x a quantile of Beta(ν/2, 1/2).
pub(super) fn student_quantile(freedom: f64) -> f64 {
    let x = beta_quantile(2.0 * TAIL, freedom / 2.0, 0.5);
    (freedom * (1.0 / x - 1.0)).sqrt()
}

/// Probability that |T| exceeds `critical`, T being noncentral t: a normal of mean `shift` over the root of an independent χ²/ν.
///
/// The density of that root is integrated by Simpson's rule; beyond ten of its standard deviations nothing is left.
pub(super) fn noncentral_student_exceeds(critical: f64, freedom: f64, shift: f64) -> f64 {
    const STEPS: u32 = 2_000;
    let half = freedom / 2.0;
    let log_scale = core::f64::consts::LN_2 + half * libm::log(half) - libm::lgamma(half);
    let integrand = |s: f64| {
        let density = libm::exp(log_scale + (freedom - 1.0) * libm::log(s) - half * s * s);
        density * (normal_cdf(shift - critical * s) + normal_cdf(-shift - critical * s))
    };
    let end = 1.0 + 10.0 / freedom.sqrt();
    let width = end / f64::from(STEPS);
    // The density vanishes at zero, where its logarithm does not exist.
    let inner: f64 = (1..STEPS).map(|i| f64::from(2 + 2 * (i % 2)) * integrand(f64::from(i) * width)).sum();
    (inner + integrand(end)) * width / 3.0
}

/// Probability of at most `count` events where `mean` are expected, by Poisson's law.
pub(super) fn poisson_cdf(count: u64, mean: f64) -> f64 {
    let log_mean = libm::log(mean);
    (0..=count).map(|k| k as f64).map(|k| libm::exp(k * log_mean - mean - libm::lgamma(k + 1.0))).sum()
}

/// Quantile of Beta(a, b).
pub(super) fn beta_quantile(p: f64, a: f64, b: f64) -> f64 {
    bisect(0.0, 1.0, |x| beta_cdf(x, a, b) < p)
}

/// The point of [`low`, `high`] up to which `below` holds.
pub(super) fn bisect(mut low: f64, mut high: f64, below: impl Fn(f64) -> bool) -> f64 {
    // 64 halvings exhaust a double's digits on these ranges.
    for _ in 0..64 {
        let middle = 0.5 * (low + high);
        if below(middle) { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Regularized incomplete beta function I_x(a, b) (Abramowitz and Stegun 26.5.8, evaluated as Lentz, 1976).
fn beta_cdf(x: f64, a: f64, b: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return if x <= 0.0 { 0.0 } else { 1.0 };
    }
    // The fraction converges fast below the mean; above it, the symmetry I_x(a, b) = 1 - I_{1-x}(b, a) helps.
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - beta_cdf_below_mean(1.0 - x, b, a);
    }
    beta_cdf_below_mean(x, a, b)
}

fn beta_cdf_below_mean(x: f64, a: f64, b: f64) -> f64 {
    let log_beta = libm::lgamma(a) + libm::lgamma(b) - libm::lgamma(a + b);
    let front = libm::exp(a * libm::log(x) + b * libm::log1p(-x) - log_beta) / a;
    // A denominator of zero is replaced by a tiny number, as Lentz's method asks for.
    let guarded = |y: f64| if y.abs() < 1e-300 { 1e-300 } else { y };
    let mut d = 1.0 / guarded(1.0 - (a + b) * x / (a + 1.0));
    let (mut c, mut fraction) = (1.0, d);
    for m in 1..10_000 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        let mut change = 1.0;
        for term in [even, odd] {
            d = 1.0 / guarded(1.0 + term * d);
            c = guarded(1.0 + term / c);
            change = c * d;
            fraction *= change;
        }
        if (change - 1.0).abs() < 1e-15 {
            break;
        }
    }
    front * fraction
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::close;

    #[test]
    fn quantiles_match_printed_tables() {
        // Student (1908) tables as printed in any textbook, to three digits; normal to six.
        for (freedom, t) in [(1.0, 12.706), (2.0, 4.303), (9.0, 2.262), (29.0, 2.045), (120.0, 1.980)] {
            close(student_quantile(freedom), t, 5e-4);
        }
        close(normal_quantile(0.975), 1.959_964, 1e-6);
        close(normal_quantile(0.5), 0.0, 1e-12);
    }

    #[test]
    fn the_incomplete_beta_function_meets_its_closed_forms() {
        for x in [0.01, 0.3, 0.5, 0.8, 0.99] {
            close(beta_cdf(x, 1.0, 1.0), x, 1e-14);
            // One success or more in 7 trials.
            close(beta_cdf(x, 1.0, 7.0), 1.0 - (0..7).fold(1.0, |p, _| p * (1.0 - x)), 1e-13);
            close(beta_cdf(x, 3.5, 0.5) + beta_cdf(1.0 - x, 0.5, 3.5), 1.0, 1e-13);
        }
    }

    #[test]
    fn noncentral_t_without_a_shift_is_students_t() {
        for freedom in [2.0, 9.0, 120.0] {
            close(noncentral_student_exceeds(student_quantile(freedom), freedom, 0.0), 2.0 * TAIL, 1e-9);
        }
    }
}
