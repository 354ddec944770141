//! One tick of the closed loop: decide, then at every control step perceive, predict, plan, control and move (the paper's Fig. 2).
//!
//! There are three seats for others to sit in: one decides once a tick ([`Env::step`]), one hands in a path once a tick
//! ([`Env::step_path`]), one hands in a command at every control step ([`Env::step_control`]).

use super::environment::Env;
use super::episode::time_to_collision_s;
use super::record::TickRecord;
use crate::config::{ConfigError, check_range};
use crate::decide::{ActionMask, Decision, RewardTerms, TickQuality, score};
use crate::driver::{Part, PathCommand};
use crate::vehicle::{Contact, ControlInput};

/// Why a tick cannot be taken.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// The action is masked or does not exist.
    #[error("action {action} is not allowed now (allowed: bits of {:#b})", mask.0)]
    NotAllowed {
        /// The action asked for.
        action: usize,
        /// The allowed ones.
        mask: ActionMask,
    },
    /// The episode has ended.
    #[error("the episode is over; start a new one")]
    Over,
    /// A path or a command that cannot be driven.
    #[error(transparent)]
    OutOfRange(#[from] ConfigError),
}

/// What came of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
#[must_use]
pub struct StepOutcome {
    /// The learner's reward; that of a control step is its share of a tick's.
    pub reward: RewardTerms,
    /// The tick's score, in its fixed form.
    pub score: f64,
    /// A collision ended the episode: nothing follows.
    pub terminated: bool,
    /// The episode reached its length: the future goes on unseen.
    pub truncated: bool,
}

impl Env {
    /// Drives one tick.
    pub fn step(&mut self, action: usize) -> Result<StepOutcome, StepError> {
        self.drive(action, None, &mut |_| ())
    }

    /// Drives one tick and calls `lap` at the end of each part of the loop, so that whoever owns a clock can tell where time goes.
    pub fn step_timed(&mut self, action: usize, lap: &mut impl FnMut(Part)) -> Result<StepOutcome, StepError> {
        self.drive(action, None, lap)
    }

    /// Drives one tick and records it.
    pub fn step_recorded(&mut self, action: usize) -> Result<(StepOutcome, TickRecord), StepError> {
        let mut record = self.begin_record(action);
        let outcome = self.drive(action, Some(&mut record), &mut |_| ())?;
        record.score = outcome.score;
        Ok((outcome, record))
    }

    /// Drives one tick along a path that is handed in.
    pub fn step_path(&mut self, path: &PathCommand) -> Result<StepOutcome, StepError> {
        self.check_open()?;
        self.driver.follow(path)?;
        Ok(self.run(self.periods.control_steps, None, &mut |_| ()))
    }

    /// Drives one control step by a command that is handed in; the guard still has the last word.
    pub fn step_control(&mut self, input: &ControlInput) -> Result<StepOutcome, StepError> {
        self.check_open()?;
        let (low, high) = self.control_bounds();
        check_range("control.accel_mps2", input.accel_mps2, low.accel_mps2, high.accel_mps2)?;
        check_range("control.steer_rad", input.steer_rad, low.steer_rad, high.steer_rad)?;
        self.driver.obey(*input);
        Ok(self.run(1, None, &mut |_| ()))
    }

    /// The smallest and the largest command that may be handed in: the actuators' limits.
    pub fn control_bounds(&self) -> (ControlInput, ControlInput) {
        let (vehicle, control) = (&self.config.vehicle, &self.config.control);
        let low = ControlInput { accel_mps2: -control.emergency_brake_mps2, steer_rad: -vehicle.max_steer_rad };
        (low, ControlInput { accel_mps2: vehicle.max_accel_mps2, steer_rad: vehicle.max_steer_rad })
    }

    fn drive(
        &mut self,
        action: usize,
        mut record: Option<&mut TickRecord>,
        lap: &mut impl FnMut(Part),
    ) -> Result<StepOutcome, StepError> {
        let decision = self.allowed(action)?;
        self.driver.decide(decision);
        if let Some(record) = record.as_deref_mut() {
            self.record_path(record);
        }
        Ok(self.run(self.periods.control_steps, record, lap))
    }

