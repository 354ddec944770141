//! Films of recorded traffic.
//!
//! Positions are the smoothed ones along the road; in them the future shows by a second, but by centimeters. A speed that is smoothed
//! likewise would give the future away, so speeds and accelerations are made of what was recorded up to each instant: the line
//! through the last second of recorded speeds, and for the lateral speed the last half second of positions. Lanes, which differ in width, are mapped onto
//! lanes of one width, linearly from center to center. Nobody signals in a recording.

use std::collections::BTreeMap;
use std::sync::Arc;

use lanecraft_drive::config::ConfigError;
use lanecraft_drive::road::{LaneIndex, Road, RoadConfig, Topology};
use lanecraft_drive::scene::{Neighbor, Scene, VehicleId};

use super::film::{Film, SCENE_S, onlooker};
use crate::data::DataError;
use crate::data::extract::{Point, Site, SmoothTrack, extract};
use crate::data::recording::{Recording, Sample};

/// Recorded speeds of so long make the speed and the acceleration, s.
const SPEED_WINDOW_S: f64 = 1.0;
/// Positions of so long make the lateral speed, in scenes.
const LATERAL_WINDOW: usize = 5;
/// The most lanes of a road.
const MAX_LANES: usize = 8;
/// Width of all lanes if there is but one, m.
const USUAL_WIDTH_M: f64 = 3.5;
/// Distance of the onlooker behind everybody, m.
const BEHIND_M: f64 = 100.0;

/// Why a recording gives no film.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FilmError {
    /// It cannot be used.
    #[error(transparent)]
    Data(#[from] DataError),
    /// Its lanes are none of a road of ours.
    #[error("site {site}: {source}")]
    Road {
        /// The site.
        site: String,
        /// What is wrong.
        source: ConfigError,
    },
}

/// A film of each road of a recording that has lanes.
///
/// # Errors
/// If the recording cannot be used.
pub(super) fn films(recording: &Recording) -> Result<Vec<Film>, FilmError> {
    let raw: BTreeMap<u32, &[Sample]> =
        recording.vehicles.iter().map(|vehicle| (vehicle.vehicle_id, vehicle.samples.as_slice())).collect();
    let mut films = Vec::new();
    for site in extract(std::slice::from_ref(recording))?.sites {
        if !site.tracks.is_empty() && (1..=MAX_LANES).contains(&site.lane_centers_m.len()) {
            films.push(film(&site, &raw, recording.rate_hz)?);
        }
    }
    Ok(films)
}

fn film(site: &Site, raw: &BTreeMap<u32, &[Sample]>, rate_hz: f64) -> Result<Film, FilmError> {
    let lanes = Lanes::of(site).map_err(|source| FilmError::Road { site: site.name.clone(), source })?;
    let points = || site.tracks.iter().flat_map(|track| &track.points);
    let first = points().map(|point| point.frame).min().unwrap_or(0);
    let last = points().map(|point| point.frame).max().unwrap_or(0);
    let behind_m = points().map(|point| point.s_m).fold(f64::INFINITY, f64::min) - BEHIND_M;
    let mut seen: Vec<Vec<Neighbor>> = vec![Vec::new(); (last - first) as usize + 1];
    for track in &site.tracks {
        let samples = raw.get(&track.vehicle_id).copied().unwrap_or_default();
        for (index, point) in track.points.iter().enumerate() {
            let Some((speed_mps, accel_mps2)) = motion(samples, f64::from(point.frame) * SCENE_S, rate_hz) else {
                continue;
            };
            let neighbor = Neighbor {
                ahead_m: point.s_m - behind_m,
                speed_mps,
                accel_mps2,
                lateral_speed_mps: lateral_speed_mps(&track.points[..=index]),
                ..lanes.place(track, point)
            };
            seen[(point.frame - first) as usize].push(neighbor);
        }
    }
    let scenes: Vec<Scene> = seen.into_iter().map(|neighbors| onlooker(&lanes.road, neighbors)).collect();
    Ok(Film::standing(site.name.clone(), scenes))
}

/// Speed and acceleration now by the line through the recorded speeds of the last second; nothing if they are too few.
fn motion(samples: &[Sample], now_s: f64, rate_hz: f64) -> Option<(f64, f64)> {
    let time_s = |sample: &Sample| f64::from(sample.frame) / rate_hz - now_s;
    let end = samples.partition_point(|sample| time_s(sample) < 0.01);
    let begin = samples.partition_point(|sample| time_s(sample) < -SPEED_WINDOW_S - 0.01);
    let window = &samples[begin..end];
    let count = window.len() as f64;
    if count < 0.5 * SPEED_WINDOW_S * rate_hz {
        return None;
    }
    let (time, speed) = window.iter().fold((0.0, 0.0), |(t, v), sample| (t + time_s(sample), v + sample.speed_mps));
    let (mean_s, mean_mps) = (time / count, speed / count);
    let (mut square, mut product) = (0.0, 0.0);
    for sample in window {
        let offset_s = time_s(sample) - mean_s;
        square += offset_s * offset_s;
        product += offset_s * (sample.speed_mps - mean_mps);
    }
    let accel_mps2 = product / square;
    Some(((mean_mps - accel_mps2 * mean_s).max(0.0), accel_mps2))
}

