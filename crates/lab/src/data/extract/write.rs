//! The tables that the readers of events and of traffic take.

use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;
use lanecraft_drive::road::Side;

use super::{Extraction, LaneChange, Point, Site, SmoothTrack};
use crate::data::error::DataError;
use crate::data::events::RoadKind;
use crate::data::traffic::FRAME_S;
use crate::run_dir::atomic;

/// Frames of the window before the begin and after the end of a maneuver.
const AROUND: i32 = 30;
/// How near a vehicle must come to be a neighbor, m.
const NEAR_M: f64 = 120.0;

impl Extraction {
    /// Writes `events.csv`, `tracks.csv.gz`, `traffic.csv.gz` and a page into `folder`, which is made if need be, and gives their paths.
    ///
    /// # Errors
    /// If the folder holds events already, or a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, DataError> {
        let [events, tracks, traffic] = ["events.csv", "tracks.csv.gz", "traffic.csv.gz"].map(|name| folder.join(name));
        if let Some(path) = [&events, &tracks, &traffic].into_iter().find(|path| path.exists()) {
            return Err(DataError::Occupied { path: path.clone() });
        }
        let mut written = self.report().write(folder)?;
        atomic::write(&traffic, &packed(&traffic, |out| self.traffic(out))?)?;
        atomic::write(&tracks, &packed(&tracks, |out| self.tracks(out))?)?;
        // The last one, so that who finds it finds the tracks, too.
        atomic::write(&events, self.events().as_bytes())?;
        written.extend([traffic, tracks, events]);
        Ok(written)
    }

    fn id(&self, change: &LaneChange) -> String {
        format!("{}-v{}-t{:05}", self.sites[change.site].name, change.ego_id, change.crossing)
    }

    fn events(&self) -> String {
        let mut text = "event_id,quality,site,road,ego_id,direction,lane_from,lane_to,t_start_s,t_end_s,duration_s,t_first_s,t_last_s,\
                        lateral_shift_m,d_start_m,d_end_m,lane_from_center_m,lane_to_center_m,speed_start_mps,speed_end_mps,\
                        speed_mean_mps,peak_lat_speed_mps,peak_lat_accel_mps2\n"
            .to_owned();
        for change in &self.changes {
            let site = &self.sites[change.site];
            let (id, name, quality) = (self.id(change), &site.name, change.quality);
            let road = if site.road == RoadKind::Freeway { "freeway" } else { "arterial" };
            let side = if change.side == Side::Left { "left" } else { "right" };
            let (ego, from, to) = (change.ego_id, change.lane_from, change.lane_to);
            let _ = write!(text, "{id},{quality:?},{name},{road},{ego},{side},{from},{to}");
            for value in figures(site, change) {
                let _ = write!(text, ",{value:.3}");
            }
            text.push('\n');
        }
        text
    }

    fn tracks(&self, out: &mut dyn Write) -> io::Result<()> {
        let head = "event_id,vehicle_id,is_ego,t_s,s_m,d_m,vs_mps,vd_mps,as_mps2,ad_mps2,lane,length_m,width_m";
        writeln!(out, "{head}")?;
        for change in &self.changes {
            let id = self.id(change);
            for (track, points) in around(&self.sites[change.site], change) {
                let (vehicle, length_m, width_m) = (track.vehicle_id, track.length_m, track.width_m);
                let is_ego = u8::from(vehicle == change.ego_id);
                for p in points {
                    let t_s = f64::from(p.frame - change.crossing) * FRAME_S;
                    write!(out, "{id},{vehicle},{is_ego},{t_s:.1},{:.3},{:.3},{:.3}", p.s_m, p.d_m, p.vs_mps)?;
                    write!(out, ",{:.3},{:.3},{:.3},{}", p.vd_mps, p.as_mps2, p.ad_mps2, p.lane)?;
                    writeln!(out, ",{length_m:.3},{width_m:.3}")?;
                }
            }
        }
        Ok(())
    }

    fn traffic(&self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "site,vehicle_id,frame,s_m,d_m,vs_mps,vd_mps,lane,length_m,width_m")?;
        for site in &self.sites {
            for track in &site.tracks {
                for p in &track.points {
                    write!(out, "{},{},{},{:.3},{:.3}", site.name, track.vehicle_id, p.frame, p.s_m, p.d_m)?;
                    write!(out, ",{:.3},{:.3},{}", p.vs_mps, p.vd_mps, p.lane)?;
                    writeln!(out, ",{:.3},{:.3}", track.length_m, track.width_m)?;
                }
            }
        }
        Ok(())
    }
}

/// The figures of an event, from `t_start_s` on.
fn figures(site: &Site, change: &LaneChange) -> [f64; 15] {
    let points = change.maneuver();
    let (first, last) = (points[0], points[points.len() - 1]);
    let time_s = |frame: i32| f64::from(frame - change.crossing) * FRAME_S;
    let center_m = |lane: u32| site.lane_centers_m[lane as usize - 1];
    let peak = |of: fn(&Point) -> f64| points.iter().map(|point| of(point).abs()).fold(0.0, f64::max);
    [
        time_s(change.start),
        time_s(change.end),
        change.duration_s(),
        time_s(change.points[0].frame),
        time_s(change.points[change.points.len() - 1].frame),
        change.shift_m(),
        first.d_m,
        last.d_m,
        center_m(change.lane_from),
        center_m(change.lane_to),
        first.vs_mps,
        last.vs_mps,
        change.mean_speed_mps(),
        peak(|point| point.vd_mps),
        peak(|point| point.ad_mps2),
    ]
}

/// The ego and its neighbors with their points in the window: all vehicles that come near, and into one of the lanes beside both.
fn around<'a>(site: &'a Site, change: &'a LaneChange) -> Vec<(&'a SmoothTrack, &'a [Point])> {
    let (begin, end) = (change.start - AROUND, change.end + AROUND);
    let ego = within(&change.points, begin, end);
    let (begin, end) = (ego[0].frame, ego[ego.len() - 1].frame);
    let lanes = change.lane_from.min(change.lane_to).saturating_sub(1)..=change.lane_from.max(change.lane_to) + 1;
    let near = |point: &Point| (point.s_m - ego[(point.frame - begin) as usize].s_m).abs() <= NEAR_M;
    let shown = |track: &'a SmoothTrack| {
        let points = within(&track.points, begin, end);
        let is_ego = track.vehicle_id == change.ego_id;
        let meets = points.iter().any(near) && points.iter().any(|point| lanes.contains(&point.lane));
        (is_ego || meets).then_some((track, points))
    };
    site.tracks.iter().filter_map(shown).collect()
}

/// The points from the frame `begin` to `end`.
fn within(points: &[Point], begin: i32, end: i32) -> &[Point] {
    let first = points.partition_point(|point| point.frame < begin);
    &points[first..points.partition_point(|point| point.frame <= end)]
}

/// What `content` writes, compressed.
fn packed(path: &Path, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<Vec<u8>, DataError> {
    let failed = |source| DataError::Pack { path: path.to_owned(), source };
    let mut out = GzEncoder::new(Vec::new(), Compression::default());
    content(&mut out).map_err(failed)?;
    out.finish().map_err(failed)
}
