//! The longitudinal controller (Eq. 25): model-predictive control of speed and acceleration behind predicted leaders.
//!
//! minimize Σ q_1 (V − V_target)² + (a − a_ref)² + w j², with the state [s, V, a] and the jerk j as input, subject to
//! the bounds of jerk (hard), acceleration and speed, and to a spacing from every leader's *predicted* position (soft,
//! with an exact penalty).
//!
//! Departures from the paper: it bounds the present instant only and weighs P_1 and R_1 = 4 P_1, whose size cancels
//! out; here only q_1 = P_1 / R_1 appears. The goal counts in the first `goal_steps` stages; the rest of the horizon
//! only sees what is ahead, at a_ref = 0: otherwise a plan puts off the approach to a leader to its own end, for ever.
//! The acceleration is that after the drive train, whose lag is inverted exactly in the command. The safe distance is
//! quadratic in the speed and is linearized about the speeds of the plan before. A car that stands with no room ahead
//! is held without a solve. By choice the plan begins where the commands on their way through the drive train's delay
//! will have led, and a constant disturbance (a grade) and an offset of the drive train (an unknown mass) are
//! estimated and compensated. The adhesion that counts is the lowest within reach of the brakes.

use lanecraft_qp::{Problem, Row, Solver, Start};
use serde::{Deserialize, Serialize};
use serde_big_array::BigArray;

use crate::control::config::{ControlConfig, MAX_HORIZON, has_one_grip};
use crate::control::delay::SentCommands;
use crate::control::observer::SpeedObserver;
use crate::control::verdict::{Rung, SolveSummary};
use crate::models::rss::{Braking, safe_gap};
use crate::predict::Forecast;
use crate::road::{LaneIndex, Road};
use crate::scene::{Neighbor, Scene};
use crate::vehicle::{VehicleParams, lag_response, lagged};

/// What the decision asks of the speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedGoal {
    /// a_ref, m/s².
    pub reference_accel_mps2: f64,
    /// Speed whose error is weighed, m/s: V_max when keeping, the entry speed when changing.
    pub target_speed_mps: f64,
    /// Lanes whose leaders bound the spacing.
    pub lanes: [Option<LaneIndex>; 2],
}

/// Points of a speed profile.
pub const SPEED_POINTS: usize = MAX_HORIZON + 1;

/// The longitudinal controller's answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedPlan {
    /// Acceleration to command now, m/s².
    pub accel_mps2: f64,
    /// Planned jerk of the car, m/s³.
    pub jerk_mps3: f64,
    /// Planned speeds, m/s: the first one now, then one for each longitudinal step; constant beyond the horizon.
    pub speeds_mps: [f64; SPEED_POINTS],
    /// Where the answer comes from.
    pub rung: Rung,
    /// How the solve went.
    pub solve: SolveSummary,
}

// States and rows of the problem.
const SPACING: usize = 0;
const SAFETY: usize = 1;
const SPEED: usize = 2;
const ACCEL: usize = 3;
/// A car above V_max comes back to it at this rate, m/s².
const SPEED_RETURN_MPS2: f64 = 1.0;
/// Who must leave a lane slows down to a crawl this far before its end, m, at this rate, m/s²: a change at this speed, m/s, takes some
/// 20 m, and the others get some ten seconds to make room.
const CRAWL_ROOM_M: f64 = 60.0;
const LEAVING_DECEL_MPS2: f64 = 1.5;
const CRAWL_SPEED_MPS: f64 = 3.5;
/// A car this slow stands, m/s.
const STANDING_SPEED_MPS: f64 = 0.05;
/// It stays while its leader is nearer than the spacing, and while there is less than this to gain, m, behind a leader
/// slower than the next figure.
const STANDING_ROOM_M: f64 = 1.0;
const STANDING_LEADER_MPS: f64 = 0.5;
/// The brake of a standing car, m/s².
const STANDING_BRAKE_MPS2: f64 = -1.0;
/// Preview of the feedback law, s.
const FEEDBACK_PREVIEW_S: f64 = 2.0;
/// The plan before is a fair guess of this one's speeds if it starts this close, m/s.
const GUESS_TOLERANCE_MPS: f64 = 1.0;