    /// Drives `control_steps` control steps, or as many as there are before a collision.
    fn run(
        &mut self,
        control_steps: u32,
        mut record: Option<&mut TickRecord>,
        lap: &mut impl FnMut(Part),
    ) -> StepOutcome {
        let mut quality = TickQuality::default();
        for _ in 0..control_steps {
            self.perceive();
            lap(Part::Perception);
            let input = self.driver.control(lap);
            let before = self.ego;
            self.move_car(&input);
            lap(Part::Plant);
            let events = self.world.step(self.ego_body(), self.config.env.control_period_s);
            lap(Part::Traffic);
            self.measure(before.accel_mps2, 1.0 / f64::from(control_steps), &mut quality);
            if let Some(record) = record.as_deref_mut() {
                record.frames.push(self.frame());
            }
            if events.collision.is_some() {
                self.episode.collision = events.collision;
                break;
            }
        }
        self.finish(control_steps, quality, lap)
    }

    fn check_open(&self) -> Result<(), StepError> {
        if self.over { Err(StepError::Over) } else { Ok(()) }
    }

    fn allowed(&self, action: usize) -> Result<Decision, StepError> {
        self.check_open()?;
        let decision = self.driver.actions().decode(action).filter(|_| self.mask.allows(action));
        decision.ok_or(StepError::NotAllowed { action, mask: self.mask })
    }

    /// The car moves through one control step, in the plant's own smaller steps.
    fn move_car(&mut self, input: &ControlInput) {
        let before_m = self.ego.s_m;
        for plant_step in 0..self.periods.plant_steps {
            let contact = self.contact(plant_step);
            self.ego = self.plant.step(&self.ego, input, &contact, self.config.env.plant_period_s);
        }
        self.driven_m += self.ego.s_m - before_m;
        self.ego.s_m = self.world.road().wrap_m(self.ego.s_m);
    }

    /// What road and wind do to the car in this plant step of the control step.
    fn contact(&self, plant_step: u32) -> Contact {
        let (road, s_m) = (self.world.road(), self.ego.s_m);
        let steps = self.episode.control_steps * u64::from(self.periods.plant_steps) + u64::from(plant_step);
        let time_s = steps as f64 * self.config.env.plant_period_s;
        let (side_force_n, yaw_moment_nm) = self.config.plant.wind_load(self.ego.speed_mps, time_s);
        Contact { side_force_n, yaw_moment_nm, ..Contact::at(road, s_m) }
    }

    fn measure(&mut self, accel_before_mps2: f64, share: f64, quality: &mut TickQuality) {
        let jerk_mps3 = (self.ego.accel_mps2 - accel_before_mps2).abs() / self.config.env.control_period_s;
        quality.mean_abs_jerk_mps3 += share * jerk_mps3;
        quality.control_quality += share * self.control_quality();
        let episode = &mut self.episode;
        episode.control_steps += 1;
        episode.speed_sum_mps += self.ego.speed_mps;
        episode.jerk_sum_mps3 += jerk_mps3;
        let ttc_s = time_to_collision_s(self.driver.scene());
        episode.min_time_to_collision_s = episode.min_time_to_collision_s.min(ttc_s);
    }

    /// |d − d_ref|/0.5 m + |β|/β_max + |δ|/δ_max.
    fn control_quality(&self) -> f64 {
        let vehicle = &self.config.vehicle;
        let reference_m = self.driver.reference_d_m();
        let sideslip_max_rad = libm::atan(0.02 * self.world.road().adhesion() * 9.81);
        (self.ego.d_m - reference_m).abs() / 0.5
            + self.sideslip_rad().abs() / sideslip_max_rad
            + self.ego.steer_rad.abs() / vehicle.max_steer_rad
    }

    pub(super) fn sideslip_rad(&self) -> f64 {
        if self.ego.speed_mps > 1.0 { libm::atan(self.ego.lateral_speed_mps / self.ego.speed_mps) } else { 0.0 }
    }

    fn finish(&mut self, control_steps: u32, quality: TickQuality, lap: &mut impl FnMut(Part)) -> StepOutcome {
        self.look(lap);
        let terminated = self.episode.collision.is_some();
        self.episode.ticks += 1;
        let score = score(self.driver.scene());
        self.episode.score_sum += score;
        self.episode.counts = *self.driver.counts();
        let length = u64::from(self.periods.ticks) * u64::from(self.periods.control_steps);
        let truncated = !terminated && self.episode.control_steps >= length;
        self.over = terminated || truncated;
        let share = f64::from(control_steps) / f64::from(self.periods.control_steps);
        let reward = self.config.reward.terms(self.driver.scene(), &quality, terminated).over(share);
        StepOutcome { reward, score, terminated, truncated }
    }
}
