//! The guard: the last check before the plant, at every control step.
//!
//! If the wanted command would break the safe distance to *any* vehicle ahead in an occupied lane, or laterally so
//! close that it may come into the way, the mildest braking that keeps it takes its place; if none does, full braking.
//! Looking at the nearest leader alone is not enough: a fast near one hides a standing far one of the other lane, and
//! two cars that swap lanes lose each other. Where the drive train has a delay, the step that counts is the one the
//! command acts in: until then the car does what it was sent, while every leader may already brake in full.

use serde::{Deserialize, Serialize};

use crate::control::config::{ControlConfig, Footing, has_one_grip};
use crate::control::delay::SentCommands;
use crate::control::worst_case::{Opening, closest_m};
use crate::models::rss::{Braking, safe_gap_m};
use crate::road::LaneIndex;
use crate::scene::{Neighbor, Scene};
use crate::vehicle::{ControlInput, VehicleParams, VehicleState, lag_response};

/// Why the guard changed a command, or called off a lane change: one cause for each such step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GuardCause {
    /// The command or the own state is NaN or infinite: full braking, steering held.
    NotFinite,
    /// The safe distance to a vehicle of the lane that the ego is in would have been broken.
    OwnLane,
    /// The same to a vehicle of a lane that the ego leaves or enters.
    OtherLane,
    /// The same to a vehicle of neither, but laterally so close that it may come into the way.
    Beside,
    /// The commanded acceleration was outside the actuators' limits.
    AccelLimit,
    /// The commanded road-wheel angle was outside the actuators' limits or out of their reach.
    SteerLimit,
    /// A lane change was called off: the safe distance to the leader of the new lane was broken.
    AbortLeader,
    /// A lane change was called off: the follower in the new lane had come too close.
    AbortFollower,
}

impl GuardCause {
    /// All causes, in the order of their discriminants.
    pub const ALL: [Self; 8] = [
        Self::NotFinite,
        Self::OwnLane,
        Self::OtherLane,
        Self::Beside,
        Self::AccelLimit,
        Self::SteerLimit,
        Self::AbortLeader,
        Self::AbortFollower,
    ];

    /// Whether the guard braked in place of the command.
    pub fn brakes(self) -> bool {
        matches!(self, Self::NotFinite | Self::OwnLane | Self::OtherLane | Self::Beside)
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::NotFinite => "not finite",
            Self::OwnLane => "leader, own lane",
            Self::OtherLane => "leader, other lane",
            Self::Beside => "vehicle beside",
            Self::AccelLimit => "limit of acceleration",
            Self::SteerLimit => "limit of steering",
            Self::AbortLeader => "abort for a leader",
            Self::AbortFollower => "abort for a follower",
        }
    }
}

/// Levels of braking, mildest first, m/s²; full braking comes after them.
const LEVELS_MPS2: [f64; 6] = [0.0, -1.0, -2.0, -3.0, -4.5, -6.0];
/// Vehicles further ahead than this cannot matter, m: above the safe distance at 60 m/s to a standing car.
const RANGE_M: f64 = 300.0;
/// Reaction time that a follower in the target lane is granted, s.
const FOLLOWER_REACTION_S: f64 = 0.1;
/// Braking that a follower in the target lane is granted, m/s².
const FOLLOWER_BRAKE_MPS2: f64 = 6.0;
/// Gap that must be left to a follower, m.
const FOLLOWER_MARGIN_M: f64 = 1.0;
/// By how much the safe distance in the target lane must be broken before a lane change is given up, m.
const ABORT_TOLERANCE_M: f64 = 3.0;

/// The guard of one car.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Guard {
    config: ControlConfig,
    params: VehicleParams,
    period_s: f64,
    drive_response: f64,
    steer_response: f64,
    sent: SentCommands,
}

/// The ego at a later instant.
#[derive(Clone, Copy)]
struct Next {
    travelled_m: f64,
    speed_mps: f64,
    accel_mps2: f64,
}

/// What one check is about.
struct Seen<'a> {
    scene: &'a Scene,
    lanes: [Option<LaneIndex>; 2],
    /// The ego when a command of now counts.
    begin: &'a Next,
    footing: &'a Footing,
}

impl Guard {
    /// A guard for this car; both must be valid. `control_period_s`: time between two calls of [`Self::check`].
    pub fn new(config: &ControlConfig, params: &VehicleParams, control_period_s: f64) -> Self {
        Self {
            config: config.clone(),
            params: params.clone(),
            period_s: control_period_s,
            drive_response: lag_response(params.drive_lag_s, control_period_s),
            steer_response: lag_response(params.steer_lag_s, control_period_s),
            sent: SentCommands::new(params.drive_delay_s, control_period_s),
        }
    }

    /// This command was sent; to be called once each control step where the drive train has a delay.
    pub fn sent(&mut self, input: ControlInput) {
        self.sent.push(input.accel_mps2);
    }

