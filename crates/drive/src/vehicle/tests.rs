//! The plant and the linear model against closed forms and each other.

use super::bicycle::{DiscreteBicycle, lateral_dynamics, steady_sideslip_rad, steady_steer_rad, understeer_gradient};
use super::*;

const DRY: Contact =
    Contact { adhesion: 0.85, curvature_radpm: 0.0, grade: 0.0, bank_rad: 0.0, side_force_n: 0.0, yaw_moment_nm: 0.0 };

fn paper_car() -> VehicleParams {
    VehicleParams::preset(VehiclePreset::Paper)
}

fn advance(
    params: &VehicleParams,
    state: VehicleState,
    input: ControlInput,
    (dt_s, steps): (f64, u32),
) -> VehicleState {
    (0..steps).fold(state, |state, _| step(params, &state, &input, &DRY, dt_s))
}

#[test]
fn the_lateral_modes_are_stable_where_the_printed_signs_are_not() {
    // Eigenvalues at 25 m/s: −20.9 and −39.2 per second, found independently from the printed parameters.
    let (a, _) = lateral_dynamics(&paper_car(), 25.0);
    let (trace, determinant) = (a[0][0] + a[1][1], a[0][0] * a[1][1] - a[0][1] * a[1][0]);
    assert!((trace - -60.1).abs() < 0.11 && (determinant - 20.9 * 39.2).abs() < 4.0, "{trace} {determinant}");
    for params in [paper_car(), VehicleParams::default()] {
        for speed_mps in [20.0, 25.0, 30.0, 33.3] {
            let (a, _) = lateral_dynamics(&params, speed_mps);
            assert!(a[0][0] + a[1][1] < 0.0 && a[0][0] * a[1][1] > a[0][1] * a[1][0]);
        }
    }
}

#[test]
fn steady_cornering_is_that_of_the_closed_forms() {
    let params = paper_car();
    // Known from Table I: understeer gradient 0.0023 rad/(m/s²), and no sideslip at 26.4 m/s.
    assert!((understeer_gradient(&params) - 0.0023).abs() < 5e-5);
    assert!(steady_sideslip_rad(&params, 26.4, 1.0).abs() < 0.01);
    let speed_mps = 25.0;
    let input = ControlInput { accel_mps2: 0.0, steer_rad: 1e-4 };
    let mut state = VehicleState { speed_mps, ..VehicleState::default() };
    for _ in 0..400 {
        // The plant slows down in a bend: hold its speed.
        state = VehicleState { speed_mps, ..step(&params, &state, &input, &DRY, 0.01) };
    }
    let curvature = state.yaw_rate_radps / speed_mps;
    let steer = steady_steer_rad(&params, speed_mps, curvature);
    assert!((steer / input.steer_rad - 1.0).abs() < 1e-6, "{steer}");
    let sideslip = steady_sideslip_rad(&params, speed_mps, curvature);
    assert!((state.lateral_speed_mps / speed_mps / sideslip - 1.0).abs() < 1e-5);
}

#[test]
fn the_integration_is_of_fourth_order() {
    for tires in [TireModel::Linear, TireModel::Pacejka] {
        let params = VehicleParams { tires, steer_lag_s: 0.1, drive_lag_s: 0.2, ..paper_car() };
        let start = VehicleState { speed_mps: 25.0, lateral_speed_mps: 0.3, ..VehicleState::default() };
        let input = ControlInput { accel_mps2: -2.0, steer_rad: 0.02 };
        let exact = advance(&params, start, input, (0.000_25, 4000));
        let error = |dt_s: f64, steps: u32| {
            let end = advance(&params, start, input, (dt_s, steps));
            (end.d_m - exact.d_m).abs() + (end.heading_rad - exact.heading_rad).abs()
        };
        let order = libm::log2(error(0.01, 100) / error(0.005, 200));
        assert!((3.7..4.3).contains(&order), "{tires:?}: order {order}");
        // The step in use, against steps 40 times smaller.
        assert!(error(0.01, 100) < 1e-5, "{tires:?}");
    }
}

#[test]
fn tires_agree_at_small_slip_and_part_at_large() {
    let drive = |tires, steer_rad| {
        let params = VehicleParams { tires, ..paper_car() };
        let start = VehicleState { speed_mps: 25.0, ..VehicleState::default() };
        advance(&params, start, ControlInput { accel_mps2: 0.0, steer_rad }, (0.01, 200)).yaw_rate_radps
    };
    let ratio = |steer_rad| drive(TireModel::Pacejka, steer_rad) / drive(TireModel::Linear, steer_rad);
    assert!((ratio(1e-3) - 1.0).abs() < 2e-3, "{}", ratio(1e-3));
    assert!(ratio(0.08) < 0.9, "{}", ratio(0.08));
}

