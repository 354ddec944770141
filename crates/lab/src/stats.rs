//! Intervals: means by Student's t or the bootstrap, paired differences, and rates of rare events.
//!
//! All intervals are two-sided at 95 %, but for rates with no event (or nothing else), where the one-sided bound is given.
//!
//! **Means.** Below [`BOOTSTRAP_MIN_COUNT`] values Student's t interval is used, from there on the bias-corrected and
//! accelerated bootstrap (BCa; Efron, 1987). The switch is a measurement. Share of 3000 samples whose interval held the mean:
//!
//! | values | normal, BCa | normal, t | exponential, BCa | exponential, t |
//! | ---: | ---: | ---: | ---: | ---: |
//! | 10 | 89.5 % | 94.6 % | 87.7 % | 90.5 % |
//! | 20 | 92.8 % | 95.3 % | 90.8 % | 91.5 % |
//! | 40 | 94.8 % | 95.6 % | 92.6 % | 93.2 % |
//! | 100 | 94.3 % | 94.7 % | 94.5 % | 94.2 % |
//!
//! So t covers better until about 100 values; from there BCa covers as well, and its ends are unequal where the data are skewed.
//!
//! **Rates.** Wilson's score interval (Wilson, 1927) covers 95 % on average; that of Clopper and Pearson (1934) covers at least
//! 95 % always and is wider. With no event in n trials, the rule of three (Hanley and Lippman-Hand, 1983) bounds the rate by 3/n.
//!
//! Equal input gives equal bits: the resamples come from one keyed stream, whatever was drawn before.

use crate::metrics::Interval;
use lanecraft_net::random::Stream;

/// Number of values from which [`mean_interval`] uses the bootstrap; below, Student's t.
pub const BOOTSTRAP_MIN_COUNT: usize = 100;

/// Number of resamples: the standard error of an end is then about 1 % of the interval's width.
const RESAMPLES: usize = 4000;

/// Share of each tail of a two-sided 95 % interval.
const TAIL: f64 = 0.025;

/// Why no interval can be given.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StatsError {
    /// Fewer values than an interval needs.
    #[error("an interval needs at least {min} values, but there are {count}")]
    TooFew {
        /// Number of values.
        count: usize,
        /// Smallest number allowed.
        min: usize,
    },
    /// A value that is infinite or not a number.
    #[error("value {index} is {value}, but must be finite")]
    NotFinite {
        /// Its index.
        index: usize,
        /// The value.
        value: f64,
    },
    /// Two lists that should be paired differ in length.
    #[error("paired values must be equally many, but there are {first} and {second}")]
    Unpaired {
        /// Length of the first list.
        first: usize,
        /// Length of the second list.
        second: usize,
    },
    /// More events than trials, or no trial.
    #[error("{events} events in {trials} trials: there must be at least 1 trial and no more events than trials")]
    Counts {
        /// Number of events.
        events: usize,
        /// Number of trials.
        trials: usize,
    },
}

/// The mean of independent values with its 95 % interval: Student's t below [`BOOTSTRAP_MIN_COUNT`] values, else BCa.
///
/// # Errors
/// If there are fewer than 2 values, or one is not finite.
pub fn mean_interval(values: &[f64]) -> Result<Interval, StatsError> {
    if values.len() < BOOTSTRAP_MIN_COUNT { t_interval(values) } else { bootstrap_interval(values) }
}

/// The mean of `first[i] - second[i]` with its 95 % interval, for two policies on the same scenarios.
///
/// # Errors
/// If the lists differ in length, have fewer than 2 values, or a difference is not finite.
pub fn paired_difference(first: &[f64], second: &[f64]) -> Result<Interval, StatsError> {
    if first.len() != second.len() {
        return Err(StatsError::Unpaired { first: first.len(), second: second.len() });
    }
    let differences: Vec<f64> = first.iter().zip(second).map(|(a, b)| a - b).collect();
    mean_interval(&differences)
}

