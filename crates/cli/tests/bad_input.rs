//! Bad input against the built binary: exit code 2, a message that says what to change, and nothing written.

#![allow(clippy::unwrap_used, reason = "a test")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Runs the binary in `folder` with the words of `line` as arguments.
fn lanecraft(folder: &Path, line: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lanecraft")).args(line.split_whitespace()).current_dir(folder).output().unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// A folder with a finished run, an interrupted run, a folder that is no run, and files that are broken.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    for (name, finished) in [("finished", true), ("interrupted", false)] {
        fs::create_dir(path.join(name)).unwrap();
        let manifest = format!(
            r#"{{"schema": 1, "version": "0.1.0", "commit": "unknown", "command": "train", "preset": "default",
               "seed": 0, "config_sha256": "", "finished": {finished}, "files": {{}}}}"#
        );
        fs::write(path.join(name).join("manifest.json"), manifest).unwrap();
    }
    fs::create_dir(path.join("photos")).unwrap();
    fs::write(path.join("photos/cat.jpg"), "cat").unwrap();
    fs::create_dir(path.join("broken")).unwrap();
    fs::write(path.join("broken/manifest.json"), "{").unwrap();
    fs::write(path.join("misspelt.toml"), "[training]\n\nsed = 3\n").unwrap();
    let jam = "name = \"jam\"\ndescription = \"\"\n\n[traffic]\ndensity_veh_per_km_lane = 180.0\n";
    fs::write(path.join("jam.toml"), jam).unwrap();
    fs::write(path.join("no.toml"), "[training\n").unwrap();
    fs::write(path.join("binary.toml"), [0xff_u8, 0xfe, 0x00]).unwrap();
    folder
}

