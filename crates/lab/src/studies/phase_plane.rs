//! The plane of sideslip and yaw rate (Fig. 11): what the stability bounds and the choice of the weights do there.
//!
//! First, a lane change that the grip does not allow (3.75 m in 2.0 s at 33.3 m/s on μ = 0.4, q_2 = 10⁻²), with the
//! bounds of Eq. 26 and without. Second, four lane changes of different durations and speeds on a dry road, with q_2
//! chosen for each and with one constant q_2. A trajectory's size is the area of its convex hull.

use super::output::{Figure, StudyError, StudyReport, Table};
use crate::maneuvers::measure::sideslip_rad;
use crate::maneuvers::{EgoScript, Leg, Maneuver, Measure, Run, Stack};
use crate::report::svg::{Axis, Plot};

/// The lane changes of the second figure: speed (m/s), duration (s) and the level of q_2 chosen for it. The shorter the
/// change, the tighter: the same level means a larger error at a shorter duration.
const CHANGES: [(f64, f64, f64); 4] = [(20.0, 2.0, 3e-3), (25.0, 2.5, 1e-3), (30.0, 3.0, 1e-3), (33.0, 4.0, 3e-4)];
/// The constant levels it is compared with.
const CONSTANTS: [f64; 3] = [3e-4, 1e-3, 3e-3];

/// A trajectory in the plane, in degrees and degrees per second.
struct Trajectory {
    name: String,
    points: Vec<[f64; 2]>,
    slip_use: f64,
    lane_error_rms_m: f64,
    effort: f64,
}

impl Trajectory {
    fn new(name: &str, runs: &[Run]) -> Self {
        let samples = || runs.iter().flat_map(|run| &run.samples);
        let largest = |measure: &Measure| runs.iter().map(|run| measure.of(run)).fold(0.0, f64::max);
        let count = samples().count() as f64;
        let errors: f64 = samples().map(|s| (s.ego.d_m - s.reference_d_m) * (s.ego.d_m - s.reference_d_m)).sum();
        let steering: f64 = samples().map(|s| s.ego.steer_rad * s.ego.steer_rad).sum();
        Self {
            name: name.into(),
            points: samples().map(|s| [sideslip_rad(s).to_degrees(), s.ego.yaw_rate_radps.to_degrees()]).collect(),
            slip_use: largest(&Measure::SlipUse),
            lane_error_rms_m: (errors / count).sqrt(),
            effort: (steering / count).sqrt().to_degrees(),
        }
    }

    fn row(&self) -> Vec<String> {
        let sideslip = self.points.iter().map(|p| p[0].abs()).fold(0.0, f64::max);
        let yaw_rate = self.points.iter().map(|p| p[1].abs()).fold(0.0, f64::max);
        let figures = [
            (hull_area(&self.points), 2),
            (sideslip, 2),
            (yaw_rate, 1),
            (self.slip_use, 2),
            (self.lane_error_rms_m, 3),
            (self.effort, 3),
        ];
        let cells = figures.iter().map(|(value, decimals)| format!("{value:.decimals$}"));
        std::iter::once(self.name.clone()).chain(cells).collect()
    }
}

const HEAD: [&str; 7] =
    ["case", "hull deg²/s", "max |β| deg", "max |γ| deg/s", "slip use", "lane error rms m", "steering rms deg"];

