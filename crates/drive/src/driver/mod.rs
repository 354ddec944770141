//! The ego car's mind and what it carries from one step to the next: the path it follows, the plans it weighs, the controllers'
//! warm starts and the counts of everything that did not go as planned.
//!
//! It is handed a [`Scene`] and answers with a [`ControlInput`]; it never sees the world.

mod activity;
mod counts;
mod part;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::config::ConfigError;
use crate::control::{
    ControlConfig, ControlWeights, Guard, GuardCause, LateralMpc, LateralReference, LongitudinalMpc, Rung, SpeedGoal,
};
use crate::decide::{
    ActionMask, ActionSet, ActionsConfig, Decision, Maneuver, ShieldCause, ShieldConfig, check_lane_change,
};
use crate::models::rss::Braking;
use crate::plan::{LaneChangePath, Planner, PlannerConfig, Quintic, Refusal, Window};
use crate::predict::{Forecast, Forecaster, PredictionConfig};
use crate::road::{LaneIndex, Road, Side};
use crate::scene::Scene;
use crate::vehicle::{ControlInput, VehicleParams};

use activity::{Activity, HandedPath};
pub use activity::{Change, PathBounds, PathCommand};
pub use counts::DriverCounts;
pub use part::Part;

/// Everything that shapes a driver.
#[derive(Clone, Debug)]
pub struct DriverSetup<'a> {
    /// The car.
    pub vehicle: &'a VehicleParams,
    /// The planner.
    pub planner: &'a PlannerConfig,
    /// The controllers.
    pub control: &'a ControlConfig,
    /// The action set.
    pub actions: &'a ActionsConfig,
    /// The shield.
    pub shield: &'a ShieldConfig,
    /// The forecast.
    pub prediction: &'a PredictionConfig,
    /// Whether the planner's veto is the action mask (default) or comes after the decision (paper).
    pub plan_first: bool,
    /// Time between two control steps, s.
    pub control_period_s: f64,
}

/// Why a lane change is not on offer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Denial {
    /// The planner finds no path.
    Planner(Refusal),
    /// The shield forbids it.
    Shield(ShieldCause),
}

/// The ego car's mind.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Driver {
    scene: Scene,
    #[serde(skip)]
    forecast: Forecast,
    forecaster: Forecaster,
    planner: Planner,
    shield: ShieldConfig,
    braking: Braking,
    actions: ActionSet,
    plan_first: bool,
    longitudinal: LongitudinalMpc,
    lateral: LateralMpc,
    guard: Guard,
    control_period_s: f64,
    speed_max_mps: f64,
    activity: Activity,
    lane: LaneIndex,
    steps_since_change: u32,
    offers: [Result<Window, Denial>; 2],
    counts: DriverCounts,
    guard_cause: Option<GuardCause>,
}

/// Two paths that end this close to each other end at the same place, m.
const SAME_END_M: f64 = 0.01;
/// The speed handed in with a path is approached with this time constant, s, and at most this acceleration (that of Table II), m/s².
const SPEED_RESPONSE_S: f64 = 2.0;
const HANDED_ACCEL_MPS2: f64 = 2.0;
/// A driver that has just started has not changed lane for this long, in control steps.
const LONG_AGO_STEPS: u32 = 1 << 20;

