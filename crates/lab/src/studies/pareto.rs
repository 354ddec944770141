//! What the weights trade: q_2 (Eq. 26) over speeds and adhesions in a lane change, q_1 (Eq. 25) over speeds and decisions.
//!
//! Only ratios of the weights have an effect, so each controller has one: a sweep of it is its whole Pareto front. The levels of
//! the action set should span the fronts without lying where they are flat.

use super::in_parallel;
use super::output::{Figure, StudyError, StudyReport, Table};
use crate::maneuvers::measure::sideslip_rad;
use crate::maneuvers::{EgoScript, Leg, Maneuver, Measure, Run, Stack};
use crate::report::svg::{Axis, Plot};

const PATH_RATIOS: [f64; 9] = [1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 1e-1, 1.0];
/// Speed (m/s), adhesion and duration of the lane change (s), the shortest comfortable one on that road.
const ROADS: [(f64, f64, f64); 6] =
    [(20.0, 0.85, 2.5), (28.0, 0.85, 2.5), (33.0, 0.85, 2.5), (20.0, 0.4, 3.5), (28.0, 0.4, 3.5), (33.0, 0.4, 3.5)];
const SPEED_RATIOS: [f64; 8] = [2.5e-4, 2.5e-3, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0];
/// Speed now and decision, m/s and m/s².
const DECISIONS: [(f64, f64); 6] = [(22.0, 2.0), (22.0, 0.0), (22.0, -2.0), (28.0, 2.0), (28.0, 0.0), (28.0, -2.0)];
/// How long a decision is watched, s: until the next one but a little more.
const DECISION_S: f64 = 2.0;

/// Figures of one lane change.
struct Change {
    rms_m: f64,
    sideslip_deg: f64,
    slip_use: f64,
    effort_deg: f64,
    lateral_jerk_mps3: f64,
}

pub(super) fn run() -> Result<StudyReport, StudyError> {
    let cases: Vec<(usize, f64)> = (0..ROADS.len()).flat_map(|road| PATH_RATIOS.map(|q2| (road, q2))).collect();
    let changes = in_parallel(&cases, |&(road, q2)| lane_change(ROADS[road], q2))?;
    let decisions: Vec<(usize, f64)> =
        (0..DECISIONS.len()).flat_map(|case| SPEED_RATIOS.map(|q1| (case, q1))).collect();
    let obeyed = in_parallel(&decisions, |&(case, q1)| obey(DECISIONS[case], q1))?;
    let figures = vec![
        front(&changes, "effort", "root mean square steering, deg", |c| c.effort_deg),
        front(&changes, "comfort", "root mean square lateral jerk, m/s³", |c| c.lateral_jerk_mps3),
        obedience(&obeyed),
    ];
    let summary = "Recommended levels of q2: 3e-4 (smooth: below 0.1 m on every road here), 1e-3 (middle) and 3e-3 (exact). At 1e-4 the \
         error passes 0.2 m at 20 m/s; from 3e-3 to 1e-2 it falls by no more than 2 cm and the delay margin by a quarter or more. Recommended \
         levels of q1: 0.0025 (the decision is obeyed), 0.01 and 0.05 (the speed is pursued as well); at 0.1 a decision to brake \
         speeds the car up at 22 m/s, at the printed 0.25 everywhere."
        .to_owned();
    Ok(StudyReport {
        name: "pareto",
        title: "What the weights trade".into(),
        summary,
        tables: vec![path_table(&cases, &changes), speed_table(&obeyed)],
        figures,
    })
}

fn lane_change((speed_mps, adhesion, duration_s): (f64, f64, f64), path_ratio: f64) -> Result<Change, StudyError> {
    let legs = vec![Leg { at_s: 0.5, duration_s, d_m: 3.75 }];
    let ego = EgoScript { path_ratio, ..EgoScript::along(speed_mps, legs) };
    let run = Maneuver::new("change", "", ego, duration_s + 3.0).on_adhesion(adhesion).run(Stack::default())?;
    let count = run.samples.len() as f64;
    let steering: f64 = run.samples.iter().map(|s| s.ego.steer_rad * s.ego.steer_rad).sum();
    let sideslip = run.samples.iter().map(|s| sideslip_rad(s).abs()).fold(0.0, f64::max);
    Ok(Change {
        rms_m: Measure::LaneErrorRms.of(&run),
        sideslip_deg: sideslip.to_degrees(),
        slip_use: Measure::SlipUse.of(&run),
        effort_deg: (steering / count).sqrt().to_degrees(),
        lateral_jerk_mps3: lateral_jerk_rms(&run),
    })
}

/// Of V γ, by differences of control steps.
fn lateral_jerk_rms(run: &Run) -> f64 {
    let accels: Vec<f64> = run.samples.iter().map(|s| s.ego.speed_mps * s.ego.yaw_rate_radps).collect();
    let period_s = run.samples[1].time_s - run.samples[0].time_s;
    let squares: f64 = accels.windows(2).map(|pair| (pair[1] - pair[0]) * (pair[1] - pair[0])).sum();
    (squares / (accels.len() - 1) as f64).sqrt() / period_s
}