/// The longitudinal controller with its warm start and last plan: a clone goes on exactly as the original.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LongitudinalMpc {
    config: ControlConfig,
    period_s: f64,
    /// Share of the way to its command that the drive train covers in a control period.
    response: f64,
    drive_lag_s: f64,
    sent: SentCommands,
    observer: SpeedObserver,
    problem: Problem<3, 4>,
    solver: Solver<3, 4>,
    plan: LastPlan,
    /// Lowest acceleration on this road: the controller's own limit, or what the adhesion leaves, m/s².
    lowest_mps2: f64,
    /// Lowest speed of the plan, m/s.
    speed_lower_mps: f64,
}

/// The last solved plan.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct LastPlan {
    /// Control steps since it was made; more than may be bridged if there is none.
    age: usize,
    #[serde(with = "BigArray")]
    jerks_mps3: [f64; MAX_HORIZON],
    #[serde(with = "BigArray")]
    speeds_mps: [f64; SPEED_POINTS],
    /// The last acceleration asked of the car, for the case that its own is unknown, m/s².
    accel_mps2: f64,
}

impl LongitudinalMpc {
    /// A controller for this car; both must be valid. `control_period_s`: time between two calls of [`Self::plan`].
    pub fn new(config: &ControlConfig, params: &VehicleParams, control_period_s: f64) -> Self {
        let horizon = usize::from(config.longitudinal_horizon);
        let delay_s = if config.delay_compensation { params.drive_delay_s } else { 0.0 };
        let mut mpc = Self {
            config: config.clone(),
            period_s: control_period_s,
            response: lag_response(params.drive_lag_s, control_period_s),
            drive_lag_s: params.drive_lag_s,
            sent: SentCommands::new(delay_s, control_period_s),
            observer: SpeedObserver::new(config.observer_time_s, control_period_s, params.drive_lag_s),
            problem: Problem::new(horizon),
            solver: Solver::new(horizon),
            plan: LastPlan {
                age: usize::MAX,
                jerks_mps3: [0.0; MAX_HORIZON],
                speeds_mps: [0.0; SPEED_POINTS],
                accel_mps2: 0.0,
            },
            lowest_mps2: config.accel_min_mps2,
            speed_lower_mps: if config.speed_floor { config.speed_min_mps } else { 0.0 },
        };
        mpc.set_constants();
        mpc
    }

    /// Everything that no scene changes: dynamics, weights and the rows of speed and acceleration.
    fn set_constants(&mut self) {
        let config = &self.config;
        let h = config.longitudinal_step_s;
        (self.problem.input_min, self.problem.input_max) = (-config.jerk_max_mps3, config.jerk_max_mps3);
        let floor_weights = if config.speed_floor {
            (0.01 * config.spacing_l1_weight, 0.01 * config.spacing_l2_weight)
        } else {
            (config.limit_l1_weight, config.limit_l2_weight)
        };
        for stage in &mut self.problem.stages {
            stage.a = [[1.0, h, 0.5 * h * h], [0.0, 1.0, h], [0.0, 0.0, 1.0]];
            stage.b = [h * h * h / 6.0, 0.5 * h * h, h];
            stage.input_weight = config.jerk_weight_s2;
            // Limits of the state after the step, with the dynamics put in.
            stage.rows[SPEED] = Row {
                state: stage.a[1],
                input: stage.b[1],
                lower: self.speed_lower_mps,
                upper: f64::INFINITY,
                l1_weight: floor_weights.0,
                l2_weight: floor_weights.1,
            };
            stage.rows[ACCEL] = Row {
                state: stage.a[2],
                input: stage.b[2],
                lower: self.lowest_mps2,
                upper: config.accel_max_mps2,
                l1_weight: config.limit_l1_weight,
                l2_weight: config.limit_l2_weight,
            };
            for row in [SPACING, SAFETY] {
                stage.rows[row].l1_weight = config.spacing_l1_weight;
                stage.rows[row].l2_weight = config.spacing_l2_weight;
            }
        }
    }

