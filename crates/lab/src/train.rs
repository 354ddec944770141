//! Training: many environments side by side, one learner, and the same bits whatever the number of threads.
//!
//! Training goes in rounds. In a round every environment drives one tick with the network as it was at the round's start, while the
//! learner makes the updates that the round before has earned; then the new transitions enter the replay buffer in the order of the
//! environments. Both halves of a round run at the same time, and neither sees the other's result before it is over, so the outcome
//! depends on the seed alone.

use std::sync::Arc;
use std::time::{Duration, Instant};

use lanecraft_drive::decide::ActionSet;
use lanecraft_drive::env::{Config, Env, EnvError, StepError, StepOutcome};
use lanecraft_learn::{
    ActError, Actor, Exploration, Learner, LearnerConfig, LearnerMetadata, NStepQueue, OptionAccumulator, Policy,
    ReplayBuffer, ReplayError, Transition, UpdateError,
};
use lanecraft_net::random::Stream;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::{RunConfig, SeedRole, TrainingConfig};
use crate::metrics::CurvePoint;

/// Why training stopped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError {
    /// A bad setting of the learner.
    #[error(transparent)]
    Config(#[from] lanecraft_learn::ConfigError),
    /// A scenario could not be built.
    #[error(transparent)]
    Env(#[from] EnvError),
    /// The network could not decide.
    #[error(transparent)]
    Act(#[from] ActError),
    /// An action was not allowed.
    #[error(transparent)]
    Step(#[from] StepError),
    /// A transition does not fit the buffer.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// An update failed.
    #[error(transparent)]
    Update(#[from] UpdateError),
    /// A checkpoint that does not fit the configuration.
    #[error(transparent)]
    Checkpoint(#[from] lanecraft_learn::CheckpointError),
    /// A checkpoint of another configuration.
    #[error("the checkpoint is of another shape: expected {expected}, found {found}")]
    OtherShape {
        /// Configured.
        expected: String,
        /// In the checkpoint.
        found: String,
    },
}

/// Training in progress.
#[derive(Debug)]
pub struct Trainer {
    environment: Arc<Config>,
    training: TrainingConfig,
    learner: Learner,
    replay: ReplayBuffer,
    seats: Vec<Seat>,
    decisions: u64,
    updates_owed: u64,
    window: Window,
    /// For those who ask where time goes; nothing depends on it.
    learning_time: Duration,
}

/// An environment with what its running episode carries.
#[derive(Debug)]
struct Seat {
    env: Env,
    /// Number of the episode over all environments.
    episode: u64,
    head: usize,
    actor: Actor,
    option: Option<OptionAccumulator>,
    /// Finished options whose returns are not complete.
    returns: NStepQueue,
    /// Actions since the episode began: with its seed they are the environment's whole state.
    actions: Vec<u8>,
}

/// What is shown of training since the last point of the curve.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Window {
    episodes: u64,
    score_sum: f64,
    speed_sum_mps: f64,
    collisions: u64,
    updates: u64,
    loss_sum: f64,
    decisions: u64,
    agreement_sum: f64,
}

/// The state of a training run, but for the tensors.
///
/// An environment is not written out: its episode's number and the actions since its start give it back, bit for bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingState {
    /// The learner and its buffer.
    pub learner: LearnerMetadata,
    decisions: u64,
    updates_owed: u64,
    window: Window,
    seats: Vec<(u64, Vec<u8>)>,
}

/// What a seat brings back from a tick.
struct SeatTick {
    transitions: Vec<Transition>,
    agreement: Option<f64>,
}

impl Trainer {
    /// A new training run.
    pub fn new(config: &RunConfig) -> Result<Self, TrainError> {
        let environment = Arc::new(config.environment.clone());
        let training = config.training.clone();
        let inputs = environment.observation.size();
        let actions = ActionSet::new(&environment.actions).map_err(EnvError::from)?.len();
        let learner = Learner::new(&config.learner, inputs, actions, training.seed)?;
        let replay = learner.empty_replay();
        let seats =
            (0..training.environments as u64).map(|episode| Seat::start(&environment, &training, &learner, episode));
        let seats = seats.collect::<Result<_, _>>()?;
        Ok(Self {
            environment,
            training,
            learner,
            replay,
            seats,
            decisions: 0,
            updates_owed: 0,
            window: Window::default(),
            learning_time: Duration::ZERO,
        })
    }

    /// Goes on where `state` and its tensors were taken, with the same configuration.
    pub fn resume(config: &RunConfig, state: &TrainingState, tensors: &[u8]) -> Result<Self, TrainError> {
        let mut trainer = Self::new(config)?;
        let expected = (trainer.learner.config(), trainer.environment.observation.size(), trainer.seats.len());
        let found = (&state.learner.config, state.learner.inputs, state.seats.len());
        if expected != found {
            let [expected, found] = [expected, found]
                .map(|(learner, inputs, seats)| format!("{inputs} inputs, {seats} environments and {learner:?}"));
            return Err(TrainError::OtherShape { expected, found });
        }
        (trainer.learner, trainer.replay) = Learner::from_checkpoint(&state.learner, tensors)?;
        trainer.decisions = state.decisions;
        trainer.updates_owed = state.updates_owed;
        trainer.window = state.window.clone();
        for (seat, (episode, actions)) in trainer.seats.iter_mut().zip(&state.seats) {
            *seat = Seat::start(&trainer.environment, &trainer.training, &trainer.learner, *episode)?;
            seat.replay(actions, &trainer.learner)?;
        }
        Ok(trainer)
    }

    /// All that is needed to go on: the state and the bytes of a safetensors file. Equal runs give equal bytes.
    pub fn checkpoint(&self) -> Result<(TrainingState, Vec<u8>), TrainError> {
        let (learner, tensors) = self.learner.to_checkpoint(&self.replay)?;
        let state = TrainingState {
            learner,
            decisions: self.decisions,
            updates_owed: self.updates_owed,
            window: self.window.clone(),
            seats: self.seats.iter().map(|seat| (seat.episode, seat.actions.clone())).collect(),
        };
        Ok((state, tensors))
    }

    /// The network as it is now.
    pub fn policy(&self) -> Policy {
        self.learner.policy()
    }

    /// Decisions taken.
    pub fn decisions(&self) -> u64 {
        self.decisions
    }

    /// Gradient updates made.
    pub fn updates(&self) -> u64 {
        self.learner.updates()
    }

    /// Time spent in updates since this process began with the run.
    pub fn learning_time(&self) -> Duration {
        self.learning_time
    }

    /// Whether all decisions have been taken.
    pub fn is_finished(&self) -> bool {
        self.decisions >= self.training.decisions
    }

    /// One round. Returns a point of the learning curve when one is due.
    pub fn round(&mut self) -> Result<Option<CurvePoint>, TrainError> {
        let before = self.decisions;
        let total = self.training.decisions;
        self.restart_finished()?;
        let policy = self.learner.policy();
        let epsilon = self.learner.epsilon(before, total);
        let streams = self.number_decisions();
        let config = self.learner.config().clone();
        let rate = self.learner.learning_rate(before, total);
        let (seats, learner, replay, owed) = (&mut self.seats, &mut self.learner, &self.replay, self.updates_owed);
        let (ticks, losses) = rayon::join(
            || {
                let tick = |(seat, stream): (&mut Seat, &Option<Stream>)| {
                    seat.drive(&policy, stream.map(|stream| (epsilon, stream)), &config)
                };
                seats.par_iter_mut().zip(&streams).map(tick).collect::<Result<Vec<_>, _>>()
            },
            || {
                let begun = Instant::now();
                let losses: Result<Vec<_>, _> = (0..owed).map(|_| Ok(learner.update(replay, rate)?.loss)).collect();
                (losses, begun.elapsed())
            },
        );
        let (losses, learning_time): (Result<Vec<f64>, UpdateError>, Duration) = losses;
        self.learning_time += learning_time;
        self.store(ticks?)?;
        self.window.count_losses(&losses?);
        let earned = before + 1..=self.decisions;
        self.updates_owed =
            earned.filter(|&decision| self.learner.is_update_due(decision, &self.replay)).count() as u64;
        Ok(self.curve_point(before, epsilon))
    }

    /// Puts a new episode into every seat whose episode is over.
    fn restart_finished(&mut self) -> Result<(), TrainError> {
        let stride = self.seats.len() as u64;
        for seat in self.seats.iter_mut().filter(|seat| seat.env.is_over()) {
            self.window.count_episode(&seat.env);
            *seat = Seat::start(&self.environment, &self.training, &self.learner, seat.episode + stride)?;
        }
        Ok(())
    }

    /// Numbers the decisions of this round in the order of the seats: each number is the key of that decision's random draws.
    fn number_decisions(&mut self) -> Vec<Option<Stream>> {
        let mut streams = Vec::with_capacity(self.seats.len());
        for seat in &self.seats {
            streams.push(seat.env.decision_due().then(|| {
                self.decisions += 1;
                self.learner.exploration_stream(self.decisions)
            }));
        }
        streams
    }

    fn store(&mut self, ticks: Vec<SeatTick>) -> Result<(), TrainError> {
        for tick in ticks {
            self.window.count_agreement(tick.agreement);
            for mut transition in tick.transitions {
                transition.bootstrap_mask = self.learner.bootstrap_mask(self.replay.pushed());
                self.replay.push(&transition)?;
            }
        }
        Ok(())
    }

    /// A point for each `log_every_decisions`, once an episode has ended since the last one.
    fn curve_point(&mut self, before: u64, epsilon: f64) -> Option<CurvePoint> {
        let every = self.training.log_every_decisions;
        if self.decisions / every == before / every || self.window.episodes == 0 {
            return None;
        }
        let window = std::mem::take(&mut self.window);
        let episodes = window.episodes as f64;
        Some(CurvePoint {
            decisions: self.decisions,
            updates: self.learner.updates(),
            reward_per_tick: window.score_sum / episodes,
            speed_mps: window.speed_sum_mps / episodes,
            collisions_per_episode: window.collisions as f64 / episodes,
            loss: window.loss_sum / (window.updates.max(1) as f64),
            agreement: window.agreement_sum / (window.decisions.max(1) as f64),
            epsilon,
        })
    }
}

impl Window {
    fn count_episode(&mut self, env: &Env) {
        let episode = env.episode();
        self.episodes += 1;
        self.score_sum += episode.mean_score();
        self.speed_sum_mps += episode.mean_speed_mps();
        self.collisions += u64::from(episode.collision.is_some());
    }

    fn count_losses(&mut self, losses: &[f64]) {
        self.updates += losses.len() as u64;
        self.loss_sum += losses.iter().sum::<f64>();
    }

    fn count_agreement(&mut self, agreement: Option<f64>) {
        if let Some(agreement) = agreement {
            self.decisions += 1;
            self.agreement_sum += agreement;
        }
    }
}

impl Seat {
    /// A seat at the start of the episode with this number.
    fn start(
        environment: &Arc<Config>,
        training: &TrainingConfig,
        learner: &Learner,
        episode: u64,
    ) -> Result<Self, TrainError> {
        let env = Env::new(environment, SeedRole::Training.scenario_seed(training.seed, episode))?;
        let (head, actor) = (learner.head(episode), Actor::new(learner.policy()));
        let returns = NStepQueue::new(learner.config().n_step);
        Ok(Self { env, episode, head, actor, option: None, returns, actions: Vec::new() })
    }

    /// Drives one tick. With a stream a decision is due and is taken by the seat's head; without, a lane change goes on.
    fn drive(
        &mut self,
        policy: &Policy,
        decision: Option<(f64, Stream)>,
        config: &LearnerConfig,
    ) -> Result<SeatTick, TrainError> {
        let Some((epsilon, mut stream)) = decision else {
            let transitions = self.tick(self.env.actions().continue_action())?;
            return Ok(SeatTick { transitions, agreement: None });
        };
        self.actor.set_policy(policy.clone());
        let (observation, mask) = (self.observation(), self.env.mask().0);
        let agreement = self.actor.greedy(&observation, mask)?.agreement;
        let exploration = Exploration { head: self.head, epsilon };
        let action = self.actor.act(&observation, mask, exploration, &mut stream)?;
        self.option = Some(OptionAccumulator::start(observation, action, config));
        Ok(SeatTick { transitions: self.tick(action)?, agreement: Some(agreement) })
    }

    /// Takes the actions of an interrupted episode again.
    fn replay(&mut self, actions: &[u8], learner: &Learner) -> Result<(), TrainError> {
        for &action in actions {
            if self.env.decision_due() {
                self.option = Some(OptionAccumulator::start(self.observation(), action.into(), learner.config()));
            }
            // Its transitions are in the replay buffer already.
            self.tick(action.into())?;
        }
        Ok(())
    }

    /// Drives one tick and returns the transitions that it completes.
    fn tick(&mut self, action: usize) -> Result<Vec<Transition>, TrainError> {
        let StepOutcome { reward, terminated, .. } = self.env.step(action)?;
        self.actions.push(action as u8);
        if let Some(option) = &mut self.option {
            option.tick(reward.sum());
        }
        let mut complete = Vec::new();
        if let Some(transition) = self.finish_option(terminated) {
            complete.extend(self.returns.push(transition));
        }
        if self.env.is_over() {
            complete.extend(self.returns.flush());
        }
        Ok(complete)
    }

    /// The transition of the running option, if the tick has ended it. One that the time limit cuts off is dropped: the state in the
    /// middle of a lane change is no decision state, so there is nothing to bootstrap from.
    fn finish_option(&mut self, terminated: bool) -> Option<Transition> {
        if !terminated && !self.env.decision_due() {
            return None;
        }
        let option = self.option.take()?;
        Some(option.finish(self.observation(), self.env.mask().0, terminated, 0))
    }

    fn observation(&self) -> Vec<f32> {
        let mut observation = vec![0.0; self.env.config().observation.size()];
        self.env.observe(&mut observation);
        observation
    }
}
