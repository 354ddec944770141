//! Made-up but plausible data: no number here was measured.

use lanecraft_drive::control::GuardCause;
use lanecraft_drive::env::{
    CandidateRecord, EgoFrame, Frame, PathRecord, TRACE_SCHEMA, TickRecord, Trace, TraceHeader, VehicleFrame,
};

use crate::metrics::{CurvePoint, Interval, PolicyResult};
use crate::report::{Difference, IrlFeature, IrlSummary, MethodResult, ReportData, ScenarioSet};

const LANE_M: f64 = 3.75;
const TICK_S: f64 = 0.5;
const STEPS: u32 = 10;

fn around(mean: f64, half: f64) -> Interval {
    Interval { mean, low: mean - half, high: mean + half }
}

/// A policy with this reward per tick and this share of collisions in percent.
pub(super) fn result(policy: &str, reward: f64, collisions_percent: f64) -> PolicyResult {
    let rate = collisions_percent / 100.0;
    let rate_interval = Interval { mean: rate, low: 0.6 * rate, high: 1.5 * rate + 0.001 };
    PolicyResult {
        policy: policy.into(),
        episodes: 500,
        speed_mps: around(20.0 + 0.45 * reward, 0.12),
        reward_per_tick: around(reward, 0.21),
        collisions_per_episode: rate_interval,
        at_fault_collisions_per_episode: Interval { mean: 0.4 * rate, low: 0.2 * rate, high: 0.9 * rate + 0.001 },
        lane_changes_per_min: around(0.2 * reward, 0.08),
        min_time_to_collision_s: around(6.5 - 0.1 * collisions_percent, 0.3),
        refusals_per_min: around(0.9, 0.1),
        fallbacks_per_min: around(0.01, 0.005),
        guard_interventions_per_min: around(0.15, 0.03),
        guard_causes_per_min: [(GuardCause::OwnLane, around(0.12, 0.02)), (GuardCause::OtherLane, around(0.03, 0.01))]
            .into(),
        shield_interventions_per_min: around(0.3, 0.04),
        jerk_mps3: around(0.9 + 0.02 * reward, 0.02),
    }
}

fn curve(final_reward: f64, pace: f64) -> Vec<CurvePoint> {
    let point = |i: u32| {
        let x = f64::from(i);
        let learned = 1.0 - libm::exp(-x / pace);
        let wobble = libm::sin(1.7 * x) * 0.25 + libm::sin(4.3 * x + pace) * 0.2;
        CurvePoint {
            decisions: u64::from(i) * 4000,
            updates: u64::from(i) * 1000,
            reward_per_tick: 11.0 + (final_reward - 11.0) * learned + wobble,
            speed_mps: 24.0 + 4.5 * learned + 0.2 * wobble,
            collisions_per_episode: (0.3 * (1.0 - learned) + 0.012 + 0.01 * wobble).max(0.0),
            loss: 0.02 + 0.2 * (1.0 - learned) + 0.004 * wobble,
            agreement: 0.6 + 0.3 * learned,
            epsilon: (1.0 - 0.02 * x).max(0.02),
        }
    };
    (0..=60).map(point).collect()
}

/// Coefficients of the quintic from `from` to `to` at rest within `duration`.
fn quintic(from: f64, to: f64, duration: f64) -> [f64; 6] {
    let (shift, t) = (to - from, duration);
    let cube = t * t * t;
    [from, 0.0, 0.0, 10.0 * shift / cube, -15.0 * shift / (cube * t), 6.0 * shift / (cube * t * t)]
}

struct Change {
    start_s: f64,
    from_m: f64,
    to_m: f64,
    duration_s: f64,
}

const CHANGES: [Change; 2] = [
    Change { start_s: 8.0, from_m: LANE_M, to_m: 2.0 * LANE_M, duration_s: 4.2 },
    Change { start_s: 21.0, from_m: 2.0 * LANE_M, to_m: LANE_M, duration_s: 5.1 },
];

fn path_at(time_s: f64) -> Option<(&'static Change, f64)> {
    let active = |c: &&Change| (c.start_s..c.start_s + c.duration_s).contains(&time_s);
    CHANGES.iter().find(active).map(|c| (c, time_s - c.start_s))
}

/// Lateral position and its rate.
fn lateral(time_s: f64) -> (f64, f64) {
    let value = |c: [f64; 6], t: f64| c.iter().rev().fold(0.0, |sum, x| sum * t + x);
    if let Some((change, t)) = path_at(time_s) {
        let c = quintic(change.from_m, change.to_m, change.duration_s);
        return (value(c, t), (value(c, t + 1e-4) - value(c, t - 1e-4)) / 2e-4);
    }
    let last = CHANGES.iter().rev().find(|c| time_s >= c.start_s);
    (last.map_or(LANE_M, |c| c.to_m), 0.0)
}

fn speed(time_s: f64) -> f64 {
    let dip = |at: f64, width: f64| libm::exp(-((time_s - at) / width) * ((time_s - at) / width));
    30.0 - 3.4 * dip(6.5, 3.0) + 0.9 * dip(16.0, 4.0) - 0.8 * dip(24.0, 3.0)
}

