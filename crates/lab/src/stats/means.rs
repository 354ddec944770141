//! Means and interquartile means of independent values, and differences of two lists.
//!
//! What the values are decides what an interval speaks of: values of episodes speak of further scenarios for the same policy, means of
//! training seeds ([`super::SeedScores`]) of further trainings.

use super::bootstrap::bootstrap_interval;
use super::distributions::student_quantile;
use super::{StatsError, checked};
use crate::metrics::Interval;

/// Number of values from which [`mean_interval`] uses the bootstrap; below, Student's t.
pub const BOOTSTRAP_MIN_COUNT: usize = 100;

/// The mean of independent values with its 95 % interval: Student's t below [`BOOTSTRAP_MIN_COUNT`] values, else BCa.
///
/// # Errors
/// If there are fewer than 2 values, or one is not finite.
pub fn mean_interval(values: &[f64]) -> Result<Interval, StatsError> {
    if values.len() < BOOTSTRAP_MIN_COUNT { t_interval(values) } else { bootstrap_interval(values) }
}

/// The mean of `first[i] - second[i]` with its 95 % interval, for two policies on the same scenarios or with the same seeds.
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

/// The mean of `first` as a share of the mean of `second` with its 95 % interval, for two policies on the same scenarios or with the same
/// seeds: the interval of the mean of `first[i] - ratio * second[i]`, which is zero, over the mean of `second` (the delta method).
///
/// A ratio of means and not a mean of ratios: a scenario in which there is hardly anything to gain would decide the latter.
///
/// # Errors
/// As [`paired_difference`]; also if the mean of `second` is zero.
pub fn paired_ratio(first: &[f64], second: &[f64]) -> Result<Interval, StatsError> {
    paired_difference(first, second)?;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let whole = mean(second);
    let ratio = mean(first) / whole;
    let scaled: Vec<f64> = first.iter().zip(second).map(|(a, b)| (a - ratio * b) / whole).collect();
    let Interval { low, high, .. } = mean_interval(&scaled)?;
    Ok(Interval { mean: ratio, low: ratio + low, high: ratio + high })
}

/// The mean of `first` minus that of `second`, drawn independently, with Welch's 95 % interval (Welch, 1947), which lets the variances
/// differ; the degrees of freedom are those of Satterthwaite (1946).
///
/// # Errors
/// If a list has fewer than 2 values, or one is not finite.
pub fn welch_difference(first: &[f64], second: &[f64]) -> Result<Interval, StatsError> {
    let moments = |values: &[f64]| {
        let (mean, variance) = mean_and_variance(checked(values)?);
        Ok::<_, StatsError>((mean, variance / values.len() as f64, (values.len() - 1) as f64))
    };
    let ((mean, error, freedom), (other_mean, other_error, other_freedom)) = (moments(first)?, moments(second)?);
    let (difference, both) = (mean - other_mean, error + other_error);
    if both == 0.0 {
        return Ok(Interval { mean: difference, low: difference, high: difference });
    }
    let freedom = both * both / (error * error / freedom + other_error * other_error / other_freedom);
    let half = student_quantile(freedom) * both.sqrt();
    Ok(Interval { mean: difference, low: difference - half, high: difference + half })
}

/// The mean with Student's t interval (Student, 1908): exact for normal values, from 2 on.
///
/// # Errors
/// If there are fewer than 2 values, or one is not finite.
pub fn t_interval(values: &[f64]) -> Result<Interval, StatsError> {
    let (mean, variance) = mean_and_variance(checked(values)?);
    let half = student_quantile((values.len() - 1) as f64) * (variance / values.len() as f64).sqrt();
    Ok(Interval { mean, low: mean - half, high: mean + half })
}

/// The interquartile mean (Agarwal et al., 2021): the mean of what is left when the lowest and the highest quarter of the values, rounded
/// down, are left out, as in their library. NaN if there are no values.
pub fn interquartile_mean(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let cut = sorted.len() / 4;
    mean(&sorted[cut..sorted.len() - cut])
}

