//! Tracks of vehicles as recorded, whatever format they came in: positions of the centers of vehicles in a plane, in SI units.
//!
//! The plane is right-handed (y to the left of x), its origin and direction are the source's. A reader hands in one row after the other,
//! in any order; only the rows that are kept lie in memory, 32 bytes each, and there is a limit to them. Figures alone need no rows:
//! [`super::inspect`] holds none.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::Serialize;

use super::collect::{ByVehicle, Collector, Held, Key, Source};
use super::error::DataError;
use super::events::RoadKind;
use super::units;

/// Format of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// NGSIM, table of the US Department of Transportation with 25 named columns.
    Ngsim25,
    /// NGSIM, 18 columns, named or not, separated by commas or blanks.
    Ngsim18,
    /// highD, three tables.
    Highd,
    /// CommonRoad 2020a.
    Commonroad,
    /// The table `traffic.csv.gz` of this program.
    Traffic,
}

/// One instant of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Count of frames since the first one of the site.
    pub frame: i32,
    /// Lane as the source numbers it, 0 if it does not.
    pub lane: u32,
    /// Position of the center in the plane, m.
    pub x_m: f64,
    /// Position of the center in the plane, m.
    pub y_m: f64,
    /// Speed, m/s.
    pub speed_mps: f64,
}

/// The track of one vehicle; frames may be missing.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleTrack {
    /// Which vehicle, within its site. That of the source, unless the source used it for another vehicle before.
    pub vehicle_id: u32,
    /// Length, m.
    pub length_m: f64,
    /// Width, m.
    pub width_m: f64,
    /// At least one sample, by rising frame.
    pub samples: Vec<Sample>,
}

/// What was recorded at one site.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Name of the site.
    pub site: String,
    /// Where it came from.
    pub format: Format,
    /// Kind of road.
    pub road: RoadKind,
    /// Frames per second.
    pub rate_hz: f64,
    /// At least one vehicle, by rising id.
    pub vehicles: Vec<VehicleTrack>,
    /// What was odd, and how often; oddities of the file as a whole are counted at its first site.
    pub oddities: BTreeMap<Oddity, u64>,
}

/// Something odd in a file that does not keep it from being read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Oddity {
    /// A row for a vehicle and frame that were there, with the same values.
    RepeatedRows,
    /// The same with other values; the first row stands.
    ConflictingRows,
    /// Either of them, but so far behind the first one that it was not held any more to be compared.
    LateRows,
    /// An id that a vehicle of another size, or one that had long gone, had before.
    IdsUsedAgain,
    /// Tracks with frames missing.
    TracksWithGaps,
    /// Frames missing in them.
    MissingFrames,
    /// Vehicles with fewer rows than the source announces.
    ShorterThanAnnounced,
    /// Rows of sites that were not asked for.
    RowsOfOtherSites,
    /// Obstacles that are no motor vehicles.
    NoMotorVehicles,
    /// Obstacles without a rectangular shape.
    NoRectangles,
    /// Obstacles without a trajectory.
    NoTrajectories,
    /// States whose position or time is not exact.
    InexactStates,
}

impl Oddity {
    /// What it is, for people.
    pub fn text(self) -> &'static str {
        match self {
            Self::RepeatedRows => "rows that repeat another one, dropped",
            Self::ConflictingRows => "rows that contradict an earlier one, dropped",
            Self::LateRows => "rows that repeat or contradict one far ahead of them, dropped",
            Self::IdsUsedAgain => "ids used again for another vehicle, which got a new one",
            Self::TracksWithGaps => "tracks with gaps",
            Self::MissingFrames => "frames missing in these",
            Self::ShorterThanAnnounced => "vehicles with fewer rows than the file announces",
            Self::RowsOfOtherSites => "rows of sites that were not asked for",
            Self::NoMotorVehicles => "obstacles that are no motor vehicles, dropped",
            Self::NoRectangles => "obstacles that are no rectangles, dropped",
            Self::NoTrajectories => "obstacles without trajectories, dropped",
            Self::InexactStates => "states with inexact positions or times, dropped",
        }
    }
}

/// Which sites to read, and how much of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selection {
    /// What the names of the sites begin with.
    pub sites: String,
    /// The most samples to hold.
    pub max_samples: usize,
}

