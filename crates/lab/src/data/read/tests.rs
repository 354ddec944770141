//! Handwritten files with the quirks of each format and with every error; the real samples, where they lie.

use std::fs;
use std::path::{Path, PathBuf};

use super::super::inspect::inspect;
use super::super::recording::Oddity;
use super::*;

/// A folder with files of these names and contents.
fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

fn read_text(name: &str, text: &str) -> Result<Vec<Recording>, DataError> {
    let folder = folder(&[(name, text)]);
    read(&folder.path().join(name), &Selection::default())
}

fn swap(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "`{from}` is not there");
    text.replacen(from, to, 1)
}

/// The samples, if the environment names their folder.
fn samples() -> Option<PathBuf> {
    let data = std::env::var("LANECRAFT_DATA").ok();
    if data.is_none() {
        println!("skipped: LANECRAFT_DATA names no folder with recordings");
    }
    data.map(|data| Path::new(&data).join("ngsim-lane-changes/samples"))
}

const NGSIM: &str = "\u{feff}Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,v_length,v_Width,v_Vel,Lane_ID,Location\n\
                     7,12,\"1,156\",1118846980200,12.5,\"1,020\",20,6.5,50,2,us-101\n\
                     7,10,\"1,156\",1118846980000,12.5,\"1,010\",20,6.5,50,2,us-101\n\
                     9,10,2,1163368300000,30,100,16,6,40,1,peachtree\n\
                     7,10,\"1,156\",1118846980000,12.5,\"1,010\",20,6.5,50,2,us-101\n\
                     7,10,\"1,156\",1118846980000,12.5,\"1,011\",20,6.5,50,2,us-101\n\
                     7,10,\"1,156\",1118847980000,12.5,\"1,011\",20,6.5,50,2,us-101\n\
                     9,11,2,1163368300100,30,104,16,6,40,1,peachtree\n";

#[test]
fn ngsim_rows_of_any_order_become_tracks_in_meters() {
    let recordings = read_text("x.csv", NGSIM).unwrap();
    assert_eq!(recordings.iter().map(|r| r.site.as_str()).collect::<Vec<_>>(), ["peachtree", "us-101"]);
    assert_eq!(recordings.iter().map(|r| r.road).collect::<Vec<_>>(), [RoadKind::Arterial, RoadKind::Freeway]);
    let vehicle = &recordings[1].vehicles[0];
    assert_eq!(vehicle.samples.iter().map(|sample| sample.frame).collect::<Vec<_>>(), [0, 2]);
    let second = vehicle.samples[1];
    // 1020 ft, less half of 20 ft; 12.5 ft to the right.
    assert!((second.x_m - 1010.0 * 0.3048).abs() < 1e-9 && (second.y_m + 12.5 * 0.3048).abs() < 1e-9);
    assert!((second.speed_mps - 15.24).abs() < 1e-9 && second.lane == 2);
    assert_eq!((vehicle.length_m, vehicle.width_m), (6.096, 1.981));
    let odd = &recordings[1].oddities;
    assert_eq!((odd[&Oddity::RepeatedRows], odd[&Oddity::ConflictingRows]), (1, 1));
    assert_eq!((odd[&Oddity::TracksWithGaps], odd[&Oddity::MissingFrames]), (1, 1));
    // The id came back 1000 s later: another car.
    assert_eq!((odd[&Oddity::IdsUsedAgain], recordings[1].vehicles[1].vehicle_id), (1, 8));
    assert_eq!(recordings[0].oddities[&Oddity::ShorterThanAnnounced], 1);
}

#[test]
fn sites_are_chosen_and_samples_are_limited() {
    let folder = folder(&[("x.csv", NGSIM)]);
    let path = folder.path().join("x.csv");
    let chosen = read(&path, &Selection { sites: "peach".into(), max_samples: 2 }).unwrap();
    assert_eq!((chosen.len(), chosen[0].oddities[&Oddity::RowsOfOtherSites]), (1, 5));
    let message = read(&path, &Selection { max_samples: 3, ..Selection::default() }).unwrap_err().to_string();
    assert!(message.contains("more than 3 samples"), "{message}");
    let message = read(&path, &Selection { sites: "i-80".into(), ..Selection::default() }).unwrap_err().to_string();
    assert!(message.contains("no vehicles that were asked for"), "{message}");
}

