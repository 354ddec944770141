//! The section `[control]`: limits, horizons and weights of the two controllers and of the guard.

use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_order, check_range};
use crate::models::rss::Braking;
use crate::road::Road;
use crate::vehicle::tire::GRAVITY_MPS2;

/// Most stages a controller may look ahead.
pub const MAX_HORIZON: usize = 64;
/// Share of μ g that full braking is trusted to reach.
const USABLE_GRIP: f64 = 0.95;
/// Share of the usable grip that full braking takes in the sharpest bend: slowing down is what cures it.
const LEAST_SHARE: f64 = 0.5;
/// Points at which the road's curvature ahead is looked up.
const CURVATURE_POINTS: u32 = 8;
/// Time in which full braking is built up, with some to spare, s.
const BUILD_UP_S: f64 = 1.0;
/// Least braking that is counted on, m/s²: below it a stop is beyond any look-ahead.
const BRAKE_MIN_MPS2: f64 = 0.2;

/// What the heading is compared with in Eq. 26.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HeadingReference {
    /// The slope of the reference path.
    Slope,
    /// Zero, as in the paper, although a lane change needs up to 0.14 rad.
    Zero,
}

/// What stands for all that lies beyond the lateral horizon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TerminalCost {
    /// The last stage, weighed by `terminal_weight`.
    Weighted,
    /// The cost-to-go of the linear-quadratic regulator without constraints, which solves the discrete algebraic Riccati
    /// equation (Mayne, Rawlings, Rao and Scokaert, 2000).
    Riccati,
}

/// Motion control. All weights of one problem are relative to each other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[expect(clippy::struct_excessive_bools, reason = "independent switches, each a key of the configuration file")]
pub struct ControlConfig {
    /// Lowest acceleration the longitudinal controller asks for, m/s². The paper gives none; −2 cannot resolve a
    /// closing speed of 10 m/s in 30 m.
    pub accel_min_mps2: f64,
    /// Highest acceleration, m/s² (Table II's largest reference).
    pub accel_max_mps2: f64,
    /// Bound of the jerk, m/s³. Not in the paper.
    pub jerk_max_mps3: f64,
    /// Weight of the squared jerk against that of the squared acceleration error, s². Not in the paper.
    pub jerk_weight_s2: f64,
    /// Stages of the longitudinal problem, N_p of Eq. 25; the paper gives none (20 of 0.1 s in its preset). Two seconds are
    /// too short to stop for a standing car seen at 150 m; five are enough, and 0.2 s a stage are fine enough for them.
    pub longitudinal_horizon: u8,
    /// Length of a longitudinal stage, s.
    pub longitudinal_step_s: f64,
    /// Stages over which Eq. 25 pursues the target speed and the reference acceleration; later ones have a_ref = 0 and
    /// the limits, so that a longer look-ahead changes neither how well a decision is obeyed nor how close the car
    /// follows.
    pub goal_steps: u8,
    /// Stages of the lateral problem, N_p of Eq. 26, each one control period long; the paper gives none.
    pub lateral_horizon: u8,
    /// Bumper-to-bumper distance s_saf at standstill, m. The paper gives none.
    pub spacing_min_m: f64,
    /// Further distance per speed, s. The paper has a constant distance.
    pub spacing_headway_s: f64,
    /// Whether the spacing must also keep the guard's safe distance, so that the guard has nothing to do.
    pub safe_spacing: bool,
    /// What the spacing keeps beyond the guard's safe distance, m.
    pub safe_spacing_extra_m: f64,
    /// Time in which a spacing lost to a car cutting in is to be regained, s; 0 = at once, as in the paper.
    pub spacing_recovery_s: f64,
    /// Linear slack weight of the spacing, 1/m.
    pub spacing_l1_weight: f64,
    /// Quadratic slack weight of the spacing, 1/m².
    pub spacing_l2_weight: f64,
    /// Linear slack weight of the bounds of speed and acceleration.
    pub limit_l1_weight: f64,
    /// Quadratic slack weight of the bounds of speed and acceleration.
    pub limit_l2_weight: f64,
    /// V_max, m/s: 120 km/h.
    pub speed_max_mps: f64,
    /// V_min, m/s: 60 km/h.
    pub speed_min_mps: f64,
    /// Whether V_min bounds the speed, as in the paper: softly, at 1/100 of the spacing's weights. Otherwise standstill
    /// does.
    pub speed_floor: bool,
    /// Heading reference of Eq. 26.
    pub heading_reference: HeadingReference,
    /// Weight of the squared change of the road-wheel angle in a step against that of its square, R_2. Not in the
    /// paper.
    pub steer_change_weight: f64,
    /// Whether yaw rate and slip angles are bounded (the constraints of Eq. 26).
    pub stability_constraints: bool,
    /// Share of the slip limits that may be used: real tires exceed the linear model's slip at the limit by 11–19 %.
    /// The paper has 1.
    pub stability_tightening: f64,
    /// Share of μ g / V that bounds the yaw rate (Rajamani, 2012). The paper has 1.
    pub yaw_rate_factor: f64,
    /// Linear slack weight of the stability bounds, 1/rad.
    pub stability_l1_weight: f64,
    /// Quadratic slack weight of the stability bounds, 1/rad².
    pub stability_l2_weight: f64,
    /// What stands for all that lies beyond the lateral horizon. The paper has nothing.
    pub terminal_cost: TerminalCost,
    /// What the last stage of the lateral problem counts against the others where it is weighed. The paper has 1.
    pub terminal_weight: f64,
    /// Whether plans begin where the commands still on their way will have led, which matters only where the actuators
    /// have a delay.
    pub delay_compensation: bool,
    /// Whether constant disturbances (side wind, bank, grade, an unknown mass) are estimated and compensated. Not in the
    /// paper.
    pub observer: bool,
    /// Time constant of their estimates, s.
    pub observer_time_s: f64,
    /// Control steps for which an earlier plan may stand in for a failed solve.
    pub shifted_plan_steps: u8,
    /// Whether the guard checks every command. The paper has none.
    pub guard: bool,
    /// Braking the guard may use, m/s² (positive), within 95 % of μ g.
    pub emergency_brake_mps2: f64,
    /// Jerk the guard may use, m/s³.
    pub emergency_jerk_mps3: f64,
    /// By which share the car may be heavier than its controllers know: emergency braking and its jerk are counted on
    /// that much less, and still asked for in full.
    pub mass_margin: f64,
    /// Braking a leader is expected of, m/s² (positive), within 95 % of μ g; one that is seen to brake harder is expected
    /// to go on with that.
    pub leader_brake_mps2: f64,
    /// Time the ego is assumed to go on before it brakes, s: a control step and the drive train's lag, rounded up.
    pub reaction_s: f64,
    /// Distance the safe gap leaves between the bumpers, m.
    pub margin_m: f64,
    /// Lateral distance between centers below which a vehicle ahead matters in whatever lane it is, m.
    pub guard_lateral_m: f64,
}

