//! The sections of the fast environment.

use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::config::{ConfigError, check_order, check_range};
use crate::road::RoadConfig;
use crate::scenario::{Distribution, TrafficConfig};

/// Largest number of observed vehicles, the ego included.
pub(super) const MAX_OBSERVED: usize = 64;
/// How far the ego sees, m (highway-env: 5 s at 40 m/s).
pub(super) const SIGHT_M: f64 = 200.0;

/// The whole fast environment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct KinematicConfig {
    /// The road. `length_m` is not read: it follows from the number of vehicles and their density, and is 400 m at least, so that nobody
    /// is in sight twice on a ring.
    pub road: RoadConfig,
    /// The other drivers. `density_spread_veh_per_km_lane` is not read, for their number is given.
    pub traffic: TrafficConfig,
    /// What the ego is to do.
    pub task: KinematicTask,
}

impl Default for KinematicConfig {
    fn default() -> Self {
        let traffic = TrafficConfig {
            // highway-env places one vehicle every 24 m or so, whatever the lane: 13.9 on three lanes.
            density_veh_per_km_lane: 14.0,
            desired_speed_mps: Distribution::uniform(21.0, 24.0),
            time_headway_s: Distribution::fixed(1.5),
            min_gap_m: Distribution::fixed(5.0),
            max_accel_mps2: Distribution::fixed(3.0),
            comfort_decel_mps2: Distribution::fixed(5.0),
            politeness: Distribution::fixed(0.0),
            accel_gain_threshold_mps2: 0.2,
            safe_decel_mps2: 2.0,
            lane_decision_period_s: 1.0,
            warm_up_s: 0.0,
            ..TrafficConfig::default()
        };
        let road = RoadConfig { lanes: 3, lane_width_m: 4.0, ..RoadConfig::default() };
        Self { road, traffic, task: KinematicTask::default() }
    }
}

/// The task: time, meta-actions, reward, observation. Defaults are those of `highway-fast-v0`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct KinematicTask {
    /// Number of other vehicles.
    pub vehicles: u32,
    /// Simulation steps in a second, Hz.
    pub simulation_hz: f64,
    /// Simulation steps between two decisions.
    pub steps_per_decision: u32,
    /// Length of an episode, s; the last decision is the first that reaches it.
    pub duration_s: f64,
    /// Speeds that the ego can be told to drive at, rising, m/s.
    pub target_speeds_mps: Vec<f64>,
    /// Reward of a collision.
    pub collision_reward: f64,
    /// Reward of the rightmost target lane, falling linearly to 0 on the leftmost one.
    pub right_lane_reward: f64,
    /// Reward of the highest speed, falling linearly to 0 at the lowest one of the range below.
    pub high_speed_reward: f64,
    /// Reward of a lane change begun.
    pub lane_change_reward: f64,
    /// Speed along the road from which on speed is rewarded, m/s.
    pub reward_min_speed_mps: f64,
    /// Speed along the road from which on more speed earns no more, m/s.
    pub reward_max_speed_mps: f64,
    /// Whether the reward is scaled from `[collision_reward, high_speed_reward + right_lane_reward]` to [0, 1].
    pub normalize_reward: bool,
    /// What is observed.
    pub observation: KinematicsConfig,
}

impl Default for KinematicTask {
    fn default() -> Self {
        Self {
            vehicles: 20,
            simulation_hz: 5.0,
            steps_per_decision: 5,
            duration_s: 30.0,
            target_speeds_mps: vec![20.0, 25.0, 30.0],
            collision_reward: -1.0,
            right_lane_reward: 0.1,
            high_speed_reward: 0.4,
            lane_change_reward: 0.0,
            reward_min_speed_mps: 20.0,
            reward_max_speed_mps: 30.0,
            normalize_reward: true,
            observation: KinematicsConfig::default(),
        }
    }
}

/// A column of the observation; x points along the road, y to the right from the middle of the leftmost lane, as in highway-env.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
// The names are highway-env's.
#[serde(rename_all = "snake_case")]
pub enum Feature {
    /// 1 if there is a vehicle.
    Presence,
    /// Position along the road, m.
    X,
    /// Position to the right, m.
    Y,
    /// Speed along the road, m/s.
    Vx,
    /// Speed to the right, m/s.
    Vy,
    /// Heading, rad, positive to the right.
    Heading,
    /// Cosine of the heading.
    CosH,
    /// Sine of the heading.
    SinH,
}

/// The observation `Kinematics`: a row for the ego and one for each of the nearest vehicles, nearest along the road first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct KinematicsConfig {
    /// Rows, the ego's included.
    pub observed_vehicles: usize,
    /// Columns.
    pub features: Vec<Feature>,
    /// Whether the others' positions and velocities are absolute, not relative to the ego's. The ego's own always are.
    pub absolute: bool,
    /// Whether x is scaled from ±200 m, y from ± the road's width and speeds from ±80 m/s to ±1 and cut off there.
    pub normalize: bool,
    /// Whether vehicles more than two car lengths behind are seen.
    pub see_behind: bool,
}

