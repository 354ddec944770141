//! Every maneuver of the suite, driven once.

use std::collections::BTreeSet;

use lanecraft_drive::control::TerminalCost;
use lanecraft_drive::vehicle::{LoadTransfer, TireModel};
use lanecraft_lab::maneuvers::{LateralLaw, Maneuver, SpeedLaw, Stack, catalogue};

#[test]
fn every_maneuver_passes_its_checks() {
    let all = catalogue();
    assert!(all.len() >= 30, "{} maneuvers", all.len());
    let names: BTreeSet<&str> = all.iter().map(|maneuver| maneuver.name.as_str()).collect();
    assert_eq!(names.len(), all.len(), "names are unique");
    let mut wrong = Vec::new();
    for maneuver in &all {
        for v in maneuver.judge(Stack::default()).unwrap().verdicts {
            // A shortfall that is none any more has to be struck out.
            if v.passed != v.shortfall.is_empty() {
                let bounds = format!("{}..{}", v.low, v.high);
                wrong.push(format!("{}: {}: {:.3} {} in {bounds}", maneuver.name, v.check, v.measured, v.unit));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn named(name: &str) -> Maneuver {
    catalogue().into_iter().find(|maneuver| maneuver.name == name).expect("it is in the catalogue")
}

/// Names of the failed checks.
fn failed(maneuver: &Maneuver) -> Vec<&'static str> {
    let verdicts = maneuver.judge(Stack::default()).expect("it is valid").verdicts;
    verdicts.iter().filter(|v| !v.passed && v.shortfall.is_empty()).map(|v| v.check).collect()
}

#[test]
fn checks_fail_where_the_stack_is_crippled() {
    let cripple = |name: &str, change: &dyn Fn(&mut Maneuver)| {
        let mut maneuver = named(name);
        change(&mut maneuver);
        let failed = failed(&maneuver);
        println!("{name}: {failed:?}");
        failed
    };
    let blind = |m: &mut Maneuver| (m.control.guard, m.control.safe_spacing) = (false, false);
    assert!(cripple("cut-out-standing", &blind).contains(&"no collision"));
    assert!(cripple("leader-brakes-7", &blind).contains(&"no collision"));
    assert!(cripple("ncap-stationary-110", &blind).contains(&"no collision"));
    assert!(cripple("ncap-overtaken-80", &|m| m.ego.path_ratio = 1e-7).contains(&"stays in its lane"));
    let short_sighted = |m: &mut Maneuver| (m.control.longitudinal_horizon, m.control.safe_spacing) = (5, false);
    assert!(cripple("standing-car-33", &short_sighted).contains(&"guard idle"));
    let free = |m: &mut Maneuver| m.control.stability_constraints = false;
    assert!(cripple("forced-wet", &free).contains(&"sideslip"));
    let jerky = |m: &mut Maneuver| m.control.jerk_max_mps3 = 20.0;
    assert!(cripple("leader-brakes-5", &jerky).contains(&"jerk"));
    let lazy = |m: &mut Maneuver| m.ego.path_ratio = 1e-6;
    assert!(cripple("lane-change-28", &lazy).contains(&"stays in lane"));
    assert!(cripple("bend-650", &|m| m.road.adhesion = 0.15).contains(&"stays in lane"));
    let late = |m: &mut Maneuver| (m.control.delay_compensation, m.plant.steer_delay_s) = (false, 0.3);
    assert!(cripple("steer-delay-200", &late).contains(&"settles"));
    assert!(cripple("side-wind-observer", &|m| m.control.observer = false).contains(&"ends in the middle"));
    assert!(cripple("hold-up-10", &|m| m.control.observer = false).contains(&"holds the speed"));
    let slow = |m: &mut Maneuver| m.plant.max_steer_rate_radps = 0.15;
    assert!(cripple("iso-3888-2-50", &slow).contains(&"no cone touched"));
}

#[test]
fn a_truer_car_drives_them_as_well() {
    // Axle loads that follow the acceleration, grip shared between braking and steering, Dugoff's tires.
    let mut wrong = Vec::new();
    for mut maneuver in catalogue() {
        maneuver.options.load_transfer = LoadTransfer::QuasiStatic;
        maneuver.options.combined_grip = true;
        maneuver.plant.tires = TireModel::Dugoff;
        wrong.extend(failed(&maneuver).into_iter().map(|check| format!("{}: {check}", maneuver.name)));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn classical_controllers_drive_the_same_maneuvers() {
    for lateral in [LateralLaw::Lqr, LateralLaw::Stanley] {
        let stack = Stack { lateral, speed: SpeedLaw::Pi };
        for maneuver in catalogue() {
            let outcome = maneuver.judge(stack).unwrap();
            // They know no bounds of slip, jerk or spacing; but behind the same guard nobody is hit.
            for v in outcome.verdicts.iter().filter(|v| v.check == "no collision") {
                assert!(v.passed, "{} with {lateral:?}: {} m", outcome.maneuver, v.measured);
            }
        }
    }
}

#[test]
fn the_regulators_cost_to_go_makes_a_short_horizon_long_enough() {
    let failing = |terminal_cost| {
        let all = catalogue().into_iter().map(|mut maneuver| {
            (maneuver.control.lateral_horizon, maneuver.control.terminal_cost) = (8, terminal_cost);
            maneuver
        });
        all.filter(|maneuver| !failed(maneuver).is_empty()).map(|maneuver| maneuver.name).collect::<Vec<_>>()
    };
    assert_eq!(failing(TerminalCost::Riccati), Vec::<String>::new());
    let weighted = failing(TerminalCost::Weighted);
    assert!(weighted.len() >= 4, "{weighted:?}");
}
