//! The lateral controller (Eq. 26): model-predictive path tracking within the limits of lateral stability.
//!
//! minimize Σ P_21 (φ − φ_ref)² + P_22 (Y − Y_ref)² + R_2 δ² + w R_2 Δδ², with P_22 = 10 P_21 and q_2 = P_21 / R_2,
//! subject to the bounds of Δδ (hard) and of δ, yaw rate and both slip angles (soft). The state is [d, V_y, φ, γ, δ]
//! and the input Δδ.
//!
//! Departures from the paper: the model follows the planned speed along the horizon and is discretized by zero-order
//! hold; steering lag, road curvature (with its steady steering angle and sideslip as references) and a small cost of Δδ
//! are added. Cost and slack weights are divided by P_21, so that the slack weights mean the same at every q_2. At low
//! speed R_2 falls and the reference is approached no more steeply than the car can go. By choice the plan begins where
//! the commands on their way through the steering's delay will have led, constant disturbances are estimated and their
//! steady states added to the references, so that they leave no offset, and what lies beyond the horizon is weighed: by the last
//! stage or by the cost-to-go of the regulator without constraints.

use std::sync::Arc;

use lanecraft_qp::{Problem, Row, Solver, Start, infinite_horizon_weight};
use serde::{Deserialize, Serialize};
use serde_big_array::BigArray;

use crate::control::classical::Steady;
use crate::control::config::{ControlConfig, HeadingReference, MAX_HORIZON, TerminalCost};
use crate::control::delay::SentCommands;
use crate::control::observer::LateralObserver;
use crate::control::verdict::{Rung, SolveSummary};
use crate::scene::Scene;
use crate::vehicle::bicycle::{DiscreteBicycle, steady_sideslip_rad, steady_steer_rad};
use crate::vehicle::tire::{GRAVITY_MPS2, slip_angles_rad, slip_limits_rad};
use crate::vehicle::{VehicleParams, VehicleState, lag_response, lagged};

/// Where the car is to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LateralReference<'a> {
    /// On a line of constant d.
    LaneCenter {
        /// Lateral position, m.
        d_m: f64,
    },
    /// On a lane-change path: d(t) = Σ c_i t^i until its duration, constant afterwards.
    Path {
        /// c_0 to c_5, m, m/s, … m/s⁵.
        coefficients: &'a [f64; 6],
        /// Duration t_c, s.
        duration_s: f64,
        /// Time since the path began, s.
        elapsed_s: f64,
    },
}

impl LateralReference<'_> {
    /// (d, ḋ) `ahead_s` from now.
    fn at(&self, ahead_s: f64) -> (f64, f64) {
        match *self {
            Self::LaneCenter { d_m } => (d_m, 0.0),
            Self::Path { coefficients: c, duration_s, elapsed_s } => {
                let beyond = elapsed_s + ahead_s >= duration_s;
                let t = if beyond { duration_s } else { elapsed_s + ahead_s };
                let d_m = c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
                let rate = c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * (4.0 * c[4] + t * 5.0 * c[5])));
                (d_m, if beyond { 0.0 } else { rate })
            }
        }
    }
}

/// The lateral controller's answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteerPlan {
    /// Road-wheel angle to command now, rad.
    pub steer_rad: f64,
    /// Where the answer comes from.
    pub rung: Rung,
    /// How the solve went.
    pub solve: SolveSummary,
    /// Present front slip angle over the slip limit of Eq. 26 (untightened).
    pub front_slip_use: f64,
    /// Present rear slip angle over its limit.
    pub rear_slip_use: f64,
    /// Present yaw rate over μ g / V.
    pub yaw_rate_use: f64,
}

