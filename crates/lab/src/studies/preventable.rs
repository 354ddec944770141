//! The map of preventable collisions, in the manner of UN Regulation 157 (2021, annex 4, appendix 3).
//!
//! The regulation asks a system to avoid every collision that a competent and careful human driver avoids, and gives a
//! model of that driver: 0.4 s to perceive the risk, from the instant at which the other car has moved 0.375 m out of its
//! lane (or its view is free, or it begins to brake), 0.75 s of reaction, then braking that builds up within 0.6 s to 0.774 g.
//! Departures: here the driver reacts to every cut-in, not only below a time to collision of 2 s, which makes more
//! collisions preventable; speeds go up to 120 km/h.

use lanecraft_drive::road::Road;

use super::cells::{CellAxis, Look, cell_map};
use super::in_parallel;
use super::output::{Figure, StudyError, StudyReport, Table};
use crate::maneuvers::car::{CAR_SIZE_M, Car};
use crate::maneuvers::{CarScript, EgoScript, LateralShape, Maneuver, Measure, Stack};

/// Time to perceive the risk, s.
const PERCEPTION_S: f64 = 0.4;
/// Reaction time, s.
const REACTION_S: f64 = 0.75;
/// Full braking: 0.774 g.
const BRAKE_MPS2: f64 = 0.774 * 9.81;
/// Time until full braking, s.
const BUILD_UP_S: f64 = 0.6;
/// Movement out of the lane that is seen, m.
const WANDERING_M: f64 = 0.375;
/// Width of a lane, m.
const LANE_M: f64 = 3.75;
/// When the other car begins, s: by then the ego has settled.
const BEGIN_S: f64 = 1.0;
const DURATION_S: f64 = 14.0;
/// Step of the careful driver's simulation, s.
const STEP_S: f64 = 0.01;

/// A cell's class.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Class {
    /// Neither collides.
    Avoided,
    /// The careful driver collides, this one does not.
    Beyond,
    /// Both collide.
    Unpreventable,
    /// The careful driver avoids what this one does not: the bar is broken.
    Hit,
}

impl Class {
    const ALL: [Self; 4] = [Self::Avoided, Self::Beyond, Self::Unpreventable, Self::Hit];

    fn look(self) -> Look {
        let (class, mark) = match self {
            Self::Avoided => ("avoided", ""),
            Self::Beyond => ("beyond", "+"),
            Self::Unpreventable => ("unpreventable", "·"),
            Self::Hit => ("hit", "✕"),
        };
        Look { class, mark }
    }
}

