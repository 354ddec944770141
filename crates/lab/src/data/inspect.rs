//! What recordings hold, in figures, from running sums: what is held grows with the vehicles and the gaps in their tracks, not with rows.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;

use super::collect::{ByVehicle, Collector, Held, Key, Source};
use super::error::DataError;
use super::read::{median, scan};
use super::recording::{Format, Oddities, Oddity, Sample, Selection, count, longest_gap};
use super::units::{self, Second};

/// A recording in figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Inspection {
    /// Name of the site.
    pub site: String,
    /// Where it came from.
    pub format: Format,
    /// Frames per second.
    pub rate_hz: f64,
    /// How many vehicles.
    pub vehicles: usize,
    /// How many samples.
    pub samples: u64,
    /// From the first to the last frame, s.
    pub duration_s: f64,
    /// Speeds: 5 %, 50 % and 95 % quantile over all samples, m/s, rounded to 0.01.
    pub speed_mps: [f64; 3],
    /// Median length of a vehicle, m.
    pub length_m: f64,
    /// Lanes as the source numbers them; empty if it does not.
    pub lanes: Vec<u32>,
    /// What was odd, and how often; oddities of the file as a whole are counted at its first site.
    pub oddities: BTreeMap<Oddity, u64>,
}

impl Inspection {
    /// For a terminal.
    pub fn text(&self) -> String {
        let format = match self.format {
            Format::Ngsim25 => "NGSIM, 25 columns",
            Format::Ngsim18 => "NGSIM, 18 columns",
            Format::Highd => "highD",
            Format::Commonroad => "CommonRoad 2020a",
            Format::Traffic => "traffic table",
        };
        let lanes: Vec<String> = self.lanes.iter().map(u32::to_string).collect();
        let lanes = if lanes.is_empty() { "not given".to_owned() } else { lanes.join(", ") };
        let [slow, middle, fast] = self.speed_mps;
        let mut text = format!(
            "{} ({format})\n  vehicles   {}, median length {:.1} m\n  samples    {} at {} Hz over {:.1} s\n  \
             speeds     {slow:.1}, {middle:.1}, {fast:.1} m/s (5, 50, 95 %)\n  lanes      {lanes}\n",
            self.site, self.vehicles, self.length_m, self.samples, self.rate_hz, self.duration_s
        );
        for (oddity, count) in &self.oddities {
            let _ = writeln!(text, "  odd        {count} {}", oddity.text());
        }
        text
    }
}

/// Looks at the sites in the file at `path` whose names begin with `sites`.
///
/// # Errors
/// As [`super::read::read`], but no number of samples is too big.
pub fn inspect(path: &Path, sites: &str) -> Result<Vec<Inspection>, DataError> {
    let selection = Selection { sites: sites.to_owned(), max_samples: usize::MAX };
    let mut collector = Collector::<Figures>::new(path, &selection);
    let source = scan(path, &mut collector)?;
    let (mut inspections, mut lengths_m, mut ratios) = (Vec::new(), Vec::new(), Histogram::default());
    for (site, mut figures) in collector.take_sites()? {
        ratios.add(&figures.ratios);
        let (inspection, lengths) = figures.finish(site, &source);
        inspections.push(inspection);
        lengths_m.extend(lengths);
    }
    for (oddity, times) in collector.oddities {
        count(&mut inspections[0].oddities, oddity, times);
    }
    units::check_medians(path, median(lengths_m), ratios.total(), ratios.quantile(0.5))?;
    Ok(inspections)
}

/// Running sums of a site.
#[derive(Default)]
struct Figures {
    tracks: ByVehicle<Track>,
    speeds: Histogram,
    ratios: Histogram,
    lanes: BTreeSet<u32>,
    oddities: Oddities,
}

impl Held for Figures {
    fn take(&mut self, key: Key, sample: Sample, rate_hz: f64) {
        let track = self.tracks.of(key);
        if !track.frames.insert(sample.frame) {
            count(&mut self.oddities, track.repeated(&sample), 1);
            return;
        }
        track.last = Some(sample);
        self.speeds.push(sample.speed_mps);
        if let Some(ratio) = track.second.push(&sample, rate_hz) {
            self.ratios.push(ratio);
        }
        if sample.lane > 0 {
            self.lanes.insert(sample.lane);
        }
    }
}

impl Figures {
    /// The figures of the site, and the length of each vehicle in meters.
    fn finish(&mut self, site: String, source: &Source) -> (Inspection, Vec<f64>) {
        let (mut ids, mut lengths_m, mut oddities) = (BTreeSet::new(), Vec::new(), std::mem::take(&mut self.oddities));
        let (mut first, mut last) = (i32::MAX, i32::MIN);
        for ((id, millimeters, _), track) in self.tracks.take_in_order() {
            for part in track.frames.parts(longest_gap(source.rate_hz)) {
                count(&mut oddities, Oddity::IdsUsedAgain, u64::from(!ids.insert(id)));
                count(&mut oddities, Oddity::TracksWithGaps, u64::from(part.missing > 0));
                count(&mut oddities, Oddity::MissingFrames, part.missing);
                lengths_m.push(f64::from(millimeters) / 1e3);
                (first, last) = (first.min(part.first), last.max(part.last));
            }
        }
        let inspection = Inspection {
            site,
            format: source.format,
            rate_hz: source.rate_hz,
            vehicles: lengths_m.len(),
            samples: self.speeds.total(),
            duration_s: f64::from(last - first) / source.rate_hz,
            speed_mps: [0.05, 0.5, 0.95].map(|share| self.speeds.quantile(share)),
            length_m: median(lengths_m.clone()),
            lanes: self.lanes.iter().copied().collect(),
            oddities,
        };
        (inspection, lengths_m)
    }
}