const YAW_RATE: usize = 0;
const FRONT_SLIP: usize = 1;
const REAR_SLIP: usize = 2;
const STEER: usize = 3;
/// P_22 / P_21 (Eq. 26).
const POSITION_TO_HEADING: f64 = 10.0;
/// Range of q_2; beyond it the problem is that of the nearer end to rounding.
const PATH_RATIO_RANGE: (f64, f64) = (1e-8, 1e8);
/// The model holds from this speed on; below, the car is steered as at this speed, m/s.
const MODEL_SPEED_MIN_MPS: f64 = 2.0;
/// Below this speed R_2 falls with the square of the speed, m/s: a slow car must steer far, and with a constant R_2 it misses its
/// lane. The paper's speeds lie above.
const STEER_COST_SPEED_MPS: f64 = 15.0;
/// Steepest way to the reference, m/m: a path in time asks a car that has to slow down in it to go sideways.
const SLOPE_MAX: f64 = 0.25;
/// A car slower than this keeps its wheel where it is, m/s: turning it would not move the car sideways.
const STEERING_SPEED_MPS: f64 = 0.5;
const MODEL_SPEED_MAX_MPS: f64 = 60.0;
/// Distance of the tabulated speeds, m/s: interpolated matrices are within 1e-4 of the exact ones from 15 m/s on.
const MODEL_SPEED_STEP_MPS: f64 = 0.25;
/// Below this speed the plant passes over to rolling without slip, which is no disturbance, m/s.
const OBSERVED_SPEED_MIN_MPS: f64 = 10.0;
/// Natural frequency of the critically damped feedback law, rad/s.
const FEEDBACK_FREQUENCY_RADPS: f64 = 1.2;

/// The lateral controller with its warm start and last plan: a clone goes on exactly as the original.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LateralMpc {
    config: ControlConfig,
    params: VehicleParams,
    period_s: f64,
    /// Share of the way to its command that the steering covers in a control period.
    response: f64,
    /// The model at the tabulated speeds; clones share it, and it is not stored.
    #[serde(skip)]
    models: Arc<[DiscreteBicycle]>,
    /// The same for the part of the steering's delay that is no whole control period; empty if there is none.
    #[serde(skip)]
    rest_models: Arc<[DiscreteBicycle]>,
    sent: SentCommands,
    observer: LateralObserver,
    /// Where the plan begins: how long from now, s, and how far along the road, m.
    start: (f64, f64),
    tail: Tail,
    problem: Problem<5, 4>,
    solver: Solver<5, 4>,
    /// Control steps since the last solved plan.
    plan_age: usize,
    #[serde(with = "BigArray")]
    planned_changes_rad: [f64; MAX_HORIZON],
    last_steer_rad: f64,
}

/// The last cost-to-go that was asked for, less the cost of the last stage, and what it was asked for.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Tail {
    speed_mps: f64,
    steer_cost: f64,
    weight: [[f64; 5]; 5],
}

/// The limits of Eq. 26 on this road.
#[derive(Clone, Copy)]
struct StabilityLimits {
    front_slip_rad: f64,
    rear_slip_rad: f64,
    /// Bound of the lateral acceleration V γ, m/s².
    yaw_accel_mps2: f64,
}

impl LateralMpc {
    /// A controller for this car; both must be valid. `control_period_s`: time between two calls of [`Self::plan`] and
    /// length of a stage.
    pub fn new(config: &ControlConfig, params: &VehicleParams, control_period_s: f64) -> Self {
        let horizon = usize::from(config.lateral_horizon);
        let response = lag_response(params.steer_lag_s, control_period_s);
        let delay_s = if config.delay_compensation { params.steer_delay_s } else { 0.0 };
        let sent = SentCommands::new(delay_s, control_period_s);
        let mut problem = Problem::new(horizon);
        // With lag the rate is highest at the start of a step, Δδ / (T (1 − e^(−h/T))).
        let change_rad = params.max_steer_rate_radps
            * if params.steer_lag_s > 0.0 { params.steer_lag_s * response } else { control_period_s };
        (problem.input_min, problem.input_max) = (-change_rad, change_rad);
        let mut mpc = Self {
            config: config.clone(),
            params: params.clone(),
            period_s: control_period_s,
            response,
            models: Arc::default(),
            rest_models: Arc::default(),
            sent,
            observer: LateralObserver::new(config.observer_time_s, control_period_s),
            start: (0.0, 0.0),
            tail: Tail { speed_mps: f64::NAN, steer_cost: f64::NAN, weight: [[0.0; 5]; 5] },
            problem,
            solver: Solver::new(horizon),
            plan_age: usize::MAX,
            planned_changes_rad: [0.0; MAX_HORIZON],
            last_steer_rad: 0.0,
        };
        mpc.tabulate();
        mpc
    }

