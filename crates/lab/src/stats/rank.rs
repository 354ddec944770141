//! Comparisons that need only the order of values: the probability of improvement, and Spearman's test for a trend.

use lanecraft_net::random::Stream;
use serde::{Deserialize, Serialize};

use super::distributions::{TAIL, bisect, normal_quantile};
use super::{StatsError, checked};
use crate::metrics::Interval;

/// The probability that a value of the first group exceeds one of the second, ties counted half: Mann and Whitney's U over the number of
/// pairs (Mann and Whitney, 1947; Agarwal et al., 2021, who average it over tasks). NaN if a group is empty.
pub(super) fn superiority(first: &[f64], second: &[f64]) -> f64 {
    let half_wins =
        |a: &f64| second.iter().map(|b| f64::from(u8::from(a > b)) + f64::from(u8::from(a >= b))).sum::<f64>();
    first.iter().map(half_wins).sum::<f64>() / (2 * first.len() * second.len()) as f64
}

/// Newcombe's 95 % interval (2006, method 5) around such a probability, of groups of these sizes: all values that lie within 1.96 of
/// their own standard errors, with the variance of Hanley and McNeil (1982). Unlike a bootstrap it has a width even where all values of
/// one group exceed all of the other.
pub(super) fn superiority_interval(estimate: f64, [first, second]: [usize; 2]) -> Interval {
    let (m, n) = (first as f64, second as f64);
    let z = normal_quantile(1.0 - TAIL);
    let error = |p: f64| {
        let pairs = (1.0 - p) / (2.0 - p) + p / (1.0 + p);
        (p * (1.0 - p) * (1.0 + (f64::midpoint(m, n) - 1.0) * pairs) / (m * n)).sqrt()
    };
    let low = if estimate <= 0.0 { 0.0 } else { bisect(0.0, estimate, |p| estimate - p > z * error(p)) };
    let high = if estimate >= 1.0 { 1.0 } else { bisect(estimate, 1.0, |p| p - estimate <= z * error(p)) };
    Interval { mean: estimate, low, high }
}

/// Numbers of values up to which all orders are counted: 8! = 40 320.
const EXACT_MAX_COUNT: usize = 8;
/// Random orders beyond that: the standard error of a p-value of 0.05 is then 0.07 %.
const ORDERS: u32 = 100_000;

/// Spearman's test for a trend.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trend {
    /// Spearman's rank correlation, -1 to 1; equal values share their mean rank.
    pub rank_correlation: f64,
    /// Probability of a correlation as high or higher if there is no trend: small if `y` rises with `x`.
    pub p_rising: f64,
    /// Probability of a correlation as far from zero, to either side, if there is no trend.
    pub p_two_sided: f64,
}

/// Whether `y` rises or falls with `x` (Spearman, 1904). The p-values count permutations of `y`: all of them up to 8 values, from there on
/// 100 000 random ones and the one seen. One pair is the unit; pairs must be independent, for example one for each training seed.
///
/// # Errors
/// If the lists differ in length, have fewer than 3 values, a value is not finite, or a list has only one value.
pub fn spearman_trend(x: &[f64], y: &[f64]) -> Result<Trend, StatsError> {
    if x.len() != y.len() {
        return Err(StatsError::Unpaired { first: x.len(), second: y.len() });
    }
    if x.len() < 3 {
        return Err(StatsError::TooFew { count: x.len(), min: 3 });
    }
    let (x, mut y) = (centered_ranks(checked(x)?), centered_ranks(checked(y)?));
    let square = |ranks: &[i64]| ranks.iter().map(|r| r * r).sum::<i64>() as f64;
    let spread = (square(&x) * square(&y)).sqrt();
    if spread == 0.0 {
        return Err(StatsError::Constant);
    }
    let seen = covariance(&x, &y);
    let [mut orders, mut rising, mut either] = [0_u32; 3];
    let mut count = |y: &[i64]| {
        let found = covariance(&x, y);
        orders += 1;
        rising += u32::from(found >= seen);
        either += u32::from(found.abs() >= seen.abs());
    };
    if y.len() <= EXACT_MAX_COUNT {
        for_each_order(&mut y, 0, &mut count);
    } else {
        count(&y);
        let mut stream = Stream::new(0, "stats.spearman");
        for _ in 0..ORDERS {
            shuffle(&mut y, &mut stream);
            count(&y);
        }
    }
    let share = |of: u32| f64::from(of) / f64::from(orders);
    Ok(Trend { rank_correlation: seen as f64 / spread, p_rising: share(rising), p_two_sided: share(either) })
}

