//! The fast environment as a value, and its step. A clone of it is a snapshot.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::action::MetaAction;
use super::config::{KinematicConfig, SIGHT_M};
use super::ego::EgoState;
use super::observation::observe;
use crate::decide::ActionMask;
use crate::road::RoadConfig;
use crate::scenario::{ScenarioDistribution, ScenarioError};
use crate::traffic::{Collision, ExternalBody, World};
use crate::vehicle::VehicleParams;

/// Why a decision cannot be carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// There is no such action.
    #[error("there is no action {action}; the last one is {}", MetaAction::ALL.len() - 1)]
    NoSuchAction {
        /// The action asked for.
        action: usize,
    },
    /// The episode has ended.
    #[error("the episode is over; start a new one")]
    Over,
}

/// What came of a decision.
#[derive(Clone, Copy, Debug, PartialEq)]
#[must_use]
pub struct Outcome {
    /// The reward.
    pub reward: f64,
    /// A collision ended the episode: nothing follows.
    pub terminated: bool,
    /// The episode reached its length: the future goes on unseen.
    pub truncated: bool,
}

/// A highway with traffic and one kinematic ego car, driven one decision at a time. What serde stores of it lacks the configuration: use
/// [`Self::snapshot`] and [`Self::restore`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KinematicEnv {
    #[serde(skip)]
    pub(super) config: Arc<KinematicConfig>,
    world: World,
    ego: EgoState,
    /// Length and width of the ego, m.
    size_m: (f64, f64),
    /// Decisions taken.
    steps: u32,
    collision: Option<Collision>,
}

impl KinematicEnv {
    /// The environment of `config` in the traffic that it gives for `seed`, the ego in the largest gap of a lane drawn.
    ///
    /// # Errors
    /// If the configuration is not valid, or the traffic so dense that the ego finds no room.
    pub fn new(config: &Arc<KinematicConfig>, seed: u64) -> Result<Self, ScenarioError> {
        config.validate()?;
        let mut scenario = distribution(config).sample(seed)?;
        // Each lane gets a whole number, so that some of the last lane have to go again.
        scenario.vehicles.truncate(config.task.vehicles as usize);
        let mut world = World::with_step(&scenario, 1.0 / config.task.simulation_hz)?;
        let (s_m, lane, speed_mps) = world.ego_start();
        let ego = EgoState::new(world.road(), s_m, lane, speed_mps, &config.task.target_speeds_mps);
        let car = VehicleParams::default();
        let size_m = (car.length_m, car.width_m);
        world.set_ego(body(&ego, size_m));
        Ok(Self { config: Arc::clone(config), world, ego, size_m, steps: 0, collision: None })
    }

    /// Carries out the meta-action with this index in [`MetaAction::ALL`]. One that the mask lacks changes neither lane nor speed, as in
    /// highway-env. A collision ends the step at once.
    ///
    /// # Errors
    /// If there is no such action, or the episode is over.
    pub fn step(&mut self, action: usize) -> Result<Outcome, StepError> {
        if self.is_over() {
            return Err(StepError::Over);
        }
        let action = *MetaAction::ALL.get(action).ok_or(StepError::NoSuchAction { action })?;
        let task = &self.config.task;
        let last_lane = self.ego.target_lane;
        self.ego.take(action, self.world.road(), &task.target_speeds_mps);
        let changes = self.ego.target_lane != last_lane;
        let lane_center_m = self.world.road().lane_center_m(self.ego.target_lane);
        let target_mps = task.target_speeds_mps[self.ego.speed_index];
        let dt_s = 1.0 / task.simulation_hz;
        let terminated = (0..task.steps_per_decision).any(|_| {
            self.ego.step(lane_center_m, target_mps, dt_s);
            self.collision = self.world.step(body(&self.ego, self.size_m), dt_s).collision;
            self.collision.is_some()
        });
        self.steps += 1;
        let truncated = self.steps >= task.decisions();
        Ok(Outcome { reward: self.reward(terminated, changes), terminated, truncated })
    }

