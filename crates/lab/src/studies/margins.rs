//! Gain and delay margins of both control loops over speed.
//!
//! Plant and controller are linearized numerically where no bound is active: straight driving in the middle of the lane, and
//! following at the equilibrium distance. The loop is cut at the plant's input: L(z) = K (z − A)⁻¹ B with z = e^(jωh). The gain
//! margins are 1/|L| where L crosses the negative real axis, the delay margin is the smallest (arg L + π)/ω where |L| = 1
//! (Skogestad and Postlethwaite, 2005, section 2.4). The simulated delay margin is the longest pure delay, unknown to the
//! controllers, with which the nonlinear car still comes to rest in its lane; it counts whole steps of 0.01 s.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use lanecraft_drive::control::{LateralReference, SpeedGoal};
use lanecraft_drive::predict::{Forecast, Predictor};
use lanecraft_drive::road::{LaneIndex, Road};
use lanecraft_drive::scene::{Neighbor, Scene, VehicleId};
use lanecraft_drive::vehicle::{Contact, ControlInput, VehicleState, step};

use super::in_parallel;
use super::output::{Figure, StudyError, StudyReport, Table};
use crate::maneuvers::{CarScript, EgoScript, LateralLaw, Maneuver, Measure, Stack};
use crate::report::svg::{Axis, Plot};

const PERIOD_S: f64 = 0.05;
const SUBSTEPS: u32 = 5;
const SPEEDS_MPS: [f64; 6] = [10.0, 15.0, 20.0, 25.0, 30.0, 33.0];
/// Points of the frequency response, from this frequency to half the sampling frequency, rad/s.
const FREQUENCIES: u32 = 4000;
const LOWEST_RADPS: f64 = 0.02;
/// Longest delay tried in simulation, in hundredths of a second.
const DELAY_MAX: u32 = 50;

/// A lateral controller of the study.
#[derive(Clone, Copy)]
struct Law {
    name: &'static str,
    lateral: LateralLaw,
    path_ratio: f64,
}

const LAWS: [Law; 7] = [
    Law { name: "mpc, q2 = 1e-4", lateral: LateralLaw::Mpc, path_ratio: 1e-4 },
    Law { name: "mpc, q2 = 3e-4", lateral: LateralLaw::Mpc, path_ratio: 3e-4 },
    Law { name: "mpc, q2 = 1e-3", lateral: LateralLaw::Mpc, path_ratio: 1e-3 },
    Law { name: "mpc, q2 = 3e-3", lateral: LateralLaw::Mpc, path_ratio: 3e-3 },
    Law { name: "mpc, q2 = 1e-2", lateral: LateralLaw::Mpc, path_ratio: 1e-2 },
    Law { name: "lqr, q2 = 1e-3", lateral: LateralLaw::Lqr, path_ratio: 1e-3 },
    Law { name: "stanley", lateral: LateralLaw::Stanley, path_ratio: 1e-3 },
];

/// How many of them are model-predictive; they come first.
const MPC_LAWS: usize = 5;

/// x⁺ = A x + B u with u = −K x.
struct Loop<const N: usize> {
    a: [[f64; N]; N],
    b: [f64; N],
    k: [f64; N],
}

/// Margins of a loop.
#[derive(Clone, Copy, Debug)]
struct Margins {
    stable: bool,
    /// Largest factor below 1 that destabilizes; 0 if none does.
    gain_low: f64,
    /// Smallest factor above 1 that destabilizes; infinite if none does.
    gain_high: f64,
    phase_deg: f64,
    delay_s: f64,
}

