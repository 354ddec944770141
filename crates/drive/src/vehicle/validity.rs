//! The plant against an independent integration of the same equations, against closed forms, and at its limits.

use super::tire::axle_force_n;
use super::*;

const G: f64 = 9.81;

/// What one drive is made of.
struct Case {
    params: VehicleParams,
    contact: Contact,
    input: ControlInput,
}

/// The equations written out a second time, for the second source: [s, d, φ, `V_x`, `V_y`, γ, δ, a] with both actuators as lags.
fn equations(case: &Case, x: &[f64; 8]) -> [f64; 8] {
    let (p, c) = (&case.params, &case.contact);
    let &[_, d, phi, vx, vy, yaw, steer, accel] = x;
    let force = |stiffness: f64, load: f64, slip: f64| match p.tires {
        TireModel::Pacejka => {
            let peak = c.adhesion * load;
            -peak * libm::sin(1.3 * libm::atan(2.0 * stiffness * slip / (1.3 * peak)))
        }
        _ => -2.0 * stiffness * slip,
    };
    let (lf, lr, m) = (p.front_axle_m, p.rear_axle_m, p.mass_kg);
    let front = force(p.front_stiffness_nprad, m * G * lr / (lf + lr), (vy + lf * yaw) / vx - steer);
    let rear = force(p.rear_stiffness_nprad, m * G * lf / (lf + lr), (vy - lr * yaw) / vx);
    let s_rate = (vx * libm::cos(phi) - vy * libm::sin(phi)) / (1.0 - d * c.curvature_radpm);
    let slope = libm::atan(c.grade);
    [
        s_rate,
        vx * libm::sin(phi) + vy * libm::cos(phi),
        yaw - c.curvature_radpm * s_rate,
        accel + vy * yaw - G * libm::sin(slope),
        (front + rear + c.side_force_n) / m - G * libm::sin(c.bank_rad) - vx * yaw,
        (lf * front - lr * rear + c.yaw_moment_nm) / p.yaw_inertia_kgm2,
        (case.input.steer_rad - steer) / p.steer_lag_s,
        (case.input.accel_mps2 - accel) / p.drive_lag_s,
    ]
}

/// `x` after `step_s` by Gragg's modified midpoint rule in 2, 4, … 14 pieces, extrapolated to none (Bulirsch and Stoer,
/// 1966): order 14.
fn extrapolated(case: &Case, x: &[f64; 8], step_s: f64) -> [f64; 8] {
    const COLUMNS: usize = 7;
    let mut table = [[0.0; 8]; COLUMNS];
    for row in 0..COLUMNS {
        let pieces = 2 * (row + 1);
        let h = step_s / pieces as f64;
        let (mut before, mut now) = (*x, along(x, &equations(case, x), h));
        for _ in 1..pieces {
            (before, now) = (now, along(&before, &equations(case, &now), 2.0 * h));
        }
        let last = along(&before, &equations(case, &now), h);
        let mut value: [f64; 8] = core::array::from_fn(|i| 0.5 * (now[i] + last[i]));
        for (column, coarser) in table.iter_mut().enumerate().take(row) {
            let ratio = (row + 1) as f64 / (row - column) as f64;
            let better = core::array::from_fn(|i| value[i] + (value[i] - coarser[i]) / (ratio * ratio - 1.0));
            *coarser = core::mem::replace(&mut value, better);
        }
        table[row] = value;
    }
    table[COLUMNS - 1]
}

fn along(x: &[f64; 8], rate: &[f64; 8], time_s: f64) -> [f64; 8] {
    core::array::from_fn(|i| x[i] + time_s * rate[i])
}

fn reference(case: &Case, speed_mps: f64, steps: u32) -> [f64; 8] {
    let start = [0.0, 0.0, 0.0, speed_mps, 0.0, 0.0, 0.0, 0.0];
    (0..steps).fold(start, |x, _| extrapolated(case, &x, 0.01))
}

