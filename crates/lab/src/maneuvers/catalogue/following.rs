//! Braking and following: leaders that brake, standing cars, cut-ins and cut-outs.

use super::{in_lane, no_collision, no_fallback, no_guard};
use crate::maneuvers::{CarScript, Check, EgoScript, LateralShape, Leg, Maneuver, Measure, Steering};

/// Bumpers closer than this at rest, or further apart than that, are no good stop, m (5 m are asked for).
const FINAL_GAP_M: (f64, f64) = (3.5, 8.0);

pub(super) fn maneuvers() -> Vec<Maneuver> {
    let mut all: Vec<Maneuver> = [1.0, 3.0, 5.0, 7.0].into_iter().map(leader_brakes).collect();
    all.push(stop_and_go());
    all.extend([25.0, 28.0, 33.0].into_iter().map(standing_car));
    all.extend([0.3, 0.6, 0.9].into_iter().map(standing_car_on_adhesion));
    all.extend([("light", 0.8), ("heavy", 1.2)].into_iter().map(mass_brakes));
    all.extend([cut_in(), cut_in_slower(), cut_in_and_brake()]);
    all.extend([cut_out_standing(), cut_out_slow(), approach(), set_speed(), brake_in_lane_change()]);
    all
}

fn stops() -> Check {
    Check::between("stops at the gap", Measure::FinalGap, FINAL_GAP_M.0, FINAL_GAP_M.1)
}

/// Behind hard braking, which is forecast as constant speed, the spacing is used up as far as the guard's margin of 1 m.
fn stops_late() -> Check {
    Check::between("stops at the gap", Measure::FinalGap, 0.9, FINAL_GAP_M.1)
}

/// The forecast has constant speeds, so the ego brakes later than its leader and for that harder, m/s².
const LATE_MPS2: f64 = 2.3;

fn comfort(braking_mps2: f64, jerk_mps3: f64) -> [Check; 2] {
    [Check::at_most("braking", Measure::Braking, braking_mps2), Check::at_most("jerk", Measure::Jerk, jerk_mps3)]
}

/// The longitudinal controller's bound of the jerk with the drive train's rounding, m/s³.
const JERK_MAX_MPS3: f64 = 6.1;

/// 28 m/s, 1.5 s behind; the leader brakes to standstill.
fn leader_brakes(brake_mps2: f64) -> Maneuver {
    let name = format!("leader-brakes-{brake_mps2:.0}");
    let about = format!("28 m/s, 42 m behind a leader that brakes at {brake_mps2:.0} m/s² to standstill");
    let cars = vec![CarScript::steady(42.0, 0, 28.0).with_phases(&[(2.0, -brake_mps2)])];
    let full = brake_mps2 > 5.0;
    Maneuver::new(name, about, EgoScript::hold(28.0), 45.0)
        .with_cars(cars)
        .checked([no_collision(), if brake_mps2 < 5.0 { stops() } else { stops_late() }, in_lane(), no_fallback()])
        .checked(if full { comfort(8.0, 25.0) } else { comfort(brake_mps2 + LATE_MPS2, JERK_MAX_MPS3) })
        .checked((!full).then(no_guard))
}

/// Three stops at 3.3 m/s², as in openpilot's longitudinal suite.
fn stop_and_go() -> Maneuver {
    let phases: Vec<(f64, f64)> = (0..3)
        .flat_map(|i| {
            let at_s = 3.0 + 20.0 * f64::from(i);
            [(at_s, -3.3), (at_s + 8.0, 1.5), (at_s + 16.0, 0.0)]
        })
        .collect();
    let ego = EgoScript { target_speed_mps: 33.333, reference_accel_mps2: 2.0, ..EgoScript::hold(12.0) };
    Maneuver::new("stop-and-go", "a leader at 12 m/s stops three times at 3.3 m/s² and drives off again", ego, 65.0)
        .with_cars(vec![CarScript::steady(15.0, 0, 12.0).with_phases(&phases)])
        .checked([
            no_collision(),
            Check::at_least("smallest gap", Measure::SmallestGap, 3.5),
            Check::at_least("drives off again", Measure::FinalSpeed, 11.0),
            in_lane(),
            no_fallback(),
            no_guard(),
        ])
        .checked(comfort(3.3 + LATE_MPS2, JERK_MAX_MPS3))
}

