//! When human drivers change lane: MOBIL for the wish, the law of the safe distance for the permission.

use super::World;
use super::fleet::steps;
use super::following::Obstacle;
use crate::models::car_following::Leader;
use crate::models::idm::{IdmParams, idm_free_accel};
use crate::models::mobil::{AccelChange, KeepRight, MobilParams, MobilSituation, mobil_gain, mobil_gain_keep_right};
use crate::road::{LaneIndex, Side};
use crate::scene::VehicleId;

/// Reaction that a courteous driver grants an ego behind it, s: a control step and drive lag of 0.3 s, then the mean delay of a
/// braking force that builds up at 25 m/s³ to 8 m/s².
const COURTEOUS_REACTION_S: f64 = 0.46;

/// Another vehicle in a lane, seen from the vehicle that may change.
#[derive(Clone, Copy)]
struct Other {
    /// Where it is and what it did in the last step, as one who follows it sees it.
    leader: Leader,
    /// How it follows; for the ego an estimate.
    driver: IdmParams,
}

impl World {
    /// Lets every driver whose turn it is look at the lanes beside it, by rising id: a claim is seen by all later ones. Returns the
    /// number of changes started.
    pub(super) fn choose_lanes(&mut self, dt_s: f64) -> u32 {
        let period = i64::from(steps(self.traffic.lane_decision_period_s, dt_s));
        let change_steps = steps(self.traffic.lane_change_duration_s, dt_s);
        let pause_steps = steps(self.traffic.lane_change_cooldown_s, dt_s).max(change_steps);
        let ids = self.fleet.ids();
        let first = ids.start + (-self.now - i64::from(ids.start)).rem_euclid(period) as u32;
        let mut started = 0;
        for id in (first..ids.end).step_by(period as usize).map(VehicleId) {
            let Some(i) = self.fleet.slot(id).filter(|&i| self.may_change(i)) else { continue };
            if let Some(lane) = self.best_lane(i) {
                self.start_change(i, lane, change_steps);
                self.fleet.free_step[i] = self.now + i64::from(pause_steps);
                started += 1;
            }
        }
        started
    }

    /// Whether the driver of slot `i` is free to change lane: neither in a change, nor in the pause after one, nor under a command.
    fn may_change(&self, i: usize) -> bool {
        let fleet = &self.fleet;
        fleet.lane[i] == fleet.target_lane[i]
            && fleet.free_step[i] <= self.now
            && !self.is_commanded(VehicleId(fleet.id[i]))
    }

    /// The lane beside that is safe and pays most; of equal ones the left.
    fn best_lane(&self, i: usize) -> Option<u8> {
        let mut best: Option<(f64, u8)> = None;
        for side in Side::BOTH {
            let Some(LaneIndex(lane)) = self.road.beside(LaneIndex(self.fleet.lane[i]), side) else { continue };
            if !self.is_safe(i, lane) {
                continue;
            }
            let Some(gain_mps2) = self.gain_mps2(i, lane) else { continue };
            if best.is_none_or(|(most_mps2, _)| gain_mps2 > most_mps2) {
                best = Some((gain_mps2, lane));
            }
        }
        best.map(|(_, lane)| lane)
    }

    /// Whether `i` in `lane` would be safe behind its leaders and its followers behind it.
    fn is_safe(&self, i: usize, lane: u8) -> bool {
        let speed_mps = self.fleet.speed_mps[i];
        let ahead_is_safe = self.fleet.ahead(i, lane).is_none_or(|j| {
            self.fleet.gap_m(i, j) >= self.limits(i, false).required_gap_m(speed_mps, self.fleet.speed_mps[j])
        });
        let behind_is_safe = self.fleet.behind(i, lane).is_none_or(|j| {
            self.fleet.gap_m(j, i) >= self.limits(j, false).required_gap_m(self.fleet.speed_mps[j], speed_mps)
        });
        let end_is_safe = self.obstacle_gap_m(i, lane) >= self.limits(i, false).required_gap_m(speed_mps, 0.0);
        ahead_is_safe && behind_is_safe && end_is_safe && self.is_safe_for_ego(i, lane)
    }

    fn is_safe_for_ego(&self, i: usize, lane: u8) -> bool {
        let Some(ego) = self.ego.as_ref().filter(|ego| ego.occupies(lane)) else { return true };
        let speed_mps = self.fleet.speed_mps[i];
        let (ahead, gap_m) = ego.gap_m(&self.fleet, i);
        if ahead {
            return gap_m >= self.limits(i, true).required_gap_m(speed_mps, ego.speed_mps);
        }
        // The ego brakes at least as hard as human drivers do.
        let reaction_s = if self.traffic.courteous { COURTEOUS_REACTION_S } else { 0.0 };
        let hardest_mps2 = self.traffic.hardest_brake_mps2(self.road.adhesion());
        let limits = self.traffic.braking_limits(hardest_mps2, false, self.road.adhesion());
        gap_m >= limits.required_gap_m(ego.speed_mps, speed_mps) + reaction_s * ego.speed_mps
    }