#[test]
fn what_is_wrong_in_an_ngsim_table_is_named_with_line_and_column() {
    for (from, to, expected) in [
        ("\"1,156\",1118846980200", "\"11,56\",1118846980200", "x.csv, line 2: column `total_frames`: `11,56`"),
        ("1118846980200,12.5", "12.5,1118846980200", "line 2: column `global_time`: `12.5` is no number"),
        ("30,100,16", "30,,16", "line 4: column `local_y`: `` is no number"),
        ("30,100,16,6,40,1,peachtree", "30,100", "line 4: cannot be read"),
        ("30,100,16", "30,100,-16", "line 4: column `v_length`: `-16` is no number in 1..=150"),
        ("9,10,2", "9.5,10,2", "line 4: column `vehicle_id`: `9.5`"),
        ("v_Vel", "v_Speed", "line 1: has no column `v_vel`"),
    ] {
        let message = read_text("x.csv", &swap(NGSIM, from, to)).unwrap_err().to_string();
        assert!(message.contains(expected), "`{message}` does not say `{expected}`");
    }
    let years = read_text("x.csv", &swap(NGSIM, "1118847980000", "1118847980")).unwrap_err().to_string();
    assert!(years.contains("the times at site `us-101` lie years apart"), "{years}");
    let header = NGSIM.lines().next().unwrap();
    assert!(read_text("x.csv", header).unwrap_err().to_string().contains("holds no rows"));
}

#[test]
fn figures_are_those_of_the_tracks() {
    let folder = folder(&[("x.csv", NGSIM)]);
    let path = folder.path().join("x.csv");
    let (recordings, inspected) = (read(&path, &Selection::default()).unwrap(), inspect(&path, "").unwrap());
    assert_eq!(inspected.len(), recordings.len());
    for (recording, figures) in recordings.iter().zip(&inspected) {
        assert_eq!((&figures.site, figures.vehicles), (&recording.site, recording.vehicles.len()));
        let samples: usize = recording.vehicles.iter().map(|vehicle| vehicle.samples.len()).sum();
        assert_eq!((figures.samples, &figures.oddities), (samples as u64, &recording.oddities));
    }
    assert_eq!((inspected[1].duration_s, inspected[1].speed_mps), (1000.0, [15.24; 3]));
    // A repetition that comes after other rows of its vehicle is no longer told from a contradiction.
    fs::write(&path, format!("{NGSIM}7,12,\"1,156\",1118846980200,12.5,\"1,020\",20,6.5,50,2,us-101\n")).unwrap();
    assert_eq!(inspect(&path, "us").unwrap()[0].oddities[&Oddity::LateRows], 1);
}

#[test]
fn a_packed_table_that_is_cut_off_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.csv.gz");
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    std::io::Write::write_all(&mut packed, NGSIM.as_bytes()).unwrap();
    let packed = packed.finish().unwrap();
    fs::write(&path, &packed[..packed.len() - 9]).unwrap();
    for message in
        [read(&path, &Selection::default()).unwrap_err().to_string(), inspect(&path, "").unwrap_err().to_string()]
    {
        assert!(message.contains("x.csv.gz, line "), "{message}");
    }
}

const OLD: &str = "14 88 2 1118846988400 51.951 1074.452 0 0 24.0 8.5 2 43.69 11.10 5 0 33 0.00 0.00\n\
                   14\t89 2  1118846988500 51.957 1078.775 0 0 24.0 8.5 2 44.55 6.81 5 0 33 0.00 0.00 \n";

#[test]
fn old_ngsim_text_and_the_same_with_commas_agree() {
    let blanks = read_text("x.txt", OLD).unwrap();
    let lines = OLD.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(","));
    let commas = read_text("x.txt", &lines.collect::<Vec<_>>().join("\n")).unwrap();
    assert_eq!(blanks, commas);
    assert_eq!((blanks[0].vehicles[0].samples.len(), blanks[0].format), (2, Format::Ngsim18));
    let cut = &OLD[..OLD.len() - 12];
    let message = read_text("x.txt", cut).unwrap_err().to_string();
    assert!(message.contains("x.txt, line 2: cannot be read"), "{message}");
    let wrong = swap(OLD, "51.957 1078.775", "1078,775 51.957");
    assert!(read_text("x.txt", &wrong).unwrap_err().to_string().contains("line 2"));
}

const TRACKS: &str = "frame,id,x,y,width,height,xVelocity,yVelocity,laneId\n\
                      1,3,10.0,20.0,4.0,2.0,-25.0,0.0,2\n\
                      2,3,9.0,20.0,4.0,2.0,-25.0,0.0,2\n";
const META: &str = "id,initialFrame,finalFrame,numFrames\n3,1,2,2\n";
const RECORDING: &str = "id,frameRate,numVehicles\n1,25,1\n";

fn read_highd(tracks: &str, meta: &str, recording: &str) -> Result<Vec<Recording>, DataError> {
    let folder = folder(&[("01_tracks.csv", tracks), ("01_tracksMeta.csv", meta), ("01_recordingMeta.csv", recording)]);
    read(&folder.path().join("01_tracks.csv"), &Selection::default())
}

