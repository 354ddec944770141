//! The scenario files that come with the project: each drives, and pictures, page and schema are current.
//!
//! With `LANECRAFT_UPDATE` set, the committed digests, pictures, page and schema are written anew instead of compared.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test that says what it skips")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use lanecraft_drive::env::{Frame, Trace, VehicleFrame};
use lanecraft_lab::baselines::Rule;
use lanecraft_lab::config::{Preset, RunConfig};
use lanecraft_lab::policy::Policy;
use lanecraft_lab::scenarios::{LoadedScenario, gallery_page, list, picture, schema};
use rayon::prelude::*;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn files() -> Vec<PathBuf> {
    let scenarios = root().join("scenarios");
    let mut files = list(&scenarios).unwrap();
    files.extend(list(&scenarios.join("splits")).unwrap());
    files
}

/// The file's name without its end, after its folder's if that is not `scenarios`.
fn key(path: &Path) -> String {
    let relative = path.strip_prefix(root().join("scenarios")).unwrap();
    relative.with_extension("").to_string_lossy().replace('\\', "/")
}

/// Reads a scenario; none if it needs recordings that are not there.
fn load(path: &Path) -> Option<LoadedScenario> {
    let text = std::fs::read_to_string(path).unwrap();
    if text.contains("[recording]") && std::env::var_os("LANECRAFT_DATA").is_none() {
        println!("skipped {}: LANECRAFT_DATA is not set", path.display());
        return None;
    }
    Some(LoadedScenario::read(path).unwrap_or_else(|error| panic!("{error}")))
}

fn drive(scenario: &LoadedScenario, rule: Rule) -> (Trace, u32) {
    let mut config = RunConfig::resolve(Preset::Default, None, &[]).unwrap().environment;
    config.env.episode_s = scenario.file.duration_s;
    let (trace, episode) = scenario.drive(&Policy::Rule(rule), &config, 1).unwrap();
    // Recorded vehicles appear where their tracks begin, be that right before the ego.
    if let Some(collision) = episode.collision.filter(|_| !scenario.needs_recording()) {
        let name = &scenario.file.name;
        assert!(!collision.fault.at_fault(), "{name}: {} drove into somebody: {collision:?}", rule.name());
    }
    (trace, episode.counts.lane_changes)
}

fn overlap(a: &VehicleFrame, b: &VehicleFrame) -> bool {
    (a.ahead_m - b.ahead_m).abs() < 0.5 * (a.length_m + b.length_m)
        && (a.d_m - b.d_m).abs() < 0.5 * (a.width_m + b.width_m)
}

fn pairs_that_overlap(frame: &Frame) -> usize {
    let vehicles = &frame.vehicles;
    let with_earlier = |(i, a): (usize, &VehicleFrame)| vehicles[..i].iter().filter(|b| overlap(a, b)).count();
    vehicles.iter().enumerate().map(with_earlier).sum()
}

fn check(scenario: &LoadedScenario, rule: Rule) -> String {
    let (trace, _) = drive(scenario, rule);
    let name = &scenario.file.name;
    let frames = trace.ticks.iter().flat_map(|tick| &tick.frames);
    // Recorded vehicles are where they were recorded, up to errors of some decimeters.
    if !scenario.needs_recording() {
        let overlaps: usize = frames.map(pairs_that_overlap).sum();
        assert_eq!(overlaps, 0, "{name}: human drivers touch each other");
    }
    let (right_m, left_m) = scenario.road().unwrap().edges_m();
    let mut egos = trace.ticks.iter().flat_map(|tick| &tick.frames).map(|frame| frame.ego.d_m);
    assert!(egos.all(|d_m| (right_m..=left_m).contains(&d_m)), "{name} leads off the road");
    if rule.name() == "best-lane" && !key(&scenario.path).contains('/') {
        hold(&format!("docs/gallery/{name}.svg"), &picture(name, &trace, &scenario.road().unwrap()));
    }
    let last = trace.ticks.last().and_then(|tick| tick.frames.last()).unwrap();
    let end_s = last.time_s;
    format!("{} {} {end_s:.2} {}", key(&scenario.path), rule.name(), last.digest)
}

