//! How human drivers follow: the leaders of each vehicle in one sweep along the road, then its model below the law of the safe distance.

use std::ops::Range;

use pulp::{Arch, NullaryFnOnce};
use serde::{Deserialize, Serialize};

use super::World;
use super::fleet::Fleet;
use super::world::Ego;
use crate::models::car_following::{CarFollowing, Leader};
use crate::models::idm::IdmTerms;
use crate::models::safe_distance::BrakingLimits;
use crate::road::LaneIndex;

/// More lanes than any road has.
const MAX_LANES: usize = 8;

/// Something that stands in a lane and is no vehicle, such as the lane's end.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Obstacle {
    /// The lane.
    pub lane: LaneIndex,
    /// Where it begins along the road, m.
    pub s_m: f64,
}

/// The rear end of what is ahead in a lane.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Rear {
    bumper_m: f64,
    speed_mps: f64,
    accel_mps2: f64,
}

/// Nobody is ahead.
const NOBODY: Rear = Rear { bumper_m: f64::INFINITY, speed_mps: 0.0, accel_mps2: 0.0 };

/// A further leader of one vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct FurtherLeader {
    follower: usize,
    leader: Leader,
    is_ego: bool,
}

/// The leaders of all vehicles, by slot.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Leaders {
    /// Gap to the leader in the own lane, infinite without one, m.
    gap_m: Vec<f64>,
    speed_mps: Vec<f64>,
    accel_mps2: Vec<f64>,
    /// Of those that have more than one: in the lane they change into, across the ring's end, the ego.
    further: Vec<FurtherLeader>,
}

impl Leaders {
    /// For this many vehicles.
    pub(super) fn resize(&mut self, count: usize) {
        self.gap_m.resize(count, 0.0);
        self.speed_mps.resize(count, 0.0);
        self.accel_mps2.resize(count, 0.0);
        self.further.clear();
        self.further.reserve(2 * count + MAX_LANES);
    }

    /// One sweep against the driving direction, with the last seen vehicle or obstacle of every lane at hand.
    pub(super) fn find(&mut self, fleet: &Fleet, obstacles: &[Obstacle]) {
        self.further.clear();
        let mut seen = [NOBODY; MAX_LANES];
        let mut end = fleet.len();
        for obstacle in obstacles.iter().rev() {
            let start = fleet.s_m.partition_point(|&s_m| s_m <= obstacle.s_m).min(end);
            self.sweep(fleet, start..end, &mut seen);
            seen[usize::from(obstacle.lane.0)] = Rear { bumper_m: obstacle.s_m, ..NOBODY };
            end = start;
        }
        self.sweep(fleet, 0..end, &mut seen);
        if fleet.is_ring() {
            self.close_ring(fleet, &seen);
        }
    }

    /// The leaders of these slots, none of which is ahead of what has been seen.
    fn sweep(&mut self, fleet: &Fleet, slots: Range<usize>, seen: &mut [Rear; MAX_LANES]) {
        let places = fleet.s_m[slots.clone()].iter().zip(&fleet.half_length_m[slots.clone()]);
        let motions = fleet.speed_mps[slots.clone()].iter().zip(&fleet.accel_mps2[slots.clone()]);
        let lanes = fleet.lane[slots.clone()].iter().zip(&fleet.target_lane[slots.clone()]);
        let vehicles = places.zip(motions).zip(lanes);
        let gaps_m = self.gap_m[slots.clone()].iter_mut();
        let leaders = gaps_m.zip(&mut self.speed_mps[slots.clone()]).zip(&mut self.accel_mps2[slots.clone()]);
        let further = &mut self.further;
        for (i, (((place, motion), lanes), ((gap_m, leader_mps), leader_mps2))) in
            slots.zip(vehicles.zip(leaders)).rev()
        {
            let (&s_m, &half_length_m) = place;
            let (lane, target) = (usize::from(*lanes.0) % MAX_LANES, usize::from(*lanes.1) % MAX_LANES);
            let ahead = &seen[lane];
            (*gap_m, *leader_mps, *leader_mps2) =
                (ahead.bumper_m - (s_m + half_length_m), ahead.speed_mps, ahead.accel_mps2);
            let own = Rear { bumper_m: s_m - half_length_m, speed_mps: *motion.0, accel_mps2: *motion.1 };
            if target != lane {
                further.push(behind(fleet, i, &seen[target], 0.0));
                seen[target] = own;
            }
            seen[lane] = own;
        }
    }

    /// Ahead of the last of each lane is the first of it, unless that is the same.
    fn close_ring(&mut self, fleet: &Fleet, first: &[Rear; MAX_LANES]) {
        for (lane, rear) in (0..).zip(first).filter(|(_, rear)| rear.bumper_m < f64::INFINITY) {
            if let Some(i) = fleet.last(lane).filter(|&i| fleet.s_m[i] - fleet.half_length_m[i] != rear.bumper_m) {
                self.further.push(behind(fleet, i, rear, fleet.ring_m));
            }
        }
    }