impl Default for Selection {
    /// All sites, and 30 million samples or about 1 GB: more than the whole NGSIM table holds.
    fn default() -> Self {
        Self { sites: String::new(), max_samples: 30_000_000 }
    }
}

/// A gap after which an id is taken to be another vehicle's, s.
const LONGEST_GAP_S: f64 = 10.0;

/// The samples of each vehicle, as they come.
#[derive(Default)]
pub(super) struct Rows(ByVehicle<Vec<Sample>>);

impl Held for Rows {
    fn take(&mut self, key: Key, sample: Sample, _rate_hz: f64) {
        self.0.of(key).push(sample);
    }
}

/// The recordings that `source` tells of, by name of the site.
pub(super) fn recordings(
    path: &Path,
    source: &Source,
    mut collector: Collector<'_, Rows>,
) -> Result<Vec<Recording>, DataError> {
    let &Source { format, rate_hz, road } = source;
    let mut recordings = Vec::new();
    for (site, rows) in collector.take_sites()? {
        let (vehicles, oddities) = vehicles(rows, rate_hz);
        let road = road(&site);
        recordings.push(Recording { site, format, road, rate_hz, vehicles, oddities });
    }
    for (oddity, times) in collector.oddities {
        count(&mut recordings[0].oddities, oddity, times);
    }
    units::check(path, &recordings)?;
    Ok(recordings)
}

/// Oddities by kind.
pub(super) type Oddities = BTreeMap<Oddity, u64>;

/// Counts something odd that was met `times`.
pub(super) fn count(oddities: &mut Oddities, oddity: Oddity, times: u64) {
    if times > 0 {
        *oddities.entry(oddity).or_default() += times;
    }
}

/// The most frames from one row of a vehicle to the next.
pub(super) fn longest_gap(rate_hz: f64) -> i32 {
    (LONGEST_GAP_S * rate_hz).round() as i32
}

/// The vehicles of a site, with frames from 0, and what was odd about them.
fn vehicles(mut rows: Rows, rate_hz: f64) -> (Vec<VehicleTrack>, Oddities) {
    let tracks: Vec<(Key, Vec<Sample>)> = rows.0.take_in_order().collect();
    let first = tracks.iter().flat_map(|(_, samples)| samples).map(|sample| sample.frame).min().unwrap_or(0);
    let mut last_id = tracks.last().map_or(0, |(key, _)| key.0);
    let (mut ids, mut oddities, mut vehicles) = (BTreeSet::new(), Oddities::new(), Vec::new());
    for ((source_id, length, width), samples) in tracks {
        let samples = in_order(samples, first, &mut oddities);
        let meters = |millimeters: u32| f64::from(millimeters) / 1e3;
        for part in samples.chunk_by(|a, b| b.frame - a.frame <= longest_gap(rate_hz)) {
            let used = !ids.insert(source_id);
            last_id = last_id.saturating_add(u32::from(used));
            count(&mut oddities, Oddity::IdsUsedAgain, u64::from(used));
            let missing = i64::from(part[part.len() - 1].frame - part[0].frame) + 1 - part.len() as i64;
            count(&mut oddities, Oddity::TracksWithGaps, u64::from(missing > 0));
            count(&mut oddities, Oddity::MissingFrames, missing.unsigned_abs());
            vehicles.push(VehicleTrack {
                vehicle_id: if used { last_id } else { source_id },
                length_m: meters(length),
                width_m: meters(width),
                samples: part.to_vec(),
            });
        }
    }
    vehicles.sort_by_key(|vehicle| vehicle.vehicle_id);
    (vehicles, oddities)
}

/// The samples by rising frame, counted from `first`, one for each: the first of the file.
fn in_order(mut samples: Vec<Sample>, first: i32, oddities: &mut Oddities) -> Vec<Sample> {
    // Those of the same frame stay in the order of the file.
    samples.sort_by_key(|sample| sample.frame);
    samples.dedup_by(|later, earlier| {
        let oddity = if later == earlier { Oddity::RepeatedRows } else { Oddity::ConflictingRows };
        let same_frame = later.frame == earlier.frame;
        count(oddities, oddity, u64::from(same_frame));
        same_frame
    });
    for sample in &mut samples {
        sample.frame -= first;
    }
    samples
}
