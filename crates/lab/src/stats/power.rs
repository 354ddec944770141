//! How many values a comparison needs, before it is run: 80 % power at a two-sided level of 5 %.

use super::StatsError;
use super::distributions::{TAIL, noncentral_student_exceeds, normal_quantile, student_quantile};

/// The chance with which a difference that exists shall be found.
const POWER: f64 = 0.8;
/// Largest number of values that is answered; a difference that asks for more is out of reach.
const MAX_COUNT: usize = 1_000_000;

/// Seeds for each of two methods that find a difference of means with 80 % power by the two-sided t test for independent samples, where
/// the standard deviation between seeds is `sd_over_difference` times the difference. Exact for normal scores (noncentral t).
///
/// # Errors
/// If the ratio is not positive, or so large that more than a million seeds are needed.
pub fn seeds_per_method(sd_over_difference: f64) -> Result<usize, StatsError> {
    if sd_over_difference.is_nan() || sd_over_difference <= 0.0 {
        return Err(StatsError::Effect { value: sd_over_difference });
    }
    let finds = |count: usize| {
        let n = count as f64;
        let freedom = 2.0 * n - 2.0;
        noncentral_student_exceeds(student_quantile(freedom), freedom, (n / 2.0).sqrt() / sd_over_difference) >= POWER
    };
    // The normal approximation falls short by a few at most, so the search from there on is short.
    let z = normal_quantile(1.0 - TAIL) + normal_quantile(POWER);
    let start = 2.0 * (z * sd_over_difference) * (z * sd_over_difference);
    ((start as usize).max(2)..=MAX_COUNT)
        .find(|count| finds(*count))
        .ok_or(StatsError::Effect { value: sd_over_difference })
}

/// Episodes for each of two policies that find the difference of these two rates with 80 % power by the two-sided test of two proportions
/// (Fleiss, Levin and Paik, 2003, without the correction for continuity). Episodes of different policies are taken as independent.
///
/// # Errors
/// If a rate is not between 0 and 1, or the two are so close that more than a million episodes are needed.
pub fn episodes_per_policy(rate: f64, other_rate: f64) -> Result<usize, StatsError> {
    for value in [rate, other_rate] {
        if !(0.0..=1.0).contains(&value) {
            return Err(StatsError::Effect { value });
        }
    }
    let variance = |p: f64| p * (1.0 - p);
    let difference = rate - other_rate;
    let root = normal_quantile(1.0 - TAIL) * (2.0 * variance(f64::midpoint(rate, other_rate))).sqrt()
        + normal_quantile(POWER) * (variance(rate) + variance(other_rate)).sqrt();
    let count = (root * root / (difference * difference)).ceil();
    if count <= MAX_COUNT as f64 { Ok((count as usize).max(2)) } else { Err(StatsError::Effect { value: difference }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_those_of_the_printed_tables() {
        // Cohen (1988), table 2.4.1: d = 4, 2, 1, 0.5 at a power of 0.8 and a two-sided level of 0.05.
        for (ratio, seeds) in [(0.25, 3), (0.5, 6), (1.0, 17), (2.0, 64)] {
            assert_eq!(seeds_per_method(ratio), Ok(seeds));
        }
        for wrong in [0.0, -1.0, f64::NAN, 1e9] {
            assert!(seeds_per_method(wrong).is_err());
        }
    }

    #[test]
    fn the_papers_fall_in_collisions_needs_over_a_thousand_episodes() {
        // 43.6 % fewer collisions than in 5 % of the episodes.
        assert_eq!(episodes_per_policy(0.05, 0.0282), Ok(1240));
        assert_eq!(episodes_per_policy(0.0282, 0.05), Ok(1240));
        for (a, b) in [(0.1, 0.1), (0.1, 1.1), (f64::NAN, 0.1)] {
            assert!(episodes_per_policy(a, b).is_err());
        }
    }
}