pub(super) fn run() -> Result<StudyReport, StudyError> {
    let cases: Vec<(Law, f64)> = LAWS.iter().flat_map(|&law| SPEEDS_MPS.map(|speed| (law, speed))).collect();
    let lateral =
        in_parallel(&cases, |&(law, speed)| Ok((lateral_loop(law, speed)?.margins(), lateral_delay_s(law, speed)?)))?;
    let following = in_parallel(&SPEEDS_MPS, |&speed| {
        Ok((free_loop(speed)?.margins(), following_loop(speed)?.margins(), following_delay_s(speed)?))
    })?;
    let head = ["loop", "speed m/s", "gain down", "gain up", "phase deg", "delay s", "delay simulated s"];
    let mut table = Table::new("lateral", "Margins of the lateral loop", &head);
    for (&(law, speed), (margins, simulated)) in cases.iter().zip(&lateral) {
        table.rows.push(row(law.name, speed, margins, &format!("{simulated:.2}")));
    }
    let mut speed_table = Table::new("longitudinal", "Margins of the longitudinal loop, q1 = 0.025", &head);
    for (&speed, (free, _, _)) in SPEEDS_MPS.iter().zip(&following) {
        speed_table.rows.push(row("free road", speed, free, "–"));
    }
    for (&speed, (_, behind, simulated)) in SPEEDS_MPS.iter().zip(&following) {
        speed_table.rows.push(row("following", speed, behind, &format!("{simulated:.2}")));
    }
    let least = lateral.iter().take(MPC_LAWS * SPEEDS_MPS.len()).map(|(_, delay)| *delay).fold(f64::INFINITY, f64::min);
    let least_speed = following.iter().map(|(_, _, delay)| *delay).fold(f64::INFINITY, f64::min);
    let summary = format!(
        "Over all speeds and levels of q2, the model-predictive lateral loop bears an unknown pure delay of the steering of at least \
         {least:.2} s, the longitudinal loop one of the drive train of at least {least_speed:.2} s (simulated, the longest tried is \
         {:.2} s).",
        f64::from(DELAY_MAX) / 100.0
    );
    let figures = vec![
        figure(&lateral, "delay", "delay margin, s", |m| m.delay_s),
        figure(&lateral, "gain", "upper gain margin", |m| m.gain_high),
    ];
    Ok(StudyReport {
        name: "margins",
        title: "Gain and delay margins".into(),
        summary,
        tables: vec![table, speed_table],
        figures,
    })
}

fn row(name: &str, speed_mps: f64, m: &Margins, simulated: &str) -> Vec<String> {
    let figure = |value: f64, decimals: usize| {
        if !m.stable {
            "unstable".to_owned()
        } else if value.is_finite() {
            format!("{value:.decimals$}")
        } else {
            "none".to_owned()
        }
    };
    let down = if m.stable && m.gain_low == 0.0 { "none".to_owned() } else { figure(m.gain_low, 2) };
    let figures = [down, figure(m.gain_high, 2), figure(m.phase_deg, 0), figure(m.delay_s, 3)];
    [vec![name.to_owned(), format!("{speed_mps:.0}")], figures.to_vec(), vec![simulated.to_owned()]].concat()
}

fn figure(lateral: &[(Margins, f64)], name: &str, y_name: &str, value: fn(&Margins) -> f64) -> Figure {
    let values = lateral.iter().map(|(margins, _)| value(margins));
    let mut plot = Plot::new(Axis::over("speed, m/s", SPEEDS_MPS), Axis::over(y_name, values.chain([0.0])));
    for (series, chunk) in lateral.chunks(SPEEDS_MPS.len()).enumerate() {
        let points: Vec<[f64; 2]> = SPEEDS_MPS.iter().zip(chunk).map(|(speed, (m, _))| [*speed, value(m)]).collect();
        plot.line(&points, series);
        for point in points {
            plot.point(point, series);
        }
    }
    let title = format!("Lateral loop: {y_name} over speed");
    let legend = LAWS.iter().enumerate().map(|(i, law)| (law.name.to_owned(), i)).collect();
    Figure { name: name.into(), svg: plot.finish(&title), title, legend }
}

