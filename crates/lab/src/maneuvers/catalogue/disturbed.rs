//! What the controllers do not know, or know late: grades, steering delay, side wind, patches of ice.

use lanecraft_drive::road::{AdhesionPatch, GradePoint};

use super::{in_lane, no_collision, no_fallback};
use crate::maneuvers::{CarScript, Check, EgoScript, Leg, Maneuver, Measure};

pub(super) fn maneuvers() -> Vec<Maneuver> {
    let grades = [-0.10, -0.06, 0.06, 0.10];
    let mut all: Vec<Maneuver> = grades.into_iter().map(stop_on_grade).collect();
    all.extend([-0.10, -0.06, 0.06, 0.10].into_iter().map(hold_on_grade));
    all.extend([0.0, 0.05, 0.1, 0.2].into_iter().map(delayed));
    all.extend([side_wind(false), side_wind(true), gusts(), patch_of_ice(), patch_of_ice_in_lane_change()]);
    all
}

fn name_of(grade: f64) -> String {
    format!("{}-{:02.0}", if grade > 0.0 { "up" } else { "down" }, 100.0 * grade.abs())
}

fn graded(mut maneuver: Maneuver, grade: f64) -> Maneuver {
    maneuver.road.grade = vec![GradePoint { s_m: 0.0, grade }];
    maneuver.control.observer = true;
    maneuver
}

fn stop_on_grade(grade: f64) -> Maneuver {
    let about = format!("a standing car seen at 150 m from 25 m/s, {:.0} % grade", 100.0 * grade);
    let maneuver = Maneuver::new(format!("stop-{}", name_of(grade)), about, EgoScript::hold(25.0), 35.0)
        .with_cars(vec![CarScript::steady(150.0, 0, 0.0)])
        .checked([
            no_collision(),
            Check::between("stops at the gap", Measure::FinalGap, 3.5, 8.0),
            Check::at_most("stands", Measure::FinalSpeed, 0.05),
            Check::at_most("braking", Measure::Braking, 6.5),
            no_fallback(),
        ]);
    graded(maneuver, grade)
}

fn hold_on_grade(grade: f64) -> Maneuver {
    let about = format!("holds 25 m/s from a {:.0} % grade on, with the observer", 100.0 * grade);
    let maneuver = Maneuver::new(format!("hold-{}", name_of(grade)), about, EgoScript::hold(25.0), 40.0).checked([
        Check::between("holds the speed", Measure::FinalSpeed, 24.5, 25.5),
        in_lane(),
        no_fallback(),
    ]);
    graded(maneuver, grade)
}

/// The controllers know the delay.
fn delayed(delay_s: f64) -> Maneuver {
    let legs = vec![Leg { at_s: 0.5, duration_s: 3.0, d_m: 3.75 }];
    let mut maneuver = Maneuver::new(
        format!("steer-delay-{:03.0}", 1000.0 * delay_s),
        format!("3.75 m in 3 s at 28 m/s with a known steering delay of {:.0} ms", 1000.0 * delay_s),
        EgoScript::along(28.0, legs),
        9.0,
    )
    .checked([
        in_lane(),
        Check::at_most("settles", Measure::SettleTime, 1.0),
        Check::at_most("ends in the middle", Measure::FinalLaneError, 0.05),
        Check::at_most("slip use", Measure::SlipUse, 0.6),
        no_fallback(),
    ]);
    maneuver.plant.steer_delay_s = delay_s;
    maneuver.model.steer_delay_s = delay_s;
    maneuver
}

/// A side wind of 15 m/s that hits the car at once, as behind a bridge.
fn side_wind(observer: bool) -> Maneuver {
    let (name, with) = if observer { ("side-wind-observer", "with") } else { ("side-wind", "without") };
    let about = format!("28 m/s, a side wind of 15 m/s at once, {with} the observer of disturbances");
    let mut maneuver = Maneuver::new(name, about, EgoScript::hold(28.0), 12.0).checked([
        in_lane(),
        Check::at_most("ends in the middle", Measure::FinalLaneError, if observer { 0.02 } else { 0.2 }),
        no_fallback(),
    ]);
    maneuver.options.wind_mps = 15.0;
    maneuver.control.observer = observer;
    maneuver
}

fn gusts() -> Maneuver {
    let mut maneuver = Maneuver::new(
        "gusts",
        "33 m/s, side wind of 8 m/s with gusts of 10 m/s every 3 s",
        EgoScript::hold(33.0),
        15.0,
    )
    .checked([in_lane(), Check::at_most("slip use", Measure::SlipUse, 0.5), no_fallback()]);
    maneuver.options.wind_mps = 8.0;
    maneuver.options.gust_mps = 10.0;
    maneuver.options.gust_period_s = 3.0;
    maneuver
}

fn patch(s_m: f64, length_m: f64) -> Vec<AdhesionPatch> {
    vec![AdhesionPatch { s_m, length_m, adhesion: 0.2 }]
}

fn patch_of_ice() -> Maneuver {
    let mut maneuver = Maneuver::new(
        "stop-over-ice",
        "a standing car seen at 150 m from 20 m/s, 40 m of known ice (μ = 0.2) before it",
        EgoScript::hold(20.0),
        40.0,
    )
    .with_cars(vec![CarScript::steady(150.0, 0, 0.0)])
    .checked([
        no_collision(),
        Check::between("stops at the gap", Measure::FinalGap, 3.5, 8.0),
        in_lane(),
        no_fallback(),
    ]);
    maneuver.road.adhesion_patches = patch(80.0, 40.0);
    maneuver
}

fn patch_of_ice_in_lane_change() -> Maneuver {
    let legs = vec![Leg { at_s: 0.5, duration_s: 4.0, d_m: 3.75 }];
    let mut maneuver = Maneuver::new(
        "lane-change-over-ice",
        "3.75 m in 4 s at 22 m/s over 10 m of known ice (μ = 0.2)",
        EgoScript::along(22.0, legs),
        9.0,
    )
    .checked([
        in_lane(),
        Check::at_most("sideslip", Measure::Sideslip, 1.0),
        Check::at_most("ends in the middle", Measure::FinalLaneError, 0.05),
        no_fallback(),
    ]);
    maneuver.road.adhesion_patches = patch(40.0, 10.0);
    maneuver
}