impl Default for KinematicsConfig {
    fn default() -> Self {
        Self {
            observed_vehicles: 5,
            features: vec![Feature::Presence, Feature::X, Feature::Y, Feature::Vx, Feature::Vy],
            absolute: false,
            normalize: true,
            see_behind: false,
        }
    }
}

impl KinematicsConfig {
    /// Numbers in an observation.
    pub fn size(&self) -> usize {
        self.observed_vehicles * self.features.len()
    }

    /// The lowest and the highest value of each number, in their order; without scaling, what can grow without end is bounded by the
    /// largest number of single precision.
    pub fn bounds(&self) -> (Vec<f32>, Vec<f32>) {
        let row = self.features.iter().map(|feature| match feature {
            Feature::Presence => (0.0, 1.0),
            Feature::CosH | Feature::SinH => (-1.0, 1.0),
            Feature::Heading => (-core::f32::consts::PI, core::f32::consts::PI),
            Feature::X | Feature::Y | Feature::Vx | Feature::Vy if self.normalize => (-1.0, 1.0),
            Feature::X | Feature::Y | Feature::Vx | Feature::Vy => (f32::MIN, f32::MAX),
        });
        let rows = std::iter::repeat_n(row, self.observed_vehicles);
        rows.flatten().unzip()
    }
}

impl KinematicConfig {
    /// The configuration that a TOML text lays over the default one, key by key. (Serde alone would take the keys that a given section
    /// lacks from the section's own default, not from this environment's.)
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        let mut all = Table::try_from(Self::default()).expect("all sections are tables of plain values");
        lay_over(&mut all, text.parse()?);
        all.try_into()
    }

    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.road.validate()?;
        self.traffic.validate()?;
        let len = self.road.lanes_open.len();
        if len > 0 {
            let allowed = "none: the ego of this environment heeds no lane's end";
            return Err(ConfigError::WrongLength { key: "road.lanes_open", len, allowed });
        }
        self.task.validate()
    }
}

/// Tables are laid over tables, any other value replaces.
fn lay_over(below: &mut Table, above: Table) {
    for (key, value) in above {
        match (below.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) if !above.contains_key("kind") => lay_over(below, above),
            (_, value) => {
                below.insert(key, value);
            }
        }
    }
}

impl KinematicTask {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("task.vehicles", f64::from(self.vehicles), 1.0, 1e6)?;
        check_range("task.simulation_hz", self.simulation_hz, 1.0, 100.0)?;
        check_range("task.steps_per_decision", f64::from(self.steps_per_decision), 1.0, 1000.0)?;
        check_range("task.duration_s", self.duration_s, 0.01, 1e6)?;
        let speeds = &self.target_speeds_mps;
        if speeds.is_empty() {
            let (key, allowed) = ("task.target_speeds_mps", "at least one");
            return Err(ConfigError::WrongLength { key, len: 0, allowed });
        }
        let mut least_mps = 0.0;
        for &speed_mps in speeds {
            check_range("task.target_speeds_mps", speed_mps, least_mps, 60.0)?;
            least_mps = speed_mps;
        }
        for (key, reward) in [
            ("task.collision_reward", self.collision_reward),
            ("task.right_lane_reward", self.right_lane_reward),
            ("task.high_speed_reward", self.high_speed_reward),
            ("task.lane_change_reward", self.lane_change_reward),
        ] {
            check_range(key, reward, -1e6, 1e6)?;
        }
        self.validate_scales()
    }

    /// What is divided by must not vanish.
    fn validate_scales(&self) -> Result<(), ConfigError> {
        check_range("task.reward_min_speed_mps", self.reward_min_speed_mps, 0.0, 60.0)?;
        check_range("task.reward_max_speed_mps", self.reward_max_speed_mps, self.reward_min_speed_mps + 0.01, 100.0)?;
        if self.normalize_reward {
            let best = ("task.high_speed_reward", self.high_speed_reward + self.right_lane_reward - 1e-6);
            check_order(("task.collision_reward", self.collision_reward), best)?;
        }
        let observation = &self.observation;
        let rows = observation.observed_vehicles as f64;
        check_range("task.observation.observed_vehicles", rows, 1.0, MAX_OBSERVED as f64)?;
        let len = observation.features.len();
        if (1..=8).contains(&len) {
            return Ok(());
        }
        Err(ConfigError::WrongLength { key: "task.observation.features", len, allowed: "1 to 8" })
    }

    /// Decisions in an episode.
    pub(super) fn decisions(&self) -> u32 {
        let decisions = self.duration_s * self.simulation_hz / f64::from(self.steps_per_decision);
        // Written in decimal, a whole number of decisions may come out a little above it.
        (decisions - 1e-9).ceil().max(1.0) as u32
    }
}
