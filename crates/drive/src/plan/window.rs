//! The allowed durations of a lane change (Eq. 15), and why there may be none.
//!
//! The paper's d_avoi = V_rel t_c + ½ a_max t_c² ≤ min{d_c, d_a} − s_saf has one relative speed for two leaders, and no follower.
//! Here every vehicle has its own: those ahead in the new lane count until t_c, those ahead in the old lane until the bodies are
//! apart, and those behind in the new lane must get along with a comfortable braking until t_c (MOBIL's safety criterion; Kesting,
//! Treiber and Helbing, 2007). All of them, not the nearest alone: a fast leader may hide a slow one. The forecast has its say
//! beside the worst case of Eq. 15.

use serde::{Deserialize, Serialize};

use super::candidates::PlannerConfig;
use super::motion::Motion;
use super::quintic::LateralState;
use crate::predict::{FORECAST_STEP_S, Forecast};
use crate::road::{LaneIndex, Side};
use crate::scene::{Neighbor, Scene};

/// Why a lane change is not allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "kebab-case")]
pub enum Refusal {
    /// No lane on this side, or a solid line before it.
    #[error("there is no lane to cross into on this side")]
    NoLane,
    /// The new lane ends in sight, or the present one does and this is not the way out of it.
    #[error("the new lane ends in sight or leads no way out of one that does")]
    LaneEnds,
    /// A vehicle abreast in the new lane.
    #[error("a vehicle is abreast in the new lane")]
    Occupied,
    /// No duration within the lateral bounds.
    #[error("no duration keeps the lateral bounds")]
    LateralLimit,
    /// A vehicle ahead in the new lane leaves less time than the shortest duration.
    #[error("a leader in the new lane is too close")]
    TargetLeader,
    /// A vehicle ahead in the old lane leaves less time than the shortest duration.
    #[error("the leader in the present lane is too close")]
    CurrentLeader,
    /// A vehicle behind in the new lane would have to brake too hard.
    #[error("a follower in the new lane is too close")]
    Follower,
    /// The others leave time for a lane change, but not for one within the lateral bounds.
    #[error("the time left is shorter than the lateral bounds allow")]
    EmptyWindow,
}

impl Refusal {
    /// All reasons, in the order in which they are looked for.
    pub const ALL: [Self; 8] = [
        Self::NoLane,
        Self::LaneEnds,
        Self::Occupied,
        Self::LateralLimit,
        Self::TargetLeader,
        Self::CurrentLeader,
        Self::Follower,
        Self::EmptyWindow,
    ];
}

/// The lane change allowed on one side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Window {
    /// Which side.
    pub side: Side,
    /// The lane it leaves.
    pub from: LaneIndex,
    /// The lane it enters.
    pub to: LaneIndex,
    /// The measured lateral state from which it starts.
    pub start: LateralState,
    /// Shortest allowed duration, s; always allowed.
    pub shortest_s: f64,
    /// Longest allowed duration, s. A path between the two may still break a lateral bound.
    pub longest_s: f64,
}

/// The longest durations that the others allow, s, by refusal.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct TimeLimits([(Refusal, f64); 3]);

impl TimeLimits {
    /// Looks at every neighbor of `scene`. `separation_share` is the share of the duration after which the old lane is left.
    pub(super) fn new(
        config: &PlannerConfig,
        (scene, forecast): (&Scene, &Forecast),
        to: LaneIndex,
        separation_share: f64,
        horizon_s: f64,
    ) -> Self {
        let encounter = Encounter { config, scene, forecast, horizon_s };
        let [mut target, mut current, mut follower] = [f64::INFINITY; 3];
        for (index, neighbor) in scene.neighbors.iter().enumerate() {
            let ahead = neighbor.ahead_m >= 0.0;
            if neighbor.occupies(to) {
                if ahead {
                    target = target.min(encounter.leader_s(index, neighbor));
                } else {
                    follower = follower.min(encounter.follower_s(index, neighbor));
                }
            }
            if ahead && neighbor.occupies(scene.ego_lane) {
                current = current.min(encounter.leader_s(index, neighbor) / separation_share);
            }
        }
        Self([(Refusal::TargetLeader, target), (Refusal::CurrentLeader, current), (Refusal::Follower, follower)])
    }

