//! Recorded traffic from a table of tracks.
//!
//! The table has the columns `vehicle_id`, `s_m`, `d_m`, `vs_mps`, `vd_mps`, `length_m`, `width_m`, and either `site` with `frame`
//! (tenths of a second) or `event_id` with `t_s`. Rows of a vehicle follow each other by time.

use std::path::{Path, PathBuf};

use lanecraft_drive::scenario::{RecordedTraffic, Recording, Track, TrackSample};

use super::ScenarioFileError;
use super::error::line_of;
use crate::data::{Table, TableError, TableErrorKind};

/// Time between two frames, s.
const PERIOD_S: f64 = 0.1;
/// Bounds of positions, m; of speeds, m/s; of lengths and widths, m; of times, s.
const POSITION_M: (f64, f64) = (-1e6, 1e6);
const SPEED_MPS: (f64, f64) = (-20.0, 80.0);
const SIZE_M: (f64, f64) = (0.3, 40.0);
const TIME_S: (f64, f64) = (-1e5, 1e5);

/// Reads the recording that `config`, in the scenario file at `scenario`, names.
pub(super) fn read(scenario: &Path, config: &RecordedTraffic) -> Result<Recording, ScenarioFileError> {
    let table = find(scenario, &config.file).ok_or_else(|| {
        let text = std::fs::read_to_string(scenario).unwrap_or_default();
        ScenarioFileError::NoRecording {
            origin: line_of(scenario, &text, "recording.file"),
            file: config.file.clone(),
            data_is_set: std::env::var_os("LANECRAFT_DATA").is_some(),
        }
    })?;
    Ok(Reader::open(&table, config)?.read()?)
}

fn find(scenario: &Path, file: &str) -> Option<PathBuf> {
    let beside = scenario.parent().unwrap_or(Path::new("")).join(file);
    let data = std::env::var_os("LANECRAFT_DATA").map(|folder| PathBuf::from(folder).join(file));
    [Some(beside), data].into_iter().flatten().find(|path| path.is_file())
}

/// Which columns say where and when.
struct Keys {
    site: &'static str,
    time: &'static str,
    seconds: f64,
}

struct Reader<'a> {
    table: Table,
    keys: Keys,
    config: &'a RecordedTraffic,
    tracks: Vec<Track>,
    /// Vehicle and time of the last row that was taken.
    last: Option<(u32, f64)>,
}

impl<'a> Reader<'a> {
    fn open(path: &Path, config: &'a RecordedTraffic) -> Result<Self, TableError> {
        const COMMON: [&str; 7] = ["vehicle_id", "s_m", "d_m", "vs_mps", "vd_mps", "length_m", "width_m"];
        let traffic = Keys { site: "site", time: "frame", seconds: PERIOD_S };
        let events = Keys { site: "event_id", time: "t_s", seconds: 1.0 };
        let open = |keys: &Keys| {
            let columns: Vec<&'static str> = COMMON.into_iter().chain([keys.site, keys.time]).collect();
            Table::open(path, &columns)
        };
        let (table, keys) = match open(&events) {
            Ok(table) => (table, events),
            Err(_) => (open(&traffic)?, traffic),
        };
        Ok(Self { table, keys, config, tracks: Vec::new(), last: None })
    }

    fn read(mut self) -> Result<Recording, TableError> {
        while self.table.next()? {
            if self.table.text(self.keys.site)? == self.config.site {
                self.row()?;
            }
        }
        if self.tracks.is_empty() {
            let problem = "no row of the table has this name";
            return Err(self.table.error_of_file(TableErrorKind::BadKey { key: self.config.site.clone(), problem }));
        }
        // Whoever is gone before the scene starts is not in it.
        self.tracks.retain(|track| track.first_s + track.samples.len() as f64 * PERIOD_S > 0.0);
        Ok(Recording { period_s: PERIOD_S, tracks: self.tracks })
    }

    /// A row goes on with the last track if it is of the same vehicle and a frame later, else it begins one.
    fn row(&mut self) -> Result<(), TableError> {
        let (table, config) = (&self.table, self.config);
        let vehicle = table.index("vehicle_id")?;
        let time_s = table.number(self.keys.time, TIME_S)? * self.keys.seconds - config.start_s;
        let sample = TrackSample {
            s_m: table.number("s_m", POSITION_M)? + config.s_offset_m,
            d_m: table.number("d_m", POSITION_M)? + config.d_offset_m,
            speed_mps: table.number("vs_mps", SPEED_MPS)?.max(0.0),
            lateral_speed_mps: table.number("vd_mps", SPEED_MPS)?,
        };
        let goes_on = self.last.is_some_and(|(last, last_s)| last == vehicle && near(time_s - last_s, PERIOD_S));
        match self.tracks.last_mut().filter(|_| goes_on) {
            Some(track) => track.samples.push(sample),
            None => self.tracks.push(Track {
                length_m: table.number("length_m", SIZE_M)?,
                width_m: table.number("width_m", SIZE_M)?,
                first_s: time_s,
                samples: vec![sample],
            }),
        }
        self.last = Some((vehicle, time_s));
        Ok(())
    }
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-3
}
