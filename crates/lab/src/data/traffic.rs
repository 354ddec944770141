//! Recorded traffic: every track of each site in full, as prepared from NGSIM (US Department of Transportation).
//!
//! One table, `traffic.csv.gz`, by site, vehicle and frame of 0.1 s. Along the road s grows ahead, d to the left; lane 1 is the
//! leftmost. The smoothed columns are read: the recorded accelerations are clipped noise, and so are not.

use std::collections::BTreeMap;
use std::path::Path;

use super::table::{Table, TableError, TableErrorKind};

/// Time between two frames, s.
pub const FRAME_S: f64 = 0.1;

/// One instant of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrafficPoint {
    /// Count of frames since an origin of the site's own; may be negative.
    pub frame: i32,
    /// Lane, 1 is the leftmost.
    pub lane: u32,
    /// Position along the road, m.
    pub s_m: f64,
    /// Speed along the road, m/s.
    pub speed_mps: f64,
}

/// The track of one vehicle; frames may be missing.
#[derive(Clone, Debug, PartialEq)]
pub struct TrafficTrack {
    /// Which vehicle, within its site.
    pub vehicle_id: u32,
    /// Length, m.
    pub length_m: f64,
    /// At least one point, by rising frame.
    pub points: Vec<TrafficPoint>,
}

/// A stretch of road, recorded without a break.
#[derive(Clone, Debug, PartialEq)]
pub struct TrafficSite {
    /// Its name.
    pub name: String,
    /// All vehicles, by rising id.
    pub tracks: Vec<TrafficTrack>,
}

const COLUMNS: [&str; 7] = ["site", "vehicle_id", "frame", "s_m", "vs_mps", "lane", "length_m"];

/// Allowed positions along a road, m.
const POSITIONS_M: (f64, f64) = (-1e6, 1e6);
/// Allowed speeds along the road, m/s: a smoothed track may move back a little at rest.
const SPEEDS_MPS: (f64, f64) = (-20.0, 120.0);
/// Allowed lengths of vehicles, m.
const LENGTHS_M: (f64, f64) = (0.1, 50.0);

/// Reads the sites of `folder`, by name.
///
/// # Errors
/// If the table or a column is missing, a row cut off, a number missing, not finite or out of range, or the frames of a vehicle do
/// not rise.
pub fn read_traffic(folder: &Path) -> Result<Vec<TrafficSite>, TableError> {
    let mut table = Table::open(&folder.join("traffic.csv.gz"), &COLUMNS)?;
    let mut sites: BTreeMap<String, BTreeMap<u32, TrafficTrack>> = BTreeMap::new();
    while table.next()? {
        let point = TrafficPoint {
            frame: table.integer("frame")?,
            lane: table.index("lane")?,
            s_m: table.number("s_m", POSITIONS_M)?,
            speed_mps: table.number("vs_mps", SPEEDS_MPS)?,
        };
        let (vehicle_id, length_m) = (table.index("vehicle_id")?, table.number("length_m", LENGTHS_M)?);
        let tracks = sites.entry(table.text("site")?.to_owned()).or_default();
        let track =
            tracks.entry(vehicle_id).or_insert_with(|| TrafficTrack { vehicle_id, length_m, points: Vec::new() });
        if track.points.last().is_some_and(|last| last.frame >= point.frame) {
            let problem = "the frames of this vehicle do not rise";
            return Err(table.error(TableErrorKind::BadKey { key: vehicle_id.to_string(), problem }));
        }
        track.points.push(point);
    }
    let site = |(name, tracks): (String, BTreeMap<u32, TrafficTrack>)| TrafficSite {
        name,
        tracks: tracks.into_values().collect(),
    };
    Ok(sites.into_iter().map(site).collect())
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use flate2::Compression;
    use flate2::write::GzEncoder;

    use super::*;

    const TRAFFIC: &str = "site,vehicle_id,frame,s_m,vs_mps,lane,length_m\n\
                           b,7,0,0.0,20.0,1,4.5\n\
                           b,7,1,2.0,20.0,1,4.5\n\
                           a,7,1,2.0,20.0,2,4.5\n\
                           b,3,-1,30.0,18.0,1,5.0\n";

    fn read(text: &str) -> Result<Vec<TrafficSite>, TableError> {
        let folder = tempfile::tempdir().unwrap();
        let mut packed = GzEncoder::new(Vec::new(), Compression::default());
        packed.write_all(text.as_bytes()).unwrap();
        std::fs::write(folder.path().join("traffic.csv.gz"), packed.finish().unwrap()).unwrap();
        read_traffic(folder.path())
    }

    #[test]
    fn tracks_come_by_site_and_vehicle() {
        let sites = read(TRAFFIC).unwrap();
        assert_eq!(sites.iter().map(|site| site.name.as_str()).collect::<Vec<_>>(), ["a", "b"]);
        let ids: Vec<u32> = sites[1].tracks.iter().map(|track| track.vehicle_id).collect();
        assert_eq!((ids, sites[1].tracks[1].points.len()), (vec![3, 7], 2));
    }

    #[test]
    fn whatever_is_wrong_is_named_with_its_line() {
        for (from, to, expected) in [
            ("2.0,20.0,1", "inf,20.0,1", "traffic.csv.gz, line 3: column `s_m`: `inf` is no number"),
            ("2.0,20.0,1", "2.0,,1", "line 3: column `vs_mps`: `` is no number"),
            ("b,7,1", "b,7,0", "line 3: `7`: the frames of this vehicle do not rise"),
            ("18.0,1", "18.0,-1", "line 5: column `lane`"),
            ("b,3,-1", "b,3,0.5", "line 5: column `frame`: `0.5` is no number"),
            ("5.0\n", "500.0\n", "line 5: column `length_m`: `500.0` is no number in 0.1..=50"),
            ("b,3,-1,30.0,", "b,3,-1,", "line 5: cannot be read"),
            ("frame", "frames", "line 1: has no column `frame`"),
        ] {
            assert!(TRAFFIC.contains(from));
            let message = read(&TRAFFIC.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(message.contains(expected), "`{message}` does not say `{expected}`");
        }
    }
}
