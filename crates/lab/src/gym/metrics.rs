//! What is measured at each step, beside the reward.

use lanecraft_drive::decide::RewardTerms;
use lanecraft_drive::env::{Env, StepOutcome};
use lanecraft_drive::kinematic::KinematicEnv;
use lanecraft_drive::traffic::Collision;

/// What kind of number a measurement is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MetricKind {
    /// A real number.
    Float,
    /// A whole number.
    Count,
    /// 0 or 1.
    Flag,
}

/// A measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Metric {
    /// Its name, with the unit.
    pub name: &'static str,
    /// Its kind.
    pub kind: MetricKind,
}

const fn metric(name: &'static str, kind: MetricKind) -> Metric {
    Metric { name, kind }
}

use MetricKind::{Count, Flag, Float};

/// Of the whole loop, in the order of [`drive`].
pub(super) const DRIVE: &[Metric] = &[
    metric("time_s", Float),
    metric("speed_mps", Float),
    metric("accel_mps2", Float),
    metric("d_m", Float),
    metric("lane", Count),
    metric("driven_m", Float),
    metric("min_time_to_collision_s", Float),
    metric("score", Float),
    metric("reward_speed", Float),
    metric("reward_collision", Float),
    metric("reward_lane", Float),
    metric("reward_jerk", Float),
    metric("reward_control_quality", Float),
    metric("reward_penalty", Float),
    metric("collided", Flag),
    metric("at_fault", Flag),
    metric("lane_changes", Count),
    metric("aborts", Count),
    metric("refusals", Count),
    metric("fallbacks", Count),
    metric("guard_interventions", Count),
    metric("shield_interventions", Count),
    metric("decision_due", Flag),
    metric("action", Count),
];

/// Of the fast environment, in the order of [`kinematic`].
pub(super) const KINEMATIC: &[Metric] = &[
    metric("time_s", Float),
    metric("speed_mps", Float),
    metric("lane", Count),
    metric("collided", Flag),
    metric("at_fault", Flag),
    metric("action", Count),
];

/// The measurements of the fast environment.
pub(super) fn kinematic(env: &KinematicEnv, action: usize, out: &mut [f64]) {
    let ego = env.ego();
    let lane = env.world().road().nearest_lane(ego.d_m);
    let (collided, at_fault) = ends(env.collision());
    out.copy_from_slice(&[env.time_s(), ego.speed_mps, f64::from(lane.0), collided, at_fault, action as f64]);
}

/// Whether there was a collision, and whether it was the ego's fault.
fn ends(collision: Option<Collision>) -> (f64, f64) {
    (flag(collision.is_some()), flag(collision.is_some_and(|collision| collision.fault.at_fault())))
}

fn flag(value: bool) -> f64 {
    f64::from(u8::from(value))
}

/// The measurements after a step, or after a reset if there was none.
pub(super) fn drive(env: &Env, step: Option<&StepOutcome>, action: usize, out: &mut [f64]) {
    let (ego, episode) = (env.ego(), env.episode());
    let terms = step.map_or_else(RewardTerms::default, |step| step.reward);
    let counts = env.driver().counts();
    let (collided, at_fault) = ends(episode.collision);
    out.copy_from_slice(&[
        episode.control_steps as f64 * env.config().env.control_period_s,
        ego.speed_mps,
        ego.accel_mps2,
        ego.d_m,
        f64::from(env.scene().ego_lane.0),
        env.driven_m(),
        episode.min_time_to_collision_s,
        step.map_or(0.0, |step| step.score),
        terms.speed,
        terms.collision,
        terms.lane,
        terms.jerk,
        terms.control_quality,
        terms.penalty,
        collided,
        at_fault,
        f64::from(counts.lane_changes),
        f64::from(counts.aborts),
        f64::from(counts.refusals),
        f64::from(counts.fallbacks.iter().sum::<u32>()),
        f64::from(counts.guard_interventions()),
        f64::from(counts.shield),
        flag(env.decision_due()),
        action as f64,
    ]);
}