#[test]
fn highd_boxes_become_centers_with_y_upwards() {
    let recording = &read_highd(TRACKS, META, RECORDING).unwrap()[0];
    assert_eq!((recording.site.as_str(), recording.rate_hz), ("01", 25.0));
    let sample = recording.vehicles[0].samples[0];
    assert_eq!((sample.x_m, sample.y_m, sample.speed_mps, sample.lane), (12.0, -21.0, 25.0, 2));
    assert!(recording.oddities.is_empty());
    let short = &read_highd(TRACKS, &swap(META, "3,1,2,2", "3,1,9,9"), RECORDING).unwrap()[0];
    assert_eq!(short.oddities[&Oddity::ShorterThanAnnounced], 1);
}

#[test]
fn what_is_wrong_in_highd_tables_is_named_with_line_and_column() {
    let refused = |tracks: &str, meta: &str, recording: &str, expected: &str| {
        let message = read_highd(tracks, meta, recording).unwrap_err().to_string();
        assert!(message.contains(expected), "`{message}` does not say `{expected}`");
    };
    refused(
        TRACKS,
        &swap(META, "3,1,2,2", "3,5,2,2"),
        RECORDING,
        "01_tracksMeta.csv, line 2: column `finalFrame`: `2`",
    );
    refused(TRACKS, &format!("{META}3,1,2,2\n"), RECORDING, "line 3: `3`: appears twice");
    refused(&swap(TRACKS, "2,3,9", "2,4,9"), META, RECORDING, "01_tracks.csv, line 3: `4`: is no vehicle");
    refused(&swap(TRACKS, "2,3,9", "3,3,9"), META, RECORDING, "line 3: `3`: is here at a frame outside");
    refused(&swap(TRACKS, "-25.0", "NaN"), META, RECORDING, "line 2: column `xVelocity`: `NaN`");
    refused(TRACKS, META, &swap(RECORDING, "25", "0"), "01_recordingMeta.csv, line 2: column `frameRate`: `0`");
    refused(TRACKS, META, &swap(RECORDING, "25,1", "25,2"), "line 2: `2`: is the announced number of vehicles");
    let alone = folder(&[("01_tracks.csv", TRACKS)]);
    let message = read(&alone.path().join("01_tracks.csv"), &Selection::default()).unwrap_err().to_string();
    assert!(message.contains("01_recordingMeta.csv, line 0: cannot be opened"), "{message}");
    let message = read(Path::new("a/01_tracksMeta.csv"), &Selection::default()).unwrap_err().to_string();
    assert!(message.contains("is read along with a/01_tracks.csv"), "{message}");
}

const SCENE: &str = r#"<?xml version="1.0"?>
<commonRoad commonRoadVersion="2020a" timeStepSize="0.2">
  <scenarioTags><urban/></scenarioTags>
  <dynamicObstacle id="5">
    <type>car</type>
    <shape><rectangle><length>4.5</length><width>1.8</width></rectangle></shape>
    <initialState><position><point><x>1.0</x><y>2.0</y></point></position><time><exact>0</exact></time></initialState>
    <trajectory>
      <state><position><point><x>5.0</x><y>2.0</y></point></position><time><exact>1</exact></time><velocity><exact>20.0</exact></velocity></state>
      <state><position><circle><radius>1.0</radius></circle></position><time><exact>2</exact></time></state>
    </trajectory>
  </dynamicObstacle>
  <dynamicObstacle id="6"><type>pedestrian</type></dynamicObstacle>
  <dynamicObstacle id="8"><type>car</type><shape><circle><radius>1</radius></circle></shape></dynamicObstacle>
</commonRoad>
"#;

#[test]
fn commonroad_obstacles_become_tracks_and_others_are_counted() {
    let recording = &read_text("x.xml", SCENE).unwrap()[0];
    assert_eq!((recording.rate_hz, recording.road), (5.0, RoadKind::Arterial));
    let vehicle = &recording.vehicles[0];
    assert_eq!((recording.vehicles.len(), vehicle.vehicle_id, vehicle.length_m), (1, 5, 4.5));
    // The first state has no speed, so it is that to the next one.
    assert_eq!(vehicle.samples.iter().map(|sample| sample.speed_mps).collect::<Vec<_>>(), [20.0, 20.0]);
    for oddity in [Oddity::InexactStates, Oddity::NoMotorVehicles, Oddity::NoRectangles] {
        assert_eq!(recording.oddities[&oddity], 1, "{oddity:?}");
    }
}