/// What the brakes can do on the road ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footing {
    /// What the safe distance assumes, the descent and the margin of the mass taken off.
    pub braking: Braking,
    /// What may be asked of the tires here, m/s² (positive).
    pub tire_brake_mps2: f64,
    /// What the descent adds to the acceleration at most, m/s².
    pub descent_mps2: f64,
}

/// Whether the brakes have the same grip everywhere: one adhesion, and no bend that takes of it.
pub(crate) fn has_one_grip(road: &Road) -> bool {
    road.is_uniform() && road.config().curvature.is_empty()
}

impl Default for ControlConfig {
    fn default() -> Self {
        Self {
            accel_min_mps2: -6.0,
            accel_max_mps2: 2.0,
            jerk_max_mps3: 6.0,
            jerk_weight_s2: 0.01,
            longitudinal_horizon: 25,
            longitudinal_step_s: 0.2,
            goal_steps: 10,
            lateral_horizon: 20,
            spacing_min_m: 5.0,
            spacing_headway_s: 0.5,
            safe_spacing: true,
            safe_spacing_extra_m: 2.0,
            spacing_recovery_s: 4.0,
            spacing_l1_weight: 1e3,
            spacing_l2_weight: 1e2,
            limit_l1_weight: 5e4,
            limit_l2_weight: 1e4,
            speed_max_mps: 33.333,
            speed_min_mps: 16.667,
            speed_floor: false,
            heading_reference: HeadingReference::Slope,
            steer_change_weight: 1.0,
            stability_constraints: true,
            stability_tightening: 0.85,
            yaw_rate_factor: 0.85,
            stability_l1_weight: 2e4,
            stability_l2_weight: 1e6,
            terminal_cost: TerminalCost::Weighted,
            terminal_weight: 1.0,
            delay_compensation: true,
            observer: false,
            observer_time_s: 0.5,
            shifted_plan_steps: 5,
            guard: true,
            emergency_brake_mps2: 8.0,
            emergency_jerk_mps3: 25.0,
            mass_margin: 0.0,
            leader_brake_mps2: 7.0,
            reaction_s: 0.3,
            margin_m: 1.0,
            guard_lateral_m: 2.4,
        }
    }
}

