//! Which car-following model human drivers have: the Intelligent Driver Model, or the enhanced one.
//!
//! The enhanced model (Kesting, Treiber and Helbing, 2010, "Enhanced intelligent driver model to access the impact of driving
//! strategies on traffic capacity") keeps IDM where IDM is the gentler one. Where IDM brakes harder than the
//! constant-acceleration heuristic a_CAH finds necessary, as behind a vehicle that cut in, it trusts the heuristic:
//!
//! a = a_IDM if a_IDM ≥ a_CAH, else (1 − c) a_IDM + c [a_CAH + b tanh((a_IDM − a_CAH) / b)] with the coolness c = 0.99.
//!
//! a_CAH is what avoids a collision if the leader keeps its acceleration. With ã_l = min(a_l, a_max) it is
//! v² ã_l / (v_l² − 2 s ã_l) if v_l (v − v_l) < −2 s ã_l, where the leader stops first, else ã_l − (v − v_l)² Θ(v − v_l) / (2 s).
//! The paper writes ≤: both branches agree at the border, but there the first is 0/0 behind a standing leader.
//!
//! Without an approach and behind a leader at constant speed a_CAH is 0, so that both models have the same equilibrium.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::idm::{IdmTerms, SHORTEST_GAP_M};

/// Coolness c: how far the heuristic is trusted (Kesting 2010: 0.99; 0 is IDM).
const COOLNESS: f64 = 0.99;

/// A car-following model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CarFollowing {
    /// The Intelligent Driver Model (Treiber, Hennecke and Helbing, 2000).
    #[default]
    Idm,
    /// The same with the constant-acceleration heuristic, which does not overreact when somebody cuts in.
    EnhancedIdm,
}

/// A vehicle ahead, as its follower sees it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Leader {
    /// Bumper-to-bumper gap, infinite without a leader, m.
    pub gap_m: f64,
    /// Its speed, m/s.
    pub speed_mps: f64,
    /// Its acceleration, m/s².
    pub accel_mps2: f64,
}

impl CarFollowing {
    /// Acceleration behind a leader, m/s².
    // Must be inlined into the loops that `pulp` compiles for the processor's instruction set.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub fn accel_mps2(self, speed_mps: f64, leader: &Leader, driver: &IdmTerms) -> f64 {
        let idm_mps2 = driver.accel_mps2(leader.gap_m, speed_mps, speed_mps - leader.speed_mps);
        match self {
            Self::EnhancedIdm if leader.gap_m < f64::INFINITY => {
                cooled(idm_mps2, heuristic_mps2(speed_mps, leader, driver.max_accel_mps2), driver.comfort_decel_mps2())
            }
            Self::Idm | Self::EnhancedIdm => idm_mps2,
        }
    }
}

/// The demand of IDM, softened where the heuristic asks for less braking, m/s²; `b` is the comfortable deceleration.
fn cooled(idm_mps2: f64, heuristic_mps2: f64, b: f64) -> f64 {
    if idm_mps2 >= heuristic_mps2 {
        return idm_mps2;
    }
    let calm_mps2 = heuristic_mps2 + b * libm::tanh((idm_mps2 - heuristic_mps2) / b);
    (1.0 - COOLNESS) * idm_mps2 + COOLNESS * calm_mps2
}

/// The acceleration a_CAH that just avoids a collision if the leader keeps its own, m/s².
fn heuristic_mps2(speed_mps: f64, leader: &Leader, max_accel_mps2: f64) -> f64 {
    let (v, v_leader, gap_m) = (speed_mps, leader.speed_mps, leader.gap_m.max(SHORTEST_GAP_M));
    let leader_mps2 = leader.accel_mps2.min(max_accel_mps2);
    if v_leader * (v - v_leader) < -2.0 * gap_m * leader_mps2 {
        return v * v * leader_mps2 / (v_leader * v_leader - 2.0 * gap_m * leader_mps2);
    }
    let approach = (v - v_leader).max(0.0);
    leader_mps2 - approach * approach / (2.0 * gap_m)
}

#[cfg(test)]
mod tests {
    use super::super::idm::{IdmParams, idm_equilibrium_gap_m};
    use super::*;

    const DRIVER: IdmParams = IdmParams {
        desired_speed_mps: 120.0 / 3.6,
        time_headway_s: 1.5,
        min_gap_m: 2.0,
        max_accel_mps2: 1.4,
        comfort_decel_mps2: 2.0,
    };

