//! The environment's configuration: one section for each module.

use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_range, whole_multiple};
use crate::control::ControlConfig;
use crate::decide::{ActionsConfig, ObservationConfig, RewardConfig, ShieldConfig};
use crate::perceive::PerceptionConfig;
use crate::plan::PlannerConfig;
use crate::predict::PredictionConfig;
use crate::road::RoadConfig;
use crate::scenario::{ScenarioError, ScenarioFile, TrafficConfig};
use crate::vehicle::{PlantConfig, VehicleParams};

/// In which order decision and plan are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Order {
    /// Both sides are planned before the decision, and the planner's veto is the action mask.
    PlanFirst,
    /// The paper's literal order: a lane change without a path becomes lane keeping, and is counted.
    DecideFirst,
}

/// Periods and length of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EnvConfig {
    /// Time between two decisions, the tick, s. The paper gives none; below 0.5 s a discount of 0.95 looks ahead no further than a
    /// lane change lasts.
    pub decision_period_s: f64,
    /// Time between two control steps, s: the sampling behind Table IV.
    pub control_period_s: f64,
    /// Integration step of the plant, s.
    pub plant_period_s: f64,
    /// Length of an episode, s.
    pub episode_s: f64,
    /// Order of decision and plan.
    pub order: Order,
    /// Text of a scenario file, whose road and traffic then stand for the sections `road` and `traffic`; empty: those.
    pub scenario: String,
}

impl Default for EnvConfig {
    fn default() -> Self {
        Self {
            decision_period_s: 0.5,
            control_period_s: 0.05,
            plant_period_s: 0.01,
            episode_s: 40.0,
            order: Order::PlanFirst,
            scenario: String::new(),
        }
    }
}

/// How often one period fits into the one above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Periods {
    /// Plant steps in a control step.
    pub plant_steps: u32,
    /// Control steps in a tick.
    pub control_steps: u32,
    /// Ticks in an episode.
    pub ticks: u32,
}

impl EnvConfig {
    /// The scenario file, if there is one.
    pub fn scenario_file(&self) -> Result<Option<ScenarioFile>, ConfigError> {
        if self.scenario.is_empty() {
            return Ok(None);
        }
        let bad = |error: ScenarioError| ConfigError::BadScenario { key: "env.scenario", message: error.to_string() };
        ScenarioFile::from_toml(&self.scenario).map(Some).map_err(bad)
    }

    /// Checks every range and that each period is a whole multiple of the one below.
    pub fn periods(&self) -> Result<Periods, ConfigError> {
        check_range("env.plant_period_s", self.plant_period_s, 0.001, 0.05)?;
        check_range("env.control_period_s", self.control_period_s, 0.01, 0.2)?;
        check_range("env.decision_period_s", self.decision_period_s, 0.05, 5.0)?;
        check_range("env.episode_s", self.episode_s, 1.0, 1e5)?;
        let plant = ("env.plant_period_s", self.plant_period_s);
        let control = ("env.control_period_s", self.control_period_s);
        let decision = ("env.decision_period_s", self.decision_period_s);
        Ok(Periods {
            plant_steps: whole_multiple(control, plant)?,
            control_steps: whole_multiple(decision, control)?,
            ticks: whole_multiple(("env.episode_s", self.episode_s), decision)?,
        })
    }
}

/// The whole environment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Periods, episode, order.
    pub env: EnvConfig,
    /// The road.
    pub road: RoadConfig,
    /// The other drivers.
    pub traffic: TrafficConfig,
    /// The ego car.
    pub vehicle: VehicleParams,
    /// How the true car differs from what its controllers know, and the wind.
    pub plant: PlantConfig,
    /// Its sensors.
    pub perception: PerceptionConfig,
    /// Its forecast.
    pub prediction: PredictionConfig,
    /// Its lane-change planner.
    pub planner: PlannerConfig,
    /// Its controllers and guard.
    pub control: ControlConfig,
    /// Its actions.
    pub actions: ActionsConfig,
    /// What it observes.
    pub observation: ObservationConfig,
    /// What it is rewarded for.
    pub reward: RewardConfig,
    /// Which lane changes it may decide on.
    pub shield: ShieldConfig,
}

impl Config {
    /// Checks every section.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.env.periods()?;
        self.env.scenario_file()?;
        self.road.validate()?;
        self.traffic.validate()?;
        self.vehicle.validate()?;
        self.check_delays()?;
        self.plant.validate()?;
        self.perception.validate()?;
        self.prediction.validate(self.env.control_period_s)?;
        self.planner.validate()?;
        self.control.validate()?;
        self.actions.validate()?;
        self.observation.validate()?;
        self.reward.validate()?;
        self.shield.validate()
    }

    /// A delay is none or a whole number of plant steps.
    fn check_delays(&self) -> Result<(), ConfigError> {
        let plant = ("env.plant_period_s", self.env.plant_period_s);
        let vehicle = &self.vehicle;
        for (key, delay_s) in
            [("vehicle.steer_delay_s", vehicle.steer_delay_s), ("vehicle.drive_delay_s", vehicle.drive_delay_s)]
        {
            if delay_s > 0.0 {
                whole_multiple((key, delay_s), plant)?;
            }
        }
        Ok(())
    }
}
