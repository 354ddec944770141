//! Which durations a lane change may have for the car's own sake, and the parameters of the planner.
//!
//! The paper bounds the course angle Ẏ/V by atan(0.02 μ g) (Eq. 15b), which it calls sideslip. The default bounds what limits a car:
//! the lateral acceleration of the continuous polynomial, and the sideslip of the linear bicycle model on it.

use serde::{Deserialize, Serialize};

use super::features::{FEATURES, FeatureConfig, PAPER_SELECTION, Selection};
use super::motion::Motion;
use super::reward::RewardModel;
use crate::config::{ConfigError, check_order, check_range, whole_multiple};
use crate::vehicle::VehicleParams;

/// Standard gravity g, m/s².
const GRAVITY_MPS2: f64 = 9.81;

/// What bounds the steepness of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LateralBound {
    /// Lateral acceleration and the bicycle model's sideslip.
    Acceleration,
    /// The course angle (Eq. 15b as printed).
    CourseAngle,
}

/// The planner's parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlannerConfig {
    /// Shortest duration of a lane change, s.
    pub duration_min_s: f64,
    /// Longest duration, s; the paper has none, and without a leader Eq. 15 gives none.
    pub duration_max_s: f64,
    /// Longest duration where the lateral bound leaves no shorter one (wet road, low speed), s.
    pub duration_max_extended_s: f64,
    /// Step of the durations, s (paper: 0.1).
    pub duration_step_s: f64,
    /// Lateral end positions of the candidates as distances from the lane's center to the left, m, the first one 0 (paper: 0 alone).
    pub end_offsets_m: Vec<f64>,
    /// Changes of speed by the end of the candidates, m/s, the first one 0 (paper: 0 alone).
    pub end_speed_changes_mps: Vec<f64>,
    /// Largest acceleration or braking for a change of speed, m/s².
    pub speed_change_accel_mps2: f64,
    /// Whether the others have a say in whether a lane change is allowed (Eq. 15). Without it, only the lateral bounds do.
    pub veto: bool,
    /// Least bumper distance s_saf, m. The paper has no value.
    pub safety_gap_m: f64,
    /// Braking of a leader from now on that must be survived, m/s²: a_x,max of Eq. 15. The paper has no value.
    pub leader_decel_mps2: f64,
    /// Braking that may be asked of the new follower, m/s²: the safe deceleration of MOBIL (Kesting et al., 2007).
    pub follower_decel_mps2: f64,
    /// What bounds the steepness of a path.
    pub bound: LateralBound,
    /// Largest lateral acceleration, m/s².
    pub lateral_accel_max_mps2: f64,
    /// Largest lateral acceleration as a share of μ g.
    pub adhesion_share: f64,
    /// Sideslip (paper: course angle) is bounded by atan(this · μ g), s²/m (paper: 0.02).
    pub slip_factor_s2pm: f64,
    /// Lateral distance from the old lane's center at which its leader no longer counts, m: the bodies are apart.
    pub clearance_m: f64,
    /// Lateral distance from the old lane's center up to which a change may be broken off, m: the car is inside its lane's marking.
    pub abort_offset_m: f64,
    /// How features are computed.
    pub features: FeatureConfig,
    /// Means of the features.
    pub feature_means: [f64; FEATURES],
    /// Scales of the features, positive.
    pub feature_scales: [f64; FEATURES],
    /// Cost weights −ϖ of the normalized features by the order of [`FEATURE_NAMES`](super::FEATURE_NAMES); 0 leaves one out. The defaults put the preferred duration at about
    /// 2.5 s between 25 and 30 m/s, where those of Table IV lie; learned weights replace them.
    pub cost_weights: [f64; FEATURES],
}