fn standing_car(speed_mps: f64) -> Maneuver {
    let name = format!("standing-car-{speed_mps:.0}");
    let about = format!("a standing car seen at 150 m from {speed_mps:.0} m/s");
    Maneuver::new(name, about, EgoScript::hold(speed_mps), 35.0)
        .with_cars(vec![CarScript::steady(150.0, 0, 0.0)])
        .checked([no_collision(), stops(), in_lane(), no_fallback(), no_guard()])
        .checked(comfort(6.01, JERK_MAX_MPS3))
}

fn standing_car_on_adhesion(adhesion: f64) -> Maneuver {
    // Where full grip is trusted to 95 %, 20 m/s take 72 m at μ = 0.3: seen at 150 m, there is room.
    let name = format!("standing-car-mu-{:02.0}", 10.0 * adhesion);
    let about = format!("a standing car seen at 150 m from 20 m/s on μ = {adhesion}");
    Maneuver::new(name, about, EgoScript::hold(20.0), 45.0)
        .on_adhesion(adhesion)
        .with_cars(vec![CarScript::steady(150.0, 0, 0.0)])
        .checked([no_collision(), stops(), in_lane(), no_fallback(), no_guard()])
        .checked(comfort(6.01, JERK_MAX_MPS3))
}

fn mass_brakes((name, factor): (&str, f64)) -> Maneuver {
    let jerk = Check::at_most("jerk", Measure::Jerk, JERK_MAX_MPS3);
    let light = "the bound is that of the commands, which a car 20 % lighter than known answers by a quarter more";
    let mut maneuver = Maneuver::new(
        format!("mass-{name}-brakes"),
        format!("{factor} times the mass that the controllers know, behind a leader that brakes at 3 m/s²"),
        EgoScript::hold(28.0),
        45.0,
    )
    .with_cars(vec![CarScript::steady(42.0, 0, 28.0).with_phases(&[(2.0, -3.0)])])
    .checked([no_collision(), stops(), in_lane(), no_fallback(), no_guard()])
    .checked([
        Check::at_most("braking", Measure::Braking, 3.0 + LATE_MPS2),
        if factor < 1.0 { jerk.falls_short(light) } else { jerk },
    ]);
    maneuver.options.mass_factor = factor;
    maneuver
}

fn cut_in() -> Maneuver {
    Maneuver::new(
        "cut-in",
        "a car at the own speed of 25 m/s cuts in 12 m ahead within 3 s",
        EgoScript::hold(25.0),
        25.0,
    )
    .with_cars(vec![CarScript::steady(12.0, 1, 25.0).with_change(2.0, 3.0, 0, LateralShape::Signaled)])
    .checked([no_collision(), in_lane(), Check::between("gap regained", Measure::FinalGap, 16.5, 30.0), no_fallback()])
    .checked(comfort(3.0, JERK_MAX_MPS3))
}

fn cut_in_slower() -> Maneuver {
    Maneuver::new(
        "cut-in-slower",
        "a car 8 m/s slower cuts in 35 m ahead, unannounced, at 1.5 m/s to the side",
        EgoScript::hold(28.0),
        25.0,
    )
    .with_cars(vec![CarScript::steady(35.0, 1, 20.0).with_change(0.5, 2.5, 0, LateralShape::Abrupt)])
    .checked([
        no_collision(),
        in_lane(),
        Check::between("gap regained", Measure::FinalGap, 13.5, 25.0),
        Check::at_most("braking", Measure::Braking, 8.0),
        no_fallback(),
    ])
}

