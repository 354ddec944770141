//! The controllers' linear single-track model (Eqs. 2–4 at small angles): its matrices, steady states and exact
//! discrete form.
//!
//! State x = [d, V_y, φ, γ, δ]: lateral position, lateral speed, heading relative to the road, yaw rate and road-wheel
//! angle. Discretization is by zero-order hold: forward Euler of this model diverges at 0.05 s and 20 m/s.

use lanecraft_qp::zero_order_hold;

use crate::vehicle::VehicleParams;
use crate::vehicle::actuator::lag_response;

/// (A, B) of the block ẋ = A x + B δ with x = [V_y, γ] at `speed_mps` > 0 (Eq. 4 with the restoring sign).
pub fn lateral_dynamics(params: &VehicleParams, speed_mps: f64) -> ([[f64; 2]; 2], [f64; 2]) {
    let p = params;
    let v = speed_mps;
    let (m, jz, lf, lr) = (p.mass_kg, p.yaw_inertia_kgm2, p.front_axle_m, p.rear_axle_m);
    let (cf, cr) = (2.0 * p.front_stiffness_nprad, 2.0 * p.rear_stiffness_nprad);
    let moment = cf * lf - cr * lr;
    let a = [
        [-(cf + cr) / (m * v), -v - moment / (m * v)],
        [-moment / (jz * v), -(cf * lf * lf + cr * lr * lr) / (jz * v)],
    ];
    (a, [cf / m, cf * lf / jz])
}

/// Understeer gradient, rad/(m/s²): how much more steering a lateral acceleration needs than the geometry asks for.
pub fn understeer_gradient(params: &VehicleParams) -> f64 {
    let p = params;
    p.mass_kg / (2.0 * p.wheelbase_m())
        * (p.rear_axle_m / p.front_stiffness_nprad - p.front_axle_m / p.rear_stiffness_nprad)
}

/// Road-wheel angle that holds a curvature at `speed_mps`, rad.
pub fn steady_steer_rad(params: &VehicleParams, speed_mps: f64, curvature_radpm: f64) -> f64 {
    curvature_radpm * (params.wheelbase_m() + understeer_gradient(params) * speed_mps * speed_mps)
}

/// Sideslip angle β = V_y / V_x of steady cornering, rad.
pub fn steady_sideslip_rad(params: &VehicleParams, speed_mps: f64, curvature_radpm: f64) -> f64 {
    let p = params;
    let rear_load = p.mass_kg * p.front_axle_m / (2.0 * p.rear_stiffness_nprad * p.wheelbase_m());
    curvature_radpm * (p.rear_axle_m - rear_load * speed_mps * speed_mps)
}

/// x_{k+1} = A x_k + B Δδ_k, with Δδ the *achieved* change of the road-wheel angle in the step.
///
/// The actuator's lag is inside: a step's command is δ + Δδ / (1 − e^(−h/T)), so that δ arrives at δ + Δδ at the step's
/// end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiscreteBicycle {
    /// A, row by row.
    pub a: [[f64; 5]; 5],
    /// B.
    pub b: [f64; 5],
    /// What a constant lateral acceleration (m/s²) and a constant yaw acceleration (rad/s²) that act on the car from
    /// outside add to the state in a step.
    pub disturbance: [[f64; 2]; 5],
}

impl DiscreteBicycle {
    /// The exact discrete model at a constant `speed_mps` > 0.
    pub fn new(params: &VehicleParams, speed_mps: f64, step_s: f64) -> Self {
        let (m, n) = lateral_dynamics(params, speed_mps);
        let lag_s = params.steer_lag_s;
        // Without lag the command is the angle: it drives the four other states directly.
        let (decay, direct) = if lag_s > 0.0 { (1.0 / lag_s, 0.0) } else { (0.0, 1.0) };
        let through = 1.0 - direct;
        let continuous = [
            [0.0, 1.0, speed_mps, 0.0, 0.0],
            [0.0, m[0][0], 0.0, m[0][1], through * n[0]],
            [0.0, 0.0, 0.0, 1.0, 0.0],
            [0.0, m[1][0], 0.0, m[1][1], through * n[1]],
            [0.0, 0.0, 0.0, 0.0, -decay],
        ];
        let input = [[0.0; 3], [direct * n[0], 1.0, 0.0], [0.0; 3], [direct * n[1], 0.0, 1.0], [decay, 0.0, 0.0]];
        let (transition, response) = zero_order_hold(&continuous, &input, step_s);
        let lead = 1.0 / lag_response(lag_s, step_s);
        let (mut a, mut b) = (transition, [0.0; 5]);
        for i in 0..4 {
            a[i][4] += response[i][0];
            b[i] = lead * response[i][0];
        }
        a[4] = [0.0, 0.0, 0.0, 0.0, 1.0];
        b[4] = 1.0;
        Self { a, b, disturbance: response.map(|row| [row[1], row[2]]) }
    }
}
