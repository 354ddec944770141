//! An episode that one process stores and another goes on from.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use lanecraft_drive::env::{Config, Env};
use lanecraft_lab::snapshot_file::{self, SnapshotFileError};
use lanecraft_net::random::Stream;

/// Names the snapshot to the second process, which is this test's binary, too.
const FILE_VARIABLE: &str = "LANECRAFT_TEST_SNAPSHOT";
/// Before each digest that the second process prints.
const MARK: &str = "digest ";

fn start(seed: u64) -> Env {
    let mut config = Config::default();
    config.env.episode_s = 20.0;
    (config.control.observer, config.perception.position_noise_m) = (true, 0.2);
    Env::new(&Arc::new(config), seed).expect("the default scenario can be built")
}

fn step(env: &mut Env) -> u64 {
    let mut stream = Stream::keyed(1, "snapshot.process", u64::from(env.episode().ticks), 0);
    let allowed: Vec<usize> = (0..32).filter(|&action| env.mask().allows(action)).collect();
    let _ = env.step(allowed[stream.below(allowed.len())]).expect("allowed");
    env.digest()
}

fn drive_on(mut env: Env) -> Vec<u64> {
    let mut digests = Vec::new();
    while !env.is_over() {
        digests.push(step(&mut env));
    }
    digests
}

/// The second process; without a file to go on from there is nothing to do.
#[test]
fn go_on() {
    let Some(file) = std::env::var_os(FILE_VARIABLE).map(PathBuf::from) else { return };
    let env = Env::restore(&snapshot_file::read(&file).expect("whole")).expect("the same version");
    for digest in drive_on(env) {
        println!("{MARK}{digest:016x}");
    }
}

fn gone_on(file: &Path) -> Vec<u64> {
    let program = std::env::current_exe().expect("it runs");
    let output = Command::new(program).args(["--exact", "go_on", "--nocapture"]).env(FILE_VARIABLE, file).output();
    let output = output.expect("it can be started again");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("text");
    // The first stands behind the name of the test on its line.
    let digests = text.lines().filter_map(|line| line.split_once(MARK).map(|(_, digest)| digest));
    digests.map(|digest| u64::from_str_radix(digest, 16).expect("a number")).collect()
}

#[test]
fn another_process_goes_on_bit_for_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    for (seed, ticks) in [(1, 0), (2, 7), (3, 18), (4, 33)] {
        let mut env = start(seed);
        for _ in 0..ticks {
            step(&mut env);
        }
        let file = folder.path().join(format!("{seed}.snapshot"));
        snapshot_file::write(&file, &env.snapshot().expect("can be stored")).expect("can be written");
        let here = drive_on(env);
        assert!(!here.is_empty() && gone_on(&file) == here, "seed {seed}, {ticks} ticks");
    }
}

#[test]
fn a_file_that_is_none_is_refused_with_its_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("notes.txt");
    assert!(matches!(snapshot_file::read(&file), Err(SnapshotFileError::Read { .. })));
    std::fs::write(&file, "no snapshot").expect("can be written");
    let refusal = snapshot_file::read(&file).expect_err("foreign");
    assert!(matches!(refusal, SnapshotFileError::Snapshot { .. }) && refusal.to_string().contains("notes.txt"));
}