    /// The command to send, and why it is not `input`. `lanes`: those the ego is in, leaves or enters.
    ///
    /// With the guard switched off only the actuators' limits and finiteness are checked.
    pub fn check(
        &self,
        scene: &Scene,
        lanes: [Option<LaneIndex>; 2],
        input: ControlInput,
    ) -> (ControlInput, Option<GuardCause>) {
        let footing = self.config.braking_on(&scene.road, scene.ego.s_m, scene.ego.speed_mps);
        if !is_finite(&scene.ego) || !input.accel_mps2.is_finite() || !input.steer_rad.is_finite() {
            return (self.refused(scene, input, &footing), Some(GuardCause::NotFinite));
        }
        let limited = self.limited(scene, input);
        let limit = if limited.accel_mps2 == input.accel_mps2 {
            (limited.steer_rad != input.steer_rad).then_some(GuardCause::SteerLimit)
        } else {
            Some(GuardCause::AccelLimit)
        };
        if !self.config.guard {
            return (limited, limit);
        }
        let begin = self.past_delay(&scene.ego, &footing);
        let seen = Seen { scene, lanes, begin: &begin, footing: &footing };
        let Some(cause) = self.broken_by(&seen, limited.accel_mps2) else { return (limited, limit) };
        let accel_mps2 = self.mildest(&seen, limited.accel_mps2);
        (ControlInput { accel_mps2, ..limited }, Some(cause))
    }

    fn refused(&self, scene: &Scene, input: ControlInput, footing: &Footing) -> ControlInput {
        let held = [input.steer_rad, scene.ego.steer_rad].into_iter().find(|steer| steer.is_finite());
        let most = self.params.max_steer_rad;
        ControlInput {
            accel_mps2: -footing.tire_brake_mps2,
            steer_rad: held.map_or(0.0, |steer| steer.clamp(-most, most)),
        }
    }

    /// `input` within what the actuators can do in this step.
    fn limited(&self, scene: &Scene, input: ControlInput) -> ControlInput {
        let (p, steer) = (&self.params, scene.ego.steer_rad);
        let reach_rad = p.max_steer_rate_radps * (self.period_s / self.steer_response + p.steer_delay_s);
        ControlInput {
            accel_mps2: input.accel_mps2.clamp(-self.config.emergency_brake_mps2, p.max_accel_mps2),
            steer_rad: input
                .steer_rad
                .clamp(steer - reach_rad, steer + reach_rad)
                .clamp(-p.max_steer_rad, p.max_steer_rad),
        }
    }

    /// The mildest level below the wanted command that keeps every safe distance, or full braking.
    fn mildest(&self, seen: &Seen, wanted_mps2: f64) -> f64 {
        let full_mps2 = -seen.footing.tire_brake_mps2;
        for level in LEVELS_MPS2 {
            let command = self.towards(seen, level);
            let milder = command < wanted_mps2 && level > full_mps2;
            if milder && self.broken_by(seen, command).is_none() {
                return command;
            }
        }
        self.towards(seen, full_mps2)
    }

    /// The command that brings the acceleration to `level` as fast as the emergency jerk allows.
    fn towards(&self, seen: &Seen, level: f64) -> f64 {
        let change = self.config.emergency_jerk_mps3 * self.period_s;
        let now = seen.begin.accel_mps2;
        let next = level.clamp(now - change, now + change);
        (now + (next - now) / self.drive_response).clamp(-seen.footing.tire_brake_mps2, 0.0)
    }

    /// Where the first vehicle is to which the safe distance would be broken after this step.
    fn broken_by(&self, seen: &Seen, accel_mps2: f64) -> Option<GuardCause> {
        let next = self.next(seen.begin, accel_mps2, self.period_s, seen.footing);
        let scene = seen.scene;
        let place = |n: &Neighbor| {
            if n.occupies(scene.ego_lane) {
                Some(GuardCause::OwnLane)
            } else if seen.lanes.into_iter().flatten().any(|lane| n.occupies(lane)) {
                Some(GuardCause::OtherLane)
            } else {
                let close = (n.d_m - scene.ego.d_m).abs() < self.config.guard_lateral_m;
                close.then_some(GuardCause::Beside)
            }
        };
        let ahead = scene.neighbors.iter().filter(|n| n.ahead_m > 0.0 && n.ahead_m < RANGE_M || n.ahead_m.is_nan());
        ahead
            .filter_map(|n| place(n).map(|cause| (n, cause)))
            .find(|(n, _)| !self.keeps(&next, n, seen))
            .map(|(_, cause)| cause)
    }

    /// Where the commands on their way will have led when one of now counts.
    fn past_delay(&self, ego: &VehicleState, footing: &Footing) -> Next {
        let now = Next { travelled_m: 0.0, speed_mps: ego.road_speed_mps(), accel_mps2: ego.accel_mps2 };
        self.sent.under_way().fold(now, |next, (time_s, command)| self.next(&next, command, time_s, footing))
    }