    /// Makes the tables of models, which are not stored with the rest.
    pub(crate) fn tabulate(&mut self) {
        self.models = models(&self.params, self.period_s);
        let rest_s = self.sent.rest_s();
        self.rest_models = if rest_s > 0.0 { models(&self.params, rest_s) } else { Arc::default() };
    }

    /// Plans from this scene along `reference`. `speeds_mps`: the speed profile of the longitudinal controller, one
    /// point for each longitudinal step, the first one now. `path_ratio` is q_2.
    ///
    /// Answers on every input: what cannot be solved goes down the ladder of [`Rung`].
    pub fn plan(
        &mut self,
        scene: &Scene,
        reference: LateralReference<'_>,
        speeds_mps: &[f64],
        path_ratio: f64,
    ) -> SteerPlan {
        let ego = &scene.ego;
        if ego.speed_mps < STEERING_SPEED_MPS {
            self.plan_age = usize::MAX;
            self.observer.interrupt();
            self.problem.initial_state[4] = ego.steer_rad;
            let solve = SolveSummary { solved: true, ..SolveSummary::default() };
            return self.answer(scene, Rung::Solved, 0.0, solve);
        }
        let state = [ego.d_m, ego.lateral_speed_mps, ego.heading_rad, ego.yaw_rate_radps, ego.steer_rad];
        if self.config.observer {
            self.observe(&state, ego.speed_mps);
        }
        self.begin(scene, state);
        self.set_stages(scene, reference, speeds_mps, path_ratio);
        let start = if self.plan_age == 0 { Start::Shifted(1) } else { Start::Cold };
        let solve = SolveSummary::new(&self.solver.solve(&self.problem, start));
        let (rung, change_rad) = if solve.solved {
            self.plan_age = 0;
            for (slot, change) in self.planned_changes_rad.iter_mut().zip(self.solver.inputs()) {
                *slot = *change;
            }
            (Rung::Solved, self.planned_changes_rad[0])
        } else {
            self.fall_back(scene, reference)
        };
        self.answer(scene, rung, change_rad, solve)
    }

    /// The states [d, `V_y`, φ, γ, δ] of the last plan, one at the end of each stage; none if it was not solved for.
    pub fn planned_states(&self) -> Option<&[[f64; 5]]> {
        (self.plan_age == 0).then(|| self.solver.states())
    }

    /// The steering is sent this command in place of the one of the last plan.
    pub fn sent(&mut self, steer_rad: f64) {
        self.sent.amend(steer_rad);
    }

    fn observe(&mut self, state: &[f64; 5], speed_mps: f64) {
        if (OBSERVED_SPEED_MIN_MPS..=MODEL_SPEED_MAX_MPS).contains(&speed_mps) {
            let model = interpolated(&self.models, speed_mps);
            self.observer.observe(state, &model);
        } else {
            self.observer.interrupt();
        }
    }

