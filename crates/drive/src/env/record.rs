//! The one trace container: tests hash it, the player shows it, reports read it, `replay --check` runs it again.

use serde::{Deserialize, Serialize};

/// Version of the trace format.
pub const TRACE_SCHEMA: u32 = 1;

/// What a trace needs to be run again, and what a viewer needs to draw it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TraceHeader {
    /// [`TRACE_SCHEMA`] of the writer.
    pub schema: u32,
    /// Version of the software that wrote it.
    pub version: String,
    /// Who drove, for example `rule:best-lane` or `bootstrapped-dqn`.
    pub policy: String,
    /// Seed of the scenario.
    pub scenario_seed: u64,
    /// The resolved configuration of the environment, as TOML.
    pub config_toml: String,
    /// Number of lanes; lane 0 is the rightmost, centered at d = 0.
    pub lanes: u8,
    /// Lane width, m.
    pub lane_width_m: f64,
    /// Length of the ring, or 0 on an open road, m.
    pub ring_length_m: f64,
    /// Length of the ego car, m.
    pub ego_length_m: f64,
    /// Width of the ego car, m.
    pub ego_width_m: f64,
    /// Time between two frames, s.
    pub control_period_s: f64,
    /// Time between two decisions, s.
    pub decision_period_s: f64,
}

/// One tick: what was decided, and the control steps that followed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TickRecord {
    /// Index of the action in the action set.
    pub action: usize,
    /// The action in words, for example `accelerate q1=0.025` or `change left q2=0.001`.
    pub action_name: String,
    /// Which actions were allowed, bit i for action i.
    pub mask: u32,
    /// On the tick in which a lane change starts: the candidates that the planner weighed; else empty.
    pub candidates: Vec<CandidateRecord>,
    /// The path being followed during this tick, if any.
    pub path: Option<PathRecord>,
    /// Reward of the tick in the paper's units, its fixed scoring form.
    pub score: f64,
    /// One frame for each control step, after it.
    pub frames: Vec<Frame>,
}

/// A lane-change candidate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CandidateRecord {
    /// Coefficients of d(t) = Σ c_i tⁱ.
    pub coefficients: [f64; 6],
    /// Duration t_c, s.
    pub duration_s: f64,
    /// Learned reward (larger is more human-like).
    pub reward: f64,
    /// Whether it was chosen.
    pub chosen: bool,
}

/// A lane-change path in progress.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathRecord {
    /// Coefficients of d(t) = Σ c_i tⁱ.
    pub coefficients: [f64; 6],
    /// Duration t_c, s.
    pub duration_s: f64,
    /// Time since its start at the beginning of this tick, s.
    pub elapsed_s: f64,
}

/// The road and everybody on it at one instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Time since the start of the episode, s.
    pub time_s: f64,
    /// The ego car.
    pub ego: EgoFrame,
    /// The other vehicles by rising id.
    pub vehicles: Vec<VehicleFrame>,
    /// Digest of the whole state after this step, 16 hexadecimal digits.
    pub digest: String,
}

/// The ego car in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EgoFrame {
    /// Position along the road (not wrapped on a ring: distance driven since the start plus the start), m.
    pub s_m: f64,
    /// Lateral position, m.
    pub d_m: f64,
    /// Heading relative to the road, rad.
    pub heading_rad: f64,
    /// Speed, m/s.
    pub speed_mps: f64,
    /// Sideslip angle β, rad.
    pub sideslip_rad: f64,
    /// Yaw rate γ, rad/s.
    pub yaw_rate_radps: f64,
    /// Acceleration, m/s².
    pub accel_mps2: f64,
    /// Road-wheel angle, rad.
    pub steer_rad: f64,
    /// Whether the guard changed the command in this step.
    pub guarded: bool,
}

/// Another vehicle in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleFrame {
    /// Identity.
    pub id: u32,
    /// Distance ahead of the ego's center along the road, m (negative behind).
    pub ahead_m: f64,
    /// Lateral position, m.
    pub d_m: f64,
    /// Speed, m/s.
    pub speed_mps: f64,
    /// Length, m.
    pub length_m: f64,
    /// Width, m.
    pub width_m: f64,
}

/// A recorded episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trace {
    /// What it takes to run or draw it.
    pub header: TraceHeader,
    /// Its ticks in order.
    pub ticks: Vec<TickRecord>,
}
