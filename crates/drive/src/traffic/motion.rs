//! How vehicles move through a step: along the road at constant acceleration, sideways along their lane changes.

use super::World;
use super::fleet::Fleet;
use crate::models::safe_distance::ballistic_step;
use crate::road::{LaneIndex, Road};
use crate::scene::VehicleId;

impl World {
    /// Moves all vehicles through a step.
    pub(super) fn advance(&mut self, dt_s: f64) {
        for i in 0..self.fleet.len() {
            self.fleet.advance(i, dt_s);
        }
        self.advance_changes(dt_s);
    }

    /// Starts a lane change of so many steps.
    pub(super) fn start_change(&mut self, slot: usize, lane: u8, change_steps: u32) {
        let fleet = &mut self.fleet;
        fleet.occupy(slot, fleet.lane[slot], lane);
        fleet.change_steps[slot] = change_steps;
        fleet.changed_step[slot] = self.now;
        fleet.changing.push(fleet.id[slot]);
    }

    /// Moves those that change lane to the side.
    fn advance_changes(&mut self, dt_s: f64) {
        let mut changing = std::mem::take(&mut self.fleet.changing);
        changing.retain(|&id| {
            let Some(slot) = self.fleet.slot(VehicleId(id)) else { return false };
            // Those that arrived in the last step come to rest.
            let changes = self.fleet.lane[slot] != self.fleet.target_lane[slot];
            let before_m = self.fleet.d_m[slot];
            if changes {
                let done_steps = self.now + 1 - self.fleet.changed_step[slot];
                self.fleet.advance_change(slot, done_steps as f64, &self.road, dt_s);
            }
            self.fleet.moved_left_m[slot] = self.fleet.d_m[slot] - before_m;
            changes
        });
        self.fleet.changing = changing;
    }
}

impl Fleet {
    fn advance(&mut self, i: usize, dt_s: f64) {
        let speed_mps = self.speed_mps[i];
        let (moved_m, next_mps) = ballistic_step(speed_mps, self.accel_mps2[i], dt_s);
        self.speed_mps[i] = next_mps;
        // A stop within the step makes the mean gentler than the demand.
        if next_mps == 0.0 {
            self.accel_mps2[i] = -speed_mps / dt_s + 0.0;
        }
        let s_m = self.s_m[i] + moved_m;
        self.s_m[i] = if s_m >= self.ring_m { s_m - self.ring_m } else { s_m };
        self.moved_m[i] = moved_m;
    }

    /// A quintic in time from center to center with zero lateral speed and acceleration at both ends.
    fn advance_change(&mut self, i: usize, done_steps: f64, road: &Road, dt_s: f64) {
        let target_lane = self.target_lane[i];
        let (from_m, to_m) = (road.lane_center_m(LaneIndex(self.lane[i])), road.lane_center_m(LaneIndex(target_lane)));
        let total_steps = f64::from(self.change_steps[i]);
        if done_steps >= total_steps {
            self.d_m[i] = to_m;
            self.lateral_speed_mps[i] = 0.0;
            self.occupy(i, target_lane, target_lane);
            return;
        }
        let total_s = total_steps * dt_s;
        let t = done_steps / total_steps;
        let rest = 1.0 - t;
        self.d_m[i] = from_m + (to_m - from_m) * t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
        self.lateral_speed_mps[i] = (to_m - from_m) * 30.0 * t * t * rest * rest / total_s;
    }
}
