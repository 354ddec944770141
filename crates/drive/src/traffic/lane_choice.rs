//! When human drivers change lane: MOBIL for the wish, the law of the safe distance for the permission.

use super::World;
use super::fleet::steps;
use super::following::Obstacle;
use super::neighbors::Around;
use crate::models::car_following::Leader;
use crate::models::idm::IdmTerms;
use crate::models::mobil::{AccelChange, KeepRight, MobilParams, MobilSituation, mobil_gain, mobil_gain_keep_right};
use crate::road::Side;
use crate::scene::VehicleId;

/// Reaction that a courteous driver grants an ego behind it, s: a control step and drive lag of 0.3 s, then the mean delay of a
/// braking force that builds up at 25 m/s³ to 8 m/s².
const COURTEOUS_REACTION_S: f64 = 0.46;

/// The follower in a lane of the vehicle that may change.
#[derive(Clone, Copy)]
struct Rear {
    gap_m: f64,
    speed_mps: f64,
    /// How it follows; for the ego an estimate.
    driver: IdmTerms,
}

/// What happens if the lane is kept, and to the follower there if not.
struct Keeping {
    front: Leader,
    accel_mps2: f64,
    old_follower: AccelChange,
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

    /// Whether the driver of slot `i` is free to change lane: neither in a change, nor under a command, nor, unless the lane ends, in
    /// the pause after a change.
    fn may_change(&self, i: usize) -> bool {
        let fleet = &self.fleet;
        (fleet.free_step[i] <= self.now || self.way_out(i).is_some())
            && fleet.lane[i] == fleet.target_lane[i]
            && !self.is_commanded(VehicleId(fleet.id[i]))
    }

    /// The lane beside that is safe and pays most; of equal ones the left. Out of a lane that ends soon only safety counts.
    fn best_lane(&self, i: usize) -> Option<u8> {
        let out = self.way_out(i);
        let mut best: Option<(f64, u8)> = None;
        let mut keeping: Option<Keeping> = None;
        for side in Side::BOTH.into_iter().filter(|&side| out.is_none_or(|out| out == side)) {
            let Some(lane) = self.lane_beside(i, side) else { continue };
            let around = self.fleet.around(i, lane);
            if !self.is_safe(i, lane, around) {
                continue;
            }
            let keeping = keeping.get_or_insert_with(|| self.keeping(i));
            let Some(gain_mps2) = self.gain_mps2((i, lane), around, keeping, out.is_some()) else { continue };
            if best.is_none_or(|(most_mps2, _)| gain_mps2 > most_mps2) {
                best = Some((gain_mps2, lane));
            }
        }
        best.map(|(_, lane)| lane)
    }

    /// Whether `i` in `lane` would be safe behind its leaders and its followers behind it.
    fn is_safe(&self, i: usize, lane: u8, around: Around) -> bool {
        self.is_safe_among_humans(i, lane, around) && self.is_safe_for_ego(i, lane)
    }

    /// The same, the ego left out.
    pub(super) fn is_safe_among_humans(&self, i: usize, lane: u8, around: Around) -> bool {
        let speed_mps = self.fleet.speed_mps[i];
        let behind_is_safe = around.behind.is_none_or(|j| {
            self.fleet.gap_m(j, i) >= self.limits(j, false).required_gap_m(self.fleet.speed_mps[j], speed_mps)
        });
        let ahead_is_safe = around.ahead.is_none_or(|j| {
            self.fleet.gap_m(i, j) >= self.limits(i, false).required_gap_m(speed_mps, self.fleet.speed_mps[j])
        });
        let end_m = self.obstacle_gap_m(i, lane);
        let end_is_safe = end_m == f64::INFINITY || end_m >= self.limits(i, false).required_gap_m(speed_mps, 0.0);
        behind_is_safe && ahead_is_safe && end_is_safe && self.stops_before_end(i, lane)
    }

    /// Whether the distances to the ego would be safe, too.
    pub(super) fn is_safe_for_ego(&self, i: usize, lane: u8) -> bool {
        let Some(ego) = self.ego.as_ref().filter(|ego| ego.occupies(lane)) else { return true };
        let speed_mps = self.fleet.speed_mps[i];
        let (ahead, gap_m) = ego.gap_m(&self.fleet, i);
        if ahead {
            return gap_m >= self.limits(i, true).required_gap_m(speed_mps, ego.speed_mps);
        }
        // The ego brakes at least as hard as human drivers do.
        let reaction_s = if self.traffic.courteous { COURTEOUS_REACTION_S } else { 0.0 };
        let hardest_mps2 = self.traffic.hardest_brake_mps2(self.road.adhesion_range().0);
        let limits = self.traffic.braking_limits(hardest_mps2, false, &self.road);
        gap_m >= limits.required_gap_m(ego.speed_mps, speed_mps) + reaction_s * ego.speed_mps
    }

