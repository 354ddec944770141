//! Intervals and tests for experiments: means, rates of rare events, comparisons of methods over training seeds, trends, sample sizes.
//!
//! All intervals are two-sided at 95 %, but for rates with no event (or nothing else), where the one-sided bound is given.
//!
//! | question | function | unit |
//! | --- | --- | --- |
//! | how well a policy drives | [`mean_interval`], [`paired_difference`] | the episode |
//! | how well a method trains | [`SeedScores::mean`], [`SeedScores::interquartile_mean`], [`SeedScores::profile`] | the training seed |
//! | which of two methods is better | [`SeedScores::difference`], [`SeedScores::probability_of_improvement`] | the training seed |
//! | the same over tasks with trainings of their own | [`SeedScores::stratified`], [`SeedScores::improvement_over_tasks`] | the training |
//! | how often it collides | [`rate_interval`], [`exact_rate_interval`], [`rate_difference`], [`rate_per_1000_km`] | the episode, the event |
//! | whether a score rises with a setting | [`spearman_trend`] | the pair |
//! | how many seeds or episodes are needed | [`seeds_per_method`], [`episodes_per_policy`] | |
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
//! `docs/statistics.md` has the coverage of every interval here.
//!
//! Equal input gives equal bits: resamples and random orders come from keyed streams, whatever was drawn before.

mod bootstrap;
mod distributions;
mod means;
mod power;
mod rank;
mod rates;
mod seeds;

pub use bootstrap::bootstrap_interval;
pub use means::{
    BOOTSTRAP_MIN_COUNT, interquartile_mean, interquartile_mean_interval, mean_interval, paired_difference,
    paired_ratio, t_interval, welch_difference,
};
pub use power::{episodes_per_policy, seeds_per_method};
pub use rank::{Trend, spearman_trend};
pub use rates::{
    clopper_pearson_interval, exact_rate_interval, rate_difference, rate_interval, rate_per_1000_km, rule_of_three,
    wilson_interval,
};
pub use seeds::{Aggregate, Pairing, SeedScores};

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
    /// A distance over which nothing can be counted.
    #[error("the distance is {distance_m} m, but must be positive and finite")]
    Distance {
        /// The distance, m.
        distance_m: f64,
    },
    /// One seed twice, which would count as two trainings.
    #[error("seed {seed} is there twice; each training counts once")]
    SameSeed {
        /// The seed.
        seed: u64,
    },
    /// Values of which all are the same, so that they have no order.
    #[error("all values are the same, so there is no trend to test")]
    Constant,
    /// A rate, ratio or difference for which no sample size can be given.
    #[error("no sample of up to a million values can be planned for {value}")]
    Effect {
        /// The value.
        value: f64,
    },
}

/// The values, if there are 2 or more and all are finite.
fn checked(values: &[f64]) -> Result<&[f64], StatsError> {
    require(&[values.len()], 2)?;
    match values.iter().enumerate().find(|(_, x)| !x.is_finite()) {
        Some((index, value)) => Err(StatsError::NotFinite { index, value: *value }),
        None => Ok(values),
    }
}

/// Refuses counts below `min`.
fn require(counts: &[usize], min: usize) -> Result<(), StatsError> {
    counts.iter().find(|count| **count < min).map_or(Ok(()), |count| Err(StatsError::TooFew { count: *count, min }))
}

#[cfg(test)]
fn close(actual: f64, expected: f64, tolerance: f64) {
    assert!((actual - expected).abs() <= tolerance, "{actual} is not within {tolerance} of {expected}");
}
