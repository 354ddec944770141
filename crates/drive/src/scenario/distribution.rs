//! How a parameter differs from driver to driver.

use lanecraft_net::random::Stream;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_order, check_range};

/// Smallest standard deviation that is still one, in units of the parameter; below, write `fixed`.
const SMALLEST_SD: f64 = 1e-3;

/// A distribution over drivers, in the units of the parameter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Distribution {
    /// The same for everybody.
    Fixed {
        /// The value.
        value: f64,
    },
    /// Every value of a range alike.
    Uniform {
        /// Lower end.
        min: f64,
        /// Upper end.
        max: f64,
    },
    /// Normal, cut off at both ends.
    Normal {
        /// Mean before the cut, between both ends.
        mean: f64,
        /// Standard deviation before the cut.
        sd: f64,
        /// Lower end.
        min: f64,
        /// Upper end.
        max: f64,
    },
}

impl Distribution {
    /// The same for everybody.
    pub fn fixed(value: f64) -> Self {
        Self::Fixed { value }
    }

    /// Every value from `min` to `max` alike.
    pub fn uniform(min: f64, max: f64) -> Self {
        Self::Uniform { min, max }
    }

    /// The smallest and the largest value that may be drawn.
    pub fn bounds(&self) -> (f64, f64) {
        match *self {
            Self::Fixed { value } => (value, value),
            Self::Uniform { min, max } | Self::Normal { min, max, .. } => (min, max),
        }
    }

    /// The value for one driver: one draw of `stream`, none if it is the same for everybody.
    pub fn sample(&self, stream: &mut Stream) -> f64 {
        match *self {
            Self::Fixed { value } => value,
            Self::Uniform { min, max } => stream.range(min, max),
            Self::Normal { mean, sd, min, max } => {
                let (low, high) = ((min - mean) / sd, (max - mean) / sd);
                let share = stream.range(normal_cdf(low), normal_cdf(high));
                (mean + sd * normal_quantile(share, low, high)).clamp(min, max)
            }
        }
    }

    /// Checks that all values lie in `min..=max`, and that the shape is possible.
    pub(super) fn validate(&self, keys: &Keys, (lowest, highest): (f64, f64)) -> Result<(), ConfigError> {
        match *self {
            Self::Fixed { value } => check_range(keys.value, value, lowest, highest),
            Self::Uniform { min, max } => check_ends(keys, (min, max), (lowest, highest)),
            Self::Normal { mean, sd, min, max } => {
                check_ends(keys, (min, max), (lowest, highest))?;
                check_range(keys.mean, mean, min, max)?;
                check_range(keys.sd, sd, SMALLEST_SD, highest - lowest)
            }
        }
    }
}

fn check_ends(keys: &Keys, (min, max): (f64, f64), (lowest, highest): (f64, f64)) -> Result<(), ConfigError> {
    check_range(keys.min, min, lowest, highest)?;
    check_range(keys.max, max, lowest, highest)?;
    check_order((keys.min, min), (keys.max, max))
}

/// The dotted keys of a distribution's numbers.
pub(super) struct Keys {
    pub(super) value: &'static str,
    pub(super) min: &'static str,
    pub(super) max: &'static str,
    pub(super) mean: &'static str,
    pub(super) sd: &'static str,
}

/// The [`Keys`] of the distribution with this dotted key.
macro_rules! keys {
    ($key:literal) => {
        $crate::scenario::distribution::Keys {
            value: concat!($key, ".value"),
            min: concat!($key, ".min"),
            max: concat!($key, ".max"),
            mean: concat!($key, ".mean"),
            sd: concat!($key, ".sd"),
        }
    };
}
pub(super) use keys;

fn normal_cdf(z: f64) -> f64 {
    0.5 * libm::erfc(-z * core::f64::consts::FRAC_1_SQRT_2)
}

/// The point of `low..=high` below which this share of all normal values lies, by bisection.
fn normal_quantile(share: f64, low: f64, high: f64) -> f64 {
    // Beyond nine standard deviations nothing is left at this precision; 60 halvings of that range reach it.
    let (mut low, mut high) = (low.max(-9.0), high.min(9.0));
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if normal_cdf(middle) < share { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use lanecraft_net::random::Stream;

    use super::Distribution;

    fn draws(distribution: Distribution) -> Vec<f64> {
        let mut stream = Stream::new(5, "test");
        (0..20_000).map(|_| distribution.sample(&mut stream)).collect()
    }

    fn mean_and_sd(values: &[f64]) -> (f64, f64) {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / values.len() as f64;
        (mean, variance.sqrt())
    }

    #[test]
    fn a_wide_cut_leaves_the_normal_distribution() {
        let (mean, sd) = mean_and_sd(&draws(Distribution::Normal { mean: 1.4, sd: 0.3, min: -10.0, max: 10.0 }));
        // Four standard errors: 0.3 / √20000 of the mean, that over √2 of the deviation.
        assert!((mean - 1.4).abs() < 0.009 && (sd - 0.3).abs() < 0.006, "{mean} {sd}");
    }

    #[test]
    fn a_cut_moves_the_mean_as_the_law_says() {
        let values = draws(Distribution::Normal { mean: 0.0, sd: 1.0, min: 0.0, max: 40.0 });
        // The half-normal distribution: mean √(2/π), variance 1 − 2/π.
        let (mean, sd) = mean_and_sd(&values);
        let expected = (2.0 / core::f64::consts::PI).sqrt();
        assert!((mean - expected).abs() < 0.018 && (sd - (1.0 - expected * expected).sqrt()).abs() < 0.018);
        assert!(values.iter().all(|x| *x >= 0.0));
    }

    #[test]
    fn uniform_is_the_range_of_the_stream_and_each_driver_takes_one_draw() {
        let mut streams = [Stream::new(1, "test"); 3];
        let value = Distribution::uniform(19.0, 27.0).sample(&mut streams[0]);
        assert_eq!(value, streams[1].range(19.0, 27.0));
        Distribution::Normal { mean: 0.0, sd: 1.0, min: -1.0, max: 1.0 }.sample(&mut streams[2]);
        assert!(streams[0] == streams[1] && streams[1] == streams[2]);
        assert_eq!(Distribution::fixed(2.0).sample(&mut streams[0]), 2.0);
        assert_eq!(streams[0], streams[1]);
    }
}
