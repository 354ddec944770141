//! The safe distance: far enough to stop behind a leader that brakes as hard as it can.
//!
//! With speed v and braking b of the follower, v_l and b_l of the leader, gap g and margin m, a state is safe if
//! g ≥ m + max(0, v²/(2b) − v_l²/(2b_l)). This is the condition behind the safe speed of Krauss (1998), here for the ballistic
//! update with its exact stop, so that it is kept exactly: a leader that brakes with b_l through a step keeps the sum of its
//! position and its braking distance, hence the state after the step is safe if
//! (v + v′) Δt/2 + v′²/(2b) ≤ g − m + v_l²/(2b_l), which gives the largest safe next speed v′. Braking with b fulfils it whenever
//! the present state is safe: safety once reached is never lost. For b ≤ b_l the gap of two braking vehicles is shortest at the
//! start or at the end, never between, so that safe states have no contact at any instant; hence the demand b ≤ b_l.

use serde::{Deserialize, Serialize};

/// Who brakes how hard.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BrakingLimits {
    /// Hardest braking b of the follower, m/s² (positive, not above the leader's).
    pub follower_mps2: f64,
    /// Hardest braking b_l that the leader is trusted not to exceed, m/s² (positive).
    pub leader_mps2: f64,
    /// Gap m left when both stand, m.
    pub margin_m: f64,
}

impl BrakingLimits {
    /// The smallest safe bumper-to-bumper gap, m.
    pub fn required_gap_m(&self, speed_mps: f64, leader_speed_mps: f64) -> f64 {
        let own_m = stopping_distance_m(speed_mps, self.follower_mps2);
        self.margin_m + (own_m - stopping_distance_m(leader_speed_mps, self.leader_mps2)).max(0.0)
    }

    /// The largest speed at which this gap is safe, m/s; negative if none is.
    pub fn safe_speed_mps(&self, gap_m: f64, leader_speed_mps: f64) -> f64 {
        let room_m = gap_m - self.margin_m;
        if room_m < 0.0 {
            return -1.0;
        }
        (2.0 * self.follower_mps2 * (room_m + stopping_distance_m(leader_speed_mps, self.leader_mps2))).sqrt()
    }

    /// The largest acceleration for a step of `dt_s` after which the state is safe whatever the leader does, m/s².
    ///
    /// Never below full braking, which is all there is to do if the state is unsafe already.
    // Must be inlined into the loops that `pulp` compiles for the processor's instruction set; for their sake without branches and with
    // the quotients that stay the same from vehicle to vehicle apart.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub fn safe_accel_mps2(&self, gap_m: f64, speed_mps: f64, leader_speed_mps: f64, dt_s: f64) -> f64 {
        let b = self.follower_mps2;
        let leader_stop_m = leader_speed_mps * leader_speed_mps * (0.5 / self.leader_mps2);
        let room_m = gap_m - self.margin_m + leader_stop_m;
        let half_mps = 0.5 * b * dt_s;
        let square = half_mps * half_mps + 2.0 * b * (room_m - 0.5 * dt_s * speed_mps);
        let accel_mps2 = (square.max(0.0).sqrt() - half_mps - speed_mps) * (1.0 / dt_s);
        // Below: the step itself is longer than the room unless the follower stops within it.
        let stops = square < half_mps * half_mps;
        if stops { -b } else { accel_mps2.max(-b) }
    }
}

/// Distance covered while braking to a stop, m.
pub fn stopping_distance_m(speed_mps: f64, brake_mps2: f64) -> f64 {
    speed_mps * speed_mps / (2.0 * brake_mps2)
}

/// Distance and speed after a step at constant acceleration that stops exactly at zero speed (ballistic update): (m, m/s).
// Inlined and without branches for the same reason.
#[allow(clippy::inline_always)]
#[inline(always)]
pub fn ballistic_step(speed_mps: f64, accel_mps2: f64, dt_s: f64) -> (f64, f64) {
    let next_mps = speed_mps + accel_mps2 * dt_s;
    let (on_m, stop_m) = (0.5 * (speed_mps + next_mps) * dt_s, speed_mps * speed_mps / (-2.0 * accel_mps2));
    let stop_m = if accel_mps2 < 0.0 { stop_m } else { 0.0 };
    if next_mps > 0.0 { (on_m, next_mps) } else { (stop_m, 0.0) }
}

