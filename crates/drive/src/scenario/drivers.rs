//! Who drives: the parameters that human drivers share and the ranges of those that differ.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::distribution::{Distribution, Keys, keys};
use crate::config::{ConfigError, check_order, check_range};
use crate::models::car_following::CarFollowing;
use crate::models::safe_distance::BrakingLimits;
use crate::road::Road;

/// Standard gravity, m/s².
const GRAVITY_MPS2: f64 = 9.81;
/// Share of the adhesion that braking can use: the rest keeps the wheels rolling and the vehicle on its path.
const USABLE_ADHESION: f64 = 0.95;
/// Gap left between two standing vehicles by the law of the safe distance, m.
pub(super) const SAFE_MARGIN_M: f64 = 1.0;

/// What kind of vehicle a human drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum VehicleKind {
    /// 4.8 m × 1.9 m.
    Car,
    /// 12 m × 2.5 m: the longest and widest rigid truck allowed on Chinese (and European) roads.
    Truck,
}

impl VehicleKind {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Car => "car",
            Self::Truck => "truck",
        }
    }

    /// Length, m.
    pub fn length_m(self) -> f64 {
        match self {
            Self::Car => 4.8,
            Self::Truck => 12.0,
        }
    }

    /// Width, m.
    pub fn width_m(self) -> f64 {
        match self {
            Self::Car => 1.9,
            Self::Truck => 2.5,
        }
    }
}

/// The human drivers and how many there are. The paper names IDM and MOBIL and gives no number but the road's speed limits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrafficConfig {
    /// Vehicles per kilometer and lane: 14 leaves gaps; from 20 on the flow holds everybody near 20 m/s.
    pub density_veh_per_km_lane: f64,
    /// Half-width of the uniform range from which each scenario draws its density around the value above.
    pub density_spread_veh_per_km_lane: f64,
    /// Share of trucks. 0: the paper speaks of cars, and the published ceilings are those of cars.
    pub truck_share: f64,
    /// Which car-following model: `idm`, or `enhanced-idm`, which does not overreact when somebody cuts in (Kesting 2010).
    pub car_following: CarFollowing,
    /// Desired speed of a car v₀, m/s: below the limit, so that overtaking pays.
    pub desired_speed_mps: Distribution,
    /// Desired speed of a truck, m/s (90 km/h, the usual limiter, at most).
    pub truck_desired_speed_mps: Distribution,
    /// Time headway T, s (Treiber 2000, Kesting 2007: 1 to 1.8).
    pub time_headway_s: Distribution,
    /// Gap at standstill s₀, m (Treiber 2000: 2).
    pub min_gap_m: Distribution,
    /// Acceleration of a car a_max, m/s².
    pub max_accel_mps2: Distribution,
    /// Acceleration of a truck, m/s².
    pub truck_max_accel_mps2: Distribution,
    /// Comfortable deceleration b, m/s² (positive).
    pub comfort_decel_mps2: Distribution,
    /// Hardest braking of a car on a dry road, m/s² (positive); 0.95 μ g bounds it further.
    pub max_brake_mps2: f64,
    /// Hardest braking of a truck, m/s² (positive): 5 m/s² is what heavy vehicles must reach.
    pub truck_max_brake_mps2: f64,
    /// Hardest braking that human drivers expect of the ego, m/s² (positive): the plant's limit.
    pub ego_max_brake_mps2: f64,
    /// MOBIL's weight p of the others' gain (Kesting 2007: 0 to 0.5).
    pub politeness: Distribution,
    /// MOBIL's threshold Δa_th, m/s².
    pub accel_gain_threshold_mps2: f64,
    /// MOBIL's hardest forced braking b_safe, m/s² (positive).
    pub safe_decel_mps2: f64,
    /// Whether drivers keep right and pass on the left as on European roads (Kesting 2007, asymmetric rule); else sides are equal.
    pub keep_right: bool,
    /// How much more a right lane is worth if they do, Δa_bias, m/s² (Kesting 2007: 0.3). At most the threshold leaves everybody in place.
    pub keep_right_bias_mps2: f64,
    /// Time from the start of a lane change to the next one, s; stops ping-pong.
    pub lane_change_cooldown_s: f64,
    /// Duration of a lane change, s.
    pub lane_change_duration_s: f64,
    /// Time between two looks at the other lanes, s; vehicles look at different steps.
    pub lane_decision_period_s: f64,
    /// Whether human drivers cut in before the ego only at a distance safe for its delays, too.
    pub courteous: bool,
    /// Time that sampled traffic drives alone before the ego is placed, s.
    pub warm_up_s: f64,
    /// Largest random shift of a start position, in shares of the free space between vehicles.
    pub start_jitter: f64,
    /// Rate at which each car near ahead of the ego starts a full brake of 3 s, 1/s; for stress tests only.
    pub stress_brake_rate_hz: f64,
}

