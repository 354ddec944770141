//! The plant: a single-track car in the road frame (Eqs. 1–4), integrated by the classical Runge–Kutta scheme.
//!
//! V̇_x = a_x + V_y γ, M (V̇_y + V_x γ) = F_yf + F_yr, J_z γ̇ = L_f F_yf − L_r F_yr, and, along a road of curvature κ,
//! ṡ = (V_x cos φ − V_y sin φ) / (1 − κ d), ḋ = V_x sin φ + V_y cos φ, φ̇ = γ − κ ṡ.
//!
//! The right-hand sides also carry the road's grade θ (−g sin θ along the car), its bank (−g sin ϑ across it) and the
//! wind's side force and yaw moment.
//!
//! Departures from the paper: sine and cosine instead of small angles; actuator lags and limits; braking and driving
//! bounded by μ g; below a walking pace the slip angles are singular, so that V_y and γ pass over to those of rolling
//! without slip. By choice ([`PlantConfig`]): axle loads that follow the acceleration, and grip shared between the
//! two directions, F_x² + F_y² ≤ (μ F_z)², with F_x split between the axles as their loads are. The acceleration in the
//! state is what the tires do, F_x / M; gravity comes on top.

use crate::road::Road;
use crate::vehicle::actuator::lagged;
use crate::vehicle::options::LoadTransfer;
use crate::vehicle::tire::{GRAVITY_MPS2, axle_force_n, slip_angles_rad};
use crate::vehicle::{ControlInput, PlantConfig, VehicleParams, VehicleState};

/// Below this speed the car rolls without slip, m/s.
const ROLLING_SPEED_MPS: f64 = 3.0;
/// The slip equations hold alone from this speed on at the latest, m/s, unless they are too stiff there.
const SLIDING_SPEED_MPS: f64 = 6.0;
/// Fastest lateral mode, 1/s, that a step of 0.01 s follows with ease (the scheme is stable up to 2.78 / 0.01 s).
const FASTEST_MODE_PER_S: f64 = 170.0;
/// How fast V_y and γ take the values of rolling without slip, 1/s.
const ROLLING_RATE_PER_S: f64 = 20.0;
/// Share of μ g that braking takes at most where grip is shared: anti-lock brakes leave the rest to steering.
const LONGITUDINAL_SHARE: f64 = 0.95;

/// What road and wind do to the car at its position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Contact {
    /// Adhesion coefficient μ.
    pub adhesion: f64,
    /// Curvature κ of the reference line, rad/m, positive to the left.
    pub curvature_radpm: f64,
    /// Grade, m/m, positive uphill.
    pub grade: f64,
    /// Bank, rad, positive where the left side is the higher one.
    pub bank_rad: f64,
    /// Force of the wind to the left, N.
    pub side_force_n: f64,
    /// Moment of the wind about the vertical axis, N m, positive to the left.
    pub yaw_moment_nm: f64,
}

impl Contact {
    /// What `road` does to a car at `s_m`, without wind.
    pub fn at(road: &Road, s_m: f64) -> Self {
        Self {
            adhesion: road.adhesion_at(s_m),
            curvature_radpm: road.curvature_radpm(s_m),
            grade: road.grade(s_m),
            bank_rad: road.bank_rad(s_m),
            side_force_n: 0.0,
            yaw_moment_nm: 0.0,
        }
    }
}

/// The state of the car `dt_s` later (0.01 s is meant), with `input` held.
///
/// A speed that would fall below zero ends at exactly zero, where the car rests until it is driven off. Non-finite
/// numbers are passed on, for the caller to find.
pub fn step(
    params: &VehicleParams,
    state: &VehicleState,
    input: &ControlInput,
    contact: &Contact,
    dt_s: f64,
) -> VehicleState {
    step_with(params, &PlantConfig::default(), state, input, contact, dt_s)
}

/// The same, of a car that differs from `params` as `options` say. Their delays and their wind are the caller's to see to.
pub fn step_with(
    params: &VehicleParams,
    options: &PlantConfig,
    state: &VehicleState,
    input: &ControlInput,
    contact: &Contact,
    dt_s: f64,
) -> VehicleState {
    let drive = Drive::new((params, options), state, input, contact);
    if state.speed_mps <= 0.0 && drive.accel_mps2(dt_s) <= drive.holding_mps2() {
        // Uphill the drive train builds up what it takes to move off.
        let accel_mps2 = drive.accel_mps2(dt_s).max(0.0);
        return VehicleState { accel_mps2, ..at_rest(state, drive.steer_rad(dt_s)) };
    }
    let next = drive.integrate(dt_s);
    if next.speed_mps >= 0.0 || next.speed_mps.is_nan() {
        return next;
    }
    // The car stops within the step: integrate to that instant, found by the secant, which is exact for constant
    // braking.
    let share = state.speed_mps / (state.speed_mps - next.speed_mps);
    at_rest(&drive.integrate(share * dt_s), drive.steer_rad(dt_s))
}