/// The mean with Student's t interval: exact for normal values.
///
/// # Errors
/// If there are fewer than 2 values, or one is not finite.
pub fn t_interval(values: &[f64]) -> Result<Interval, StatsError> {
    let mean = checked_mean(values)?;
    let freedom = (values.len() - 1) as f64;
    let variance = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / freedom;
    let half = student_quantile(freedom) * (variance / values.len() as f64).sqrt();
    Ok(Interval { mean, low: mean - half, high: mean + half })
}

/// The mean with its bias-corrected and accelerated bootstrap interval (Efron, 1987).
///
/// # Errors
/// If there are fewer than 2 values, or one is not finite.
pub fn bootstrap_interval(values: &[f64]) -> Result<Interval, StatsError> {
    let mean = checked_mean(values)?;
    if values.iter().all(|x| *x == values[0]) {
        return Ok(Interval { mean, low: mean, high: mean });
    }
    let means = resampled_means(values);
    // Resamples equal to the mean count half, so that rates and other data with ties get no spurious bias.
    let below = means.partition_point(|x| *x < mean);
    let up_to = means.partition_point(|x| *x <= mean);
    let share = (below + up_to) as f64 / (2 * RESAMPLES) as f64;
    let bias = normal_quantile(share.clamp(0.5 / RESAMPLES as f64, 1.0 - 0.5 / RESAMPLES as f64));
    // The jackknife's acceleration; for a mean the left-out means are known in closed form.
    let power_sum = |n: i32| values.iter().map(|x| (0..n).fold(1.0, |p, _| p * (x - mean))).sum::<f64>();
    let squares = power_sum(2);
    let acceleration = power_sum(3) / (6.0 * squares * squares.sqrt());
    let end = |tail: f64| {
        let z = bias + normal_quantile(tail);
        let share = normal_cdf(bias + z / (1.0 - acceleration * z));
        means[((share * RESAMPLES as f64) as usize).min(RESAMPLES - 1)]
    };
    Ok(Interval { mean, low: end(TAIL), high: end(1.0 - TAIL) })
}

/// The rate of an event with its 95 % interval: Wilson's, and the rule of three where nothing or only events were seen.
///
/// # Errors
/// If there is no trial, or there are more events than trials.
pub fn rate_interval(events: usize, trials: usize) -> Result<Interval, StatsError> {
    let wilson = wilson_interval(events, trials)?;
    if events == 0 {
        return Ok(Interval { high: rule_of_three(trials), ..wilson });
    }
    if events == trials {
        return Ok(Interval { low: 1.0 - rule_of_three(trials), ..wilson });
    }
    Ok(wilson)
}

/// The rate of an event with Wilson's score interval.
///
/// # Errors
/// If there is no trial, or there are more events than trials.
pub fn wilson_interval(events: usize, trials: usize) -> Result<Interval, StatsError> {
    let rate = checked_rate(events, trials)?;
    let n = trials as f64;
    let z = normal_quantile(1.0 - TAIL);
    let shrink = 1.0 + z * z / n;
    let center = (rate + z * z / (2.0 * n)) / shrink;
    let half = z * (rate * (1.0 - rate) / n + z * z / (4.0 * n * n)).sqrt() / shrink;
    // Rounding must not push an end past a rate of exactly 0 or 1.
    let low = if events == 0 { 0.0 } else { center - half };
    let high = if events == trials { 1.0 } else { center + half };
    Ok(Interval { mean: rate, low, high })
}

/// The rate of an event with the interval of Clopper and Pearson, which covers at least 95 % whatever the rate.
///
/// # Errors
/// If there is no trial, or there are more events than trials.
pub fn clopper_pearson_interval(events: usize, trials: usize) -> Result<Interval, StatsError> {
    let rate = checked_rate(events, trials)?;
    let (k, n) = (events as f64, trials as f64);
    let low = if events == 0 { 0.0 } else { beta_quantile(TAIL, k, n - k + 1.0) };
    let high = if events == trials { 1.0 } else { beta_quantile(1.0 - TAIL, k + 1.0, n - k) };
    Ok(Interval { mean: rate, low, high })
}