impl Default for TrafficConfig {
    fn default() -> Self {
        Self {
            density_veh_per_km_lane: 14.0,
            density_spread_veh_per_km_lane: 0.0,
            truck_share: 0.0,
            car_following: CarFollowing::Idm,
            desired_speed_mps: Distribution::uniform(19.0, 27.0),
            truck_desired_speed_mps: Distribution::uniform(20.0, 25.0),
            time_headway_s: Distribution::uniform(1.0, 1.8),
            min_gap_m: Distribution::fixed(2.0),
            max_accel_mps2: Distribution::fixed(1.5),
            truck_max_accel_mps2: Distribution::fixed(0.8),
            comfort_decel_mps2: Distribution::fixed(2.0),
            max_brake_mps2: 7.0,
            truck_max_brake_mps2: 5.0,
            ego_max_brake_mps2: 8.0,
            politeness: Distribution::fixed(0.3),
            accel_gain_threshold_mps2: 0.2,
            safe_decel_mps2: 3.0,
            keep_right: false,
            keep_right_bias_mps2: 0.3,
            lane_change_cooldown_s: 6.0,
            lane_change_duration_s: 3.0,
            lane_decision_period_s: 0.5,
            courteous: false,
            warm_up_s: 5.0,
            start_jitter: 0.3,
            stress_brake_rate_hz: 0.0,
        }
    }
}