/// Lateral speed at the last of these points by the line through the last of them.
fn lateral_speed_mps(points: &[Point]) -> f64 {
    let recent = &points[points.len().saturating_sub(LATERAL_WINDOW + 1)..];
    let (first, last) = (recent[0], recent[recent.len() - 1]);
    let elapsed_s = f64::from(last.frame - first.frame) * SCENE_S;
    if elapsed_s > 0.0 { (last.d_m - first.d_m) / elapsed_s } else { 0.0 }
}

/// Lanes of one width in place of those of a site.
struct Lanes {
    road: Arc<Road>,
    /// Centers of the site's lanes from right to left, m.
    centers_m: Vec<f64>,
}

impl Lanes {
    fn of(site: &Site) -> Result<Self, ConfigError> {
        let centers_m: Vec<f64> = site.lane_centers_m.iter().rev().copied().collect();
        let lanes = centers_m.len();
        let lane_width_m =
            if lanes > 1 { (centers_m[lanes - 1] - centers_m[0]) / (lanes - 1) as f64 } else { USUAL_WIDTH_M };
        let config = RoadConfig { lanes: lanes as u8, lane_width_m, topology: Topology::Open, ..RoadConfig::default() };
        Ok(Self { road: Arc::new(Road::new(config)?), centers_m })
    }

    /// Lateral position on the road with lanes of one width.
    fn mapped_m(&self, d_m: f64) -> f64 {
        let (centers_m, width_m) = (&self.centers_m, self.road.lane_width_m());
        let right = centers_m.partition_point(|center| *center <= d_m).clamp(1, centers_m.len().max(2) - 1) - 1;
        let pitch_m = if centers_m.len() > 1 { centers_m[right + 1] - centers_m[right] } else { width_m };
        // Beyond the outer centers as far as it is.
        let beyond = d_m < centers_m[0] || d_m > centers_m[centers_m.len() - 1];
        if beyond {
            let (outer, center_m) = if d_m < centers_m[0] {
                (0, centers_m[0])
            } else {
                (centers_m.len() - 1, centers_m[centers_m.len() - 1])
            };
            return outer as f64 * width_m + d_m - center_m;
        }
        (right as f64 + (d_m - centers_m[right]) / pitch_m) * width_m
    }

    /// A vehicle in its lane, all else to be filled in.
    fn place(&self, track: &SmoothTrack, point: &Point) -> Neighbor {
        let lane = LaneIndex((self.centers_m.len() - (point.lane as usize).clamp(1, self.centers_m.len())) as u8);
        let car = Neighbor::car(VehicleId(track.vehicle_id), lane, self.mapped_m(point.d_m), 0.0, 0.0);
        Neighbor { length_m: track.length_m, width_m: track.width_m, ..car }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::events::RoadKind;

    fn site(centers_m: &[f64]) -> Site {
        Site { name: "here".into(), road: RoadKind::Freeway, lane_centers_m: centers_m.to_vec(), tracks: Vec::new() }
    }

    #[test]
    fn the_speed_is_that_of_the_past_alone() {
        let sample =
            |frame: i32| Sample { frame, lane: 0, x_m: 0.0, y_m: 0.0, speed_mps: 10.0 + 0.2 * f64::from(frame) };
        let mut samples: Vec<Sample> = (0..40).map(sample).collect();
        let before = motion(&samples, 2.0, 10.0).unwrap();
        assert!((before.0 - 14.0).abs() < 1e-9 && (before.1 - 2.0).abs() < 1e-9);
        samples[21..].iter_mut().for_each(|sample| sample.speed_mps = 0.0);
        assert_eq!(motion(&samples, 2.0, 10.0), Some(before));
        assert_eq!(motion(&samples, 0.1, 10.0), None);
    }

    #[test]
    fn lanes_of_any_width_become_lanes_of_one() {
        let lanes = Lanes::of(&site(&[11.0, 7.0, 4.0])).unwrap();
        assert_eq!(lanes.road.lane_width_m(), 3.5);
        for (d_m, mapped_m) in [(4.0, 0.0), (5.5, 1.75), (7.0, 3.5), (9.0, 5.25), (11.0, 7.0), (3.0, -1.0), (12.0, 8.0)]
        {
            assert!((lanes.mapped_m(d_m) - mapped_m).abs() < 1e-12, "{d_m}");
        }
        let one = Lanes::of(&site(&[2.0])).unwrap();
        assert_eq!((one.mapped_m(1.0), one.mapped_m(2.0), one.mapped_m(3.0)), (-1.0, 0.0, 1.0));
    }
}
