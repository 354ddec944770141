//! The reward (Eqs. 5-8), as repaired: what the learner is given, and the one fixed form in which every policy is scored.
//!
//! As printed, the collision term is blind (its potential is in meters: bumper contact gives 1e-5), the lane term overflows and
//! punishes the lane's center (departures 5 and 6 in `docs/deviations.md`). The literal forms are kept for the preset `paper`.

use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_order, check_range};
use crate::scene::Scene;

/// The paper's lane width and the length over which a gap counts as close, m: they make the potential of Eq. 7 dimensionless.
const LATERAL_SCALE_M: f64 = 3.75;
const LONGITUDINAL_SCALE_M: f64 = 10.0;
/// Exponents σ1 and σ2 of Eq. 7.
const SIGMA_LATERAL: f64 = -3.0;
const SIGMA_LONGITUDINAL: f64 = -0.5;
/// The legal limits of Chinese expressways, 60 and 120 km/h: the paper's captions lie within, its text gives none.
const SCORE_SPEED_MIN_MPS: f64 = 60.0 / 3.6;
const SCORE_SPEED_MAX_MPS: f64 = 120.0 / 3.6;
/// Weights of Eq. 5.
const SPEED_WEIGHT: f64 = 20.0;
const COLLISION_WEIGHT: f64 = -5.0;
const LANE_WEIGHT: f64 = -0.1;

/// Units of the potential of Eq. 7.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CollisionForm {
    /// Lane widths and tens of meters.
    Normalized,
    /// Meters, as printed.
    Meters,
}

/// Shape of the lane term of Eq. 8.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LaneForm {
    /// 1 − exp(−d²/(2 · 0.5²)): 0 on the lane's center, 1 on the marking.
    OffCenter,
    /// 2.5 exp(+d²/(2 · 0.1²)) as printed, with the exponent held below 20.
    Literal,
}

/// The learner's reward.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RewardConfig {
    /// ω_sped of Eq. 5 (20).
    pub speed_weight: f64,
    /// ω_col of Eq. 5 (−5).
    pub collision_weight: f64,
    /// ω_lanc of Eq. 5 (−0.1).
    pub lane_weight: f64,
    /// Units of Eq. 7.
    pub collision_form: CollisionForm,
    /// Shape of Eq. 8.
    pub lane_form: LaneForm,
    /// V_min of Eq. 6, m/s; below it the term goes on falling, to −1.
    pub speed_min_mps: f64,
    /// V_max of Eq. 6, m/s.
    pub speed_max_mps: f64,
    /// Weight of the mean absolute jerk of a tick (per m/s³): cuts needless lane changes; 0 in the paper.
    pub jerk_weight: f64,
    /// Weight of tracking error, sideslip and steering effort, without which q2 has no effect on the reward; 0 in the paper.
    pub control_quality_weight: f64,
    /// Added once on a collision; 0 in the paper.
    pub collision_penalty: f64,
}

impl Default for RewardConfig {
    fn default() -> Self {
        Self {
            speed_weight: SPEED_WEIGHT,
            collision_weight: COLLISION_WEIGHT,
            lane_weight: LANE_WEIGHT,
            collision_form: CollisionForm::Normalized,
            lane_form: LaneForm::OffCenter,
            speed_min_mps: 16.667,
            speed_max_mps: 33.333,
            jerk_weight: -0.5,
            control_quality_weight: 0.0,
            collision_penalty: 0.0,
        }
    }
}

impl RewardConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("reward.speed_weight", self.speed_weight, 0.0, 1e3)?;
        check_range("reward.collision_weight", self.collision_weight, -1e3, 0.0)?;
        check_range("reward.lane_weight", self.lane_weight, -1e3, 0.0)?;
        check_range("reward.speed_min_mps", self.speed_min_mps, 0.0, 60.0)?;
        check_range("reward.speed_max_mps", self.speed_max_mps, 1.0, 60.0)?;
        check_order(("reward.speed_min_mps", self.speed_min_mps + 0.1), ("reward.speed_max_mps", self.speed_max_mps))?;
        check_range("reward.jerk_weight", self.jerk_weight, -100.0, 0.0)?;
        check_range("reward.control_quality_weight", self.control_quality_weight, -100.0, 0.0)?;
        check_range("reward.collision_penalty", self.collision_penalty, -1e4, 0.0)
    }

    /// The terms of one tick, each times its weight, from the scene at its end and how it was driven.
    pub fn terms(&self, scene: &Scene, quality: &TickQuality, collided: bool) -> RewardTerms {
        let speed = speed_term(scene.ego.speed_mps, self.speed_min_mps, self.speed_max_mps);
        let lane = match self.lane_form {
            LaneForm::OffCenter => off_center_term(scene),
            LaneForm::Literal => {
                let off_m = off_center_m(scene);
                2.5 * libm::exp((off_m * off_m / (2.0 * 0.1 * 0.1)).min(20.0))
            }
        };
        RewardTerms {
            speed: self.speed_weight * speed,
            collision: self.collision_weight * collision_term(scene, self.collision_form),
            lane: self.lane_weight * lane,
            jerk: self.jerk_weight * quality.mean_abs_jerk_mps3,
            control_quality: self.control_quality_weight * quality.control_quality,
            penalty: if collided { self.collision_penalty } else { 0.0 },
        }
    }
}