impl<const N: usize> Loop<N> {
    fn margins(&self) -> Margins {
        let mut margins = Margins {
            stable: self.is_stable(),
            gain_low: 0.0,
            gain_high: f64::INFINITY,
            phase_deg: f64::INFINITY,
            delay_s: f64::INFINITY,
        };
        let highest = PI / PERIOD_S;
        let ratio = libm::log(highest / LOWEST_RADPS) / f64::from(FREQUENCIES);
        let mut last: Option<[f64; 2]> = None;
        for i in 0..=FREQUENCIES {
            let frequency = LOWEST_RADPS * libm::exp(ratio * f64::from(i));
            let Some(now) = self.response(frequency) else { continue };
            if let Some(before) = last {
                margins.note(before, now, frequency);
            }
            last = Some(now);
        }
        // At half the sampling frequency L is real.
        if let Some([real, _]) = last
            && real < 0.0
        {
            margins.note_gain(-1.0 / real);
        }
        margins
    }

    /// L(e^(jωh)) as real and imaginary part.
    fn response(&self, frequency_radps: f64) -> Option<[f64; 2]> {
        let (sin, cos) = libm::sincos(frequency_radps * PERIOD_S);
        let mut rows = [[[0.0; 2]; N]; N];
        for (i, row) in rows.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = [-self.a[i][j], 0.0];
            }
            row[i] = [row[i][0] + cos, sin];
        }
        let x = solve(rows, self.b.map(|b| [b, 0.0]))?;
        Some(self.k.iter().zip(x).fold([0.0; 2], |sum, (k, x)| [sum[0] + k * x[0], sum[1] + k * x[1]]))
    }

    /// Whether all eigenvalues of A − B K lie inside the unit circle: its powers vanish.
    fn is_stable(&self) -> bool {
        let mut power: [[f64; N]; N] =
            std::array::from_fn(|i| std::array::from_fn(|j| self.a[i][j] - self.b[i] * self.k[j]));
        // 2^16 steps: eigenvalues up to 1 − 5e-4 have died out.
        for _ in 0..16 {
            let square: [[f64; N]; N] =
                std::array::from_fn(|i| std::array::from_fn(|j| (0..N).map(|k| power[i][k] * power[k][j]).sum()));
            power = square;
            if power.iter().flatten().any(|v| !v.is_finite() || v.abs() > 1e100) {
                return false;
            }
        }
        power.iter().flatten().all(|v| v.abs() < 1e-6)
    }
}

impl Margins {
    /// Takes in the crossings between two neighboring points of L.
    fn note(&mut self, before: [f64; 2], now: [f64; 2], frequency_radps: f64) {
        let size = |l: [f64; 2]| libm::hypot(l[0], l[1]);
        if (size(before) - 1.0) * (size(now) - 1.0) <= 0.0 {
            let angle = libm::atan2(now[1], now[0]) + PI;
            let angle = if angle <= 0.0 { angle + TAU } else { angle };
            self.phase_deg = self.phase_deg.min(angle.min(TAU - angle).to_degrees());
            self.delay_s = self.delay_s.min(angle / frequency_radps);
        }
        if before[1] * now[1] <= 0.0 && before[0] < 0.0 && now[0] < 0.0 {
            self.note_gain(-1.0 / now[0]);
        }
    }

    fn note_gain(&mut self, factor: f64) {
        if factor > 1.0 {
            self.gain_high = self.gain_high.min(factor);
        } else {
            self.gain_low = self.gain_low.max(factor);
        }
    }
}