pub(super) fn run() -> Result<StudyReport, StudyError> {
    let forced = [forced(true)?, forced(false)?];
    let mut weights = Vec::new();
    weights.push(changes("q2 chosen for each", None)?);
    for q2 in CONSTANTS {
        weights.push(changes(&format!("constant q2 = {q2:.0e}"), Some(q2))?);
    }
    let table = |name: &str, caption: &str, rows: &[Trajectory]| Table {
        rows: rows.iter().map(Trajectory::row).collect(),
        ..Table::new(name, caption, &HEAD)
    };
    let areas = forced.each_ref().map(|trajectory| hull_area(&trajectory.points));
    let summary = format!(
        "Without the stability bounds the forced lane change covers {:.0} times the area of the phase plane that it covers with \
         them. On a dry road the weights trade tracking for effort, and a smaller area always goes with a larger error: on a \
         fixed path tighter tracking never makes the car more stable.",
        areas[1] / areas[0]
    );
    let tables = vec![
        table("bounds", "Forced lane change: 3.75 m in 2.0 s at 33.3 m/s on μ = 0.4, q2 = 1e-2", &forced),
        table("weights", "Four lane changes on a dry road", &weights),
    ];
    let figures = vec![
        figure("bounds", "Stability bounds on and off (μ = 0.4)", &forced),
        figure("bounds-on", "The same with the bounds alone, enlarged", &forced[..1]),
        figure("weights", "Weights chosen for each change and constant ones (dry)", &weights),
    ];
    Ok(StudyReport {
        name: "phase-plane",
        title: "Phase plane of sideslip and yaw rate".into(),
        summary,
        tables,
        figures,
    })
}

fn forced(bounds: bool) -> Result<Trajectory, StudyError> {
    let mut maneuver = change((33.3, 2.0, 1e-2)).on_adhesion(0.4);
    maneuver.control.stability_constraints = bounds;
    let runs = [maneuver.run(Stack::default())?];
    Ok(Trajectory::new(if bounds { "bounds on" } else { "bounds off" }, &runs))
}

/// All changes one after the other, with the constant `path_ratio` or each with its own.
fn changes(name: &str, path_ratio: Option<f64>) -> Result<Trajectory, StudyError> {
    let runs: Result<Vec<Run>, _> = CHANGES
        .iter()
        .map(|&(speed, duration, own)| change((speed, duration, path_ratio.unwrap_or(own))).run(Stack::default()))
        .collect();
    Ok(Trajectory::new(name, &runs?))
}

fn change((speed_mps, duration_s, path_ratio): (f64, f64, f64)) -> Maneuver {
    let legs = vec![Leg { at_s: 0.5, duration_s, d_m: 3.75 }];
    Maneuver::new("change", "", EgoScript { path_ratio, ..EgoScript::along(speed_mps, legs) }, duration_s + 2.5)
}

fn figure(name: &str, title: &str, trajectories: &[Trajectory]) -> Figure {
    let axis = |label: &str, index: usize| {
        Axis::over(label, trajectories.iter().flat_map(move |t| t.points.iter().map(move |p| p[index])))
    };
    let mut plot = Plot::new(axis("sideslip β, deg", 0), axis("yaw rate γ, deg/s", 1));
    // The last one drawn lies on top.
    for (series, trajectory) in trajectories.iter().enumerate().rev() {
        plot.line(&trajectory.points, series);
    }
    let legend = trajectories.iter().enumerate().map(|(i, t)| (t.name.clone(), i)).collect();
    Figure { name: name.into(), title: title.into(), svg: plot.finish(title), legend }
}

/// Area of the convex hull, by Andrew's monotone chain and the shoelace formula.
fn hull_area(points: &[[f64; 2]]) -> f64 {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let turn = |o: [f64; 2], a: [f64; 2], b: [f64; 2]| (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while chain.len() >= 2 && turn(chain[chain.len() - 2], chain[chain.len() - 1], point) <= 0.0 {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut sorted.iter().copied());
    hull.extend(chain(&mut sorted.iter().rev().copied()));
    let next = hull.iter().cycle().skip(1);
    0.5 * hull.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f64>().abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hull_of_a_square_with_points_inside_is_the_square() {
        let points = [[0.0, 0.0], [2.0, 0.0], [1.0, 1.0], [2.0, 3.0], [0.0, 3.0], [1.0, 0.0], [0.5, 2.5]];
        assert_eq!(hull_area(&points), 6.0);
        assert_eq!(hull_area(&[[1.0, 1.0]]), 0.0);
    }

    #[test]
    fn only_the_bounds_keep_the_forced_lane_change_in_hand() {
        let (on, off) = (forced(true).unwrap(), forced(false).unwrap());
        assert!(hull_area(&off.points) > 100.0 * hull_area(&on.points));
    }
}