/// How a tick was driven: means over its control steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TickQuality {
    /// Mean absolute jerk, m/s³.
    pub mean_abs_jerk_mps3: f64,
    /// Mean of |d − d_ref|/0.5 m + |β|/β_max + |δ|/δ_max.
    pub control_quality: f64,
}

/// The weighted terms of one tick's reward.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RewardTerms {
    /// High speed (Eq. 6).
    pub speed: f64,
    /// Closeness to others (Eq. 7).
    pub collision: f64,
    /// Distance from the lane's center (Eq. 8).
    pub lane: f64,
    /// Jerk.
    pub jerk: f64,
    /// Tracking, stability and effort.
    pub control_quality: f64,
    /// Collision penalty.
    pub penalty: f64,
}

impl RewardTerms {
    /// The terms of this share of a tick: all but the penalty, which is paid once.
    #[must_use]
    pub fn over(self, share: f64) -> Self {
        Self {
            speed: share * self.speed,
            collision: share * self.collision,
            lane: share * self.lane,
            jerk: share * self.jerk,
            control_quality: share * self.control_quality,
            penalty: self.penalty,
        }
    }

    /// Their sum, the tick's reward in the paper's units.
    pub fn sum(&self) -> f64 {
        self.speed + self.collision + self.lane + self.jerk + self.control_quality + self.penalty
    }
}

/// The score of a tick: Eq. 5 in one fixed form, the same for every policy whatever it was trained with.
pub fn score(scene: &Scene) -> f64 {
    SPEED_WEIGHT * speed_term(scene.ego.speed_mps, SCORE_SPEED_MIN_MPS, SCORE_SPEED_MAX_MPS)
        + COLLISION_WEIGHT * collision_term(scene, CollisionForm::Normalized)
        + LANE_WEIGHT * off_center_term(scene)
}

/// Eq. 6, held above −1 so that standing still costs no more than 20 a tick.
fn speed_term(speed_mps: f64, min_mps: f64, max_mps: f64) -> f64 {
    ((speed_mps - min_mps) / (max_mps - min_mps)).max(-1.0)
}

/// Eq. 7 over all perceived vehicles.
fn collision_term(scene: &Scene, form: CollisionForm) -> f64 {
    let (lateral_m, longitudinal_m) = match form {
        CollisionForm::Normalized => (LATERAL_SCALE_M, LONGITUDINAL_SCALE_M),
        CollisionForm::Meters => (1.0, 1.0),
    };
    // Beyond seven scales ahead a vehicle adds less than exp(−24).
    let near = scene.neighbors.iter().filter(|n| n.ahead_m.abs() < 7.0 * longitudinal_m);
    near.map(|neighbor| {
        let y = (neighbor.d_m - scene.ego.d_m) / lateral_m;
        let x = neighbor.ahead_m / longitudinal_m;
        libm::exp(SIGMA_LATERAL * y * y + SIGMA_LONGITUDINAL * x * x)
    })
    .sum()
}

fn off_center_m(scene: &Scene) -> f64 {
    scene.ego.d_m - scene.road.lane_center_m(scene.ego_lane)
}

fn off_center_term(scene: &Scene) -> f64 {
    let off_m = off_center_m(scene);
    1.0 - libm::exp(-off_m * off_m / 0.5)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::road::{LaneIndex, Road, RoadConfig};
    use crate::scene::{Neighbor, VehicleId};
    use crate::vehicle::VehicleState;

    fn scene(speed_mps: f64, ahead_m: Option<f64>) -> Scene {
        let neighbor = |ahead_m| Neighbor::car(VehicleId(1), LaneIndex(0), 0.0, ahead_m, speed_mps);
        Scene {
            road: Arc::new(Road::new(RoadConfig::default()).expect("valid")),
            ego: VehicleState { speed_mps, ..VehicleState::default() },
            ego_length_m: 4.8,
            ego_width_m: 1.9,
            ego_lane: LaneIndex(0),
            neighbors: ahead_m.map(neighbor).into_iter().collect(),
        }
    }

    #[test]
    fn free_driving_at_the_limit_scores_twenty() {
        assert!((score(&scene(120.0 / 3.6, None)) - 20.0).abs() < 1e-12);
        assert!((score(&scene(60.0 / 3.6, None))).abs() < 1e-12);
        assert!((score(&scene(0.0, None)) + 20.0).abs() < 1e-12);
    }

    #[test]
    fn a_car_ten_meters_ahead_costs_three() {
        let alone = score(&scene(25.0, None));
        let close = score(&scene(25.0, Some(10.0)));
        // −5 exp(−0.5) = −3.03.
        assert!((close - alone + 5.0 * libm::exp(-0.5)).abs() < 1e-12);
    }

    #[test]
    fn the_printed_potential_is_blind_to_bumper_contact() {
        let config = RewardConfig { collision_form: CollisionForm::Meters, ..RewardConfig::default() };
        let terms = config.terms(&scene(25.0, Some(4.8)), &TickQuality::default(), false);
        assert!(terms.collision.abs() < 1e-4);
    }

    #[test]
    fn the_printed_lane_term_stays_finite() {
        let config = RewardConfig { lane_form: LaneForm::Literal, ..RewardConfig::default() };
        let mut off = scene(25.0, None);
        off.ego.d_m = 1.8;
        assert!(config.terms(&off, &TickQuality::default(), false).sum().is_finite());
    }
}