fn driven(case: &Case, speed_mps: f64, (dt_s, steps): (f64, u32)) -> VehicleState {
    let start = VehicleState { speed_mps, ..VehicleState::default() };
    (0..steps).fold(start, |state, _| step(&case.params, &state, &case.input, &case.contact, dt_s))
}

fn cases() -> [Case; 3] {
    let car = |tires| VehicleParams { tires, ..VehicleParams::default() };
    let dry = Contact { adhesion: 0.85, ..Contact::default() };
    let rough = Contact {
        curvature_radpm: 1e-3,
        grade: 0.04,
        bank_rad: 0.03,
        side_force_n: 600.0,
        yaw_moment_nm: 200.0,
        ..dry
    };
    // 0.02 rad and a wheel that never meets its rate limit.
    let input = ControlInput { accel_mps2: -1.0, steer_rad: 0.02 };
    [
        Case { params: car(TireModel::Linear), contact: dry, input },
        Case { params: car(TireModel::Pacejka), contact: dry, input },
        Case { params: car(TireModel::Pacejka), contact: rough, input },
    ]
}

#[test]
fn four_seconds_end_where_an_independent_integration_ends() {
    for case in cases() {
        let exact = reference(&case, 25.0, 400);
        let fine = driven(&case, 25.0, (0.000_5, 8000));
        let error_m = libm::hypot(fine.s_m - exact[0], fine.d_m - exact[1]);
        assert!(error_m < 1e-9, "{:?}: {error_m} m", case.params.tires);
        // The step in use: far below any sensor.
        let used = driven(&case, 25.0, (0.01, 400));
        let error_m = libm::hypot(used.s_m - exact[0], used.d_m - exact[1]);
        assert!(error_m < 1e-4, "{:?}: {error_m} m", case.params.tires);
    }
}

#[test]
fn the_order_of_convergence_is_four() {
    for case in cases() {
        // After 0.3 s, where both lateral modes are still moving.
        let exact = reference(&case, 25.0, 30);
        let error = |dt_s, steps| {
            let end = driven(&case, 25.0, (dt_s, steps));
            libm::hypot(end.lateral_speed_mps - exact[4], end.yaw_rate_radps - exact[5])
        };
        let order = libm::log2(error(0.002_5, 120) / error(0.001_25, 240));
        assert!((3.9..4.1).contains(&order), "{:?}: order {order}", case.params.tires);
    }
}

#[test]
fn tires_saturate_at_what_the_load_and_the_road_give() {
    for tires in [TireModel::Dugoff, TireModel::Pacejka] {
        for adhesion in [0.85, 0.4, 0.1] {
            let peak_n = adhesion * 7570.0;
            let forces = (0..4000).map(|i| -axle_force_n(tires, 85_000.0, peak_n, f64::from(i) * 5e-4));
            let largest = forces.fold(0.0, f64::max);
            assert!(largest <= peak_n && largest > 0.98 * peak_n, "{tires:?}, μ {adhesion}: {largest} of {peak_n}");
        }
        // Never more than the road gives across the car, however it is steered.
        let params = VehicleParams { tires, ..VehicleParams::default() };
        let wet = Contact { adhesion: 0.4, ..Contact::default() };
        let mut state = VehicleState { speed_mps: 30.0, ..VehicleState::default() };
        for k in 0..300 {
            let input = ControlInput { accel_mps2: 0.0, steer_rad: if k < 150 { 0.1 } else { -0.1 } };
            let next = step(&params, &state, &input, &wet, 0.01);
            let mean = |a: f64, b: f64| 0.5 * (a + b);
            let across = (next.lateral_speed_mps - state.lateral_speed_mps) / 0.01
                + mean(next.speed_mps, state.speed_mps) * mean(next.yaw_rate_radps, state.yaw_rate_radps);
            // The mean over a step is taken to second order only.
            assert!(across.abs() < 0.4 * G * 1.02, "{tires:?}, step {k}: {across}");
            state = next;
        }
    }
}

