//! The car itself (open-loop steering), bends, and disturbances that the lateral controller has to end.

use lanecraft_drive::road::CurvaturePoint;
use lanecraft_drive::vehicle::LoadTransfer;

use super::{in_lane, no_collision, no_fallback};
use crate::maneuvers::{CarScript, Check, EgoScript, Maneuver, Measure, Steering};

pub(super) fn maneuvers() -> Vec<Maneuver> {
    vec![
        step_steer(),
        sine_with_dwell(),
        bend(),
        bend_wet(),
        stop_in_bend(),
        offset(),
        spin_recovery(),
        spin_recovery_wet(),
    ]
}

/// ISO 7401: 100 km/h, steering for about 4 m/s² of lateral acceleration.
fn step_steer() -> Maneuver {
    let ego = EgoScript { steering: Steering::Step { at_s: 1.0, steer_rad: 0.021 }, ..EgoScript::hold(100.0 / 3.6) };
    Maneuver::new("step-steer", "open loop: steering step at 100 km/h to about 4 m/s² (ISO 7401)", ego, 4.0).checked([
        Check::between("yaw gain of the linear car", Measure::YawGainRatio, 0.85, 1.05),
        Check::at_most("yaw rise time", Measure::YawRiseTime, 0.4),
        Check::at_most("yaw overshoot", Measure::YawOvershoot, 15.0),
        Check::between("lateral acceleration", Measure::LateralAccel, 3.0, 5.0),
        Check::at_most("sideslip", Measure::Sideslip, 2.0),
    ])
}

/// FMVSS 126: 80 km/h, 0.7 Hz, 0.5 s of dwell, five times the steering of 0.3 g.
fn sine_with_dwell() -> Maneuver {
    let steering = Steering::SineWithDwell { at_s: 1.0, steer_rad: 5.0 * 0.022, frequency_hz: 0.7, dwell_s: 0.5 };
    let ego = EgoScript { steering, ..EgoScript::hold(80.0 / 3.6) };
    Maneuver::new("sine-with-dwell", "open loop: FMVSS 126 at 80 km/h with five times the steering of 0.3 g", ego, 6.0)
        .checked([
            Check::at_most("yaw rate after 1.00 s", Measure::YawRateLeft(1.0), 35.0),
            Check::at_most("yaw rate after 1.75 s", Measure::YawRateLeft(1.75), 20.0),
            Check::at_least("displacement after 1.07 s", Measure::SineDisplacement, 1.83),
        ])
}

/// A bend of 650 m radius behind a clothoid of 150 m.
fn curved(name: &str, about: &str, speed_mps: f64, adhesion: f64) -> Maneuver {
    let point = |s_m, curvature_radpm| CurvaturePoint { s_m, curvature_radpm };
    let mut maneuver = Maneuver::new(name, about, EgoScript::hold(speed_mps), 20.0).on_adhesion(adhesion).checked([
        in_lane(),
        Check::at_most("ends in the middle", Measure::FinalLaneError, 0.05),
        Check::at_most("sideslip", Measure::Sideslip, 1.0),
        no_fallback(),
    ]);
    maneuver.road.curvature =
        vec![point(100.0, 0.0), point(250.0, 1.0 / 650.0), point(450.0, 1.0 / 650.0), point(600.0, 0.0)];
    maneuver
}

fn bend() -> Maneuver {
    curved("bend-650", "a bend of 650 m radius at 120 km/h", 120.0 / 3.6, 0.85)
}

fn bend_wet() -> Maneuver {
    curved("bend-650-wet", "a bend of 650 m radius at 100 km/h on μ = 0.4", 100.0 / 3.6, 0.4)
}

/// The lateral demand leaves the brakes less than they could have, on a car that shares its grip and shifts its loads.
fn stop_in_bend() -> Maneuver {
    let about = "90 km/h on μ = 0.4 in a bend of 300 m radius: a standing car comes into sight at 125 m; shared grip, load transfer";
    let mut maneuver = Maneuver::new("stop-in-bend-wet", about, EgoScript::hold(25.0), 16.0)
        .on_adhesion(0.4)
        .with_cars(vec![CarScript::steady(225.0, 0, 0.0).hidden_until(4.0)])
        .checked([
            no_collision(),
            in_lane(),
            Check::at_most("stands", Measure::FinalSpeed, 0.1),
            Check::at_most("sideslip", Measure::Sideslip, 2.0),
            no_fallback(),
        ]);
    let point = |s_m, curvature_radpm| CurvaturePoint { s_m, curvature_radpm };
    maneuver.road.curvature = vec![point(20.0, 0.0), point(80.0, 1.0 / 300.0)];
    maneuver.options.combined_grip = true;
    maneuver.options.load_transfer = LoadTransfer::QuasiStatic;
    maneuver
}

fn offset() -> Maneuver {
    let ego = EgoScript { d_m: 0.8, ..EgoScript::hold(28.0) };
    Maneuver::new("offset-start", "28 m/s, 0.8 m beside the reference", ego, 10.0).checked([
        Check::at_most("settles", Measure::SettleTime, 3.0),
        Check::at_most("ends in the middle", Measure::FinalLaneError, 0.02),
        // No path is planned back: the controller uses what its bounds leave.
        Check::at_most("slip use", Measure::SlipUse, 0.85),
        no_fallback(),
    ])
}

fn spinning(name: &str, yaw_rate_radps: f64, adhesion: f64) -> Maneuver {
    let ego = EgoScript { yaw_rate_radps, ..EgoScript::hold(28.0) };
    let about = format!("28 m/s on μ = {adhesion}, hit into a yaw rate of {:.0} deg/s", yaw_rate_radps.to_degrees());
    Maneuver::new(name, about, ego, 10.0).on_adhesion(adhesion).checked([
        Check::at_most("stays in its lane", Measure::LaneError, 0.9),
        Check::at_most("settles", Measure::SettleTime, 3.0),
        Check::at_most("sideslip", Measure::Sideslip, 6.0),
        no_fallback(),
    ])
}

fn spin_recovery() -> Maneuver {
    spinning("yaw-impulse", 0.35, 0.85)
}

fn spin_recovery_wet() -> Maneuver {
    spinning("yaw-impulse-wet", 0.2, 0.4)
}
