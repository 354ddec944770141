//! What the road asks of human drivers beyond following: lanes that end, and speed limits.
//!
//! The end of a lane is a standing obstacle to car following and to the law of the safe distance, so that nobody ever drives past it.
//! From some distance on (the strategic look-ahead of Erdmann, 2014) its drivers change towards the lane that goes on as soon as that
//! is safe, whatever they gain or others lose within MOBIL's safe braking. Both sides cooperate, as in the reference: who must change
//! falls in behind the leader in the new lane, and its follower there falls in behind it, each within a comfortable braking. Unlike in
//! the reference nobody speeds up for a gap.
//!
//! Grade is not felt: the models' accelerations are those of drivers who make up for it with the pedal.

use super::World;
use crate::models::idm::{IdmParams, IdmTerms, idm_accel};
use crate::models::mobil::MobilParams;
use crate::road::{LaneIndex, Side};

/// Each lane to cross before the end takes so much room, m, and so much time, s: two lane changes of 3 s with a look around.
const ROOM_PER_LANE_M: f64 = 100.0;
const TIME_PER_LANE_S: f64 = 8.0;
/// Who is slower than this before the end of its lane waits for a gap, m/s.
const WAITING_SPEED_MPS: f64 = 2.0;
/// So many can stand abreast of a vehicle, and one more.
const ABREAST: usize = 4;
/// A speed limit is approached so that the difference shrinks with this time constant, s.
const LIMIT_TIME_S: f64 = 1.0;

impl World {
    /// Holds all accelerations within what the road and courtesy allow.
    pub(super) fn heed_road(&mut self, dt_s: f64) {
        if self.road.has_all_lanes() && self.road.config().speed_limits.is_empty() {
            return;
        }
        for i in 0..self.fleet.len() {
            let allowed_mps2 = self.road_bound_mps2(i, dt_s).max(-self.fleet.max_brake_mps2[i]);
            self.fleet.accel_mps2[i] = self.fleet.accel_mps2[i].min(allowed_mps2);
        }
    }

    /// How vehicle `i` chooses lanes here: by its driver's wishes, but for a speed limit.
    pub(super) fn terms(&self, i: usize) -> IdmTerms {
        let terms = self.fleet.terms[i];
        if self.road.config().speed_limits.is_empty() {
            return terms;
        }
        let per_allowed_spm = 1.0 / self.road.allowed_speed_mps(self.fleet.s_m[i]);
        IdmTerms { per_desired_speed_spm: terms.per_desired_speed_spm.max(per_allowed_spm), ..terms }
    }

    /// What the road and courtesy leave of the acceleration of vehicle `i`, m/s².
    fn road_bound_mps2(&self, i: usize, dt_s: f64) -> f64 {
        let driver = &self.fleet.driver[i];
        let limit_mps2 = self.limit_bound_mps2(i, driver);
        if self.road.has_all_lanes() {
            return limit_mps2;
        }
        limit_mps2.min(self.end_bound_mps2(i, driver, dt_s)).min(self.courtesy_bound_mps2(i, driver))
    }

    /// Keeps below the allowed speed, by comfortable braking at most.
    fn limit_bound_mps2(&self, i: usize, driver: &IdmParams) -> f64 {
        let speed_mps = self.fleet.speed_mps[i];
        let s_m = self.fleet.s_m[i];
        // Where the driver is as well as where the driver looks: nobody speeds up before a limit ends.
        let allowed_mps =
            self.road.allowed_speed_mps(s_m).min(self.road.allowed_speed_mps(s_m + speed_mps * LIMIT_TIME_S));
        ((allowed_mps - speed_mps) / LIMIT_TIME_S).max(-driver.comfort_decel_mps2)
    }

    /// Stops before the ends of all occupied lanes; only the end of the lane to stay in is a reason to slow down early.
    fn end_bound_mps2(&self, i: usize, driver: &IdmParams, dt_s: f64) -> f64 {
        let speed_mps = self.fleet.speed_mps[i];
        let safe_mps2 = |lane| self.limits(i, false).safe_accel_mps2(self.end_gap_m(i, lane), speed_mps, 0.0, dt_s);
        let (lane, target_lane) = (self.fleet.lane[i], self.fleet.target_lane[i]);
        let wish_mps2 = idm_accel(self.end_gap_m(i, target_lane), speed_mps, speed_mps, driver);
        safe_mps2(lane).min(safe_mps2(target_lane)).min(wish_mps2)
    }

    /// From the front bumper of `i` to the end of `lane`, m.
    fn end_gap_m(&self, i: usize, lane: u8) -> f64 {
        self.road.lane_end_ahead_m(LaneIndex(lane), self.fleet.s_m[i]) - self.fleet.half_length_m[i]
    }