    /// Plans from this scene; `forecast` must have been made for it. `speed_ratio` is q_1.
    ///
    /// Answers on every input: what cannot be solved goes down the ladder of [`Rung`].
    pub fn plan(&mut self, scene: &Scene, forecast: &Forecast, goal: &SpeedGoal, speed_ratio: f64) -> SpeedPlan {
        let now_mps = scene.ego.road_speed_mps();
        if self.stays(scene, goal, now_mps) {
            return self.hold();
        }
        self.lowest_mps2 = self.lowest_at(&scene.road, scene.ego.s_m, now_mps);
        if self.config.observer {
            let limits = (self.lowest_mps2, self.config.accel_max_mps2);
            self.observer.observe(now_mps, scene.ego.accel_mps2, &self.sent, limits);
        }
        let [_, speed_mps, accel_mps2] = self.begin(now_mps, scene.ego.accel_mps2);
        self.set_goal(goal, speed_ratio);
        self.set_speed_limit(scene, goal);
        if !has_one_grip(&scene.road) {
            self.set_grip(scene);
        }
        self.set_spacing(scene, forecast, goal, speed_mps);
        let start = if self.plan.age == 0 { Start::Shifted(0) } else { Start::Cold };
        let summary = SolveSummary::new(&self.solver.solve(&self.problem, start));
        let (rung, jerk_mps3) = if summary.solved {
            self.keep_plan(speed_mps);
            (Rung::Solved, self.plan.jerks_mps3[0])
        } else {
            self.fall_back(scene, goal)
        };
        self.answer(speed_mps, accel_mps2, jerk_mps3, rung, summary)
    }

    /// The states [s, V, a] of the last plan, one at the end of each stage, s from here; none if it was not solved for.
    pub fn planned_states(&self) -> Option<&[[f64; 3]]> {
        (self.plan.age == 0).then(|| self.solver.states())
    }

    /// The drive train is sent this command in place of the one of the last plan.
    pub fn sent(&mut self, accel_mps2: f64) {
        self.sent.amend(accel_mps2);
    }

    /// Lowest acceleration that the road at `s_m` allows the tires at this speed, m/s².
    fn lowest_at(&self, road: &Road, s_m: f64, speed_mps: f64) -> f64 {
        self.config.accel_min_mps2.max(-self.config.brake_at_mps2(road, s_m, speed_mps))
    }

    /// Sets the plan's initial state: distance from here, speed and acceleration when a command of now will count.
    fn begin(&mut self, mut speed: f64, mut accel: f64) -> [f64; 3] {
        let mut travelled = 0.0;
        let outside = self.observer.accel_mps2();
        for (time_s, command) in self.sent.under_way() {
            let target = command + self.observer.drive_mps2();
            let gained = target * time_s + (accel - target) * self.drive_lag_s * lag_response(self.drive_lag_s, time_s);
            let next = speed + gained + outside * time_s;
            // Written so that NaN gets in, for the solver to refuse.
            let next = if next < 0.0 { 0.0 } else { next };
            travelled += 0.5 * (speed + next) * time_s;
            speed = next;
            accel = lagged(accel, target, self.drive_lag_s, f64::INFINITY, time_s);
        }
        let h = self.config.longitudinal_step_s;
        for stage in &mut self.problem.stages {
            stage.c = [0.5 * h * h * outside, h * outside, 0.0];
        }
        self.problem.initial_state = [travelled, speed, accel];
        self.problem.initial_state
    }

