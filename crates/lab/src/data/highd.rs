//! highD (Krajewski et al. 2018): drone recordings of German freeways, a recording in three tables.
//!
//! `NN_tracks.csv` is named; `NN_tracksMeta.csv` and `NN_recordingMeta.csv` are read beside it. Positions are the upper left corners of
//! boxes in an image, y downwards; they become the boxes' centers with y upwards. `width` is the extent along the road, `height` across.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::collect::{Collector, Held, Row, Source};
use super::error::DataError;
use super::events::RoadKind;
use super::recording::{Format, Oddity};
use super::table::{Table, TableError, TableErrorKind};

const TRACK_COLUMNS: [&str; 9] = ["frame", "id", "x", "y", "width", "height", "xVelocity", "yVelocity", "laneId"];
const META_COLUMNS: [&str; 4] = ["id", "initialFrame", "finalFrame", "numFrames"];
const RECORDING_COLUMNS: [&str; 2] = ["frameRate", "numVehicles"];

/// Allowed positions, m.
const POSITIONS_M: (f64, f64) = (-1e4, 1e4);
/// Allowed sizes, m.
const SIZES_M: (f64, f64) = (0.1, 50.0);
/// Allowed speeds in either direction, m/s.
const SPEEDS_MPS: (f64, f64) = (-120.0, 120.0);
/// Allowed frame rates, Hz.
const RATES_HZ: (f64, f64) = (1.0, 100.0);
/// How the names of the tables end.
const ENDS: [&str; 3] = ["_tracks.csv", "_tracksMeta.csv", "_recordingMeta.csv"];

/// The tracks that belong to a table that is read along with them.
pub(super) fn tracks_of(path: &Path) -> Option<PathBuf> {
    let name = path.file_name()?.to_str()?;
    let start = ENDS[1..].iter().find_map(|end| name.strip_suffix(end))?;
    Some(path.with_file_name(format!("{start}{}", ENDS[0])))
}

/// Hands the rows of the recording whose tracks are at `path` to `collector`, as the site `name`.
pub(super) fn read<S: Held>(path: &Path, name: &str, collector: &mut Collector<'_, S>) -> Result<Source, DataError> {
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    let start = file.strip_suffix(ENDS[0]).unwrap_or(&file);
    let beside = |end: &str| path.with_file_name(format!("{start}{end}"));
    let mut recording = Table::open(&beside(ENDS[2]), &RECORDING_COLUMNS)?;
    recording.next()?;
    let rate_hz = recording.number("frameRate", RATES_HZ)?;
    let announced_vehicles = recording.index("numVehicles")?;
    let mut announced = read_meta(&beside(ENDS[1]))?;
    if announced.len() as u64 != u64::from(announced_vehicles) {
        let (key, problem) =
            (announced_vehicles.to_string(), "is the announced number of vehicles, which the other table lacks");
        return Err(recording.error(TableErrorKind::BadKey { key, problem }).into());
    }
    let mut table = Table::open(path, &TRACK_COLUMNS)?;
    while table.next()? {
        let id = table.index("id")?;
        let bad_key = |problem| table.error(TableErrorKind::BadKey { key: id.to_string(), problem });
        let vehicle = announced.get_mut(&id).ok_or_else(|| bad_key("is no vehicle of the table beside this one"))?;
        let row = row(&table, id)?;
        if !(vehicle.first..=vehicle.last).contains(&row.frame) {
            return Err(bad_key("is here at a frame outside of those announced for it").into());
        }
        vehicle.missing -= 1;
        collector.push(name, rate_hz, &row)?;
    }
    let short = announced.values().filter(|vehicle| vehicle.missing > 0).count();
    collector.count(Oddity::ShorterThanAnnounced, short as u64);
    Ok(Source { format: Format::Highd, rate_hz, road: |_| RoadKind::Freeway })
}

/// What is announced of a vehicle.
struct Announced {
    first: i64,
    last: i64,
    missing: i64,
}

fn read_meta(path: &Path) -> Result<BTreeMap<u32, Announced>, TableError> {
    let mut table = Table::open(path, &META_COLUMNS)?;
    let mut announced = BTreeMap::new();
    while table.next()? {
        let id = table.index("id")?;
        let bad_key = |problem| table.error(TableErrorKind::BadKey { key: id.to_string(), problem });
        let (first, frames) = (table.index("initialFrame")?, table.index("numFrames")?);
        let last = table.number("finalFrame", (f64::from(first), f64::from(u32::MAX)))? as i64;
        let vehicle = Announced { first: i64::from(first), last, missing: i64::from(frames) };
        if announced.insert(id, vehicle).is_some() {
            return Err(bad_key("appears twice"));
        }
    }
    Ok(announced)
}

fn row(table: &Table, vehicle_id: u32) -> Result<Row, TableError> {
    let (length_m, width_m) = (table.number("width", SIZES_M)?, table.number("height", SIZES_M)?);
    let speed = |column| table.number(column, SPEEDS_MPS);
    Ok(Row {
        vehicle_id,
        length_m,
        width_m,
        frame: i64::from(table.index("frame")?),
        lane: table.index("laneId")?,
        x_m: table.number("x", POSITIONS_M)? + length_m / 2.0,
        y_m: -(table.number("y", POSITIONS_M)? + width_m / 2.0),
        speed_mps: libm::hypot(speed("xVelocity")?, speed("yVelocity")?),
    })
}
