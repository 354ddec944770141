//! Lane changes and courses between cones.

use super::{in_lane, no_fallback, no_guard};
use crate::maneuvers::measure::Gate;
use crate::maneuvers::{Check, EgoScript, Leg, Maneuver, Measure};

pub(super) fn maneuvers() -> Vec<Maneuver> {
    let mut all: Vec<Maneuver> = [20.0, 28.0, 33.0].into_iter().map(lane_change).collect();
    // About as short as 85 % of the grip, of which the controller uses 85 %, allows on each road.
    all.extend([(0.3, 4.0), (0.6, 3.0), (0.9, 2.5)].into_iter().map(lane_change_on_adhesion));
    all.extend([("light", 0.8), ("heavy", 1.2)].into_iter().map(lane_change_with_mass));
    all.extend([forced_wet(), there_and_back(), iso_3888_1()]);
    all.extend([50.0, 60.0].into_iter().map(iso_3888_2));
    all
}

fn steady(slip_use: f64, sideslip_deg: f64) -> [Check; 2] {
    [
        Check::at_most("slip use", Measure::SlipUse, slip_use),
        Check::at_most("sideslip", Measure::Sideslip, sideslip_deg),
    ]
}

fn change(speed_mps: f64, duration_s: f64) -> EgoScript {
    EgoScript::along(speed_mps, vec![Leg { at_s: 0.5, duration_s, d_m: 3.75 }])
}

fn settles() -> [Check; 4] {
    [
        in_lane(),
        Check::at_most("settles", Measure::SettleTime, 0.5),
        Check::at_most("ends in the middle", Measure::FinalLaneError, 0.02),
        no_fallback(),
    ]
}

fn lane_change(speed_mps: f64) -> Maneuver {
    let name = format!("lane-change-{speed_mps:.0}");
    Maneuver::new(name, format!("3.75 m in 3 s at {speed_mps:.0} m/s"), change(speed_mps, 3.0), 8.0)
        .checked(settles())
        .checked([no_guard()])
        .checked(steady(0.5, 0.6))
}

fn lane_change_on_adhesion((adhesion, duration_s): (f64, f64)) -> Maneuver {
    let name = format!("lane-change-mu-{:02.0}", 10.0 * adhesion);
    Maneuver::new(name, format!("3.75 m in {duration_s} s at 28 m/s on μ = {adhesion}"), change(28.0, duration_s), 10.0)
        .on_adhesion(adhesion)
        .checked(settles())
        .checked(steady(0.85, 0.6))
}

fn lane_change_with_mass((name, factor): (&str, f64)) -> Maneuver {
    let mut maneuver = Maneuver::new(
        format!("mass-{name}-lane-change"),
        format!("3.75 m in 3 s at 28 m/s with {factor} times the mass and yaw inertia that the controllers know"),
        change(28.0, 3.0),
        8.0,
    )
    .checked(settles())
    .checked(steady(0.6, 0.6));
    maneuver.options.mass_factor = factor;
    maneuver
}

/// Figure 11's stress case: more than the grip allows, so that only the bounds keep the car in hand.
fn forced_wet() -> Maneuver {
    let ego = EgoScript { path_ratio: 1e-2, ..change(33.3, 2.0) };
    Maneuver::new("forced-wet", "3.75 m in 2 s at 33.3 m/s on μ = 0.4, which the planner would refuse", ego, 9.0)
        .on_adhesion(0.4)
        .checked(steady(1.0, 0.6))
        .checked([
            Check::at_most("stays on the road", Measure::LaneError, 1.5),
            Check::at_most("ends in the middle", Measure::FinalLaneError, 0.1),
            no_fallback(),
        ])
}

fn there_and_back() -> Maneuver {
    let legs = vec![Leg { at_s: 0.5, duration_s: 2.5, d_m: 3.75 }, Leg { at_s: 3.0, duration_s: 2.5, d_m: 0.0 }];
    Maneuver::new(
        "double-lane-change",
        "3.75 m there and back in 2.5 s each at 28 m/s",
        EgoScript::along(28.0, legs),
        9.0,
    )
    .checked(settles())
    .checked(steady(0.75, 0.6))
}

