//! Runs by the built binary: they end, go on after being killed, and give the same bytes whatever happened on the way.

#![allow(clippy::unwrap_used, reason = "a test")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// A training of seconds, with a checkpoint every few milliseconds.
const SHORT: &str = "--decisions 1500 --set training.log_every_decisions=200 --set training.checkpoint_every_decisions=100 \
                     --set learner.learning_starts=100 --set learner.batch=16 --set learner.core=[16] --set learner.head=[16]";

fn lanecraft(folder: &Path, line: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lanecraft"));
    command.args(line.split_whitespace()).current_dir(folder);
    command
}

fn run(folder: &Path, line: &str) -> Output {
    lanecraft(folder, line).output().unwrap()
}

/// Runs it and expects it to succeed.
fn done(folder: &Path, line: &str) -> String {
    let output = run(folder, line);
    assert_eq!(output.status.code(), Some(0), "`{line}`: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn content(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    entries.map(|entry| (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap())).collect()
}

fn assert_same(a: &Path, b: &Path) {
    let (a, b) = (content(a), content(b));
    assert!(a.keys().eq(b.keys()), "{:?} and {:?}", a.keys(), b.keys());
    for (name, bytes) in &a {
        assert!(*bytes == b[name], "{name} differs");
    }
}

#[test]
fn a_finished_run_stays_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    done(path, &format!("train --out run {SHORT}"));
    let before = content(&path.join("run"));
    assert!(String::from_utf8_lossy(&before["manifest.json"]).contains("\"finished\": true"));
    assert_eq!(done(path, "train --out run --resume"), "run is finished\n");
    for line in ["train --out run", "train --out run --set training.sed=1 --force"] {
        assert_eq!(run(path, line).status.code(), Some(2), "{line}");
    }
    assert!(content(&path.join("run")) == before);
}

#[test]
fn threads_do_not_change_a_run() {
    let folder = tempfile::tempdir().unwrap();
    for threads in [1, 3] {
        done(folder.path(), &format!("train --out threads-{threads} --threads {threads} {SHORT}"));
    }
    assert_same(&folder.path().join("threads-1"), &folder.path().join("threads-3"));
}

/// Kills come at times that vary from machine to machine; every one of them has to be survived.
#[test]
fn a_killed_run_goes_on_to_the_same_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    done(path, &format!("train --out whole {SHORT}"));
    let mut killed = 0;
    for milliseconds in [5, 40, 90, 150, 220, 300] {
        let line = format!("train --out killed --resume {SHORT}");
        let mut child = lanecraft(path, &line).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(milliseconds));
        killed += usize::from(child.try_wait().unwrap().is_none());
        child.kill().unwrap();
        child.wait().unwrap();
    }
    assert!(killed > 0, "no run lasted long enough to be killed");
    done(path, &format!("train --out killed --resume {SHORT}"));
    assert_same(&path.join("whole"), &path.join("killed"));
}

#[test]
fn a_run_is_judged_in_its_own_environment_unless_told_otherwise() {
    let folder = tempfile::tempdir().unwrap();
    done(folder.path(), &format!("train --out run {SHORT} --set traffic.density_veh_per_km_lane=8"));
    let evaluate = "evaluate run --episodes 3 --set evaluation.episode_s=10 --json --quiet";
    let own = done(folder.path(), evaluate);
    assert_eq!(done(folder.path(), &format!("{evaluate} --set traffic.density_veh_per_km_lane=8")), own);
    assert_ne!(done(folder.path(), &format!("{evaluate} --set traffic.density_veh_per_km_lane=20")), own);
}