    /// Sets the plan's initial state: `state`, moved on by the commands on their way.
    fn begin(&mut self, scene: &Scene, mut state: [f64; 5]) {
        let (ego, p) = (&scene.ego, &self.params);
        let speed_mps = ego.speed_mps.clamp(MODEL_SPEED_MIN_MPS, MODEL_SPEED_MAX_MPS);
        let mut s_m = ego.s_m;
        for (time_s, command) in self.sent.under_way() {
            let table = if time_s < self.period_s { &self.rest_models } else { &self.models };
            let model = interpolated(table, speed_mps);
            let target = command.clamp(-p.max_steer_rad, p.max_steer_rad);
            let change = lagged(state[4], target, p.steer_lag_s, p.max_steer_rate_radps, time_s) - state[4];
            let turned = scene.road.curvature_radpm(s_m) * speed_mps * time_s;
            let from_outside = [-0.5 * turned * speed_mps * time_s, 0.0, -turned, 0.0, 0.0];
            let [lateral, yaw] = self.observer.estimate();
            let last = state;
            for i in 0..5 {
                let moved: f64 = model.a[i].iter().zip(&last).map(|(a, x)| a * x).sum();
                let disturbed = model.disturbance[i][0] * lateral + model.disturbance[i][1] * yaw;
                state[i] = moved + model.b[i] * change + from_outside[i] + disturbed;
            }
            s_m += speed_mps * time_s;
        }
        self.start = (self.sent.delay_s(), s_m);
        self.problem.initial_state = state;
    }

    fn set_stages(&mut self, scene: &Scene, reference: LateralReference<'_>, speeds_mps: &[f64], path_ratio: f64) {
        let steer_cost = 1.0 / path_ratio.clamp(PATH_RATIO_RANGE.0, PATH_RATIO_RANGE.1);
        let mut limits = self.limits(scene.road.adhesion());
        let slope = self.config.heading_reference == HeadingReference::Slope;
        let (start_s, mut s_m) = self.start;
        let start_m = self.problem.initial_state[0];
        let (held_steer_rad, steady_lateral_mps) = self.held_against_disturbance(scene.ego.speed_mps);
        let mut reach_m = 0.0;
        let horizon = self.problem.stages.len();
        for k in 0..horizon {
            let speed_mps = self.speed_at(start_s + k as f64 * self.period_s, speeds_mps, scene.ego.speed_mps);
            let curvature = scene.road.curvature_radpm(s_m);
            if !scene.road.is_uniform() {
                limits = self.limits(scene.road.adhesion_at(s_m));
            }
            s_m += speed_mps * self.period_s;
            self.set_model(k, speed_mps, curvature);
            self.set_limits(k, speed_mps, &limits);
            let (d_m, rate_mps) = reference.at(start_s + (k + 1) as f64 * self.period_s);
            reach_m += SLOPE_MAX * speed_mps * self.period_s;
            let d_m = within(d_m, start_m, reach_m);
            let rate_mps = within(rate_mps, 0.0, SLOPE_MAX * speed_mps);
            let heading = if slope { rate_mps / speed_mps } else { 0.0 }
                - steady_sideslip_rad(&self.params, speed_mps, curvature)
                - steady_lateral_mps / speed_mps;
            let slow = (speed_mps / STEER_COST_SPEED_MPS).min(1.0);
            let steer_cost = steer_cost * slow * slow;
            let steady_steer_rad = steady_steer_rad(&self.params, speed_mps, curvature) + held_steer_rad;
            let last = k + 1 == horizon;
            let weighted = last && self.config.terminal_cost == TerminalCost::Weighted;
            let share = if weighted { self.config.terminal_weight } else { 1.0 };
            let stage = &mut self.problem.stages[k];
            stage.state_weight = [share * POSITION_TO_HEADING, 0.0, share, 0.0, share * steer_cost];
            stage.state_reference = [d_m, 0.0, heading, 0.0, steady_steer_rad];
            stage.input_weight = steer_cost * self.config.steer_change_weight;
            if last && !weighted {
                self.set_tail(scene, reference, speed_mps, steady_lateral_mps);
            }
        }
    }

