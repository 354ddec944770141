//! String stability: a platoon of eight own cars behind a leader whose speed changes.
//!
//! A platoon is string stable if the error of the speed does not grow from car to car (Swaroop and Hedrick, 1996). Measured
//! are the largest and the root-mean-square deviation of each car from the speed before the disturbance, for a braking pulse of
//! the leader and for sines; each car's own controllers, guard and plant drive it behind the one before.

use std::f64::consts::TAU;
use std::sync::Arc;

use lanecraft_drive::control::classical::SpeedController;
use lanecraft_drive::control::{Guard, SpeedGoal};
use lanecraft_drive::predict::{Forecast, Predictor};
use lanecraft_drive::road::{LaneIndex, Road};
use lanecraft_drive::scene::{Neighbor, Scene, VehicleId};
use lanecraft_drive::vehicle::{Contact, ControlInput, VehicleParams, VehicleState, step};

use super::in_parallel;
use super::output::{Figure, StudyError, StudyReport, Table};
use crate::maneuvers::{EgoScript, Maneuver, SpeedLaw, Stack};
use crate::report::svg::{Axis, Plot};

const CARS: usize = 8;
const PERIOD_S: f64 = 0.05;
const SUBSTEPS: u32 = 5;
/// Speed before the disturbance, m/s.
const SPEED_MPS: f64 = 25.0;
/// Until then the platoon settles, s.
const SETTLE_S: f64 = 60.0;
/// Time gaps tried for the model-predictive controller, s; its own is the first.
const HEADWAYS_S: [f64; 6] = [0.5, 0.8, 1.0, 1.2, 1.5, 2.0];
/// A smaller deviation of the speed is what is left of the start, m/s.
const NOTHING_LEFT_MPS: f64 = 0.02;
/// Periods of the sines, s.
const SINE_PERIODS_S: [f64; 5] = [4.0, 8.0, 12.0, 20.0, 40.0];

/// How the leader's speed departs from [`SPEED_MPS`], at the time after the settling.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Disturbance {
    /// −2 m/s² for 2.5 s, 2 s of rest, +1 m/s² back.
    Pulse,
    /// 1 m/s with this period, s.
    Sine(f64),
}

impl Disturbance {
    fn speed_mps(self, time_s: f64) -> f64 {
        let past_s = time_s - SETTLE_S;
        match self {
            _ if past_s <= 0.0 => SPEED_MPS,
            Self::Pulse => {
                let lost = 2.0 * past_s.min(2.5);
                SPEED_MPS - lost + (past_s - 4.5).clamp(0.0, 5.0)
            }
            Self::Sine(period_s) => SPEED_MPS + libm::sin(TAU * past_s / period_s),
        }
    }

    fn name(self) -> String {
        match self {
            Self::Pulse => "braking pulse".into(),
            Self::Sine(period_s) => format!("sine, {period_s:.0} s"),
        }
    }

    /// How long it is watched, s.
    fn watch_s(self) -> f64 {
        match self {
            Self::Pulse => 60.0,
            Self::Sine(period_s) => 40.0_f64.max(6.0 * period_s),
        }
    }
}

/// Speeds of the leader and of every car after the settling, one row for each control step.
struct Drive {
    speeds_mps: Vec<[f64; CARS + 1]>,
    smallest_gap_m: f64,
}

impl Drive {
    /// Largest deviation of each car from the speed before, m/s; for sines, of the last third.
    fn peaks(&self, disturbance: Disturbance) -> [f64; CARS + 1] {
        let skip = if disturbance == Disturbance::Pulse { 0 } else { 2 * self.speeds_mps.len() / 3 };
        let mut peaks = [0.0_f64; CARS + 1];
        for row in &self.speeds_mps[skip..] {
            for (peak, speed) in peaks.iter_mut().zip(row) {
                *peak = peak.max((speed - SPEED_MPS).abs());
            }
        }
        peaks
    }
}

/// One car with its mind.
struct Member {
    scene: Scene,
    speed: SpeedController,
    guard: Guard,
}

