//! The human-driven vehicles as a structure of arrays in the order of their positions.
//!
//! The index into the arrays is the vehicle's slot. Slots follow each other along the road, so that every pass over the traffic
//! reads memory in order, and the nearest vehicles stand in the nearest slots. A vehicle that overtakes changes its slot; its id
//! stays.

use serde::{Deserialize, Serialize};

use crate::models::idm::{IdmParams, IdmTerms};
use crate::road::{LaneIndex, Road};
use crate::scenario::VehicleSpec;
use crate::scene::{Neighbor, VehicleId};

/// No slot: the vehicle has left.
const GONE: u32 = u32::MAX;
/// The step of a lane change that never was.
pub(super) const NEVER: i64 = i64::MIN;

/// One human-driven vehicle as others see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vehicle {
    /// Which one.
    pub id: VehicleId,
    /// Position of its center along the road, m.
    pub s_m: f64,
    /// Position of its center to the left of the reference line, m.
    pub d_m: f64,
    /// Speed along the road, m/s.
    pub speed_mps: f64,
    /// Speed to the left, m/s.
    pub lateral_speed_mps: f64,
    /// Mean acceleration over the last step, m/s².
    pub accel_mps2: f64,
    /// Length, m.
    pub length_m: f64,
    /// Width, m.
    pub width_m: f64,
    /// The lane it is in, or leaves.
    pub lane: LaneIndex,
    /// The lane it changes into; equal to `lane` when it keeps.
    pub target_lane: LaneIndex,
}

impl Vehicle {
    /// The vehicle as somebody sees it whose center is so far behind it along the road, m.
    pub fn seen(&self, ahead_m: f64) -> Neighbor {
        Neighbor {
            id: self.id,
            ahead_m,
            d_m: self.d_m,
            speed_mps: self.speed_mps,
            lateral_speed_mps: self.lateral_speed_mps,
            accel_mps2: self.accel_mps2,
            length_m: self.length_m,
            width_m: self.width_m,
            lane: self.lane,
            target_lane: self.target_lane,
        }
    }
}