    /// Ends the problem in the cost-to-go at this speed, about the steady motion along the reference.
    fn set_tail(&mut self, scene: &Scene, reference: LateralReference<'_>, speed_mps: f64, drift_mps: f64) {
        let end_s = self.start.0 + self.problem.stages.len() as f64 * self.period_s;
        let steady = Steady::new(&self.params, scene, reference, speed_mps, end_s);
        let Some(stage) = self.problem.stages.last_mut() else { return };
        stage.state_reference[1] = steady.lateral_speed_mps + drift_mps;
        stage.state_reference[3] = steady.yaw_rate_radps;
        let (weights, steer_cost) = (stage.state_weight, stage.input_weight);
        let grid_mps = speed_mps.round();
        if (self.tail.speed_mps, self.tail.steer_cost) != (grid_mps, steer_cost) {
            let model = interpolated(&self.models, grid_mps);
            // With weights so far apart that it does not settle, nothing counts after the horizon.
            let weight = infinite_horizon_weight(&model.a, &model.b, &weights, steer_cost).unwrap_or_default();
            self.tail = Tail { speed_mps: grid_mps, steer_cost, weight };
        }
        self.problem.terminal_weight = self.tail.weight;
    }

    /// Road-wheel angle, rad, and lateral speed, m/s, that the estimated disturbance asks for.
    fn held_against_disturbance(&self, speed_mps: f64) -> (f64, f64) {
        if !self.config.observer {
            return (0.0, 0.0);
        }
        self.observer.steady(&self.params, speed_mps.clamp(OBSERVED_SPEED_MIN_MPS, MODEL_SPEED_MAX_MPS))
    }

    /// The profile's speed at `time_s`, within the model's range.
    fn speed_at(&self, time_s: f64, speeds_mps: &[f64], now_mps: f64) -> f64 {
        let position = time_s / self.config.longitudinal_step_s;
        let before = position as usize;
        let speed_mps = match (speeds_mps.get(before), speeds_mps.get(before + 1)) {
            (Some(a), Some(b)) => a + (position - before as f64) * (b - a),
            (Some(a), None) => *a,
            _ => speeds_mps.last().copied().unwrap_or(now_mps),
        };
        speed_mps.clamp(MODEL_SPEED_MIN_MPS, MODEL_SPEED_MAX_MPS)
    }

    /// Dynamics of stage `k`: the table's matrices, interpolated, and the turning of the road under the car.
    fn set_model(&mut self, k: usize, speed_mps: f64, curvature: f64) {
        let (low, high, share) = between(&self.models, speed_mps);
        let stage = &mut self.problem.stages[k];
        for i in 0..5 {
            for j in 0..5 {
                stage.a[i][j] = low.a[i][j] + share * (high.a[i][j] - low.a[i][j]);
            }
            stage.b[i] = low.b[i] + share * (high.b[i] - low.b[i]);
        }
        let turned = curvature * speed_mps * self.period_s;
        stage.c = [-0.5 * turned * speed_mps * self.period_s, 0.0, -turned, 0.0, 0.0];
        if self.config.observer {
            let [lateral, yaw] = self.observer.estimate();
            for (c, response) in stage.c.iter_mut().zip(&low.disturbance) {
                *c += response[0] * lateral + response[1] * yaw;
            }
        }
    }