#[test]
fn dugoff_tires_are_linear_up_to_half_their_peak_and_smooth_there() {
    let force = |slip| axle_force_n(TireModel::Dugoff, 85_000.0, 6000.0, slip);
    let knee = 3000.0 / 170_000.0;
    assert!((force(0.5 * knee) + 1500.0).abs() < 1e-9 && (force(-0.5 * knee) - 1500.0).abs() < 1e-9);
    let slope = |slip: f64| (force(slip + 1e-7) - force(slip - 1e-7)) / 2e-7;
    assert!((slope(knee * 1.000_1) / slope(knee * 0.999_9) - 1.0).abs() < 1e-3);
    // Dugoff's form (2 − λ) λ at twice the knee, λ = 1/2: 3/4 of the linear force.
    assert!((force(2.0 * knee) + 0.75 * 6000.0).abs() < 1e-9);
}

#[test]
fn axle_loads_move_by_the_closed_form() {
    let (params, h) = (VehicleParams::default(), 0.54);
    let (m, lf, lr) = (1274.0, 1.016, 1.562);
    let moving = PlantConfig { load_transfer: LoadTransfer::QuasiStatic, ..PlantConfig::default() };
    for accel in [-8.0, 0.0, 2.0] {
        let (front, rear) = moving.axle_loads_n(&params, accel);
        assert!((front + rear - m * G).abs() < 1e-9);
        // Moments about the center of gravity: F_zr L_r − F_zf L_f = M a h.
        assert!((rear * lr - front * lf - m * accel * h).abs() < 1e-9);
        let (front, rear) = PlantConfig::default().axle_loads_n(&params, accel);
        assert!((rear * lr - front * lf).abs() < 1e-9 && (front + rear - m * G).abs() < 1e-9);
    }
}

/// Lateral acceleration after 0.3 s of steering by 0.1 rad on a wet road, its speed held.
fn cornering_mps2(options: &PlantConfig, accel_mps2: f64) -> f64 {
    let params =
        VehicleParams { steer_lag_s: 0.0, drive_lag_s: 0.0, max_steer_rate_radps: 5.0, ..VehicleParams::default() };
    let wet = Contact { adhesion: 0.4, ..Contact::default() };
    let mut state = VehicleState { speed_mps: 25.0, accel_mps2, ..VehicleState::default() };
    let input = ControlInput { accel_mps2, steer_rad: 0.1 };
    let mut across = 0.0;
    for _ in 0..30 {
        let next = step_with(&params, options, &state, &input, &wet, 0.01);
        across = (next.lateral_speed_mps - state.lateral_speed_mps) / 0.01 + 25.0 * next.yaw_rate_radps;
        state = VehicleState { speed_mps: 25.0, ..next };
    }
    across
}

#[test]
fn braking_costs_cornering_where_grip_is_shared() {
    let apart = PlantConfig::default();
    let shared = PlantConfig { combined_grip: true, ..PlantConfig::default() };
    // Braking changes the speed within a step.
    assert!((cornering_mps2(&apart, -3.0) / cornering_mps2(&apart, 0.0) - 1.0).abs() < 0.01);
    assert!((cornering_mps2(&shared, 0.0) / cornering_mps2(&apart, 0.0) - 1.0).abs() < 1e-9);
    // At 3 of 3.924 m/s² the ellipse leaves 0.645 of the grip; the rear axle is not at its limit.
    let ratio = cornering_mps2(&shared, -3.0) / cornering_mps2(&shared, 0.0);
    assert!((0.60..0.75).contains(&ratio), "{ratio}");
}

#[test]
fn a_heavier_car_answers_a_command_less() {
    let params = VehicleParams { drive_lag_s: 0.0, ..VehicleParams::default() };
    let dry = Contact { adhesion: 0.85, ..Contact::default() };
    for mass_factor in [0.8, 1.0, 1.2] {
        let options = PlantConfig { mass_factor, ..PlantConfig::default() };
        let start = VehicleState { speed_mps: 20.0, ..VehicleState::default() };
        let input = ControlInput { accel_mps2: 1.5, steer_rad: 0.0 };
        let end = step_with(&params, &options, &start, &input, &dry, 0.01);
        assert!((end.speed_mps - 20.0 - 0.015 / mass_factor).abs() < 1e-12);
    }
}