pub(super) fn run() -> Result<StudyReport, StudyError> {
    let disturbances: Vec<Disturbance> =
        std::iter::once(Disturbance::Pulse).chain(SINE_PERIODS_S.map(Disturbance::Sine)).collect();
    let cases: Vec<(SpeedLaw, Disturbance)> =
        [SpeedLaw::Mpc, SpeedLaw::Pi].iter().flat_map(|&law| disturbances.iter().map(move |&d| (law, d))).collect();
    let drives = in_parallel(&cases, |&(law, disturbance)| platoon(law, disturbance, HEADWAYS_S[0]))?;
    let mut table = Table::new(
        "peaks",
        "Largest deviation of the speed, m/s, of the leader (0) and the cars behind; growth = last car over first; step = worst from one car to the next",
        &["law", "disturbance", "0", "1", "2", "4", "6", "8", "growth", "step", "smallest gap m"],
    );
    let mut worst = [0.0_f64; 2];
    for (&(law, disturbance), drive) in cases.iter().zip(&drives) {
        let peaks = drive.peaks(disturbance);
        let growth = peaks[CARS] / peaks[1];
        let step = worst_step(&peaks);
        worst[law as usize] = worst[law as usize].max(step);
        let mut row = vec![law_name(law).to_owned(), disturbance.name()];
        row.extend([0, 1, 2, 4, 6, 8].map(|car| format!("{:.3}", peaks[car])));
        row.extend([growth, step, drive.smallest_gap_m].map(|value| format!("{value:.3}")));
        table.rows.push(row);
    }
    let figures = cases.iter().zip(&drives).filter(|(case, _)| case.1 == Disturbance::Pulse);
    let mut figures: Vec<Figure> = figures.map(|(&(law, _), drive)| pulse_figure(law, drive)).collect();
    figures.push(growth_figure(&cases, &drives));
    let headways = headways()?;
    let summary = format!(
        "Worst amplification of the speed's deviation from one car to the next: {:.3} with model-predictive control, {:.3} with \
         proportional-integral control at a time gap of 1.2 s. Up to 1, a platoon is string stable.",
        worst[0], worst[1]
    );
    Ok(StudyReport {
        name: "string-stability",
        title: "String stability of a platoon of eight".into(),
        summary,
        tables: vec![table, headways],
        figures,
    })
}

/// Worst amplification from one car to the next, as long as there is something left to amplify.
fn worst_step(peaks: &[f64; CARS + 1]) -> f64 {
    let steps = peaks.windows(2).filter(|pair| pair[0] > NOTHING_LEFT_MPS);
    steps.map(|pair| pair[1] / pair[0]).fold(0.0, f64::max)
}

/// What a longer time gap does to the model-predictive platoon.
fn headways() -> Result<Table, StudyError> {
    let cases: Vec<(f64, Disturbance)> =
        HEADWAYS_S.iter().flat_map(|&gap| SINE_PERIODS_S.map(|period| (gap, Disturbance::Sine(period)))).collect();
    let steps = in_parallel(&cases, |&(gap, disturbance)| {
        Ok(worst_step(&platoon(SpeedLaw::Mpc, disturbance, gap)?.peaks(disturbance)))
    })?;
    let names = SINE_PERIODS_S.map(|period_s| Disturbance::Sine(period_s).name());
    let mut head = vec!["time gap s"];
    head.extend(names.iter().map(String::as_str));
    let mut table = Table::new(
        "headways",
        "Worst amplification from one car to the next by the time gap of the spacing, mpc",
        &head,
    );
    for (gap, chunk) in HEADWAYS_S.iter().zip(steps.chunks(SINE_PERIODS_S.len())) {
        let cells = chunk.iter().map(|step| format!("{step:.3}"));
        table.rows.push(std::iter::once(format!("{gap:.1}")).chain(cells).collect());
    }
    Ok(table)
}

fn law_name(law: SpeedLaw) -> &'static str {
    match law {
        SpeedLaw::Mpc => "mpc",
        SpeedLaw::Pi => "pi",
    }
}

fn platoon(law: SpeedLaw, disturbance: Disturbance, headway_s: f64) -> Result<Drive, StudyError> {
    let params = VehicleParams::default();
    let mut maneuver = Maneuver::new("platoon", "", EgoScript::hold(SPEED_MPS), 0.0);
    maneuver.control.spacing_headway_s = headway_s;
    let road = Arc::new(Road::new(maneuver.road.clone())?);
    // Near the final one, so that the platoon settles in time.
    let spacing_m = 15.0 + params.length_m + headway_s * SPEED_MPS;
    let stack = Stack { speed: law, ..Stack::default() };
    let mut members: Vec<Member> = (0..CARS)
        .map(|i| Member {
            scene: Scene {
                road: Arc::clone(&road),
                ego: VehicleState {
                    s_m: -spacing_m * (i as f64 + 1.0),
                    speed_mps: SPEED_MPS,
                    ..VehicleState::default()
                },
                ego_length_m: params.length_m,
                ego_width_m: params.width_m,
                ego_lane: LaneIndex(0),
                neighbors: Vec::new(),
            },
            speed: stack.speed(&maneuver),
            guard: Guard::new(&maneuver.control, &params, PERIOD_S),
        })
        .collect();
    let mut drive = Drive { speeds_mps: Vec::new(), smallest_gap_m: f64::INFINITY };
    let mut leader = VehicleState { speed_mps: SPEED_MPS, ..VehicleState::default() };
    let mut forecast = Forecast::default();
    for k in 0..((SETTLE_S + disturbance.watch_s()) / PERIOD_S) as u32 {
        let time_s = f64::from(k) * PERIOD_S;
        let mut ahead = leader;
        for member in &mut members {
            let now = member.scene.ego;
            let gap_m = member.advance(&ahead, &params, &mut forecast);
            drive.smallest_gap_m = drive.smallest_gap_m.min(gap_m);
            ahead = now;
        }
        let next_mps = disturbance.speed_mps(time_s + PERIOD_S);
        leader.s_m += 0.5 * (leader.speed_mps + next_mps) * PERIOD_S;
        leader.accel_mps2 = (next_mps - leader.speed_mps) / PERIOD_S;
        leader.speed_mps = next_mps;
        if time_s >= SETTLE_S {
            let speed = |car: usize| if car == 0 { leader.speed_mps } else { members[car - 1].scene.ego.speed_mps };
            drive.speeds_mps.push(std::array::from_fn(speed));
        }
    }
    Ok(drive)
}

