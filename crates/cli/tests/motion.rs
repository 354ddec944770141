//! The commands about motion control: `maneuvers` and `study`.

use std::process::{Command, Output};

fn lanecraft(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lanecraft")).args(arguments).output().expect("the binary runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn a_maneuver_is_judged_in_json() {
    let output = lanecraft(&["maneuvers", "cut-in", "--json"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let outcome: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one object");
    assert_eq!(outcome["maneuver"], "cut-in");
    let verdicts = outcome["verdicts"].as_array().expect("a list");
    assert!(verdicts.iter().any(|v| v["check"] == "no collision" && v["passed"] == true));
}

#[test]
fn a_failing_check_ends_with_code_2_and_the_name() {
    let output = lanecraft(&["maneuvers", "side-wind-observer", "--lateral", "lqr"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stdout).contains("FAIL"));
    assert!(text(&output.stderr).contains("1 of 1 maneuvers fail: side-wind-observer"));
    let output = lanecraft(&["maneuvers", "cut-inn"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("did you mean `cut-in`?"));
}

#[test]
fn a_study_leaves_tables_figures_and_a_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("new/figures");
    let output = lanecraft(&["study", "phase-plane", "--out", &out.to_string_lossy()]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("bounds off"));
    for file in ["phase-plane-bounds.csv", "phase-plane-bounds.svg", "phase-plane.html"] {
        assert!(out.join(file).metadata().is_ok_and(|data| data.len() > 100), "{file}");
    }
}
