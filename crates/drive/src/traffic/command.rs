//! What takes the place of a driver's free will: stress brakes, scripted events, recorded traffic.
//!
//! Commands are few and kept apart from the vehicles, so that those who drive themselves pay nothing for them. Who is under a
//! command chooses no lanes.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::World;
use super::fleet::{Fleet, steps};
use crate::road::LaneIndex;
use crate::scene::VehicleId;

/// A place and a motion on a recorded track.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackPoint {
    /// Position of the center along the road, m.
    pub s_m: f64,
    /// Position of the center to the left of the reference line, m.
    pub d_m: f64,
    /// Speed along the road, m/s.
    pub speed_mps: f64,
    /// Speed to the left, m/s.
    pub lateral_speed_mps: f64,
    /// Acceleration along the road, m/s².
    pub accel_mps2: f64,
    /// The lane it is in, or leaves.
    pub lane: LaneIndex,
    /// The lane it changes into; equal to `lane` when it keeps.
    pub target_lane: LaneIndex,
}

/// What a vehicle does instead of what its driver wants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Command {
    /// Brakes or accelerates, whatever is ahead; a vehicle brakes no harder than it can.
    Accelerate {
        /// The acceleration, m/s².
        accel_mps2: f64,
        /// For how many steps.
        steps: u32,
    },
    /// Brakes at least this hard, and harder where what is ahead asks for it.
    Brake {
        /// The deceleration, m/s² (positive).
        decel_mps2: f64,
        /// For how many steps.
        steps: u32,
    },
    /// Follows a recorded track of one point a step, the next step leading to the first; drives itself after the last.
    Follow(Arc<[TrackPoint]>),
}

/// A command under way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Order {
    pub(super) id: VehicleId,
    command: Command,
    /// The step in which it was given.
    since_step: i64,
}

impl Order {
    /// How many steps it takes in all.
    fn steps(&self) -> i64 {
        match &self.command {
            Command::Accelerate { steps, .. } | Command::Brake { steps, .. } => i64::from(*steps),
            Command::Follow(points) => points.len() as i64,
        }
    }

    /// Steps left in step `now`.
    pub(super) fn left_steps(&self, now: i64) -> i64 {
        (self.since_step + self.steps() - now).max(0)
    }
}

impl World {
    /// Puts a command in the place of a vehicle's free will from the next step on; a new one replaces the last. Nothing happens if there
    /// is no such vehicle.
    pub fn command(&mut self, id: VehicleId, command: Command) {
        if self.fleet.slot(id).is_none() {
            return;
        }
        if matches!(command, Command::Follow(_)) {
            self.fleet.changing.retain(|&changing| changing != id.0);
        }
        let order = Order { id, command, since_step: self.now };
        match self.find_order(id) {
            Ok(index) => self.orders[index] = order,
            Err(index) => self.orders.insert(index, order),
        }
    }

    /// Makes a vehicle change into `lane` from the next step on, whoever is there. Returns whether there is such a vehicle and such a
    /// lane beside it and no change under way.
    pub fn change_lane(&mut self, id: VehicleId, lane: LaneIndex, dt_s: f64) -> bool {
        let Some(slot) = self.fleet.slot(id) else { return false };
        let own = self.fleet.lane[slot];
        let possible =
            own == self.fleet.target_lane[slot] && own.abs_diff(lane.0) == 1 && self.road.lanes().any(|l| l == lane);
        if possible {
            self.start_change(slot, lane.0, steps(self.traffic.lane_change_duration_s, dt_s));
        }
        possible
    }

    /// Whether a command stands in the place of the vehicle's will.
    pub fn is_commanded(&self, id: VehicleId) -> bool {
        !self.orders.is_empty() && self.find_order(id).is_ok()
    }

    fn find_order(&self, id: VehicleId) -> Result<usize, usize> {
        self.orders.binary_search_by_key(&id, |order| order.id)
    }

    /// Forgets the commands that have been carried out.
    pub(super) fn end_orders(&mut self) {
        let (now, fleet, road) = (self.now, &mut self.fleet, &self.road);
        self.orders.retain(|order| {
            let Some(slot) = fleet.slot(order.id) else { return false };
            let goes_on = order.left_steps(now) > 0;
            if !goes_on && matches!(order.command, Command::Follow(_)) {
                // It drives itself again, in the lane where it is, and comes to rest there.
                let lane = road.nearest_lane(fleet.d_m[slot]).0;
                fleet.occupy(slot, lane, lane);
                fleet.lateral_speed_mps[slot] = 0.0;
                fleet.changing.push(order.id.0);
            }
            goes_on
        });
    }

    /// Puts the commanded accelerations in the place of the wished ones.
    pub(super) fn obey(&mut self) {
        for order in &self.orders {
            let Some(slot) = self.fleet.slot(order.id) else { continue };
            let wish_mps2 = &mut self.fleet.accel_mps2[slot];
            let accel_mps2 = match order.command {
                Command::Accelerate { accel_mps2, .. } => accel_mps2,
                Command::Brake { decel_mps2, .. } => wish_mps2.min(-decel_mps2),
                Command::Follow(_) => continue,
            };
            *wish_mps2 = accel_mps2.max(-self.fleet.max_brake_mps2[slot]);
        }
    }

    /// Moves those on a track to its next point.
    pub(super) fn follow_tracks(&mut self) {
        for order in &self.orders {
            let (Command::Follow(points), Some(slot)) = (&order.command, self.fleet.slot(order.id)) else { continue };
            if let Some(point) = points.get((self.now - order.since_step) as usize) {
                let s_m = self.road.wrap_m(point.s_m);
                let from = (self.before_m(slot), self.fleet.d_m[slot]);
                if self.fleet.target_lane[slot] != point.target_lane.0 {
                    self.fleet.changed_step[slot] = self.now;
                }
                place(&mut self.fleet, slot, &TrackPoint { s_m, ..*point }, from);
            }
        }
    }

    /// Where the vehicle was before the step.
    fn before_m(&self, slot: usize) -> f64 {
        self.road.wrap_m(self.fleet.s_m[slot] - self.fleet.moved_m[slot])
    }
}

fn place(fleet: &mut Fleet, slot: usize, point: &TrackPoint, (from_s_m, from_d_m): (f64, f64)) {
    fleet.moved_m[slot] = fleet.signed_ahead_m(from_s_m, point.s_m);
    fleet.moved_left_m[slot] = point.d_m - from_d_m;
    fleet.s_m[slot] = point.s_m;
    fleet.d_m[slot] = point.d_m;
    fleet.speed_mps[slot] = point.speed_mps;
    fleet.lateral_speed_mps[slot] = point.lateral_speed_mps;
    fleet.accel_mps2[slot] = point.accel_mps2;
    fleet.occupy(slot, point.lane.0, point.target_lane.0);
}
