//! The human-driven vehicles as a structure of arrays; the index is the vehicle's id.

use crate::models::idm::IdmParams;
use crate::models::safe_distance::ballistic_step;
use crate::road::{LaneIndex, Road};
use crate::scenario::{Scenario, VehicleKind, VehicleSpec};
use crate::scene::VehicleId;

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

/// A lane change under way.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LaneChange {
    /// Steps done.
    pub(super) done_steps: u32,
    /// Steps in all; 0 if no change is under way.
    pub(super) total_steps: u32,
}

/// All vehicles.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fleet {
    pub(super) s_m: Vec<f64>,
    pub(super) d_m: Vec<f64>,
    pub(super) speed_mps: Vec<f64>,
    pub(super) lateral_speed_mps: Vec<f64>,
    pub(super) accel_mps2: Vec<f64>,
    pub(super) lane: Vec<u8>,
    pub(super) target_lane: Vec<u8>,
    pub(super) change: Vec<LaneChange>,
    /// Steps until the next change may start.
    pub(super) cooldown_steps: Vec<u32>,
    /// Steps since the last change started; saturates.
    pub(super) since_change_steps: Vec<u32>,
    /// Steps left of a stress brake.
    pub(super) brake_steps: Vec<u32>,
    /// Displacement in the last step, along the road and to the left, m.
    pub(super) moved_m: Vec<(f64, f64)>,
    pub(super) half_length_m: Vec<f64>,
    pub(super) half_width_m: Vec<f64>,
    pub(super) driver: Vec<IdmParams>,
    pub(super) max_brake_mps2: Vec<f64>,
}

/// A duration in steps, at least one.
pub(super) fn steps(duration_s: f64, dt_s: f64) -> u32 {
    (duration_s / dt_s).round().max(1.0) as u32
}

impl Fleet {
    pub(super) fn new(scenario: &Scenario, dt_s: f64) -> Self {
        let vehicles = &scenario.vehicles;
        let each = |f: &dyn Fn(&VehicleSpec) -> f64| vehicles.iter().map(f).collect::<Vec<_>>();
        let lane: Vec<u8> = vehicles.iter().map(|vehicle| vehicle.lane.0).collect();
        let count = vehicles.len();
        Self {
            s_m: each(&|vehicle| scenario.road.wrap_m(vehicle.s_m)),
            d_m: each(&|vehicle| scenario.road.lane_center_m(vehicle.lane)),
            speed_mps: each(&|vehicle| vehicle.speed_mps),
            lateral_speed_mps: vec![0.0; count],
            accel_mps2: vec![0.0; count],
            target_lane: lane.clone(),
            lane,
            change: vec![LaneChange::default(); count],
            cooldown_steps: vehicles.iter().map(|vehicle| steps(vehicle.cooldown_s, dt_s)).collect(),
            since_change_steps: vec![u32::MAX; count],
            brake_steps: vec![0; count],
            moved_m: vec![(0.0, 0.0); count],
            half_length_m: each(&|vehicle| 0.5 * VehicleKind::length_m(vehicle.kind)),
            half_width_m: each(&|vehicle| 0.5 * VehicleKind::width_m(vehicle.kind)),
            driver: vehicles.iter().map(|vehicle| vehicle.driver).collect(),
            max_brake_mps2: each(&|vehicle| vehicle.max_brake_mps2),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.s_m.len()
    }

    /// The occupied lanes as bits: both during a change.
    pub(super) fn lane_bits(&self, i: usize) -> u8 {
        (1 << self.lane[i]) | (1 << self.target_lane[i])
    }

    pub(super) fn vehicle(&self, i: usize) -> Vehicle {
        Vehicle {
            id: VehicleId(i as u32),
            s_m: self.s_m[i],
            d_m: self.d_m[i],
            speed_mps: self.speed_mps[i],
            lateral_speed_mps: self.lateral_speed_mps[i],
            accel_mps2: self.accel_mps2[i],
            length_m: 2.0 * self.half_length_m[i],
            width_m: 2.0 * self.half_width_m[i],
            lane: LaneIndex(self.lane[i]),
            target_lane: LaneIndex(self.target_lane[i]),
        }
    }

    /// Moves vehicle `i` through a step at its acceleration, and sideways along its change.
    pub(super) fn advance(&mut self, i: usize, road: &Road, ring_m: f64, dt_s: f64) {
        let speed_mps = self.speed_mps[i];
        let (moved_m, next_mps) = ballistic_step(speed_mps, self.accel_mps2[i], dt_s);
        self.speed_mps[i] = next_mps;
        // A stop within the step makes the mean gentler than the demand.
        if next_mps == 0.0 {
            self.accel_mps2[i] = -speed_mps / dt_s + 0.0;
        }
        let s_m = self.s_m[i] + moved_m;
        self.s_m[i] = if s_m >= ring_m { s_m - ring_m } else { s_m };
        let before_m = self.d_m[i];
        if self.change[i].total_steps > 0 {
            self.advance_change(i, road, dt_s);
        }
        self.moved_m[i] = (moved_m, self.d_m[i] - before_m);
        self.cooldown_steps[i] = self.cooldown_steps[i].saturating_sub(1);
        self.since_change_steps[i] = self.since_change_steps[i].saturating_add(1);
        self.brake_steps[i] = self.brake_steps[i].saturating_sub(1);
    }

    /// A quintic in time from center to center with zero lateral speed and acceleration at both ends.
    fn advance_change(&mut self, i: usize, road: &Road, dt_s: f64) {
        let change = &mut self.change[i];
        change.done_steps += 1;
        let (from_m, to_m) =
            (road.lane_center_m(LaneIndex(self.lane[i])), road.lane_center_m(LaneIndex(self.target_lane[i])));
        if change.done_steps >= change.total_steps {
            *change = LaneChange::default();
            self.d_m[i] = to_m;
            self.lateral_speed_mps[i] = 0.0;
            self.lane[i] = self.target_lane[i];
            return;
        }
        let total_s = f64::from(change.total_steps) * dt_s;
        let t = f64::from(change.done_steps) / f64::from(change.total_steps);
        let rest = 1.0 - t;
        self.d_m[i] = from_m + (to_m - from_m) * t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
        self.lateral_speed_mps[i] = (to_m - from_m) * 30.0 * t * t * rest * rest / total_s;
    }
}