impl Default for PlannerConfig {
    fn default() -> Self {
        Self {
            duration_min_s: 1.5,
            duration_max_s: 4.0,
            duration_max_extended_s: 8.0,
            duration_step_s: 0.1,
            end_offsets_m: vec![0.0],
            end_speed_changes_mps: vec![0.0],
            speed_change_accel_mps2: 1.5,
            veto: true,
            safety_gap_m: 5.0,
            leader_decel_mps2: 2.0,
            follower_decel_mps2: 3.0,
            bound: LateralBound::Acceleration,
            lateral_accel_max_mps2: 4.0,
            adhesion_share: 0.85,
            slip_factor_s2pm: 0.02,
            clearance_m: 2.1,
            abort_offset_m: 0.9,
            features: FeatureConfig::default(),
            feature_means: [0.0; FEATURES],
            // Of a change of 3.75 m within 2.5 s at 28 m/s on an ordinarily busy road.
            feature_scales: [0.0041, 0.5, 0.0079, 0.125, 50.0, 3.5, 0.3, 0.1, 1.0],
            cost_weights: [1.0, 1.0, 1.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        }
    }
}

impl PlannerConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let step = ("planner.duration_step_s", self.duration_step_s);
        check_range("planner.duration_min_s", self.duration_min_s, 0.5, 20.0)?;
        check_range("planner.duration_max_s", self.duration_max_s, 0.5, 20.0)?;
        check_range("planner.duration_max_extended_s", self.duration_max_extended_s, 0.5, 20.0)?;
        check_range(step.0, step.1, 0.01, 1.0)?;
        let limits = [
            ("planner.duration_min_s", self.duration_min_s),
            ("planner.duration_max_s", self.duration_max_s),
            ("planner.duration_max_extended_s", self.duration_max_extended_s),
        ];
        for limit in limits {
            whole_multiple(limit, step)?;
        }
        check_order(limits[0], limits[1])?;
        check_order(limits[1], limits[2])?;
        check_ends("planner.end_offsets_m", &self.end_offsets_m, 1.5)?;
        check_ends("planner.end_speed_changes_mps", &self.end_speed_changes_mps, 10.0)?;
        check_range("planner.speed_change_accel_mps2", self.speed_change_accel_mps2, 0.1, 5.0)?;
        check_range("planner.safety_gap_m", self.safety_gap_m, 0.0, 50.0)?;
        check_range("planner.leader_decel_mps2", self.leader_decel_mps2, 0.1, 10.0)?;
        check_range("planner.follower_decel_mps2", self.follower_decel_mps2, 0.1, 10.0)?;
        check_range("planner.lateral_accel_max_mps2", self.lateral_accel_max_mps2, 0.5, 10.0)?;
        check_range("planner.adhesion_share", self.adhesion_share, 0.1, 1.0)?;
        check_range("planner.slip_factor_s2pm", self.slip_factor_s2pm, 0.001, 0.1)?;
        check_range("planner.clearance_m", self.clearance_m, 1.0, 6.0)?;
        check_range("planner.abort_offset_m", self.abort_offset_m, 0.0, 3.0)?;
        self.features.validate()?;
        for i in 0..FEATURES {
            check_range("planner.feature_means", self.feature_means[i], -1e6, 1e6)?;
            check_range("planner.feature_scales", self.feature_scales[i], 1e-12, 1e6)?;
            check_range("planner.cost_weights", self.cost_weights[i], -1e6, 1e6)?;
        }
        Ok(())
    }

    /// The same planner with a reward learned from drivers.
    #[must_use]
    pub fn with_reward(self, reward: &RewardModel) -> Self {
        let (mut means, mut scales, mut weights) = ([0.0; FEATURES], [1.0; FEATURES], [0.0; FEATURES]);
        for (number, index) in reward.indices().enumerate() {
            means[index] = reward.mean[number];
            scales[index] = reward.scale[number];
            weights[index] = -reward.weights[number];
        }
        let features = reward.definition.clone();
        Self { features, feature_means: means, feature_scales: scales, cost_weights: weights, ..self }
    }

    /// The paper's features and those that have a weight.
    pub(super) fn selection(&self) -> Selection {
        std::array::from_fn(|index| PAPER_SELECTION[index] || self.cost_weights[index] != 0.0)
    }
}

/// A list of ends of candidates: the first is 0, so that there always is the candidate that the window promises.
fn check_ends(key: &'static str, ends: &[f64], largest: f64) -> Result<(), ConfigError> {
    check_range(key, ends.first().copied().unwrap_or(f64::NAN), 0.0, 0.0)?;
    ends.iter().try_for_each(|&end| check_range(key, end, -largest, largest))
}

/// The bounds on a path's steepness at one speed on one road.
#[derive(Clone, Copy, Debug)]
pub(super) struct LateralLimits {
    bound: LateralBound,
    /// Largest |d̈|, m/s².
    accel_mps2: f64,
    /// Largest |ḋ|, m/s.
    speed_mps: f64,
    /// Largest acceleration that the tires may be asked for in the plane, less the curve's, m/s².
    grip_mps2: f64,
    /// Largest acceleration along the road, m/s².
    speed_change_mps2: f64,
    /// Largest sideslip, rad.
    sideslip_rad: f64,
    /// Sideslip = `per_accel` · d̈ + `per_jerk` · d⃛.
    per_accel: f64,
    per_jerk: f64,
}