/// Twice the rank of each value less twice the mean rank: whole numbers also where equal values share a rank, so that sums are exact.
fn centered_ranks(values: &[f64]) -> Vec<i64> {
    let rank = |value: &f64| {
        let below = values.iter().filter(|x| *x < value).count() as i64;
        let up_to = values.iter().filter(|x| *x <= value).count() as i64;
        below + up_to - values.len() as i64
    };
    values.iter().map(rank).collect()
}

fn covariance(x: &[i64], y: &[i64]) -> i64 {
    x.iter().zip(y).map(|(a, b)| a * b).sum()
}

/// Calls `visit` with every order of `values[fixed..]`.
fn for_each_order(values: &mut [i64], fixed: usize, visit: &mut impl FnMut(&[i64])) {
    if fixed + 1 >= values.len() {
        return visit(values);
    }
    for other in fixed..values.len() {
        values.swap(fixed, other);
        for_each_order(values, fixed + 1, visit);
        values.swap(fixed, other);
    }
}

/// Fisher and Yates's shuffle (1938).
fn shuffle(values: &mut [i64], stream: &mut Stream) {
    for last in (1..values.len()).rev() {
        values.swap(last, stream.below(last + 1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::close;

    #[test]
    fn superiority_counts_pairs_and_halves_ties() {
        assert_eq!(superiority(&[1.0, 3.0], &[2.0, 3.0]), (0.0 + 1.5) / 4.0);
        let (a, b) = ([5.0, 7.0, 7.5], [4.0, 7.0]);
        close(superiority(&a, &b) + superiority(&b, &a), 1.0, 1e-15);
    }

    #[test]
    fn full_separation_leaves_doubt_that_shrinks_with_the_groups() {
        let low = |n| superiority_interval(1.0, [n, n]).low;
        assert!(low(3) < 0.6 && low(10) > 0.75 && low(100) > 0.97);
        assert_eq!(superiority_interval(1.0, [5, 5]).high, 1.0);
        // Swapped groups give the mirrored interval.
        let (a, b) = (superiority_interval(0.7, [10, 6]), superiority_interval(0.3, [6, 10]));
        close(a.low, 1.0 - b.high, 1e-12);
        close(a.high, 1.0 - b.low, 1e-12);
    }

    #[test]
    fn a_trend_has_the_exact_p_value() {
        // A strict rise is one of n! orders.
        let rise = spearman_trend(&[1.0, 2.0, 4.0, 6.0, 9.0], &[0.1, 0.2, 0.3, 0.4, 0.5]).unwrap();
        assert_eq!(rise, Trend { rank_correlation: 1.0, p_rising: 1.0 / 120.0, p_two_sided: 2.0 / 120.0 });
        // Zar (1972), table of critical values, n = 7: a correlation of 0.714 or more has a one-sided chance of 0.044.
        let seven: Vec<f64> = (1..=7).map(f64::from).collect();
        let mixed = spearman_trend(&seven, &[2.0, 1.0, 5.0, 3.0, 4.0, 7.0, 6.0]).unwrap();
        assert!(mixed.rank_correlation > 0.714 && mixed.p_rising < 0.044);
    }

    #[test]
    fn random_orders_agree_with_the_normal_limit() {
        // No trend in these 40 values by construction: y mirrors within each half.
        let x: Vec<f64> = (0..40).map(f64::from).collect();
        let y: Vec<f64> = (0..40).map(|i: i32| f64::from((i % 20 - 10).abs())).collect();
        let trend = spearman_trend(&x, &y).unwrap();
        let z = trend.rank_correlation * 39.0_f64.sqrt();
        close(trend.p_rising, crate::stats::distributions::normal_cdf(-z), 0.02);
        assert_eq!(trend, spearman_trend(&x, &y).unwrap());
    }

    #[test]
    fn wrong_input_is_refused() {
        assert_eq!(spearman_trend(&[1.0; 3], &[1.0, 2.0, 3.0]), Err(StatsError::Constant));
        assert!(spearman_trend(&[1.0, 2.0], &[1.0, 2.0]).is_err());
        assert!(spearman_trend(&[1.0, 2.0, f64::NAN], &[1.0, 2.0, 3.0]).is_err());
        assert!(spearman_trend(&[1.0, 2.0, 3.0], &[1.0, 2.0]).is_err());
    }
}
