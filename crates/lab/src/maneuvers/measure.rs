//! What is measured in a drive, and the checks on it.

use lanecraft_drive::vehicle::tire::{slip_angles_rad, slip_limits_rad};
use serde::Serialize;

use super::runner::{PERIOD_S, Run, Sample};

/// Slip angles mean nothing below this speed, m/s.
const SLIP_SPEED_MIN_MPS: f64 = 3.0;
/// A car is settled while it is this close to its reference, m.
const SETTLED_M: f64 = 0.1;

/// Points of the body's sides that are held against cones, as shares of half its length and width.
const SIDE_POINTS: [(f64, f64); 10] = [
    (-1.0, -1.0),
    (-0.5, -1.0),
    (0.0, -1.0),
    (0.5, -1.0),
    (1.0, -1.0),
    (-1.0, 1.0),
    (-0.5, 1.0),
    (0.0, 1.0),
    (0.5, 1.0),
    (1.0, 1.0),
];

/// A lane of cones: the whole body must pass between them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Gate {
    /// From here, m.
    pub from_s_m: f64,
    /// To here, m.
    pub to_s_m: f64,
    /// Middle, m.
    pub d_m: f64,
    /// Width, m.
    pub width_m: f64,
}

/// A figure of a drive.
#[derive(Clone, Debug, PartialEq)]
pub enum Measure {
    /// Smallest free distance to any car, m; negative after a collision.
    Clearance,
    /// Largest distance from the reference, m.
    LaneError,
    /// Root mean square distance from the reference, m.
    LaneErrorRms,
    /// Distance from the reference at the end, m.
    FinalLaneError,
    /// Time after the last leg (or the start) until the car stays within 0.1 m of its reference, s.
    SettleTime,
    /// Largest sideslip angle, degrees.
    Sideslip,
    /// Largest slip angle over the limit of Eq. 26 on either axle.
    SlipUse,
    /// Largest lateral acceleration V γ, m/s².
    LateralAccel,
    /// Hardest braking, m/s².
    Braking,
    /// Largest jerk, m/s³.
    Jerk,
    /// Distance to the car ahead at the end, m.
    FinalGap,
    /// Smallest distance to the car ahead, m.
    SmallestGap,
    /// Speed at the end, m/s.
    FinalSpeed,
    /// Highest speed, m/s.
    HighestSpeed,
    /// Control steps in which the guard braked.
    GuardSteps,
    /// Control steps in which a controller fell back.
    FallbackSteps,
    /// Yaw rate this long after open-loop steering ended over its peak since steering turned back, percent.
    YawRateLeft(f64),
    /// Lateral movement 1.07 s after open-loop steering began, m.
    SineDisplacement,
    /// Yaw rate at the end over that of the linear model in steady cornering.
    YawGainRatio,
    /// Time from the steering step until 90 % of the last yaw rate, s.
    YawRiseTime,
    /// Overshoot of the yaw rate over its last value, percent.
    YawOvershoot,
    /// Smallest distance of the body from the cones, m; negative if it touches them.
    ConeClearance(Vec<Gate>),
}