impl LateralLimits {
    /// At `speed_mps` with adhesion μ, where the road's own curvature takes up to `curve_accel_mps2` of the grip.
    ///
    /// Sideslip: with the yaw rate γ = d̈/V the axle forces follow from M d̈ = F_f + F_r and J_z γ̇ = L_f F_f − L_r F_r, and
    /// F_r = −2 K_r (V_y − L_r γ)/V gives β = V_y/V = (L_r/V² − L_f M/(2 K_r L)) d̈ + J_z/(2 K_r L V) d⃛.
    pub(super) fn new(
        config: &PlannerConfig,
        vehicle: &VehicleParams,
        (speed_mps, adhesion, curve_accel_mps2): (f64, f64, f64),
    ) -> Self {
        let v = speed_mps;
        let grip_mps2 = adhesion * GRAVITY_MPS2;
        let angle_rad = libm::atan(config.slip_factor_s2pm * grip_mps2);
        let lever = 2.0 * vehicle.rear_stiffness_nprad * vehicle.wheelbase_m();
        Self {
            bound: config.bound,
            accel_mps2: config.lateral_accel_max_mps2.min(config.adhesion_share * grip_mps2 - curve_accel_mps2),
            grip_mps2: config.adhesion_share * grip_mps2 - curve_accel_mps2,
            speed_change_mps2: config.speed_change_accel_mps2,
            speed_mps: angle_rad * v,
            sideslip_rad: angle_rad,
            per_accel: vehicle.rear_axle_m / (v * v) - vehicle.front_axle_m * vehicle.mass_kg / lever,
            per_jerk: vehicle.yaw_inertia_kgm2 / (lever * v),
        }
    }

    /// Whether `motion` stays within the bounds on its whole duration, by the extrema of the continuous polynomials; false for a car
    /// at rest. With a change of speed the largest accelerations along and across count as if they came together.
    pub(super) fn allow(&self, motion: &Motion) -> bool {
        let path = &motion.lateral;
        let across = match self.bound {
            LateralBound::CourseAngle => path.max_speed_mps() <= self.speed_mps,
            LateralBound::Acceleration => {
                path.max_accel_mps2() <= self.accel_mps2
                    && path.max_of_accel_and_jerk(self.per_accel, self.per_jerk) <= self.sideslip_rad
            }
        };
        let along_mps2 = motion.course().max_accel_mps2();
        let together = || libm::hypot(path.max_accel_mps2(), along_mps2) <= self.grip_mps2;
        across && (along_mps2 == 0.0 || (along_mps2 <= self.speed_change_mps2 && together()))
    }
}

#[cfg(test)]
mod tests {
    use lanecraft_net::random::Stream;

    use super::*;
    use crate::plan::quintic::{LateralState, Quintic};

    fn held(speed_mps: f64, lateral: Quintic) -> Motion {
        Motion { lateral, speed_mps, speed_change_mps: 0.0 }
    }

    fn shortest_s(bound: LateralBound, speed_mps: f64, adhesion: f64) -> f64 {
        let config = PlannerConfig { bound, ..PlannerConfig::default() };
        let limits = LateralLimits::new(&config, &VehicleParams::default(), (speed_mps, adhesion, 0.0));
        (1..2000)
            .map(|k| 0.01 * f64::from(k))
            .find(|&t| limits.allow(&held(speed_mps, Quintic::new(LateralState::default(), 3.75, t))))
            .unwrap()
    }

    #[test]
    fn the_course_angle_of_equation_15_gives_its_closed_form() {
        for (speed, adhesion) in [(20.0, 0.85), (33.3, 0.85), (25.0, 0.4)] {
            let expected = 1.875 * 3.75 / (libm::atan(0.02 * adhesion * 9.81) * speed);
            assert!((shortest_s(LateralBound::CourseAngle, speed, adhesion) - expected).abs() <= 0.01);
        }
        assert!((shortest_s(LateralBound::CourseAngle, 20.0, 0.85) - 2.13).abs() <= 0.01);
    }