/// Compares with a committed text, or writes it.
fn hold(path: &str, text: &str) {
    let path = root().join(path);
    if std::env::var_os("LANECRAFT_UPDATE").is_some() {
        std::fs::write(&path, text).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap();
    assert!(committed == text, "{} is not current: set LANECRAFT_UPDATE and run this test again", path.display());
}

/// Every scenario drives for as long as it says under a rule and under random choice, without a contact among human drivers and
/// without one by the ego's fault, with the same bits everywhere; the pictures of the gallery are those of the rule. Each line: file, rule, seconds driven, digest of the last state.
#[test]
fn every_scenario_drives_with_its_digests() {
    let jobs: Vec<(PathBuf, Rule)> = (files().into_iter())
        .flat_map(|path| ["best-lane", "random"].map(|rule| (path.clone(), rule.parse().unwrap())))
        .collect();
    let lines = jobs.par_iter().map(|(path, rule)| load(path).map(|scenario| check(&scenario, *rule)));
    let lines: Vec<Option<String>> = lines.collect();
    let committed = std::fs::read_to_string(root().join("crates/lab/tests/scenario_digests.txt")).unwrap_or_default();
    // What cannot be driven here keeps its committed line.
    let of_job = |((path, rule), line): (&(PathBuf, Rule), Option<String>)| {
        let start = format!("{} {} ", key(path), rule.name());
        line.or_else(|| committed.lines().find(|line| line.starts_with(&start)).map(str::to_owned)).unwrap_or_default()
    };
    let text: String = jobs.iter().zip(lines).map(of_job).map(|line| line + "\n").collect();
    for (now, then) in text.lines().zip(committed.lines()) {
        if now != then {
            println!("now  {now}\nthen {then}");
        }
    }
    hold("crates/lab/tests/scenario_digests.txt", &text);
}

#[test]
fn the_overtaking_scene_gives_the_ego_four_lane_changes() {
    let scenario = load(&root().join("scenarios/continuous-overtaking.toml")).unwrap();
    let (_, changes) = drive(&scenario, "best-lane".parse().unwrap());
    assert!(changes >= 4, "{changes} lane changes");
}

#[test]
fn the_page_of_the_gallery_shows_every_scenario() {
    let paths = list(&root().join("scenarios")).unwrap();
    assert!(paths.len() >= 20, "{} scenarios", paths.len());
    let files: Vec<_> = paths.iter().map(|path| (path.as_path(), std::fs::read_to_string(path).unwrap())).collect();
    hold("docs/gallery.md", &gallery_page(&files).unwrap());
    for path in &paths {
        let drawn = root().join("docs/gallery").join(path.with_extension("svg").file_name().unwrap());
        assert!(drawn.is_file(), "there is no picture {}", drawn.display());
        let name = lanecraft_lab::scenarios::name_of(path);
        let text = std::fs::read_to_string(path).unwrap();
        assert!(text.contains(&format!("name = \"{name}\"")), "{} has another name in it", path.display());
    }
}

#[test]
fn the_schema_is_current() {
    hold("docs/scenario.schema.json", &schema());
}

#[test]
fn a_picture_is_plain_svg_and_the_same_each_time() {
    let scenario = load(&root().join("scenarios/cut-in.toml")).unwrap();
    let mut config = RunConfig::resolve(Preset::Default, None, &[]).unwrap().environment;
    config.env.episode_s = 5.0;
    let draw = || {
        let (trace, _) = scenario.drive(&Policy::Rule(Rule::KeepLane), &config, 1).unwrap();
        picture("a < b", &trace, &scenario.road().unwrap())
    };
    let svg = draw();
    assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n") && svg.contains("a &lt; b"));
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "a number that is none");
    assert_eq!(svg, draw());
}

const TWO_CARS: &str = r#"name = "two"
description = "two cars"

[road]
topology = "open"

[ego]
kind = "at"
lane = 1
s_m = 0.0
speed_mps = 20.0

[[vehicles]]
name = "leader"
lane = 0
s_m = 100.0
speed_mps = 20.0
desired_speed_mps = 25.0
kind = "car"

[[vehicles]]
name = "follower"
lane = 0
s_m = 50.0
speed_mps = 20.0
desired_speed_mps = 25.0
kind = "car"

[[events]]
vehicle = "leader"
trigger = { kind = "at-time", time_s = 5.0 }
action = { kind = "brake", decel_mps2 = 5.0, duration_s = 2.0 }
"#;

