//! Recorded vehicles: where each was, ten times a second or so.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_range};

/// Which recording drives around the ego, and how it lies on the road.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordedTraffic {
    /// Table of tracks, relative to the scenario file or, if it is not there, to the folder `LANECRAFT_DATA`.
    pub file: String,
    /// The site (column `site`) or the event (column `event_id`) in it.
    pub site: String,
    /// Time in the recording at which the scene starts, s.
    #[serde(default)]
    pub start_s: f64,
    /// Added to each recorded position along the road, m.
    #[serde(default)]
    pub s_offset_m: f64,
    /// Added to each recorded lateral position, m, so that the center of the rightmost lane lies at 0.
    #[serde(default)]
    pub d_offset_m: f64,
    /// Whether a vehicle leaves its recorded path and follows the ego once the ego is ahead of it.
    #[serde(default)]
    pub reactive: bool,
}

impl RecordedTraffic {
    pub(super) fn validate(&self) -> Result<(), ConfigError> {
        check_range("recording.start_s", self.start_s, -3600.0, 36_000.0)?;
        check_range("recording.s_offset_m", self.s_offset_m, -1e5, 1e5)?;
        check_range("recording.d_offset_m", self.d_offset_m, -100.0, 100.0)
    }
}

/// Where a recorded vehicle was, and how fast.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackSample {
    /// Position of its center along the road, m.
    pub s_m: f64,
    /// Position of its center to the left of the reference line, m.
    pub d_m: f64,
    /// Speed along the road, m/s.
    pub speed_mps: f64,
    /// Speed to the left, m/s.
    pub lateral_speed_mps: f64,
}

/// A recorded vehicle, without gaps in time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// Length, m.
    pub length_m: f64,
    /// Width, m.
    pub width_m: f64,
    /// Time of the first sample, s.
    pub first_s: f64,
    /// The samples, one each [`Recording::period_s`].
    pub samples: Vec<TrackSample>,
}

/// Recorded vehicles, with times since the start of the scene and positions on its road.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// Time between two samples, s.
    pub period_s: f64,
    /// The vehicles.
    pub tracks: Vec<Track>,
}

impl Track {
    /// Where the vehicle is at `time_s`: on a straight line between the samples beside; none before the first and after the last.
    pub fn at(&self, time_s: f64, period_s: f64) -> Option<TrackSample> {
        // A time that lies on a sample, up to rounding, is that sample's.
        let index = (time_s - self.first_s) / period_s + 1e-9;
        let last = self.samples.len().checked_sub(1)?;
        if index < 0.0 || index > last as f64 + 2e-9 {
            return None;
        }
        let before = (index as usize).min(last);
        let (a, b) = (self.samples[before], self.samples[(before + 1).min(last)]);
        let share = index - before as f64;
        let between = |a: f64, b: f64| a + share * (b - a);
        Some(TrackSample {
            s_m: between(a.s_m, b.s_m),
            d_m: between(a.d_m, b.d_m),
            speed_mps: between(a.speed_mps, b.speed_mps),
            lateral_speed_mps: between(a.lateral_speed_mps, b.lateral_speed_mps),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{Track, TrackSample};

    #[test]
    fn a_track_is_straight_between_samples_and_ends_with_them() {
        let sample = |s_m| TrackSample { s_m, d_m: 0.0, speed_mps: 10.0, lateral_speed_mps: 0.0 };
        let track = Track { length_m: 4.5, width_m: 1.8, first_s: 1.0, samples: vec![sample(0.0), sample(1.0)] };
        let at = |time_s| track.at(time_s, 0.1).map(|sample| (sample.s_m * 1e6).round() / 1e6);
        assert_eq!([at(0.9), at(1.0), at(1.05), at(1.1), at(1.2)], [None, Some(0.0), Some(0.5), Some(1.0), None]);
    }
}