#[test]
fn every_speed_stays_finite() {
    for params in [paper_car(), VehicleParams::default()] {
        for tenths in 0..=600 {
            let speed_mps = f64::from(tenths) * 0.1;
            let start = VehicleState { speed_mps, lateral_speed_mps: 0.2, ..VehicleState::default() };
            let end = advance(&params, start, ControlInput { accel_mps2: -1.0, steer_rad: 0.03 }, (0.01, 150));
            let values = [end.s_m, end.d_m, end.heading_rad, end.speed_mps, end.lateral_speed_mps, end.yaw_rate_radps];
            assert!(values.iter().all(|v| v.is_finite() && v.abs() < 200.0), "{speed_mps}: {end:?}");
            // The linear tire spins out at high speed and 0.03 rad; below that, the yaw rate is that of the steering.
            assert!(end.yaw_rate_radps.abs() < 1.5, "{speed_mps}: {end:?}");
        }
    }
}

#[test]
fn braking_ends_in_an_exact_stop() {
    for drive_lag_s in [0.0, 0.2] {
        let params = VehicleParams { drive_lag_s, ..VehicleParams::default() };
        let start = VehicleState { speed_mps: 20.0, accel_mps2: -8.0, ..VehicleState::default() };
        let brake = ControlInput { accel_mps2: -8.0, steer_rad: 0.0 };
        let end = advance(&params, start, brake, (0.01, 400));
        assert_eq!((end.speed_mps, end.lateral_speed_mps, end.yaw_rate_radps), (0.0, 0.0, 0.0));
        // v² / 2 b, to rounding.
        assert!((end.s_m - 25.0).abs() < 1e-9, "{} m", end.s_m);
        let later = advance(&params, end, brake, (0.01, 100));
        assert_eq!(later, end);
        let off = advance(&params, later, ControlInput { accel_mps2: 1.0, steer_rad: 0.0 }, (0.01, 100));
        assert!(off.speed_mps > 0.5);
    }
}

#[test]
fn the_road_bounds_the_braking() {
    let wet = Contact { adhesion: 0.4, ..DRY };
    let start = VehicleState { speed_mps: 30.0, ..VehicleState::default() };
    let input = ControlInput { accel_mps2: -8.0, steer_rad: 0.0 };
    let params = paper_car();
    let end = (0..100).fold(start, |state, _| step(&params, &state, &input, &wet, 0.01));
    assert!((start.speed_mps - end.speed_mps - 0.4 * 9.81).abs() < 1e-9);
}

#[test]
fn a_straight_line_across_a_bend_is_straight() {
    // Without steering the car leaves a circle of radius R along its tangent: (R − d)² = R² + s².
    let bend = Contact { curvature_radpm: 0.01, ..DRY };
    let start = VehicleState { speed_mps: 20.0, ..VehicleState::default() };
    let params = paper_car();
    let end = (0..100).fold(start, |state, _| step(&params, &state, &ControlInput::default(), &bend, 0.01));
    let d_m = 100.0 - libm::hypot(100.0, 20.0);
    assert!((end.d_m - d_m).abs() < 1e-8 && (end.heading_rad + libm::atan(0.2)).abs() < 1e-9, "{end:?}");
}

#[test]
fn the_discrete_model_follows_the_plant_at_small_angles() {
    for lag_s in [0.0, 0.1] {
        let params = VehicleParams { steer_lag_s: lag_s, max_steer_rate_radps: 5.0, ..paper_car() };
        let model = DiscreteBicycle::new(&params, 28.0, 0.05);
        let start = VehicleState {
            speed_mps: 28.0,
            lateral_speed_mps: 2e-3,
            heading_rad: 1e-4,
            yaw_rate_radps: 1e-3,
            steer_rad: 1e-4,
            ..VehicleState::default()
        };
        let change = 1e-4;
        let command = start.steer_rad + change / lag_response(lag_s, 0.05);
        // Without lag the plant still turns the wheel at its rate limit, 2e-5 s here.
        let end = advance(&params, start, ControlInput { accel_mps2: 0.0, steer_rad: command }, (0.001, 50));
        let x = [0.0, 2e-3, 1e-4, 1e-3, 1e-4];
        let seen = [end.d_m, end.lateral_speed_mps, end.heading_rad, end.yaw_rate_radps, end.steer_rad];
        for (i, value) in seen.iter().enumerate() {
            let predicted: f64 = model.b[i] * change + model.a[i].iter().zip(&x).map(|(a, x)| a * x).sum::<f64>();
            assert!(
                (predicted - value).abs() < 1e-3 * value.abs() + 1e-9,
                "lag {lag_s}, state {i}: {predicted} {value}"
            );
        }
    }
}