impl Driver {
    /// A driver in the middle of its lane. `scene` gives the road and the car's size; it is filled by the first perception.
    pub fn new(setup: &DriverSetup, scene: Scene, lane: LaneIndex) -> Result<Self, ConfigError> {
        let nothing =
            ControlWeights { speed_ratio: setup.actions.change_speed_ratio, path_ratio: setup.actions.keep_path_ratio };
        let guard = Guard::new(setup.control, setup.vehicle, setup.control_period_s);
        let braking = guard.braking(&scene);
        Ok(Self {
            scene,
            forecast: Forecast::default(),
            forecaster: Forecaster::new(setup.prediction, setup.control_period_s)?,
            planner: Planner::new(setup.planner, setup.vehicle)?,
            shield: setup.shield.clone(),
            braking,
            actions: ActionSet::new(setup.actions)?,
            plan_first: setup.plan_first,
            longitudinal: LongitudinalMpc::new(setup.control, setup.vehicle, setup.control_period_s),
            lateral: LateralMpc::new(setup.control, setup.vehicle, setup.control_period_s),
            guard,
            control_period_s: setup.control_period_s,
            speed_max_mps: setup.control.speed_max_mps,
            activity: Activity::Keeping { accel_mps2: 0.0, weights: nothing },
            lane,
            steps_since_change: LONG_AGO_STEPS,
            offers: [Err(Denial::Planner(Refusal::NoLane)); 2],
            counts: DriverCounts::default(),
            guard_cause: None,
        })
    }

    /// Makes anew what is not stored with the rest, and shares the road with the world again.
    pub(crate) fn rebuild(&mut self, road: &Arc<Road>) {
        self.scene.road = Arc::clone(road);
        self.lateral.tabulate();
        self.look_ahead();
    }

    /// What the driver knows.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The scene, to be filled by perception.
    pub fn scene_mut(&mut self) -> &mut Scene {
        &mut self.scene
    }

    /// The scene, and the forecast that is to be handed in with it, if the predictor is one that knows what no car can.
    pub fn foretold(&mut self) -> (&Scene, Option<&mut Forecast>) {
        (&self.scene, self.forecaster.handed_in_mut())
    }

    /// The forecast of the last look ahead.
    pub fn forecast(&self) -> &Forecast {
        &self.forecast
    }

    /// What makes the forecasts.
    pub fn forecaster(&self) -> &Forecaster {
        &self.forecaster
    }

    /// The planner.
    pub fn planner(&self) -> &Planner {
        &self.planner
    }

    /// The actions.
    pub fn actions(&self) -> &ActionSet {
        &self.actions
    }

    /// The safe-distance law's parameters.
    pub fn braking(&self) -> &Braking {
        &self.braking
    }

    /// The counts.
    pub fn counts(&self) -> &DriverCounts {
        &self.counts
    }

    /// Why the guard changed the last command, or called off the lane change with it.
    pub fn guard_cause(&self) -> Option<GuardCause> {
        self.guard_cause
    }

    /// The lane change under way, if any.
    pub fn change(&self) -> Option<&Change> {
        match &self.activity {
            Activity::Changing(change) => Some(change),
            _ => None,
        }
    }

    /// The path that is followed, from a decision or handed in, and the time since it began, s.
    pub fn path(&self) -> Option<(&Quintic, f64)> {
        let (quintic, steps) = match &self.activity {
            Activity::Changing(change) => (&change.path.quintic, change.elapsed_steps),
            Activity::Following(path) => (&path.quintic, path.elapsed_steps),
            Activity::Keeping { .. } | Activity::Obeying(_) => return None,
        };
        Some((quintic, f64::from(steps) * self.control_period_s))
    }

    /// The lane the car keeps or changes into: its turn signal.
    pub fn target_lane(&self) -> LaneIndex {
        self.lane
    }

    /// Time since the last lane change ended, s.
    pub fn since_change_s(&self) -> f64 {
        f64::from(self.steps_since_change) * self.control_period_s
    }

    /// The lane change on offer at this tick, or why there is none.
    pub fn offer(&self, side: Side) -> &Result<Window, Denial> {
        &self.offers[side as usize]
    }

    /// Once a tick, before the decision: ends a lane change that has run its course and weighs both sides.
    pub fn consider(&mut self, lap: &mut impl FnMut(Part)) {
        self.finish_change();
        self.braking = self.guard.braking(&self.scene);
        self.look_ahead();
        lap(Part::Forecast);
        if self.change().is_none() {
            for side in Side::BOTH {
                self.offers[side as usize] = self.weigh(side);
            }
        }
        lap(Part::Planner);
    }