    /// Whether the car stands with no room ahead: every limit of the problem meets in that point, and there is nothing
    /// to plan.
    fn stays(&self, scene: &Scene, goal: &SpeedGoal, speed_mps: f64) -> bool {
        let room_m = self.config.spacing_min_m + STANDING_ROOM_M;
        speed_mps.abs() < STANDING_SPEED_MPS
            && goal.lanes.into_iter().flatten().any(|lane| {
                scene.leader(lane).is_some_and(|leader| {
                    let gap_m = leader.gap_m(scene.ego_length_m);
                    gap_m < self.config.spacing_min_m || gap_m < room_m && leader.speed_mps < STANDING_LEADER_MPS
                })
            })
    }

    fn hold(&mut self) -> SpeedPlan {
        self.plan.age = usize::MAX;
        self.plan.accel_mps2 = 0.0;
        self.sent.push(STANDING_BRAKE_MPS2);
        self.observer.interrupt();
        SpeedPlan {
            accel_mps2: STANDING_BRAKE_MPS2,
            jerk_mps3: 0.0,
            speeds_mps: [0.0; SPEED_POINTS],
            rung: Rung::Solved,
            solve: SolveSummary { solved: true, ..SolveSummary::default() },
        }
    }

    fn set_goal(&mut self, goal: &SpeedGoal, speed_ratio: f64) {
        let config = &self.config;
        let pursued = usize::from(config.goal_steps);
        for (k, stage) in self.problem.stages.iter_mut().enumerate() {
            let tail = k >= pursued;
            let (ratio, reference_mps2) = if tail { (0.0, 0.0) } else { (speed_ratio, goal.reference_accel_mps2) };
            // The tires push for the decision and against what acts from outside.
            let reference_mps2 = reference_mps2 - self.observer.accel_mps2();
            stage.state_weight = [0.0, ratio, 1.0];
            stage.state_reference = [0.0, goal.target_speed_mps, reference_mps2];
            stage.rows[ACCEL].lower = self.lowest_mps2;
            stage.rows[SPEED].lower = self.speed_lower_mps - stage.c[1];
        }
    }

    /// Bounds each stage by the speed allowed where the car will be at its present speed, and by that from which it can still change
    /// out of a lane that ends; a car above comes back gently.
    fn set_speed_limit(&mut self, scene: &Scene, goal: &SpeedGoal) {
        let [travelled_m, speed_mps, _] = self.problem.initial_state;
        let end_m = match goal.lanes {
            [Some(kept), None] => scene.lane_end_ahead_m(kept),
            _ => f64::INFINITY,
        };
        for (k, stage) in self.problem.stages.iter_mut().enumerate() {
            let time_s = (k + 1) as f64 * self.config.longitudinal_step_s;
            let ahead_m = travelled_m + speed_mps * time_s;
            let allowed_mps = self.config.speed_max_mps.min(scene.road.allowed_speed_mps(scene.ego.s_m + ahead_m));
            let allowed_mps = allowed_mps.max(speed_mps - SPEED_RETURN_MPS2 * time_s);
            let leaving_mps = leaving_speed_mps(end_m - ahead_m).max(speed_mps - 2.0 * LEAVING_DECEL_MPS2 * time_s);
            stage.rows[SPEED].upper = allowed_mps.min(leaving_mps) - stage.c[1];
        }
    }

    /// Bounds each stage by the adhesion of where the car will be at its present speed.
    fn set_grip(&mut self, scene: &Scene) {
        let [travelled_m, speed_mps, _] = self.problem.initial_state;
        for k in 0..self.problem.stages.len() {
            let ahead_m = travelled_m + speed_mps * k as f64 * self.config.longitudinal_step_s;
            self.problem.stages[k].rows[ACCEL].lower = self.lowest_at(&scene.road, scene.ego.s_m + ahead_m, speed_mps);
        }
    }

    fn set_spacing(&mut self, scene: &Scene, forecast: &Forecast, goal: &SpeedGoal, speed_mps: f64) {
        for stage in &mut self.problem.stages {
            stage.rows[SPACING].upper = f64::INFINITY;
            stage.rows[SAFETY].upper = f64::INFINITY;
        }
        let mut done = None;
        for lane in goal.lanes.into_iter().flatten() {
            let Some(index) = scene.leader_index(lane) else { continue };
            if done != Some(index) {
                self.bound_by_leader(&scene.neighbors[index], forecast, index, scene, speed_mps);
            }
            done = Some(index);
        }
    }