fn at_rest(state: &VehicleState, steer_rad: f64) -> VehicleState {
    VehicleState { speed_mps: 0.0, lateral_speed_mps: 0.0, yaw_rate_radps: 0.0, accel_mps2: 0.0, steer_rad, ..*state }
}

/// Position, heading and speeds: s, d, φ, V_x, V_y, γ.
type Motion = [f64; 6];

/// One step's constants.
struct Drive<'a> {
    params: &'a VehicleParams,
    options: &'a PlantConfig,
    state: &'a VehicleState,
    contact: &'a Contact,
    steer_target_rad: f64,
    accel_target_mps2: f64,
    /// Most that the tires can brake and drive by, m/s².
    grip_mps2: f64,
    /// μ F_z of the front and the rear axle of a car that neither brakes nor drives, N.
    resting_peaks_n: (f64, f64),
    mass_kg: f64,
    yaw_inertia_kgm2: f64,
    /// Acceleration by gravity on a grade and a bank, m/s²: along and across the car.
    gravity_mps2: (f64, f64),
    /// From this speed on the slip equations hold alone, m/s.
    sliding_speed_mps: f64,
}

/// What the actuators and the axles are at one instant.
#[derive(Clone, Copy)]
struct Instant {
    steer_rad: f64,
    accel_mps2: f64,
    /// μ F_z of the front and the rear axle, as far as braking leaves it, N.
    peaks_n: (f64, f64),
    /// Cornering stiffness of one tire at the axle's load, front and rear, N/rad.
    stiffness_nprad: (f64, f64),
}

impl<'a> Drive<'a> {
    fn new(
        (params, options): (&'a VehicleParams, &'a PlantConfig),
        state: &'a VehicleState,
        input: &ControlInput,
        contact: &'a Contact,
    ) -> Self {
        let p = params;
        let grip_mps2 = contact.adhesion * GRAVITY_MPS2 * if options.combined_grip { LONGITUDINAL_SHARE } else { 1.0 };
        let (mass_kg, yaw_inertia_kgm2) = (options.mass_factor * p.mass_kg, options.mass_factor * p.yaw_inertia_kgm2);
        let (front_n, rear_n) = options.axle_loads_n(p, 0.0);
        let (kf, kr, lf, lr) = (p.front_stiffness_nprad, p.rear_stiffness_nprad, p.front_axle_m, p.rear_axle_m);
        let stiffness = (2.0 * (kf + kr) / mass_kg).max(2.0 * (kf * lf * lf + kr * lr * lr) / yaw_inertia_kgm2);
        Self {
            params,
            options,
            state,
            contact,
            steer_target_rad: input.steer_rad.clamp(-p.max_steer_rad, p.max_steer_rad),
            accel_target_mps2: (input.accel_mps2 / options.mass_factor)
                .clamp(-p.max_brake_mps2.min(grip_mps2), p.max_accel_mps2.min(grip_mps2)),
            grip_mps2,
            resting_peaks_n: (contact.adhesion * front_n, contact.adhesion * rear_n),
            mass_kg,
            yaw_inertia_kgm2,
            gravity_mps2: gravity_mps2(contact),
            sliding_speed_mps: SLIDING_SPEED_MPS.max(stiffness / FASTEST_MODE_PER_S),
        }
    }

    /// Most that the tires may push with no motion following: on a grade the brakes hold the car.
    fn holding_mps2(&self) -> f64 {
        (-self.gravity_mps2.0).max(0.0)
    }

    fn steer_rad(&self, time_s: f64) -> f64 {
        let p = self.params;
        lagged(self.state.steer_rad, self.steer_target_rad, p.steer_lag_s, p.max_steer_rate_radps, time_s)
    }

    fn accel_mps2(&self, time_s: f64) -> f64 {
        let lag_s = self.params.drive_lag_s;
        let accel = lagged(self.state.accel_mps2, self.accel_target_mps2, lag_s, f64::INFINITY, time_s);
        accel.clamp(-self.grip_mps2, self.grip_mps2)
    }

    fn at(&self, time_s: f64) -> Instant {
        let (p, options) = (self.params, self.options);
        let (steer_rad, accel_mps2) = (self.steer_rad(time_s), self.accel_mps2(time_s));
        let (mut peaks_n, mut stiffness_nprad) =
            (self.resting_peaks_n, (p.front_stiffness_nprad, p.rear_stiffness_nprad));
        if options.load_transfer == LoadTransfer::QuasiStatic {
            let (front_n, rear_n) = options.axle_loads_n(p, accel_mps2);
            let (front_share, rear_share) =
                (self.contact.adhesion * front_n / peaks_n.0, self.contact.adhesion * rear_n / peaks_n.1);
            peaks_n = (front_share * peaks_n.0, rear_share * peaks_n.1);
            stiffness_nprad = (front_share * stiffness_nprad.0, rear_share * stiffness_nprad.1);
        }
        if options.combined_grip {
            // F_x over μ F_z is the same at both axles: a / (μ g).
            let used = accel_mps2 / (self.contact.adhesion * GRAVITY_MPS2);
            let left = (1.0 - used * used).max(0.0).sqrt();
            peaks_n = (left * peaks_n.0, left * peaks_n.1);
        }
        Instant { steer_rad, accel_mps2, peaks_n, stiffness_nprad }
    }