    /// The ego as a leader of the nearest vehicle behind it in each of its lanes. It never hides a vehicle, for it may do anything:
    /// both are leaders.
    pub(super) fn add_ego(&mut self, fleet: &Fleet, ego: &Ego) {
        for lane in (0..MAX_LANES as u8).filter(|&lane| ego.occupies(lane)) {
            let Some(follower) = fleet.nearest_behind(ego.s_m(), lane) else { continue };
            let (ahead, gap_m) = ego.gap_m(fleet, follower);
            if ahead {
                self.further.push(FurtherLeader { follower, leader: ego.as_leader(gap_m), is_ego: true });
            }
        }
    }
}

fn behind(fleet: &Fleet, follower: usize, rear: &Rear, turn_m: f64) -> FurtherLeader {
    let gap_m = rear.bumper_m + turn_m - (fleet.s_m[follower] + fleet.half_length_m[follower]);
    let leader = Leader { gap_m, speed_mps: rear.speed_mps, accel_mps2: rear.accel_mps2 };
    FurtherLeader { follower, leader, is_ego: false }
}

/// How drivers follow: their model below the law of the safe distance.
#[derive(Clone, Copy)]
struct Law {
    model: CarFollowing,
    safe: BrakingLimits,
    dt_s: f64,
}

impl Law {
    /// What a driver does behind one leader, m/s²: what it wants, but no more than keeps the distance safe.
    // Must be inlined into the loop that `pulp` compiles for the processor's instruction set.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn accel_mps2(&self, driver: &IdmTerms, speed_mps: f64, leader: &Leader) -> f64 {
        let wish_mps2 = self.model.accel_mps2(speed_mps, leader, driver);
        let safe_mps2 = self.safe.safe_accel_mps2(leader.gap_m, speed_mps, leader.speed_mps, self.dt_s);
        wish_mps2.min(safe_mps2).max(-self.safe.follower_mps2)
    }
}

impl World {
    /// The leaders of all.
    pub(super) fn find_leaders(&mut self) {
        self.leaders.find(&self.fleet, &self.obstacles);
        if let Some(ego) = &self.ego {
            self.leaders.add_ego(&self.fleet, ego);
        }
    }

    /// What every driver does towards its leaders: first all at once towards the one in the own lane, then the few who have more.
    pub(super) fn follow_leaders(&mut self, arch: Arch, dt_s: f64) {
        let mut accel_mps2 = std::mem::take(&mut self.fleet.accel_mps2);
        let (fleet, leaders) = (&self.fleet, &self.leaders);
        let law = Law { model: self.traffic.car_following, safe: self.trust(false), dt_s };
        arch.dispatch(FollowAll { accel_mps2: &mut accel_mps2, fleet, leaders, law });
        for &FurtherLeader { follower: i, leader, is_ego } in &leaders.further {
            let law = Law { safe: self.limits(i, is_ego), ..law };
            let further_mps2 = law.accel_mps2(&fleet.terms[i], fleet.speed_mps[i], &leader);
            accel_mps2[i] = accel_mps2[i].min(further_mps2);
        }
        self.fleet.accel_mps2 = accel_mps2;
    }
}

/// The accelerations of all behind the leaders in their own lanes.
struct FollowAll<'a> {
    accel_mps2: &'a mut [f64],
    fleet: &'a Fleet,
    leaders: &'a Leaders,
    law: Law,
}

#[allow(clippy::inline_always)]
impl NullaryFnOnce for FollowAll<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { accel_mps2, fleet, leaders, law } = self;
        // Each with a loop of its own, for only the first is branch-free.
        match law.model {
            CarFollowing::Idm => follow_all(accel_mps2, fleet, leaders, Law { model: CarFollowing::Idm, ..law }),
            CarFollowing::EnhancedIdm => follow_all(accel_mps2, fleet, leaders, law),
        }
    }
}

// Apart from the rest so that the compiler knows that what is written is not read. Must be inlined into what `pulp` compiles for the
// processor's instruction set.
#[allow(clippy::inline_always)]
#[inline(always)]
fn follow_all(accel_mps2: &mut [f64], fleet: &Fleet, leaders: &Leaders, law: Law) {
    let count = accel_mps2.len();
    let (gap_m, leader_mps) = (&leaders.gap_m[..count], &leaders.speed_mps[..count]);
    let leader_mps2 = &leaders.accel_mps2[..count];
    let (speed_mps, brake_mps2) = (&fleet.speed_mps[..count], &fleet.max_brake_mps2[..count]);
    let (slowness, headway_s) = (&fleet.per_desired_speed_spm[..count], &fleet.time_headway_s[..count]);
    let (min_gap_m, max_accel_mps2) = (&fleet.min_gap_m[..count], &fleet.max_accel_mps2[..count]);
    let per_braking_scale = &fleet.per_braking_scale_s2pm[..count];
    for i in 0..count {
        let driver = IdmTerms {
            per_desired_speed_spm: slowness[i],
            time_headway_s: headway_s[i],
            min_gap_m: min_gap_m[i],
            max_accel_mps2: max_accel_mps2[i],
            per_braking_scale_s2pm: per_braking_scale[i],
        };
        let leader = Leader { gap_m: gap_m[i], speed_mps: leader_mps[i], accel_mps2: leader_mps2[i] };
        let safe = BrakingLimits { follower_mps2: brake_mps2[i], ..law.safe };
        accel_mps2[i] = Law { safe, ..law }.accel_mps2(&driver, speed_mps[i], &leader);
    }
}
