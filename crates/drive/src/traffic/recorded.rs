//! Recorded vehicles: each follows its track as long as it lasts, and is gone after it.
//!
//! They see nobody, so they may drive into the ego or, where the recording is inexact, through each other. By choice a vehicle
//! whose leader the ego has become leaves its track for good and drives itself.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::World;
use super::command::{Command, TrackPoint};
use crate::road::{LaneIndex, Road};
use crate::scenario::{Scenario, Track, VehicleKind, VehicleSpec};
use crate::scene::VehicleId;

/// Longer recorded vehicles are trucks, m.
const LONGEST_CAR_M: f64 = 7.0;
/// A vehicle is bound for the lane in which it would be after this time, s.
const FORESIGHT_S: f64 = 1.0;
/// The ego ahead within this time gap is a leader to be followed, s.
const FOLLOW_WITHIN_S: f64 = 3.0;

/// A recorded vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Recorded {
    track: usize,
    state: State,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum State {
    /// Not there yet.
    Outside,
    /// On the road, but not under way.
    Entered(VehicleId),
    /// On its track.
    Follows(VehicleId),
    /// Off its track, or gone.
    Over,
}

impl Recorded {
    /// All vehicles of the scenario's recording.
    pub(super) fn all(scenario: &Scenario) -> Vec<Self> {
        let count = scenario.recording.as_ref().map_or(0, |(recording, _)| recording.tracks.len());
        (0..count).map(|track| Self { track, state: State::Outside }).collect()
    }

    /// Moves on before the coming step.
    pub(super) fn play(&mut self, scenario: &Scenario, world: &mut World, dt_s: f64) {
        let Some((recording, reactive)) = &scenario.recording else { return };
        let track = &recording.tracks[self.track];
        let now_s = world.now as f64 * dt_s;
        self.enter(scenario, world, now_s);
        if let State::Entered(id) = self.state {
            let points = points(track, recording.period_s, &world.road, (now_s, dt_s));
            world.command(id, Command::Follow(points));
            self.state = State::Follows(id);
        }
        let State::Follows(id) = self.state else { return };
        if track.at(now_s + dt_s, recording.period_s).is_none() {
            world.remove(id);
            self.state = State::Over;
        } else if *reactive && world.follows_ego(id) {
            world.leave_track(id);
            self.state = State::Over;
        }
    }

    /// Appears on the road at the beginning of its track, unless the ego is there.
    pub(super) fn enter(&mut self, scenario: &Scenario, world: &mut World, now_s: f64) {
        let (State::Outside, Some((recording, _))) = (self.state, &scenario.recording) else { return };
        let track = &recording.tracks[self.track];
        let Some(sample) = track.at(now_s, recording.period_s) else { return };
        let lane = world.road.nearest_lane(sample.d_m);
        let kind = if track.length_m > LONGEST_CAR_M { VehicleKind::Truck } else { VehicleKind::Car };
        let mut spec = scenario.draw_entering(lane, self.track as u64);
        let fastest_mps = track.samples.iter().map(|sample| sample.speed_mps).fold(1.0, f64::max);
        spec.driver.desired_speed_mps = fastest_mps;
        spec = VehicleSpec { kind, s_m: sample.s_m, speed_mps: sample.speed_mps, ..spec };
        if world.is_on_ego(sample.s_m, sample.d_m, (track.length_m, track.width_m)) {
            self.state = State::Over;
            return;
        }
        let id = world.insert_recorded(&spec, sample.d_m, (track.length_m, track.width_m));
        self.state = State::Entered(id);
    }
}

/// The track from the step after `now_s` on, one point a step.
fn points(track: &Track, period_s: f64, road: &Road, (now_s, dt_s): (f64, f64)) -> Arc<[TrackPoint]> {
    let samples = (1..).map_while(|step| track.at(now_s + f64::from(step) * dt_s, period_s));
    let samples: Vec<_> = samples.collect();
    let point = |(index, sample): (usize, &crate::scenario::TrackSample)| {
        let before = samples[index.saturating_sub(1)];
        let lane = road.nearest_lane(sample.d_m);
        TrackPoint {
            s_m: sample.s_m,
            d_m: sample.d_m,
            speed_mps: sample.speed_mps,
            lateral_speed_mps: sample.lateral_speed_mps,
            accel_mps2: (sample.speed_mps - before.speed_mps) / dt_s,
            lane,
            target_lane: bound_for(road, lane, sample.d_m + FORESIGHT_S * sample.lateral_speed_mps),
        }
    };
    samples.iter().enumerate().map(point).collect()
}

/// The lane of `d_m`, or the one beside `lane` on the way there.
fn bound_for(road: &Road, lane: LaneIndex, d_m: f64) -> LaneIndex {
    let LaneIndex(wanted) = road.nearest_lane(d_m);
    LaneIndex(wanted.clamp(lane.0.saturating_sub(1), lane.0 + 1))
}

impl World {
    fn insert_recorded(&mut self, spec: &VehicleSpec, d_m: f64, (length_m, width_m): (f64, f64)) -> VehicleId {
        // A recorded vehicle chooses no lanes; one that drives itself is in no hurry to.
        let id = self.insert(spec, 1.0);
        if let Some(slot) = self.fleet.slot(id) {
            self.fleet.d_m[slot] = d_m;
            self.fleet.half_length_m[slot] = 0.5 * length_m;
            self.fleet.half_width_m[slot] = 0.5 * width_m;
        }
        id
    }

    fn is_on_ego(&self, s_m: f64, d_m: f64, (length_m, width_m): (f64, f64)) -> bool {
        self.ego.as_ref().is_some_and(|ego| {
            let along_m = self.fleet.signed_ahead_m(ego.s_m(), self.road.wrap_m(s_m)).abs();
            let across_m = (d_m - ego.d_m()).abs();
            along_m < 0.5 * length_m + ego.half_length_m() && across_m < 0.5 * width_m + ego.half_width_m()
        })
    }

    /// Whether the ego is what the vehicle has next ahead of it, and near.
    fn follows_ego(&self, id: VehicleId) -> bool {
        let (Some(ego), Some(i)) = (&self.ego, self.fleet.slot(id)) else { return false };
        let (fleet, lane) = (&self.fleet, self.fleet.lane[i]);
        let (ahead, gap_m) = ego.gap_m(fleet, i);
        let nearer = fleet.around(i, lane).ahead.is_none_or(|j| gap_m < fleet.gap_m(i, j));
        ahead && nearer && ego.occupies(lane) && gap_m < FOLLOW_WITHIN_S * fleet.speed_mps[i]
    }

    fn leave_track(&mut self, id: VehicleId) {
        // A command of no steps is none.
        self.command(id, Command::Accelerate { accel_mps2: 0.0, steps: 0 });
        if let Some(slot) = self.fleet.slot(id) {
            let lane = self.fleet.lane[slot];
            self.fleet.occupy(slot, lane, lane);
            self.fleet.lateral_speed_mps[slot] = 0.0;
        }
    }
}
