//! The whole extraction: made-up lane changes whose truth is known, and the published ones, where they lie.

use std::path::{Path, PathBuf};

use super::*;
use crate::data::events::read_events;
use crate::data::read::read;
use crate::data::recording::{Format, Sample, Selection, VehicleTrack};
use crate::data::traffic::{FRAME_S, read_traffic};

/// A driver who keeps to `lane_m` and moves by `shift_m` along a quintic (rest to rest) from `start_s` on within `duration_s`.
#[derive(Clone, Copy)]
struct Driver {
    lane_m: f64,
    shift_m: f64,
    start_s: f64,
    duration_s: f64,
    length_m: f64,
}

const STEADY: Driver = Driver { lane_m: 0.0, shift_m: 0.0, start_s: 8.0, duration_s: 5.0, length_m: 4.5 };

/// Everybody drives 25 m/s ahead for 20 s; the later in the list, the further behind.
fn recording(rate_hz: f64, drivers: &[Driver]) -> Recording {
    let track = |(id, driver): (usize, &Driver)| {
        let sample = |frame: i32| {
            let time_s = f64::from(frame) / rate_hz;
            let t = ((time_s - driver.start_s) / driver.duration_s).clamp(0.0, 1.0);
            let y_m = driver.lane_m + driver.shift_m * t * t * t * (10.0 + t * (6.0 * t - 15.0));
            Sample { frame, lane: 0, x_m: 25.0 * time_s - 15.0 * id as f64, y_m, speed_mps: 25.0 }
        };
        let samples = (0..(20.0 * rate_hz) as i32).map(sample).collect();
        VehicleTrack { vehicle_id: id as u32 + 1, length_m: driver.length_m, width_m: 1.8, samples }
    };
    let vehicles = drivers.iter().enumerate().map(track).collect();
    let (site, oddities) = ("made-up".to_owned(), BTreeMap::new());
    Recording { site, format: Format::Traffic, road: RoadKind::Freeway, rate_hz, vehicles, oddities }
}

/// Three lanes with two steady drivers each, and `others`.
fn three_lanes(rate_hz: f64, others: &[Driver]) -> Recording {
    let steady = [0.0, 3.5, 7.0, 0.0, 3.5, 7.0].map(|lane_m| Driver { lane_m, ..STEADY });
    recording(rate_hz, &[&steady, others].concat())
}

#[test]
fn a_quintic_lane_change_is_found_with_its_bounds_at_any_rate() {
    let change = Driver { shift_m: 3.5, ..STEADY };
    for rate_hz in [5.0, 10.0, 25.0] {
        let found = extract(&[three_lanes(rate_hz, &[change])]).unwrap();
        assert_eq!((found.changes.len(), found.sites[0].lane_centers_m.len()), (1, 3), "{:?}", found.skips);
        let change = &found.changes[0];
        assert_eq!((change.side, change.quality, change.lane_from, change.lane_to), (Side::Left, Quality::A, 3, 2));
        // Half way, 2.5 s after the begin; the line may lie a few centimeters off.
        assert!((change.crossing - 105).abs() <= 1, "{}", change.crossing);
        // The quintic's lateral speed 30 x 3.5 m / 5 s t²(1 - t)² exceeds 0.10 m/s for 0.075 < t < 0.925, that is for 4.25 s;
        // smoothing over 2.1 s moves each bound by at most 0.2 s.
        assert!((change.duration_s() - 4.25).abs() <= 0.4, "{}", change.duration_s());
        assert!((change.mean_speed_mps() - 25.0).abs() < 0.01 && (change.shift_m() - 3.5).abs() < 0.1);
    }
}

#[test]
fn what_is_dropped_is_counted() {
    let driver = Driver { shift_m: 3.5, ..STEADY };
    for (other, skip) in [
        (Driver { lane_m: 0.9, shift_m: 1.5, ..driver }, Skip::Wobble),
        (Driver { shift_m: 7.0, duration_s: 9.0, ..driver }, Skip::SecondCrossing),
        (Driver { start_s: -2.0, ..driver }, Skip::CutOff),
        (Driver { length_m: 2.0, ..driver }, Skip::ShortVehicle),
    ] {
        let found = extract(&[three_lanes(10.0, &[other])]).unwrap();
        assert!(found.changes.is_empty() && found.skips.contains_key(&skip), "{skip:?}: {:?}", found.skips);
    }
    let twice = [three_lanes(10.0, &[]), three_lanes(10.0, &[])];
    assert!(extract(&twice).unwrap_err().to_string().contains("two of the files hold a site `made-up`"));
}

#[test]
fn a_change_seen_late_or_in_part_is_of_lower_quality() {
    let quality = |start_s: f64| {
        let found = extract(&[three_lanes(10.0, &[Driver { shift_m: -3.5, lane_m: 7.0, start_s, ..STEADY }])]).unwrap();
        found.changes.iter().map(|change| (change.side, change.quality)).collect::<Vec<_>>()
    };
    assert_eq!(quality(8.0), [(Side::Right, Quality::A)]);
    assert_eq!(quality(0.3), [(Side::Right, Quality::B)]);
    // The track begins 1.2 s after the driver did, by then 0.4 m from the center.
    assert_eq!(quality(-1.2), [(Side::Right, Quality::C)]);
}