/// The interquartile mean of independent values with the 95 % interval of Tukey and McLaughlin (1963): Student's t with the winsorized
/// standard error and as many degrees of freedom as values are kept, less one.
///
/// Of fewer than 4 values none is left out, and it is [`t_interval`]. At 4 and 5 values it is very wide, for 1 and 2 degrees of freedom
/// are left. For 5 values or more of a score that training seeds differ in.
///
/// # Errors
/// If there are fewer than 2 values, or one is not finite.
pub fn interquartile_mean_interval(values: &[f64]) -> Result<Interval, StatsError> {
    let mut sorted = checked(values)?.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (count, cut) = (sorted.len(), sorted.len() / 4);
    let kept = (count - 2 * cut) as f64;
    let middle = mean(&sorted[cut..count - cut]);
    let (lowest, highest) = (sorted[cut], sorted[count - cut - 1]);
    let winsorized: Vec<f64> = sorted.iter().map(|x| x.clamp(lowest, highest)).collect();
    let (_, variance) = mean_and_variance(&winsorized);
    let error = ((count - 1) as f64 * variance / (kept * (kept - 1.0))).sqrt();
    let half = student_quantile(kept - 1.0) * error;
    Ok(Interval { mean: middle, low: middle - half, high: middle + half })
}

/// The mean of the values; NaN if there are none.
pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Mean and sample variance.
fn mean_and_variance(values: &[f64]) -> (f64, f64) {
    let mean = mean(values);
    (mean, values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (values.len() - 1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::close;

    #[test]
    fn a_ratio_is_exact_where_the_pairs_are_proportional_and_has_no_unit() {
        let second = [4.0, 7.0, 9.5, 12.0, 6.5];
        let first = second.map(|x| 0.8 * x);
        let exact = paired_ratio(&first, &second).unwrap();
        for end in [exact.mean, exact.low, exact.high] {
            close(end, 0.8, 1e-12);
        }
        let first = [3.0, 6.5, 7.0, 11.0, 5.5];
        let (a, b) = (paired_ratio(&first, &second).unwrap(), paired_ratio(&first.map(|x| 3.0 * x), &second).unwrap());
        assert!(a.low < a.mean && a.mean < a.high);
        close(b.low, 3.0 * a.low, 1e-12);
        // Cochran (1977, eq. 6.13) gives the standard error of a ratio of means by the same residuals.
        let squares: f64 = first.iter().zip(second).map(|(x, y)| (x - a.mean * y) * (x - a.mean * y)).sum();
        let error = (squares / (5.0 * 4.0)).sqrt() / 7.8;
        close(a.high - a.mean, 2.776_445 * error, 1e-6);
        assert!(paired_ratio(&[1.0, 2.0], &[1.0, -1.0]).is_err());
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
        // The same data as two independent groups, as R prints its example `t.test(extra ~ group)`: -3.3654832 to 0.2054832.
        let welch = welch_difference(&first, &second).unwrap();
        close(welch.low, -3.365_483_2, 1e-6);
        close(welch.high, 0.205_483_2, 1e-6);
    }

    #[test]
    fn the_interquartile_mean_leaves_out_a_quarter_at_each_end() {
        assert_eq!(interquartile_mean(&[9.0, 1.0, 2.0, -50.0]), 1.5);
        assert_eq!(interquartile_mean(&[3.0, 1.0, 5.0]), 3.0);
        assert!(interquartile_mean(&[]).is_nan());
        // Winsorized to 3, 3, 3, 4, .., 8, 8, 8: SSD 42.5, 6 kept, so 5.5 ± 2.570582 √(42.5 / 30).
        let interval = interquartile_mean_interval(&[10.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 1.0]).unwrap();
        close(interval.mean, 5.5, 1e-12);
        close(interval.high - 5.5, 2.570_582 * (42.5_f64 / 30.0).sqrt(), 1e-5);
        let few = [1.0, 4.0, 2.0];
        assert_eq!(interquartile_mean_interval(&few).unwrap().low, t_interval(&[1.0, 2.0, 4.0]).unwrap().low);
    }

    #[test]
    fn an_outlier_moves_the_mean_but_not_the_interquartile_mean() {
        let values: Vec<f64> = (0..10).map(f64::from).collect();
        let mut spoilt = values.clone();
        spoilt[9] = 1e6;
        assert_eq!(interquartile_mean_interval(&values), interquartile_mean_interval(&spoilt));
        assert!(t_interval(&spoilt).unwrap().mean > 1e4);
    }

    #[test]
    fn wrong_input_is_refused() {
        for interval in [mean_interval, interquartile_mean_interval] {
            assert_eq!(interval(&[1.0]), Err(StatsError::TooFew { count: 1, min: 2 }));
            assert!(matches!(interval(&[1.0, f64::NAN]), Err(StatsError::NotFinite { index: 1, .. })));
        }
        assert_eq!(paired_difference(&[1.0], &[]), Err(StatsError::Unpaired { first: 1, second: 0 }));
        assert!(welch_difference(&[1.0, 2.0], &[1.0]).is_err());
        assert_eq!(welch_difference(&[2.0; 3], &[1.0; 2]).unwrap().high, 1.0);
    }
}