    fn gain_mps2(&self, i: usize, lane: u8) -> Option<f64> {
        let own_lane = self.fleet.lane[i];
        let (front, new_front) = (self.front(i, own_lane), self.front(i, lane));
        let situation = self.situation(i, lane, (front, new_front));
        let traffic = &self.traffic;
        let params = MobilParams {
            politeness: self.fleet.politeness[i],
            accel_gain_threshold_mps2: traffic.accel_gain_threshold_mps2,
            safe_decel_mps2: traffic.safe_decel_mps2,
        };
        if !traffic.keep_right {
            return mobil_gain(&situation, &params);
        }
        let to_left = lane > own_lane;
        let rule = KeepRight {
            bias_mps2: traffic.keep_right_bias_mps2,
            to_left,
            speed_mps: self.fleet.speed_mps[i],
            left_leader_mps: if to_left { new_front } else { front }.map_or(f64::INFINITY, |f| f.leader.speed_mps),
        };
        mobil_gain_keep_right(&situation, &params, &rule)
    }

    /// What a change of `i` into `lane` means to all concerned; `front` and `new_front` are its leaders before and after.
    fn situation(&self, i: usize, lane: u8, (front, new_front): (Option<Other>, Option<Other>)) -> MobilSituation {
        let me = self.other(i, 0.0);
        let length_m = 2.0 * self.fleet.half_length_m[i];
        let with_me = |rear: &Other| self.accel_behind(rear, Some(Leader { gap_m: rear.leader.gap_m, ..me.leader }));
        let without_me = |rear: &Other, front: &Option<Other>| {
            let gap_m = |front: &Other| rear.leader.gap_m + length_m + front.leader.gap_m;
            self.accel_behind(rear, front.map(|front| Leader { gap_m: gap_m(&front), ..front.leader }))
        };
        let own = |front: &Option<Other>| self.accel_behind(&me, front.map(|front| front.leader));
        MobilSituation {
            changer: AccelChange { keep_mps2: own(&front), change_mps2: own(&new_front) },
            new_follower: self.rear(i, lane).map_or_else(AccelChange::default, |rear| AccelChange {
                keep_mps2: without_me(&rear, &new_front),
                change_mps2: with_me(&rear),
            }),
            old_follower: self.rear(i, self.fleet.lane[i]).map_or_else(AccelChange::default, |rear| AccelChange {
                keep_mps2: with_me(&rear),
                change_mps2: without_me(&rear, &front),
            }),
        }
    }

    /// The nearest ahead of `i` in `lane`, the ego and obstacles included.
    fn front(&self, i: usize, lane: u8) -> Option<Other> {
        let human = self.fleet.ahead(i, lane).map(|j| self.other(j, self.fleet.gap_m(i, j)));
        let gap_m = self.obstacle_gap_m(i, lane);
        let standing = Leader { gap_m, speed_mps: 0.0, accel_mps2: 0.0 };
        let obstacle = (gap_m < f64::INFINITY).then_some(Other { leader: standing, driver: self.fleet.driver[i] });
        nearer(nearer(human, obstacle), self.ego_as_other(i, lane, true))
    }

    /// How far it is from slot `i` to the next obstacle ahead in `lane`, infinite if there is none, m.
    fn obstacle_gap_m(&self, i: usize, lane: u8) -> f64 {
        let gap_m =
            |obstacle: &Obstacle| self.fleet.ahead_m(self.fleet.s_m[i], obstacle.s_m) - self.fleet.half_length_m[i];
        let in_lane = self.obstacles.iter().filter(|obstacle| obstacle.lane.0 == lane);
        let ahead = in_lane.filter(|obstacle| self.fleet.is_ring() || obstacle.s_m >= self.fleet.s_m[i]);
        ahead.map(gap_m).fold(f64::INFINITY, f64::min)
    }

    /// The nearest behind `i` in `lane`, the ego included.
    fn rear(&self, i: usize, lane: u8) -> Option<Other> {
        let human = self.fleet.behind(i, lane).map(|j| self.other(j, self.fleet.gap_m(j, i)));
        nearer(human, self.ego_as_other(i, lane, false))
    }

    fn other(&self, j: usize, gap_m: f64) -> Other {
        let (speed_mps, accel_mps2) = (self.fleet.speed_mps[j], self.fleet.accel_mps2[j]);
        Other { leader: Leader { gap_m, speed_mps, accel_mps2 }, driver: self.fleet.driver[j] }
    }

    /// The ego, if it is in `lane` and on the wanted side; it is taken for a driver like `i` who wants no less than its speed.
    fn ego_as_other(&self, i: usize, lane: u8, wanted_ahead: bool) -> Option<Other> {
        let ego = self.ego.as_ref().filter(|ego| ego.occupies(lane))?;
        let (ahead, gap_m) = ego.gap_m(&self.fleet, i);
        let own = self.fleet.driver[i];
        let driver = IdmParams { desired_speed_mps: own.desired_speed_mps.max(ego.speed_mps), ..own };
        (ahead == wanted_ahead).then_some(Other { leader: ego.as_leader(gap_m), driver })
    }

    /// What a driver does behind a leader, or on a free road, m/s².
    fn accel_behind(&self, follower: &Other, leader: Option<Leader>) -> f64 {
        let (speed_mps, driver) = (follower.leader.speed_mps, &follower.driver);
        leader.map_or_else(
            || idm_free_accel(speed_mps, driver),
            |leader| self.traffic.car_following.accel_mps2(speed_mps, &leader, driver),
        )
    }
}

fn nearer(a: Option<Other>, b: Option<Other>) -> Option<Other> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if b.leader.gap_m < a.leader.gap_m { b } else { a }),
        (a, b) => a.or(b),
    }
}