    fn reward(&self, collided: bool, changes: bool) -> f64 {
        let task = &self.config.task;
        let last = f64::from(self.config.road.lanes - 1);
        let right = (last - f64::from(self.ego.target_lane.0)) / last.max(1.0);
        let range_mps = task.reward_max_speed_mps - task.reward_min_speed_mps;
        let fast = ((self.ego.velocity_mps().0 - task.reward_min_speed_mps) / range_mps).clamp(0.0, 1.0);
        let reward = task.collision_reward * f64::from(u8::from(collided))
            + task.right_lane_reward * right
            + task.high_speed_reward * fast
            + task.lane_change_reward * f64::from(u8::from(changes));
        let (least, most) = (task.collision_reward, task.high_speed_reward + task.right_lane_reward);
        if task.normalize_reward { (reward - least) / (most - least) } else { reward }
    }

    /// Writes the observation into `out`, of length `config.task.observation.size()`: row by row.
    pub fn observe(&self, out: &mut [f32]) {
        debug_assert_eq!(out.len(), self.config.task.observation.size(), "the observation's size");
        observe(&self.config.task.observation, &self.world, &self.ego, out);
    }

    /// The actions that can change something, and to keep on.
    pub fn mask(&self) -> ActionMask {
        MetaAction::mask(&self.ego, self.world.road(), self.config.task.target_speeds_mps.len())
    }

    /// The configuration.
    pub fn config(&self) -> &Arc<KinematicConfig> {
        &self.config
    }

    /// The ego car.
    pub fn ego(&self) -> &EgoState {
        &self.ego
    }

    /// Length and width of the ego car, m.
    pub fn ego_size_m(&self) -> (f64, f64) {
        self.size_m
    }

    /// The other vehicles.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The collision that ended the episode.
    pub fn collision(&self) -> Option<Collision> {
        self.collision
    }

    /// Whether the episode has ended, by a collision or by its length.
    pub fn is_over(&self) -> bool {
        self.collision.is_some() || self.steps >= self.config.task.decisions()
    }

    /// Decisions taken.
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// Time simulated since the start, s.
    pub fn time_s(&self) -> f64 {
        self.world.time_step() as f64 / self.config.task.simulation_hz
    }

    /// A hash of all bits that determine what follows (FNV-1a over 64-bit words).
    pub fn digest(&self) -> u64 {
        let own = [self.world.digest(), u64::from(self.steps) << 1 | u64::from(self.is_over())];
        let words = own.into_iter().chain(self.ego.digest_words());
        words.fold(0xCBF2_9CE4_8422_2325, |hash, word| (hash ^ word).wrapping_mul(0x0000_0100_0000_01B3))
    }
}

/// Roads just so long that the wanted number of vehicles has the wanted density.
fn distribution(config: &KinematicConfig) -> ScenarioDistribution {
    let (road, mut traffic) = (&config.road, config.traffic.clone());
    let per_lane = f64::from(config.task.vehicles.div_ceil(u32::from(road.lanes)));
    let length_m = (1000.0 * per_lane / traffic.density_veh_per_km_lane).max(2.0 * SIGHT_M);
    traffic.density_veh_per_km_lane = 1000.0 * per_lane / length_m;
    traffic.density_spread_veh_per_km_lane = 0.0;
    ScenarioDistribution { road: RoadConfig { length_m, ..road.clone() }, traffic }
}

/// The ego car as the world sees it.
fn body(ego: &EgoState, (length_m, width_m): (f64, f64)) -> ExternalBody {
    ExternalBody {
        s_m: ego.s_m,
        d_m: ego.d_m,
        heading_rad: ego.heading_rad,
        speed_mps: ego.speed_mps,
        accel_mps2: ego.accel_mps2,
        length_m,
        width_m,
        target_lane: ego.target_lane,
    }
}
