//! The search for the ceiling by the built binary: it adds what is missing, and the same bytes come out at any number of threads.

#![allow(clippy::unwrap_used, reason = "a test")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

const SHORT: &str = "ceiling rule:proposals --episodes 2 --set evaluation.episode_s=4";

fn run(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lanecraft"));
    command.args(line.split_whitespace()).current_dir(folder).output().unwrap()
}

#[test]
fn a_ceiling_that_was_added_to_is_that_of_one_go() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    for line in
        ["--out whole --width 1 2 --threads 1", "--out parts --width 1", "--out parts --width 1 2 --resume --threads 3"]
    {
        let output = run(path, &format!("{SHORT} {line}"));
        assert_eq!(output.status.code(), Some(0), "{line}: {}", String::from_utf8_lossy(&output.stderr));
        assert!(String::from_utf8_lossy(&output.stdout).contains("rule:proposals"));
    }
    for name in
        ["ceiling-widths.csv", "ceiling-standings.csv", "ceiling-convergence.svg", "ceiling.html", "config.toml"]
    {
        let [whole, parts] = ["whole", "parts"].map(|run| fs::read(path.join(run).join(name)).unwrap());
        assert!(whole == parts, "{name} differs");
    }
}

#[test]
fn a_folder_of_other_scenarios_is_not_added_to() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    assert_eq!(run(path, &format!("{SHORT} --out run --width 1")).status.code(), Some(0));
    for line in ["--out run", "--out run --resume --set traffic.density_veh_per_km_lane=8", "--out other --width 0"] {
        assert_eq!(run(path, &format!("{SHORT} --width 1 {line}")).status.code(), Some(2), "{line}");
    }
}
