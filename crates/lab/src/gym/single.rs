//! One environment of a task.

use std::sync::Arc;

use lanecraft_drive::decide::Maneuver;
use lanecraft_drive::driver::PathCommand;
use lanecraft_drive::env::{Env, EnvError, StepError, StepOutcome};
use lanecraft_drive::snapshot::{Snapshot, SnapshotError};
use lanecraft_drive::vehicle::ControlInput;

use super::metrics;
use super::task::{ActionSpace, MaskedActions, Seat, Task};

/// Why an environment cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GymError {
    /// The scene cannot be built.
    #[error(transparent)]
    Env(#[from] EnvError),
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
            ActionSpace::Continuous { .. } => ("real numbers", matches!(self, Self::Continuous(_))),
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
    env: Env,
    last: Option<StepOutcome>,
    action: usize,
}

impl Gym {
    /// The start of the episode of this seed.
    pub fn new(task: &Arc<Task>, seed: u64) -> Result<Self, GymError> {
        Ok(Self { task: Arc::clone(task), env: Env::new(&task.config, seed)?, last: None, action: 0 })
    }

    /// The environment itself.
    pub fn env(&self) -> &Env {
        &self.env
    }

    /// What `action` means here; nothing moves yet.
    ///
    /// # Errors
    /// If the episode is over, or the action does not exist, is out of bounds or is forbidden.
    pub fn command(&self, action: Actions) -> Result<Command, GymError> {
        action.check(self.task.actions(), 1)?;
        if self.env.is_over() {
            return Err(StepError::Over.into());
        }
        Ok(match (action, self.task.seat) {
            (Actions::Discrete(action), _) => Command::Decide(self.legal(action[0])?),
            (Actions::Continuous(numbers), Seat::Control) => {
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
        let outcome = match command {
            Command::Decide(action) => {
                self.action = *action;
                self.env.step(*action)?
            }
            Command::Plan(path) => self.env.step_path(path)?,
            Command::Control(input) => self.env.step_control(input)?,
        };
        self.last = Some(outcome);
        Ok((outcome.reward.sum(), outcome.terminated, outcome.truncated))
    }

    /// Whether the episode has ended.
    pub fn is_over(&self) -> bool {
        self.env.is_over()
    }

    /// Writes the observation.
    pub fn observe(&self, out: &mut [f32]) {
        self.env.observe(out);
    }

    /// Writes which actions are allowed; nothing if actions are not discrete.
    pub fn mask(&self, out: &mut [bool]) {
        let mask = self.env.mask();
        for (action, allowed) in out.iter_mut().enumerate() {
            *allowed = mask.allows(action);
        }
    }

    /// Writes the task's measurements.
    pub fn metrics(&self, out: &mut [f64]) {
        metrics::drive(&self.env, self.last.as_ref(), self.action, out);
    }

    /// The episode as it stands.
    pub fn snapshot(&self) -> Result<Snapshot, GymError> {
        Ok(self.env.snapshot()?)
    }

    /// Goes on from an episode that was stored.
    ///
    /// # Errors
    /// If it was one of another configuration, whose observations and actions may be others.
    pub fn restore(task: &Arc<Task>, snapshot: &Snapshot) -> Result<Self, GymError> {
        let env = Env::restore(snapshot)?;
        if env.config() != &task.config {
            return Err(GymError::OtherTask);
        }
        Ok(Self { task: Arc::clone(task), env, last: None, action: 0 })
    }

    /// A digest of the whole physical state: equal states have equal digests.
    pub fn digest(&self) -> u64 {
        self.env.digest()
    }

    /// The action that is taken for `action`.
    fn legal(&self, action: i64) -> Result<usize, GymError> {
        let (mask, set) = (self.env.mask(), self.env.actions());
        let count = set.len() + 2;
        let wanted = usize::try_from(action).ok().filter(|action| *action < count);
        let wanted = wanted.ok_or(GymError::NoSuchAction { action, last: count - 1 })?;
        if mask.allows(wanted) {
            return Ok(wanted);
        }
        let hold = set.plain(Maneuver::Keep { accel_mps2: 0.0 });
        let mut instead = [Some(set.continue_action()), hold].into_iter().flatten().chain(0..count);
        match (self.task.masked, instead.find(|action| mask.allows(*action))) {
            (MaskedActions::Replace, Some(instead)) => Ok(instead),
            _ => Err(StepError::NotAllowed { action: wanted, mask }.into()),
        }
    }

    /// The numbers of an action. Bounds in single precision may lie beyond those in double precision by a rounding error, which is
    /// forgiven.
    fn within<const N: usize>(&self, numbers: &[f64]) -> Result<[f64; N], GymError> {
        let ActionSpace::Continuous { low, high } = self.task.actions() else { return Ok([f64::NAN; N]) };
        let mut within = [0.0; N];
        for index in 0..N {
            let (value, low, high) = (numbers[index], low[index], high[index]);
            let slack = f64::from(f32::EPSILON) * low.abs().max(high.abs());
            if !(low - slack..=high + slack).contains(&value) {
                return Err(GymError::OutOfBounds { index, value, low, high });
            }
            within[index] = value.clamp(low, high);
        }
        Ok(within)
    }
}
