//! How human drivers follow: the leaders of each vehicle in one sweep along the road, then its model below the law of the safe distance.

use super::World;
use super::fleet::Fleet;
use super::world::Ego;
use crate::models::car_following::Leader;
use crate::road::LaneIndex;

/// More lanes than any road has.
const MAX_LANES: usize = 8;

/// Something that stands in a lane and is no vehicle, such as the lane's end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// The lane.
    pub lane: LaneIndex,
    /// Where it begins along the road, m.
    pub s_m: f64,
}

/// The rear end of what is ahead in a lane.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Rear {
    s_m: f64,
    half_length_m: f64,
    speed_mps: f64,
    accel_mps2: f64,
}

/// Nobody is ahead.
const NOBODY: Rear = Rear { s_m: f64::INFINITY, half_length_m: 0.0, speed_mps: 0.0, accel_mps2: 0.0 };

/// A further leader of one vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
struct FurtherLeader {
    follower: usize,
    leader: Leader,
    is_ego: bool,
}

/// The leaders of all vehicles, by slot.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Leaders {
    /// Gap to the leader in the own lane, infinite without one, m.
    gap_m: Vec<f64>,
    speed_mps: Vec<f64>,
    /// What it did in the last step, m/s².
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
        let mut obstacles = obstacles.iter().rev().peekable();
        for i in (0..fleet.len()).rev() {
            while let Some(obstacle) = obstacles.next_if(|obstacle| obstacle.s_m >= fleet.s_m[i]) {
                seen[usize::from(obstacle.lane.0)] = standing(obstacle);
            }
            let (lane, target) = (usize::from(fleet.lane[i]), usize::from(fleet.target_lane[i]));
            let rear = seen[lane];
            self.gap_m[i] = rear.s_m - fleet.s_m[i] - fleet.half_length_m[i] - rear.half_length_m;
            self.speed_mps[i] = rear.speed_mps;
            self.accel_mps2[i] = rear.accel_mps2;
            if target != lane {
                self.add(fleet, i, &seen[target], 0.0);
            }
            let own = Rear {
                s_m: fleet.s_m[i],
                half_length_m: fleet.half_length_m[i],
                speed_mps: fleet.speed_mps[i],
                accel_mps2: fleet.accel_mps2[i],
            };
            (seen[lane], seen[target]) = (own, own);
        }
        if fleet.is_ring() {
            obstacles.for_each(|obstacle| seen[usize::from(obstacle.lane.0)] = standing(obstacle));
            self.close_ring(fleet, &seen);
        }
    }

    /// Ahead of the last of each lane is the first of it, unless that is the same.
    fn close_ring(&mut self, fleet: &Fleet, first: &[Rear; MAX_LANES]) {
        for (lane, rear) in (0..).zip(first).filter(|(_, rear)| rear.s_m < f64::INFINITY) {
            let last = fleet.lanes.iter().rposition(|lanes| lanes & (1 << lane) != 0);
            if let Some(i) = last.filter(|&i| fleet.s_m[i] != rear.s_m) {
                self.add(fleet, i, rear, fleet.ring_m);
            }
        }
    }

    fn add(&mut self, fleet: &Fleet, follower: usize, rear: &Rear, turn_m: f64) {
        let gap_m = rear.s_m - fleet.s_m[follower] + turn_m - fleet.half_length_m[follower] - rear.half_length_m;
        let leader = Leader { gap_m, speed_mps: rear.speed_mps, accel_mps2: rear.accel_mps2 };
        self.further.push(FurtherLeader { follower, leader, is_ego: false });
    }

    /// The ego as a leader of the nearest vehicle behind it in each of its lanes. It never hides a vehicle, for it may do anything:
    /// both are leaders.
    pub(super) fn add_ego(&mut self, fleet: &Fleet, ego: &Ego) {
        for lane in (0..MAX_LANES as u8).filter(|&lane| ego.occupies(lane)) {
            let Some(follower) = fleet.nearest_behind(ego.s_m(), lane) else { continue };
            let (ahead, gap_m) = ego.gap_m(fleet, follower);
            if ahead {
                let leader = ego.as_leader(gap_m);
                self.further.push(FurtherLeader { follower, leader, is_ego: true });
            }
        }
    }
}

fn standing(obstacle: &Obstacle) -> Rear {
    Rear { s_m: obstacle.s_m, ..NOBODY }
}

impl World {
    /// The leaders of all.
    pub(super) fn find_leaders(&mut self) {
        self.leaders.find(&self.fleet, &self.obstacles);
        if let Some(ego) = &self.ego {
            self.leaders.add_ego(&self.fleet, ego);
        }
    }

    /// What every driver wants towards its leaders, but no more than keeps the distances safe.
    pub(super) fn follow_leaders(&mut self, dt_s: f64) {
        for i in 0..self.fleet.len() {
            let Leaders { gap_m, speed_mps, accel_mps2, .. } = &self.leaders;
            let leader = Leader { gap_m: gap_m[i], speed_mps: speed_mps[i], accel_mps2: accel_mps2[i] };
            self.fleet.accel_mps2[i] = self.behind_mps2(i, &leader, false, dt_s);
        }
        for k in 0..self.leaders.further.len() {
            let FurtherLeader { follower: i, leader, is_ego } = self.leaders.further[k];
            let accel_mps2 = self.behind_mps2(i, &leader, is_ego, dt_s);
            self.fleet.accel_mps2[i] = self.fleet.accel_mps2[i].min(accel_mps2);
        }
    }

    /// What the driver of slot `i` does behind one leader, m/s².
    fn behind_mps2(&self, i: usize, leader: &Leader, is_ego: bool, dt_s: f64) -> f64 {
        let (speed_mps, limits) = (self.fleet.speed_mps[i], self.limits(i, is_ego));
        let wish_mps2 = self.traffic.car_following.accel_mps2(speed_mps, leader, &self.fleet.driver[i]);
        let safe_mps2 = limits.safe_accel_mps2(leader.gap_m, speed_mps, leader.speed_mps, dt_s);
        wish_mps2.min(safe_mps2).max(-limits.follower_mps2)
    }
}