#[test]
fn the_quick_start_reports_and_its_episode_runs_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let short = SHORT.replace("--decisions ", "--set training.decisions=");
    let line = format!("{short} --set evaluation.episodes=3 --set evaluation.episode_s=10");
    for name in ["quickstart", "quickstart-2"] {
        let text = done(path, &line);
        let report = path.join("runs").join(name).join("report.html");
        assert!(text.contains("rule:best-lane") && text.contains(&format!("runs/{name}/report.html")), "{text}");
        assert!(fs::read_to_string(report).unwrap().contains("</html>"));
    }
    let trace = "runs/quickstart/episode.jsonl.gz";
    assert!(done(path, &format!("replay {trace} --check")).contains("steps are the same"));
    assert!(done(path, &format!("replay {trace}")).lines().count() > 10);
    done(path, "report runs/quickstart runs/quickstart-2");

    // The same episode from another seed is another one.
    let text = lanecraft_lab::trace_file::read_trace(&path.join(trace)).map(|mut trace| {
        trace.header.scenario_seed += 1;
        trace
    });
    lanecraft_lab::trace_file::write_trace(&path.join("other.jsonl"), &text.unwrap()).unwrap();
    let output = run(path, "replay other.jsonl --check");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("step 1 differs in"), "{message}");
}

#[test]
fn policies_are_compared_in_the_same_scenarios() {
    let folder = tempfile::tempdir().unwrap();
    let line = "evaluate rule:best-lane rule:random --episodes 3 --set evaluation.episode_s=5 --json --quiet";
    let lines = done(folder.path(), line);
    let names: Vec<String> = lines
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["policy"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(names, ["rule:best-lane", "rule:random"]);
    assert_eq!(done(folder.path(), &format!("{line} --threads 1")), lines);
}

#[test]
fn a_predictor_is_trained_to_the_same_bytes_at_any_number_of_threads_and_drives() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let short =
        "--set predictor.scenarios=9 --set predictor.scenario_s=10 --set predictor.epochs=1 --set predictor.hidden=4";
    done(path, &format!("predictor train --out one --threads 1 {short}"));
    done(path, &format!("predictor train --out two --threads 2 {short}"));
    assert_same(&path.join("one"), &path.join("two"));
    let files: Vec<String> = content(&path.join("one")).into_keys().collect();
    assert_eq!(files, ["config.toml", "manifest.json", "predictor.safetensors", "report.html", "training.csv"]);
    let with = "--set prediction.model=one/predictor.safetensors --set evaluation.episode_s=5";
    let table =
        done(path, &format!("predictor evaluate --scenarios 2 --set predictor.scenario_s=10 --out figures {with}"));
    assert!(table.contains("constant-acceleration") && table.contains("lstm"), "{table}");
    let markdown = fs::read_to_string(path.join("figures/predictor.md")).unwrap();
    assert!(markdown.contains("| idm-rollout | 2 | "), "{markdown}");
    let swapped = done(path, &format!("predictor swap --episodes 2 --policy rule:keep-lane --json {with}"));
    assert_eq!(swapped.lines().count(), 5, "{swapped}");
}

/// A study of seconds: two variants that learn and one rule, of which one shares the training of another.
const STUDY: &str = r#"
title = "Study"
summary = "With and without a shield."
preset = "default"
reference = "with"
base = { learner.learning_starts = 50, learner.batch = 8, learner.core = [8], learner.head = [8], evaluation.episode_s = 5 }
[[variants]]
name = "with"
[[variants]]
name = "without"
test = { shield.enabled = false }
[[variants]]
name = "rule"
policy = "rule:keep-lane"
[[claims]]
source = "Fig. 0"
metric = "reward"
variant = "with"
against = "rule"
change_percent = 10.0
"#;

#[test]
fn a_sweep_runs_only_what_is_missing_and_its_rows_are_the_same_in_any_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("study.toml"), STUDY).unwrap();
    let sweep = |out: &str, with: &str| {
        done(path, &format!("sweep study.toml --decisions 150 --seeds 2 --episodes 3 --out {out} {with}"))
    };
    let tables = sweep("one", "--jobs 3");
    assert!(tables.contains("without") && tables.contains("Fig. 0"), "{tables}");
    sweep("two", "--jobs 1");
    let rows = |out: &str| fs::read_to_string(path.join(out).join("study/rows.csv")).unwrap();
    assert_eq!(rows("one"), rows("two"));
    // A row that is there is taken as it is; one that is missing is computed again, to the same bytes.
    let marked: Vec<String> =
        rows("one").lines().filter(|line| !line.starts_with("without,1,")).map(str::to_owned).collect();
    assert_eq!(marked.len(), 5);
    fs::write(path.join("one/study/rows.csv"), marked.join("\n") + "\n").unwrap();
    assert_eq!(fs::read_dir(path.join("one/study/runs")).unwrap().count(), 2);
    sweep("one", "--jobs 2");
    assert_eq!(rows("one"), rows("two"));
    for name in ["experiment.html", "experiment.md", "experiment-results.csv", "experiment-safety.svg"] {
        assert!(path.join("one/study").join(name).exists(), "{name}");
    }
}

