//! NGSIM vehicle trajectories (US Department of Transportation, Federal Highway Administration): the table of 25 named columns, and the
//! older 18 columns as blank-separated text or as commas, with or without names.
//!
//! Feet become meters. `Local_Y` runs ahead, `Local_X` to the right from the left edge of the road; both mean the middle of the front of a
//! vehicle, from which we go back by half its length. Frames are counted by `Global_Time`, because frame numbers and ids begin anew in
//! each recording period of the joint table. Rows may come in any order, and thousands may be set apart by commas.

use std::collections::BTreeMap;
use std::path::Path;

use super::collect::{Collector, Held, Row, Source};
use super::error::DataError;
use super::events::RoadKind;
use super::recording::{Format, Oddity};
use super::table::{Column, Layout, Table, TableError};

/// A foot, m.
const FOOT_M: f64 = 0.3048;
/// Frames per second.
const RATE_HZ: f64 = 10.0;

/// The older layout.
pub(super) const COLUMNS_18: [&str; 18] = [
    "vehicle_id",
    "frame_id",
    "total_frames",
    "global_time",
    "local_x",
    "local_y",
    "global_x",
    "global_y",
    "v_length",
    "v_width",
    "v_class",
    "v_vel",
    "v_acc",
    "lane_id",
    "preceding",
    "following",
    "space_headway",
    "time_headway",
];
/// What is read of either layout.
const READ: [&str; 9] =
    ["vehicle_id", "total_frames", "global_time", "local_x", "local_y", "v_length", "v_width", "v_vel", "lane_id"];

/// Allowed times, ms, so that a column in the wrong place is noticed: since 1970 up to the year 2100, but Peachtree Street's lack digits.
const TIMES_MS: (f64, f64) = (1e8, 4.1e12);
/// Allowed places across the road, ft.
const ACROSS_FT: (f64, f64) = (-3e3, 3e3);
/// Allowed places along the road, ft.
const ALONG_FT: (f64, f64) = (-2e4, 2e4);
/// Allowed lengths and widths, ft.
const SIZES_FT: (f64, f64) = (1.0, 150.0);
/// Allowed speeds, ft/s.
const SPEEDS_FTPS: (f64, f64) = (0.0, 250.0);

/// Hands the rows of the file at `path` to `collector`; rows without a location belong to the site `name`.
pub(super) fn read<S: Held>(
    path: &Path,
    layout: Layout,
    name: &str,
    collector: &mut Collector<'_, S>,
) -> Result<Source, DataError> {
    let mut table = Table::open_as(path, layout, &READ)?;
    let columns = Columns::of(&table)?;
    // Rows seen, by id and announced number.
    let mut announced: BTreeMap<(u32, u32), u64> = BTreeMap::new();
    while table.next()? {
        let row = columns.row(&table)?;
        *announced.entry((row.vehicle_id, table.grouped_index(columns.total)?)).or_default() += 1;
        let location = columns.location.map_or("", |column| table.field(column).trim());
        collector.push(if location.is_empty() { name } else { location }, RATE_HZ, &row)?;
    }
    let short = announced.iter().filter(|((_, total), seen)| u64::from(*total) > **seen).count();
    collector.count(Oddity::ShorterThanAnnounced, short as u64);
    let format = if columns.location.is_some() { Format::Ngsim25 } else { Format::Ngsim18 };
    Ok(Source { format, rate_hz: RATE_HZ, road })
}

fn road(site: &str) -> RoadKind {
    match site.to_ascii_lowercase().as_str() {
        "lankershim" | "peachtree" => RoadKind::Arterial,
        _ => RoadKind::Freeway,
    }
}

/// Where the columns that are read stand.
struct Columns {
    id: Column,
    total: Column,
    time: Column,
    across: Column,
    along: Column,
    length: Column,
    width: Column,
    speed: Column,
    lane: Column,
    location: Option<Column>,
}

impl Columns {
    fn of(table: &Table) -> Result<Self, TableError> {
        Ok(Self {
            id: table.column("vehicle_id")?,
            total: table.column("total_frames")?,
            time: table.column("global_time")?,
            across: table.column("local_x")?,
            along: table.column("local_y")?,
            length: table.column("v_length")?,
            width: table.column("v_width")?,
            speed: table.column("v_vel")?,
            lane: table.column("lane_id")?,
            location: if table.has("location") { Some(table.column("location")?) } else { None },
        })
    }

    fn row(&self, table: &Table) -> Result<Row, TableError> {
        let feet = |column, range| table.grouped(column, range).map(|value| value * FOOT_M);
        let length_m = feet(self.length, SIZES_FT)?;
        Ok(Row {
            vehicle_id: table.grouped_index(self.id)?,
            length_m,
            width_m: feet(self.width, SIZES_FT)?,
            frame: (table.grouped(self.time, TIMES_MS)? * RATE_HZ / 1e3).round() as i64,
            lane: table.grouped_index(self.lane)?,
            x_m: feet(self.along, ALONG_FT)? - length_m / 2.0,
            y_m: -feet(self.across, ACROSS_FT)?,
            speed_mps: feet(self.speed, SPEEDS_FTPS)?,
        })
    }
}