    /// Tightens the spacing rows by one leader.
    fn bound_by_leader(&mut self, leader: &Neighbor, forecast: &Forecast, index: usize, scene: &Scene, speed_mps: f64) {
        let config = &self.config;
        let bumpers_m = 0.5 * (leader.length_m + scene.ego_length_m);
        let braking = config.braking_on(&scene.road, scene.ego.s_m, speed_mps).braking;
        let delay_s = self.sent.delay_s();
        let braking = Braking { reaction_s: braking.reaction_s + delay_s, ..braking.behind(leader.accel_mps2) };
        let headway_s = config.spacing_headway_s;
        let spacing_m = config.spacing_min_m + headway_s * speed_mps;
        let lost_m = (spacing_m - (leader.ahead_m - bumpers_m)).max(0.0);
        let guessed = self.plan.age == 0 && (self.plan.speeds_mps[0] - speed_mps).abs() < GUESS_TOLERANCE_MPS;
        for (k, stage) in self.problem.stages.iter_mut().enumerate() {
            let time_s = (k + 1) as f64 * config.longitudinal_step_s;
            let then = forecast.at(index, delay_s + time_s);
            let free_m = then.ahead_m - bumpers_m;
            let forgiven_m = lost_m * (1.0 - time_s / config.spacing_recovery_s).max(0.0);
            let bound_m = free_m - config.spacing_min_m + forgiven_m;
            let guess_mps = if guessed { self.plan.speeds_mps[k + 1] } else { speed_mps };
            let added_m = stage.c[0] + headway_s * stage.c[1];
            tighten(&mut stage.rows[SPACING], (&stage.a, &stage.b), (headway_s, bound_m - added_m), guess_mps);
            if config.safe_spacing {
                let (slope_s, at_rest_m) = safe_line(guess_mps, then.speed_mps, &braking);
                let added_m = stage.c[0] + slope_s * stage.c[1];
                let bound_m = free_m - config.safe_spacing_extra_m - at_rest_m - added_m;
                tighten(&mut stage.rows[SAFETY], (&stage.a, &stage.b), (slope_s, bound_m), guess_mps);
            }
        }
    }

    fn keep_plan(&mut self, speed_mps: f64) {
        let plan = &mut self.plan;
        plan.age = 0;
        plan.speeds_mps[0] = speed_mps;
        let mut last = speed_mps;
        for (k, slot) in plan.speeds_mps[1..].iter_mut().enumerate() {
            if let Some(state) = self.solver.states().get(k) {
                last = state[1].max(0.0);
            }
            *slot = last;
        }
        for (slot, jerk) in plan.jerks_mps3.iter_mut().zip(self.solver.inputs()) {
            *slot = *jerk;
        }
    }

    /// The ladder below the optimum: a rung and a jerk.
    fn fall_back(&mut self, scene: &Scene, goal: &SpeedGoal) -> (Rung, f64) {
        let config = &self.config;
        let [_, v, a] = self.problem.initial_state;
        self.plan.age = self.plan.age.saturating_add(1);
        if !v.is_finite() {
            return (Rung::FullBrake, -config.emergency_jerk_mps3);
        }
        if self.plan.age <= usize::from(config.shifted_plan_steps) {
            let stage = (self.plan.age as f64 * self.period_s / config.longitudinal_step_s) as usize;
            return (Rung::ShiftedPlan, self.plan.jerks_mps3[stage.min(usize::from(config.longitudinal_horizon) - 1)]);
        }
        let wanted = self.feedback_accel_mps2(scene, goal, v);
        if !wanted.is_finite() || !a.is_finite() {
            return (Rung::BrakeInLane, -config.jerk_max_mps3);
        }
        let jerk = (wanted - a) / config.longitudinal_step_s;
        (Rung::FeedbackLaw, jerk.clamp(-config.jerk_max_mps3, config.jerk_max_mps3))
    }