/// What is held of a vehicle.
#[derive(Default)]
struct Track {
    frames: Frames,
    /// The last sample that was no repetition.
    last: Option<Sample>,
    second: Second,
}

impl Track {
    /// What is odd about a sample whose frame was there.
    fn repeated(&self, sample: &Sample) -> Oddity {
        match self.last {
            Some(last) if last == *sample => Oddity::RepeatedRows,
            Some(last) if last.frame == sample.frame => Oddity::ConflictingRows,
            _ => Oddity::LateRows,
        }
    }
}

/// A set of frames, as runs without gaps: the last frame of each by its first one.
#[derive(Default)]
struct Frames(BTreeMap<i32, i32>);

/// A part of a track that is one vehicle's.
struct Part {
    first: i32,
    last: i32,
    missing: u64,
}

impl Frames {
    /// Puts `frame` in; false if it was there.
    fn insert(&mut self, frame: i32) -> bool {
        let below = self.0.range(..=frame).next_back().map(|(first, last)| (*first, *last));
        if below.is_some_and(|(_, last)| frame <= last) {
            return false;
        }
        let first = below.filter(|(_, last)| last + 1 == frame).map_or(frame, |(first, _)| first);
        let last = self.0.remove(&(frame + 1)).unwrap_or(frame);
        self.0.insert(first, last);
        true
    }

    /// The parts between gaps of more than `longest_gap` frames.
    fn parts(&self, longest_gap: i32) -> Vec<Part> {
        let mut parts: Vec<Part> = Vec::new();
        for (&first, &last) in &self.0 {
            match parts.last_mut() {
                Some(part) if first - part.last <= longest_gap => {
                    part.missing += u64::from((first - part.last - 1).unsigned_abs());
                    part.last = last;
                }
                _ => parts.push(Part { first, last, missing: 0 }),
            }
        }
        parts
    }
}

/// Bins for each unit of the values.
const BINS: f64 = 100.0;
/// The last bin, which holds what lies above, too: 1000 m/s, or a thousand times as fast.
const LAST_BIN: usize = 100_000;

/// Counts of values by hundredths, so that quantiles need no values.
#[derive(Default)]
struct Histogram(Vec<u64>);

impl Histogram {
    fn push(&mut self, value: f64) {
        let bin = ((value * BINS).round() as usize).min(LAST_BIN);
        if self.0.len() <= bin {
            self.0.resize(bin + 1, 0);
        }
        self.0[bin] += 1;
    }

    fn add(&mut self, other: &Self) {
        self.0.resize(self.0.len().max(other.0.len()), 0);
        self.0.iter_mut().zip(&other.0).for_each(|(count, more)| *count += more);
    }

    fn total(&self) -> u64 {
        self.0.iter().sum()
    }

    /// The value with this `share` of all below it; 0 if there are none.
    fn quantile(&self, share: f64) -> f64 {
        let rank = (share * self.total().saturating_sub(1) as f64).round() as u64;
        let mut below = 0;
        let bin = self.0.iter().position(|count| {
            below += count;
            below > rank
        });
        bin.unwrap_or(0) as f64 / BINS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is held of a vehicle seen in `frames`: runs of frames, and bins of speeds.
    fn held(frames: impl Iterator<Item = i32>) -> (usize, usize) {
        let mut figures = Figures::default();
        for frame in frames {
            let sample = Sample { frame, lane: 1, x_m: 2.0 * f64::from(frame), y_m: 0.0, speed_mps: 20.0 };
            figures.take((1, 4500, 1800), sample, 10.0);
        }
        (figures.tracks.of((1, 4500, 1800)).frames.0.len(), figures.speeds.0.len() + figures.ratios.0.len())
    }

    #[test]
    fn what_is_held_of_a_vehicle_does_not_grow_with_its_rows() {
        let few = held(0..100);
        assert_eq!(few.0, 1);
        assert_eq!(held(0..100_000), few);
        assert_eq!(held((0..100_000).rev()), few);
        // Rows that come twice, and halves that meet.
        assert_eq!(held((0..1000).chain(0..1000)), few);
        assert_eq!(held((0..1000).step_by(2).chain((1..1000).step_by(2))).0, 1);
    }

    #[test]
    fn frames_are_split_at_long_gaps_and_counted_within_short_ones() {
        let mut frames = Frames::default();
        assert!([5, 7, 6, 10, 200].into_iter().all(|frame| frames.insert(frame)));
        assert!([5, 6, 7, 10].into_iter().all(|frame| !frames.insert(frame)));
        let parts: Vec<_> = frames.parts(100).iter().map(|part| (part.first, part.last, part.missing)).collect();
        assert_eq!(parts, [(5, 10, 2), (200, 200, 0)]);
    }
}