    /// One Runge–Kutta step of the motion, with the actuators' exact positions at its start, middle and end.
    fn integrate(&self, dt_s: f64) -> VehicleState {
        let state = self.state;
        let x =
            [state.s_m, state.d_m, state.heading_rad, state.speed_mps, state.lateral_speed_mps, state.yaw_rate_radps];
        let half_s = 0.5 * dt_s;
        let actuators = [0.0, half_s, dt_s].map(|time_s| self.at(time_s));
        let k1 = self.derivative(&x, &actuators[0]);
        let k2 = self.derivative(&moved(&x, &k1, half_s), &actuators[1]);
        let k3 = self.derivative(&moved(&x, &k2, half_s), &actuators[1]);
        let k4 = self.derivative(&moved(&x, &k3, dt_s), &actuators[2]);
        let mut mean = [0.0; 6];
        for i in 0..6 {
            mean[i] = (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) / 6.0;
        }
        let [s_m, d_m, heading_rad, speed_mps, lateral_speed_mps, yaw_rate_radps] = moved(&x, &mean, dt_s);
        let Instant { steer_rad, accel_mps2, .. } = actuators[2];
        VehicleState { s_m, d_m, heading_rad, speed_mps, lateral_speed_mps, yaw_rate_radps, steer_rad, accel_mps2 }
    }

    fn derivative(&self, &[_, d, heading, vx, vy, yaw_rate]: &Motion, now: &Instant) -> Motion {
        let (sin, cos) = libm::sincos(heading);
        let curvature = self.contact.curvature_radpm;
        let s_rate = (vx * cos - vy * sin) / (1.0 - curvature * d);
        let (vy_rate, yaw_accel) = self.lateral(vx, vy, yaw_rate, now);
        // Eq. 4 keeps V_y γ; while rolling it is a term of second order that only hinders an exact stop.
        let coupling = if vx > ROLLING_SPEED_MPS { vy * yaw_rate } else { 0.0 };
        let forward = now.accel_mps2 + self.gravity_mps2.0 + coupling;
        [s_rate, vx * sin + vy * cos, yaw_rate - curvature * s_rate, forward, vy_rate, yaw_accel]
    }

    /// (V̇_y, γ̇): Eq. 2 with the tires of Eq. 3, passing over to rolling without slip at low speed.
    fn lateral(&self, vx: f64, vy: f64, yaw_rate: f64, now: &Instant) -> (f64, f64) {
        let p = self.params;
        let share = ((vx - ROLLING_SPEED_MPS) / (self.sliding_speed_mps - ROLLING_SPEED_MPS)).clamp(0.0, 1.0);
        let sliding = share * share * (3.0 - 2.0 * share);
        let (mut vy_rate, mut yaw_accel) = (0.0, 0.0);
        if sliding > 0.0 {
            let (front_slip, rear_slip) = slip_angles_rad(p, vx, vy, yaw_rate, now.steer_rad);
            let front = axle_force_n(p.tires, now.stiffness_nprad.0, now.peaks_n.0, front_slip);
            let rear = axle_force_n(p.tires, now.stiffness_nprad.1, now.peaks_n.1, rear_slip);
            let force = front + rear + self.contact.side_force_n;
            let moment = p.front_axle_m * front - p.rear_axle_m * rear + self.contact.yaw_moment_nm;
            vy_rate = sliding * (force / self.mass_kg + self.gravity_mps2.1 - vx * yaw_rate);
            yaw_accel = sliding * moment / self.yaw_inertia_kgm2;
        }
        if sliding < 1.0 {
            let rolling_yaw_rate = vx * libm::tan(now.steer_rad) / p.wheelbase_m();
            let rate = (1.0 - sliding) * ROLLING_RATE_PER_S;
            vy_rate += rate * (rolling_yaw_rate * p.rear_axle_m - vy);
            yaw_accel += rate * (rolling_yaw_rate - yaw_rate);
        }
        (vy_rate, yaw_accel)
    }
}

/// What gravity does on this road, m/s²: along the car (downhill) and across it (down the bank).
fn gravity_mps2(contact: &Contact) -> (f64, f64) {
    let along = if contact.grade == 0.0 { 0.0 } else { -GRAVITY_MPS2 * libm::sin(libm::atan(contact.grade)) };
    let across = if contact.bank_rad == 0.0 { 0.0 } else { -GRAVITY_MPS2 * libm::sin(contact.bank_rad) };
    (along, across)
}

fn moved(x: &Motion, rate: &Motion, time_s: f64) -> Motion {
    let mut next = *x;
    for i in 0..6 {
        next[i] += time_s * rate[i];
    }
    next
}
