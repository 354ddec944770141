//! How vehicles move through a step: along the road at constant acceleration, sideways along their lane changes.

use pulp::Arch;

use super::World;
use super::fleet::Fleet;
use crate::models::safe_distance::ballistic_step;
use crate::road::{LaneIndex, Road};
use crate::scene::VehicleId;

impl World {
    /// Moves all vehicles through a step.
    pub(super) fn advance(&mut self, arch: Arch, dt_s: f64) {
        let fleet = &mut self.fleet;
        let motion = [&mut fleet.s_m, &mut fleet.speed_mps, &mut fleet.accel_mps2, &mut fleet.moved_m];
        arch.dispatch(
            #[inline(always)]
            || advance_all(motion.map(Vec::as_mut_slice), fleet.ring_m, dt_s),
        );
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

/// Moves all along the road: position in m, speed in m/s, acceleration in m/s² and what each has moved in m.
// Must be inlined into what `pulp` compiles for the processor's instruction set.
#[allow(clippy::inline_always)]
#[inline(always)]
fn advance_all([s_m, speed_mps, accel_mps2, moved_m]: [&mut [f64]; 4], ring_m: f64, dt_s: f64) {
    let count = s_m.len();
    let (speed_mps, accel_mps2, moved_m) = (&mut speed_mps[..count], &mut accel_mps2[..count], &mut moved_m[..count]);
    for i in 0..count {
        let (on_m, next_mps) = ballistic_step(speed_mps[i], accel_mps2[i], dt_s);
        // A stop within the step makes the mean gentler than the demand.
        let stopped_mps2 = 0.0 - speed_mps[i] * (1.0 / dt_s);
        accel_mps2[i] = if next_mps == 0.0 { stopped_mps2 } else { accel_mps2[i] };
        let next_m = s_m[i] + on_m;
        s_m[i] = if next_m >= ring_m { next_m - ring_m } else { next_m };
        speed_mps[i] = next_mps;
        moved_m[i] = on_m;
    }
}