#[test]
fn a_grade_is_held_at_rest_and_driven_off_on() {
    let params = VehicleParams::default();
    let uphill = Contact { adhesion: 0.85, grade: 0.1, ..Contact::default() };
    let drive = |state: VehicleState, accel_mps2: f64, steps| {
        let input = ControlInput { accel_mps2, steer_rad: 0.0 };
        (0..steps).fold(state, |state, _| step(&params, &state, &input, &uphill, 0.01))
    };
    let rolling = VehicleState { speed_mps: 3.0, ..VehicleState::default() };
    let stopped = drive(rolling, 0.0, 600);
    assert_eq!(stopped.speed_mps, 0.0);
    // 3² / (2 g sin θ).
    assert!((stopped.s_m - 9.0 / (2.0 * G * libm::sin(libm::atan(0.1)))).abs() < 1e-6, "{} m", stopped.s_m);
    assert_eq!(drive(stopped, 0.5, 300).s_m, stopped.s_m);
    assert!(drive(stopped, 2.0, 300).speed_mps > 2.0);
}

#[test]
fn nothing_becomes_infinite_with_all_options() {
    let options = PlantConfig {
        load_transfer: LoadTransfer::QuasiStatic,
        combined_grip: true,
        mass_factor: 0.8,
        ..PlantConfig::default()
    };
    for tires in [TireModel::Dugoff, TireModel::Pacejka] {
        let params = VehicleParams { tires, ..VehicleParams::default() };
        for tenths in 0..=600 {
            let mut state = VehicleState { speed_mps: f64::from(tenths) * 0.1, ..VehicleState::default() };
            for k in 0..100 {
                let contact = Contact {
                    adhesion: if k % 20 < 10 { 0.85 } else { 0.1 },
                    grade: -0.05,
                    bank_rad: 0.05,
                    side_force_n: 800.0,
                    ..Contact::default()
                };
                let input = ControlInput { accel_mps2: -8.0, steer_rad: 0.05 };
                state = step_with(&params, &options, &state, &input, &contact, 0.01);
                let values = [state.s_m, state.d_m, state.heading_rad, state.lateral_speed_mps, state.yaw_rate_radps];
                assert!(values.iter().all(|v| v.is_finite() && v.abs() < 200.0) && state.speed_mps >= 0.0, "{state:?}");
            }
        }
    }
}

#[test]
fn a_delay_moves_the_answer_by_itself_and_nothing_else() {
    let late = VehicleParams { steer_delay_s: 0.12, drive_delay_s: 0.2, ..VehicleParams::default() };
    let mut prompt = Plant::SingleTrack(SingleTrack::new(&VehicleParams::default(), &PlantConfig::default(), 0.01));
    let mut delayed = Plant::SingleTrack(SingleTrack::new(&late, &PlantConfig::default(), 0.01));
    let dry = Contact { adhesion: 0.85, ..Contact::default() };
    let start = VehicleState { speed_mps: 25.0, ..VehicleState::default() };
    let command = |k: u32| ControlInput { accel_mps2: if k < 30 { -2.0 } else { 1.0 }, steer_rad: 0.01 };
    let (mut one, mut other, mut copy) = (start, start, None);
    let mut seen = [Vec::new(), Vec::new()];
    for k in 0..80 {
        one = prompt.step(&one, &command(k), &dry, 0.01);
        other = delayed.step(&other, &command(k), &dry, 0.01);
        seen[0].push((one.steer_rad, one.accel_mps2));
        seen[1].push((other.steer_rad, other.accel_mps2));
        if k == 25 {
            copy = Some((delayed.clone(), other));
        }
    }
    for k in 0..60 {
        assert_eq!((seen[0][k].0, seen[0][k].1), (seen[1][k + 12].0, seen[1][k + 20].1));
    }
    let (mut plant, mut state) = copy.unwrap();
    for k in 26..80 {
        state = plant.step(&state, &command(k), &dry, 0.01);
    }
    assert_eq!(state, other);
}