impl Measure {
    /// Its unit.
    pub fn unit(&self) -> &'static str {
        match self {
            Self::Clearance
            | Self::LaneError
            | Self::LaneErrorRms
            | Self::FinalLaneError
            | Self::FinalGap
            | Self::SmallestGap
            | Self::SineDisplacement
            | Self::ConeClearance(_) => "m",
            Self::SettleTime | Self::YawRiseTime => "s",
            Self::Sideslip => "deg",
            Self::SlipUse | Self::YawGainRatio => "",
            Self::LateralAccel | Self::Braking => "m/s²",
            Self::Jerk => "m/s³",
            Self::FinalSpeed | Self::HighestSpeed => "m/s",
            Self::GuardSteps | Self::FallbackSteps => "steps",
            Self::YawRateLeft(_) | Self::YawOvershoot => "%",
        }
    }

    /// The figure; NaN if the drive has none.
    pub fn of(&self, run: &Run) -> f64 {
        let largest = |figure: &dyn Fn(&Sample) -> f64| run.samples.iter().map(figure).fold(0.0, worse);
        let last = run.samples.last();
        let end = |figure: &dyn Fn(&Sample) -> f64| last.map_or(f64::NAN, figure);
        match self {
            Self::Clearance => run.samples.iter().map(|s| s.clearance_m).fold(f64::INFINITY, f64::min),
            Self::LaneError => largest(&lane_error),
            Self::LaneErrorRms => {
                let sum: f64 = run.samples.iter().map(|s| lane_error(s) * lane_error(s)).sum();
                (sum / run.samples.len() as f64).sqrt()
            }
            Self::FinalLaneError => end(&lane_error),
            Self::SettleTime => settle_time_s(run),
            Self::Sideslip => largest(&|s| sideslip_rad(s).abs().to_degrees()),
            Self::SlipUse => largest(&|s| slip_use(run, s)),
            Self::LateralAccel => largest(&|s| (s.ego.speed_mps * s.ego.yaw_rate_radps).abs()),
            Self::Braking => largest(&|s| -s.ego.accel_mps2),
            Self::Jerk => largest(&|s| s.jerk_mps3.abs()),
            Self::FinalGap => end(&|s| s.gap_m),
            Self::SmallestGap => run.samples.iter().map(|s| s.gap_m).fold(f64::INFINITY, f64::min),
            Self::FinalSpeed => end(&|s| s.ego.speed_mps),
            Self::HighestSpeed => largest(&|s| s.ego.speed_mps),
            Self::GuardSteps => run.samples.iter().filter(|s| s.guarded).count() as f64,
            Self::FallbackSteps => run.samples.iter().filter(|s| s.fallback).count() as f64,
            Self::YawRateLeft(after_s) => yaw_rate_left(run, *after_s),
            Self::SineDisplacement => at(run, run.steer_begin_s + 1.07).map_or(f64::NAN, |s| s.ego.d_m.abs()),
            Self::YawGainRatio => yaw_gain_ratio(run),
            Self::YawRiseTime => yaw_rise_time_s(run),
            Self::YawOvershoot => {
                let settled = end(&|s| s.ego.yaw_rate_radps.abs());
                100.0 * (largest(&|s| s.ego.yaw_rate_radps.abs()) / settled - 1.0)
            }
            Self::ConeClearance(gates) => cone_clearance_m(run, gates),
        }
    }
}

/// The larger one, NaN if either is.
fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}

fn lane_error(s: &Sample) -> f64 {
    (s.ego.d_m - s.reference_d_m).abs()
}

/// β, rad; 0 below walking pace.
pub(crate) fn sideslip_rad(s: &Sample) -> f64 {
    if s.ego.speed_mps < SLIP_SPEED_MIN_MPS { 0.0 } else { libm::atan(s.ego.lateral_speed_mps / s.ego.speed_mps) }
}

/// The larger slip use of the two axles.
pub(crate) fn slip_use(run: &Run, s: &Sample) -> f64 {
    if s.ego.speed_mps < SLIP_SPEED_MIN_MPS {
        return 0.0;
    }
    let ego = &s.ego;
    let (front, rear) =
        slip_angles_rad(&run.plant, ego.speed_mps, ego.lateral_speed_mps, ego.yaw_rate_radps, ego.steer_rad);
    let (front_limit, rear_limit) = slip_limits_rad(&run.plant, run.road.adhesion_at(ego.s_m));
    (front.abs() / front_limit).max(rear.abs() / rear_limit)
}

fn settle_time_s(run: &Run) -> f64 {
    let settled = |s: &Sample| lane_error(s) <= SETTLED_M;
    let Some(last_out) = run.samples.iter().rposition(|s| !settled(s)) else { return 0.0 };
    if last_out + 1 == run.samples.len() {
        return f64::INFINITY;
    }
    (run.samples[last_out].time_s - run.legs_end_s).max(0.0)
}

/// The sample at `time_s`.
fn at(run: &Run, time_s: f64) -> Option<&Sample> {
    run.samples.get(((time_s / PERIOD_S).round() as usize).checked_sub(1)?)
}

