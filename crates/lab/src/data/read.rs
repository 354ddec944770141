//! Reads recordings of any known format, which the content tells, not the name.

use std::io::Read as _;
use std::path::Path;

use super::error::DataError;
use super::events::RoadKind;
use super::recording::{Collector, Format, Recording, Row, Selection, VehicleTrack};
use super::table::{Layout, Table, TableError, TableErrorKind, content};
use super::{commonroad, highd, ngsim};

/// How much of a file is looked at to tell its format, bytes.
const LOOKED_AT: u64 = 4096;
/// Medians of vehicles' lengths that are believed, m.
const MEDIAN_LENGTHS_M: (f64, f64) = (2.5, 15.0);
/// Medians that are believed of the distance driven in a second over that which the speeds say.
const SPEED_RATIOS: (f64, f64) = (0.8, 1.25);
/// Distances that are enough to judge by.
const ENOUGH_RATIOS: usize = 20;
/// Speed from which the ratio is taken, m/s: the noise of slower positions is no speed.
const FAST_MPS: f64 = 3.0;

/// Reads the file at `path`, compressed if its name ends in `.gz`.
///
/// The file goes by once; only the samples of the selected sites are held.
///
/// # Errors
/// If the file is of no known format, cut off, a column is missing, a value is missing or out of range, the units are not those of the
/// format, nothing that was asked for is there, or there is more of it than the selection allows.
pub fn read(path: &Path, selection: &Selection) -> Result<Vec<Recording>, DataError> {
    if let Some(tracks) = highd::tracks_of(path) {
        return Err(DataError::NotTheTracks { path: path.to_owned(), tracks });
    }
    let start = start(path)?;
    let name = site_name(path);
    match kind(&start) {
        Some(Kind::Ngsim(layout)) => ngsim::read(path, layout, &name, selection),
        Some(Kind::Highd) => highd::read(path, &name, selection),
        Some(Kind::Commonroad) => commonroad::read(path, &name, selection),
        Some(Kind::Traffic) => read_traffic_table(path, selection),
        None => {
            let first_line = start.lines().next().unwrap_or_default().chars().take(60).collect();
            Err(DataError::UnknownFormat { path: path.to_owned(), first_line })
        }
    }
}

/// What a file is read as.
enum Kind {
    Ngsim(Layout),
    Highd,
    Commonroad,
    Traffic,
}

/// The beginning of the file, as text.
fn start(path: &Path) -> Result<String, TableError> {
    let failed = |error| TableError { path: path.to_owned(), line: 0, kind: TableErrorKind::Open(error) };
    let mut bytes = Vec::new();
    content(path).map_err(failed)?.take(LOOKED_AT).read_to_end(&mut bytes).map_err(failed)?;
    Ok(String::from_utf8_lossy(&bytes).trim_start_matches('\u{feff}').to_owned())
}

fn kind(start: &str) -> Option<Kind> {
    if start.trim_start().starts_with('<') {
        return Some(Kind::Commonroad);
    }
    let first = start.lines().next()?.trim();
    let names: Vec<String> = first.split(',').map(|name| name.trim().to_ascii_lowercase()).collect();
    let has = |wanted: &[&str]| wanted.iter().all(|&name| names.iter().any(|other| other == name));
    let numbers = |fields: &[&str]| fields.len() == 18 && fields.iter().all(|field| field.parse::<f64>().is_ok());
    if has(&["vehicle_id", "global_time"]) || has(&["vehicle_id", "local_x"]) {
        Some(Kind::Ngsim(Layout::NamedInAnyCase))
    } else if has(&["frame", "id", "xvelocity"]) {
        Some(Kind::Highd)
    } else if has(&["site", "vehicle_id", "frame"]) {
        Some(Kind::Traffic)
    } else if numbers(&first.split_whitespace().collect::<Vec<_>>()) {
        Some(Kind::Ngsim(Layout::Blanks(&ngsim::COLUMNS_18)))
    } else if numbers(&first.split(',').map(str::trim).collect::<Vec<_>>()) {
        Some(Kind::Ngsim(Layout::Commas(&ngsim::COLUMNS_18)))
    } else {
        None
    }
}

