//! Reads recordings of any known format, which the content tells, not the name.

use std::io::Read as _;
use std::path::Path;

use super::collect::{Collector, Held, Row, Source};
use super::error::DataError;
use super::events::RoadKind;
use super::recording::{Format, Recording, Selection, recordings};
use super::table::{Layout, Table, TableError, TableErrorKind, content};
use super::{commonroad, highd, ngsim};

/// How much of a file is looked at to tell its format, bytes.
const LOOKED_AT: u64 = 4096;
/// Reads the file at `path`, compressed if its name ends in `.gz`.
///
/// The file goes by once; only the samples of the selected sites are held.
///
/// # Errors
/// If the file is of no known format, cut off, a column is missing, a value is missing or out of range, the units are not those of the
/// format, nothing that was asked for is there, or there is more of it than the selection allows.
pub fn read(path: &Path, selection: &Selection) -> Result<Vec<Recording>, DataError> {
    let mut collector = Collector::new(path, selection);
    let source = scan(path, &mut collector)?;
    recordings(path, &source, collector)
}

/// Hands all rows of the file at `path` to `collector`.
pub(super) fn scan<S: Held>(path: &Path, collector: &mut Collector<'_, S>) -> Result<Source, DataError> {
    if let Some(tracks) = highd::tracks_of(path) {
        return Err(DataError::NotTheTracks { path: path.to_owned(), tracks });
    }
    let start = start(path)?;
    let name = site_name(path);
    match kind(&start) {
        Some(Kind::Ngsim(layout)) => ngsim::read(path, layout, &name, collector),
        Some(Kind::Highd) => highd::read(path, &name, collector),
        Some(Kind::Commonroad) => commonroad::read(path, &name, collector),
        Some(Kind::Traffic) => read_traffic_table(path, collector),
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
fn read_traffic_table<S: Held>(path: &Path, collector: &mut Collector<'_, S>) -> Result<Source, DataError> {
    let mut table = Table::open(path, &TRAFFIC_COLUMNS)?;
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
        collector.push(table.text("site")?, TRAFFIC_RATE_HZ, &row)?;
    }
    let road = |site: &str| if site.starts_with("lanker") { RoadKind::Arterial } else { RoadKind::Freeway };
    Ok(Source { format: Format::Traffic, rate_hz: TRAFFIC_RATE_HZ, road })
}

/// The middle one of `values`; 0 if there are none.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests;