    /// The reference acceleration, cut so that the spacing is kept after the preview time and V_max is not passed; NaN
    /// if a leader is.
    fn feedback_accel_mps2(&self, scene: &Scene, goal: &SpeedGoal, v: f64) -> f64 {
        let config = &self.config;
        let t = FEEDBACK_PREVIEW_S;
        let outside = self.observer.accel_mps2();
        let mut accel = goal.reference_accel_mps2;
        let mut cut = |bound: f64| accel = if bound < accel || bound.is_nan() { bound } else { accel };
        cut((config.speed_max_mps.min(scene.road.allowed_speed_mps(scene.ego.s_m)) - v) / t);
        for lane in goal.lanes.into_iter().flatten() {
            if let Some(leader) = scene.leader(lane) {
                let spare_m = leader.gap_m(scene.ego_length_m) - config.spacing_min_m - config.spacing_headway_s * v;
                cut(2.0 * (spare_m + (leader.speed_mps - v) * t) / (t * t));
            }
        }
        if accel.is_nan() { accel } else { (accel - outside).clamp(self.lowest_mps2, config.accel_max_mps2) }
    }

    /// The command that gives the car the planned jerk for one control period.
    fn answer(&mut self, speed: f64, accel: f64, jerk: f64, rung: Rung, solve: SolveSummary) -> SpeedPlan {
        let config = &self.config;
        let now = if accel.is_finite() { accel } else { self.plan.accel_mps2 };
        let (lowest, highest) = (self.lowest_mps2, config.accel_max_mps2);
        let command = if rung == Rung::FullBrake {
            -config.emergency_brake_mps2
        } else {
            (now + jerk * self.period_s / self.response - self.observer.drive_mps2()).clamp(lowest, highest)
        };
        self.sent.push(command);
        self.plan.accel_mps2 = (now + jerk * self.period_s).clamp(lowest, highest);
        let speeds_mps = if rung == Rung::Solved {
            self.plan.speeds_mps
        } else {
            [if speed.is_finite() { speed.max(0.0) } else { 0.0 }; SPEED_POINTS]
        };
        SpeedPlan { accel_mps2: command, jerk_mps3: jerk, speeds_mps, rung, solve }
    }
}

/// The largest speed so far before the end of a lane that must be left: down to a crawl in time, for a car that stands cannot change
/// lane any more. Infinite without an end.
fn leaving_speed_mps(end_ahead_m: f64) -> f64 {
    let room_m = (end_ahead_m - CRAWL_ROOM_M).max(0.0);
    (CRAWL_SPEED_MPS * CRAWL_SPEED_MPS + 2.0 * LEAVING_DECEL_MPS2 * room_m).sqrt()
}

/// Slope and value at standstill of the safe gap's tangent in the ego's speed. The acceleration counts as zero: the
/// plan changes it.
fn safe_line(guess_mps: f64, leader_speed_mps: f64, braking: &Braking) -> (f64, f64) {
    let safe = safe_gap(guess_mps, 0.0, leader_speed_mps, braking);
    (safe.slope_s, safe.gap_m - safe.slope_s * guess_mps)
}

/// Makes `row` the limit s + slope V ≤ bound after the step, if that is tighter at the guessed speed than what it
/// holds.
fn tighten(row: &mut Row<3>, (a, b): (&[[f64; 3]; 3], &[f64; 3]), (slope_s, bound_m): (f64, f64), guess_mps: f64) {
    let held_slope_s = row.state[1] - a[0][1];
    // Written so that NaN gets in, for the solver to refuse.
    if bound_m - slope_s * guess_mps >= row.upper - held_slope_s * guess_mps {
        return;
    }
    row.upper = bound_m;
    for (coefficient, (position, speed)) in row.state.iter_mut().zip(a[0].iter().zip(&a[1])) {
        *coefficient = position + slope_s * speed;
    }
    row.input = b[0] + slope_s * b[1];
}