/// Writes the columns once: all that handles whole vehicles follows from this list.
macro_rules! columns {
    ($($(#[$doc:meta])* $name:ident: $entry:ty,)*) => {
        /// All vehicles, by rising position and id.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        pub(super) struct Fleet {
            $($(#[$doc])* pub(super) $name: Vec<$entry>,)*
            /// The slot of each id from `first_id` on.
            slots: Vec<u32>,
            /// All ids below have left.
            first_id: u32,
            /// Ids of those that change lane or have just arrived, in the order of their starts.
            pub(super) changing: Vec<u32>,
            /// Length of the ring, infinite on an open road, m.
            pub(super) ring_m: f64,
            /// Half the length of the longest vehicle there ever was, m.
            pub(super) longest_half_m: f64,
        }

        /// One vehicle's entries.
        struct Row { $($name: $entry,)* }

        impl Fleet {
            fn empty(ring_m: f64) -> Self {
                let (slots, changing) = (Vec::new(), Vec::new());
                Self { $($name: Vec::new(),)* slots, first_id: 0, changing, ring_m, longest_half_m: 0.0 }
            }

            fn insert_row(&mut self, slot: usize, row: Row) {
                self.longest_half_m = self.longest_half_m.max(row.half_length_m);
                $(self.$name.insert(slot, row.$name);)*
            }

            fn remove_row(&mut self, slot: usize) {
                $(self.$name.remove(slot);)*
            }

            fn swap_rows(&mut self, a: usize, b: usize) {
                $(self.$name.swap(a, b);)*
            }

            fn rotate_rows_right(&mut self, count: usize) {
                $(self.$name.rotate_right(count);)*
            }
        }
    };
}

columns! {
    /// Which vehicle.
    id: u32,
    s_m: f64,
    d_m: f64,
    speed_mps: f64,
    lateral_speed_mps: f64,
    accel_mps2: f64,
    /// The occupied lanes as bits: both during a change.
    lanes: u8,
    lane: u8,
    target_lane: u8,
    /// The step in which the last lane change started.
    changed_step: i64,
    /// Steps that the last lane change takes in all.
    change_steps: u32,
    /// The first step in which the next change may start.
    free_step: i64,
    /// Displacement in the last step along the road, m.
    moved_m: f64,
    /// Displacement in the last step to the left, m.
    moved_left_m: f64,
    half_length_m: f64,
    half_width_m: f64,
    driver: IdmParams,
    politeness: f64,
    /// The terms of the driver's car following, for who looks at one vehicle ...
    terms: IdmTerms,
    /// ... and each a column, for all at once.
    per_desired_speed_spm: f64,
    time_headway_s: f64,
    min_gap_m: f64,
    max_accel_mps2: f64,
    per_braking_scale_s2pm: f64,
    max_brake_mps2: f64,
}

/// A duration in steps, at least one.
pub(super) fn steps(duration_s: f64, dt_s: f64) -> u32 {
    (duration_s / dt_s).round().max(1.0) as u32
}

impl Fleet {
    /// The vehicles of a scene with the index as the id; `free_steps`: the first step in which each may change lane.
    pub(super) fn new(specs: &[VehicleSpec], free_steps: &[i64], road: &Road, ring_m: f64) -> Self {
        let mut fleet = Self::empty(ring_m);
        let mut order: Vec<(f64, usize)> = specs.iter().map(|spec| road.wrap_m(spec.s_m)).zip(0..).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (slot, &(_, id)) in order.iter().enumerate() {
            fleet.insert_row(slot, row(id as u32, &specs[id], road, free_steps[id]));
        }
        fleet.slots = vec![GONE; specs.len()];
        fleet.number_slots(0..specs.len());
        fleet.changing.reserve(specs.len());
        fleet
    }

    /// Adds a vehicle; returns its id, which no other ever had.
    pub(super) fn insert(&mut self, spec: &VehicleSpec, road: &Road, free_step: i64) -> VehicleId {
        let id = self.first_id + self.slots.len() as u32;
        let row = row(id, spec, road, free_step);
        let slot = self.s_m.partition_point(|&s_m| s_m <= row.s_m);
        self.insert_row(slot, row);
        self.slots.push(GONE);
        self.number_slots(slot..self.len());
        VehicleId(id)
    }

    /// Takes a vehicle off the road; returns whether there was one of this id.
    pub(super) fn remove(&mut self, id: VehicleId) -> bool {
        let Some(slot) = self.slot(id) else { return false };
        self.remove_row(slot);
        self.slots[(id.0 - self.first_id) as usize] = GONE;
        self.number_slots(slot..self.len());
        self.changing.retain(|&changing| changing != id.0);
        // Where vehicles enter and leave all the time, ids that have left must not pile up.
        let gone = self.slots.iter().take_while(|&&slot| slot == GONE).count();
        if 2 * gone > self.slots.len() {
            self.slots.drain(..gone);
            self.first_id += gone as u32;
        }
        true
    }

    fn number_slots(&mut self, slots: std::ops::Range<usize>) {
        for slot in slots {
            self.slots[(self.id[slot] - self.first_id) as usize] = slot as u32;
        }
    }

    pub(super) fn len(&self) -> usize {
        self.id.len()
    }

    /// Where the vehicle of this id stands, if it is on the road.
    pub(super) fn slot(&self, id: VehicleId) -> Option<usize> {
        let index = id.0.checked_sub(self.first_id)?;
        self.slots.get(index as usize).filter(|&&slot| slot != GONE).map(|&slot| slot as usize)
    }

    /// All ids on the road, and some that have left.
    pub(super) fn ids(&self) -> std::ops::Range<u32> {
        self.first_id..self.first_id + self.slots.len() as u32
    }

    /// The slots by rising id.
    pub(super) fn by_id(&self) -> impl Iterator<Item = usize> + '_ {
        self.slots.iter().filter(|&&slot| slot != GONE).map(|&slot| slot as usize)
    }

    /// Restores the order after a step: those that passed the ring's end are turned to the front, the rest is nearly sorted, which
    /// insertion does in near linear time.
    pub(super) fn sort(&mut self) {
        if self.ring_m.is_finite() {
            // Whoever stands nearer to the start than it has moved has just passed it.
            let moved = self.s_m.iter().zip(&self.moved_m).rev();
            let passed = moved.take_while(|(s_m, moved_m)| s_m < moved_m).count();
            if passed > 0 {
                self.rotate_rows_right(passed);
                self.number_slots(0..self.len());
            }
        }
        let mut sorted = 1;
        while let Some(offset) = self.s_m[sorted - 1..].windows(2).position(|pair| pair[0] >= pair[1]) {
            self.sink(sorted + offset);
            sorted += offset + 1;
        }
    }

    /// Moves the vehicle of this slot back to its place among those before it.
    fn sink(&mut self, mut slot: usize) {
        let top = slot;
        while slot > 0 && (self.s_m[slot], self.id[slot]) < (self.s_m[slot - 1], self.id[slot - 1]) {
            self.swap_rows(slot - 1, slot);
            slot -= 1;
        }
        self.number_slots(slot..top + 1);
    }

    /// Gives the vehicle in this slot another driver.
    pub(super) fn set_driver(&mut self, slot: usize, driver: IdmParams) {
        let terms = IdmTerms::from(&driver);
        (self.driver[slot], self.terms[slot]) = (driver, terms);
        self.per_desired_speed_spm[slot] = terms.per_desired_speed_spm;
        self.time_headway_s[slot] = terms.time_headway_s;
        self.min_gap_m[slot] = terms.min_gap_m;
        self.max_accel_mps2[slot] = terms.max_accel_mps2;
        self.per_braking_scale_s2pm[slot] = terms.per_braking_scale_s2pm;
    }

    /// Sets the lanes of the vehicle in this slot.
    pub(super) fn occupy(&mut self, slot: usize, lane: u8, target_lane: u8) {
        (self.lane[slot], self.target_lane[slot]) = (lane, target_lane);
        self.lanes[slot] = (1 << lane) | (1 << target_lane);
    }

    pub(super) fn vehicle(&self, slot: usize) -> Vehicle {
        Vehicle {
            id: VehicleId(self.id[slot]),
            s_m: self.s_m[slot],
            d_m: self.d_m[slot],
            speed_mps: self.speed_mps[slot],
            lateral_speed_mps: self.lateral_speed_mps[slot],
            accel_mps2: self.accel_mps2[slot],
            length_m: 2.0 * self.half_length_m[slot],
            width_m: 2.0 * self.half_width_m[slot],
            lane: LaneIndex(self.lane[slot]),
            target_lane: LaneIndex(self.target_lane[slot]),
        }
    }
}

fn row(id: u32, spec: &VehicleSpec, road: &Road, free_step: i64) -> Row {
    let terms = IdmTerms::from(&spec.driver);
    Row {
        id,
        s_m: road.wrap_m(spec.s_m),
        d_m: road.lane_center_m(spec.lane),
        speed_mps: spec.speed_mps,
        lateral_speed_mps: 0.0,
        accel_mps2: 0.0,
        lanes: 1 << spec.lane.0,
        lane: spec.lane.0,
        target_lane: spec.lane.0,
        changed_step: NEVER,
        change_steps: 0,
        free_step,
        moved_m: 0.0,
        moved_left_m: 0.0,
        half_length_m: 0.5 * spec.kind.length_m(),
        half_width_m: 0.5 * spec.kind.width_m(),
        driver: spec.driver,
        politeness: spec.politeness,
        terms,
        per_desired_speed_spm: terms.per_desired_speed_spm,
        time_headway_s: terms.time_headway_s,
        min_gap_m: terms.min_gap_m,
        max_accel_mps2: terms.max_accel_mps2,
        per_braking_scale_s2pm: terms.per_braking_scale_s2pm,
        max_brake_mps2: spec.max_brake_mps2,
    }
}