/// x of the complex system M x = b by elimination with pivots; `None` if it is singular.
fn solve<const N: usize>(mut m: [[[f64; 2]; N]; N], mut b: [[f64; 2]; N]) -> Option<[[f64; 2]; N]> {
    let times = |p: [f64; 2], q: [f64; 2]| [p[0] * q[0] - p[1] * q[1], p[0] * q[1] + p[1] * q[0]];
    let minus = |p: [f64; 2], q: [f64; 2]| [p[0] - q[0], p[1] - q[1]];
    let over = |p: [f64; 2], q: [f64; 2]| {
        let size = q[0] * q[0] + q[1] * q[1];
        [(p[0] * q[0] + p[1] * q[1]) / size, (p[1] * q[0] - p[0] * q[1]) / size]
    };
    let size = |p: [f64; 2]| p[0].abs() + p[1].abs();
    for column in 0..N {
        let pivot = (column..N).max_by(|&i, &j| size(m[i][column]).total_cmp(&size(m[j][column])))?;
        if size(m[pivot][column]) == 0.0 {
            return None;
        }
        m.swap(column, pivot);
        b.swap(column, pivot);
        for row in column + 1..N {
            let factor = over(m[row][column], m[column][column]);
            let upper = m[column];
            for (entry, above) in m[row].iter_mut().zip(upper).skip(column) {
                *entry = minus(*entry, times(factor, above));
            }
            b[row] = minus(b[row], times(factor, b[column]));
        }
    }
    for row in (0..N).rev() {
        for column in row + 1..N {
            b[row] = minus(b[row], times(m[row][column], b[column]));
        }
        b[row] = over(b[row], m[row][row]);
    }
    Some(b)
}

/// Central differences of `f` at 0 with these steps.
fn slopes<const N: usize, const M: usize>(steps: [f64; N], f: impl Fn(&[f64; N]) -> [f64; M]) -> [[f64; N]; M] {
    let mut jacobian = [[0.0; N]; M];
    for (j, step) in steps.into_iter().enumerate() {
        let at = |value: f64| {
            let mut x = [0.0; N];
            x[j] = value;
            f(&x)
        };
        let (above, below) = (at(step), at(-step));
        for (row, (a, b)) in jacobian.iter_mut().zip(above.into_iter().zip(below)) {
            row[j] = (a - b) / (2.0 * step);
        }
    }
    jacobian
}

/// The car a control step later on a straight dry road.
fn moved(maneuver: &Maneuver, state: VehicleState, input: &ControlInput) -> VehicleState {
    let contact = Contact { adhesion: maneuver.road.adhesion, ..Contact::default() };
    (0..SUBSTEPS).fold(state, |state, _| step(&maneuver.plant, &state, input, &contact, PERIOD_S / f64::from(SUBSTEPS)))
}

fn scene(maneuver: &Maneuver, ego: VehicleState) -> Result<Scene, StudyError> {
    Ok(Scene {
        road: Arc::new(Road::new(maneuver.road.clone())?),
        ego,
        ego_length_m: maneuver.plant.length_m,
        ego_width_m: maneuver.plant.width_m,
        ego_lane: LaneIndex(0),
        neighbors: Vec::new(),
    })
}

/// x = [d, V_y, φ, γ, δ], u = δ's command.
fn lateral_loop(law: Law, speed_mps: f64) -> Result<Loop<5>, StudyError> {
    let ego = EgoScript { path_ratio: law.path_ratio, ..EgoScript::hold(speed_mps) };
    let maneuver = Maneuver::new("margin", "", ego, 0.0);
    let state = |x: &[f64]| VehicleState {
        d_m: x[0],
        speed_mps,
        lateral_speed_mps: x[1],
        heading_rad: x[2],
        yaw_rate_radps: x[3],
        steer_rad: x[4],
        ..VehicleState::default()
    };
    let response = slopes([1e-4, 1e-4, 1e-5, 1e-5, 1e-5, 1e-5], |x: &[f64; 6]| {
        let next = moved(&maneuver, state(x), &ControlInput { accel_mps2: 0.0, steer_rad: x[5] });
        [next.d_m, next.lateral_speed_mps, next.heading_rad, next.yaw_rate_radps, next.steer_rad]
    });
    let controller = Stack { lateral: law.lateral, ..Stack::default() }.lateral(&maneuver);
    let empty = scene(&maneuver, state(&[0.0; 5]))?;
    let gains = slopes([1e-4, 1e-4, 1e-5, 1e-5, 1e-5], |x: &[f64; 5]| {
        let scene = Scene { ego: state(x), ..empty.clone() };
        let reference = LateralReference::LaneCenter { d_m: 0.0 };
        [-controller.clone().steer(&scene, reference, &[speed_mps], law.path_ratio).steer_rad]
    });
    Ok(Loop { a: response.map(|row| std::array::from_fn(|j| row[j])), b: response.map(|row| row[5]), k: gains[0] })
}