#[test]
fn rows_alone_make_the_tables_and_missing_ones_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), "reproduce fig12 --budget smoke --rows-only --out none");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("no row of dqn, seed 0, dqn, seed 1"), "{message}");
    assert!(!folder.path().join("none").exists());
    for (line, said) in [
        ("reproduce fig99 --out none", "did you mean"),
        ("sweep --out none", "nothing to vary"),
        ("sweep --vary learner.discuont=0.9 --out none", "did you mean `learner.discount`?"),
        ("sweep --vary learner.discount=0.9,9 --out none", "`learner.discount` is 9"),
        ("sweep --vary learner.discount --out none", "KEY=VALUE"),
    ] {
        let output = run(folder.path(), line);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{line}: {message}");
        assert!(message.contains(said), "{line}: {message}");
    }
}

#[test]
fn runs_are_pooled_by_their_seeds_and_unfinished_ones_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let short = format!("{SHORT} --set evaluation.episodes=3 --set evaluation.episode_s=5");
    for (algorithm, seed) in [("dqn", 0), ("dqn", 1), ("double-dqn", 0), ("double-dqn", 1)] {
        done(path, &format!("train --out runs/{algorithm}/{seed} --algorithm {algorithm} --seed {seed} {short}"));
    }
    done(path, &format!("train --out runs/thin --set traffic.density_veh_per_km_lane=8 {short}"));
    fs::create_dir_all(path.join("runs/broken")).unwrap();
    for file in ["config.toml", "manifest.json"] {
        fs::copy(path.join("runs/thin").join(file), path.join("runs/broken").join(file)).unwrap();
    }
    let runs = "runs/dqn/0 runs/dqn/1 runs/double-dqn/0 runs/double-dqn/1 runs/thin runs/broken";
    let output = run(path, &format!("report {runs}"));
    assert!(output.status.success());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("runs/broken is left out") && said.contains("policy.safetensors"), "{said}");
    let page = fs::read_to_string(path.join("runs/dqn/0/report.html")).unwrap();
    for text in [
        "1 of 6 runs failed or are incomplete",
        "2 different sets of test scenarios",
        "double-dqn has 2 training seeds",
        "<small>2 seeds, 6 episodes</small>",
        "same seeds, paired",
        "Results in the scenarios of thin",
        "runs/double-dqn/1",
    ] {
        assert!(page.contains(text), "{text}");
    }
    // Alone, what is not finished has no page.
    let output = run(path, "report runs/broken");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("policy.safetensors"));
}

/// The tables of `docs/reproduction.md` follow from the rows in `experiments/results`.
#[test]
fn the_documented_results_are_those_of_the_rows() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let documented = fs::read_to_string(root.join("docs/reproduction.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for entry in fs::read_dir(root.join("experiments/results")).unwrap().map(Result::unwrap) {
        let name = entry.file_name().into_string().unwrap();
        fs::create_dir(folder.path().join(&name)).unwrap();
        fs::copy(entry.path().join("rows.csv"), folder.path().join(&name).join("rows.csv")).unwrap();
        done(folder.path(), &format!("reproduce {name} --budget quick --rows-only --out ."));
        let tables = fs::read_to_string(folder.path().join(&name).join("experiment.md")).unwrap();
        let (results, _) = tables.split_once("\n\nRelative").unwrap_or((&tables, ""));
        for line in results.lines().filter(|line| line.starts_with('|')) {
            assert!(documented.contains(line), "{name}: {line}");
        }
    }
}
