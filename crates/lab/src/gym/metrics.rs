//! What is measured at each step, beside the reward.

use lanecraft_drive::decide::RewardTerms;
use lanecraft_drive::env::{Env, StepOutcome};

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

/// The measurements after a step, or after a reset if there was none.
pub(super) fn drive(env: &Env, step: Option<&StepOutcome>, action: usize, out: &mut [f64]) {
    let (ego, episode) = (env.ego(), env.episode());
    let terms = step.map_or_else(RewardTerms::default, |step| step.reward);
    let counts = env.driver().counts();
    let flag = |value: bool| f64::from(u8::from(value));
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
        flag(episode.collision.is_some()),
        flag(episode.collision.is_some_and(|collision| collision.fault.at_fault())),
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