/// The 95 % upper bound of a rate when none of `trials` trials had the event: 3/n, at most 1.
pub fn rule_of_three(trials: usize) -> f64 {
    (3.0 / trials as f64).min(1.0)
}

fn checked_mean(values: &[f64]) -> Result<f64, StatsError> {
    if values.len() < 2 {
        return Err(StatsError::TooFew { count: values.len(), min: 2 });
    }
    if let Some((index, value)) = values.iter().enumerate().find(|(_, x)| !x.is_finite()) {
        return Err(StatsError::NotFinite { index, value: *value });
    }
    Ok(values.iter().sum::<f64>() / values.len() as f64)
}

fn checked_rate(events: usize, trials: usize) -> Result<f64, StatsError> {
    if trials == 0 || events > trials {
        return Err(StatsError::Counts { events, trials });
    }
    Ok(events as f64 / trials as f64)
}

/// Means of the resamples, sorted.
fn resampled_means(values: &[f64]) -> Vec<f64> {
    let mut stream = Stream::new(0, "stats.bootstrap");
    let n = values.len();
    let mut means: Vec<f64> =
        (0..RESAMPLES).map(|_| (0..n).map(|_| values[stream.below(n)]).sum::<f64>() / n as f64).collect();
    means.sort_by(f64::total_cmp);
    means
}

fn normal_cdf(z: f64) -> f64 {
    0.5 * libm::erfc(-z / core::f64::consts::SQRT_2)
}

/// Standard normal quantile, by bisection: only a few are needed.
fn normal_quantile(p: f64) -> f64 {
    bisect(-10.0, 10.0, |z| normal_cdf(z) < p)
}

/// The 97.5 % quantile of Student's t: t² = ν (1/x - 1) with x a quantile of Beta(ν/2, 1/2).
fn student_quantile(freedom: f64) -> f64 {
    let x = beta_quantile(2.0 * TAIL, freedom / 2.0, 0.5);
    (freedom * (1.0 / x - 1.0)).sqrt()
}

fn beta_quantile(p: f64, a: f64, b: f64) -> f64 {
    bisect(0.0, 1.0, |x| beta_cdf(x, a, b) < p)
}