/// x = [V, a], u = a's command, without a leader.
fn free_loop(speed_mps: f64) -> Result<Loop<2>, StudyError> {
    // The highest speed bounds the speed from above; the target lies below it.
    let maneuver = Maneuver::new("margin", "", EgoScript::hold(speed_mps), 0.0);
    let state = |x: &[f64]| VehicleState { speed_mps: speed_mps + x[0], accel_mps2: x[1], ..VehicleState::default() };
    let response = slopes([1e-3, 1e-3, 1e-3], |x: &[f64; 3]| {
        let next = moved(&maneuver, state(x), &ControlInput { accel_mps2: x[2], steer_rad: 0.0 });
        [next.speed_mps, next.accel_mps2]
    });
    let controller = Stack::default().speed(&maneuver);
    let empty = scene(&maneuver, state(&[0.0; 2]))?;
    let goal = SpeedGoal { reference_accel_mps2: 0.0, target_speed_mps: speed_mps, lanes: [Some(LaneIndex(0)), None] };
    let gains = slopes([1e-3, 1e-3], |x: &[f64; 2]| {
        let scene = Scene { ego: state(x), ..empty.clone() };
        [-controller.clone().drive(&scene, &Forecast::default(), &goal, maneuver.ego.speed_ratio).accel_mps2]
    });
    Ok(Loop { a: response.map(|row| [row[0], row[1]]), b: response.map(|row| row[2]), k: gains[0] })
}

/// Drives 120 s behind a leader of this speed; gives the distance at the end, m.
fn equilibrium_gap_m(speed_mps: f64) -> Result<f64, StudyError> {
    let maneuver = behind(speed_mps, 10.0 + speed_mps, 120.0);
    Ok(Measure::FinalGap.of(&maneuver.run(Stack::default())?))
}

/// The ego would drive 5 m/s faster than its leader.
fn behind(speed_mps: f64, gap_m: f64, duration_s: f64) -> Maneuver {
    let ego = EgoScript { target_speed_mps: speed_mps + 5.0, ..EgoScript::hold(speed_mps) };
    let mut maneuver =
        Maneuver::new("margin", "", ego, duration_s).with_cars(vec![CarScript::steady(gap_m, 0, speed_mps)]);
    maneuver.control.speed_max_mps = speed_mps + 10.0;
    maneuver
}

/// x = [gap, V, a], u = a's command, behind a leader of constant speed.
fn following_loop(speed_mps: f64) -> Result<Loop<3>, StudyError> {
    let gap_m = equilibrium_gap_m(speed_mps)?;
    let maneuver = behind(speed_mps, gap_m, 0.0);
    let state = |x: &[f64]| VehicleState { speed_mps: speed_mps + x[1], accel_mps2: x[2], ..VehicleState::default() };
    let response = slopes([1e-3, 1e-3, 1e-3, 1e-3], |x: &[f64; 4]| {
        let next = moved(&maneuver, state(x), &ControlInput { accel_mps2: x[3], steer_rad: 0.0 });
        [x[0] + speed_mps * PERIOD_S - next.s_m, next.speed_mps, next.accel_mps2]
    });
    let controller = Stack::default().speed(&maneuver);
    let empty = scene(&maneuver, state(&[0.0; 3]))?;
    let goal = SpeedGoal {
        reference_accel_mps2: 0.0,
        target_speed_mps: maneuver.ego.target_speed_mps,
        lanes: [Some(LaneIndex(0)), None],
    };
    let gains = slopes([1e-3, 1e-3, 1e-3], |x: &[f64; 3]| {
        let ahead_m = gap_m + x[0] + maneuver.plant.length_m;
        let scene = Scene { ego: state(x), neighbors: vec![leader(ahead_m, speed_mps)], ..empty.clone() };
        let mut forecast = Forecast::default();
        Predictor::ConstantVelocity.forecast(&scene, &mut forecast);
        let mut controller = controller.clone();
        // The safe distance is linearized about the plan before: let it settle.
        let mut accel_mps2 = 0.0;
        for _ in 0..5 {
            accel_mps2 = controller.drive(&scene, &forecast, &goal, maneuver.ego.speed_ratio).accel_mps2;
        }
        [-accel_mps2]
    });
    Ok(Loop { a: response.map(|row| [row[0], row[1], row[2]]), b: response.map(|row| row[3]), k: gains[0] })
}