/// Gates one behind the other, as (length, middle, width).
fn gates(sections: &[(f64, Option<(f64, f64)>)]) -> Vec<Gate> {
    let mut from_s_m = START_M;
    let mut gates = Vec::new();
    for &(length_m, lane) in sections {
        gates.extend(lane.map(|(d_m, width_m)| Gate { from_s_m, to_s_m: from_s_m + length_m, d_m, width_m }));
        from_s_m += length_m;
    }
    gates
}

/// Where the courses begin, m.
const START_M: f64 = 30.0;
/// Adhesion of the dry asphalt of a proving ground.
const DRY: f64 = 1.0;
/// Width of the car, m.
const WIDTH_M: f64 = 1.9;

/// ISO 3888-1:2018, the severe lane change, at its 80 km/h: 15 m of lane, 30 m to change by 3.5 m, 25 m of lane, 25 m back, 30 m of lane.
fn iso_3888_1() -> Maneuver {
    let speed_mps = 80.0 / 3.6;
    let lanes = [
        (15.0, Some((0.0, 1.1 * WIDTH_M + 0.25))),
        (30.0, None),
        (25.0, Some((3.5, 1.2 * WIDTH_M + 0.25))),
        (25.0, None),
        (30.0, Some((0.0, 1.3 * WIDTH_M + 0.25))),
    ];
    let when = |s_m: f64| s_m / speed_mps;
    let legs = vec![
        Leg { at_s: when(START_M + 8.0), duration_s: when(42.0), d_m: 3.5 },
        Leg { at_s: when(START_M + 64.0), duration_s: when(36.0), d_m: 0.0 },
    ];
    let ego = EgoScript { path_ratio: 1e-2, ..EgoScript::along(speed_mps, legs) };
    Maneuver::new("iso-3888-1", "severe lane change of ISO 3888-1 at 80 km/h", ego, 8.0)
        .on_adhesion(DRY)
        .checked([
            Check::at_least("no cone touched", Measure::ConeClearance(gates(&lanes)), 0.0),
            Check::at_most("settles", Measure::SettleTime, 1.0),
            no_fallback(),
        ])
        .checked(steady(1.2, 2.0))
}

/// ISO 3888-2:2011, obstacle avoidance: 12 m of lane, 13.5 m to change, 11 m of lane, 12.5 m back, 12 m of lane.
fn iso_3888_2(speed_kmh: f64) -> Maneuver {
    let speed_mps = speed_kmh / 3.6;
    let (first, second, third) = (1.1 * WIDTH_M + 0.25, WIDTH_M + 1.0, 3.0);
    // The second lane begins 1 m to the left of the first one's left edge; the third shares the first one's right edge.
    let second_d_m = 0.5 * first + 1.0 + 0.5 * second;
    let third_d_m = 0.5 * (third - first);
    let lanes = [
        (12.0, Some((0.0, first))),
        (13.5, None),
        (11.0, Some((second_d_m, second))),
        (12.5, None),
        (12.0, Some((third_d_m, third))),
    ];
    let when = |s_m: f64| s_m / speed_mps;
    let legs = vec![
        Leg { at_s: when(START_M + 7.0), duration_s: when(22.5), d_m: second_d_m - 0.15 },
        Leg { at_s: when(START_M + 31.0), duration_s: when(23.0), d_m: third_d_m },
    ];
    let ego = EgoScript { path_ratio: 1e-1, ..EgoScript::along(speed_mps, legs) };
    let no_cone = Check::at_least("no cone touched", Measure::ConeClearance(gates(&lanes)), 0.0);
    let late = "the path is a quintic that does not use the width of the lanes, and the bounds leave 15 % of the grip";
    let name = format!("iso-3888-2-{speed_kmh:.0}");
    Maneuver::new(name, format!("obstacle avoidance of ISO 3888-2 at {speed_kmh:.0} km/h"), ego, 9.0)
        .on_adhesion(DRY)
        .checked([
            if speed_kmh > 50.0 { no_cone.falls_short(late) } else { no_cone },
            Check::at_most("settles", Measure::SettleTime, 1.0),
            no_fallback(),
        ])
        .checked(steady(1.2, 3.0))
}