    /// The tightest one; the first of equal ones.
    pub(super) fn tightest(&self) -> (Refusal, f64) {
        self.0.iter().fold(self.0[0], |best, &limit| if limit.1 < best.1 { limit } else { best })
    }
}

/// Whether `motion`, whose speed changes, keeps the gaps that a window asks for at constant speed: to the leaders in the new lane, until
/// the bodies are apart to those in the old one, and to the followers in the new lane.
///
/// The gaps are looked at every forecast step. Between two of them the ego and, in the worst case, the leader leave the straight line
/// by no more than an eighth of their accelerations times the step squared, which is added to the gap asked for.
pub(super) fn keeps_gaps(
    config: &PlannerConfig,
    (scene, forecast): (&Scene, &Forecast),
    to: LaneIndex,
    separation_share: f64,
    motion: &Motion,
) -> bool {
    let (course, duration_s) = (motion.course(), motion.lateral.duration_s);
    let curved_mps2 = course.max_accel_mps2() + config.leader_decel_mps2;
    let asked_m = config.safety_gap_m + 0.125 * curved_mps2 * FORECAST_STEP_S * FORECAST_STEP_S;
    let keeps = |index: usize, neighbor: &Neighbor, until_s: f64| {
        let lengths_m = 0.5 * (neighbor.length_m + scene.ego_length_m);
        let steps = (until_s / FORECAST_STEP_S).ceil() as usize;
        (0..=steps).all(|step| {
            let time_s = step as f64 * FORECAST_STEP_S;
            let ((way_m, speed_mps, _), point) = (course.at(time_s), forecast.at(index, time_s));
            if neighbor.ahead_m >= 0.0 {
                let worst_m = time_s * (neighbor.speed_mps - 0.5 * config.leader_decel_mps2 * time_s);
                point.ahead_m.min(neighbor.ahead_m + worst_m) - way_m - lengths_m >= asked_m
            } else {
                let closing_mps = (point.speed_mps - speed_mps).max(0.0);
                let braking_m = 0.5 * closing_mps * closing_mps / config.follower_decel_mps2;
                way_m - point.ahead_m - lengths_m >= asked_m + braking_m
            }
        })
    };
    scene.neighbors.iter().enumerate().all(|(index, neighbor)| {
        let leaves = neighbor.ahead_m >= 0.0 && neighbor.occupies(scene.ego_lane);
        (!neighbor.occupies(to) || keeps(index, neighbor, duration_s))
            && (!leaves || keeps(index, neighbor, separation_share * duration_s))
    })
}

/// The ego, at constant speed, among its neighbors.
struct Encounter<'a> {
    config: &'a PlannerConfig,
    scene: &'a Scene,
    forecast: &'a Forecast,
    horizon_s: f64,
}