/// Mean acceleration over a decision's time, m/s².
fn obey((speed_mps, reference_accel_mps2): (f64, f64), speed_ratio: f64) -> Result<f64, StudyError> {
    let ego = EgoScript { target_speed_mps: 33.333, reference_accel_mps2, speed_ratio, ..EgoScript::hold(speed_mps) };
    let run = Maneuver::new("decision", "", ego, DECISION_S).run(Stack::default())?;
    Ok((Measure::FinalSpeed.of(&run) - speed_mps) / DECISION_S)
}

fn road_name((speed_mps, adhesion, duration_s): (f64, f64, f64)) -> String {
    format!("{speed_mps:.0} m/s, μ {adhesion}, {duration_s} s")
}

fn path_table(cases: &[(usize, f64)], changes: &[Change]) -> Table {
    let mut table = Table::new(
        "q2",
        "Lane change of 3.75 m by q2",
        &["road", "q2", "lane error rms m", "max |β| deg", "slip use", "steering rms deg", "lateral jerk rms m/s³"],
    );
    for (&(road, q2), c) in cases.iter().zip(changes) {
        let figures = [(c.rms_m, 4), (c.sideslip_deg, 3), (c.slip_use, 3), (c.effort_deg, 3), (c.lateral_jerk_mps3, 2)];
        let mut row = vec![road_name(ROADS[road]), format!("{q2:.0e}")];
        row.extend(figures.iter().map(|(value, decimals)| format!("{value:.decimals$}")));
        table.rows.push(row);
    }
    table
}

fn speed_table(obeyed: &[f64]) -> Table {
    let names = DECISIONS.map(|(speed, accel)| format!("{speed:.0} m/s, a_ref {accel:+.0}"));
    let mut head = vec!["q1"];
    head.extend(names.iter().map(String::as_str));
    let mut table = Table::new("q1", "Mean acceleration in the 2 s after a decision, m/s², by q1", &head);
    for (index, q1) in SPEED_RATIOS.iter().enumerate() {
        let mut row = vec![q1.to_string()];
        row.extend((0..DECISIONS.len()).map(|case| format!("{:+.2}", obeyed[case * SPEED_RATIOS.len() + index])));
        table.rows.push(row);
    }
    table
}

/// Tracking against another figure, one curve for each road, with a mark at each level of the action set.
fn front(changes: &[Change], name: &str, y_name: &str, figure: fn(&Change) -> f64) -> Figure {
    let log_rms = |c: &Change| libm::log10(c.rms_m);
    let mut plot = Plot::new(
        Axis::over("root mean square lane error, log10 of m", changes.iter().map(log_rms)),
        Axis::over(y_name, changes.iter().map(figure).chain([0.0])),
    );
    let mut legend = Vec::new();
    for (road, chunk) in changes.chunks(PATH_RATIOS.len()).enumerate() {
        let points: Vec<[f64; 2]> = chunk.iter().map(|c| [log_rms(c), figure(c)]).collect();
        plot.line(&points, road);
        for (point, _) in points.iter().zip(PATH_RATIOS).filter(|(_, q2)| [3e-4, 1e-3, 3e-3].contains(q2)) {
            plot.point(*point, road);
        }
        legend.push((road_name(ROADS[road]), road));
    }
    let title = format!("Tracking against {name}; marks from right to left: q2 = 3e-4, 1e-3, 3e-3");
    Figure { name: name.into(), svg: plot.finish(&title), title, legend }
}

fn obedience(obeyed: &[f64]) -> Figure {
    let mut plot = Plot::new(
        Axis::over("log10 of q1", SPEED_RATIOS.map(libm::log10)),
        Axis::over("mean acceleration, m/s²", obeyed.iter().copied()),
    );
    let mut legend = Vec::new();
    for (case, chunk) in obeyed.chunks(SPEED_RATIOS.len()).enumerate() {
        let points: Vec<[f64; 2]> =
            SPEED_RATIOS.iter().zip(chunk).map(|(q1, accel)| [libm::log10(*q1), *accel]).collect();
        plot.line(&points, case);
        let (speed, accel) = DECISIONS[case];
        legend.push((format!("{speed:.0} m/s, a_ref {accel:+.0}"), case));
    }
    plot.level(0.0);
    let title = "How a decision is obeyed by q1".to_owned();
    Figure { name: "decisions".into(), svg: plot.finish(&title), title, legend }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_recommended_levels_are_what_the_summary_says() {
        let rms_m = |road: usize, q2: f64| lane_change(ROADS[road], q2).unwrap().rms_m;
        assert!((0..ROADS.len()).all(|road| rms_m(road, 3e-4) < 0.1));
        assert!(rms_m(0, 1e-4) > 0.2);
        assert!((0..ROADS.len()).all(|road| rms_m(road, 3e-3) - rms_m(road, 1e-2) < 0.02));
        assert!(obey((22.0, -2.0), 0.05).unwrap() < 0.0 && obey((22.0, -2.0), 0.1).unwrap() > 0.0);
    }

    #[test]
    fn decisions_are_obeyed_at_small_q1_and_drowned_at_the_printed_ratio() {
        assert!(obey((22.0, -2.0), 2.5e-3).unwrap() < -1.0);
        assert!(obey((22.0, -2.0), 0.25).unwrap() > 0.0);
    }
}
