//! Lane keeping behind a leader who brakes hard twice in 20 s, with cars that cut in inside the safe gap; the desired
//! acceleration and the weights change each second.
//!
//! State: distance covered from now on (m), speed (m/s) and, with a lagging drivetrain, acceleration (m/s²); the input is the
//! demanded acceleration (m/s²). Rows: speed limits, and the spacing to a leader who is expected to keep his speed.

use lanecraft_net::random::Stream;
use lanecraft_qp::{Problem, Row, Solver, Start, zero_order_hold};

const SPEED_MIN_MPS: f64 = 5.0;
const SPEED_MAX_MPS: f64 = 33.0;
const ACCEL_MIN_MPS2: f64 = -6.0;
const ACCEL_MAX_MPS2: f64 = 2.5;
const SAFE_GAP_M: f64 = 15.0;
/// Time constant of the drivetrain.
const LAG_S: f64 = 0.3;
const L1_WEIGHT: f64 = 2e3;
const L2_WEIGHT: f64 = 1e3;
/// Steps between two cars that cut in, and the first of them.
const CUT_IN_PERIOD: usize = 230;
const CUT_IN_FIRST: usize = 150;
/// Steps of the plant in one of the controller.
const PLANT_STEPS: u32 = 10;

struct Traffic {
    speed_mps: f64,
    accel_mps2: f64,
    gap_m: f64,
    leader_speed_mps: f64,
    leader_accel_mps2: f64,
}

/// Acceleration of the leader at a time, unless he has reached the end of his speed range.
fn leader_accel(time_s: f64, speed_mps: f64) -> f64 {
    let wanted = match time_s % 20.0 {
        t if t < 4.0 => 0.5,
        t if t < 7.0 => -3.0,
        t if t < 12.0 => 1.2,
        t if t < 14.0 => -5.0,
        _ => 1.0,
    };
    let at_end = if wanted > 0.0 { speed_mps >= 32.0 } else { speed_mps <= 12.0 };
    if at_end { 0.0 } else { wanted }
}

fn advance(traffic: &mut Traffic, demand_mps2: f64, step_s: f64, lagging: bool) {
    let h = step_s / f64::from(PLANT_STEPS);
    for _ in 0..PLANT_STEPS {
        traffic.accel_mps2 =
            if lagging { traffic.accel_mps2 + h * (demand_mps2 - traffic.accel_mps2) / LAG_S } else { demand_mps2 };
        traffic.gap_m += h * (traffic.leader_speed_mps - traffic.speed_mps);
        traffic.speed_mps = (traffic.speed_mps + h * traffic.accel_mps2).max(0.0);
        traffic.leader_speed_mps = (traffic.leader_speed_mps + h * traffic.leader_accel_mps2).max(0.0);
    }
}

/// Chain of integrators from the input to the distance; the last one is a lag if there are three.
fn model<const NX: usize>(step_s: f64) -> ([[f64; NX]; NX], [f64; NX]) {
    let (mut a, mut b) = ([[0.0; NX]; NX], [[0.0]; NX]);
    for i in 1..NX {
        a[i - 1][i] = 1.0;
    }
    b[NX - 1] = [1.0];
    if NX == 3 {
        (a[2][2], b[2]) = (-1.0 / LAG_S, [1.0 / LAG_S]);
    }
    let (transition, input) = zero_order_hold(&a, &b, step_s);
    (transition, input.map(|[b]| b))
}

/// What the controller is told anew each second.
struct Orders {
    accel_mps2: f64,
    speed_weight: f64,
}

fn pick(stream: &mut Stream, values: [f64; 3]) -> f64 {
    values[stream.below(3)]
}

fn problem<const NX: usize>(
    (horizon, step_s): (usize, f64),
    traffic: &Traffic,
    orders: &Orders,
    stream: &mut Stream,
) -> Problem<NX, 2> {
    let mut problem = Problem::new(horizon);
    let gap_m = traffic.gap_m + 0.1 * stream.normal();
    let leader_mps = traffic.leader_speed_mps + 0.1 * stream.normal();
    problem.initial_state[1] = traffic.speed_mps + 0.05 * stream.normal();
    if NX == 3 {
        problem.initial_state[2] = traffic.accel_mps2;
    }
    (problem.input_min, problem.input_max) = (ACCEL_MIN_MPS2, ACCEL_MAX_MPS2);
    let (a, b) = model::<NX>(step_s);
    for (k, stage) in problem.stages.iter_mut().enumerate() {
        (stage.a, stage.b) = (a, b);
        (stage.state_weight[1], stage.state_reference[1]) = (2.0 * orders.speed_weight, SPEED_MAX_MPS);
        (stage.input_weight, stage.input_reference) = (8.0 * orders.speed_weight, orders.accel_mps2);
        let next =
            |i: usize| Row { state: a[i], input: b[i], l1_weight: L1_WEIGHT, l2_weight: L2_WEIGHT, ..Row::unbounded() };
        let ahead_s = (k + 1) as f64 * step_s;
        let turn_m = 0.5 * traffic.leader_accel_mps2.clamp(-2.0, 2.0) * ahead_s.min(1.0) * ahead_s;
        let free_m = gap_m + leader_mps * ahead_s + turn_m - SAFE_GAP_M;
        stage.rows = [Row { lower: SPEED_MIN_MPS, upper: SPEED_MAX_MPS, ..next(1) }, Row { upper: free_m, ..next(0) }];
    }
    problem
}

/// `count` problems of `horizon` steps of `step_s`; with NX = 3 the drivetrain lags.
pub fn sequence<const NX: usize>(horizon: usize, step_s: f64, count: usize) -> Vec<Problem<NX, 2>> {
    let mut stream = Stream::keyed(1, "bench.keeping", NX as u64, horizon as u64);
    let mut traffic =
        Traffic { speed_mps: 28.0, accel_mps2: 0.0, gap_m: 40.0, leader_speed_mps: 26.0, leader_accel_mps2: 0.0 };
    let mut orders = Orders { accel_mps2: 0.0, speed_weight: 1.0 };
    let mut solver = Solver::new(horizon);
    let steps_per_second = (1.0 / step_s).round() as usize;
    let mut step = |t: usize| {
        traffic.leader_accel_mps2 = leader_accel(t as f64 * step_s, traffic.leader_speed_mps);
        if t.is_multiple_of(steps_per_second) {
            orders.accel_mps2 = pick(&mut stream, [2.0, 0.0, -2.0]);
            orders.speed_weight = pick(&mut stream, [0.5, 1.0, 2.0]);
        }
        if t % CUT_IN_PERIOD == CUT_IN_FIRST {
            (traffic.gap_m, traffic.leader_speed_mps) = (SAFE_GAP_M - 5.0, traffic.speed_mps - 3.0);
        } else if traffic.gap_m > 120.0 {
            traffic.gap_m = 60.0;
        }
        let problem = problem::<NX>((horizon, step_s), &traffic, &orders, &mut stream);
        let _ = solver.solve(&problem, Start::Cold);
        advance(&mut traffic, solver.inputs()[0], step_s, NX == 3);
        problem
    };
    (0..count).map(&mut step).collect()
}
