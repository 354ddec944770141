//! The plant against the single-track model of commonroad-vehicle-models 3.0.2 (Althoff, Koschi and Manzinger, 2017), from
//! reference data with the script that made it: `tests/data/commonroad.py`.
//!
//! That model's tires are linear, as Eq. 3, and so are those here. It differs in one term: its speed is that along the
//! course and changes by command alone, whereas by Eqs. 2 and 4 the tires' lateral force, which is not quite at right
//! angles to the course, changes it by F_y sin β / M. Its sideslip also lacks the factor cos β of that force.

use super::bicycle::lateral_dynamics;
use super::tire::{axle_force_n, slip_angles_rad};
use super::*;

const TRAJECTORIES: &str = include_str!("../../tests/data/commonroad_trajectories.csv");
const AXLES: &str = include_str!("../../tests/data/commonroad_axles.csv");
const LINEAR: &str = include_str!("../../tests/data/commonroad_linear.csv");
/// Height of the center of gravity, duration and peak of the sine of steering: those of the script.
const HEIGHT_M: f64 = 0.54;
const CHANGE_S: f64 = 3.0;
const PEAK_RAD: f64 = 0.015_704;
const STEP_S: f64 = 0.001;

/// The numbers of a table whose first column is dropped if it is text.
fn rows<const N: usize>(table: &'static str, case: &str) -> Vec<[f64; N]> {
    let rows = table.lines().skip(1).filter(|line| line.starts_with(case));
    rows.map(|line| {
        let cells: Vec<f64> = line.split(',').filter_map(|cell| cell.parse().ok()).collect();
        cells.try_into().expect("as many columns as the table has")
    })
    .collect()
}

/// The car without lags, its tires linear.
fn car() -> VehicleParams {
    VehicleParams { tires: TireModel::Linear, steer_lag_s: 0.0, drive_lag_s: 0.0, ..VehicleParams::default() }
}

/// Road-wheel angle of a case, rad.
fn steer_rad(case: &str, time_s: f64) -> f64 {
    match case {
        "step" => 0.02,
        _ => PEAK_RAD * libm::sin(core::f64::consts::TAU * time_s.min(CHANGE_S) / CHANGE_S),
    }
}

/// Largest differences along a case: of the position, m, and of the yaw rate, as a share of its peak.
fn differences(case: &str, mut state_at: impl FnMut(f64) -> [f64; 3]) -> (f64, f64) {
    let reference = rows::<8>(TRAJECTORIES, case);
    let peak = reference.iter().map(|row| row[6].abs()).fold(0.0, f64::max);
    let apart = reference.iter().map(|row| {
        let [x_m, y_m, yaw_rate] = state_at(row[0]);
        (libm::hypot(x_m - row[1], y_m - row[2]), (yaw_rate - row[6]).abs() / peak)
    });
    apart.fold((0.0, 0.0), |most: (f64, f64), (position, yaw)| (most.0.max(position), most.1.max(yaw)))
}

/// The plant driven through a case, in the middle of each step's steering.
fn driven(params: &VehicleParams, case: &'static str) -> (f64, f64) {
    let contact = Contact { adhesion: 0.85, ..Contact::default() };
    let mut state = VehicleState { speed_mps: 25.0, steer_rad: steer_rad(case, 0.0), ..VehicleState::default() };
    let mut k = 0_u32;
    differences(case, |time_s| {
        while f64::from(k) * STEP_S < time_s - 0.5 * STEP_S {
            let steer_rad = steer_rad(case, (f64::from(k) + 0.5) * STEP_S);
            state = step(params, &state, &ControlInput { accel_mps2: 0.0, steer_rad }, &contact, STEP_S);
            k += 1;
        }
        [state.s_m, state.d_m, state.yaw_rate_radps]
    })
}

/// The equations with speed and sideslip as states, [x, y, ψ, V, γ, β]. With `whole_force` they are Eqs. 1–3 in other
/// states; without, the reference's.
fn in_course_states(x: &[f64; 6], steer: f64, whole_force: bool) -> [f64; 6] {
    let (p, &[_, _, heading, v, yaw, beta]) = (car(), x);
    let (sin, cos) = if whole_force { libm::sincos(beta) } else { (beta, 1.0) };
    let (front_slip, rear_slip) = slip_angles_rad(&p, v * cos, v * sin, yaw, steer);
    let front = axle_force_n(p.tires, p.front_stiffness_nprad, 0.0, front_slip);
    let rear = axle_force_n(p.tires, p.rear_stiffness_nprad, 0.0, rear_slip);
    let accel = (front + rear) / p.mass_kg;
    [
        v * libm::cos(heading + beta),
        v * libm::sin(heading + beta),
        yaw,
        if whole_force { accel * sin } else { 0.0 },
        (p.front_axle_m * front - p.rear_axle_m * rear) / p.yaw_inertia_kgm2,
        accel * cos / v - yaw,
    ]
}