/// Command line, and what the message must contain.
const REFUSED: &[(&str, &[&str])] = &[
    // Keys and values of the configuration.
    ("--set training.sed=1", &["`training.sed`", "value 1", "did you mean `training.seed`?"]),
    ("quickstart --set trainin.seed=1", &["`trainin.seed`", "did you mean `training.seed`?"]),
    ("train --out new --set decisions=1", &["did you mean `training.decisions`?"]),
    ("train --out new --set env.episode_s=0", &["`env.episode_s` is 0", "1..=100000"]),
    ("train --out new --set env.episode_s=nan", &["`env.episode_s` is nan", "finite"]),
    ("train --out new --set env.episode_s=long", &["`env.episode_s` is \"long\"", "a number"]),
    ("train --out new --set training.seed=1.5", &["`training.seed` is 1.5", "a whole number"]),
    ("train --out new --set training.seed", &["key=value"]),
    ("train --out new --seed 99999999", &["`training.seed` is 99999999", "0..=1048575"]),
    ("train --out new --decisions 0", &["`training.decisions` is 0"]),
    ("evaluate rule:random --episodes 0", &["`evaluation.episodes` is 0"]),
    ("train --out new --set learner.discuont=1", &["did you mean `learner.discount`?"]),
    ("train --out new --set learner.discount=1.5", &["`learner.discount` is 1.5", "0..=1"]),
    ("train --out new --set learner.algorithm=doubel-dqn", &["did you mean `double-dqn`?"]),
    ("train --out new --algorithm dqn --set learner.batch=0", &["`learner.batch` is 0"]),
    ("--set traffic.density=20", &["did you mean `traffic.density_veh_per_km_lane`?"]),
    ("--set traffic.density_veh_per_km_lane=-3", &["`traffic.density_veh_per_km_lane` is -3"]),
    ("--set env.decision_period_s=0.12", &["`env.decision_period_s` is 0.12 s", "`env.control_period_s` = 0.05 s"]),
    ("--set env.control_period_s=0.033", &["`env.control_period_s` is 0.033 s"]),
    ("--set control.stability_constraints=1", &["`control.stability_constraints` is 1", "true or false"]),
    ("--preset paper --set vehicle.tires=pacejkka", &["did you mean `pacejka`?"]),
    // Files of the configuration.
    ("train --out new --config misspelt.toml", &["misspelt.toml:3", "did you mean `training.seed`?"]),
    ("train --out new --config no.toml", &["no.toml:1"]),
    ("train --out new --config binary.toml", &["cannot read binary.toml"]),
    ("train --out new --config missing.toml", &["cannot read missing.toml"]),
    ("train --out new --config photos", &["cannot read photos"]),
    // Recordings.
    ("data inspect photos", &["this is a folder"]),
    ("data inspect photos/dog.jpg", &["there is no such file"]),
    ("data inspect misspelt.toml", &["misspelt.toml, line 1", "begins no recording that is known"]),
    ("data extract binary.toml --out new", &["binary.toml, line 1", "begins no recording that is known"]),
    ("data extract misspelt.toml", &["--out"]),
    // Names.
    ("trian", &["'train'"]),
    ("train --out new --preset papr", &["papr", "paper"]),
    ("train --out new --algorithm doubel-dqn", &["doubel-dqn", "double-dqn"]),
    ("train --out new --forse", &["--forse", "--force"]),
    ("evaluate rule:best-lan", &["rule:best-lan", "did you mean `rule:best-lane`?"]),
    ("evaluate best-lane", &["best-lane", "did you mean `rule:best-lane`?"]),
    // Missing, broken and unfit files and folders.
    ("evaluate", &["DIR|rule:NAME"]),
    ("evaluate finishd", &["finishd", "did you mean `finished`?"]),
    ("evaluate photos", &["photos is not a run"]),
    ("evaluate broken", &["broken/manifest.json is broken"]),
    ("report", &["RUN"]),
    ("report no.toml", &["this is no folder"]),
    ("report broken", &["broken/manifest.json is broken"]),
    ("replay missing.json", &["there is no such file"]),
    ("replay photos", &["this is a folder"]),
    ("irl fit --data nowhere", &["there is nothing of this name"]),
    ("--data nowhere", &["there is no such folder"]),
    ("traffic calibrate --data nowhere", &["there is no such folder"]),
    ("traffic calibrate --data photos", &["photos/traffic.csv.gz", "cannot be opened"]),
    ("--set traffic.time_headway_s=1.2", &["`traffic.time_headway_s` is 1.2", "a table with a `kind`"]),
    (
        "--set traffic.time_headway_s.max=0.5",
        &["`traffic.time_headway_s.min` is 1, above `traffic.time_headway_s.max`"],
    ),
    ("train", &["--out"]),
    ("scenario check gone.toml", &["there is no such file"]),
    ("scenario check misspelt.toml", &["misspelt.toml:1:", "`training`"]),
    ("scenario check jam.toml", &["jam.toml:5: 180 vehicles in lane 0"]),
    ("scenario run jam.toml --out jam.svg", &["jam.toml:5:"]),
    ("scenario run jam.toml --out jam.png", &["jam.png is neither a picture (.svg) nor a trace"]),
    ("scenario run jam.toml --policy rule:best-lan", &["did you mean `rule:best-lane`?"]),
    ("scenario list photos", &["there is no scenario in photos"]),
    ("evaluate rule:random --scenario misspelt.toml", &["misspelt.toml:1:", "`training`"]),
    ("train --out new --scenario jam.toml", &["jam.toml:5:"]),
    ("train --out new --set env.scenario=3", &["`env.scenario` is no scenario"]),
    ("train --out new --threads 0", &["1..=1024"]),
    // The predictor.
    ("predictor train --out new --set predictor.hidden=0", &["`predictor.hidden` is 0", "1..=512"]),
    ("predictor train --out new --set predictor.scenarios=0", &["no vehicle", "--data"]),
    ("predictor train --out new --data nowhere.csv", &["nowhere.csv"]),
    ("predictor train --out finished", &["finished exists already", "--force"]),
    ("predictor evaluate --data misspelt.toml", &["misspelt.toml"]),
    (
        "evaluate rule:random --set prediction.model=photos/cat.jpg",
        &["`prediction.model` is \"photos/cat.jpg\"", "the tensor file has 3 bytes"],
    ),
    ("evaluate rule:random --set prediction.model=nowhere", &["`prediction.model` is \"nowhere\"", "No such file"]),
    ("evaluate rule:random --set prediction.predictor=lsmt", &["did you mean `lstm`?"]),
    // Runs that exist.
    ("train --out finished", &["finished exists already", "--force"]),
    ("train --out photos", &["photos exists already"]),
    ("train --out photos --force", &["photos is not a run", "left alone"]),
    ("train --out broken --force", &["broken is not a run", "left alone"]),
    ("train --out no.toml --force", &["no.toml"]),
    ("train --out no.toml/run", &["no.toml/run"]),
    ("train --out new --resume --force", &["cannot be used with"]),
    ("train --out photos --resume", &["photos exists already"]),
    ("train --out broken --resume", &["broken/manifest.json is broken"]),
];

#[test]
fn bad_input_is_refused_by_name_and_nothing_is_written() {
    let folder = workplace();
    let before = names(folder.path());
    for (line, expected) in REFUSED {
        let output = lanecraft(folder.path(), line);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "`{line}`: {message}");
        for part in *expected {
            assert!(message.contains(part), "`{line}` should say `{part}`, but says: {message}");
        }
        assert!(!message.contains("panicked"), "`{line}`: {message}");
        assert!(output.stdout.is_empty(), "`{line}` printed a result");
        assert_eq!(names(folder.path()), before, "`{line}` wrote something");
    }
    assert_eq!(names(&folder.path().join("finished")), ["manifest.json"]);
    assert_eq!(fs::read(folder.path().join("photos/cat.jpg")).unwrap(), b"cat");
}

#[test]
fn help_shows_examples_for_every_command() {
    let folder = tempfile::tempdir().unwrap();
    let commands = ["", "quickstart", "irl fit", "train", "evaluate", "report", "replay", "bench", "traffic calibrate"];
    for command in commands.into_iter().chain([
        "scenario",
        "scenario run",
        "data inspect",
        "data extract",
        "predictor train",
        "predictor evaluate",
        "predictor swap",
        "reproduce",
        "sweep",
        "export",
    ]) {
        let output = lanecraft(folder.path(), &format!("{command} --help"));
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert_eq!(output.status.code(), Some(0), "{command}");
        let example = format!("  lanecraft {command}");
        assert!(text.contains("Examples:") && text.contains(example.trim_end()), "{command}: {text}");
    }
}
