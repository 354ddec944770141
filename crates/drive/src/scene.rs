//! All that the ego car may know: its own state, the vehicles it perceives and the road.
//!
//! The ego stack is given a [`Scene`] and nothing else, so that it cannot peek at the world and so that the same stack can be driven
//! by another simulator or a recording.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::road::{LaneIndex, Road, Side};
use crate::vehicle::VehicleState;

/// Identifies a vehicle for as long as it exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct VehicleId(pub u32);

/// No road has more lanes; the last ids belong to their ends.
const MAX_LANES: u32 = 8;

/// A perceived vehicle, or the end of a lane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Neighbor {
    /// Which vehicle.
    pub id: VehicleId,
    /// From the ego's center to this vehicle's center along the road, m; negative behind.
    pub ahead_m: f64,
    /// Lateral position of its center, m.
    pub d_m: f64,
    /// Speed along the road, m/s.
    pub speed_mps: f64,
    /// Speed to the left, m/s.
    pub lateral_speed_mps: f64,
    /// Acceleration along the road, m/s².
    pub accel_mps2: f64,
    /// Length, m.
    pub length_m: f64,
    /// Width, m.
    pub width_m: f64,
    /// The lane it is in, or leaves.
    pub lane: LaneIndex,
    /// The lane it changes into (its turn signal); equal to `lane` when it keeps.
    pub target_lane: LaneIndex,
}

impl Neighbor {
    /// A passenger car, 4.8 by 1.9 m, that keeps `lane` at constant speed.
    pub fn car(id: VehicleId, lane: LaneIndex, d_m: f64, ahead_m: f64, speed_mps: f64) -> Self {
        Self {
            id,
            ahead_m,
            d_m,
            speed_mps,
            lateral_speed_mps: 0.0,
            accel_mps2: 0.0,
            length_m: 4.8,
            width_m: 1.9,
            lane,
            target_lane: lane,
        }
    }

    /// The end of `lane`, `end_ahead_m` ahead of the ego's center: to the ego a vehicle that stands there for ever.
    pub fn lane_end(road: &Road, lane: LaneIndex, end_ahead_m: f64) -> Self {
        let end = Self::car(VehicleId(u32::MAX - u32::from(lane.0)), lane, road.lane_center_m(lane), end_ahead_m, 0.0);
        Self { ahead_m: end_ahead_m + 0.5 * end.length_m, ..end }
    }

    /// Whether it is no vehicle but the end of a lane.
    pub fn is_lane_end(&self) -> bool {
        self.id.0 > u32::MAX - MAX_LANES
    }

    /// Whether it stands in `lane`, leaves it or enters it.
    pub fn occupies(&self, lane: LaneIndex) -> bool {
        self.lane == lane || self.target_lane == lane
    }

    /// Bumper-to-bumper distance to an ego of this length, m; negative if they are abreast.
    pub fn gap_m(&self, ego_length_m: f64) -> f64 {
        self.ahead_m.abs() - 0.5 * (self.length_m + ego_length_m)
    }
}

/// The ego car's knowledge at one instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// The road.
    pub road: Arc<Road>,
    /// The ego's own state.
    pub ego: VehicleState,
    /// The ego's length, m.
    pub ego_length_m: f64,
    /// The ego's width, m.
    pub ego_width_m: f64,
    /// The lane whose center is nearest to the ego.
    pub ego_lane: LaneIndex,
    /// Perceived vehicles and ends of lanes by rising `ahead_m`, then by id.
    pub neighbors: Vec<Neighbor>,
}

impl Scene {
    /// Index of the nearest vehicle ahead (center not behind the ego's) that occupies `lane`.
    pub fn leader_index(&self, lane: LaneIndex) -> Option<usize> {
        self.neighbors.iter().position(|n| n.ahead_m >= 0.0 && n.occupies(lane))
    }

    /// The nearest vehicle ahead that occupies `lane`.
    pub fn leader(&self, lane: LaneIndex) -> Option<&Neighbor> {
        self.leader_index(lane).map(|index| &self.neighbors[index])
    }

    /// The lane on this side, if it exists beside the ego and the line between may be crossed.
    pub fn beside(&self, lane: LaneIndex, side: Side) -> Option<LaneIndex> {
        let body_m = 0.5 * self.ego_length_m;
        let beside = self.road.neighbor_lane(lane, side, self.ego.s_m)?;
        self.road.lane_holds(beside, self.ego.s_m, body_m).then_some(beside)
    }

    /// How far ahead of the ego's center the end of `lane` is seen, m; infinite if none is in sight.
    pub fn lane_end_ahead_m(&self, lane: LaneIndex) -> f64 {
        let end = self.neighbors.iter().find(|n| n.is_lane_end() && n.lane == lane);
        end.map_or(f64::INFINITY, |end| end.ahead_m - 0.5 * end.length_m)
    }

    /// The side to which the ego must leave its lane, because its end is in sight.
    pub fn way_out(&self) -> Option<Side> {
        let ends = self.lane_end_ahead_m(self.ego_lane).is_finite();
        if ends { self.road.way_out(self.ego_lane, self.ego.s_m) } else { None }
    }

    /// Index of the nearest vehicle behind that occupies `lane`.
    pub fn follower_index(&self, lane: LaneIndex) -> Option<usize> {
        self.neighbors.iter().rposition(|n| n.ahead_m < 0.0 && n.occupies(lane))
    }

    /// The nearest vehicle behind that occupies `lane`.
    pub fn follower(&self, lane: LaneIndex) -> Option<&Neighbor> {
        self.follower_index(lane).map(|index| &self.neighbors[index])
    }
}
