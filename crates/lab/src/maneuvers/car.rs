//! Scripted cars: a start, phases of acceleration and at most one lane change.

use lanecraft_drive::plan::{LateralState, Quintic};
use lanecraft_drive::road::{LaneIndex, Road};
use lanecraft_drive::scene::{Neighbor, VehicleId};

/// Length and width of every scripted car, m.
pub(crate) const CAR_SIZE_M: (f64, f64) = (4.8, 1.9);
/// A car that does not signal is seen to leave its lane when it has moved this far, m: the wandering zone of UN
/// Regulation 157.
const WANDERING_M: f64 = 0.375;

/// An acceleration from some time on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phase {
    /// From when, s.
    pub from_s: f64,
    /// Acceleration, m/s²; a car never drives backward.
    pub accel_mps2: f64,
}

/// How a car moves sideways.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LateralShape {
    /// Along a quintic, with its turn signal on.
    Signaled,
    /// At constant lateral speed, without a signal.
    Abrupt,
}

/// A lane change of a scripted car.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaneMove {
    /// When it begins, s.
    pub at_s: f64,
    /// How long it takes, s.
    pub duration_s: f64,
    /// Where to.
    pub to: LaneIndex,
    /// How.
    pub shape: LateralShape,
}

/// A scripted car.
#[derive(Clone, Debug, PartialEq)]
pub struct CarScript {
    /// Bumper-to-bumper distance to the ego at the start, m; negative if it is behind.
    pub gap_m: f64,
    /// Lane at the start.
    pub lane: LaneIndex,
    /// Speed at the start, m/s.
    pub speed_mps: f64,
    /// Accelerations by rising time; none before the first.
    pub phases: Vec<Phase>,
    /// Its lane change, if any.
    pub change: Option<LaneMove>,
    /// It is not perceived before, s.
    pub hidden_until_s: f64,
}

impl CarScript {
    /// A car that keeps its lane and its speed.
    pub fn steady(gap_m: f64, lane: u8, speed_mps: f64) -> Self {
        let lane = LaneIndex(lane);
        Self { gap_m, lane, speed_mps, phases: Vec::new(), change: None, hidden_until_s: 0.0 }
    }

    /// The same with these accelerations, as (from, m/s²).
    #[must_use]
    pub fn with_phases(mut self, phases: &[(f64, f64)]) -> Self {
        self.phases = phases.iter().map(|&(from_s, accel_mps2)| Phase { from_s, accel_mps2 }).collect();
        self
    }

    /// The same with a lane change.
    #[must_use]
    pub fn with_change(mut self, at_s: f64, duration_s: f64, to: u8, shape: LateralShape) -> Self {
        self.change = Some(LaneMove { at_s, duration_s, to: LaneIndex(to), shape });
        self
    }

    /// The same, hidden until then.
    #[must_use]
    pub fn hidden_until(mut self, time_s: f64) -> Self {
        self.hidden_until_s = time_s;
        self
    }

    /// Lateral position (m) and speed (m/s) at `time_s`.
    fn lateral(&self, road: &Road, time_s: f64) -> (f64, f64) {
        let from_m = road.lane_center_m(self.lane);
        let Some(change) = &self.change else { return (from_m, 0.0) };
        let (to_m, elapsed_s) = (road.lane_center_m(change.to), time_s - change.at_s);
        if elapsed_s <= 0.0 {
            return (from_m, 0.0);
        }
        match change.shape {
            LateralShape::Signaled => {
                let start = LateralState { d_m: from_m, ..LateralState::default() };
                let (d_m, speed_mps, ..) = Quintic::new(start, to_m, change.duration_s).at(elapsed_s);
                (d_m, speed_mps)
            }
            LateralShape::Abrupt if elapsed_s >= change.duration_s => (to_m, 0.0),
            LateralShape::Abrupt => {
                let speed_mps = (to_m - from_m) / change.duration_s;
                (from_m + speed_mps * elapsed_s, speed_mps)
            }
        }
    }
}

/// A scripted car on its way.
#[derive(Clone, Debug)]
pub(crate) struct Car<'a> {
    script: &'a CarScript,
    id: VehicleId,
    pub(crate) s_m: f64,
    pub(crate) d_m: f64,
    speed_mps: f64,
    accel_mps2: f64,
    lateral_speed_mps: f64,
}

impl<'a> Car<'a> {
    /// At its start, for an ego of this length at s = 0.
    pub(crate) fn new(script: &'a CarScript, index: usize, road: &Road, ego_length_m: f64) -> Self {
        let bumpers_m = 0.5 * (CAR_SIZE_M.0 + ego_length_m);
        let s_m = script.gap_m + bumpers_m.copysign(script.gap_m);
        let d_m = road.lane_center_m(script.lane);
        let id = VehicleId(index as u32 + 1);
        Self { script, id, s_m, d_m, speed_mps: script.speed_mps, accel_mps2: 0.0, lateral_speed_mps: 0.0 }
    }

    /// Moves on by `dt_s` from `time_s`.
    pub(crate) fn advance(&mut self, road: &Road, time_s: f64, dt_s: f64) {
        // Half a step of tolerance: times are multiples of the step.
        let phase = self.script.phases.iter().rev().find(|phase| time_s + 0.5 * dt_s >= phase.from_s);
        let accel_mps2 = phase.map_or(0.0, |phase| phase.accel_mps2);
        let next = (self.speed_mps + accel_mps2 * dt_s).max(0.0);
        self.s_m += 0.5 * (self.speed_mps + next) * dt_s;
        self.accel_mps2 = if next > 0.0 { accel_mps2 } else { 0.0 };
        self.speed_mps = next;
        (self.d_m, self.lateral_speed_mps) = self.script.lateral(road, time_s + dt_s);
    }

    /// What an ego at `ego_s_m` perceives of it.
    pub(crate) fn perceived(&self, road: &Road, ego_s_m: f64, time_s: f64) -> Option<Neighbor> {
        if time_s < self.script.hidden_until_s {
            return None;
        }
        let (lane, target_lane) = self.lanes(road, time_s);
        Some(Neighbor {
            id: self.id,
            ahead_m: self.s_m - ego_s_m,
            d_m: self.d_m,
            speed_mps: self.speed_mps,
            lateral_speed_mps: self.lateral_speed_mps,
            accel_mps2: self.accel_mps2,
            length_m: CAR_SIZE_M.0,
            width_m: CAR_SIZE_M.1,
            lane,
            target_lane,
        })
    }

    fn lanes(&self, road: &Road, time_s: f64) -> (LaneIndex, LaneIndex) {
        let from = self.script.lane;
        let Some(change) = &self.script.change else { return (from, from) };
        let moved_m = (self.d_m - road.lane_center_m(from)).abs();
        let begun = match change.shape {
            LateralShape::Signaled => time_s >= change.at_s,
            LateralShape::Abrupt => moved_m >= WANDERING_M,
        };
        if time_s >= change.at_s + change.duration_s {
            (change.to, change.to)
        } else {
            (from, if begun { change.to } else { from })
        }
    }
}