/// One panel: a family of cells over a gap and another figure.
struct Panel {
    family: &'static str,
    name: String,
    title: String,
    x: (&'static str, Vec<f64>),
    y: (&'static str, Vec<f64>),
    /// The cell's maneuver, and when its risk can be seen, s; from (x, y).
    cell: Box<dyn Fn(f64, f64) -> (Maneuver, f64) + Sync>,
}

pub(super) fn run() -> Result<StudyReport, StudyError> {
    let mut table = Table::new(
        "cells",
        "Cells by class: avoided by both; beyond = avoided, though the careful driver collides; unpreventable = neither avoids; hit = only the careful driver avoids",
        &["panel", "cells", "avoided", "beyond", "unpreventable", "hit", "highest own speed at impact m/s"],
    );
    let mut hits =
        Table::new("hits", "Preventable collisions, one by one", &["panel", "x", "y", "own speed at impact m/s"]);
    let mut figures = Vec::new();
    let mut totals = [0_usize; 4];
    for panel in panels() {
        let cells = classify(&panel)?;
        let places = panel.y.1.iter().flat_map(|y| panel.x.1.iter().map(move |x| (x, y)));
        for ((x, y), cell) in places.zip(&cells).filter(|(_, cell)| cell.0 == Class::Hit) {
            let place = [format!("{} {x:.1}", panel.x.0), format!("{} {y:.1}", panel.y.0)];
            hits.rows.push([vec![panel.title.clone()], place.to_vec(), vec![format!("{:.1}", cell.1)]].concat());
        }
        let counts = Class::ALL.map(|class| cells.iter().filter(|cell| cell.0 == class).count());
        for (total, count) in totals.iter_mut().zip(counts) {
            *total += count;
        }
        let impact = cells.iter().map(|cell| cell.1).fold(0.0, f64::max);
        let mut row = vec![panel.title.clone(), cells.len().to_string()];
        row.extend(counts.iter().map(ToString::to_string));
        row.push(format!("{impact:.1}"));
        table.rows.push(row);
        figures.push(figure(&panel, &cells));
    }
    let [avoided, beyond, unpreventable, hit] = totals;
    let summary = format!(
        "{} cells: {avoided} avoided by both, {beyond} avoided although the careful driver collides, {unpreventable} that neither \
         avoids, and {hit} preventable collisions (the bar is none). In the maps, an empty cell is avoided by both, + is avoided \
         beyond the careful driver, · is hit by both, ✕ is a preventable collision.",
        totals.iter().sum::<usize>()
    );
    Ok(StudyReport {
        name: "preventable",
        title: "Preventable collisions".into(),
        summary,
        tables: vec![table, hits],
        figures,
    })
}

/// Class and impact speed of every cell, row by row.
fn classify(panel: &Panel) -> Result<Vec<(Class, f64)>, StudyError> {
    let cells: Vec<(f64, f64)> = panel.y.1.iter().flat_map(|&y| panel.x.1.iter().map(move |&x| (x, y))).collect();
    in_parallel(&cells, |&(x, y)| {
        let (maneuver, seen_s) = (panel.cell)(x, y);
        let run = maneuver.run(Stack::default())?;
        let first = run.samples.iter().find(|sample| sample.clearance_m < 0.0);
        let impact = first.map_or(0.0, |sample| sample.ego.speed_mps);
        let own = Measure::Clearance.of(&run) < 0.0;
        let class = match (own, careful_driver_collides(&maneuver, seen_s)?) {
            (false, false) => Class::Avoided,
            (false, true) => Class::Beyond,
            (true, true) => Class::Unpreventable,
            (true, false) => Class::Hit,
        };
        Ok((class, impact))
    })
}

fn figure(panel: &Panel, cells: &[(Class, f64)]) -> Figure {
    let looks: Vec<Look> = cells.iter().map(|cell| cell.0.look()).collect();
    let decimals = |values: &[f64]| usize::from(values.iter().any(|v| v.fract() != 0.0));
    let (x, y) = (&panel.x, &panel.y);
    let svg = cell_map(
        &CellAxis { name: x.0, values: &x.1, decimals: decimals(&x.1) },
        &CellAxis { name: y.0, values: &y.1, decimals: decimals(&y.1) },
        &looks,
        &panel.title,
    );
    Figure { name: format!("{}-{}", panel.family, panel.name), title: panel.title.clone(), svg, legend: Vec::new() }
}

/// Whether the careful driver, who sees the risk at `seen_s`, collides.
fn careful_driver_collides(maneuver: &Maneuver, seen_s: f64) -> Result<bool, StudyError> {
    let road = Road::new(maneuver.road.clone())?;
    let length_m = maneuver.plant.length_m;
    let mut cars: Vec<Car<'_>> =
        maneuver.cars.iter().enumerate().map(|(i, script)| Car::new(script, i, &road, length_m)).collect();
    let (mut s_m, mut speed_mps) = (0.0, maneuver.ego.speed_mps);
    let begin_s = seen_s + PERCEPTION_S + REACTION_S;
    for k in 0..(maneuver.duration_s / STEP_S) as u32 {
        let time_s = f64::from(k) * STEP_S;
        let share = ((time_s - begin_s) / BUILD_UP_S).clamp(0.0, 1.0);
        let next = (speed_mps - share * BRAKE_MPS2 * STEP_S).max(0.0);
        s_m += 0.5 * (speed_mps + next) * STEP_S;
        speed_mps = next;
        for car in &mut cars {
            car.advance(&road, time_s, STEP_S);
            let ahead_m = (car.s_m - s_m).abs() - 0.5 * (CAR_SIZE_M.0 + length_m);
            let beside_m = (car.d_m - maneuver.ego.d_m).abs() - 0.5 * (CAR_SIZE_M.1 + maneuver.plant.width_m);
            if ahead_m < 0.0 && beside_m < 0.0 {
                return Ok(true);
            }
        }
    }
    Ok(false)
}

fn steps(first: f64, step: f64, count: u32) -> Vec<f64> {
    (0..count).map(|i| first + step * f64::from(i)).collect()
}

fn panels() -> Vec<Panel> {
    let mut panels = Vec::new();
    for speed_kmh in [60.0, 90.0, 120.0] {
        for lateral_mps in [0.6, 1.2, 1.8] {
            panels.push(cut_in(speed_kmh, lateral_mps));
        }
        panels.push(leader_brakes(speed_kmh));
        panels.push(cut_out(speed_kmh));
    }
    panels
}

fn maneuver(speed_mps: f64, cars: Vec<CarScript>) -> Maneuver {
    Maneuver::new("cell", "", EgoScript::hold(speed_mps), DURATION_S).with_cars(cars)
}

fn cut_in(speed_kmh: f64, lateral_mps: f64) -> Panel {
    let speed_mps = speed_kmh / 3.6;
    Panel {
        family: "cut-in",
        name: format!("{speed_kmh:.0}-{:02.0}", 10.0 * lateral_mps),
        title: format!("Cut-in at {speed_kmh:.0} km/h, {lateral_mps} m/s to the side"),
        x: ("gap, m", steps(5.0, 5.0, 12)),
        y: ("slower by, m/s", steps(0.0, 2.0, 8)),
        cell: Box::new(move |gap_m, slower_mps| {
            // The gap is that at the beginning of the cut-in.
            let start_m = gap_m + slower_mps * BEGIN_S;
            let car = CarScript::steady(start_m, 1, (speed_mps - slower_mps).max(0.0));
            let car = car.with_change(BEGIN_S, LANE_M / lateral_mps, 0, LateralShape::Abrupt);
            (maneuver(speed_mps, vec![car]), BEGIN_S + WANDERING_M / lateral_mps)
        }),
    }
}

fn leader_brakes(speed_kmh: f64) -> Panel {
    let speed_mps = speed_kmh / 3.6;
    Panel {
        family: "leader-brakes",
        name: format!("{speed_kmh:.0}"),
        title: format!("Leader brakes at {speed_kmh:.0} km/h"),
        x: ("time gap, s", steps(0.4, 0.2, 10)),
        // No car brakes harder than μ g = 8.3 m/s² on this road.
        y: ("braking, m/s²", steps(1.0, 1.0, 8)),
        cell: Box::new(move |gap_s, brake_mps2| {
            let car = CarScript::steady(gap_s * speed_mps, 0, speed_mps).with_phases(&[(BEGIN_S, -brake_mps2)]);
            (maneuver(speed_mps, vec![car]), BEGIN_S)
        }),
    }
}

fn cut_out(speed_kmh: f64) -> Panel {
    let speed_mps = speed_kmh / 3.6;
    Panel {
        family: "cut-out",
        name: format!("{speed_kmh:.0}"),
        title: format!("Cut-out at {speed_kmh:.0} km/h in front of a standing car"),
        x: ("from leader to standing car, m", steps(10.0, 10.0, 12)),
        y: ("time gap to leader, s", steps(0.6, 0.2, 8)),
        cell: Box::new(move |room_m, gap_s| {
            let lateral_mps = 1.8;
            let seen_s = BEGIN_S + WANDERING_M / lateral_mps;
            let gap_m = gap_s * speed_mps;
            let leader = CarScript::steady(gap_m, 0, speed_mps).with_change(
                BEGIN_S,
                LANE_M / lateral_mps,
                1,
                LateralShape::Abrupt,
            );
            let standing = gap_m + CAR_SIZE_M.0 + room_m + speed_mps * BEGIN_S;
            (maneuver(speed_mps, vec![leader, CarScript::steady(standing, 0, 0.0).hidden_until(seen_s)]), seen_s)
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_collision_is_preventable() {
        for panel in [leader_brakes(120.0), cut_in(120.0, 1.8), cut_out(120.0)] {
            let hits = classify(&panel).unwrap().iter().filter(|cell| cell.0 == Class::Hit).count();
            assert_eq!(hits, 0, "{}", panel.title);
        }
    }

    #[test]
    fn the_careful_driver_stops_in_the_closed_form_distance() {
        // Reaction, build-up and full braking: V (0.4 + 0.75) + V·0.6 − b·0.6²/6 + (V − 0.3 b)² / (2 b).
        let v = 25.0;
        let at_full = v - 0.5 * BUILD_UP_S * BRAKE_MPS2;
        let needed_m = v * (PERCEPTION_S + REACTION_S + BUILD_UP_S) - BRAKE_MPS2 * BUILD_UP_S * BUILD_UP_S / 6.0
            + at_full * at_full / (2.0 * BRAKE_MPS2);
        for (spare_m, collides) in [(0.2, false), (-0.2, true)] {
            let cell = maneuver(v, vec![CarScript::steady(needed_m + spare_m, 0, 0.0)]);
            assert_eq!(careful_driver_collides(&cell, 0.0).unwrap(), collides, "{spare_m} m to spare");
        }
    }
}
