//! Steering and drive train: first-order lags with a rate limit, solved exactly, so that their step size does not
//! matter.

/// Where a first-order lag driven towards a constant `target` is after `time_s`, its rate limited to `rate` per second.
///
/// `lag_s` = 0 leaves only the rate limit, which may be infinite: then the value is the target from the first instant.
pub(crate) fn lagged(value: f64, target: f64, lag_s: f64, rate: f64, time_s: f64) -> f64 {
    if lag_s <= 0.0 && rate == f64::INFINITY {
        return target;
    }
    let away = target - value;
    let reach = rate * time_s;
    if lag_s <= 0.0 {
        return if away.abs() <= reach { target } else { value + reach.copysign(away) };
    }
    // Further away than rate · lag the limit holds; from there on the approach is exponential.
    let excess = away.abs() - rate * lag_s;
    if excess > reach {
        return value + reach.copysign(away);
    }
    let limited_s = if excess > 0.0 { excess / rate } else { 0.0 };
    let left = away.abs() - excess.max(0.0);
    target - (left * libm::exp(-(time_s - limited_s) / lag_s)).copysign(away)
}

/// Share of the way to a constant target that a first-order lag covers in `time_s`: 1 − e^(−t/T), 1 without lag.
pub(crate) fn lag_response(lag_s: f64, time_s: f64) -> f64 {
    if lag_s <= 0.0 { 1.0 } else { -libm::expm1(-time_s / lag_s) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_in_pieces_is_the_same_step() {
        for lag_s in [0.0, 0.1] {
            let whole = lagged(0.0, 0.2, lag_s, 0.5, 0.3);
            let pieces = (0..30).fold(0.0, |value, _| lagged(value, 0.2, lag_s, 0.5, 0.01));
            // Rounding only.
            assert!((whole - pieces).abs() < 1e-14, "{whole} {pieces}");
        }
    }

    #[test]
    fn the_rate_limit_holds_first() {
        assert_eq!(lagged(0.0, -1.0, 0.1, 0.5, 0.2), -0.1);
        assert_eq!(lagged(0.0, 1.0, 0.0, 0.5, 10.0), 1.0);
    }

    #[test]
    fn the_response_is_that_of_the_lag() {
        let response = lag_response(0.2, 0.05);
        assert!((lagged(0.0, 1.0, 0.2, f64::INFINITY, 0.05) - response).abs() < 1e-15);
    }
}