/// What is changed in the file above, and what the message must contain.
const WRONG: &[(&str, &str, &[&str])] = &[
    ("s_m = 50.0", "s_mm = 50.0", &["two.toml:24:", "`s_mm`", "did you mean `s_m`?"]),
    ("[road]", "[raod]", &["two.toml:4:", "`raod`", "did you mean `road`?"]),
    ("s_m = 50.0", "s_m = 98.0", &["two.toml:16:", "overlap at the start"]),
    ("s_m = 50.0\nspeed_mps = 20.0", "s_m = 85.0\nspeed_mps = 33.0", &["two.toml:24:", "starts"]),
    ("lane = 1", "lane = 3", &["two.toml:9:", "the ego is in lane 3", "lanes 0 to 2"]),
    ("name = \"follower\"\nlane = 0", "name = \"follower\"\nlane = 7", &["two.toml:23:", "lane 7"]),
    ("s_m = 50.0", "s_m = nan", &["two.toml:24:", "NaN"]),
    ("s_m = 50.0", "s_m = \"far\"", &["two.toml:24:", "invalid type", "far"]),
    ("vehicle = \"leader\"", "vehicle = \"laeder\"", &["two.toml:30:", "`laeder`", "did you mean `leader`?"]),
    ("name = \"follower\"", "name = \"leader\"", &["two.toml:22:", "`leader`", "names must differ"]),
    ("decel_mps2 = 5.0", "decel_mps2 = -5.0", &["two.toml:32:", "`events.action.decel_mps2` is -5"]),
    ("time_s = 5.0", "time_s = inf", &["two.toml:31:", "`events.trigger.time_s` is inf"]),
    ("kind = \"brake\"", "kind = \"brak\"", &["two.toml:32:", "`brak`", "did you mean `brake`?"]),
    ("topology = \"open\"", "lanes = 0", &["two.toml:5:", "`road.lanes` is 0", "1..=8"]),
    ("[road]", "[traffic]\nsafe_decel_mps2 = nan\n\n[road]", &["two.toml:5:", "`traffic.safe_decel_mps2` is NaN"]),
    (
        "[road]",
        "[ranges]\ntraffic.truck_shar = [0.0, 0.5]\n\n[road]",
        &["two.toml:5:", "did you mean `traffic.truck_share`?"],
    ),
    ("[road]", "[ranges]\ntraffic.truck_share = [0.5, 0.0]\n\n[road]", &["two.toml:5:", "[0.5, 0]"]),
    ("[road]", "[ranges]\ntraffic.truck_share = [0.0, 1.5]\n\n[road]", &["`traffic.truck_share` is 1.5"]),
    (
        "topology = \"open\"",
        "topology = \"ring\"\n\n[[flows]]\nlane = 0\ninflow_veh_per_h = 900.0",
        &["two.toml:7:", "flows"],
    ),
    ("[ego]", "[[flows]]\nlane = 4\ninflow_veh_per_h = 900.0\n\n[ego]", &["two.toml:8:", "flow 0 is in lane 4"]),
    ("[ego]", "[recording]\nfile = \"gone.csv\"\nsite = \"a\"\n\n[ego]", &["two.toml:17:", "beside `recording`"]),
];

/// Every wrong file is refused when it is read, with its line, its key and, where a name is misspelt, the nearest one.
#[test]
fn wrong_files_are_refused_with_line_key_and_suggestion() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.toml");
    std::fs::write(&path, TWO_CARS).unwrap();
    LoadedScenario::read(&path).unwrap();
    for (from, to, expected) in WRONG {
        assert!(TWO_CARS.contains(from), "{from}");
        std::fs::write(&path, TWO_CARS.replacen(from, to, 1)).unwrap();
        let message = LoadedScenario::read(&path).unwrap_err().to_string();
        for part in *expected {
            assert!(message.contains(part), "`{to}`: `{message}` does not say `{part}`");
        }
    }
}

#[test]
fn a_density_that_does_not_fit_and_a_missing_recording_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("full.toml");
    std::fs::write(&path, "name = \"full\"\ndescription = \"d\"\n\n[traffic]\ndensity_veh_per_km_lane = 180.0\n")
        .unwrap();
    let message = LoadedScenario::read(&path).unwrap_err().to_string();
    assert!(message.contains("full.toml:5: 180 vehicles in lane 0 take"), "{message}");
    let text = "name = \"r\"\ndescription = \"d\"\n\n[recording]\nfile = \"gone.csv\"\nsite = \"a\"\n";
    std::fs::write(&path, text).unwrap();
    let message = LoadedScenario::read(&path).unwrap_err().to_string();
    assert!(message.contains("full.toml:5: there is no recording `gone.csv`"), "{message}");
}

/// A recording of one car at constant speed in a table of its own, beside the scenario.
#[test]
fn a_recorded_vehicle_is_where_it_was_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let mut table = "site,vehicle_id,frame,s_m,d_m,vs_mps,vd_mps,length_m,width_m\n".to_owned();
    for frame in 0..100 {
        let s_m = 500.0 + 2.0 * f64::from(frame);
        writeln!(table, "here,7,{frame},{s_m:.2},3.75,20.0,0.0,4.5,1.8").unwrap();
    }
    std::fs::write(folder.path().join("tracks.csv"), table).unwrap();
    let text = "name = \"r\"\ndescription = \"d\"\nduration_s = 12.0\n\
        recording = { file = \"tracks.csv\", site = \"here\", s_offset_m = -400.0 }\n\
        road = { topology = \"open\" }\nego = { kind = \"at\", lane = 0, s_m = 0.0, speed_mps = 20.0 }\n";
    let path = folder.path().join("recorded.toml");
    std::fs::write(&path, text).unwrap();
    let (trace, _) = drive(&LoadedScenario::read(&path).unwrap(), Rule::KeepLane);
    for frame in trace.ticks.iter().flat_map(|tick| &tick.frames) {
        // The last sample is of 9.9 s.
        let expected = (frame.time_s < 9.91).then_some(100.0 + 20.0 * frame.time_s);
        let seen = frame.vehicles.first().map(|vehicle| frame.ego.s_m + vehicle.ahead_m);
        match (expected, seen) {
            (Some(expected_m), Some(seen_m)) => assert!((expected_m - seen_m).abs() < 1e-6, "{expected_m} {seen_m}"),
            (expected, seen) => assert_eq!(expected.is_some(), seen.is_some(), "at {} s", frame.time_s),
        }
    }
}