    /// Soft bounds of stage `k`. The front slip is bounded at the step's start, just after the wheel has turned: it is
    /// largest there.
    fn set_limits(&mut self, k: usize, speed_mps: f64, limits: &StabilityLimits) {
        let (lf, lr) = (self.params.front_axle_m / speed_mps, self.params.rear_axle_m / speed_mps);
        let (l1_weight, l2_weight) = (self.config.stability_l1_weight, self.config.stability_l2_weight);
        let stage = &mut self.problem.stages[k];
        let (a, b) = (&stage.a, &stage.b);
        let row = |state, input, bound: f64| Row { state, input, lower: -bound, upper: bound, l1_weight, l2_weight };
        let past = |row: Row<5>, added: f64| Row { lower: row.lower - added, upper: row.upper - added, ..row };
        let c = &stage.c;
        let mut rear = [0.0; 5];
        for (j, coefficient) in rear.iter_mut().enumerate() {
            *coefficient = a[1][j] / speed_mps - lr * a[3][j];
        }
        stage.rows = [
            past(row(a[3], b[3], limits.yaw_accel_mps2 / speed_mps), c[3]),
            row([0.0, 1.0 / speed_mps, 0.0, lf, -1.0], -1.0, limits.front_slip_rad),
            past(row(rear, b[1] / speed_mps - lr * b[3], limits.rear_slip_rad), c[1] / speed_mps - lr * c[3]),
            row([0.0, 0.0, 0.0, 0.0, 1.0], 1.0, self.params.max_steer_rad),
        ];
        if !self.config.stability_constraints {
            for index in [YAW_RATE, FRONT_SLIP, REAR_SLIP] {
                (stage.rows[index].lower, stage.rows[index].upper) = (f64::NEG_INFINITY, f64::INFINITY);
            }
        }
        debug_assert!(stage.rows[STEER].upper.is_finite());
    }

    fn limits(&self, adhesion: f64) -> StabilityLimits {
        let (front, rear) = slip_limits_rad(&self.params, adhesion);
        StabilityLimits {
            front_slip_rad: self.config.stability_tightening * front,
            rear_slip_rad: self.config.stability_tightening * rear,
            yaw_accel_mps2: self.config.yaw_rate_factor * adhesion * GRAVITY_MPS2,
        }
    }

    /// The ladder below the optimum: a rung and a change of the road-wheel angle.
    fn fall_back(&mut self, scene: &Scene, reference: LateralReference<'_>) -> (Rung, f64) {
        self.plan_age = self.plan_age.saturating_add(1);
        let bridged = usize::from(self.config.shifted_plan_steps).min(self.problem.stages.len() - 1);
        if self.plan_age <= bridged {
            return (Rung::ShiftedPlan, self.planned_changes_rad[self.plan_age]);
        }
        let wanted = self.feedback_steer_rad(scene, reference);
        let change = wanted - self.problem.initial_state[4];
        if change.is_finite() {
            (Rung::FeedbackLaw, change.clamp(self.problem.input_min, self.problem.input_max))
        } else {
            (Rung::BrakeInLane, 0.0)
        }
    }

    /// Critically damped approach of the reference by steady-state steering, within the front slip limit; NaN if the
    /// state is.
    fn feedback_steer_rad(&self, scene: &Scene, reference: LateralReference<'_>) -> f64 {
        let ego = &scene.ego;
        let speed_mps = ego.speed_mps.clamp(MODEL_SPEED_MIN_MPS, MODEL_SPEED_MAX_MPS);
        let (d_m, rate_mps) = reference.at(0.0);
        let w = FEEDBACK_FREQUENCY_RADPS;
        let accel = w * w * (d_m - ego.d_m) + 2.0 * w * (rate_mps - ego.road_lateral_speed_mps());
        let most = self.limits(scene.road.adhesion_at(ego.s_m)).yaw_accel_mps2;
        let curvature =
            scene.road.curvature_radpm(ego.s_m) + accel.clamp(-0.5 * most, 0.5 * most) / (speed_mps * speed_mps);
        steady_steer_rad(&self.params, speed_mps, curvature) + self.held_against_disturbance(speed_mps).0
    }

    /// The command that turns the wheel by `change_rad` in one control period, through its lag.
    fn answer(&mut self, scene: &Scene, rung: Rung, change_rad: f64, solve: SolveSummary) -> SteerPlan {
        let ego = &scene.ego;
        // Where the wheel will be when the command reaches it.
        let then_rad = self.problem.initial_state[4];
        let now_rad = if then_rad.is_finite() { then_rad } else { self.last_steer_rad };
        let most = self.params.max_steer_rad;
        let steer_rad = (now_rad + change_rad / self.response).clamp(-most, most);
        self.last_steer_rad = (now_rad + change_rad).clamp(-most, most);
        self.sent.push(steer_rad);
        let (front_slip_use, rear_slip_use, yaw_rate_use) = self.grip_use(ego, scene.road.adhesion_at(ego.s_m));
        SteerPlan { steer_rad, rung, solve, front_slip_use, rear_slip_use, yaw_rate_use }
    }