/// (V̇_y, γ̇) of the sliding car with the wheel straight.
fn lateral_rates(params: &VehicleParams, adhesion: f64, speed_mps: f64, vy: f64, yaw: f64) -> [f64; 2] {
    let p = params;
    let (front_n, rear_n) = tire::axle_loads_n(p);
    let (front_slip, rear_slip) = tire::slip_angles_rad(p, speed_mps, vy, yaw, 0.0);
    let front = axle_force_n(p.tires, p.front_stiffness_nprad, adhesion * front_n, front_slip);
    let rear = axle_force_n(p.tires, p.rear_stiffness_nprad, adhesion * rear_n, rear_slip);
    let turn = (p.front_axle_m * front - p.rear_axle_m * rear) / p.yaw_inertia_kgm2;
    [(front + rear) / p.mass_kg - speed_mps * yaw, turn]
}

/// The equilibrium that Newton's method reaches from here.
fn equilibrium(rates: impl Fn(f64, f64) -> [f64; 2], mut at: [f64; 2]) -> Option<[f64; 2]> {
    for _ in 0..100 {
        let (here, step) = (rates(at[0], at[1]), 1e-6);
        let (by_vy, by_yaw) = (rates(at[0] + step, at[1]), rates(at[0], at[1] + step));
        let j = [0, 1].map(|i| [(by_vy[i] - here[i]) / step, (by_yaw[i] - here[i]) / step]);
        let determinant = j[0][0] * j[1][1] - j[0][1] * j[1][0];
        at[0] -= (here[0] * j[1][1] - j[0][1] * here[1]) / determinant;
        at[1] -= (j[0][0] * here[1] - here[0] * j[1][0]) / determinant;
    }
    let rest = rates(at[0], at[1]);
    (rest[0].abs() + rest[1].abs() < 1e-9 && at[0].is_finite()).then_some(at)
}

#[test]
fn the_phase_plane_has_a_stable_middle_and_a_saddle_where_the_car_spins() {
    // 25 m/s, μ = 0.4, wheel straight (after Ono and others, 1998): beyond the saddle the rear axle has no more to give.
    let params = VehicleParams { steer_lag_s: 0.0, ..VehicleParams::default() };
    let rates = |vy, yaw| lateral_rates(&params, 0.4, 25.0, vy, yaw);
    let middle = equilibrium(rates, [0.1, 0.01]).expect("straight on");
    assert!(middle[0].abs() < 1e-9 && middle[1].abs() < 1e-9);
    let saddle = (1..40)
        .flat_map(|i| (-40..40).map(move |k| [0.25 * f64::from(i), 0.01 * f64::from(k)]))
        .find_map(|guess| equilibrium(rates, guess).filter(|at| at[0] > 0.1 && at[0] < 20.0))
        .expect("a saddle");
    // Its mirror image is one, too.
    let mirrored = rates(-saddle[0], -saddle[1]);
    assert!(mirrored[0].abs() < 1e-9 && mirrored[1].abs() < 1e-9);
    let wet = Contact { adhesion: 0.4, ..Contact::default() };
    let end = |share: f64| {
        let start = VehicleState {
            speed_mps: 25.0,
            lateral_speed_mps: share * saddle[0],
            yaw_rate_radps: share * saddle[1],
            ..VehicleState::default()
        };
        let held =
            |state, _| VehicleState { speed_mps: 25.0, ..step(&params, &state, &ControlInput::default(), &wet, 0.01) };
        (0..400).fold(start, held)
    };
    assert!(end(0.9).lateral_speed_mps.abs() < 0.01, "{saddle:?}: {:?}", end(0.9));
    assert!(end(1.1).lateral_speed_mps.abs() > saddle[0], "{saddle:?}: {:?}", end(1.1));
}