    /// Which actions the coming decision may take.
    pub fn mask(&self) -> ActionMask {
        if let Some(change) = self.change() {
            let mask = ActionMask::default().with(self.actions.continue_action());
            return match self.return_path(change) {
                Some(_) if self.plan_first => mask.with(self.actions.abort_action()),
                _ => mask,
            };
        }
        let allowed = |decision: &Decision| match decision.maneuver {
            Maneuver::Keep { .. } => !self.must_change(),
            Maneuver::Change(side) => !self.plan_first || self.offer(side).is_ok(),
            Maneuver::ChangeWhereRoom => !self.plan_first || self.roomier_side().is_some(),
            Maneuver::Continue | Maneuver::Abort => false,
        };
        let decisions = self.actions.decisions().iter().enumerate();
        decisions.filter(|(_, d)| allowed(d)).fold(ActionMask::default(), |mask, (action, _)| mask.with(action))
    }

    /// Whether the lane ends in sight and the way out of it is free: no policy may wait then.
    fn must_change(&self) -> bool {
        self.plan_first && self.scene.way_out().is_some_and(|side| self.offer(side).is_ok())
    }

    /// Takes a decision.
    pub fn decide(&mut self, decision: Decision) {
        match decision.maneuver {
            Maneuver::Keep { accel_mps2 } => {
                self.activity = Activity::Keeping { accel_mps2, weights: decision.weights };
            }
            Maneuver::Change(side) => self.begin_change(Some(side), decision.weights),
            Maneuver::ChangeWhereRoom => self.begin_change(self.roomier_side(), decision.weights),
            Maneuver::Continue => {}
            Maneuver::Abort => {
                self.abort();
            }
        }
    }

    /// The paths that may be handed in on this road.
    pub fn path_bounds(&self) -> PathBounds {
        let (planner, margin_m) = (self.planner.config(), 0.5 * self.scene.ego_width_m);
        let (right_m, left_m) = self.scene.road.edges_m();
        PathBounds {
            low: PathCommand { end_d_m: right_m + margin_m, duration_s: planner.duration_min_s, speed_mps: 0.0 },
            high: PathCommand {
                end_d_m: left_m - margin_m,
                duration_s: planner.duration_max_extended_s,
                speed_mps: self.speed_max_mps,
            },
        }
    }

    /// Takes a path in place of a decision. One that ends where the present one ends changes the speed alone, so that a path can be
    /// handed in again at every tick. Where the lateral bounds allow none (at walking pace), the car stays as it is, and a refusal is
    /// counted.
    ///
    /// # Errors
    /// A number that is not within [`Self::path_bounds`].
    pub fn follow(&mut self, command: &PathCommand) -> Result<(), ConfigError> {
        self.path_bounds().check(command)?;
        if let Activity::Following(path) = &mut self.activity
            && (path.quintic.at(f64::INFINITY).0 - command.end_d_m).abs() < SAME_END_M
        {
            path.speed_mps = command.speed_mps;
            return Ok(());
        }
        let path = self.planner.path_to(&self.scene, command.end_d_m, command.duration_s);
        self.counts.refusals += u32::from(path.is_none());
        let quintic = path.unwrap_or_else(|| Quintic::resting_at(self.reference_d_m()));
        self.lane = self.scene.road.nearest_lane(quintic.at(f64::INFINITY).0);
        self.activity = Activity::Following(HandedPath { quintic, elapsed_steps: 0, speed_mps: command.speed_mps });
        Ok(())
    }

    /// Takes a command of the seat that controls in place of a decision, for as long as no other comes.
    pub fn obey(&mut self, input: ControlInput) {
        self.lane = self.scene.ego_lane;
        self.activity = Activity::Obeying(input);
    }

    /// Where the car should be across the road now, m.
    pub fn reference_d_m(&self) -> f64 {
        self.path().map_or_else(|| self.scene.road.lane_center_m(self.lane), |(path, elapsed_s)| path.at(elapsed_s).0)
    }