impl Encounter<'_> {
    /// Until when the ego keeps s_saf to a vehicle ahead, s: if that one brakes from now on (Eq. 15), and as forecast.
    fn leader_s(&self, index: usize, leader: &Neighbor) -> f64 {
        let room_m = leader.gap_m(self.scene.ego_length_m) - self.config.safety_gap_m;
        let approach_mps = self.scene.ego.road_speed_mps() - leader.speed_mps;
        let worst_s = time_to_close(room_m, approach_mps, self.config.leader_decel_mps2);
        let forecast_s = self.holds_until_s(index, leader, |gap_m, _| gap_m >= self.config.safety_gap_m);
        worst_s.min(forecast_s)
    }

    /// Until when a vehicle behind can still avoid coming closer than s_saf with the braking that may be asked of it, s.
    fn follower_s(&self, index: usize, follower: &Neighbor) -> f64 {
        self.holds_until_s(index, follower, |gap_m, approach_mps| {
            let closing_mps = approach_mps.max(0.0);
            let braking_m = 0.5 * closing_mps * closing_mps / self.config.follower_decel_mps2;
            gap_m >= self.config.safety_gap_m + braking_m
        })
    }

    /// The last forecast instant up to which `holds(gap, their speed − ours)` has always been true, s; 0 if it is false now,
    /// infinity if it is true until the horizon.
    fn holds_until_s(&self, index: usize, neighbor: &Neighbor, holds: impl Fn(f64, f64) -> bool) -> f64 {
        let speed_mps = self.scene.ego.road_speed_mps();
        let lengths_m = 0.5 * (neighbor.length_m + self.scene.ego_length_m);
        let direction = if neighbor.ahead_m >= 0.0 { 1.0 } else { -1.0 };
        let track = self.forecast.track(index);
        let steps = (self.horizon_s / FORECAST_STEP_S).ceil() as usize;
        for step in 0..=steps {
            let time_s = step as f64 * FORECAST_STEP_S;
            let point = track.get(step).copied().unwrap_or_else(|| self.forecast.at(index, time_s));
            let gap_m = direction * (point.ahead_m - speed_mps * time_s) - lengths_m;
            if !holds(gap_m, point.speed_mps - speed_mps) {
                return step.saturating_sub(1) as f64 * FORECAST_STEP_S;
            }
        }
        f64::INFINITY
    }
}

/// The time t up to which `approach_mps` t + ½ `decel_mps2` t² stays within `room_m`, s; 0 without room.
fn time_to_close(room_m: f64, approach_mps: f64, decel_mps2: f64) -> f64 {
    if room_m < 0.0 {
        return 0.0;
    }
    let root = (approach_mps * approach_mps + 2.0 * decel_mps2 * room_m).sqrt();
    // The same root in the form that does not cancel.
    if approach_mps > 0.0 { 2.0 * room_m / (approach_mps + root) } else { (root - approach_mps) / decel_mps2 }
}

/// The share of the duration after which a change by `shift_m` from rest (Eq. 14) has moved by `needed_m`.
pub(super) fn share_of_shift(needed_m: f64, shift_m: f64) -> f64 {
    let target = (needed_m / shift_m).clamp(0.0, 1.0);
    let (mut low, mut high) = (0.0, 1.0);
    // The middle of the bracket; 30 halvings leave 1e-9 of the duration.
    for _ in 0..30 {
        let x = 0.5 * (low + high);
        if x * x * x * (10.0 + x * (6.0 * x - 15.0)) < target {
            low = x;
        } else {
            high = x;
        }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_are_apart_after_half_of_the_change() {
        assert!((share_of_shift(2.1, 3.75) - 0.53).abs() < 0.005);
        assert!(share_of_shift(5.0, 3.75) > 0.999);
        assert!(share_of_shift(-0.5, 3.75) > 0.0);
    }

    #[test]
    fn the_time_to_close_solves_equation_15() {
        for (room, approach, decel) in [(25.0, 5.0, 2.0), (25.0, -5.0, 2.0), (0.0, -3.0, 2.0), (3.0, 0.0, 1.0)] {
            let t = time_to_close(room, approach, decel);
            assert!((approach * t + 0.5 * decel * t * t - room).abs() < 1e-9);
        }
        // A gap of 30 m, approached with 5 m/s by a car whose leader brakes with 2 and with 6 m/s².
        assert!((time_to_close(25.0, 5.0, 2.0) - 3.1).abs() < 0.05);
        assert!((time_to_close(25.0, 5.0, 6.0) - 2.2).abs() < 0.05);
        assert_eq!(time_to_close(-0.1, -5.0, 2.0), 0.0);
    }
}
