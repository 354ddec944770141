//! Results as a table of text, as wide as a terminal.

use crate::metrics::{Interval, PolicyResult};

/// A column: its heading, decimals and figure.
type Column = (&'static str, usize, fn(&PolicyResult) -> Interval);

/// The columns that fit a terminal; files and the report have them all.
const COLUMNS: [Column; 6] = [
    ("speed m/s", 2, |r| r.speed_mps),
    ("collisions", 3, |r| r.collisions_per_episode),
    ("at fault", 3, |r| r.at_fault_collisions_per_episode),
    ("reward/tick", 2, |r| r.reward_per_tick),
    ("changes/min", 2, |r| r.lane_changes_per_min),
    ("min TTC s", 1, |r| r.min_time_to_collision_s),
];

/// The table with its heading and a line that says what the brackets are.
pub fn text_table(results: &[PolicyResult]) -> String {
    let mut rows = vec![std::iter::once("policy").chain(COLUMNS.map(|(name, ..)| name)).map(str::to_owned).collect()];
    rows.extend(results.iter().map(row));
    let width = |column: usize| rows.iter().map(|row: &Vec<String>| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..=COLUMNS.len()).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:<width$}"));
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    let mut lines: Vec<String> = rows.iter().map(line).collect();
    let episodes = results.first().map_or(0, |result| result.episodes);
    lines.push(format!("Mean and 95 % interval over {episodes} paired scenarios."));
    lines.join("\n")
}

fn row(result: &PolicyResult) -> Vec<String> {
    let cell = |(_, decimals, figure): &Column| {
        let Interval { mean, low, high } = figure(result);
        format!("{mean:.decimals$} [{low:.decimals$}, {high:.decimals$}]")
    };
    std::iter::once(result.policy.clone()).chain(COLUMNS.iter().map(cell)).collect()
}
