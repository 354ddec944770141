//! The one trace container: tests hash it, the player shows it, reports read it, `replay --check` runs it again.

use serde::{Deserialize, Serialize};

use super::environment::Env;
use crate::control::GuardCause;
use crate::plan::LaneChangePath;
use crate::road::Topology;

/// Version of the trace format.
pub const TRACE_SCHEMA: u32 = 2;

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
    /// Why the guard changed the command in this step, or called off the lane change.
    pub guard: Option<GuardCause>,
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

impl Env {
    /// The header of a trace that starts now. `scenario_seed` must be the seed this environment was made with.
    pub fn trace_header(&self, policy: &str, scenario_seed: u64) -> TraceHeader {
        let road = self.world.road().config();
        TraceHeader {
            schema: TRACE_SCHEMA,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            policy: policy.to_owned(),
            scenario_seed,
            config_toml: toml::to_string(&*self.config).expect("all sections are tables of plain values"),
            lanes: road.lanes,
            lane_width_m: road.lane_width_m,
            ring_length_m: if road.topology == Topology::Ring { road.length_m } else { 0.0 },
            ego_length_m: self.config.vehicle.length_m,
            ego_width_m: self.config.vehicle.width_m,
            control_period_s: self.config.env.control_period_s,
            decision_period_s: self.config.env.decision_period_s,
        }
    }

    pub(super) fn begin_record(&self, action: usize) -> TickRecord {
        TickRecord {
            action,
            action_name: self.actions().name(action),
            mask: self.mask.0,
            candidates: Vec::new(),
            path: None,
            score: 0.0,
            frames: Vec::with_capacity(self.periods.control_steps as usize),
        }
    }

    pub(super) fn frame(&self) -> Frame {
        let ego = &self.ego;
        let road = self.world.road();
        let vehicles = self.world.vehicles().map(|vehicle| VehicleFrame {
            id: vehicle.id.0,
            ahead_m: road.ahead_m(ego.s_m, vehicle.s_m),
            d_m: vehicle.d_m,
            speed_mps: vehicle.speed_mps,
            length_m: vehicle.length_m,
            width_m: vehicle.width_m,
        });
        Frame {
            time_s: self.episode.control_steps as f64 * self.config.env.control_period_s,
            ego: EgoFrame {
                s_m: self.driven_m,
                d_m: ego.d_m,
                heading_rad: ego.heading_rad,
                speed_mps: ego.speed_mps,
                sideslip_rad: self.sideslip_rad(),
                yaw_rate_radps: ego.yaw_rate_radps,
                accel_mps2: ego.accel_mps2,
                steer_rad: ego.steer_rad,
                guard: self.driver.guard_cause(),
            },
            vehicles: vehicles.collect(),
            digest: format!("{:016x}", self.digest()),
        }
    }

    /// Notes the path that the tick follows and, if it begins a lane change, the candidates it was chosen from.
    pub(super) fn record_path(&self, record: &mut TickRecord) {
        let Some(change) = self.driver.change() else { return };
        let path = self.driver.path();
        record.path = path.map(|(quintic, elapsed_s)| PathRecord {
            coefficients: quintic.coefficients,
            duration_s: quintic.duration_s,
            elapsed_s,
        });
        if let (0, false, Ok(window)) = (change.elapsed_steps, change.aborted, self.driver.offer(change.path.side)) {
            let candidates = self.driver.planner().candidates(self.driver.scene(), self.driver.forecast(), window);
            record.candidates = candidates.iter().map(|path| candidate_record(path, &change.path)).collect();
        }
    }
}

fn candidate_record(path: &LaneChangePath, chosen: &LaneChangePath) -> CandidateRecord {
    CandidateRecord {
        coefficients: path.quintic.coefficients,
        duration_s: path.quintic.duration_s,
        reward: path.reward,
        chosen: path.quintic == chosen.quintic,
    }
}
