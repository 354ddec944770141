//! Scenario files on the command line: listed, shown, driven by rules and by a trained policy, learned in, run again.

#![allow(clippy::unwrap_used, reason = "a test")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const SHORT: &str = "--decisions 600 --set training.log_every_decisions=200 --set learner.learning_starts=100 \
                     --set learner.batch=16 --set learner.core=[16] --set learner.head=[16]";

fn scenarios() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios")
}

fn done(folder: &Path, line: &str) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lanecraft"));
    let output =
        command.args(line.split_whitespace()).current_dir(folder).env_remove("LANECRAFT_DATA").output().unwrap();
    assert_eq!(output.status.code(), Some(0), "`{line}`: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// A folder with the files of the project that the test names.
fn workplace(names: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in names {
        let target = folder.path().join(Path::new(name).file_name().unwrap());
        fs::copy(scenarios().join(name), target).unwrap();
    }
    folder
}

#[test]
fn a_policy_learns_in_one_distribution_and_drives_in_others() {
    let folder = workplace(&["splits/train.toml", "splits/wet-ood.toml", "cut-in.toml"]);
    let path = folder.path();
    done(path, &format!("train --scenario train.toml --out run {SHORT}"));
    // The run goes on without the file, for its configuration holds the text.
    fs::remove_file(path.join("train.toml")).unwrap();
    assert_eq!(done(path, "train --out run --resume"), "run is finished\n");
    let results =
        done(path, "evaluate run rule:random --scenario wet-ood.toml --episodes 2 --set evaluation.episode_s=5 --json");
    assert_eq!(results.lines().count(), 2);
    let drive = "scenario run cut-in.toml --policy run --seconds 10 --seed 2 --json";
    let result: serde_json::Value = serde_json::from_str(&done(path, drive)).unwrap();
    assert_eq!((&result["policy"], &result["duration_s"]), (&"run".into(), &10.0.into()));
    done(path, &format!("{drive} --out trace.jsonl.gz"));
    fs::remove_file(path.join("cut-in.toml")).unwrap();
    assert_eq!(done(path, "replay trace.jsonl.gz --check"), "all 200 steps are the same\n");
}

#[test]
fn files_are_listed_shown_checked_and_drawn() {
    let folder = workplace(&["cut-in.toml", "free.toml"]);
    let path = folder.path();
    let listed = done(path, "scenario list .");
    assert!(listed.starts_with("cut-in ") && listed.contains("\nfree "), "{listed}");
    done(path, "scenario check cut-in.toml free.toml");
    let shown = done(path, "scenario show cut-in.toml");
    // With every key, and a scenario file again.
    assert!(shown.contains("accel_gain_threshold_mps2 = "), "{shown}");
    fs::write(path.join("shown.toml"), shown).unwrap();
    done(path, "scenario check shown.toml");
    fs::create_dir(path.join("pictures")).unwrap();
    done(path, "scenario draw cut-in.toml free.toml --seconds 2 --out pictures");
    assert!(fs::read_to_string(path.join("pictures/free.svg")).unwrap().ends_with("</svg>\n"));
    let schema: serde_json::Value = serde_json::from_str(&done(path, "scenario schema")).unwrap();
    assert!(schema["properties"]["events"].is_object());
}