#[cfg(test)]
mod tests {
    use lanecraft_net::random::Stream;

    use super::{BrakingLimits, ballistic_step};

    /// Smallest gap when the leader draws its accelerations at random, full braking included, and the follower takes all that the
    /// law allows; with the gap checked inside the steps, too.
    fn smallest_gap_m(stream: &mut Stream) -> (f64, BrakingLimits) {
        let leader_mps2 = stream.range(2.0, 9.0);
        let limits = BrakingLimits { follower_mps2: stream.range(1.5, leader_mps2), leader_mps2, margin_m: 1.0 };
        let (mut v, mut v_leader) = (stream.range(0.0, 40.0), stream.range(0.0, 40.0));
        let mut gap_m = limits.required_gap_m(v, v_leader);
        let dt_s = [0.02, 0.05, 0.1, 0.5][stream.below(4)];
        let mut smallest_m = gap_m;
        for _ in 0..200 {
            let leader_accel = if stream.bernoulli(0.7) { -leader_mps2 } else { stream.range(-leader_mps2, 2.0) };
            let accel = limits.safe_accel_mps2(gap_m, v, v_leader, dt_s).min(3.0);
            for part in 1..=4 {
                let within_s = dt_s * f64::from(part) / 4.0;
                let inside_m =
                    gap_m + ballistic_step(v_leader, leader_accel, within_s).0 - ballistic_step(v, accel, within_s).0;
                smallest_m = smallest_m.min(inside_m);
            }
            let (leader_moved_m, moved_m) =
                (ballistic_step(v_leader, leader_accel, dt_s), ballistic_step(v, accel, dt_s));
            gap_m += leader_moved_m.0 - moved_m.0;
            (v, v_leader) = (moved_m.1, leader_moved_m.1);
        }
        (smallest_m, limits)
    }

    #[test]
    fn safety_once_reached_is_never_lost() {
        let mut stream = Stream::new(11, "test.safe_distance");
        for case in 0..5000 {
            let (smallest_m, limits) = smallest_gap_m(&mut stream);
            // 1e-9 m: rounding of the gap over 200 steps of up to 20 m.
            assert!(smallest_m >= limits.margin_m - 1e-9, "case {case}: {smallest_m} with {limits:?}");
        }
    }

    #[test]
    fn the_law_is_tight() {
        // From the smallest safe gap, both braking fully end up exactly the margin apart.
        let limits = BrakingLimits { follower_mps2: 6.0, leader_mps2: 7.0, margin_m: 1.0 };
        let gap_m = limits.required_gap_m(30.0, 20.0);
        assert!((gap_m - (1.0 + 75.0 - 400.0 / 14.0)).abs() < 1e-12);
        assert!((limits.safe_speed_mps(gap_m, 20.0) - 30.0).abs() < 1e-12);
        assert!((limits.safe_accel_mps2(gap_m, 30.0, 20.0, 0.05) + 6.0).abs() < 1e-9);
        assert!(limits.safe_accel_mps2(gap_m + 1.0, 30.0, 20.0, 0.05) > -6.0);
    }

    #[test]
    fn no_room_means_full_braking() {
        let limits = BrakingLimits { follower_mps2: 6.0, leader_mps2: 7.0, margin_m: 1.0 };
        assert_eq!(limits.safe_accel_mps2(-2.0, 30.0, 0.0, 0.05), -6.0);
        assert!(limits.safe_speed_mps(0.5, 30.0) < 0.0);
    }

    #[test]
    fn a_step_stops_exactly() {
        assert_eq!(ballistic_step(1.0, -8.0, 0.5), (0.0625, 0.0));
        assert_eq!(ballistic_step(10.0, 2.0, 0.5), (5.25, 11.0));
        assert_eq!(ballistic_step(0.0, -8.0, 0.5), (0.0, 0.0));
    }
}
