//! Results as a table for people.

use lanecraft_lab::evaluate::{PolicyEpisodes, compare};
use lanecraft_lab::metrics::{Interval, PolicyResult};

use crate::output::answer;

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

/// Prints the table and how the first policy compares with the others.
pub(crate) fn print_results(episodes: &[PolicyEpisodes]) -> anyhow::Result<()> {
    let results = episodes.iter().map(PolicyEpisodes::result).collect::<Result<Vec<_>, _>>()?;
    answer(&table(&results))?;
    compare(episodes)?.iter().try_for_each(|comparison| Ok(answer(&comparison.to_string())?))
}

/// The table with its heading and a line that says what the brackets are.
fn table(results: &[PolicyResult]) -> String {
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
