//! The road from above, in characters: two columns for each 5 m, a row for each lane and each line between.

use std::fmt::Write as _;

use lanecraft_drive::road::LaneIndex;
use lanecraft_drive::scenario::VehicleKind;

use super::view::{Body, Paint, View};
use super::{EGO_COLOR, EGO_SHARE, RenderError, speed_color};

/// The narrowest text.
pub const COLUMNS_MIN: usize = 20;
/// The widest text.
pub const COLUMNS_MAX: usize = 400;
/// Length that a column shows, m.
const COLUMN_M: f64 = 2.5;

/// One place on the screen: a character, and its color if it is a vehicle's.
type Cell = (char, Option<[u8; 3]>);

/// Lines of text with ANSI colors: a row of `columns` characters for each lane (the leftmost first) and each line beside one, then a
/// line that tells time, speed, lane and note.
///
/// Cars are `=>`, trucks `###>`, the ego is orange on bright ground; speeds are colored as in [`super::rgb`]. No lane: `░`.
///
/// # Errors
/// If there are fewer than [`COLUMNS_MIN`] or more than [`COLUMNS_MAX`] columns.
pub fn ansi(view: &View, columns: usize) -> Result<String, RenderError> {
    if !(COLUMNS_MIN..=COLUMNS_MAX).contains(&columns) {
        return Err(RenderError::Columns { columns });
    }
    let mut text = String::new();
    for line in view.lines().rev() {
        let row: Vec<Cell> =
            (0..columns).map(|column| (line_character(view, line, s_m(view, columns, column)), None)).collect();
        write_row(&mut text, &row);
        if let Some(lane) = line.checked_sub(1) {
            write_row(&mut text, &lane_row(view, LaneIndex(lane), columns));
        }
    }
    let status: String = view.status().chars().take(columns).collect();
    let _ = writeln!(text, "{}", if view.collision.is_some() { format!("\x1b[1;31m{status}\x1b[0m") } else { status });
    Ok(text)
}

fn ego_column(columns: usize) -> f64 {
    (EGO_SHARE * columns as f64).floor()
}

/// The place that a column shows, m.
fn s_m(view: &View, columns: usize, column: usize) -> f64 {
    view.s_ahead_m((column as f64 - ego_column(columns)) * COLUMN_M)
}

fn line_character(view: &View, line: u8, s_m: f64) -> char {
    match view.paint(line, s_m) {
        Paint::Nothing => '░',
        Paint::Solid => '─',
        Paint::Dash => '-',
        Paint::Gap => ' ',
    }
}

/// The lane with everybody whose center is in it; the ego is drawn last.
fn lane_row(view: &View, lane: LaneIndex, columns: usize) -> Vec<Cell> {
    let exists = |column| view.road.lane_holds(lane, s_m(view, columns, column), 0.0);
    let mut row: Vec<Cell> = (0..columns).map(|column| (if exists(column) { ' ' } else { '░' }, None)).collect();
    for vehicle in view.vehicles.iter().filter(|vehicle| view.road.nearest_lane(vehicle.d_m) == lane) {
        let color = speed_color(vehicle.speed_mps, view.road.speed_limit_mps(vehicle.s_m));
        draw(&mut row, vehicle, view.ahead_m(vehicle.s_m), color);
    }
    if view.road.nearest_lane(view.ego.d_m) == lane {
        draw(&mut row, &view.ego, 0.0, EGO_COLOR);
    }
    row
}

fn draw(row: &mut [Cell], body: &Body, ahead_m: f64, color: [u8; 3]) {
    let length = (body.length_m / COLUMN_M).round().max(1.0);
    let front = ego_column(row.len()) + ((ahead_m + 0.5 * body.length_m) / COLUMN_M).round() - 1.0;
    let tail = if body.kind == VehicleKind::Truck { '#' } else { '=' };
    for (column, cell) in row.iter_mut().enumerate() {
        let behind_front = front - column as f64;
        if (0.0..length).contains(&behind_front) {
            *cell = (if behind_front == 0.0 { '>' } else { tail }, Some(color));
        }
    }
}

/// Neighbors of one color share their escape sequence; the ego's is bold and reversed.
fn write_row(text: &mut String, row: &[Cell]) {
    let mut current = None;
    for &(character, color) in row {
        if color != current {
            text.push_str("\x1b[0m");
            if let Some([red, green, blue]) = color {
                let style = if color == Some(EGO_COLOR) { "1;7;" } else { "" };
                let _ = write!(text, "\x1b[{style}38;2;{red};{green};{blue}m");
            }
            current = color;
        }
        text.push(character);
    }
    text.push_str(if current.is_some() { "\x1b[0m\n" } else { "\n" });
}