    /// One control step: forecast, both controllers (or the command handed in), guard.
    pub fn control(&mut self, lap: &mut impl FnMut(Part)) -> ControlInput {
        self.look_ahead();
        self.forecaster.remember(&self.scene);
        lap(Part::Forecast);
        let wanted = match self.activity {
            Activity::Obeying(input) => input,
            _ => self.controlled(lap),
        };
        let input = self.guarded_input(wanted);
        self.longitudinal.sent(input.accel_mps2);
        self.lateral.sent(input.steer_rad);
        self.guard.sent(input);
        self.count_step();
        lap(Part::Guard);
        input
    }

    /// What both controllers want.
    fn controlled(&mut self, lap: &mut impl FnMut(Part)) -> ControlInput {
        let (goal, weights) = self.goal();
        let speed = self.longitudinal.plan(&self.scene, &self.forecast, &goal, weights.speed_ratio);
        lap(Part::LongitudinalMpc);
        let path = self.path().map(|(quintic, elapsed_s)| (*quintic, elapsed_s));
        let reference = match &path {
            None => LateralReference::LaneCenter { d_m: self.scene.road.lane_center_m(self.lane) },
            Some((Quintic { coefficients, duration_s }, elapsed_s)) => {
                LateralReference::Path { coefficients, duration_s: *duration_s, elapsed_s: *elapsed_s }
            }
        };
        let steer = self.lateral.plan(&self.scene, reference, &speed.speeds_mps, weights.path_ratio);
        lap(Part::LateralMpc);
        self.count_rungs(speed.rung, steer.rung);
        ControlInput { accel_mps2: speed.accel_mps2, steer_rad: steer.steer_rad }
    }

    fn count_step(&mut self) {
        match &mut self.activity {
            Activity::Changing(change) => change.elapsed_steps += 1,
            Activity::Following(path) => path.elapsed_steps = path.elapsed_steps.saturating_add(1),
            Activity::Keeping { .. } | Activity::Obeying(_) => {}
        }
        if self.change().is_none() {
            self.steps_since_change = self.steps_since_change.saturating_add(1);
        }
    }

    fn look_ahead(&mut self) {
        self.forecaster.forecast(&self.scene, &mut self.forecast);
    }

    /// A lane change is an option that ends at the first tick at or after its duration.
    fn finish_change(&mut self) {
        let Activity::Changing(change) = &self.activity else { return };
        let elapsed_s = f64::from(change.elapsed_steps) * self.control_period_s;
        if elapsed_s >= change.path.quintic.duration_s - 1e-9 {
            self.activity = Activity::Keeping { accel_mps2: 0.0, weights: change.weights };
            self.steps_since_change = 0;
        }
    }

    fn weigh(&mut self, side: Side) -> Result<Window, Denial> {
        let window = self.planner.window(&self.scene, &self.forecast, side).map_err(Denial::Planner)?;
        if self.shield.enabled
            && let Err(cause) = check_lane_change(&self.shield, &self.braking, &self.scene, window.to)
        {
            self.counts.shield += 1;
            return Err(Denial::Shield(cause));
        }
        Ok(window)
    }

    /// The side with more room ahead among those on offer; the left one on a tie (the paper does not say which side to take).
    fn roomier_side(&self) -> Option<Side> {
        let room_m = |side| {
            let window = self.offer(side).as_ref().ok()?;
            let leader = self.scene.leader(window.to);
            Some(leader.map_or(f64::INFINITY, |leader| leader.gap_m(self.scene.ego_length_m)))
        };
        match (room_m(Side::Left), room_m(Side::Right)) {
            (Some(left_m), Some(right_m)) if right_m > left_m => Some(Side::Right),
            (None, Some(_)) => Some(Side::Right),
            (Some(_), _) => Some(Side::Left),
            (None, None) => None,
        }
    }

