//! What every configuration struct of this crate shares: the error of a bad value and the checks that raise it.

/// A configuration value that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// A number outside its range, or NaN.
    #[error("`{key}` is {value}, but must be in {min}..={max}")]
    OutOfRange {
        /// Dotted key, for example `traffic.density_veh_per_km_lane`.
        key: &'static str,
        /// The value given.
        value: f64,
        /// Smallest allowed value.
        min: f64,
        /// Largest allowed value.
        max: f64,
    },
    /// A range whose lower end lies above its upper end.
    #[error("`{low_key}` is {low}, above `{high_key}`, which is {high}")]
    Reversed {
        /// Key of the lower end.
        low_key: &'static str,
        /// Value of the lower end.
        low: f64,
        /// Key of the upper end.
        high_key: &'static str,
        /// Value of the upper end.
        high: f64,
    },
    /// A period that is no whole multiple of the period below it.
    #[error("`{key}` is {value_s} s, which is no whole multiple of `{base_key}` = {base_s} s")]
    NotAMultiple {
        /// Key of the longer period.
        key: &'static str,
        /// The longer period.
        value_s: f64,
        /// Key of the shorter period.
        base_key: &'static str,
        /// The shorter period.
        base_s: f64,
    },
    /// A lane that ends where no other leads on.
    #[error("`road.lanes_open` ends lane {lane} at {end_m} m, but no lane beside it can be reached there that goes on")]
    NoWayOut {
        /// The lane.
        lane: u8,
        /// Where it ends, m.
        end_m: f64,
    },
    /// A list with a wrong number of entries.
    #[error("`{key}` has {len} entries, but must have {allowed}")]
    WrongLength {
        /// Dotted key.
        key: &'static str,
        /// Entries given.
        len: usize,
        /// What is allowed, in words.
        allowed: &'static str,
    },
    /// A file that nobody has loaded.
    #[error("`{key}` is {name:?}, but that file has not been loaded")]
    NotLoaded {
        /// Dotted key.
        key: &'static str,
        /// The file.
        name: String,
    },
    /// Names of which one is not known or stands twice, or none at all.
    #[error("`{key}` is {found:?}, but must be some of {known:?}, none of them twice")]
    BadNames {
        /// Dotted key.
        key: &'static str,
        /// The names given.
        found: Vec<String>,
        /// The names there are.
        known: &'static [&'static str],
    },
    /// A text that is no scenario.
    #[error("`{key}` is no scenario: {message}")]
    BadScenario {
        /// Dotted key.
        key: &'static str,
        /// What is wrong with it.
        message: String,
    },
}

impl ConfigError {
    /// The key it is about.
    pub fn key(&self) -> &'static str {
        match self {
            Self::OutOfRange { key, .. }
            | Self::NotAMultiple { key, .. }
            | Self::WrongLength { key, .. }
            | Self::BadNames { key, .. }
            | Self::BadScenario { key, .. }
            | Self::NotLoaded { key, .. }
            | Self::Reversed { low_key: key, .. } => key,
            Self::NoWayOut { .. } => "road.lanes_open",
        }
    }
}

/// `value` must be finite and in `min..=max`.
pub fn check_range(key: &'static str, value: f64, min: f64, max: f64) -> Result<(), ConfigError> {
    if (min..=max).contains(&value) { Ok(()) } else { Err(ConfigError::OutOfRange { key, value, min, max }) }
}

/// `low` must not lie above `high` (both are checked for their ranges elsewhere).
pub fn check_order(
    (low_key, low): (&'static str, f64),
    (high_key, high): (&'static str, f64),
) -> Result<(), ConfigError> {
    if low <= high { Ok(()) } else { Err(ConfigError::Reversed { low_key, low, high_key, high }) }
}

/// How many times `base_s` fits into `value_s`; an error unless that is a whole number of at least one.
///
/// Periods are written in decimal, so that 0.5 / 0.05 is 10 only up to rounding: a relative error of 1e-9 is forgiven.
pub fn whole_multiple(
    (key, value_s): (&'static str, f64),
    (base_key, base_s): (&'static str, f64),
) -> Result<u32, ConfigError> {
    let ratio = value_s / base_s;
    let whole = ratio.round();
    if whole >= 1.0 && (ratio - whole).abs() <= 1e-9 * whole {
        Ok(whole as u32)
    } else {
        Err(ConfigError::NotAMultiple { key, value_s, base_key, base_s })
    }
}

#[cfg(test)]
mod tests {
    use super::{check_range, whole_multiple};

    #[test]
    fn nan_is_out_of_every_range() {
        assert!(check_range("k", f64::NAN, f64::NEG_INFINITY, f64::INFINITY).is_err());
        assert!(check_range("k", 1.0, 0.0, 1.0).is_ok());
    }

    #[test]
    fn decimal_periods_divide() {
        assert_eq!(whole_multiple(("a", 0.5), ("b", 0.05)), Ok(10));
        assert_eq!(whole_multiple(("a", 0.3), ("b", 0.1)), Ok(3));
        assert!(whole_multiple(("a", 0.12), ("b", 0.05)).is_err());
        assert!(whole_multiple(("a", 0.02), ("b", 0.05)).is_err());
    }
}