#[test]
fn what_is_written_is_what_the_readers_take() {
    let found = extract(&[three_lanes(25.0, &[Driver { shift_m: 3.5, ..STEADY }])]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let written = found.write(folder.path()).unwrap();
    assert!(written.iter().all(|path| path.exists()));
    let events = read_events(folder.path()).unwrap();
    let (event, change) = (&events[0], &found.changes[0]);
    assert_eq!((events.len(), event.neighbors.len(), event.ego.vehicle_id), (1, 6, change.ego_id));
    assert!((event.end_s - event.start_s - change.duration_s()).abs() < 1e-9);
    assert!((event.ego.points[0].time_s - (event.start_s - 3.0)).abs() < 1e-9);
    let sites = read_traffic(folder.path()).unwrap();
    assert_eq!((sites[0].tracks.len(), sites[0].tracks[0].points.len()), (7, 200));
    // Read again and extracted again, the same is found.
    let again = read(&folder.path().join("traffic.csv.gz"), &Selection::default()).unwrap();
    assert_eq!(extract(&again).unwrap().changes.len(), 1);
    let message = found.write(folder.path()).unwrap_err().to_string();
    assert!(message.contains("is there already"), "{message}");
}

/// The published set, if the environment names its folder.
fn published() -> Option<PathBuf> {
    let data = std::env::var("LANECRAFT_DATA").ok();
    if data.is_none() {
        println!("skipped: LANECRAFT_DATA names no folder with recorded lane changes");
    }
    data.map(|data| Path::new(&data).join("ngsim-lane-changes"))
}

/// How the published events compare with those found.
struct Comparison {
    published: usize,
    found: usize,
    same_quality: usize,
    /// Absolute differences of duration, begin and end, s, by size.
    differences_s: [Vec<f64>; 3],
}

impl Comparison {
    fn quantile_s(&self, which: usize, share: f64) -> f64 {
        let values = &self.differences_s[which];
        values[(share * (values.len() - 1) as f64).round() as usize]
    }
}

/// Events are the same if one vehicle crosses the line within half a second of the other's crossing.
fn compare(found: &Extraction, folder: &Path) -> Comparison {
    let mut first_frames = BTreeMap::new();
    for site in read_traffic(folder).unwrap() {
        first_frames.insert(site.name, site.tracks.iter().map(|track| track.points[0].frame).min().unwrap());
    }
    let qualities = std::fs::read_to_string(folder.join("events.csv")).unwrap();
    let qualities = qualities.lines().skip(1).map(|line| line.split(',').nth(2).unwrap());
    let events = read_events(folder).unwrap();
    let (mut same_quality, mut differences_s) = (0, [const { Vec::new() }; 3]);
    for (event, quality) in events.iter().zip(qualities) {
        // The name ends in the frame of the crossing, plus 1000.
        let crossing = event.id.rsplit_once("-t").unwrap().1.parse::<i32>().unwrap() - 1000 - first_frames[&event.site];
        let same = |change: &&LaneChange| {
            found.sites[change.site].name == event.site
                && change.ego_id == event.ego.vehicle_id
                && change.side == event.side
                && (change.crossing - crossing).abs() <= 5
        };
        let Some(change) = found.changes.iter().find(same) else {
            println!("not found: {}", event.id);
            continue;
        };
        same_quality += usize::from(format!("{:?}", change.quality) == quality);
        let time_s = |frame: i32| f64::from(frame - crossing) * FRAME_S;
        differences_s[0].push((change.duration_s() - (event.end_s - event.start_s)).abs());
        differences_s[1].push((time_s(change.start) - event.start_s).abs());
        differences_s[2].push((time_s(change.end) - event.end_s).abs());
    }
    for values in &mut differences_s {
        values.sort_by(f64::total_cmp);
    }
    Comparison { published: events.len(), found: differences_s[0].len(), same_quality, differences_s }
}

/// Lays the tracks along an arc of a radius of 1500 m that begins in the direction 2 rad, as a camera from above might see them.
fn bend(recordings: &mut [Recording]) {
    const RADIUS_M: f64 = 1500.0;
    let (turn_sin, turn_cos) = libm::sincos(2.0);
    let samples = recordings.iter_mut().flat_map(|recording| &mut recording.vehicles).flat_map(|v| &mut v.samples);
    for sample in samples {
        let (sin, cos) = libm::sincos(sample.x_m / RADIUS_M);
        let (x_m, y_m) = ((RADIUS_M - sample.y_m) * sin, RADIUS_M - (RADIUS_M - sample.y_m) * cos);
        (sample.x_m, sample.y_m) = (turn_cos * x_m - turn_sin * y_m, turn_sin * x_m + turn_cos * y_m);
    }
}

#[test]
fn the_published_lane_changes_are_found_again() {
    let Some(folder) = published() else { return };
    let mut recordings = read(&folder.join("traffic.csv.gz"), &Selection::default()).unwrap();
    // As published, the road is straight already; then it bends and its direction is unknown.
    for (road, least) in [("straight", 33), ("bent", 32)] {
        let extraction = extract(&recordings).unwrap();
        let compared = compare(&extraction, &folder);
        let (published, found) = (compared.published, compared.found);
        println!("{road}: {found} of {published} found, {} others", extraction.changes.len() - found);
        println!("{} of the same quality, {:?}", compared.same_quality, extraction.skips);
        for (which, what) in ["duration", "begin", "end"].iter().enumerate() {
            let [half, most, worst] = [0.5, 0.9, 1.0].map(|share| compared.quantile_s(which, share));
            println!("{what}: median {half:.2} s, 90 % {most:.2} s, worst {worst:.2} s");
            // A frame, and a third of a second for nine in ten.
            assert!(half < 0.11 && most < 0.31, "{what}");
        }
        assert!(published == 34 && found >= least && compared.same_quality >= 30);
        bend(&mut recordings);
    }
}
