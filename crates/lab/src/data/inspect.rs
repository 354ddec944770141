//! What a recording holds, in figures.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use serde::Serialize;

use super::read::median;
use super::recording::{Format, Oddity, Recording};

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
    pub samples: usize,
    /// From the first to the last frame, s.
    pub duration_s: f64,
    /// Speeds: 5 %, 50 % and 95 % quantile over all samples, m/s.
    pub speed_mps: [f64; 3],
    /// Median length of a vehicle, m.
    pub length_m: f64,
    /// Lanes as the source numbers them; empty if it does not.
    pub lanes: Vec<u32>,
    /// What was odd, and how often.
    pub oddities: BTreeMap<Oddity, u64>,
}

impl Inspection {
    /// Looks at `recording`.
    pub fn of(recording: &Recording) -> Self {
        let samples = || recording.vehicles.iter().flat_map(|vehicle| &vehicle.samples);
        let mut speeds: Vec<f64> = samples().map(|sample| sample.speed_mps).collect();
        speeds.sort_by(f64::total_cmp);
        let quantile = |share: f64| speeds.get((share * (speeds.len() - 1) as f64).round() as usize).copied();
        let lanes: BTreeSet<u32> = samples().map(|sample| sample.lane).filter(|lane| *lane > 0).collect();
        // Frames count from the first one of the site.
        let last = samples().map(|sample| sample.frame).max().unwrap_or(0);
        Self {
            site: recording.site.clone(),
            format: recording.format,
            rate_hz: recording.rate_hz,
            vehicles: recording.vehicles.len(),
            samples: speeds.len(),
            duration_s: f64::from(last) / recording.rate_hz,
            speed_mps: [0.05, 0.5, 0.95].map(|share| quantile(share).unwrap_or(0.0)),
            length_m: median(recording.vehicles.iter().map(|vehicle| vehicle.length_m).collect()),
            lanes: lanes.into_iter().collect(),
            oddities: recording.oddities.clone(),
        }
    }

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
