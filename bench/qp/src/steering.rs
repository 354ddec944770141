//! Lane changes of 3.5 m in 3.0 to 1.6 s, one in four on a slippery road, with gusts and sensor noise.
//!
//! State: lateral speed (m/s), heading (rad), yaw rate (rad/s), offset (m) and, where the input is the steering rate (rad/s)
//! instead of the steering angle (rad), that angle. Rows: slip of the front axle and, one step later, slip of the rear axle,
//! yaw rate and steering angle. The plant's tires saturate; those of the model do not.

use lanecraft_net::random::Stream;
use lanecraft_qp::{Problem, Row, Solver, Start, zero_order_hold};

const MASS_KG: f64 = 1274.0;
const YAW_INERTIA_KGM2: f64 = 606.1;
const FRONT_M: f64 = 1.016;
const REAR_M: f64 = 1.562;
/// Stiffness of one tire, N/rad.
const FRONT_STIFFNESS: f64 = 85_000.0;
const REAR_STIFFNESS: f64 = 112_000.0;
const GRAVITY_MPS2: f64 = 9.81;
const STEP_S: f64 = 0.05;
const LANE_M: f64 = 3.5;
const STEER_MAX_RAD: f64 = 0.14;
const STEER_RATE_MAX_RADPS: f64 = 0.6;
/// Steps from one lane change to the next.
const MANEUVER: usize = 100;
/// A gust every so many steps, the first of them, and the lateral speed it adds.
const GUST_PERIOD: usize = 137;
const GUST_FIRST: usize = 60;
const GUST_MPS: f64 = 0.6;
/// Steps of the plant in one of the controller.
const PLANT_STEPS: u32 = 50;

/// What differs from lane change to lane change.
struct Maneuver {
    duration_s: f64,
    adhesion: f64,
    offset_weight: f64,
    steer_weight: f64,
}

const MANEUVERS: [Maneuver; 4] = [
    Maneuver { duration_s: 3.0, adhesion: 0.85, offset_weight: 10.0, steer_weight: 10.0 },
    Maneuver { duration_s: 2.5, adhesion: 0.85, offset_weight: 20.0, steer_weight: 1.0 },
    Maneuver { duration_s: 2.0, adhesion: 0.4, offset_weight: 5.0, steer_weight: 10.0 },
    Maneuver { duration_s: 1.6, adhesion: 0.85, offset_weight: 10.0, steer_weight: 50.0 },
];

/// The controller's car at one speed, in continuous time: A, row by row, and B.
fn bicycle(speed_mps: f64) -> ([[f64; 4]; 4], [f64; 4]) {
    let (cf, cr, v) = (2.0 * FRONT_STIFFNESS, 2.0 * REAR_STIFFNESS, speed_mps);
    let moment = cf * FRONT_M - cr * REAR_M;
    let damping = cf * FRONT_M * FRONT_M + cr * REAR_M * REAR_M;
    let a = [
        [-(cf + cr) / (MASS_KG * v), 0.0, -v - moment / (MASS_KG * v), 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [-moment / (YAW_INERTIA_KGM2 * v), 0.0, -damping / (YAW_INERTIA_KGM2 * v), 0.0],
        [1.0, v, 0.0, 0.0],
    ];
    (a, [cf / MASS_KG, 0.0, cf * FRONT_M / YAW_INERTIA_KGM2, 0.0])
}

/// Largest lateral force of an axle, N, by its share of the weight.
fn grip(adhesion: f64, other_axle_m: f64) -> f64 {
    adhesion * MASS_KG * GRAVITY_MPS2 * other_axle_m / (FRONT_M + REAR_M)
}

/// Slope of the plant's state (the first four) under a steering angle.
fn slope(x: &[f64; 4], speed_mps: f64, steer_rad: f64, adhesion: f64) -> [f64; 4] {
    let force = |slip: f64, stiffness: f64, limit: f64| -limit * libm::tanh(2.0 * stiffness * slip / limit);
    let front = force((x[0] + FRONT_M * x[2]) / speed_mps - steer_rad, FRONT_STIFFNESS, grip(adhesion, REAR_M));
    let rear = force((x[0] - REAR_M * x[2]) / speed_mps, REAR_STIFFNESS, grip(adhesion, FRONT_M));
    [
        (front + rear) / MASS_KG - speed_mps * x[2],
        x[2],
        (FRONT_M * front - REAR_M * rear) / YAW_INERTIA_KGM2,
        speed_mps * libm::sin(x[1]) + x[0] * libm::cos(x[1]),
    ]
}

/// One step of the classical Runge-Kutta method.
fn runge_kutta(x: &[f64; 4], h: f64, slope: impl Fn(&[f64; 4]) -> [f64; 4]) -> [f64; 4] {
    let toward = |k: &[f64; 4], h: f64| std::array::from_fn(|i| x[i] + h * k[i]);
    let k1 = slope(x);
    let k2 = slope(&toward(&k1, 0.5 * h));
    let k3 = slope(&toward(&k2, 0.5 * h));
    let k4 = slope(&toward(&k3, h));
    std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]))
}

/// Share of the way after a share of the time: the quintic without slope and curvature at its ends.
fn quintic(share: f64) -> f64 {
    let t = share.clamp(0.0, 1.0);
    t * t * t * (10.0 + t * (6.0 * t - 15.0))
}

/// The model at one speed and the limits on one road, made once for all stages of a problem.
struct Car<const NX: usize, const NS: usize> {
    a: [[f64; NX]; NX],
    b: [f64; NX],
    rows: [Row<NX>; NS],
}

