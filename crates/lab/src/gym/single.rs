//! One environment of a task.

use std::sync::Arc;

use lanecraft_drive::decide::{ActionMask, Maneuver};
use lanecraft_drive::driver::PathCommand;
use lanecraft_drive::env::{Env, EnvError, StepError, StepOutcome};
use lanecraft_drive::kinematic::{self, KinematicEnv, MetaAction};
use lanecraft_drive::scenario::ScenarioError;
use lanecraft_drive::snapshot::{Snapshot, SnapshotError};
use lanecraft_drive::vehicle::ControlInput;

use super::metrics;
use super::task::{ActionSpace, MaskedActions, Seat, Simulation, Task, Units};
use crate::render::View;

/// Why an environment cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GymError {
    /// The scene cannot be built.
    #[error(transparent)]
    Env(#[from] EnvError),
    /// The scene of the fast environment cannot be built.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The episode has ended.
    #[error("the episode is over; begin a new one")]
    Over,
    /// The mask forbids an action.
    #[error("action {action} is not allowed now; allowed are {allowed:?}")]
    Masked {
        /// The action.
        action: usize,
        /// Those that are allowed.
        allowed: Vec<usize>,
    },
    /// An action that is none.
    #[error("action {action} does not exist; there are 0 to {last}")]
    NoSuchAction {
        /// The action.
        action: i64,
        /// The last one that exists.
        last: usize,
    },
    /// A number of an action that is out of its bounds, or NaN.
    #[error("number {index} of the action is {value}, but must be in {low}..={high}")]
    OutOfBounds {
        /// Which number.
        index: usize,
        /// The number.
        value: f64,
        /// The smallest that is allowed.
        low: f64,
        /// The largest that is allowed.
        high: f64,
    },
    /// Actions of the other kind, or too many or too few numbers.
    #[error("got {found}, but {expected} needed")]
    WrongShape {
        /// What was given.
        found: String,
        /// What is needed.
        expected: String,
    },
    /// The step was refused.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The step of the fast environment was refused.
    #[error(transparent)]
    KinematicStep(#[from] kinematic::StepError),
    /// A state that cannot be stored or gone on from.
    #[error(transparent)]
    Snapshot(#[from] SnapshotError),
    /// An episode of another configuration.
    #[error("the snapshot is one of another configuration")]
    OtherTask,
    /// No threads.
    #[error("cannot start threads")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// One environment of many.
    #[error("environment {index}: {source}")]
    At {
        /// Which one.
        index: usize,
        /// What is wrong there.
        source: Box<Self>,
    },
}

/// The actions of one environment, or of many one after the other.
#[derive(Clone, Copy, Debug)]
pub enum Actions<'a> {
    /// Whole numbers, one for each environment.
    Discrete(&'a [i64]),
    /// Vectors, one after the other.
    Continuous(&'a [f64]),
}

impl Actions<'_> {
    /// Checks that these are actions for so many environments.
    pub(super) fn check(self, space: &ActionSpace, environments: usize) -> Result<(), GymError> {
        let width = space.width();
        let (kind, found) = match self {
            Self::Discrete(actions) => ("whole numbers", actions.len()),
            Self::Continuous(actions) => ("real numbers", actions.len()),
        };
        let (needed, fits) = match space {
            ActionSpace::Discrete(_) => ("whole numbers", matches!(self, Self::Discrete(_))),
            ActionSpace::Continuous(_) => ("real numbers", matches!(self, Self::Continuous(_))),
        };
        let expected = width * environments;
        if fits && found == expected {
            return Ok(());
        }
        Err(GymError::WrongShape { found: format!("{found} {kind}"), expected: format!("{expected} {needed} are") })
    }

    /// Those of the environment with this index.
    pub(super) fn at(self, index: usize, width: usize) -> Self {
        let range = index * width..(index + 1) * width;
        match self {
            Self::Discrete(actions) => Self::Discrete(&actions[range]),
            Self::Continuous(actions) => Self::Continuous(&actions[range]),
        }
    }
}

/// An action, as it is carried out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// To the driver: an action that is allowed.
    Decide(usize),
    /// To the controllers.
    Plan(PathCommand),
    /// To the car.
    Control(ControlInput),
}

/// One environment of a task, in the middle of an episode.
#[derive(Clone, Debug)]
pub struct Gym {
    task: Arc<Task>,
    simulator: Simulator,
    /// The last action that was carried out.
    action: usize,
}

#[derive(Clone, Debug)]
enum Simulator {
    Drive { env: Box<Env>, last: Option<StepOutcome> },
    Kinematic(Box<KinematicEnv>),
}

impl Gym {
    /// The start of the episode of this seed.
    pub fn new(task: &Arc<Task>, seed: u64) -> Result<Self, GymError> {
        let simulator = match &task.simulation {
            Simulation::Drive(config, _) => Simulator::Drive { env: Box::new(Env::new(config, seed)?), last: None },
            Simulation::Kinematic(config) => Simulator::Kinematic(Box::new(KinematicEnv::new(config, seed)?)),
        };
        Ok(Self { task: Arc::clone(task), simulator, action: 0 })
    }

    /// What `action` means here; nothing moves yet.
    ///
    /// # Errors
    /// If the episode is over, or the action does not exist, is out of bounds or is forbidden.
    pub fn command(&self, action: Actions) -> Result<Command, GymError> {
        action.check(self.task.actions(), 1)?;
        if self.is_over() {
            return Err(GymError::Over);
        }
        Ok(match (action, &self.task.simulation) {
            (Actions::Discrete(action), _) => Command::Decide(self.legal(action[0])?),
            (Actions::Continuous(numbers), Simulation::Drive(_, Seat::Control)) => {
                let [accel_mps2, steer_rad] = self.within(numbers)?;
                Command::Control(ControlInput { accel_mps2, steer_rad })
            }
            (Actions::Continuous(numbers), _) => {
                let [end_d_m, duration_s, speed_mps] = self.within(numbers)?;
                Command::Plan(PathCommand { end_d_m, duration_s, speed_mps })
            }
        })
    }

    /// One step: the reward, and whether the episode was terminated or truncated by it.
    pub fn step(&mut self, command: &Command) -> Result<(f64, bool, bool), GymError> {
        if let Command::Decide(action) = command {
            self.action = *action;
        }
        match (&mut self.simulator, command) {
            (Simulator::Drive { env, last }, command) => {
                let outcome = match command {
                    Command::Decide(action) => env.step(*action)?,
                    Command::Plan(path) => env.step_path(path)?,
                    Command::Control(input) => env.step_control(input)?,
                };
                *last = Some(outcome);
                Ok((outcome.reward.sum(), outcome.terminated, outcome.truncated))
            }
            (Simulator::Kinematic(env), _) => {
                let outcome = env.step(self.action)?;
                Ok((outcome.reward, outcome.terminated, outcome.truncated))
            }
        }
    }

    /// Whether the episode has ended.
    pub fn is_over(&self) -> bool {
        match &self.simulator {
            Simulator::Drive { env, .. } => env.is_over(),
            Simulator::Kinematic(env) => env.is_over(),
        }
    }

    /// Writes the observation.
    pub fn observe(&self, out: &mut [f32]) {
        match &self.simulator {
            Simulator::Drive { env, .. } => env.observe(out),
            Simulator::Kinematic(env) => env.observe(out),
        }
    }

    /// Writes which actions are allowed; nothing if actions are not discrete.
    pub fn mask(&self, out: &mut [bool]) {
        let mask = self.allowed();
        for (action, allowed) in out.iter_mut().enumerate() {
            *allowed = mask.allows(action);
        }
    }

    /// Writes the task's measurements.
    pub fn metrics(&self, out: &mut [f64]) {
        match &self.simulator {
            Simulator::Drive { env, last } => metrics::drive(env, last.as_ref(), self.action, out),
            Simulator::Kinematic(env) => metrics::kinematic(env, self.action, out),
        }
    }

    /// What a picture of the present instant shows.
    pub fn view(&self) -> View {
        match &self.simulator {
            Simulator::Drive { env, .. } => View::of(env),
            Simulator::Kinematic(env) => View::of_kinematic(env),
        }
    }

    /// A digest of the whole physical state: equal states have equal digests.
    pub fn digest(&self) -> u64 {
        match &self.simulator {
            Simulator::Drive { env, .. } => env.digest(),
            Simulator::Kinematic(env) => env.digest(),
        }
    }

    /// The episode as it stands.
    pub fn snapshot(&self) -> Result<Snapshot, GymError> {
        Ok(match &self.simulator {
            Simulator::Drive { env, .. } => env.snapshot()?,
            Simulator::Kinematic(env) => env.snapshot()?,
        })
    }

    /// Goes on from an episode that was stored.
    ///
    /// # Errors
    /// If it was one of another configuration, whose observations and actions may be others.
    pub fn restore(task: &Arc<Task>, snapshot: &Snapshot) -> Result<Self, GymError> {
        let simulator = match &task.simulation {
            Simulation::Drive(config, _) => {
                let env = Box::new(Env::restore(snapshot)?);
                if env.config() != config {
                    return Err(GymError::OtherTask);
                }
                Simulator::Drive { env, last: None }
            }
            Simulation::Kinematic(config) => {
                let env = Box::new(KinematicEnv::restore(snapshot)?);
                if env.config() != config {
                    return Err(GymError::OtherTask);
                }
                Simulator::Kinematic(env)
            }
        };
        Ok(Self { task: Arc::clone(task), simulator, action: 0 })
    }

    /// The whole loop, if that is what is simulated.
    pub fn drive_env(&self) -> Option<&Env> {
        match &self.simulator {
            Simulator::Drive { env, .. } => Some(env),
            Simulator::Kinematic(_) => None,
        }
    }

    fn allowed(&self) -> ActionMask {
        match &self.simulator {
            Simulator::Drive { env, .. } => env.mask(),
            Simulator::Kinematic(env) => env.mask(),
        }
    }

    /// The action that is taken for `action`.
    fn legal(&self, action: i64) -> Result<usize, GymError> {
        match &self.simulator {
            Simulator::Drive { env, .. } => legal_action(env, self.task.masked, action),
            Simulator::Kinematic(env) => {
                let calm = [Some(MetaAction::Idle as usize), None];
                legal(self.task.masked, env.mask(), self.task.mask_width(), calm, action)
            }
        }
    }

    /// The numbers of an action, in SI units. Bounds in single precision may lie beyond those in double precision by a rounding error,
    /// which is forgiven.
    fn within<const N: usize>(&self, numbers: &[f64]) -> Result<[f64; N], GymError> {
        let ActionSpace::Continuous(ranges) = self.task.actions() else { return Ok([f64::NAN; N]) };
        let mut within = [0.0; N];
        for index in 0..N {
            let (value, range) = (numbers[index], ranges[index]);
            let (low, high) = match self.task.units {
                Units::Normalized => (-1.0, 1.0),
                Units::Si => (range.low, range.high),
            };
            let slack = f64::from(f32::EPSILON) * low.abs().max(high.abs());
            if !(low - slack..=high + slack).contains(&value) {
                return Err(GymError::OutOfBounds { index, value, low, high });
            }
            let value = value.clamp(low, high);
            within[index] = if self.task.units == Units::Normalized { range.at(value) } else { value };
        }
        Ok(within)
    }
}

/// The action that is taken for `action`, which may be one that the mask forbids, or none at all.
///
/// # Errors
/// If there is no such action, or it is forbidden and nothing is to take its place.
pub fn legal_action(env: &Env, masked: MaskedActions, action: i64) -> Result<usize, GymError> {
    let set = env.actions();
    let calm = [Some(set.continue_action()), set.plain(Maneuver::Keep { accel_mps2: 0.0 })];
    legal(masked, env.mask(), set.len() + 2, calm, action)
}

/// The same for any environment of `count` actions, of which those in `calm` are the first to take another's place.
fn legal(
    masked: MaskedActions,
    mask: ActionMask,
    count: usize,
    calm: [Option<usize>; 2],
    action: i64,
) -> Result<usize, GymError> {
    let wanted = usize::try_from(action).ok().filter(|action| *action < count);
    let wanted = wanted.ok_or(GymError::NoSuchAction { action, last: count - 1 })?;
    if mask.allows(wanted) {
        return Ok(wanted);
    }
    if masked == MaskedActions::Refuse {
        let allowed = (0..count).filter(|action| mask.allows(*action)).collect();
        return Err(GymError::Masked { action: wanted, allowed });
    }
    let mut instead = calm.into_iter().flatten().chain(0..count);
    Ok(instead.find(|action| mask.allows(*action)).unwrap_or(wanted))
}
