//! The safe distance on a road whose adhesion, bends or grade change what the brakes can do: the law of [`crate::models::rss`], played through.
//!
//! Closed forms need one braking for the whole stop. Counting with the lowest in reach keeps no promise: what is safe
//! now may not be when a slippery stretch comes into reach. What is played through stays true: whoever answers as in
//! the play is where the play said, so that a distance once safe can be kept safe by braking.

use crate::control::config::ControlConfig;
use crate::road::Road;
use crate::vehicle::tire::GRAVITY_MPS2;

/// Steps of the play, s: the gap's error is below b h² / 8 for each change of the braking b, 1 cm.
const STEP_S: f64 = 0.1;
/// No stop takes longer: 60 m/s at 0.5 m/s².
const LONGEST_STEPS: u32 = 1200;

/// Where the play begins.
#[derive(Clone, Copy)]
pub(crate) struct Opening {
    /// Position of the ego along the road, m.
    pub(crate) s_m: f64,
    /// Its speed, m/s, and what its tires do, m/s².
    pub(crate) speed_mps: f64,
    pub(crate) accel_mps2: f64,
    /// The leader's speed, m/s, its full braking, m/s² (positive), and how far its rear bumper is ahead of the ego's
    /// front, m.
    pub(crate) leader_speed_mps: f64,
    pub(crate) leader_brake_mps2: f64,
    pub(crate) gap_m: f64,
}

/// Smallest gap, m, if the leader brakes in full from now on and the ego after its reaction, each by what it has.
pub(crate) fn closest_m(config: &ControlConfig, road: &Road, opening: &Opening) -> f64 {
    let base = config.braking(road.adhesion());
    let Opening { s_m: mut s, speed_mps: mut v, accel_mps2: mut tires, .. } = *opening;
    let Opening { leader_speed_mps: mut leader, leader_brake_mps2, gap_m: mut gap, .. } = *opening;
    let mut closest = gap;
    for k in 0..LONGEST_STEPS {
        if v <= 0.0 || gap < 0.0 {
            break;
        }
        let most = config.brake_at_mps2(road, s, v);
        // The step in which the reaction ends counts by its share.
        let braked_s = (f64::from(k + 1) * STEP_S - base.reaction_s).clamp(0.0, STEP_S);
        let before = tires.max(-most);
        tires = (before - base.jerk_mps3 * braked_s).max(-most);
        let ramp_s = braked_s.min((before - tires) / base.jerk_mps3);
        let pushed_mps = before * (STEP_S - braked_s) + 0.5 * (before + tires) * ramp_s + tires * (braked_s - ramp_s);
        let accel = pushed_mps / STEP_S - GRAVITY_MPS2 * road.grade(s);
        let next = (v + accel * STEP_S).max(0.0);
        let leader_next = (leader - leader_brake_mps2 * STEP_S).max(0.0);
        let leader_s = STEP_S.min(leader / leader_brake_mps2);
        let own_m = 0.5 * (v + next) * if next > 0.0 { STEP_S } else { STEP_S.min(-v / accel) };
        gap += 0.5 * (leader + leader_next) * leader_s - own_m;
        s += own_m;
        (v, leader, closest) = (next, leader_next, closest.min(gap));
    }
    if v > 0.0 { f64::NEG_INFINITY } else { closest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::rss::safe_gap_m;
    use crate::road::{AdhesionPatch, CurvaturePoint, RoadConfig, Topology};

    fn road(patches: &[AdhesionPatch]) -> Road {
        let config =
            RoadConfig { topology: Topology::Open, adhesion_patches: patches.to_vec(), ..RoadConfig::default() };
        Road::new(config).unwrap()
    }

    /// How far the car comes from 20 m/s towards a wall far away, m.
    fn stop_m(config: &ControlConfig, road: &Road) -> f64 {
        let opening = Opening {
            s_m: 0.0,
            speed_mps: 20.0,
            accel_mps2: 0.0,
            leader_speed_mps: 0.0,
            leader_brake_mps2: 7.0,
            gap_m: 500.0,
        };
        500.0 - closest_m(config, road, &opening)
    }

    #[test]
    fn on_a_uniform_road_it_is_the_closed_form() {
        let config = ControlConfig::default();
        let braking = config.braking(0.85);
        for speed_mps in [5.0, 17.0, 33.0] {
            for leader_speed_mps in [0.0, 12.0, 30.0] {
                for accel_mps2 in [-4.0, 0.0, 2.0] {
                    let gap_m = safe_gap_m(speed_mps, accel_mps2, leader_speed_mps, &braking);
                    let leader_brake_mps2 = braking.leader_brake_mps2;
                    let opening =
                        Opening { s_m: 0.0, speed_mps, accel_mps2, leader_speed_mps, leader_brake_mps2, gap_m };
                    let left_m = closest_m(&config, &road(&[]), &opening);
                    let wanted_m = braking.margin_m;
                    // What the play's steps cost.
                    assert!((left_m - wanted_m).abs() < 0.1, "{speed_mps} {leader_speed_mps} {accel_mps2}: {left_m} m");
                }
            }
        }
    }

    #[test]
    fn ice_lengthens_the_stop_by_what_it_covers() {
        // From 20 m/s: 7 m/s² on the road, 1.864 on ice (95 % of μ g), of which 20 m lie in the way.
        let config = ControlConfig {
            emergency_brake_mps2: 7.0,
            reaction_s: 0.0,
            emergency_jerk_mps3: 1e6,
            ..ControlConfig::default()
        };
        let stop = |patches: &[AdhesionPatch]| stop_m(&config, &road(patches));
        let ice = AdhesionPatch { s_m: 5.0, length_m: 20.0, adhesion: 0.2 };
        let expected_m = (400.0 - 40.0 * 0.95 * 0.2 * GRAVITY_MPS2) / 14.0 + 20.0;
        assert!((stop(&[]) - 400.0 / 14.0).abs() < 0.05, "{} m", stop(&[]));
        assert!((stop(&[ice]) - expected_m).abs() < 1.0, "{} m, not {expected_m} m", stop(&[ice]));
    }

    #[test]
    fn a_bend_lengthens_the_stop_until_the_car_is_slow() {
        // 20 m/s on μ = 0.4 around 150 m of radius: the bend takes 2.67 of 3.73 m/s², and less and less as the speed falls.
        let config = ControlConfig { reaction_s: 0.0, emergency_jerk_mps3: 1e6, ..ControlConfig::default() };
        let stop = |curvature_radpm: f64| {
            let curvature = vec![CurvaturePoint { s_m: 0.0, curvature_radpm }];
            let bend = RoadConfig { topology: Topology::Open, adhesion: 0.4, curvature, ..RoadConfig::default() };
            stop_m(&config, &Road::new(bend).unwrap())
        };
        let grip = 0.95 * 0.4 * GRAVITY_MPS2;
        // With u = V²: du/ds = −2 √(g² − κ² u²), so that the stop takes arcsin(κ V² / g) / (2 κ).
        let (straight_m, kappa) = (400.0 / (2.0 * grip), 1.0 / 150.0_f64);
        let bent_m = libm::asin(400.0 * kappa / grip) / (2.0 * kappa);
        assert!((stop(0.0) - straight_m).abs() < 0.1, "{} m", stop(0.0));
        assert!((stop(kappa) - bent_m).abs() < 0.3 && bent_m > straight_m + 5.0, "{} m, not {bent_m} m", stop(kappa));
    }
}
