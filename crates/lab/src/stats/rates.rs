//! Rates of rare events: shares of trials, and events per distance.
//!
//! A trial is an episode, and events of different trials are taken as independent. Where they are not, because the runs that drive them
//! differ, the intervals are too narrow: look at the rates of the runs alone, too.

use super::StatsError;
use super::distributions::{TAIL, beta_quantile, bisect, normal_quantile, poisson_cdf};
use crate::metrics::Interval;

/// Distance over which [`rate_per_1000_km`] counts, m.
const THOUSAND_KM_M: f64 = 1e6;

/// The rate of an event with its 95 % interval: Wilson's, and the rule of three where nothing or only events were seen.
///
/// # Errors
/// If there is no trial, or there are more events than trials.
pub fn rate_interval(events: usize, trials: usize) -> Result<Interval, StatsError> {
    Ok(with_rule_of_three(wilson_interval(events, trials)?, events, trials))
}

/// The rate of an event with its exact 95 % interval: that of Clopper and Pearson, and the rule of three where nothing or only events
/// were seen.
///
/// # Errors
/// If there is no trial, or there are more events than trials.
pub fn exact_rate_interval(events: usize, trials: usize) -> Result<Interval, StatsError> {
    Ok(with_rule_of_three(clopper_pearson_interval(events, trials)?, events, trials))
}

fn with_rule_of_three(interval: Interval, events: usize, trials: usize) -> Interval {
    if events == 0 {
        return Interval { high: rule_of_three(trials), ..interval };
    }
    if events == trials {
        return Interval { low: 1.0 - rule_of_three(trials), ..interval };
    }
    interval
}

/// The rate of an event with Wilson's score interval (Wilson, 1927), which covers 95 % on average over rates.
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

/// The rate of an event with the interval of Clopper and Pearson (1934), which covers at least 95 % whatever the rate.
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

/// The difference of two rates, each as events and trials, with Newcombe's 95 % interval from Wilson's of each rate (Newcombe, 1998,
/// method 10). It has a width also where neither has an event.
///
/// # Errors
/// If one has no trial, or more events than trials.
pub fn rate_difference(first: [usize; 2], second: [usize; 2]) -> Result<Interval, StatsError> {
    let (a, b) = (wilson_interval(first[0], first[1])?, wilson_interval(second[0], second[1])?);
    let mean = a.mean - b.mean;
    let low = mean - libm::hypot(a.mean - a.low, b.high - b.mean);
    let high = mean + libm::hypot(a.high - a.mean, b.mean - b.low);
    Ok(Interval { mean, low, high })
}

/// The one-sided 95 % upper bound of a rate when none of `trials` trials had the event: 3/n, at most 1 (Hanley and Lippman-Hand, 1983).
pub fn rule_of_three(trials: usize) -> f64 {
    (3.0 / trials as f64).min(1.0)
}

/// Events per 1 000 km, seen over `distance_m`, with Poisson's exact 95 % interval (Garwood, 1936); with no event, the rule of three.
///
/// # Errors
/// If the distance is not positive and finite.
pub fn rate_per_1000_km(events: usize, distance_m: f64) -> Result<Interval, StatsError> {
    if !(distance_m.is_finite() && distance_m > 0.0) {
        return Err(StatsError::Distance { distance_m });
    }
    let unit = THOUSAND_KM_M / distance_m;
    let [low, high] = poisson_limits(events as u64);
    Ok(Interval { mean: events as f64 * unit, low: low * unit, high: high * unit })
}

/// The limits of the expected number of events: of the lower, as many or more are seen with a chance of 2.5 %; of the upper, as few.
fn poisson_limits(events: u64) -> [f64; 2] {
    if events == 0 {
        return [0.0, 3.0];
    }
    let k = events as f64;
    let low = bisect(0.0, k, |mean| 1.0 - poisson_cdf(events - 1, mean) < TAIL);
    // Ten standard deviations and a constant for the smallest counts lie beyond any limit.
    let high = bisect(k, k + 10.0 * k.sqrt() + 10.0, |mean| poisson_cdf(events, mean) > TAIL);
    [low, high]
}

fn checked_rate(events: usize, trials: usize) -> Result<f64, StatsError> {
    if trials == 0 || events > trials {
        return Err(StatsError::Counts { events, trials });
    }
    Ok(events as f64 / trials as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::close;

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
    fn differences_of_rates_match_published_values() {
        // Newcombe (1998, comparison of eleven methods), table II, method 10.
        for (first, second, low, high) in [
            ([56, 70], [48, 80], 0.0524, 0.3339),
            ([9, 10], [3, 10], 0.1705, 0.8090),
            ([0, 20], [0, 10], -0.2775, 0.1611),
        ] {
            let difference = rate_difference(first, second).unwrap();
            close(difference.low, low, 6e-5);
            close(difference.high, high, 6e-5);
        }
        assert!(rate_difference([1, 0], [0, 1]).is_err());
    }

    #[test]
    fn limits_of_a_count_are_the_printed_ones() {
        // Garwood (1936), as in any table of exact Poisson limits; a table's last digit is rounded.
        for (events, low, high) in
            [(1, 0.0253, 5.572), (2, 0.242, 7.225), (5, 1.623, 11.668), (10, 4.795, 18.39), (100, 81.36, 121.63)]
        {
            let [l, h] = poisson_limits(events);
            close(l, low, 6e-3);
            close(h, high, 6e-3);
        }
        let rate = rate_per_1000_km(5, 2e6).unwrap();
        close(rate.mean, 2.5, 1e-12);
        close(rate.high, 11.668 / 2.0, 3e-3);
    }

    #[test]
    fn no_event_follows_the_rule_of_three() {
        let none = rate_interval(0, 5000).unwrap();
        assert_eq!((none.mean, none.low, none.high), (0.0, 0.0, 6e-4));
        assert_eq!(none, exact_rate_interval(0, 5000).unwrap());
        assert_eq!(rate_per_1000_km(0, 1.5e6).unwrap().high, 2.0);
        // The exact one-sided bound is 1 - 0.05^(1/n); 3/n is above it by less than 0.2 %.
        let exact = -libm::expm1(libm::log(0.05) / 5000.0);
        assert!(none.high > exact && none.high < 1.002 * exact);
        assert_eq!(rate_interval(2, 2).unwrap().low, 0.0);
        assert_eq!(rate_interval(300, 300).unwrap().low, 0.99);
    }

    #[test]
    fn wrong_input_is_refused() {
        assert_eq!(rate_interval(3, 2), Err(StatsError::Counts { events: 3, trials: 2 }));
        assert_eq!(wilson_interval(0, 0), Err(StatsError::Counts { events: 0, trials: 0 }));
        assert_eq!(rate_per_1000_km(1, 0.0), Err(StatsError::Distance { distance_m: 0.0 }));
        assert!(rate_per_1000_km(1, f64::NAN).is_err());
    }
}