fn yaw_rate_left(run: &Run, after_s: f64) -> f64 {
    let half_s = f64::midpoint(run.steer_begin_s, run.steer_end_s);
    let peak = run.samples.iter().filter(|s| s.time_s >= half_s).map(|s| s.ego.yaw_rate_radps.abs()).fold(0.0, worse);
    at(run, run.steer_end_s + after_s).map_or(f64::NAN, |s| 100.0 * s.ego.yaw_rate_radps.abs() / peak)
}

fn yaw_gain_ratio(run: &Run) -> f64 {
    let Some(last) = run.samples.last() else { return f64::NAN };
    let speed_mps = last.ego.speed_mps;
    // Steering that a curvature of 1 rad/m needs, by the linear model.
    let steer = lanecraft_drive::vehicle::bicycle::steady_steer_rad(&run.plant, speed_mps, 1.0);
    last.ego.yaw_rate_radps / (speed_mps * run.steer_peak_rad / steer)
}

fn yaw_rise_time_s(run: &Run) -> f64 {
    let settled = run.samples.last().map_or(f64::NAN, |s| s.ego.yaw_rate_radps.abs());
    let risen = run.samples.iter().find(|s| s.ego.yaw_rate_radps.abs() >= 0.9 * settled);
    risen.map_or(f64::NAN, |s| s.time_s - run.steer_begin_s)
}

/// Points along both sides against the gates that they pass.
fn cone_clearance_m(run: &Run, gates: &[Gate]) -> f64 {
    let (half_length, half_width) = (0.5 * run.plant.length_m, 0.5 * run.plant.width_m);
    let mut least = f64::INFINITY;
    for s in &run.samples {
        let (sin, cos) = libm::sincos(s.ego.heading_rad);
        for (share, side) in SIDE_POINTS {
            let (x, y) = (share * half_length, side * half_width);
            let (at_m, d_m) = (s.ego.s_m + x * cos - y * sin, s.ego.d_m + x * sin + y * cos);
            for gate in gates.iter().filter(|gate| (gate.from_s_m..=gate.to_s_m).contains(&at_m)) {
                least = least.min(0.5 * gate.width_m - (d_m - gate.d_m).abs());
            }
        }
    }
    least
}

/// A named bound on a figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// What is asked.
    pub name: &'static str,
    /// The figure.
    pub measure: Measure,
    /// Least value allowed.
    pub low: f64,
    /// Largest value allowed.
    pub high: f64,
    /// Why a bound of the literature is not met; empty if it must be.
    pub shortfall: &'static str,
}

impl Check {
    /// The figure must not be above `high`.
    pub fn at_most(name: &'static str, measure: Measure, high: f64) -> Self {
        Self { name, measure, low: f64::NEG_INFINITY, high, shortfall: "" }
    }

    /// The figure must not be below `low`.
    pub fn at_least(name: &'static str, measure: Measure, low: f64) -> Self {
        Self { name, measure, low, high: f64::INFINITY, shortfall: "" }
    }

    /// The figure must be between the two.
    pub fn between(name: &'static str, measure: Measure, low: f64, high: f64) -> Self {
        Self { name, measure, low, high, shortfall: "" }
    }

    /// States that the bound is not met, and why.
    #[must_use]
    pub fn falls_short(mut self, why: &'static str) -> Self {
        self.shortfall = why;
        self
    }

    /// Compares.
    pub fn verdict(&self, run: &Run) -> Verdict {
        let measured = self.measure.of(run);
        Verdict {
            check: self.name,
            measured,
            low: self.low,
            high: self.high,
            unit: self.measure.unit(),
            passed: measured >= self.low && measured <= self.high,
            shortfall: self.shortfall,
        }
    }
}

/// A check's outcome.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// What was asked.
    pub check: &'static str,
    /// What was measured; not finite figures are `null` in JSON.
    pub measured: f64,
    /// Least value allowed.
    pub low: f64,
    /// Largest value allowed.
    pub high: f64,
    /// Unit of the three.
    pub unit: &'static str,
    /// Whether it holds.
    pub passed: bool,
    /// Why it is known not to hold; empty if it must.
    pub shortfall: &'static str,
}
