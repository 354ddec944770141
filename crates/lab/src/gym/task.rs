//! What is simulated, who acts in it, and the shapes of what goes in and out.

use std::sync::Arc;

use lanecraft_drive::env::{Config, Env, EnvError};
use lanecraft_drive::kinematic::{KinematicConfig, KinematicEnv, MetaAction};
use lanecraft_drive::scenario::ScenarioError;

use super::metrics::{self, Metric};

/// Which seat of the car is taken by whoever acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seat {
    /// Decides once a tick; one of the actions.
    Decide,
    /// Hands in a path once a tick: lateral position at its end (m), duration (s), speed (m/s).
    Plan,
    /// Hands in a command at every control step: acceleration (m/s²), road-wheel angle (rad).
    Control,
}

impl Seat {
    /// All seats with their names.
    pub const NAMES: [(&'static str, Self); 3] =
        [("decide", Self::Decide), ("plan", Self::Plan), ("control", Self::Control)];
}

/// What becomes of an action that the mask forbids.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskedActions {
    /// *Continue* takes its place during a lane change, else holding the speed, else the first action that is allowed.
    Replace,
    /// It is refused.
    Refuse,
}

impl MaskedActions {
    /// Both with their names.
    pub const NAMES: [(&'static str, Self); 2] = [("replace", Self::Replace), ("raise", Self::Refuse)];
}

/// In what numbers of a continuous action are given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Units {
    /// From −1 to 1, as learners want them: 0 is the middle of a range, and of a command that nothing is asked for.
    Normalized,
    /// Meters, seconds, radians.
    Si,
}

impl Units {
    /// Both with their names.
    pub const NAMES: [(&'static str, Self); 2] = [("normalized", Self::Normalized), ("si", Self::Si)];
}

/// Actions that may be taken.
#[derive(Clone, Debug, PartialEq)]
pub enum ActionSpace {
    /// Whole numbers from 0, fewer than this.
    Discrete(usize),
    /// Vectors within these bounds.
    Continuous(Vec<Range>),
}

impl ActionSpace {
    /// Numbers in one action.
    pub fn width(&self) -> usize {
        match self {
            Self::Discrete(_) => 1,
            Self::Continuous(ranges) => ranges.len(),
        }
    }
}

/// Values of one number of an action, in SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The smallest.
    pub low: f64,
    /// What a normalized 0 stands for.
    pub middle: f64,
    /// The largest.
    pub high: f64,
}

impl Range {
    /// The value of a number from −1 to 1.
    pub(super) fn at(&self, share: f64) -> f64 {
        let side = if share < 0.0 { self.middle - self.low } else { self.high - self.middle };
        (self.middle + share * side).clamp(self.low, self.high)
    }
}

/// Observations that may be made.
#[derive(Clone, Debug, PartialEq)]
pub struct ObservationSpace {
    /// Length along each axis.
    pub shape: Vec<usize>,
    /// The smallest of each number, in the order of the observation.
    pub low: Vec<f32>,
    /// The largest of each number.
    pub high: Vec<f32>,
}

impl ObservationSpace {
    /// Numbers in one observation.
    pub fn size(&self) -> usize {
        self.low.len()
    }
}

/// Why a task cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TaskError {
    /// The whole loop cannot be made.
    #[error(transparent)]
    Env(#[from] EnvError),
    /// The fast environment cannot be made.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
}

/// What is simulated.
#[derive(Clone, Debug)]
pub(super) enum Simulation {
    /// The whole loop, and which seat of it is taken.
    Drive(Arc<Config>, Seat),
    /// The fast environment.
    Kinematic(Arc<KinematicConfig>),
}

/// An environment to be made again and again.
#[derive(Clone, Debug)]
pub struct Task {
    pub(super) simulation: Simulation,
    pub(super) masked: MaskedActions,
    pub(super) units: Units,
    actions: ActionSpace,
    action_names: Vec<String>,
    observations: ObservationSpace,
}

impl Task {
    /// The whole loop, with whoever acts in this seat.
    ///
    /// # Errors
    /// If the configuration is not valid, or no scene can be built from it.
    pub fn drive(config: Arc<Config>, seat: Seat, masked: MaskedActions, units: Units) -> Result<Self, TaskError> {
        let env = Env::new(&config, 0)?;
        let (low, high) = config.observation.bounds();
        let observations = ObservationSpace { shape: config.observation.shape(), low, high };
        let actions = action_space(&env, seat);
        let named = if let ActionSpace::Discrete(count) = actions { count } else { 0 };
        let action_names = (0..named).map(|action| env.actions().name(action)).collect();
        Ok(Self { simulation: Simulation::Drive(config, seat), masked, units, actions, action_names, observations })
    }