fn vehicles(time_s: f64, ego_s_m: f64) -> Vec<VehicleFrame> {
    // Start ahead of the ego, lane, speed, length.
    const OTHERS: [(f64, f64, f64, f64); 15] = [
        (98.0, 1.0, 22.5, 4.6),
        (46.0, 0.0, 22.0, 12.0),
        (118.0, 0.0, 21.6, 13.6),
        (-78.0, 2.0, 30.5, 4.4),
        (64.0, 2.0, 31.4, 4.8),
        (188.0, 1.0, 25.5, 4.3),
        (230.0, 0.0, 22.4, 11.0),
        (-70.0, 1.0, 28.0, 4.7),
        (-52.0, 0.0, 24.5, 4.4),
        (292.0, 1.0, 26.0, 4.6),
        (318.0, 2.0, 28.8, 4.5),
        (345.0, 0.0, 22.0, 12.0),
        (405.0, 0.0, 23.0, 4.6),
        (-150.0, 2.0, 32.0, 4.9),
        (420.0, 1.0, 27.0, 4.2),
    ];
    let view = |(id, (start, lane, speed_mps, length_m)): (usize, &(f64, f64, f64, f64))| {
        // One car moves over to the right.
        let moved = if id == 8 { ((time_s - 12.0) / 4.0).clamp(0.0, 1.0) } else { 0.0 };
        VehicleFrame {
            id: id as u32 + 1,
            ahead_m: start + speed_mps * time_s - ego_s_m,
            d_m: LANE_M * (lane - moved * moved * (3.0 - 2.0 * moved)),
            speed_mps: speed_mps + 0.4 * libm::sin(0.5 * time_s + id as f64),
            length_m: *length_m,
            width_m: if *length_m > 7.0 { 2.5 } else { 1.85 },
        }
    };
    OTHERS.iter().enumerate().map(view).collect()
}

fn frame(time_s: f64, s_m: f64) -> Frame {
    let ((d_m, rate), v) = (lateral(time_s), speed(time_s));
    let heading = |t: f64| lateral(t).1 / speed(t);
    let yaw_rate_radps = (heading(time_s + 0.01) - heading(time_s - 0.01)) / 0.02;
    let ego = EgoFrame {
        s_m,
        d_m,
        heading_rad: libm::atan2(rate, v),
        speed_mps: v,
        sideslip_rad: 0.0,
        yaw_rate_radps,
        accel_mps2: (speed(time_s + 0.01) - speed(time_s - 0.01)) / 0.02,
        steer_rad: 2.6 * yaw_rate_radps / v * (1.0 + 0.002 * v * v),
        guard: (5.0..5.6).contains(&time_s).then_some(GuardCause::OwnLane),
    };
    Frame { time_s, ego, vehicles: vehicles(time_s, s_m), digest: "0000000000000000".into() }
}

fn candidates(change: &Change) -> Vec<CandidateRecord> {
    let candidate = |i: u32| {
        let duration_s = 2.4 + 0.3 * f64::from(i);
        CandidateRecord {
            coefficients: quintic(change.from_m, change.to_m, duration_s),
            duration_s,
            reward: -(duration_s - change.duration_s) * (duration_s - change.duration_s),
            chosen: (duration_s - change.duration_s).abs() < 0.15,
        }
    };
    (0..16).map(candidate).collect()
}

fn tick(index: u32, s_m: &mut f64) -> TickRecord {
    let start_s = TICK_S * f64::from(index);
    let path = path_at(start_s);
    let (starts, elapsed_s) = (path.is_some_and(|(_, t)| t == 0.0), path.map_or(0.0, |(_, t)| t));
    let accel = speed(start_s + 0.5) - speed(start_s);
    let action_name = match path {
        Some((c, _)) if starts => format!("change {} q2=0.001", if c.to_m > c.from_m { "left" } else { "right" }),
        Some(_) => "continue".into(),
        None if accel > 0.05 || index == 0 => "accelerate q1=0.025".into(),
        None if accel < -0.05 => "decelerate q1=0.01".into(),
        None => "keep speed q1=0.025".into(),
    };
    let frames = (1..=STEPS)
        .map(|step| {
            let time_s = start_s + 0.05 * f64::from(step);
            *s_m += 0.05 * speed(time_s);
            frame(time_s, *s_m)
        })
        .collect();
    TickRecord {
        action: index as usize % 7,
        action_name,
        mask: 0x7f,
        candidates: path.filter(|_| starts).map_or(vec![], |(c, _)| candidates(c)),
        path: path.map(|(c, _)| PathRecord {
            coefficients: quintic(c.from_m, c.to_m, c.duration_s),
            duration_s: c.duration_s,
            elapsed_s,
        }),
        score: 0.6 * speed(start_s),
        frames,
    }
}

fn trace() -> Trace {
    let mut s_m = 0.0;
    let header = TraceHeader {
        schema: TRACE_SCHEMA,
        version: "0.1.0".into(),
        policy: "bootstrapped-dqn".into(),
        scenario_seed: 17,
        config_toml: String::new(),
        lanes: 3,
        lane_width_m: LANE_M,
        ring_length_m: 0.0,
        ego_length_m: 4.6,
        ego_width_m: 1.9,
        control_period_s: 0.05,
        decision_period_s: TICK_S,
    };
    Trace { header, ticks: (0..64).map(|i| tick(i, &mut s_m)).collect() }
}