impl ControlConfig {
    /// The paper's reading: 2 s of look-ahead, constant bounds, heading reference 0, no guard.
    pub fn paper() -> Self {
        Self {
            longitudinal_horizon: 20,
            longitudinal_step_s: 0.1,
            goal_steps: 20,
            safe_spacing: false,
            spacing_recovery_s: 0.0,
            speed_floor: true,
            heading_reference: HeadingReference::Zero,
            stability_tightening: 1.0,
            yaw_rate_factor: 1.0,
            guard: false,
            ..Self::default()
        }
    }

    /// What the safe distance assumes on a road of this adhesion.
    pub fn braking(&self, adhesion: f64) -> Braking {
        let grip_mps2 = USABLE_GRIP * adhesion * GRAVITY_MPS2;
        // Grip goes with the mass, the force of the brakes does not.
        let heavier = 1.0 + self.mass_margin;
        Braking {
            reaction_s: self.reaction_s,
            jerk_mps3: self.emergency_jerk_mps3 / heavier,
            max_brake_mps2: (self.emergency_brake_mps2 / heavier).min(grip_mps2),
            leader_brake_mps2: self.leader_brake_mps2.min(grip_mps2),
            margin_m: self.margin_m,
        }
    }

    /// Full braking of the ego, m/s² (positive), where a bend takes `lateral_mps2` of the grip: F_x² + F_y² ≤ (μ F_z)².
    pub(crate) fn brake_in_bend_mps2(&self, adhesion: f64, lateral_mps2: f64) -> f64 {
        let grip_mps2 = USABLE_GRIP * adhesion * GRAVITY_MPS2;
        let left_mps2 = (grip_mps2 * grip_mps2 - lateral_mps2 * lateral_mps2).max(0.0).sqrt();
        self.braking(adhesion).max_brake_mps2.min(left_mps2.max(LEAST_SHARE * grip_mps2))
    }

    /// The same at a place of the road and a speed.
    pub(crate) fn brake_at_mps2(&self, road: &Road, s_m: f64, speed_mps: f64) -> f64 {
        self.brake_in_bend_mps2(road.adhesion_at(s_m), speed_mps * speed_mps * road.curvature_radpm(s_m))
    }

    /// The same from `s_m` on at this speed: the ego counts with the lowest adhesion, the sharpest bend and the steepest
    /// descent in reach of its brakes, a leader with the road's own adhesion.
    pub fn braking_on(&self, road: &Road, s_m: f64, speed_mps: f64) -> Footing {
        let braking = self.braking(road.adhesion());
        if has_one_grip(road) && road.config().grade.is_empty() {
            return Footing { braking, tire_brake_mps2: self.tire_brake_mps2(road.adhesion()), descent_mps2: 0.0 };
        }
        let braking_here = self.braking(road.adhesion_at(s_m));
        let braked_m = speed_mps * speed_mps / (2.0 * braking.max_brake_mps2);
        let reach_m = (speed_mps * (braking.reaction_s + BUILD_UP_S) + braked_m).max(0.0);
        let adhesion = road.lowest_adhesion(s_m, reach_m);
        // A grade g takes g sin(atan g) ≤ g g.
        let descent_mps2 = GRAVITY_MPS2 * road.steepest_descent(s_m, reach_m);
        let sharpest_radpm = (0..=CURVATURE_POINTS)
            .map(|point| road.curvature_radpm(s_m + reach_m * f64::from(point) / f64::from(CURVATURE_POINTS)).abs())
            .fold(0.0, f64::max);
        let in_bend_mps2 = self.brake_in_bend_mps2(adhesion, speed_mps * speed_mps * sharpest_radpm);
        let max_brake_mps2 = (in_bend_mps2 - descent_mps2).max(BRAKE_MIN_MPS2);
        // The tires are asked for what they have here, not for what they will have.
        let lost_mps2 = braking_here.max_brake_mps2 - self.brake_at_mps2(road, s_m, speed_mps);
        let tire_brake_mps2 = self.tire_brake_mps2(road.adhesion_at(s_m)) - lost_mps2;
        Footing { braking: Braking { max_brake_mps2, ..braking }, tire_brake_mps2, descent_mps2 }
    }