/// The file's name up to its first dot, without what highD puts at its end.
fn site_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = name.split('.').next().unwrap_or_default();
    name.strip_suffix("_tracks").unwrap_or(name).to_owned()
}

/// Frames per second of our own table.
const TRAFFIC_RATE_HZ: f64 = 10.0;
const TRAFFIC_COLUMNS: [&str; 5] = ["site", "vehicle_id", "frame", "length_m", "width_m"];
/// Position along the road, to the left, and speed, in order of preference.
const TRAFFIC_POSITIONS: [[&str; 3]; 2] = [["s_raw_m", "d_raw_m", "v_raw_mps"], ["s_m", "d_m", "vs_mps"]];

/// Our own table of whole sites: raw positions, or smoothed ones if it has no others.
fn read_traffic_table(path: &Path, selection: &Selection) -> Result<Vec<Recording>, DataError> {
    let mut table = Table::open(path, &TRAFFIC_COLUMNS)?;
    let mut collector = Collector::new(path, selection);
    let [s, d, v] = TRAFFIC_POSITIONS[usize::from(!table.has(TRAFFIC_POSITIONS[0][0]))];
    while table.next()? {
        let row = Row {
            vehicle_id: table.index("vehicle_id")?,
            length_m: table.number("length_m", (0.1, 50.0))?,
            width_m: table.number("width_m", (0.1, 50.0))?,
            frame: i64::from(table.integer("frame")?),
            lane: if table.has("lane") { table.index("lane")? } else { 0 },
            x_m: table.number(s, (-1e6, 1e6))?,
            y_m: table.number(d, (-1e3, 1e3))?,
            speed_mps: table.number(v, (-120.0, 120.0))?.abs(),
        };
        collector.push(table.text("site")?, &row)?;
    }
    collector.finish(Format::Traffic, TRAFFIC_RATE_HZ, |site| {
        if site.starts_with("lanker") { RoadKind::Arterial } else { RoadKind::Freeway }
    })
}

/// Refuses sizes and speeds that cannot be in the units of the format.
pub(super) fn check_units(path: &Path, recordings: &[Recording]) -> Result<(), DataError> {
    let vehicles = || recordings.iter().flat_map(|recording| &recording.vehicles);
    let refuse = |what, measured, (min, max)| DataError::Units { path: path.to_owned(), what, measured, min, max };
    let length_m = median(vehicles().map(|vehicle| vehicle.length_m).collect());
    if !(MEDIAN_LENGTHS_M.0..=MEDIAN_LENGTHS_M.1).contains(&length_m) {
        return Err(refuse("the median length of a vehicle in meters", length_m, MEDIAN_LENGTHS_M));
    }
    let of = |recording: &Recording| {
        let ratios = recording.vehicles.iter().flat_map(|vehicle| speed_ratios(vehicle, recording.rate_hz));
        ratios.collect::<Vec<_>>()
    };
    let ratios: Vec<f64> = recordings.iter().flat_map(of).collect();
    if ratios.len() < ENOUGH_RATIOS {
        return Ok(());
    }
    let ratio = median(ratios);
    if !(SPEED_RATIOS.0..=SPEED_RATIOS.1).contains(&ratio) {
        return Err(refuse("the speed by positions over the speed given", ratio, SPEED_RATIOS));
    }
    Ok(())
}

/// For each second without gaps: the way by positions over the way by speeds.
fn speed_ratios(vehicle: &VehicleTrack, rate_hz: f64) -> impl Iterator<Item = f64> {
    let second = (rate_hz.round() as usize).max(1);
    vehicle.samples.chunks_exact(second + 1).filter_map(move |part| {
        let (first, last) = (part[0], part[second]);
        let by_speed_m = part[..second].iter().map(|sample| sample.speed_mps).sum::<f64>() / rate_hz;
        let whole = last.frame - first.frame == second as i32;
        let by_position_m = libm::hypot(last.x_m - first.x_m, last.y_m - first.y_m);
        // Either may be in the wrong unit, so the faster one decides whether the vehicle moves.
        let moves = by_speed_m.max(by_position_m) > FAST_MPS * second as f64 / rate_hz;
        (whole && moves).then(|| by_position_m / by_speed_m.max(1e-3))
    })
}

/// The middle one of `values`; 0 if there are none.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests;
