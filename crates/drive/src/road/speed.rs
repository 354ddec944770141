//! Speed limits along the road.

use super::{Road, SpeedLimit};

/// Deceleration with which a driver slows down towards a lower limit ahead, m/s²: coasting with a touch of the brake.
const APPROACH_DECEL_MPS2: f64 = 1.0;

impl Road {
    /// The speed limit at `s_m`, m/s: the lowest of all that hold there, infinite without one.
    pub fn speed_limit_mps(&self, s_m: f64) -> f64 {
        self.lowest_limit(s_m, |_, _| f64::INFINITY)
    }

    /// The speed from which every limit ahead is reached in time at a gentle braking, m/s; infinite without limits.
    pub fn allowed_speed_mps(&self, s_m: f64) -> f64 {
        self.lowest_limit(s_m, |limit, ahead_m| {
            (limit.limit_mps * limit.limit_mps + 2.0 * APPROACH_DECEL_MPS2 * ahead_m).sqrt()
        })
    }

    /// The lowest of the limits that hold at `s_m` and of what `before` makes of those that begin ahead.
    fn lowest_limit(&self, s_m: f64, before: impl Fn(&SpeedLimit, f64) -> f64) -> f64 {
        let speeds = self.config().speed_limits.iter().map(|limit| {
            let ahead_m = self.past_m(s_m, limit.from_m);
            if (0.0..=limit.to_m - limit.from_m).contains(&self.past_m(limit.from_m, s_m)) {
                limit.limit_mps
            } else if ahead_m >= 0.0 {
                before(limit, ahead_m)
            } else {
                f64::INFINITY
            }
        });
        speeds.fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use crate::road::{Road, RoadConfig, SpeedLimit, Topology};

    fn limited(topology: Topology) -> Road {
        let speed_limits = vec![
            SpeedLimit { from_m: 300.0, to_m: 500.0, limit_mps: 20.0 },
            SpeedLimit { from_m: 400.0, to_m: 450.0, limit_mps: 15.0 },
        ];
        Road::new(RoadConfig { topology, speed_limits, ..RoadConfig::default() }).expect("valid")
    }

    #[test]
    fn the_lowest_limit_holds() {
        let road = limited(Topology::Ring);
        assert_eq!(
            [299.0, 300.0, 420.0, 500.0].map(|s_m| road.speed_limit_mps(s_m)),
            [f64::INFINITY, 20.0, 15.0, 20.0]
        );
    }

    #[test]
    fn limits_ahead_are_reached_in_time_and_those_behind_are_over() {
        let road = limited(Topology::Open);
        // v² = 20² + 2 · 1 m/s² · 100 m; the limit of 15 m/s, 200 m ahead, asks for √625 and no less.
        assert_eq!(road.allowed_speed_mps(200.0), 600.0_f64.sqrt());
        assert_eq!(road.allowed_speed_mps(501.0), f64::INFINITY);
        // On a ring it comes again: 799 m to 20 m/s.
        assert_eq!(limited(Topology::Ring).allowed_speed_mps(501.0), (400.0_f64 + 2.0 * 799.0).sqrt());
        assert_eq!(Road::new(RoadConfig::default()).expect("valid").allowed_speed_mps(5.0), f64::INFINITY);
    }
}