/// Those equations integrated through a case by the midpoint rule.
fn in_course_states_driven(case: &'static str, whole_force: bool) -> (f64, f64) {
    let along = |x: &[f64; 6], rate: &[f64; 6], time_s: f64| core::array::from_fn(|i| x[i] + time_s * rate[i]);
    let (mut x, mut k) = ([0.0, 0.0, 0.0, 25.0, 0.0, 0.0], 0_u32);
    differences(case, |time_s| {
        while f64::from(k) * STEP_S < time_s - 0.5 * STEP_S {
            let [begin, middle] = [0.0, 0.5].map(|share| steer_rad(case, (f64::from(k) + share) * STEP_S));
            let half: [f64; 6] = along(&x, &in_course_states(&x, begin, whole_force), 0.5 * STEP_S);
            x = along(&x, &in_course_states(&half, middle, whole_force), STEP_S);
            k += 1;
        }
        [x[0], x[1], x[4]]
    })
}

#[test]
fn trajectories_end_within_centimeters_of_the_reference() {
    // Bounds of position and yaw rate; what is measured lies below half of them.
    for (case, position_max_m, yaw_max) in [("lane-change", 0.015, 1e-3), ("step", 0.05, 1e-3)] {
        let (position_m, yaw) = driven(&car(), case);
        println!("{case}: {position_m:.4} m, yaw rate {yaw:.1e}");
        assert!(position_m < position_max_m && yaw < yaw_max, "{case}: {position_m} m, yaw rate {yaw}");
    }
    // The default car's tires bend: in the lane change 2.6 cm and 1 % of the yaw rate.
    let (position_m, yaw) = driven(&VehicleParams { tires: TireModel::Pacejka, ..car() }, "lane-change");
    assert!(position_m < 0.05 && yaw < 0.015, "Pacejka: {position_m} m, yaw rate {yaw}");
}

#[test]
fn one_term_makes_the_difference() {
    for case in ["lane-change", "step"] {
        // The reference's own equations: what is left is the midpoint rule's error.
        let (position_m, yaw) = in_course_states_driven(case, false);
        assert!(position_m < 1e-5 && yaw < 1e-4, "{case}: {position_m} m, yaw rate {yaw}");
        // With the whole lateral force they leave it as far as the plant does.
        let (with_force_m, _) = in_course_states_driven(case, true);
        let (plant_m, _) = driven(&car(), case);
        assert!((with_force_m - plant_m).abs() < 1e-4 && plant_m > 1e-3, "{case}: {with_force_m} m, plant {plant_m} m");
    }
}

#[test]
fn axle_forces_and_load_transfer_are_the_references() {
    let options = PlantConfig {
        load_transfer: LoadTransfer::QuasiStatic,
        gravity_center_height_m: HEIGHT_M,
        ..PlantConfig::default()
    };
    let p = car();
    for [v, accel, steer, yaw, beta, yaw_accel, sideslip_rate] in rows::<7>(AXLES, "") {
        // There, an axle's stiffness is a share of its load.
        let per_load = 2.0 * (p.front_stiffness_nprad + p.rear_stiffness_nprad) / (p.mass_kg * tire::GRAVITY_MPS2);
        let (front_n, rear_n) = options.axle_loads_n(&p, accel);
        let (front_slip, rear_slip) = slip_angles_rad(&p, v, v * beta, yaw, steer);
        let front = axle_force_n(p.tires, 0.5 * per_load * front_n, 0.0, front_slip);
        let rear = axle_force_n(p.tires, 0.5 * per_load * rear_n, 0.0, rear_slip);
        let moment = p.front_axle_m * front - p.rear_axle_m * rear;
        assert!((moment / p.yaw_inertia_kgm2 - yaw_accel).abs() < 1e-9, "{v} m/s: yaw acceleration");
        assert!(((front + rear) / (p.mass_kg * v) - yaw - sideslip_rate).abs() < 1e-9, "{v} m/s: sideslip");
    }
}

#[test]
fn eigenvalues_and_steady_state_are_the_references() {
    for [v, middle, real, imaginary, sideslip_gain, yaw_gain] in rows::<6>(LINEAR, "") {
        let (a, b) = lateral_dynamics(&car(), v);
        let (half_trace, determinant) = (0.5 * (a[0][0] + a[1][1]), a[0][0] * a[1][1] - a[0][1] * a[1][0]);
        let split = half_trace * half_trace - determinant;
        assert!(
            (half_trace - middle).abs() < 1e-9 && (split - (real * real - imaginary * imaginary)).abs() < 1e-9 * v * v
        );
        let lateral_mps = (a[0][1] * b[1] - a[1][1] * b[0]) / determinant;
        let yaw = (a[1][0] * b[0] - a[0][0] * b[1]) / determinant;
        assert!((lateral_mps / v - sideslip_gain).abs() < 1e-9 && (yaw - yaw_gain).abs() < 1e-9, "{v} m/s");
    }
}