fn irl() -> IrlSummary {
    let feature = |name: &str, weight: f64, half: f64, errors: [f64; 2]| IrlFeature {
        name: name.into(),
        weight,
        interval: (half > 0.0).then(|| around(weight, half)),
        ratio_of_means_error: around(errors[0], 0.02),
        mean_absolute_error: around(errors[1], 0.03),
    };
    IrlSummary {
        source: "50 synthetic drivers, 10 held out".into(),
        features: vec![
            feature("collision risk", -1.84, 0.42, [0.069, 0.140]),
            feature("lateral comfort", -0.62, 0.18, [0.029, 0.056]),
            feature("efficiency", 0.95, 0.35, [0.061, 0.119]),
            feature("stability", -0.14, 0.31, [0.008, 0.051]),
        ],
        log_likelihood: -2.58,
        uniform_log_likelihood: -3.15,
        duration_density_log_likelihood: -2.71,
        duration_errors_s: [0.28, 0.41],
        figures: Vec::new(),
    }
}

/// A report with everything in it.
pub(super) fn full() -> ReportData {
    let strings = |pairs: &[(&str, &str)]| pairs.iter().map(|(a, b)| ((*a).into(), (*b).into())).collect();
    ReportData {
        title: "Integrated decisions drive faster than rules at the same risk".into(),
        summary: vec![],
        sets: vec![set(vec![
            result("bootstrapped-dqn", 18.3, 1.4),
            result("double-dqn", 18.1, 1.6),
            result("dqn", 17.2, 3.8),
            result("rule:best-lane", 17.6, 0.8),
            result("rule:keep-lane", 13.9, 0.2),
            result("random", 9.8, 21.0),
        ])],
        curves: vec![
            ("bootstrapped-dqn".into(), curve(18.3, 9.0)),
            ("double-dqn".into(), curve(18.0, 12.0)),
            ("dqn".into(), curve(17.1, 15.0)),
        ],
        irl: Some(irl()),
        trace: Some(trace()),
        time_shares: [
            ("training", 812.0),
            ("evaluation", 240.5),
            ("inverse reinforcement learning", 31.2),
            ("data", 4.1),
        ]
        .map(|(name, s)| (name.into(), s))
        .into(),
        config_toml: "[environment]\nlanes = 3\nlane_width_m = 3.75\n\n[learner]\nheads = 6\ndiscount = 0.98\n".into(),
        seeds: strings(&[("training", "1, 2, 3, 4, 5"), ("scenarios", "100000 to 100499")]),
        statements: vec![
            "The best rule has fewer collisions; its interval overlaps that of the learned policies.".into(),
            "Collisions are counted with the shield on, as trained.".into(),
        ],
    }
}

/// The only set of scenarios.
pub(super) fn set(results: Vec<PolicyResult>) -> ScenarioSet {
    ScenarioSet { results, ..ScenarioSet::default() }
}

/// Two methods of three seeds, and a rule.
pub(super) fn pooled() -> ReportData {
    let method = |name: &str, reward: f64| {
        let rate = result(name, reward, 2.0);
        let share = |i: u32| (f64::from(i), around(1.0 - f64::from(i) / 25.0, 0.04));
        MethodResult {
            name: name.into(),
            runs: ["0", "1", "2"].map(|seed| format!("{name}-{seed}")).into(),
            episodes: 600,
            speed_mps: rate.speed_mps,
            reward_per_tick: rate.reward_per_tick,
            reward_interquartile_mean: rate.reward_per_tick,
            collisions_per_episode: rate.collisions_per_episode,
            at_fault_collisions_per_episode: rate.at_fault_collisions_per_episode,
            collisions_per_1000_km: around(12.0, 3.0),
            at_fault_collisions_per_1000_km: around(4.0, 2.0),
            collisions_by_seed: vec![0.01, 0.03, 0.02],
            profile: (0..=25).map(share).collect(),
        }
    };
    let difference = |other: &str| Difference {
        method: "dqn".into(),
        other: other.into(),
        unit: "same seeds, paired".into(),
        speed_mps: around(0.2, 0.1),
        collisions_per_episode: around(-0.01, 0.02),
        at_fault_collisions_per_episode: around(0.0, 0.01),
        reward_per_tick: around(0.3, 0.4),
    };
    let set = ScenarioSet {
        methods: vec![method("dqn", 17.0), method("double-dqn", 18.0)],
        differences: vec![difference("double-dqn"), difference("rule:best-lane")],
        improvement: vec![vec![around(0.5, 0.2), around(0.2, 0.2)], vec![around(0.8, 0.2), around(0.5, 0.2)]],
        ..set(vec![result("dqn-0", 17.0, 2.0), result("rule:best-lane", 17.6, 0.8)])
    };
    ReportData { title: "Two methods".into(), sets: vec![set], ..ReportData::default() }
}