    /// Where `time_s` under this command leads, the drive train's lag and the descent included.
    fn next(&self, from: &Next, accel_mps2: f64, time_s: f64, footing: &Footing) -> Next {
        let (v, a) = (from.speed_mps, from.accel_mps2);
        let lag_s = self.params.drive_lag_s;
        let response = lag_response(lag_s, time_s);
        let gained = (accel_mps2 + footing.descent_mps2) * time_s + (a - accel_mps2) * lag_s * response;
        let speed_mps = (v + gained).max(0.0);
        Next {
            travelled_m: from.travelled_m + 0.5 * (v + speed_mps) * time_s,
            speed_mps,
            accel_mps2: a + (accel_mps2 - a) * response,
        }
    }

    /// Whether the safe distance holds after this step even if the leader brakes in full during it. False for NaN.
    fn keeps(&self, next: &Next, leader: &Neighbor, seen: &Seen) -> bool {
        let Footing { braking, descent_mps2, .. } = seen.footing;
        let braking = &braking.behind(leader.accel_mps2);
        let time_s = self.sent.delay_s() + self.period_s;
        let leader_speed = leader.speed_mps.max(0.0);
        let leader_next = (leader_speed - braking.leader_brake_mps2 * time_s).max(0.0);
        let moving_s = time_s.min(leader_speed / braking.leader_brake_mps2);
        let leader_travelled_m = 0.5 * (leader_speed + leader_next) * moving_s;
        let gap_m = leader.gap_m(seen.scene.ego_length_m) + leader_travelled_m - next.travelled_m;
        let closed_form = gap_m >= safe_gap_m(next.speed_mps, next.accel_mps2 + descent_mps2, leader_next, braking);
        if closed_form || has_one_grip(&seen.scene.road) && *descent_mps2 == 0.0 {
            return closed_form;
        }
        let opening = Opening {
            s_m: seen.scene.ego.s_m + next.travelled_m,
            speed_mps: next.speed_mps,
            accel_mps2: next.accel_mps2,
            leader_speed_mps: leader_next,
            leader_brake_mps2: braking.leader_brake_mps2,
            gap_m,
        };
        closest_m(&self.config, &seen.scene.road, &opening) >= self.config.margin_m
    }

    /// What the safe distance assumes here: the drive train's delay adds to the reaction.
    pub fn braking(&self, scene: &Scene) -> Braking {
        let braking = self.config.braking_on(&scene.road, scene.ego.s_m, scene.ego.speed_mps).braking;
        Braking { reaction_s: braking.reaction_s + self.params.drive_delay_s, ..braking }
    }

    /// Why a lane change from `origin` to `target` should be given up, if it should: the target lane has become unsafe and
    /// the old lane is safe. Whether the car may still turn back is for the planner to say. Nothing is given up with the guard
    /// switched off.
    pub fn abort_advised(&self, scene: &Scene, origin: LaneIndex, target: LaneIndex) -> Option<GuardCause> {
        if !self.config.guard {
            return None;
        }
        let braking = self.braking(scene);
        let cause = danger(scene, target, -ABORT_TOLERANCE_M, &braking)?;
        danger(scene, origin, -self.config.margin_m, &braking).is_none().then_some(cause)
    }
}

/// Which gap in `lane` is not safe, if any, the front one with `extra_m` to spare.
fn danger(scene: &Scene, lane: LaneIndex, extra_m: f64, braking: &Braking) -> Option<GuardCause> {
    let (v, a) = (scene.ego.road_speed_mps(), scene.ego.accel_mps2);
    let front_is_safe = scene.leader(lane).is_none_or(|leader| {
        let safe_m = safe_gap_m(v, a, leader.speed_mps, &braking.behind(leader.accel_mps2));
        leader.gap_m(scene.ego_length_m) >= safe_m + extra_m
    });
    let rear_is_safe = scene.follower(lane).is_none_or(|follower| {
        let closing = (follower.speed_mps - v).max(0.0);
        let needed_m = FOLLOWER_REACTION_S * follower.speed_mps
            + closing * closing / (2.0 * FOLLOWER_BRAKE_MPS2)
            + FOLLOWER_MARGIN_M;
        follower.gap_m(scene.ego_length_m) >= needed_m
    });
    match (front_is_safe, rear_is_safe) {
        (false, _) => Some(GuardCause::AbortLeader),
        (true, false) => Some(GuardCause::AbortFollower),
        (true, true) => None,
    }
}

fn is_finite(state: &VehicleState) -> bool {
    let s = state;
    [s.s_m, s.d_m, s.heading_rad, s.speed_mps, s.lateral_speed_mps, s.yaw_rate_radps, s.steer_rad, s.accel_mps2]
        .iter()
        .all(|value| value.is_finite())
}
