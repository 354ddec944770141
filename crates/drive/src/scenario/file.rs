//! The scenario file: what stands in the TOML text.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::draw::Draw;
use super::{
    Event, Party, Ranges, RecordedTraffic, Recording, Scenario, ScenarioDistribution, ScenarioError, TrafficConfig,
    VehicleKind, check_lane, ranges, script,
};
use crate::config::check_range;
use crate::road::{LaneIndex, Road, RoadConfig, Topology};

/// A vehicle written into a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VehicleStart {
    /// Name by which events address it; empty if none does.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// Lane, from the right, starting at 0.
    pub lane: LaneIndex,
    /// Position of its center, m.
    pub s_m: f64,
    /// Speed, m/s.
    pub speed_mps: f64,
    /// Desired speed v₀ of its driver, m/s.
    pub desired_speed_mps: f64,
    /// Car or truck.
    pub kind: VehicleKind,
}

/// Where the ego starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum EgoStart {
    /// In the middle of the largest gap of a random lane, at the speed of the vehicle ahead.
    #[default]
    LargestGap,
    /// Where it is written.
    At {
        /// Lane, from the right, starting at 0.
        lane: LaneIndex,
        /// Position of its center, m.
        s_m: f64,
        /// Speed, m/s.
        speed_mps: f64,
    },
}

/// Vehicles that enter an open road one after another, with drivers drawn from `traffic`.
///
/// They arrive at random times (a Poisson process). Who would arrive too near to the vehicle ahead waits outside, and enters
/// as soon as the distance is safe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Flow {
    /// Lane, from the right, starting at 0.
    pub lane: LaneIndex,
    /// Mean number of vehicles that arrive in an hour, 1/h.
    pub inflow_veh_per_h: f64,
    /// Where they enter, m.
    #[serde(default)]
    pub enter_s_m: f64,
}

/// A scene as a file. Vehicles come from `vehicles`, or from a recording, or else are drawn from `traffic` at its density;
/// `flows` let more of them enter later.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScenarioFile {
    /// Short name.
    pub name: String,
    /// What happens, in a sentence or two.
    pub description: String,
    /// How long to drive in it, s.
    #[serde(default = "default_duration_s")]
    pub duration_s: f64,
    /// The road.
    #[serde(default)]
    pub road: RoadConfig,
    /// The drivers.
    #[serde(default)]
    pub traffic: TrafficConfig,
    /// The ego's start.
    #[serde(default)]
    pub ego: EgoStart,
    /// Numbers of `road` and `traffic` that each seed draws anew: for example
    /// `traffic.truck_share = [0.0, 0.2]` from 0 to 20 %.
    #[serde(default, skip_serializing_if = "Ranges::is_empty")]
    pub ranges: Ranges,
    /// Recorded vehicles instead of drawn ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<RecordedTraffic>,
    /// Written vehicles instead of drawn ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub vehicles: Vec<VehicleStart>,
    /// Vehicles that enter later.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub flows: Vec<Flow>,
    /// What written vehicles do apart from driving on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<Event>,
}

fn default_duration_s() -> f64 {
    60.0
}

impl Default for ScenarioFile {
    /// Traffic drawn from the defaults.
    fn default() -> Self {
        Self {
            name: "default".to_owned(),
            description: String::new(),
            duration_s: default_duration_s(),
            road: RoadConfig::default(),
            traffic: TrafficConfig::default(),
            ego: EgoStart::default(),
            ranges: Ranges::new(),
            recording: None,
            vehicles: Vec::new(),
            flows: Vec::new(),
            events: Vec::new(),
        }
    }
}

impl ScenarioFile {
    /// Reads a file's text; unknown keys are errors.
    pub fn from_toml(text: &str) -> Result<Self, ScenarioError> {
        let file: Self = toml::from_str(text).map_err(ScenarioError::Parse)?;
        file.validate()?;
        Ok(file)
    }

    /// Checks every range, and that events and flows name vehicles and lanes that exist.
    pub fn validate(&self) -> Result<(), ScenarioError> {
        check_range("duration_s", self.duration_s, 1.0, 3600.0)?;
        self.road.validate()?;
        self.traffic.validate()?;
        ranges::check(&self.ranges, &self.road, &self.traffic)?;
        script::check(&self.events, &self.vehicles, self.road.lanes)?;
        if let Some(recording) = &self.recording {
            recording.validate()?;
            let others = [("vehicles", self.vehicles.is_empty()), ("flows", self.flows.is_empty())];
            if let Some((key, _)) = others.into_iter().find(|(_, absent)| !absent) {
                return Err(ScenarioError::BesideRecording { key });
            }
        }
        self.check_flows()
    }

    fn check_flows(&self) -> Result<(), ScenarioError> {
        if !self.flows.is_empty() && self.road.topology == Topology::Ring {
            return Err(ScenarioError::FlowOnRing);
        }
        let road = Road::new(self.road.clone())?;
        for (index, flow) in self.flows.iter().enumerate() {
            check_lane(&road, flow.lane, Party::Flow(index as u32))?;
            let in_flow = |source| ScenarioError::Flow { index, source };
            check_range("flows.inflow_veh_per_h", flow.inflow_veh_per_h, 1.0, 3600.0).map_err(in_flow)?;
            check_range("flows.enter_s_m", flow.enter_s_m, 0.0, self.road.length_m).map_err(in_flow)?;
        }
        Ok(())
    }

    /// The scene with everything that is random drawn from `seed`.
    ///
    /// # Errors
    /// If it cannot be, or if it needs a recording: then [`Self::scenario_with`] is given one.
    pub fn scenario(&self, seed: u64) -> Result<Scenario, ScenarioError> {
        self.build(None, seed)
    }

    /// The scene around the ego in this recording, whose positions are those of the road.
    pub fn scenario_with(&self, recording: Arc<Recording>, seed: u64) -> Result<Scenario, ScenarioError> {
        self.build(Some(recording), seed)
    }

    fn build(&self, recording: Option<Arc<Recording>>, seed: u64) -> Result<Scenario, ScenarioError> {
        self.validate()?;
        let (road, traffic) = ranges::draw(&self.ranges, &self.road, &self.traffic, seed)?;
        let recording = match (&self.recording, recording) {
            (Some(config), None) => return Err(ScenarioError::NoRecording { file: config.file.clone() }),
            (Some(config), Some(recording)) => Some((recording, config.reactive)),
            (None, _) => None,
        };
        let scene = self.vehicles_at_start(road, traffic, recording.is_some(), seed)?;
        let script = script::resolve(&self.events, &self.vehicles);
        Ok(Scenario { ego: self.ego, script, flows: self.flows.clone(), recording, ..scene })
    }

    fn vehicles_at_start(
        &self,
        road: RoadConfig,
        traffic: TrafficConfig,
        recorded: bool,
        seed: u64,
    ) -> Result<Scenario, ScenarioError> {
        if self.vehicles.is_empty() && !recorded {
            return ScenarioDistribution { road, traffic }.sample(seed);
        }
        let road = Arc::new(Road::new(road)?);
        let draw = Draw { traffic: &traffic, road: &road, seed };
        let vehicles = self.vehicles.iter().enumerate().map(|(id, start)| draw.written(id, start)).collect();
        Ok(Scenario::of_vehicles(road, traffic, vehicles, self.ego, seed))
    }
}