impl Member {
    /// One control step behind a car in state `ahead`; gives the gap before it, m.
    fn advance(&mut self, ahead: &VehicleState, params: &VehicleParams, forecast: &mut Forecast) -> f64 {
        let lane = LaneIndex(0);
        let car = Neighbor::car(VehicleId(1), lane, 0.0, ahead.s_m - self.scene.ego.s_m, ahead.speed_mps);
        let (length_m, width_m) = (params.length_m, params.width_m);
        let neighbor = Neighbor { accel_mps2: ahead.accel_mps2, length_m, width_m, ..car };
        let gap_m = neighbor.gap_m(params.length_m);
        self.scene.neighbors = vec![neighbor];
        Predictor::ConstantVelocity.forecast(&self.scene, forecast);
        let goal = SpeedGoal { reference_accel_mps2: 0.0, target_speed_mps: 33.333, lanes: [Some(lane), None] };
        let command = self.speed.drive(&self.scene, forecast, &goal, 0.025);
        let wanted = ControlInput { accel_mps2: command.accel_mps2, steer_rad: 0.0 };
        let (input, _) = self.guard.check(&self.scene, [Some(lane), None], wanted);
        self.speed.sent(input.accel_mps2);
        self.guard.sent(input);
        let contact = Contact { adhesion: self.scene.road.adhesion(), ..Contact::default() };
        for _ in 0..SUBSTEPS {
            self.scene.ego = step(params, &self.scene.ego, &input, &contact, PERIOD_S / f64::from(SUBSTEPS));
        }
        gap_m
    }
}

fn pulse_figure(law: SpeedLaw, drive: &Drive) -> Figure {
    let shown = drive.speeds_mps.len().min((40.0 / PERIOD_S) as usize);
    let speeds = drive.speeds_mps[..shown].iter().flatten().copied();
    let mut plot = Plot::new(Axis::exactly("time, s", 0.0, 40.0), Axis::over("speed, m/s", speeds));
    let shown_cars = [0, 1, 2, 4, 8];
    for (series, car) in shown_cars.into_iter().enumerate() {
        let points: Vec<[f64; 2]> =
            drive.speeds_mps[..shown].iter().enumerate().map(|(k, row)| [k as f64 * PERIOD_S, row[car]]).collect();
        plot.line(&points, series);
    }
    let name = law_name(law);
    let legend = shown_cars.iter().enumerate();
    let legend = legend.map(|(i, &car)| (if car == 0 { "leader".to_owned() } else { format!("car {car}") }, i));
    let title = format!("Speeds after a braking pulse of the leader, {name}");
    Figure { name: format!("pulse-{name}"), svg: plot.finish(&title), title, legend: legend.collect() }
}

fn growth_figure(cases: &[(SpeedLaw, Disturbance)], drives: &[Drive]) -> Figure {
    let curves: Vec<(String, Vec<[f64; 2]>)> = cases
        .iter()
        .zip(drives)
        .filter(|(case, _)| matches!(case.1, Disturbance::Sine(period_s) if period_s >= 8.0))
        .map(|(&(law, disturbance), drive)| {
            let peaks = drive.peaks(disturbance);
            let points = peaks.iter().enumerate().map(|(car, peak)| [car as f64, *peak]).collect();
            (format!("{}, {}", law_name(law), disturbance.name()), points)
        })
        .collect();
    let values = curves.iter().flat_map(|curve| curve.1.iter().map(|point| point[1]));
    let mut plot = Plot::new(
        Axis::exactly("car", 0.0, CARS as f64),
        Axis::over("amplitude of the speed, m/s", values.chain([0.0])),
    );
    for (series, (_, points)) in curves.iter().enumerate() {
        plot.line(points, series);
        for point in points {
            plot.point(*point, series);
        }
    }
    plot.level(1.0);
    let title = "Amplitude of the speed along the platoon for sines of 1 m/s".to_owned();
    let legend = curves.iter().enumerate().map(|(i, curve)| (curve.0.clone(), i)).collect();
    Figure { name: "sines".into(), svg: plot.finish(&title), title, legend }
}