    fn grip_use(&self, ego: &VehicleState, adhesion: f64) -> (f64, f64, f64) {
        let speed_mps = ego.speed_mps.max(MODEL_SPEED_MIN_MPS);
        let (front, rear) =
            slip_angles_rad(&self.params, speed_mps, ego.lateral_speed_mps, ego.yaw_rate_radps, ego.steer_rad);
        let (front_limit, rear_limit) = slip_limits_rad(&self.params, adhesion);
        let yaw_limit = adhesion * GRAVITY_MPS2 / speed_mps;
        (front.abs() / front_limit, rear.abs() / rear_limit, ego.yaw_rate_radps.abs() / yaw_limit)
    }
}

/// The models at the tabulated speeds.
fn models(params: &VehicleParams, step_s: f64) -> Arc<[DiscreteBicycle]> {
    let points = ((MODEL_SPEED_MAX_MPS - MODEL_SPEED_MIN_MPS) / MODEL_SPEED_STEP_MPS) as u32 + 1;
    (0..points)
        .map(|i| MODEL_SPEED_MIN_MPS + f64::from(i) * MODEL_SPEED_STEP_MPS)
        .map(|speed_mps| DiscreteBicycle::new(params, speed_mps, step_s))
        .collect()
}

/// The models of the tabulated speeds beside `speed_mps`, and how far it lies from the first to the second.
fn between(models: &[DiscreteBicycle], speed_mps: f64) -> (&DiscreteBicycle, &DiscreteBicycle, f64) {
    let position = (speed_mps - MODEL_SPEED_MIN_MPS) / MODEL_SPEED_STEP_MPS;
    let before = (position as usize).min(models.len() - 2);
    (&models[before], &models[before + 1], position - before as f64)
}

/// The model at `speed_mps`.
fn interpolated(models: &[DiscreteBicycle], speed_mps: f64) -> DiscreteBicycle {
    let (low, high, share) = between(models, speed_mps);
    let mut model = *low;
    for i in 0..5 {
        for j in 0..5 {
            model.a[i][j] += share * (high.a[i][j] - low.a[i][j]);
        }
        for j in 0..2 {
            model.disturbance[i][j] += share * (high.disturbance[i][j] - low.disturbance[i][j]);
        }
        model.b[i] += share * (high.b[i] - low.b[i]);
    }
    model
}

/// `value`, or the end of `center ± reach` that is nearest to it; NaN stays NaN, for the solver to refuse.
fn within(value: f64, center: f64, reach: f64) -> f64 {
    if value.is_nan() { value } else { value.max(center - reach).min(center + reach) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolated_models_are_close_to_exact_ones() {
        let params = VehicleParams::default();
        let mut mpc = LateralMpc::new(&ControlConfig::default(), &params, 0.05);
        for (speed_mps, allowed) in [(2.1, 5e-3), (5.1, 1e-3), (15.1, 1e-4), (27.9, 1e-4), (59.9, 1e-4), (60.0, 1e-9)] {
            mpc.set_model(0, speed_mps, 0.0);
            let exact = DiscreteBicycle::new(&params, speed_mps, 0.05);
            for (row, exact) in mpc.problem.stages[0].a.iter().zip(&exact.a) {
                let size = exact.iter().fold(0.0_f64, |size, v| size.max(v.abs()));
                for (value, exact) in row.iter().zip(exact) {
                    assert!((value - exact).abs() <= allowed * size, "{speed_mps}: {value} {exact}");
                }
            }
        }
    }
}
