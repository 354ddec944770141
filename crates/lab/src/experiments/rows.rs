//! What a unit leaves: one row.

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::evaluate::PolicyEpisodes;
use crate::run_dir::{COMMIT, RunDirError, atomic};
use crate::stats::{StatsError, mean_interval};

/// The rows of an experiment, in its folder.
pub const ROWS: &str = "rows.csv";

/// A unit's outcome: one variant, trained with one seed and driven through all test scenarios.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitRow {
    /// The variant.
    pub variant: String,
    /// The training seed.
    pub seed: u64,
    /// First 16 hexadecimal digits of the SHA-256 of all that the experiment lays over its preset: a row counts for nothing else.
    pub settings: String,
    /// Commit of the program.
    pub commit: String,
    /// Decisions of the training; 0 for a rule.
    pub decisions: u64,
    /// Test scenarios.
    pub episodes: usize,
    /// Mean speed, m/s.
    pub speed_mps: f64,
    /// Mean reward of a tick, and its 95 % interval over scenarios.
    pub reward_per_tick: f64,
    /// Its lower end.
    pub reward_low: f64,
    /// Its upper end.
    pub reward_high: f64,
    /// Episodes that ended in a collision.
    pub collisions: usize,
    /// Of these, by the ego's own fault.
    pub at_fault: usize,
    /// Distance driven in all, km.
    pub driven_km: f64,
    /// Lane changes a minute.
    pub lane_changes_per_min: f64,
    /// Lane changes asked for and refused, a minute.
    pub refusals_per_min: f64,
    /// Mean absolute jerk, m/s³.
    pub jerk_mps3: f64,
    /// Mean over episodes of the smallest time to collision, s.
    pub min_time_to_collision_s: f64,
}

impl UnitRow {
    /// The row of a unit that was tested.
    pub(super) fn new(
        (variant, seed): (&str, u64),
        settings: String,
        decisions: u64,
        tested: &PolicyEpisodes,
    ) -> Result<Self, StatsError> {
        let episodes = &tested.episodes;
        let result = tested.result()?;
        let reward = mean_interval(&episodes.iter().map(|episode| episode.reward_per_tick).collect::<Vec<_>>())?;
        Ok(Self {
            variant: variant.to_owned(),
            seed,
            settings,
            commit: COMMIT.to_owned(),
            decisions,
            episodes: episodes.len(),
            speed_mps: result.speed_mps.mean,
            reward_per_tick: reward.mean,
            reward_low: reward.low,
            reward_high: reward.high,
            collisions: episodes.iter().filter(|episode| !episode.collision.is_empty()).count(),
            at_fault: episodes.iter().filter(|episode| episode.at_fault).count(),
            driven_km: episodes.iter().map(|episode| episode.speed_mps * episode.duration_s / 1000.0).sum(),
            lane_changes_per_min: result.lane_changes_per_min.mean,
            refusals_per_min: result.refusals_per_min.mean,
            jerk_mps3: result.jerk_mps3.mean,
            min_time_to_collision_s: result.min_time_to_collision_s.mean,
        })
    }
}

/// The rows in a file; none if there is no file.
///
/// # Errors
/// If the file cannot be read, or a line is no row.
pub fn read_rows(path: &Path) -> Result<Vec<UnitRow>, RunDirError> {
    let text = match fs::read(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        text => text.map_err(RunDirError::io("read", path))?,
    };
    let rows: Result<Vec<UnitRow>, _> = csv::Reader::from_reader(&text[..]).deserialize().collect();
    rows.map_err(|error| RunDirError::Broken { path: path.to_owned(), message: error.to_string() })
}

/// Writes the rows, sorted by variant and seed, in place of those in the file.
///
/// # Errors
/// If the file cannot be written; it is then as before.
pub(super) fn write_rows(path: &Path, rows: &mut [UnitRow]) -> Result<(), RunDirError> {
    rows.sort_by(|a, b| (&a.variant, a.seed).cmp(&(&b.variant, b.seed)));
    let mut writer = csv::Writer::from_writer(Vec::new());
    let broken = |message: String| RunDirError::Broken { path: path.to_owned(), message };
    for row in rows {
        writer.serialize(row).map_err(|error| broken(error.to_string()))?;
    }
    let bytes = writer.into_inner().map_err(|error| broken(error.to_string()))?;
    atomic::write(path, &bytes)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) fn row(variant: &str, seed: u64, reward_per_tick: f64, collisions: usize) -> UnitRow {
        UnitRow {
            variant: variant.to_owned(),
            seed,
            settings: "0".to_owned(),
            commit: "0".to_owned(),
            decisions: 1,
            episodes: 100,
            speed_mps: 20.0 + reward_per_tick,
            reward_per_tick,
            reward_low: reward_per_tick - 0.1,
            reward_high: reward_per_tick + 0.1,
            collisions,
            at_fault: collisions / 2,
            driven_km: 130.0,
            lane_changes_per_min: 2.0,
            refusals_per_min: 0.0,
            jerk_mps3: 0.5,
            min_time_to_collision_s: 5.0,
        }
    }

    #[test]
    fn rows_are_read_as_written_in_their_order_and_nonsense_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(ROWS);
        assert_eq!(read_rows(&path).unwrap(), []);
        write_rows(&path, &mut [row("b", 0, 1.0, 3), row("a", 1, 2.0, 0), row("a", 0, 1.5, 0)]).unwrap();
        assert_eq!(read_rows(&path).unwrap(), [row("a", 0, 1.5, 0), row("a", 1, 2.0, 0), row("b", 0, 1.0, 3)]);
        fs::write(&path, "variant,seed\na,0\n").unwrap();
        assert!(read_rows(&path).unwrap_err().to_string().contains(ROWS));
    }
}
