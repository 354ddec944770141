//! The ego car's law of safe distance, after responsibility-sensitive safety (Shalev-Shwartz, Shammah and Shashua,
//! 2017).
//!
//! The leader may brake at any time, as hard as it can; the ego goes on at its present acceleration for a reaction
//! time, then builds up its own full braking at a bounded jerk. The gap is safe if the two never touch. Where the ego
//! brakes harder than the leader, the closest instant may come before both stand: then it counts, and not the
//! difference of the stopping distances.

use serde::{Deserialize, Serialize};

/// What both cars are assumed to do in an emergency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Braking {
    /// How long the ego goes on at its present acceleration, s.
    pub reaction_s: f64,
    /// How fast the ego then builds up its braking, m/s³.
    pub jerk_mps3: f64,
    /// Full braking of the ego, m/s² (positive).
    pub max_brake_mps2: f64,
    /// Full braking of a leader, m/s² (positive).
    pub leader_brake_mps2: f64,
    /// What must be left between the bumpers, m.
    pub margin_m: f64,
}

impl Braking {
    /// The same behind this leader: one that is seen to brake harder than expected is expected to go on with that.
    #[must_use]
    pub fn behind(&self, leader_accel_mps2: f64) -> Self {
        Self { leader_brake_mps2: self.leader_brake_mps2.max(-leader_accel_mps2), ..*self }
    }
}

/// Where the ego is when it brakes in full.
struct Onset {
    time_s: f64,
    distance_m: f64,
    speed_mps: f64,
}

/// Where and when it stands, if that is before it brakes in full.
struct EarlyStop {
    time_s: f64,
    distance_m: f64,
}

/// Reaction and build-up of the braking.
fn onset(speed_mps: f64, accel_mps2: f64, braking: &Braking) -> Result<Onset, EarlyStop> {
    let (v, b, j) = (speed_mps.max(0.0), braking.max_brake_mps2, braking.jerk_mps3);
    let a = accel_mps2.max(-b);
    let reaction = braking.reaction_s;
    let v1 = v + a * reaction;
    if v1 <= 0.0 {
        let time_s = if a < 0.0 { v / -a } else { 0.0 };
        return Err(EarlyStop { time_s, distance_m: 0.5 * v * time_s });
    }
    let d1 = 0.5 * (v + v1) * reaction;
    let build_up = (a + b) / j;
    let v2 = v1 + a * build_up - 0.5 * j * build_up * build_up;
    let travelled = |t: f64| d1 + t * (v1 + t * (0.5 * a - j * t / 6.0));
    if v2 <= 0.0 {
        let stop = (a + (a * a + 2.0 * j * v1).sqrt()) / j;
        return Err(EarlyStop { time_s: reaction + stop, distance_m: travelled(stop) });
    }
    Ok(Onset { time_s: reaction + build_up, distance_m: travelled(build_up), speed_mps: v2 })
}

/// Distance the ego needs to stand, m: reaction, build-up and full braking.
pub fn stopping_distance_m(speed_mps: f64, accel_mps2: f64, braking: &Braking) -> f64 {
    match onset(speed_mps, accel_mps2, braking) {
        Err(stop) => stop.distance_m,
        Ok(full) => full.distance_m + full.speed_mps * full.speed_mps / (2.0 * braking.max_brake_mps2),
    }
}

/// A safe gap and how fast it grows with the ego's speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafeGap {
    /// Bumper-to-bumper gap, m.
    pub gap_m: f64,
    /// Its slope in the ego's speed, s.
    pub slope_s: f64,
}

/// Bumper-to-bumper gap that keeps the margin if the leader brakes in full from now on, m.
pub fn safe_gap_m(ego_speed_mps: f64, ego_accel_mps2: f64, leader_speed_mps: f64, braking: &Braking) -> f64 {
    safe_gap(ego_speed_mps, ego_accel_mps2, leader_speed_mps, braking).gap_m
}

