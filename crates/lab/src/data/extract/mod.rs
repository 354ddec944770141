//! Lane changes from recorded tracks, without a map.
//!
//! 1. `road`: the road from the tracks alone.
//! 2. `smooth`: smoothed tracks at 10 Hz.
//! 3. `lanes`: the lanes from where vehicles drive.
//! 4. `changes`: lane changes with their bounds, and why others were dropped.
//! 5. `write`: the tables that [`super::events`] and [`super::traffic`] read; `report`: a page of what was found.

mod changes;
mod lanes;
mod report;
mod road;
mod smooth;
mod solve;
mod write;

use std::collections::{BTreeMap, BTreeSet};

use lanecraft_drive::road::Side;
use serde::Serialize;

use super::error::DataError;
use super::events::RoadKind;
use super::recording::Recording;

/// One instant of a smoothed track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Count of frames of 0.1 s.
    pub frame: i32,
    /// Lane, 1 is the leftmost.
    pub lane: u32,
    /// Position along the road, m.
    pub s_m: f64,
    /// Position to the left, m.
    pub d_m: f64,
    /// Speed along the road, m/s.
    pub vs_mps: f64,
    /// Speed to the left, m/s.
    pub vd_mps: f64,
    /// Acceleration along the road, m/s².
    pub as_mps2: f64,
    /// Acceleration to the left, m/s².
    pub ad_mps2: f64,
}

/// A vehicle along the road; frames may be missing.
#[derive(Clone, Debug, PartialEq)]
pub struct SmoothTrack {
    /// Which vehicle, within its site.
    pub vehicle_id: u32,
    /// Length, m.
    pub length_m: f64,
    /// Width, m.
    pub width_m: f64,
    /// By rising frame.
    pub points: Vec<Point>,
}

/// One direction of a recording, along its road.
#[derive(Clone, Debug, PartialEq)]
pub struct Site {
    /// Its name; that of the recording, with `-a` or `-b` if both directions are used.
    pub name: String,
    /// Kind of road.
    pub road: RoadKind,
    /// Centers of the lanes from left to right, m.
    pub lane_centers_m: Vec<f64>,
    /// The vehicles, by rising id.
    pub tracks: Vec<SmoothTrack>,
}

/// How much of a lane change was seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub enum Quality {
    /// All of it, and at least 3 s of track on both sides of the crossing.
    A,
    /// All of it, but less than 3 s on one side.
    B,
    /// It is cut off, but begins and ends near the centers of lanes.
    C,
}

/// A lane change found.
#[derive(Clone, Debug, PartialEq)]
pub struct LaneChange {
    /// Index of its site.
    pub site: usize,
    /// The vehicle.
    pub ego_id: u32,
    /// To which side.
    pub side: Side,
    /// How much of it was seen.
    pub quality: Quality,
    /// Lane before the crossing, 1 is the leftmost.
    pub lane_from: u32,
    /// Lane behind it.
    pub lane_to: u32,
    /// Frame of the crossing: the first one in the new lane.
    pub crossing: i32,
    /// Frame of the begin.
    pub start: i32,
    /// Frame of the end.
    pub end: i32,
    /// The ego's points without a gap around the crossing.
    pub points: Vec<Point>,
}

impl LaneChange {
    /// From the begin to the end, s.
    pub fn duration_s(&self) -> f64 {
        f64::from(self.end - self.start) * super::traffic::FRAME_S
    }

    /// The points from the begin to the end.
    pub fn maneuver(&self) -> &[Point] {
        let first = self.points[0].frame;
        &self.points[(self.start - first) as usize..=(self.end - first) as usize]
    }

    /// Mean speed along the road from the begin to the end, m/s.
    pub fn mean_speed_mps(&self) -> f64 {
        let points = self.maneuver();
        points.iter().map(|point| point.vs_mps).sum::<f64>() / points.len() as f64
    }

    /// Lateral distance from the begin to the end, m.
    pub fn shift_m(&self) -> f64 {
        let points = self.maneuver();
        (points[points.len() - 1].d_m - points[0].d_m).abs()
    }
}

/// What was left out, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Skip {
    /// Vehicles that hardly move, so that they have no direction.
    HardlyMoves,
    /// Vehicles that cross the road.
    CrossesTheRoad,
    /// Jumps within tracks, which are split there.
    Jumps,
    /// Crossings of more than one line within a frame.
    JumpsLanes,
    /// Crossings of short vehicles: motorcycles.
    ShortVehicle,
    /// Crossings with another one near.
    SecondCrossing,
    /// Too little lateral shift: a wobble about the line.
    Wobble,
    /// Too much: two lanes at once.
    DoubleChange,
    /// The begin or the end is cut off far from the center of a lane.
    CutOff,
    /// Too slow.
    Slow,
    /// Too short or too long.
    OddDuration,
}

impl Skip {
    /// What it is, for people.
    pub fn text(self) -> &'static str {
        match self {
            Self::HardlyMoves => "vehicles that move less than 10 m",
            Self::CrossesTheRoad => "vehicles that cross the road",
            Self::Jumps => "jumps within tracks, which are split there",
            Self::JumpsLanes => "crossings of several lines within 0.1 s",
            Self::ShortVehicle => "crossings of vehicles shorter than 2.5 m",
            Self::SecondCrossing => "crossings with another one within 3 s",
            Self::Wobble => "crossings with less than 2 m of lateral shift",
            Self::DoubleChange => "crossings with more than 5 m of lateral shift",
            Self::CutOff => "lane changes cut off more than 0.9 m from the center of a lane",
            Self::Slow => "lane changes below 5 m/s",
            Self::OddDuration => "lane changes shorter than 1.5 s or longer than 12 s",
        }
    }
}

/// What was extracted.
#[derive(Clone, Debug, PartialEq)]
pub struct Extraction {
    /// The roads.
    pub sites: Vec<Site>,
    /// The lane changes, by site, vehicle and time.
    pub changes: Vec<LaneChange>,
    /// What was left out, and how often.
    pub skips: BTreeMap<Skip, u64>,
}

/// Finds the lane changes of `recordings`.
///
/// # Errors
/// If two recordings have one name.
pub fn extract(recordings: &[Recording]) -> Result<Extraction, DataError> {
    let mut names = BTreeSet::new();
    let mut found = Extraction { sites: Vec::new(), changes: Vec::new(), skips: BTreeMap::new() };
    for recording in recordings {
        if !names.insert(&recording.site) {
            return Err(DataError::SiteTwice { site: recording.site.clone() });
        }
        let roads = road::roads(recording, &mut found.skips);
        let both = roads.len() > 1;
        for (road, end) in roads.into_iter().zip(["-a", "-b"]) {
            let name = format!("{}{}", recording.site, if both { end } else { "" });
            let smoothed = |track| smooth::smooth(track, recording.rate_hz, &mut found.skips);
            let mut tracks: Vec<SmoothTrack> = road.iter().map(smoothed).collect();
            tracks.retain(|track| !track.points.is_empty());
            let lane_centers_m = lanes::lane_centers_m(&tracks);
            for point in tracks.iter_mut().flat_map(|track| &mut track.points) {
                point.lane = lanes::lane_at(&lane_centers_m, point.d_m);
            }
            let site = Site { name, road: recording.road, lane_centers_m, tracks };
            found.changes.extend(changes::changes(&site, found.sites.len(), &mut found.skips));
            found.sites.push(site);
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests;
