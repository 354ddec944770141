//! The environment: a value that holds all that lives between two ticks. A clone of it is a snapshot.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::config::{Config, Order, Periods};
use super::episode::Episode;
use super::foresight::foresee;
use crate::config::ConfigError;
use crate::decide::{ActionMask, ActionSet, Situation, observe};
use crate::driver::{Driver, DriverSetup, Part};
use crate::perceive::perceive;
use crate::road::Side;
use crate::scenario::{Scenario, ScenarioDistribution, ScenarioError};
use crate::scene::Scene;
use crate::traffic::{ExternalBody, World};
use crate::vehicle::{Plant, SingleTrack, VehicleState};

/// Why an environment cannot start.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EnvError {
    /// A bad configuration value.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A scenario that cannot be built.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
}

/// A highway with traffic and one ego car, driven one tick at a time. What serde stores of it lacks what follows from the configuration:
/// use [`Self::snapshot`] and [`Self::restore`].
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Env {
    #[serde(skip)]
    pub(super) config: Arc<Config>,
    pub(super) periods: Periods,
    pub(super) world: World,
    pub(super) driver: Driver,
    pub(super) ego: VehicleState,
    pub(super) plant: Plant,
    pub(super) driven_m: f64,
    pub(super) mask: ActionMask,
    pub(super) episode: Episode,
    pub(super) over: bool,
}

impl Config {
    /// The scenario that the scenario file, or else the distribution, gives for `seed`.
    pub fn scenario(&self, seed: u64) -> Result<Scenario, EnvError> {
        if let Some(file) = self.env.scenario_file()? {
            return Ok(file.scenario(seed)?);
        }
        let distribution = ScenarioDistribution { road: self.road.clone(), traffic: self.traffic.clone() };
        Ok(distribution.sample(seed)?)
    }
}

impl Env {
    /// The environment of `config` in the scenario that its scenario file, or else its distribution, gives for `seed`.
    pub fn new(config: &Arc<Config>, seed: u64) -> Result<Self, EnvError> {
        Self::in_scenario(config, &config.scenario(seed)?)
    }

    /// The environment of `config` in a given scenario, whose road and traffic stand for those of `config`.
    pub fn in_scenario(config: &Arc<Config>, scenario: &Scenario) -> Result<Self, EnvError> {
        config.validate()?;
        let periods = config.env.periods()?;
        let world = World::new(scenario)?;
        let road = world.road().clone();
        let (s_m, lane, speed_mps) = world.ego_start();
        let ego = VehicleState { s_m, d_m: road.lane_center_m(lane), speed_mps, ..VehicleState::default() };
        let scene = Scene {
            road,
            ego,
            ego_length_m: config.vehicle.length_m,
            ego_width_m: config.vehicle.width_m,
            ego_lane: lane,
            // The ends of lanes are neighbors, too.
            neighbors: Vec::with_capacity(world.len() + usize::from(world.road().config().lanes)),
        };
        let setup = DriverSetup {
            vehicle: &config.vehicle,
            planner: &config.planner,
            control: &config.control,
            actions: &config.actions,
            shield: &config.shield,
            prediction: &config.prediction,
            plan_first: config.env.order == Order::PlanFirst,
            control_period_s: config.env.control_period_s,
        };
        let driver = Driver::new(&setup, scene, lane)?;
        let plant = SingleTrack::new(&config.vehicle, &config.plant, config.env.plant_period_s);
        let mut env = Self {
            config: config.clone(),
            periods,
            world,
            driver,
            ego,
            plant: Plant::SingleTrack(plant),
            driven_m: 0.0,
            mask: ActionMask::default(),
            episode: Episode::default(),
            over: false,
        };
        env.world.set_ego(env.ego_body());
        env.look(&mut |_| ());
        Ok(env)
    }

    /// The configuration.
    pub fn config(&self) -> &Arc<Config> {
        &self.config
    }

    /// The periods.
    pub fn periods(&self) -> Periods {
        self.periods
    }

    /// Which actions the coming tick may take.
    pub fn mask(&self) -> ActionMask {
        self.mask
    }

    /// Whether there is anything to decide: not during a lane change, where *continue* is the only way on but for *abort*.
    pub fn decision_due(&self) -> bool {
        !self.mask.allows(self.driver.actions().continue_action())
    }

    /// The actions.
    pub fn actions(&self) -> &ActionSet {
        self.driver.actions()
    }

    /// What the ego car knows.
    pub fn scene(&self) -> &Scene {
        self.driver.scene()
    }

    /// The ego car's mind.
    pub fn driver(&self) -> &Driver {
        &self.driver
    }

    /// The other vehicles.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The ego car's state.
    pub fn ego(&self) -> &VehicleState {
        &self.ego
    }

    /// Distance driven since the start, m.
    pub fn driven_m(&self) -> f64 {
        self.driven_m
    }

    /// Puts another model of the car in place of the built-in one, from the next step on.
    pub fn set_plant(&mut self, plant: Plant) {
        self.plant = plant;
    }

    /// What was measured so far.
    pub fn episode(&self) -> &Episode {
        &self.episode
    }

    /// Whether the episode has ended, by a collision or by its length.
    pub fn is_over(&self) -> bool {
        self.over
    }

    /// Writes the observation into `out`, of length `config.observation.size()`.
    pub fn observe(&self, out: &mut [f32]) {
        let progress = self.driver.path().map_or(0.0, |(path, elapsed_s)| (elapsed_s / path.duration_s).min(1.0));
        let situation = Situation {
            progress,
            since_change_s: self.driver.since_change_s(),
            allowed: Side::BOTH.map(|side| self.decision_due() && self.driver.offer(side).is_ok()),
            driven_m: self.driven_m,
        };
        observe(&self.config.observation, self.driver.scene(), &situation, out);
    }

    /// A digest of the whole physical state, but for what an external plant holds: equal states have equal digests.
    pub fn digest(&self) -> u64 {
        let ego = &self.ego;
        let bits = [
            ego.s_m,
            ego.d_m,
            ego.heading_rad,
            ego.speed_mps,
            ego.lateral_speed_mps,
            ego.yaw_rate_radps,
            ego.steer_rad,
            ego.accel_mps2,
        ];
        // FNV-1a over 64-bit words.
        let under_way = self.plant.commands_under_way();
        bits.into_iter()
            .chain(under_way)
            .fold(self.world.digest(), |hash, x| (hash ^ x.to_bits()).wrapping_mul(0x0000_0100_0000_01B3))
    }

    /// The ego car as the world sees it.
    pub(super) fn ego_body(&self) -> ExternalBody {
        ExternalBody {
            s_m: self.ego.s_m,
            d_m: self.ego.d_m,
            heading_rad: self.ego.heading_rad,
            speed_mps: self.ego.road_speed_mps().max(0.0),
            accel_mps2: self.ego.accel_mps2,
            length_m: self.config.vehicle.length_m,
            width_m: self.config.vehicle.width_m,
            target_lane: self.driver.target_lane(),
        }
    }

    /// Perception.
    pub(super) fn perceive(&mut self) {
        perceive(&self.config.perception, &self.world, &self.ego, self.driver.scene_mut());
        let ego = self.ego_body();
        if let (scene, Some(forecast)) = self.driver.foretold() {
            foresee(&self.world, ego, self.config.env.control_period_s, scene, forecast);
        }
    }

    /// What precedes a decision: perceive, plan both sides, mask.
    pub(super) fn look(&mut self, lap: &mut impl FnMut(Part)) {
        self.perceive();
        lap(Part::Perception);
        self.driver.consider(lap);
        self.mask = self.driver.mask();
    }
}