    /// What the change into any lane is held against.
    fn keeping(&self, i: usize) -> Keeping {
        let lane = self.fleet.lane[i];
        let around = self.fleet.around(i, lane);
        let front = self.front(i, lane, around);
        let old_follower = self.rear(i, lane, around).map_or_else(AccelChange::default, |rear| AccelChange {
            keep_mps2: self.behind_me_mps2(i, &rear),
            change_mps2: self.without_me_mps2(i, &rear, &front),
        });
        let accel_mps2 = self.accel_behind_mps2(&self.terms(i), self.fleet.speed_mps[i], &front);
        Keeping { front, accel_mps2, old_follower }
    }

    /// The weighted gain of a change of `i` into `lane`, if it is allowed and pays.
    fn gain_mps2(&self, (i, lane): (usize, u8), around: Around, keeping: &Keeping, must_change: bool) -> Option<f64> {
        let front = self.front(i, lane, around);
        let change_mps2 = self.accel_behind_mps2(&self.terms(i), self.fleet.speed_mps[i], &front);
        let situation = MobilSituation {
            changer: AccelChange { keep_mps2: keeping.accel_mps2, change_mps2 },
            new_follower: self.rear(i, lane, around).map_or_else(AccelChange::default, |rear| AccelChange {
                keep_mps2: self.without_me_mps2(i, &rear, &front),
                change_mps2: self.behind_me_mps2(i, &rear),
            }),
            old_follower: keeping.old_follower,
        };
        let traffic = &self.traffic;
        let params = MobilParams {
            politeness: self.fleet.politeness[i],
            accel_gain_threshold_mps2: traffic.accel_gain_threshold_mps2,
            safe_decel_mps2: traffic.safe_decel_mps2,
        };
        if must_change {
            return mobil_gain(&situation, &self.pressing(i, params));
        }
        if !traffic.keep_right {
            return mobil_gain(&situation, &params);
        }
        let to_left = lane > self.fleet.lane[i];
        let left_front = if to_left { front } else { keeping.front };
        let rule = KeepRight {
            bias_mps2: traffic.keep_right_bias_mps2,
            to_left,
            speed_mps: self.fleet.speed_mps[i],
            left_leader_mps: if left_front.gap_m < f64::INFINITY { left_front.speed_mps } else { f64::INFINITY },
        };
        mobil_gain_keep_right(&situation, &params, &rule)
    }

    /// What `rear` does behind `i`, m/s².
    fn behind_me_mps2(&self, i: usize, rear: &Rear) -> f64 {
        self.accel_behind_mps2(&rear.driver, rear.speed_mps, &self.vehicle_ahead(i, rear.gap_m))
    }

    /// What `rear` does behind `front`, between whom `i` is or would be, m/s².
    fn without_me_mps2(&self, i: usize, rear: &Rear, front: &Leader) -> f64 {
        let gap_m = rear.gap_m + 2.0 * self.fleet.half_length_m[i] + front.gap_m;
        self.accel_behind_mps2(&rear.driver, rear.speed_mps, &Leader { gap_m, ..*front })
    }

    /// What a driver wants behind what is ahead, m/s².
    #[inline]
    fn accel_behind_mps2(&self, driver: &IdmTerms, speed_mps: f64, front: &Leader) -> f64 {
        self.traffic.car_following.accel_mps2(speed_mps, front, driver)
    }

    /// Slot `j` as one who follows it at this distance sees it.
    fn vehicle_ahead(&self, j: usize, gap_m: f64) -> Leader {
        Leader { gap_m, speed_mps: self.fleet.speed_mps[j], accel_mps2: self.fleet.accel_mps2[j] }
    }

    /// The nearest ahead of `i` in `lane`, the ego and obstacles included; nobody is infinitely far away.
    #[inline]
    fn front(&self, i: usize, lane: u8, around: Around) -> Leader {
        let mut front = Leader { gap_m: self.obstacle_gap_m(i, lane), speed_mps: 0.0, accel_mps2: 0.0 };
        if let Some(j) = around.ahead {
            front = nearer(front, self.vehicle_ahead(j, self.fleet.gap_m(i, j)));
        }
        if let Some(ego) = self.ego.as_ref().filter(|ego| ego.occupies(lane)) {
            let (ahead, gap_m) = ego.gap_m(&self.fleet, i);
            if ahead {
                front = nearer(front, ego.as_leader(gap_m));
            }
        }
        front
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
    #[inline]
    fn rear(&self, i: usize, lane: u8, around: Around) -> Option<Rear> {
        let human = around.behind.map(|j| Rear {
            gap_m: self.fleet.gap_m(j, i),
            speed_mps: self.fleet.speed_mps[j],
            driver: self.terms(j),
        });
        if let Some(ego) = self.ego.as_ref().filter(|ego| ego.occupies(lane)) {
            let (ahead, gap_m) = ego.gap_m(&self.fleet, i);
            if !ahead && human.is_none_or(|human| gap_m < human.gap_m) {
                // It is taken for a driver like `i` who wants no less than its speed.
                let own = self.terms(i);
                let per_desired_speed_spm = own.per_desired_speed_spm.min(1.0 / ego.speed_mps);
                let driver = IdmTerms { per_desired_speed_spm, ..own };
                return Some(Rear { gap_m, speed_mps: ego.speed_mps, driver });
            }
        }
        human
    }
}

fn nearer(a: Leader, b: Leader) -> Leader {
    if b.gap_m < a.gap_m { b } else { a }
}