fn leader(ahead_m: f64, speed_mps: f64) -> Neighbor {
    Neighbor::car(VehicleId(1), LaneIndex(0), 0.0, ahead_m, speed_mps)
}

/// The longest delay, s, for which `holds`, by bisection on hundredths of a second.
fn longest_delay_s(holds: impl Fn(f64) -> Result<bool, StudyError>) -> Result<f64, StudyError> {
    let (mut good, mut bad) = (0, DELAY_MAX + 1);
    while bad - good > 1 {
        let middle = u32::midpoint(good, bad);
        if holds(f64::from(middle) / 100.0)? {
            good = middle;
        } else {
            bad = middle;
        }
    }
    Ok(f64::from(good) / 100.0)
}

fn lateral_delay_s(law: Law, speed_mps: f64) -> Result<f64, StudyError> {
    longest_delay_s(|delay_s| {
        let ego = EgoScript { d_m: 0.02, path_ratio: law.path_ratio, ..EgoScript::hold(speed_mps) };
        let mut maneuver = Maneuver::new("margin", "", ego, 20.0);
        maneuver.plant.steer_delay_s = delay_s;
        let run = maneuver.run(Stack { lateral: law.lateral, ..Stack::default() })?;
        let tail = &run.samples[3 * run.samples.len() / 4..];
        Ok(tail.iter().all(|sample| sample.ego.d_m.abs() < 0.02))
    })
}

fn following_delay_s(speed_mps: f64) -> Result<f64, StudyError> {
    let gap_m = equilibrium_gap_m(speed_mps)?;
    longest_delay_s(|delay_s| {
        let mut maneuver = behind(speed_mps, gap_m + 1.0, 60.0);
        maneuver.plant.drive_delay_s = delay_s;
        let run = maneuver.run(Stack::default())?;
        let tail = &run.samples[3 * run.samples.len() / 4..];
        Ok(tail.iter().all(|sample| (sample.ego.speed_mps - speed_mps).abs() < 0.1))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn margins_of_a_sampled_integrator_are_its_closed_form() {
        // x⁺ = x + h u, u = −k x: unstable from k = 2 / h on; crossover at 2 sin(ω h / 2) = k h with phase π/2 − ω h / 2.
        let k = 4.0;
        let margins = Loop { a: [[1.0]], b: [PERIOD_S], k: [k] }.margins();
        assert!(margins.stable && margins.gain_low == 0.0);
        assert!((margins.gain_high / (2.0 / (k * PERIOD_S)) - 1.0).abs() < 1e-6, "{margins:?}");
        let half = libm::asin(0.5 * k * PERIOD_S);
        // The grid of frequencies is 0.2 % wide.
        assert!((margins.phase_deg - (0.5 * PI - half).to_degrees()).abs() < 0.1, "{margins:?}");
        assert!((margins.delay_s / ((0.5 * PI - half) / (2.0 * half / PERIOD_S)) - 1.0).abs() < 5e-3);
        assert!(!Loop { a: [[1.0]], b: [PERIOD_S], k: [41.0] }.margins().stable);
    }

    #[test]
    fn linear_and_simulated_delay_margins_agree() {
        let margins = lateral_loop(LAWS[2], 25.0).unwrap().margins();
        let simulated = lateral_delay_s(LAWS[2], 25.0).unwrap();
        // The plant's delay comes in steps of 0.01 s, and the steering's rate limit adds some of its own.
        assert!(margins.stable && (margins.delay_s - simulated).abs() < 0.025, "{margins:?} {simulated}");
    }
}