/// The gap of [`safe_gap_m`] with its slope.
pub fn safe_gap(ego_speed_mps: f64, ego_accel_mps2: f64, leader_speed_mps: f64, braking: &Braking) -> SafeGap {
    let (b, b_leader) = (braking.max_brake_mps2, braking.leader_brake_mps2);
    let v_leader = leader_speed_mps.max(0.0);
    let leader_stop_m = v_leader * v_leader / (2.0 * b_leader);
    let (closing_m, slope_s) = match onset(ego_speed_mps, ego_accel_mps2, braking) {
        Err(stop) => (stop.distance_m - leader_stop_m, stop.time_s),
        Ok(full) => {
            let leader_then = v_leader - b_leader * full.time_s;
            let approach = full.speed_mps - leader_then;
            let gain = b - b_leader;
            // The speeds become equal while both still move: that is the closest instant.
            if approach > 0.0 && gain > 0.0 && leader_then > b_leader * approach / gain {
                let leader_m = full.time_s * (v_leader - 0.5 * b_leader * full.time_s);
                (full.distance_m - leader_m + approach * approach / (2.0 * gain), full.time_s + approach / gain)
            } else {
                let rest_s = full.speed_mps / b;
                (full.distance_m + 0.5 * full.speed_mps * rest_s - leader_stop_m, full.time_s + rest_s)
            }
        }
    };
    if closing_m > 0.0 {
        SafeGap { gap_m: closing_m + braking.margin_m, slope_s }
    } else {
        SafeGap { gap_m: braking.margin_m, slope_s: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BRAKING: Braking =
        Braking { reaction_s: 0.3, jerk_mps3: 25.0, max_brake_mps2: 8.0, leader_brake_mps2: 7.0, margin_m: 1.0 };

    /// Smallest gap of the proper response, by brute force in steps of 1 ms.
    fn closest_m(gap_m: f64, ego: (f64, f64), leader_speed: f64, braking: &Braking) -> (f64, f64) {
        let dt = 1e-3;
        let ((mut v, mut a), mut v_leader) = (ego, leader_speed);
        let (mut gap, mut closest, mut travelled) = (gap_m, gap_m, 0.0);
        for k in 0..40_000 {
            if f64::from(k) * dt >= braking.reaction_s {
                a = (a - braking.jerk_mps3 * dt).max(-braking.max_brake_mps2);
            }
            let v_next = (v + a * dt).max(0.0);
            let leader_next = (v_leader - braking.leader_brake_mps2 * dt).max(0.0);
            travelled += 0.5 * (v + v_next) * dt;
            gap += 0.5 * (v_leader + leader_next - v - v_next) * dt;
            (v, v_leader) = (v_next, leader_next);
            closest = closest.min(gap);
        }
        (closest, travelled)
    }

    #[test]
    fn the_proper_response_never_touches_and_wastes_nothing() {
        for v in [0.0, 3.0, 12.0, 22.0, 30.0, 33.3, 45.0, 60.0] {
            for v_leader in [0.0, 5.0, 15.0, 25.0, 33.3, 50.0] {
                for a in [-8.0, -3.0, 0.0, 2.0] {
                    let gap = safe_gap_m(v, a, v_leader, &BRAKING);
                    let (closest, _) = closest_m(gap, (v, a), v_leader, &BRAKING);
                    // Brute force's first-order error in the acceleration: 60 m/s · 1 ms.
                    assert!(closest > 1.0 - 0.07, "v {v} a {a} leader {v_leader}: closest {closest}");
                    let tight = gap > 1.0 && closest > 1.0 + 0.07;
                    assert!(!tight, "v {v} a {a} leader {v_leader}: {closest} m left");
                }
            }
        }
    }

    #[test]
    fn the_stopping_distance_is_that_of_the_motion() {
        for (v, a) in [(0.0, 2.0), (1.0, -4.0), (2.0, 0.0), (10.0, 2.0), (33.3, -2.0), (60.0, -8.0)] {
            let (_, travelled) = closest_m(1e6, (v, a), 0.0, &BRAKING);
            assert!((stopping_distance_m(v, a, &BRAKING) - travelled).abs() < 0.07, "v {v} a {a}");
        }
    }

    #[test]
    fn the_slope_is_the_derivative() {
        for (v, a, v_leader) in [(1.0, 0.0, 0.0), (20.0, 0.0, 10.0), (40.0, 1.0, 40.0), (30.0, -4.0, 20.0)] {
            let difference = safe_gap_m(v + 1e-4, a, v_leader, &BRAKING) - safe_gap_m(v - 1e-4, a, v_leader, &BRAKING);
            let slope = safe_gap(v, a, v_leader, &BRAKING).slope_s;
            // Central difference: rounding of 1e-14 · 100 m over 2e-4 m/s.
            assert!((slope - difference / 2e-4).abs() < 1e-6, "v {v} a {a}: {slope}");
        }
    }

    #[test]
    fn figures_at_equal_speed() {
        // Braking at 7 behind a leader that brakes at 8, 0.1 s reaction at 3 m/s² and at once: 12.3 m at 30 m/s
        // (responsibility-sensitive safety's own formula, which speeds up during the reaction).
        let braking =
            Braking { reaction_s: 0.1, jerk_mps3: 1e9, max_brake_mps2: 7.0, leader_brake_mps2: 8.0, margin_m: 0.0 };
        assert!((safe_gap_m(30.0, 3.0, 30.0, &braking) - 12.3).abs() < 0.05);
    }
}