impl TrafficConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("traffic.density_veh_per_km_lane", self.density_veh_per_km_lane, 0.0, 200.0)?;
        let spread = self.density_spread_veh_per_km_lane;
        check_range("traffic.density_spread_veh_per_km_lane", spread, 0.0, self.density_veh_per_km_lane)?;
        check_range("traffic.truck_share", self.truck_share, 0.0, 1.0)?;
        check_range("traffic.start_jitter", self.start_jitter, 0.0, 0.5)?;
        check_range("traffic.warm_up_s", self.warm_up_s, 0.0, 600.0)?;
        check_range("traffic.stress_brake_rate_hz", self.stress_brake_rate_hz, 0.0, 10.0)?;
        self.validate_drivers()?;
        self.validate_braking()?;
        self.validate_lane_changes()
    }

    /// Every distribution over drivers against what its parameter allows.
    fn validate_drivers(&self) -> Result<(), ConfigError> {
        let parameters: [(&Distribution, Keys, (f64, f64)); 8] = [
            (&self.desired_speed_mps, keys!("traffic.desired_speed_mps"), (1.0, 60.0)),
            (&self.truck_desired_speed_mps, keys!("traffic.truck_desired_speed_mps"), (1.0, 60.0)),
            (&self.time_headway_s, keys!("traffic.time_headway_s"), (0.1, 10.0)),
            (&self.min_gap_m, keys!("traffic.min_gap_m"), (0.0, 20.0)),
            (&self.max_accel_mps2, keys!("traffic.max_accel_mps2"), (0.1, 6.0)),
            (&self.truck_max_accel_mps2, keys!("traffic.truck_max_accel_mps2"), (0.1, 6.0)),
            (&self.comfort_decel_mps2, keys!("traffic.comfort_decel_mps2"), (0.1, 6.0)),
            (&self.politeness, keys!("traffic.politeness"), (-1.0, 2.0)),
        ];
        parameters.iter().try_for_each(|(distribution, keys, range)| distribution.validate(keys, *range))
    }

    fn validate_braking(&self) -> Result<(), ConfigError> {
        check_range("traffic.max_brake_mps2", self.max_brake_mps2, 2.0, 12.0)?;
        check_range("traffic.truck_max_brake_mps2", self.truck_max_brake_mps2, 2.0, 12.0)?;
        check_range("traffic.ego_max_brake_mps2", self.ego_max_brake_mps2, 2.0, 12.0)?;
        // The safe distance asks that nobody brakes harder than the vehicles ahead are trusted to.
        let truck = ("traffic.truck_max_brake_mps2", self.truck_max_brake_mps2);
        check_order(truck, ("traffic.max_brake_mps2", self.max_brake_mps2))
    }

    fn validate_lane_changes(&self) -> Result<(), ConfigError> {
        check_range("traffic.accel_gain_threshold_mps2", self.accel_gain_threshold_mps2, 0.0, 100.0)?;
        check_range("traffic.safe_decel_mps2", self.safe_decel_mps2, 0.1, 9.0)?;
        check_range("traffic.keep_right_bias_mps2", self.keep_right_bias_mps2, 0.0, 10.0)?;
        check_range("traffic.lane_change_cooldown_s", self.lane_change_cooldown_s, 0.0, 600.0)?;
        check_range("traffic.lane_change_duration_s", self.lane_change_duration_s, 0.5, 20.0)?;
        check_range("traffic.lane_decision_period_s", self.lane_decision_period_s, 0.01, 60.0)
    }

    /// Hardest braking of any human-driven vehicle on a road of this adhesion, m/s².
    pub fn hardest_brake_mps2(&self, adhesion: f64) -> f64 {
        limited_by_adhesion(self.max_brake_mps2, adhesion)
    }

    /// Hardest braking that human drivers expect of the ego on a road of this adhesion, m/s².
    pub fn expected_ego_brake_mps2(&self, adhesion: f64) -> f64 {
        limited_by_adhesion(self.ego_max_brake_mps2, adhesion).max(self.hardest_brake_mps2(adhesion))
    }

    /// The law of the safe distance for a vehicle that brakes this hard, behind another human driver or behind the ego: human drivers
    /// brake everywhere as on the road's most slippery place, the ego may stand on its best one.
    pub fn braking_limits(&self, follower_mps2: f64, behind_ego: bool, road: &Road) -> BrakingLimits {
        let (lowest, highest) = road.adhesion_range();
        let leader_mps2 =
            if behind_ego { self.expected_ego_brake_mps2(highest) } else { self.hardest_brake_mps2(lowest) };
        BrakingLimits { follower_mps2, leader_mps2, margin_m: SAFE_MARGIN_M }
    }
}

/// What is left of a braking ability on a road of this adhesion, m/s².
pub(super) fn limited_by_adhesion(brake_mps2: f64, adhesion: f64) -> f64 {
    brake_mps2.min(USABLE_ADHESION * adhesion * GRAVITY_MPS2)
}

#[cfg(test)]
mod tests {
    use super::{Distribution, TrafficConfig};

    fn refusal(time_headway_s: Distribution) -> String {
        TrafficConfig { time_headway_s, ..TrafficConfig::default() }.validate().expect_err("impossible").to_string()
    }

    #[test]
    fn a_distribution_is_refused_by_the_key_of_its_number() {
        let normal = |mean, sd| Distribution::Normal { mean, sd, min: 0.5, max: 3.0 };
        for (distribution, expected) in [
            (Distribution::fixed(0.0), "`traffic.time_headway_s.value` is 0, but must be in 0.1..=10"),
            (Distribution::uniform(0.0, 2.0), "`traffic.time_headway_s.min` is 0"),
            (Distribution::uniform(1.0, 20.0), "`traffic.time_headway_s.max` is 20"),
            (Distribution::uniform(2.0, 1.0), "`traffic.time_headway_s.min` is 2, above `traffic.time_headway_s.max`"),
            (normal(3.5, 0.3), "`traffic.time_headway_s.mean` is 3.5, but must be in 0.5..=3"),
            (normal(f64::NAN, 0.3), "`traffic.time_headway_s.mean` is NaN"),
            (normal(1.4, 0.0), "`traffic.time_headway_s.sd` is 0"),
        ] {
            let message = refusal(distribution);
            assert!(message.contains(expected), "`{message}` does not say `{expected}`");
        }
    }
}
