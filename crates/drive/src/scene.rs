//! All that the ego car may know: its own state, the vehicles it perceives and the road.
//!
//! The ego stack is given a [`Scene`] and nothing else, so that it cannot peek at the world and so that the same stack can be driven
//! by another simulator or a recording.

use std::sync::Arc;

use crate::road::{LaneIndex, Road};
use crate::vehicle::VehicleState;

/// Identifies a vehicle for as long as it exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct VehicleId(pub u32);

/// A perceived vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
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
#[derive(Clone, Debug, PartialEq)]
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
    /// Perceived vehicles by rising `ahead_m`, then by id.
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

    /// Index of the nearest vehicle behind that occupies `lane`.
    pub fn follower_index(&self, lane: LaneIndex) -> Option<usize> {
        self.neighbors.iter().rposition(|n| n.ahead_m < 0.0 && n.occupies(lane))
    }

    /// The nearest vehicle behind that occupies `lane`.
    pub fn follower(&self, lane: LaneIndex) -> Option<&Neighbor> {
        self.follower_index(lane).map(|index| &self.neighbors[index])
    }
}