/// The point of [`low`, `high`] up to which `below` holds.
fn bisect(mut low: f64, mut high: f64, below: impl Fn(f64) -> bool) -> f64 {
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

    fn close(actual: f64, expected: f64, tolerance: f64) {
        assert!((actual - expected).abs() <= tolerance, "{actual} is not within {tolerance} of {expected}");
    }

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
    fn rate_intervals_match_published_values() {
        // Newcombe (1998), table I: 81 of 263, 15 of 148, 0 of 20, 1 of 29; Wilson without, and Clopper-Pearson.
        let published = [
            (81, 263, [0.2553, 0.3662], [0.2527, 0.3676]),
            (15, 148, [0.0624, 0.1605], [0.0578, 0.1617]),
            (0, 20, [0.0, 0.1611], [0.0, 0.1684]),
            (1, 29, [0.0061, 0.1718], [0.0009, 0.1776]),
        ];
        for (events, trials, wilson, exact) in published {
            let w = wilson_interval(events, trials).unwrap();
            let e = clopper_pearson_interval(events, trials).unwrap();
            for (actual, expected) in [(w.low, wilson[0]), (w.high, wilson[1]), (e.low, exact[0]), (e.high, exact[1])] {
                close(actual, expected, 6e-5);
            }
        }
    }

    #[test]
    fn no_event_follows_the_rule_of_three() {
        let none = rate_interval(0, 5000).unwrap();
        assert_eq!((none.mean, none.low, none.high), (0.0, 0.0, 6e-4));
        // The exact one-sided bound is 1 - 0.05^(1/n); 3/n is above it by less than 0.2 %.
        let exact = -libm::expm1(libm::log(0.05) / 5000.0);
        assert!(none.high > exact && none.high < 1.002 * exact);
        assert_eq!(rate_interval(2, 2).unwrap().low, 0.0);
        assert_eq!(rate_interval(300, 300).unwrap().low, 0.99);
    }

    #[test]
    fn the_t_interval_of_the_sleep_data_is_the_printed_one() {
        // Student (1908), extra hours of sleep under two drugs: paired difference 1.58, 95 % interval 0.70 to 2.46.
        let first = [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0];
        let second = [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4];
        let difference = paired_difference(&second, &first).unwrap();
        close(difference.mean, 1.58, 1e-12);
        close(difference.low, 0.700_114, 1e-6);
        close(difference.high, 2.459_886, 1e-6);
    }

    #[test]
    fn the_bootstrap_is_reproducible_and_equivariant() {
        let mut stream = Stream::new(5, "test");
        let values: Vec<f64> = (0..50).map(|_| stream.normal()).collect();
        let shifted: Vec<f64> = values.iter().map(|x| 4.0 * x + 8.0).collect();
        let (a, b) = (bootstrap_interval(&values).unwrap(), bootstrap_interval(&shifted).unwrap());
        assert_eq!(a, bootstrap_interval(&values).unwrap());
        close(b.low, 4.0 * a.low + 8.0, 1e-12);
        close(b.high, 4.0 * a.high + 8.0, 1e-12);
        assert!(a.low < a.mean && a.mean < a.high);
        let constant = bootstrap_interval(&[2.5; 40]).unwrap();
        assert_eq!((constant.low, constant.high), (2.5, 2.5));
    }

    /// Share of `trials` samples of `count` values whose interval holds the mean.
    fn coverage(
        [trials, count]: [u64; 2],
        mean: f64,
        interval: impl Fn(&[f64]) -> Result<Interval, StatsError>,
        draw: impl Fn(&mut Stream) -> f64,
    ) -> f64 {
        let hits = (0..trials).filter(|trial| {
            let mut stream = Stream::keyed(1, "coverage", *trial, count);
            let values: Vec<f64> = (0..count).map(|_| draw(&mut stream)).collect();
            let i = interval(&values).unwrap();
            i.low <= mean && mean <= i.high
        });
        hits.count() as f64 / trials as f64
    }

    #[test]
    fn coverage_of_the_mean() {
        // The standard error of a share of 0.95 in 3000 is 0.4 %: 93 to 97 % is five of them to each side.
        let covered = coverage([3000, 10], 0.0, mean_interval, Stream::normal);
        assert!((0.93..=0.97).contains(&covered), "{covered}");
        // Here 1000 samples: the standard error is 0.7 %.
        let covered = coverage([1000, 100], 1.0, mean_interval, |s| -libm::log(1.0 - s.uniform()));
        assert!((0.92..=0.97).contains(&covered), "{covered}");
    }

    #[test]
    fn coverage_of_rates() {
        for (rate, events) in [(0.05, wilson_interval as fn(usize, usize) -> _), (0.05, clopper_pearson_interval)] {
            let interval = |values: &[f64]| events(values.iter().filter(|x| **x == 1.0).count(), values.len());
            let covered = coverage([3000, 200], rate, interval, |s| f64::from(u8::from(s.bernoulli(rate))));
            assert!((0.93..=0.99).contains(&covered), "{covered}");
        }
    }

    #[test]
    fn wrong_input_is_refused() {
        assert_eq!(mean_interval(&[1.0]), Err(StatsError::TooFew { count: 1, min: 2 }));
        assert!(matches!(mean_interval(&[1.0, f64::NAN]), Err(StatsError::NotFinite { index: 1, .. })));
        assert_eq!(paired_difference(&[1.0], &[]), Err(StatsError::Unpaired { first: 1, second: 0 }));
        assert_eq!(rate_interval(3, 2), Err(StatsError::Counts { events: 3, trials: 2 }));
        assert_eq!(wilson_interval(0, 0), Err(StatsError::Counts { events: 0, trials: 0 }));
    }
}
