//! The bootstrap (Efron, 1979): intervals from the spread of a statistic over resamples of the data.
//!
//! Equal input gives equal bits: the resamples come from one keyed stream, whatever was drawn before.

use lanecraft_net::random::Stream;

use super::distributions::{TAIL, normal_cdf, normal_quantile, student_quantile};
use super::means::mean;
use super::{StatsError, checked};
use crate::metrics::Interval;

/// Number of resamples: the standard error of an end is then about 1 % of the interval's width.
const RESAMPLES: usize = 4000;

/// The mean with its bias-corrected and accelerated 95 % interval (Efron, 1987). One value is the unit that is resampled; from about
/// 100 values on it covers as it should.
///
/// # Errors
/// If there are fewer than 2 values, or one is not finite.
pub fn bootstrap_interval(values: &[f64]) -> Result<Interval, StatsError> {
    let mean = mean(checked(values)?);
    if values.iter().all(|x| *x == values[0]) {
        return Ok(Interval { mean, low: mean, high: mean });
    }
    let n = values.len();
    let means = sorted_resamples(|stream| (0..n).map(|_| values[stream.below(n)]).sum::<f64>() / n as f64);
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
        at_share(&means, normal_cdf(bias + z / (1.0 - acceleration * z)))
    };
    Ok(Interval { mean, low: end(TAIL), high: end(1.0 - TAIL) })
}

/// The expanded percentile interval (Hesterberg, 2015) of a statistic whose variance is known from `strata` groups of
/// `count` units each.
///
/// `statistic` is given the unit that is drawn for each place. A percentile interval of n units is too narrow by √((n - 1)/n), the
/// bootstrap's bias, and by t over z. Its tail is therefore Φ(-√(n/(n - 1)) t) with the degrees of freedom of these strata together.
pub(super) fn expanded_percentile(
    estimate: f64,
    [strata, count]: [usize; 2],
    statistic: impl Fn(&mut dyn FnMut() -> usize) -> f64,
) -> Interval {
    let resamples = sorted_resamples(|stream| statistic(&mut || stream.below(count)));
    let n = count as f64;
    let tail = normal_cdf(-(n / (n - 1.0)).sqrt() * student_quantile(strata as f64 * (n - 1.0)));
    Interval { mean: estimate, low: at_share(&resamples, tail), high: at_share(&resamples, 1.0 - tail) }
}

/// The statistic of each resample, in rising order.
fn sorted_resamples(statistic: impl Fn(&mut Stream) -> f64) -> Vec<f64> {
    let mut stream = Stream::new(0, "stats.bootstrap");
    let mut found: Vec<f64> = (0..RESAMPLES).map(|_| statistic(&mut stream)).collect();
    found.sort_by(f64::total_cmp);
    found
}

fn at_share(sorted: &[f64], share: f64) -> f64 {
    sorted[((share * sorted.len() as f64) as usize).min(sorted.len() - 1)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::close;

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
}