    #[test]
    fn lateral_acceleration_gives_its_closed_form_at_speed() {
        for (adhesion, bound) in [(0.85, 4.0), (0.4, 0.85 * 0.4 * 9.81)] {
            let expected = (10.0 / 3.0_f64.sqrt() * 3.75 / bound).sqrt();
            assert!((shortest_s(LateralBound::Acceleration, 25.0, adhesion) - expected).abs() <= 0.01);
        }
        // At walking pace the bicycle model's sideslip binds instead.
        assert!(shortest_s(LateralBound::Acceleration, 3.0, 0.85) > 3.0);
    }

    #[test]
    fn a_car_at_rest_changes_no_lane() {
        let limits = LateralLimits::new(&PlannerConfig::default(), &VehicleParams::default(), (0.0, 0.85, 0.0));
        assert!(!limits.allow(&held(0.0, Quintic::new(LateralState::default(), 3.75, 8.0))));
    }

    #[test]
    fn the_sideslip_is_that_of_the_bicycle_model() {
        // At this sideslip and yaw rate the axle forces of Eq. 3 must give the moment that Eq. 2 asks for.
        let (vehicle, v) = (VehicleParams::default(), 20.0);
        let limits = LateralLimits::new(&PlannerConfig::default(), &vehicle, (v, 0.85, 0.0));
        let mut stream = Stream::new(5, "sideslip");
        for _ in 0..50 {
            let (accel, jerk) = (stream.range(-2.0, 2.0), stream.range(-3.0, 3.0));
            let (yaw_rate, yaw_accel) = (accel / v, jerk / v);
            let beta = limits.per_accel * accel + limits.per_jerk * jerk;
            let rear = -2.0 * vehicle.rear_stiffness_nprad * (beta - vehicle.rear_axle_m * yaw_rate / v);
            let front = vehicle.mass_kg * accel - rear;
            let moment = vehicle.front_axle_m * front - vehicle.rear_axle_m * rear;
            assert!((moment - vehicle.yaw_inertia_kgm2 * yaw_accel).abs() < 1e-6);
        }
    }

    #[test]
    fn a_change_of_speed_has_its_own_bound_and_shares_the_grip() {
        let allowed = |adhesion: f64, duration_s: f64, speed_change_mps: f64| {
            let limits =
                LateralLimits::new(&PlannerConfig::default(), &VehicleParams::default(), (25.0, adhesion, 0.0));
            let lateral = Quintic::new(LateralState::default(), 3.75, duration_s);
            limits.allow(&Motion { speed_change_mps, ..held(25.0, lateral) })
        };
        // The largest acceleration is 1.5 Δ/t_c, so that 1.5 m/s² are reached by 4 m/s within 4 s.
        assert!(allowed(0.85, 4.0, 3.99) && allowed(0.85, 4.0, -3.99) && !allowed(0.85, 4.0, 4.01));
        // On μ 0.2 a change within 4 s takes 1.35 of 1.67 m/s²: there is 0.98 m/s² left along the road.
        assert!(allowed(0.2, 4.0, 0.0) && allowed(0.2, 4.0, 2.5) && !allowed(0.2, 4.0, 2.7));
    }

    #[test]
    fn a_configuration_survives_its_text() {
        let config = PlannerConfig { bound: LateralBound::CourseAngle, ..PlannerConfig::default() };
        let text = toml::to_string(&config).unwrap();
        assert!(text.contains("bound = \"course-angle\"") && text.contains("[features]"));
        assert_eq!(toml::from_str::<PlannerConfig>(&text).unwrap(), config);
        assert!(toml::from_str::<PlannerConfig>("safety_gap = 3.0").is_err());
    }

    #[test]
    fn a_bad_configuration_is_refused() {
        assert!(PlannerConfig::default().validate().is_ok());
        assert!(PlannerConfig { duration_min_s: 4.5, ..PlannerConfig::default() }.validate().is_err());
        assert!(PlannerConfig { duration_min_s: 1.55, ..PlannerConfig::default() }.validate().is_err());
        for ends in [vec![], vec![1.0], vec![0.0, f64::NAN], vec![0.0, 11.0]] {
            let config = PlannerConfig { end_speed_changes_mps: ends, ..PlannerConfig::default() };
            assert!(config.validate().unwrap_err().to_string().contains("planner.end_speed_changes_mps"));
        }
        assert!(PlannerConfig { safety_gap_m: f64::NAN, ..PlannerConfig::default() }.validate().is_err());
    }
}