    /// The fast environment.
    ///
    /// # Errors
    /// If the configuration is not valid, or no scene can be built from it.
    pub fn kinematic(config: Arc<KinematicConfig>, masked: MaskedActions) -> Result<Self, TaskError> {
        KinematicEnv::new(&config, 0)?;
        let seen = &config.task.observation;
        let (low, high) = seen.bounds();
        let observations = ObservationSpace { shape: vec![seen.observed_vehicles, seen.features.len()], low, high };
        let actions = ActionSpace::Discrete(MetaAction::ALL.len());
        let action_names = MetaAction::ALL.map(|action| action.name().to_owned()).into();
        let units = Units::Normalized;
        Ok(Self { simulation: Simulation::Kinematic(config), masked, units, actions, action_names, observations })
    }

    /// The actions.
    pub fn actions(&self) -> &ActionSpace {
        &self.actions
    }

    /// Numbers in a mask; none if actions are not discrete.
    pub fn mask_width(&self) -> usize {
        match self.actions {
            ActionSpace::Discrete(actions) => actions,
            ActionSpace::Continuous(_) => 0,
        }
    }

    /// The observations.
    pub fn observations(&self) -> &ObservationSpace {
        &self.observations
    }

    /// What is measured at each step.
    pub fn metrics(&self) -> &'static [Metric] {
        match self.simulation {
            Simulation::Drive(..) => metrics::DRIVE,
            Simulation::Kinematic(_) => metrics::KINEMATIC,
        }
    }

    /// What each action does, in words; none if actions are not discrete.
    pub fn action_names(&self) -> &[String] {
        &self.action_names
    }

    /// The configuration as TOML.
    pub fn config_toml(&self) -> String {
        let text = match &self.simulation {
            Simulation::Drive(config, _) => toml::to_string(&**config),
            Simulation::Kinematic(config) => toml::to_string(&**config),
        };
        text.expect("all sections are tables of plain values")
    }

    /// Simulated time from one step to the next, s.
    pub fn step_s(&self) -> f64 {
        match &self.simulation {
            Simulation::Drive(config, Seat::Control) => config.env.control_period_s,
            Simulation::Drive(config, _) => config.env.decision_period_s,
            Simulation::Kinematic(config) => f64::from(config.task.steps_per_decision) / config.task.simulation_hz,
        }
    }
}

fn action_space(env: &Env, seat: Seat) -> ActionSpace {
    match seat {
        // Those of the set, *continue* and *abort*.
        Seat::Decide => ActionSpace::Discrete(env.actions().len() + 2),
        Seat::Plan => {
            let bounds = env.driver().path_bounds();
            let [low, high] = [bounds.low, bounds.high].map(|path| [path.end_d_m, path.duration_s, path.speed_mps]);
            let range = |(low, high): (f64, f64)| Range { low, middle: 0.5 * (low + high), high };
            ActionSpace::Continuous(low.into_iter().zip(high).map(range).collect())
        }
        Seat::Control => {
            let (low, high) = env.control_bounds();
            let [low, high] = [low, high].map(|input| [input.accel_mps2, input.steer_rad]);
            let range = |(low, high): (f64, f64)| Range { low, middle: 0.0, high };
            ActionSpace::Continuous(low.into_iter().zip(high).map(range).collect())
        }
    }
}