fn cut_in_and_brake() -> Maneuver {
    Maneuver::new(
        "cut-in-and-brake",
        "a car cuts in 15 m ahead at 25 m/s and brakes at 5 m/s² to standstill",
        EgoScript::hold(25.0),
        30.0,
    )
    .with_cars(vec![
        CarScript::steady(15.0, 1, 25.0).with_change(1.0, 3.0, 0, LateralShape::Signaled).with_phases(&[(4.0, -5.0)]),
    ])
    .checked([no_collision(), in_lane(), stops_late(), no_fallback()])
}

fn cut_out_standing() -> Maneuver {
    // The leader leaves its lane 3 s before it would hit the standing car, which is seen when its view is free.
    Maneuver::new(
        "cut-out-standing",
        "the leader at 25 m/s swerves around a standing car that is 75 m ahead of it and was hidden",
        EgoScript::hold(25.0),
        25.0,
    )
    .with_cars(vec![
        CarScript::steady(25.0, 0, 25.0).with_change(2.0, 2.5, 1, LateralShape::Signaled),
        CarScript::steady(25.0 + 4.8 + 50.0 + 75.0, 0, 0.0).hidden_until(3.25),
    ])
    .checked([no_collision(), in_lane(), stops_late(), no_fallback()])
    .checked([Check::at_most("braking", Measure::Braking, 8.0)])
}

fn cut_out_slow() -> Maneuver {
    Maneuver::new(
        "cut-out-slow",
        "the leader at 30 m/s changes lane behind a car at 20 m/s that was hidden",
        EgoScript::hold(30.0),
        25.0,
    )
    .with_cars(vec![
        CarScript::steady(30.0, 0, 30.0).with_change(2.0, 3.0, 1, LateralShape::Signaled),
        CarScript::steady(30.0 + 4.8 + 60.0, 0, 20.0).hidden_until(3.5),
    ])
    .checked([no_collision(), in_lane(), Check::between("follows", Measure::FinalGap, 13.5, 25.0), no_fallback()])
    .checked(comfort(6.01, JERK_MAX_MPS3))
}

fn approach() -> Maneuver {
    Maneuver::new("approach-slower", "33 m/s, a car at 22 m/s comes into sight at 150 m", EgoScript::hold(33.0), 45.0)
        .with_cars(vec![CarScript::steady(150.0, 0, 22.0)])
        .checked([
            no_collision(),
            in_lane(),
            Check::between("follows", Measure::FinalGap, 15.5, 22.0),
            Check::between("at its speed", Measure::FinalSpeed, 21.8, 22.2),
            no_fallback(),
            no_guard(),
        ])
        .checked(comfort(3.5, JERK_MAX_MPS3))
}

fn set_speed() -> Maneuver {
    let ego = EgoScript { target_speed_mps: 33.333, reference_accel_mps2: 2.0, ..EgoScript::hold(20.0) };
    Maneuver::new("set-speed", "free road: from 20 m/s to the highest speed at a_ref = 2 m/s²", ego, 20.0)
        .checked([
            Check::between("reaches the speed", Measure::FinalSpeed, 33.2, 33.4),
            Check::at_most("not above it", Measure::HighestSpeed, 33.45),
            in_lane(),
            no_fallback(),
            no_guard(),
        ])
        .checked([Check::at_most("jerk", Measure::Jerk, JERK_MAX_MPS3)])
}

fn brake_in_lane_change() -> Maneuver {
    let legs = vec![Leg { at_s: 1.0, duration_s: 3.0, d_m: 3.75 }];
    let ego = EgoScript { steering: Steering::Legs(legs), ..EgoScript::hold(28.0) };
    Maneuver::new(
        "brake-in-lane-change",
        "28 m/s, the leader of the new lane brakes at 4 m/s² to standstill in the middle of the change",
        ego,
        30.0,
    )
    .with_cars(vec![CarScript::steady(60.0, 0, 28.0), CarScript::steady(45.0, 1, 28.0).with_phases(&[(2.0, -4.0)])])
    .checked([no_collision(), in_lane(), stops(), no_fallback()])
    .checked(comfort(6.01, JERK_MAX_MPS3))
}
