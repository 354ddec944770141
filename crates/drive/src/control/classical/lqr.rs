//! The linear-quadratic regulator of the lateral motion, with feed-forward of the reference's curvature.
//!
//! It minimizes the cost of Eq. 26 over an infinite horizon without constraints, for the linear bicycle model at the
//! present speed: Δδ = −K (x − x_ref) + Δδ_ff with x = [d, V_y, φ, γ, δ]. The gain K solves the discrete algebraic Riccati
//! equation by value iteration (Bertsekas, 2005, section 4.1), which converges from P = Q for a stabilizable and
//! detectable model. Feed-forward is the steady motion along the present curvature (Snider, 2009, section 5).

use crate::control::LateralReference;
use crate::scene::Scene;
use crate::vehicle::bicycle::DiscreteBicycle;
use crate::vehicle::{VehicleParams, lag_response};

use super::Steady;

/// Speeds of the table of gains: first, last and distance, m/s.
const SPEEDS_MPS: (f64, f64, f64) = (2.0, 60.0, 1.0);
/// P_22 / P_21 (Eq. 26).
const POSITION_TO_HEADING: f64 = 10.0;
/// Below this speed R_2 falls with the square of the speed, as in the model-predictive controller, m/s.
const STEER_COST_SPEED_MPS: f64 = 15.0;
/// Value iteration ends when P changes by less than this share.
const TOLERANCE: f64 = 1e-12;
/// The slowest case, 60 m/s with a weak q_2, needs about 400 steps.
const ITERATIONS_MAX: u32 = 20_000;

type Gain = [f64; 5];
type Square = [[f64; 5]; 5];

/// The regulator with its gains for all speeds.
#[derive(Clone, Debug)]
pub struct Lqr {
    params: VehicleParams,
    period_s: f64,
    response: f64,
    gains: Vec<Gain>,
}

impl Lqr {
    /// A regulator for this car. `control_period_s`: time between two commands; `path_ratio`: q_2;
    /// `steer_change_weight`: weight of Δδ² against that of δ².
    pub fn new(params: &VehicleParams, control_period_s: f64, path_ratio: f64, steer_change_weight: f64) -> Self {
        let (first, last, step) = SPEEDS_MPS;
        let points = ((last - first) / step) as u32 + 1;
        let gains = (0..points).map(|i| {
            let speed_mps = first + f64::from(i) * step;
            let slow = (speed_mps / STEER_COST_SPEED_MPS).min(1.0);
            let steer_cost = slow * slow / path_ratio;
            let weights = [POSITION_TO_HEADING, 0.0, 1.0, 0.0, steer_cost];
            let model = DiscreteBicycle::new(params, speed_mps, control_period_s);
            riccati(&model, &weights, steer_cost * steer_change_weight).1
        });
        Self {
            params: params.clone(),
            period_s: control_period_s,
            response: lag_response(params.steer_lag_s, control_period_s),
            gains: gains.collect(),
        }
    }

    /// The gain at a speed, m/s, between tabulated ones by linear interpolation.
    pub fn gain(&self, speed_mps: f64) -> [f64; 5] {
        let (first, last, step) = SPEEDS_MPS;
        let position = (speed_mps.clamp(first, last) - first) / step;
        let before = (position as usize).min(self.gains.len() - 2);
        let share = position - before as f64;
        let mut gain = self.gains[before];
        for (value, after) in gain.iter_mut().zip(&self.gains[before + 1]) {
            *value += share * (after - *value);
        }
        gain
    }

    /// Road-wheel angle to command, rad.
    pub fn steer_rad(&self, scene: &Scene, reference: LateralReference<'_>) -> f64 {
        let ego = &scene.ego;
        let speed_mps = ego.speed_mps.clamp(SPEEDS_MPS.0, SPEEDS_MPS.1);
        let now = Steady::new(&self.params, scene, reference, speed_mps, 0.0);
        let next = Steady::new(&self.params, scene, reference, speed_mps, self.period_s);
        let errors = [
            ego.d_m - now.d_m,
            ego.lateral_speed_mps - now.lateral_speed_mps,
            ego.heading_rad - now.heading_rad,
            ego.yaw_rate_radps - now.yaw_rate_radps,
            ego.steer_rad - now.steer_rad,
        ];
        let gain = self.gain(speed_mps);
        let correction: f64 = gain.iter().zip(&errors).map(|(k, e)| k * e).sum();
        let change_rad = next.steer_rad - now.steer_rad - correction;
        let most = self.params.max_steer_rad;
        (ego.steer_rad + change_rad / self.response).clamp(-most, most)
    }
}

/// P of the cost-to-go xᵀ P x and K of u = −K x, the fixed point of P = Q + Aᵀ P (A − B K), K = Bᵀ P A / (R + Bᵀ P B).
pub(super) fn riccati(model: &DiscreteBicycle, state_weights: &[f64; 5], input_weight: f64) -> (Square, Gain) {
    let mut cost = [[0.0; 5]; 5];
    for (i, weight) in state_weights.iter().enumerate() {
        cost[i][i] = *weight;
    }
    let mut gain = [0.0; 5];
    for _ in 0..ITERATIONS_MAX {
        let (next, next_gain) = riccati_step(model, state_weights, input_weight, &cost);
        let size = next.iter().flatten().fold(0.0_f64, |size, v| size.max(v.abs()));
        let change =
            next.iter().flatten().zip(cost.iter().flatten()).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        (cost, gain) = (next, next_gain);
        if change <= TOLERANCE * size {
            break;
        }
    }
    (cost, gain)
}

fn riccati_step(model: &DiscreteBicycle, weights: &[f64; 5], input_weight: f64, cost: &Square) -> (Square, Gain) {
    let (a, b) = (&model.a, &model.b);
    let mut cost_b = [0.0; 5];
    for i in 0..5 {
        cost_b[i] = (0..5).map(|j| cost[i][j] * b[j]).sum();
    }
    let curvature = input_weight + (0..5).map(|i| b[i] * cost_b[i]).sum::<f64>();
    let mut gain = [0.0; 5];
    for (j, value) in gain.iter_mut().enumerate() {
        *value = (0..5).map(|i| cost_b[i] * a[i][j]).sum::<f64>() / curvature;
    }
    let closed = |i: usize, j: usize| a[i][j] - b[i] * gain[j];
    let square = |entry: &dyn Fn(usize, usize) -> f64| -> Square {
        core::array::from_fn(|i| core::array::from_fn(|j| entry(i, j)))
    };
    let ahead = square(&|i, j| (0..5).map(|k| cost[i][k] * closed(k, j)).sum());
    let mut next = square(&|i, j| (0..5).map(|k| a[k][i] * ahead[k][j]).sum());
    for (i, weight) in weights.iter().enumerate() {
        next[i][i] += weight;
    }
    (next, gain)
}