    /// What full braking asks of the tires: for a heavier car, more than the grip would be for the known one.
    fn tire_brake_mps2(&self, adhesion: f64) -> f64 {
        let grip_mps2 = USABLE_GRIP * adhesion * GRAVITY_MPS2 * (1.0 + self.mass_margin);
        self.emergency_brake_mps2.min(grip_mps2)
    }

    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.validate_limits()?;
        self.validate_spacing()?;
        self.validate_stability()?;
        self.validate_guard()
    }

    fn validate_limits(&self) -> Result<(), ConfigError> {
        let most = MAX_HORIZON as f64;
        check_range("control.accel_min_mps2", self.accel_min_mps2, -12.0, -0.5)?;
        check_range("control.accel_max_mps2", self.accel_max_mps2, 0.5, 6.0)?;
        check_range("control.jerk_max_mps3", self.jerk_max_mps3, 0.5, 100.0)?;
        check_range("control.jerk_weight_s2", self.jerk_weight_s2, 1e-6, 100.0)?;
        check_range("control.longitudinal_horizon", f64::from(self.longitudinal_horizon), 2.0, most)?;
        check_range("control.longitudinal_step_s", self.longitudinal_step_s, 0.02, 0.5)?;
        check_range("control.goal_steps", f64::from(self.goal_steps), 1.0, most)?;
        check_range("control.lateral_horizon", f64::from(self.lateral_horizon), 2.0, most)?;
        check_range("control.limit_l1_weight", self.limit_l1_weight, 0.0, 1e8)?;
        check_range("control.limit_l2_weight", self.limit_l2_weight, 1e-3, 1e8)?;
        check_range("control.speed_max_mps", self.speed_max_mps, 1.0, 60.0)?;
        check_range("control.speed_min_mps", self.speed_min_mps, 0.0, 60.0)?;
        check_order(("control.speed_min_mps", self.speed_min_mps), ("control.speed_max_mps", self.speed_max_mps))
    }

    fn validate_spacing(&self) -> Result<(), ConfigError> {
        check_range("control.spacing_min_m", self.spacing_min_m, 0.0, 100.0)?;
        check_range("control.spacing_headway_s", self.spacing_headway_s, 0.0, 5.0)?;
        check_range("control.safe_spacing_extra_m", self.safe_spacing_extra_m, 0.0, 50.0)?;
        check_range("control.spacing_recovery_s", self.spacing_recovery_s, 0.0, 60.0)?;
        check_range("control.spacing_l1_weight", self.spacing_l1_weight, 0.0, 1e8)?;
        check_range("control.spacing_l2_weight", self.spacing_l2_weight, 1e-3, 1e8)
    }

    fn validate_stability(&self) -> Result<(), ConfigError> {
        check_range("control.steer_change_weight", self.steer_change_weight, 1e-6, 1e6)?;
        check_range("control.stability_tightening", self.stability_tightening, 0.1, 2.0)?;
        check_range("control.yaw_rate_factor", self.yaw_rate_factor, 0.1, 2.0)?;
        check_range("control.stability_l1_weight", self.stability_l1_weight, 0.0, 1e9)?;
        check_range("control.stability_l2_weight", self.stability_l2_weight, 1e-3, 1e9)?;
        check_range("control.terminal_weight", self.terminal_weight, 1.0, 1e3)?;
        check_range("control.observer_time_s", self.observer_time_s, 0.05, 60.0)?;
        check_range("control.shifted_plan_steps", f64::from(self.shifted_plan_steps), 0.0, 20.0)
    }

    fn validate_guard(&self) -> Result<(), ConfigError> {
        check_range("control.emergency_brake_mps2", self.emergency_brake_mps2, 1.0, 12.0)?;
        check_range("control.emergency_jerk_mps3", self.emergency_jerk_mps3, 1.0, 1000.0)?;
        check_range("control.mass_margin", self.mass_margin, 0.0, 1.0)?;
        check_range("control.leader_brake_mps2", self.leader_brake_mps2, 1.0, 12.0)?;
        check_range("control.reaction_s", self.reaction_s, 0.0, 3.0)?;
        check_range("control.margin_m", self.margin_m, 0.0, 20.0)?;
        check_range("control.guard_lateral_m", self.guard_lateral_m, 0.0, 6.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_presets_are_valid_and_survive_a_file() {
        for config in [ControlConfig::default(), ControlConfig::paper()] {
            config.validate().unwrap();
            let text = toml::to_string(&config).unwrap();
            assert_eq!(toml::from_str::<ControlConfig>(&text).unwrap(), config);
        }
    }

    #[test]
    fn bad_values_are_refused_by_name() {
        let bad = ControlConfig { jerk_max_mps3: f64::NAN, ..ControlConfig::default() };
        assert!(bad.validate().unwrap_err().to_string().contains("control.jerk_max_mps3"));
        assert!(toml::from_str::<ControlConfig>("jerk_mx_mps3 = 3.0").is_err());
    }
}
