//! Where there is room: for the ego at its start, for vehicles that enter the road.

use lanecraft_net::random::Stream;

use super::World;
use crate::models::safe_distance::BrakingLimits;
use crate::road::{LaneIndex, Topology};
use crate::scenario::{EgoStart, Party, Scenario, ScenarioError, VehicleSpec, check_gap, ego_length_m};

/// Position, lane and speed of the ego at the start.
pub(super) type Start = (f64, LaneIndex, f64);

impl World {
    /// Whether a vehicle may enter the road there: safe behind its leader, and its follower behind it, the ego included.
    pub fn has_room_for(&self, spec: &VehicleSpec) -> bool {
        let (fleet, s_m, lane) = (&self.fleet, self.road.wrap_m(spec.s_m), spec.lane.0);
        let half_length_m = 0.5 * spec.kind.length_m();
        let own = |behind_ego| BrakingLimits { follower_mps2: spec.max_brake_mps2, ..self.trust(behind_ego) };
        let ahead = fleet.nearest_ahead(s_m, lane).is_none_or(|j| {
            let gap_m = fleet.ahead_m(s_m, fleet.s_m[j]) - half_length_m - fleet.half_length_m[j];
            gap_m >= own(false).required_gap_m(spec.speed_mps, fleet.speed_mps[j])
        });
        let behind = fleet.nearest_behind(s_m, lane).is_none_or(|j| {
            let gap_m = fleet.ahead_m(fleet.s_m[j], s_m) - half_length_m - fleet.half_length_m[j];
            gap_m >= self.limits(j, false).required_gap_m(fleet.speed_mps[j], spec.speed_mps)
        });
        let ego = self.ego.as_ref().filter(|ego| ego.occupies(lane)).is_none_or(|ego| {
            let ahead_m = fleet.signed_ahead_m(s_m, ego.s_m());
            let gap_m = ahead_m.abs() - half_length_m - ego.half_length_m();
            if ahead_m >= 0.0 {
                gap_m >= own(true).required_gap_m(spec.speed_mps, ego.speed_mps)
            } else {
                gap_m >= self.ego_limits().required_gap_m(ego.speed_mps, spec.speed_mps)
            }
        });
        ahead && behind && ego
    }

    /// The ego's start as the scenario asks for it, checked for safety.
    pub(super) fn place_ego(&self, scenario: &Scenario) -> Result<Start, ScenarioError> {
        match scenario.ego {
            EgoStart::At { lane, s_m, speed_mps } => self.check_written((self.road.wrap_m(s_m), lane, speed_mps)),
            EgoStart::LargestGap => {
                let lanes = self.road.config().lanes;
                let first = Stream::new(scenario.seed, "traffic.ego").below(usize::from(lanes)) as u8;
                let mut largest_m = 0.0_f64;
                for offset in 0..lanes {
                    let lane = LaneIndex((first + offset) % lanes);
                    let Some((follower, leader, gap_m)) = self.largest_gap(lane) else { continue };
                    largest_m = largest_m.max(gap_m);
                    if let Some(start) = self.fit(lane, (follower, leader), gap_m) {
                        return Ok(start);
                    }
                }
                Err(ScenarioError::NoRoomForEgo { largest_m })
            }
        }
    }

    /// How the ego brakes in the eyes of the law: no harder than human drivers, so that the law holds behind them.
    fn ego_limits(&self) -> BrakingLimits {
        let hardest_mps2 = self.traffic.hardest_brake_mps2(self.road.adhesion_range().0);
        self.traffic.braking_limits(hardest_mps2, false, &self.road)
    }

    /// The largest gap of a lane with its follower and leader; on an open road only gaps in the rear half of the traffic count, so
    /// that there is traffic ahead.
    fn largest_gap(&self, lane: LaneIndex) -> Option<(usize, usize, f64)> {
        let open = self.road.config().topology == Topology::Open;
        let in_lane: Vec<usize> = (0..self.fleet.len()).filter(|&i| self.fleet.lanes[i] & (1 << lane.0) != 0).collect();
        let followers = if open { in_lane.len() / 2 } else { in_lane.len() };
        let mut largest: Option<(usize, usize, f64)> = None;
        for k in 0..followers {
            let (follower, leader) = (in_lane[k], in_lane[(k + 1) % in_lane.len()]);
            let half_lengths_m = self.fleet.half_length_m[follower] + self.fleet.half_length_m[leader];
            let alone_m = if follower == leader { self.road.config().length_m - 2.0 * half_lengths_m } else { 0.0 };
            let gap_m = alone_m + self.fleet.gap_m(follower, leader);
            // A gap across the end of the lane is none.
            if self.road.lane_end_ahead_m(lane, self.fleet.s_m[follower]) < gap_m {
                continue;
            }
            if largest.is_none_or(|(_, _, most_m)| gap_m > most_m) {
                largest = Some((follower, leader, gap_m));
            }
        }
        largest
    }

    /// The ego at the leader's speed in the middle of the gap, or as far ahead of the middle as its follower needs.
    fn fit(&self, lane: LaneIndex, (follower, leader): (usize, usize), gap_m: f64) -> Option<Start> {
        let speed_mps = self.fleet.speed_mps[leader];
        let room_m = gap_m - ego_length_m();
        let behind_m = self.limits(follower, true).required_gap_m(self.fleet.speed_mps[follower], speed_mps);
        let ahead_m = self.ego_limits().required_gap_m(speed_mps, speed_mps);
        if room_m < behind_m + ahead_m {
            return None;
        }
        let rear_gap_m = behind_m.max(0.5 * room_m);
        let s_m = self.fleet.s_m[follower] + self.fleet.half_length_m[follower] + rear_gap_m + 0.5 * ego_length_m();
        Some((self.road.wrap_m(s_m), lane, speed_mps))
    }

    fn check_written(&self, start: Start) -> Result<Start, ScenarioError> {
        let (s_m, lane, speed_mps) = start;
        for i in self.fleet.by_id().filter(|&i| self.fleet.lanes[i] & (1 << lane.0) != 0) {
            let ahead_m = self.fleet.signed_ahead_m(s_m, self.fleet.s_m[i]);
            let gap_m = ahead_m.abs() - self.fleet.half_length_m[i] - 0.5 * ego_length_m();
            let other = Party::Vehicle(self.fleet.id[i]);
            if ahead_m >= 0.0 {
                let required_m = self.ego_limits().required_gap_m(speed_mps, self.fleet.speed_mps[i]);
                check_gap([Party::Ego, other], gap_m, required_m)?;
            } else {
                let required_m = self.limits(i, true).required_gap_m(self.fleet.speed_mps[i], speed_mps);
                check_gap([other, Party::Ego], gap_m, required_m)?;
            }
        }
        Ok(start)
    }
}