    /// Chooses a path; without one (the paper's order: decide first, plan after) the car keeps its lane and its speed.
    fn begin_change(&mut self, side: Option<Side>, weights: ControlWeights) {
        let window = side.and_then(|side| self.offer(side).as_ref().ok());
        let Some(window) = window else {
            self.counts.refusals += 1;
            self.activity = Activity::Keeping { accel_mps2: 0.0, weights };
            return;
        };
        let path = self.planner.choose(&self.scene, &self.forecast, window);
        self.lane = path.to;
        self.counts.lane_changes += 1;
        let entry_speed_mps = self.scene.ego.speed_mps;
        self.activity = Activity::Changing(Change { path, elapsed_steps: 0, entry_speed_mps, weights, aborted: false });
    }

    fn return_path(&self, change: &Change) -> Option<LaneChangePath> {
        if change.aborted {
            return None;
        }
        self.planner.abort(&self.scene, &change.path, f64::from(change.elapsed_steps) * self.control_period_s)
    }

    /// Turns back; whether that is still possible.
    fn abort(&mut self) -> bool {
        let Activity::Changing(change) = &self.activity else { return false };
        let Some(path) = self.return_path(change) else { return false };
        let (entry_speed_mps, weights) = (change.entry_speed_mps, change.weights);
        self.lane = path.to;
        self.counts.aborts += 1;
        self.activity = Activity::Changing(Change { path, elapsed_steps: 0, entry_speed_mps, weights, aborted: true });
        true
    }

    /// What the speed controller is to aim at: full speed when keeping, the entry speed when changing, the speed handed in with a path,
    /// all within the speed limit.
    fn goal(&self) -> (SpeedGoal, ControlWeights) {
        let (target_speed_mps, reference_accel_mps2, weights) = match &self.activity {
            Activity::Keeping { accel_mps2, weights } => (self.speed_max_mps, *accel_mps2, *weights),
            Activity::Changing(change) => (change.entry_speed_mps + change.path.speed_change_mps, 0.0, change.weights),
            Activity::Following(path) => {
                let wanted_mps2 = (path.speed_mps - self.scene.ego.speed_mps) / SPEED_RESPONSE_S;
                let accel_mps2 = wanted_mps2.clamp(-HANDED_ACCEL_MPS2, HANDED_ACCEL_MPS2);
                (path.speed_mps, accel_mps2, self.actions.plain_weights())
            }
            Activity::Obeying(_) => (self.speed_max_mps, 0.0, self.actions.plain_weights()),
        };
        let allowed_mps = self.scene.road.allowed_speed_mps(self.scene.ego.s_m);
        let target_speed_mps = target_speed_mps.min(allowed_mps);
        let lanes = match self.leaving() {
            Some(from) => [Some(from), Some(self.lane)],
            None => [Some(self.lane), None],
        };
        (SpeedGoal { reference_accel_mps2, target_speed_mps, lanes }, weights)
    }

    /// The lane that the car is still in while it makes for another one.
    fn leaving(&self) -> Option<LaneIndex> {
        match &self.activity {
            Activity::Changing(change) => Some(change.path.from),
            Activity::Following(_) => Some(self.scene.ego_lane).filter(|lane| *lane != self.lane),
            Activity::Keeping { .. } | Activity::Obeying(_) => None,
        }
    }

    /// The guard's word on a command; it may also call off a lane change whose target has become unsafe.
    fn guarded_input(&mut self, wanted: ControlInput) -> ControlInput {
        let leaving = self.leaving();
        let (input, cause) = self.guard.check(&self.scene, [Some(self.lane), leaving], wanted);
        let called_off = leaving.and_then(|from| self.guard.abort_advised(&self.scene, from, self.lane));
        let called_off = called_off.filter(|_| self.abort());
        for cause in [cause, called_off].into_iter().flatten() {
            self.counts.guard[cause as usize] += 1;
        }
        self.guard_cause = cause.or(called_off);
        input
    }

    fn count_rungs(&mut self, speed: Rung, steer: Rung) {
        let worst = speed.max(steer);
        if let Some(index) = (worst as usize).checked_sub(1) {
            self.counts.fallbacks[index] += 1;
        }
    }
}
