//! Cases in the manner of Euro NCAP's protocols: car-to-car rear (AEB, 2023) and emergency lane keeping (LSS, 2023), at the
//! speeds of a highway.
//!
//! Departures: the protocols' target cars are in sight all along, these come into sight late; the closing speeds reach
//! 130 km/h where theirs end at 80 km/h; and since no driver lets go of the wheel here, the drift is the state that the
//! controllers are handed.

use super::{in_lane, no_collision, no_fallback};
use crate::maneuvers::{CarScript, Check, EgoScript, Maneuver, Measure};

pub(super) fn maneuvers() -> Vec<Maneuver> {
    let mut all: Vec<Maneuver> = [50.0, 80.0, 110.0, 130.0].into_iter().map(stationary).collect();
    all.extend([(80.0, 20.0), (130.0, 60.0)].into_iter().map(moving));
    all.extend([(12.0, 2.0), (12.0, 6.0), (40.0, 2.0), (40.0, 6.0)].into_iter().map(braking));
    all.extend([(72.0, 80.0), (110.0, 130.0)].into_iter().map(overtaken));
    all
}

/// Hardest braking that the tires give on a dry road, m/s².
const FULL_MPS2: f64 = 8.0;

fn mps(speed_kmh: f64) -> f64 {
    speed_kmh / 3.6
}

fn rear(name: String, about: String, speed_kmh: f64, target: CarScript) -> Maneuver {
    Maneuver::new(name, about, EgoScript::hold(mps(speed_kmh)), 30.0).with_cars(vec![target]).checked([
        no_collision(),
        Check::at_least("margin kept", Measure::SmallestGap, 0.9),
        Check::at_most("braking", Measure::Braking, FULL_MPS2),
        in_lane(),
        no_fallback(),
    ])
}

/// CCRs: a stationary car, seen no earlier than the law of safe distance needs it.
fn stationary(speed_kmh: f64) -> Maneuver {
    // Reaction and build-up take 0.5 s, the stop itself V² / 2b; 5 m are to spare.
    let seen_m = 0.5 * mps(speed_kmh) + mps(speed_kmh) * mps(speed_kmh) / (2.0 * 0.95 * FULL_MPS2) + 5.0;
    let name = format!("ncap-stationary-{speed_kmh:.0}");
    let about = format!("CCRs: a stationary car comes into sight {seen_m:.0} m ahead at {speed_kmh:.0} km/h");
    rear(name, about, speed_kmh, CarScript::steady(seen_m + mps(speed_kmh), 0, 0.0).hidden_until(1.0))
        .checked([Check::at_most("stands", Measure::FinalSpeed, 0.0)])
}

/// CCRm: a slower car, from `speed_kmh` to `target_kmh`.
fn moving((speed_kmh, target_kmh): (f64, f64)) -> Maneuver {
    let name = format!("ncap-moving-{speed_kmh:.0}-{target_kmh:.0}");
    let about = format!("CCRm: {speed_kmh:.0} km/h, a car at {target_kmh:.0} km/h comes into sight at 60 m");
    let target = CarScript::steady(60.0 + mps(speed_kmh - target_kmh), 0, mps(target_kmh)).hidden_until(1.0);
    rear(name, about, speed_kmh, target).checked([Check::between(
        "at its speed",
        Measure::FinalSpeed,
        mps(target_kmh) - 0.3,
        mps(target_kmh) + 0.3,
    )])
}

/// CCRb: both at 50 km/h; the one ahead brakes to standstill.
fn braking((gap_m, brake_mps2): (f64, f64)) -> Maneuver {
    let name = format!("ncap-braking-{gap_m:.0}-{brake_mps2:.0}");
    let about = format!("CCRb: 50 km/h, {gap_m:.0} m behind a car that brakes at {brake_mps2:.0} m/s² to standstill");
    rear(name, about, 50.0, CarScript::steady(gap_m, 0, mps(50.0)).with_phases(&[(1.0, -brake_mps2)]))
        .checked([Check::at_most("stands", Measure::FinalSpeed, 0.0)])
}

/// Lateral speed of the drift, m/s: the fastest of the protocol.
const DRIFT_MPS: f64 = 0.6;
/// From the lane's center to where the body would be on the marking, m.
const IN_MARKING_M: f64 = 0.5 * (3.75 - 1.9);

/// ELK toward an overtaking car: the car is found half way to the marking and drifting on.
fn overtaken((speed_kmh, other_kmh): (f64, f64)) -> Maneuver {
    let ego = EgoScript {
        d_m: 0.5 * IN_MARKING_M,
        heading_rad: DRIFT_MPS / mps(speed_kmh),
        ..EgoScript::hold(mps(speed_kmh))
    };
    let about = format!(
        "ELK: {speed_kmh:.0} km/h, drifts to the left at {DRIFT_MPS} m/s while a car at {other_kmh:.0} km/h overtakes"
    );
    Maneuver::new(format!("ncap-overtaken-{other_kmh:.0}"), about, ego, 8.0)
        .with_cars(vec![CarScript::steady(-6.0, 1, mps(other_kmh))])
        .checked([
            no_collision(),
            Check::at_most("stays in its lane", Measure::LaneError, IN_MARKING_M),
            Check::at_most("settles", Measure::SettleTime, 3.0),
            no_fallback(),
        ])
}