#[test]
fn what_is_wrong_in_a_commonroad_file_is_named_with_line_and_column() {
    for (from, to, expected) in [
        ("<x>5.0</x>", "<x>five</x>", "x.xml, line 9, column 34: <x>: `five` is no number"),
        ("<commonRoad ", "<fcd-export ", "line 2, column 58: is <fcd-export>, not <commonRoad>"),
        ("2020a", "2018b", "line 2, column 58: is CommonRoad `2018b`"),
        (" timeStepSize=\"0.2\"", "", "<commonRoad> has no timeStepSize"),
        ("id=\"6\"", "id=\"5\"", "line 13, column 27: there are two dynamic obstacles `5`"),
        ("</trajectory>", "</trajectori>", "line 11, column 18: cannot be read"),
        ("<length>4.5", "<length>450", "<length>: `450` is no number in 0.1..=50"),
    ] {
        let message = read_text("x.xml", &swap(SCENE, from, to)).unwrap_err().to_string();
        assert!(message.contains(expected), "`{message}` does not say `{expected}`");
    }
    let cut = &SCENE[..SCENE.find("<velocity>").unwrap()];
    let message = read_text("x.xml", cut).unwrap_err().to_string();
    assert!(message.contains("the file ends inside of <state>"), "{message}");
}

#[test]
fn numbers_in_other_units_are_refused() {
    let mut meters = String::from("site,vehicle_id,frame,s_raw_m,d_raw_m,v_raw_mps,length_m,width_m\n");
    let mut kilometers_per_hour = meters.clone();
    for frame in 0..300 {
        let row = |speed: f64| format!("a,1,{frame},{:.1},0,{speed},4.5,1.8\n", 2.0 * f64::from(frame));
        meters += &row(20.0);
        kilometers_per_hour += &row(72.0);
    }
    read_text("t.csv", &meters).unwrap();
    let folder = folder(&[("t.csv", &kilometers_per_hour)]);
    let inspected = inspect(&folder.path().join("t.csv"), "").unwrap_err().to_string();
    assert!(inspected.contains("the speed by positions over the speed given is 0.28"), "{inspected}");
    let message = read_text("t.csv", &kilometers_per_hour).unwrap_err().to_string();
    assert!(message.contains("the speed by positions over the speed given is 0.28"), "{message}");
    // Mixed within one table: a third in the right unit, the rest in the wrong one.
    let mixed = |(number, (right, wrong))| if number <= 100 { right } else { wrong };
    let rows: Vec<&str> = meters.lines().zip(kilometers_per_hour.lines()).enumerate().map(mixed).collect();
    let message = read_text("t.csv", &rows.join("\n")).unwrap_err().to_string();
    assert!(
        message.contains("is 0.28, not in 0.8..=1.25: the units are not those of the format, or are mixed"),
        "{message}"
    );
    let message = read_text("t.csv", &meters.replace(",4.5,", ",15.5,")).unwrap_err().to_string();
    assert!(message.contains("the median length of a vehicle in meters is 15.5"), "{message}");
}

#[test]
fn a_file_of_no_known_format_is_named() {
    for text in ["", "a,b,c\n1,2,3\n", "1 2 3\n", "\u{0}\u{1}"] {
        let message = read_text("x.dat", text).unwrap_err().to_string();
        assert!(message.contains("begins no recording that is known"), "{message}");
    }
    let message = read(Path::new("no/such.csv"), &Selection::default()).unwrap_err().to_string();
    assert!(message.contains("no/such.csv, line 0: cannot be opened"), "{message}");
}

#[test]
fn the_real_and_synthetic_samples_are_read() {
    let Some(samples) = samples() else { return };
    let only = |name: &str| {
        let mut inspected = inspect(&samples.join(name), "").unwrap();
        println!("{}", inspected[0].text());
        assert_eq!(inspected.len(), 1);
        inspected.remove(0)
    };
    let peachtree = only("ngsim-25col-peachtree-3000rows.csv");
    assert_eq!((peachtree.samples, peachtree.format, peachtree.rate_hz), (3000, Format::Ngsim25, 10.0));
    let old = only("ngsim-18col-us101-reconstructed.txt");
    assert_eq!(old.format, Format::Ngsim18);
    let highd = only("synthetic-highd/01_tracks.csv");
    let scene = only("synthetic-other/ZAM_Synthetic-1_1_T-1.xml");
    // The same scene in two formats.
    assert_eq!((highd.vehicles, scene.vehicles, highd.samples), (6, 6, 6 * 251));
    assert_eq!((highd.duration_s, scene.duration_s), (10.0, 10.0));
    assert!(highd.speed_mps.iter().zip(scene.speed_mps).all(|(a, b)| (a - b).abs() < 0.2));
}