    /// Whether `i` in `lane` could stop before its end.
    pub(super) fn stops_before_end(&self, i: usize, lane: u8) -> bool {
        self.road.has_all_lanes()
            || self.end_gap_m(i, lane) >= self.limits(i, false).required_gap_m(self.fleet.speed_mps[i], 0.0)
    }

    /// The side to which somebody in `lane` must change by now.
    #[inline]
    fn must_leave(&self, lane: LaneIndex, s_m: f64, speed_mps: f64) -> Option<Side> {
        // Most roads have no lane that ends.
        if self.road.has_all_lanes() {
            return None;
        }
        let end_m = self.road.lane_end_ahead_m(lane, s_m);
        if end_m.is_infinite() {
            return None;
        }
        let crossings = f64::from(self.road.lanes_to_cross(lane, s_m));
        let near = end_m < crossings * (ROOM_PER_LANE_M + TIME_PER_LANE_S * speed_mps);
        if near { self.road.way_out(lane, s_m) } else { None }
    }

    /// The side to which vehicle `i` must change by now.
    #[inline]
    pub(super) fn way_out(&self, i: usize) -> Option<Side> {
        self.must_leave(LaneIndex(self.fleet.target_lane[i]), self.fleet.s_m[i], self.fleet.speed_mps[i])
    }

    /// The lane on this side of `i`, if it exists there, may be crossed into and need not be left again at once.
    pub(super) fn lane_beside(&self, i: usize, side: Side) -> Option<u8> {
        let (s_m, speed_mps) = (self.fleet.s_m[i], self.fleet.speed_mps[i]);
        let lane = self.road.neighbor_lane(LaneIndex(self.fleet.lane[i]), side, s_m)?;
        let stays = self.way_out(i) == Some(side) || self.must_leave(lane, s_m, speed_mps).is_none();
        (stays && self.road.lane_holds(lane, s_m, self.fleet.half_length_m[i])).then_some(lane.0)
    }

    /// How slot `i` weighs a change that it must make: it looks for no gain, and who hardly moves any more takes every safe gap.
    pub(super) fn pressing(&self, i: usize, params: MobilParams) -> MobilParams {
        let waits = self.fleet.speed_mps[i] < WAITING_SPEED_MPS;
        MobilParams {
            politeness: 0.0,
            accel_gain_threshold_mps2: f64::NEG_INFINITY,
            safe_decel_mps2: if waits { f64::INFINITY } else { params.safe_decel_mps2 },
        }
    }

    /// Falls in behind those ahead in the lanes beside with whom the lane is to be shared: who must change behind its coming leader,
    /// others behind who must change into their lane.
    fn courtesy_bound_mps2(&self, i: usize, driver: &IdmParams) -> f64 {
        let speed_mps = self.fleet.speed_mps[i];
        let lane = LaneIndex(self.fleet.target_lane[i]);
        let out = self.way_out(i);
        let mut bound_mps2 = f64::INFINITY;
        for side in Side::BOTH {
            let Some(beside) = self.road.beside(lane, side) else { continue };
            let Some((gap_m, leader_mps, leaves)) = self.front_beside(i, beside) else { continue };
            let joins = leaves.is_some_and(|leaves| leaves != side);
            if out == Some(side) || joins {
                bound_mps2 = bound_mps2.min(idm_accel(gap_m, speed_mps, speed_mps - leader_mps, driver));
            }
        }
        bound_mps2.max(-driver.comfort_decel_mps2)
    }

    /// The nearest ahead of `i` that keeps the lane `beside`, the ego included: its gap in m, its speed in m/s, and the side to which
    /// it must change. Who is abreast, or too near to let one in, does not count: one of the two has to go on.
    fn front_beside(&self, i: usize, beside: LaneIndex) -> Option<(f64, f64, Option<Side>)> {
        let fleet = &self.fleet;
        let nearest_m = self.limits(i, false).margin_m;
        let clear = |j: &usize| fleet.gap_m(i, *j) >= nearest_m;
        let human =
            std::iter::successors(fleet.ahead(i, beside.0), |&j| fleet.ahead(j, beside.0)).take(ABREAST).find(clear);
        let human = human.filter(|&j| fleet.target_lane[j] == beside.0);
        let human = human.map(|j| (fleet.gap_m(i, j), fleet.speed_mps[j], self.way_out(j)));
        let ego = self.ego.as_ref().filter(|ego| ego.keeps(beside)).and_then(|ego| {
            let (ahead, gap_m) = ego.gap_m(fleet, i);
            (ahead && gap_m >= nearest_m)
                .then(|| (gap_m, ego.speed_mps, self.must_leave(beside, ego.s_m(), ego.speed_mps)))
        });
        match (human, ego) {
            (Some(human), Some(ego)) => Some(if ego.0 < human.0 { ego } else { human }),
            (human, ego) => human.or(ego),
        }
    }
}