    fn both(speed_mps: f64, gap_m: f64, leader_mps: f64, leader_mps2: f64) -> [f64; 2] {
        let leader = Leader { gap_m, speed_mps: leader_mps, accel_mps2: leader_mps2 };
        [CarFollowing::Idm, CarFollowing::EnhancedIdm]
            .map(|model| model.accel_mps2(speed_mps, &leader, &IdmTerms::from(&DRIVER)))
    }

    #[test]
    fn the_equilibrium_is_that_of_idm() {
        for speed_mps in [0.0, 5.0, 20.0, 33.0] {
            let gap_m = idm_equilibrium_gap_m(speed_mps, &DRIVER);
            // 1e-9: the bar for analytic checks.
            assert!(both(speed_mps, gap_m, speed_mps, 0.0)[1].abs() < 1e-9, "at {speed_mps} m/s");
        }
    }

    #[test]
    fn behind_a_cut_in_at_equal_speed_little_more_than_the_comfortable_deceleration_is_left() {
        let [idm, enhanced] = both(25.0, 10.0, 25.0, 0.0);
        assert!(idm < -20.0, "{idm}");
        // a_CAH = 0 and the tanh is saturated: a = (1 − c) a_IDM − c b.
        assert!((enhanced - (0.01 * idm - 0.99 * 2.0)).abs() < 1e-6, "{enhanced}");
    }

    #[test]
    fn the_heuristic_has_its_analytic_values() {
        let heuristic = |speed_mps, gap_m, leader_mps, leader_mps2| {
            let leader = Leader { gap_m, speed_mps: leader_mps, accel_mps2: leader_mps2 };
            heuristic_mps2(speed_mps, &leader, DRIVER.max_accel_mps2)
        };
        // Equal speeds, nobody accelerates.
        assert_eq!(heuristic(20.0, 30.0, 20.0, 0.0), 0.0);
        // The approach is spent over the gap: (25 − 20)² / (2 · 25).
        assert!((heuristic(25.0, 25.0, 20.0, 0.0) + 0.5).abs() < 1e-12);
        // Nobody ahead: IDM.
        assert_eq!(both(40.0, f64::INFINITY, 0.0, 0.0)[0], both(40.0, f64::INFINITY, 0.0, 0.0)[1]);
        // A standing leader: stop within the gap, 20² / (2 · 50).
        assert!((heuristic(20.0, 50.0, 0.0, 0.0) + 4.0).abs() < 1e-12);
        // A leader that brakes to a stop in 10² / (2 · 2) = 25 m: stop within 25 + 20 m.
        assert!((heuristic(10.0, 20.0, 10.0, -2.0) + 100.0 / 90.0).abs() < 1e-12);
        // One that accelerates beyond what the follower can is taken to accelerate as the follower can.
        assert_eq!(heuristic(20.0, 30.0, 20.0, 3.0), heuristic(20.0, 30.0, 20.0, 1.4));
    }

    /// A follower with either model drives without a jump from one branch into the other.
    #[test]
    fn the_acceleration_is_continuous_where_the_branches_meet() {
        let [gap_m, speed_mps, leader_mps] = [30.0, 22.0, 20.0];
        // v_l (v − v_l) = −2 s ã_l.
        let border_mps2 = -leader_mps * (speed_mps - leader_mps) / (2.0 * gap_m);
        let [below, above] = [-1e-9, 1e-9].map(|step| both(speed_mps, gap_m, leader_mps, border_mps2 + step)[1]);
        assert!((below - above).abs() < 1e-7);
    }

    #[test]
    fn it_brakes_like_idm_or_less_but_never_less_than_the_heuristic_asks() {
        for speed_mps in [0.0, 10.0, 25.0, 35.0] {
            for gap_m in [-1.0, 0.5, 10.0, 40.0, 200.0] {
                for (leader_mps, leader_mps2) in [(0.0, 0.0), (10.0, -4.0), (25.0, 0.0), (30.0, 2.0)] {
                    let [idm, enhanced] = both(speed_mps, gap_m, leader_mps, leader_mps2);
                    let leader = Leader { gap_m, speed_mps: leader_mps, accel_mps2: leader_mps2 };
                    let heuristic = heuristic_mps2(speed_mps, &leader, DRIVER.max_accel_mps2);
                    assert!(enhanced.is_finite() && enhanced >= idm - 1e-9 && enhanced <= idm.max(heuristic) + 1e-9);
                }
            }
        }
    }
}