impl<const NX: usize, const NS: usize> Car<NX, NS> {
    fn new(speed_mps: f64, adhesion: f64) -> Self {
        let rated = NX == 5;
        let (a4, b4) = bicycle(speed_mps);
        let (mut a, mut b) = ([[0.0; NX]; NX], [[0.0]; NX]);
        for i in 0..4 {
            a[i][..4].copy_from_slice(&a4[i]);
            *if rated { &mut a[i][NX - 1] } else { &mut b[i][0] } = b4[i];
        }
        if rated {
            b[NX - 1] = [1.0];
        }
        let (a, input) = zero_order_hold(&a, &b, STEP_S);
        let b = input.map(|[b]| b);
        Self { a, b, rows: Self::rows(&a, &b, speed_mps, adhesion) }
    }

    fn rows(a: &[[f64; NX]; NX], b: &[f64; NX], speed_mps: f64, adhesion: f64) -> [Row<NX>; NS] {
        let slip = |axle_m: f64| {
            let mut state = [0.0; NX];
            (state[0], state[2]) = (1.0 / speed_mps, axle_m / speed_mps);
            state
        };
        let unit = |i: usize| std::array::from_fn(|j| f64::from(u8::from(i == j)));
        let limit = |state: [f64; NX], input: f64, width: f64, scale: f64| Row {
            state,
            input,
            lower: -width,
            upper: width,
            l1_weight: 2e4 * scale,
            l2_weight: 1e6 * scale,
        };
        let next = |state: [f64; NX], width: f64, scale: f64| {
            let moved = std::array::from_fn(|j| (0..NX).map(|i| state[i] * a[i][j]).sum());
            limit(moved, (0..NX).map(|i| state[i] * b[i]).sum(), width, scale)
        };
        let front_rad = libm::atan(grip(adhesion, REAR_M) / (2.0 * FRONT_STIFFNESS));
        let rear_rad = libm::atan(grip(adhesion, FRONT_M) / (2.0 * REAR_STIFFNESS));
        let mut front = slip(FRONT_M);
        std::array::from_fn(|i| match (i, NX) {
            (0, 5) => {
                front[NX - 1] = -1.0;
                next(front, front_rad, 1.0)
            }
            (0, _) => limit(front, -1.0, front_rad, 1.0),
            (1, _) => next(slip(-REAR_M), rear_rad, 1.0),
            (2, _) => next(unit(2), adhesion * GRAVITY_MPS2 / speed_mps, 0.1),
            _ => next(unit(NX - 1), STEER_MAX_RAD, 1.0),
        })
    }

    fn problem(&self, horizon: usize, maneuver: &Maneuver, offset_m: impl Fn(f64) -> f64) -> Problem<NX, NS> {
        let mut problem = Problem::new(horizon);
        let bound = if NX == 5 { STEER_RATE_MAX_RADPS } else { STEER_MAX_RAD };
        (problem.input_min, problem.input_max) = (-bound, bound);
        for (k, stage) in problem.stages.iter_mut().enumerate() {
            (stage.a, stage.b, stage.rows) = (self.a, self.b, self.rows);
            (stage.state_weight[1], stage.state_weight[3]) =
                (0.2 * maneuver.offset_weight, 2.0 * maneuver.offset_weight);
            stage.state_reference[3] = offset_m((k + 1) as f64 * STEP_S);
            stage.input_weight = 2.0 * maneuver.steer_weight;
            if NX == 5 {
                stage.state_weight[NX - 1] = 2.0 * maneuver.steer_weight;
                stage.input_weight = maneuver.steer_weight;
            }
        }
        problem
    }
}

/// `count` problems at 28 m/s or, if `varying`, at a speed that changes with each of them. The input is the steering angle
/// (NX = 4, NS = 3) or its rate (NX = 5, NS = 4).
pub fn sequence<const NX: usize, const NS: usize>(horizon: usize, varying: bool, count: usize) -> Vec<Problem<NX, NS>> {
    let mut stream = Stream::keyed(1, "bench.steering", NX as u64, horizon as u64);
    let mut solver = Solver::new(horizon);
    let (mut x, mut steer_rad) = ([0.0; 4], 0.0);
    let mut step = |t: usize| {
        let maneuver = &MANEUVERS[t / MANEUVER % 4];
        let from_m = if (t / MANEUVER).is_multiple_of(2) { 0.0 } else { LANE_M };
        let begun_s = (t % MANEUVER) as f64 * STEP_S;
        let speed_mps = if varying { 28.0 + 3.0 * libm::sin(0.02 * t as f64) } else { 28.0 };
        if t % GUST_PERIOD == GUST_FIRST {
            x[0] += GUST_MPS;
        }
        let car = Car::<NX, NS>::new(speed_mps, maneuver.adhesion);
        let mut problem = car.problem(horizon, maneuver, |ahead_s| {
            from_m + (LANE_M - 2.0 * from_m) * quintic((begun_s + ahead_s) / maneuver.duration_s)
        });
        for ((seen, truth), noise) in problem.initial_state.iter_mut().zip(&x).zip([0.01, 0.001, 0.003, 0.02]) {
            *seen = truth + noise * stream.normal();
        }
        if NX == 5 {
            problem.initial_state[NX - 1] = steer_rad;
        }
        let _ = solver.solve(&problem, Start::Cold);
        let u = solver.inputs()[0];
        let h = STEP_S / f64::from(PLANT_STEPS);
        for i in 0..PLANT_STEPS {
            let steer = if NX == 5 { steer_rad + u * h * (f64::from(i) + 0.5) } else { u };
            x = runge_kutta(&x, h, |x| slope(x, speed_mps, steer, maneuver.adhesion));
        }
        steer_rad += u * STEP_S;
        problem
    };
    (0..count).map(&mut step).collect()
}
