//! Recorded lane changes with the traffic around them, as prepared from NGSIM (US Department of Transportation).
//!
//! A folder with two tables: `events.csv`, one row for each lane change, and `tracks.csv.gz`, the tracks of the changing vehicle and
//! of all others around it, by event, vehicle and time. Along the road s grows ahead, d to the left; t = 0 is the crossing of the
//! lane line. The smoothed columns are read, the raw ones left alone.

use std::collections::BTreeMap;
use std::path::Path;

use lanecraft_drive::road::Side;

use super::table::{Table, TableError, TableErrorKind};

/// Kind of road.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RoadKind {
    /// Without crossings.
    Freeway,
    /// A street of a town.
    Arterial,
}

/// One instant of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackPoint {
    /// Time since the crossing of the lane line, s.
    pub time_s: f64,
    /// Position along the road, m.
    pub s_m: f64,
    /// Position to the left, m.
    pub d_m: f64,
    /// Speed along the road, m/s.
    pub speed_mps: f64,
}

/// The track of one vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Which vehicle, within its event.
    pub vehicle_id: u32,
    /// Length, m.
    pub length_m: f64,
    /// Width, m.
    pub width_m: f64,
    /// At least one point, by rising time.
    pub points: Vec<TrackPoint>,
}

impl Track {
    /// The point at `time_s`: position as of [`Self::position_m`], speed of the last point until then, or of the first.
    pub fn state(&self, time_s: f64) -> TrackPoint {
        let after = self.points.partition_point(|point| point.time_s <= time_s);
        let (s_m, d_m) = self.position_m(time_s);
        TrackPoint { time_s, s_m, d_m, speed_mps: self.points[after.saturating_sub(1)].speed_mps }
    }

    /// Whether the vehicle was seen at `time_s`.
    pub fn covers(&self, time_s: f64) -> bool {
        let ends = (self.points.first(), self.points.last());
        matches!(ends, (Some(first), Some(last)) if (first.time_s..=last.time_s).contains(&time_s))
    }

    /// (s, d) at `time_s`, m: between points by linear interpolation, before and after the track at constant speed in its lane.
    pub fn position_m(&self, time_s: f64) -> (f64, f64) {
        let after = self.points.partition_point(|point| point.time_s <= time_s);
        match (after.checked_sub(1).and_then(|before| self.points.get(before)), self.points.get(after)) {
            (Some(a), Some(b)) => {
                let share = (time_s - a.time_s) / (b.time_s - a.time_s);
                (a.s_m + share * (b.s_m - a.s_m), a.d_m + share * (b.d_m - a.d_m))
            }
            (Some(end), None) | (None, Some(end)) => (end.s_m + (time_s - end.time_s) * end.speed_mps, end.d_m),
            (None, None) => unreachable!("a track has at least one point"),
        }
    }
}

/// A recorded lane change.
#[derive(Clone, Debug, PartialEq)]
pub struct LaneChangeEvent {
    /// Its name.
    pub id: String,
    /// The recording site; events of one site share their traffic.
    pub site: String,
    /// Kind of road.
    pub road: RoadKind,
    /// To which side.
    pub side: Side,
    /// Begin and end of the maneuver, s.
    pub start_s: f64,
    /// End of the maneuver, s.
    pub end_s: f64,
    /// Lateral position at the begin, m.
    pub start_d_m: f64,
    /// Lateral position at the end, m.
    pub end_d_m: f64,
    /// Center of the new lane, m; the lateral position at the end where the table does not know it.
    pub target_d_m: f64,
    /// Mean speed during the maneuver, m/s.
    pub mean_speed_mps: f64,
    /// The vehicle that changes lanes.
    pub ego: Track,
    /// All others, by rising id.
    pub neighbors: Vec<Track>,
}

const EVENT_COLUMNS: [&str; 10] = [
    "event_id",
    "site",
    "road",
    "ego_id",
    "direction",
    "t_start_s",
    "t_end_s",
    "d_start_m",
    "d_end_m",
    "speed_mean_mps",
];
/// What the column with the center of the new lane may be called; older tables have none.
const CENTER_COLUMNS: [&str; 2] = ["lane_to_center_m", "lane_to_centre_m"];
const TRACK_COLUMNS: [&str; 8] = ["event_id", "vehicle_id", "t_s", "s_m", "d_m", "vs_mps", "length_m", "width_m"];

/// Allowed times around a lane change, s.
const TIMES_S: (f64, f64) = (-600.0, 600.0);
/// Allowed positions along a road, m.
const POSITIONS_M: (f64, f64) = (-1e6, 1e6);
/// Allowed lateral positions, m.
const LATERAL_M: (f64, f64) = (-1e3, 1e3);
/// Allowed speeds along the road, m/s: a smoothed track may move back a little at rest.
const SPEEDS_MPS: (f64, f64) = (-20.0, 120.0);
/// Allowed lengths and widths of vehicles, m.
const SIZES_M: (f64, f64) = (0.1, 50.0);

/// Reads the events of `folder`, by the order of `events.csv`.
///
/// # Errors
/// If a table or a column is missing, a row cut off, a number missing, not finite or out of range, an event named twice, without
/// tracks or without the track of its ego, or a track not in the order of time.
pub fn read_events(folder: &Path) -> Result<Vec<LaneChangeEvent>, TableError> {
    let mut tracks = read_tracks(&folder.join("tracks.csv.gz"))?;
    let mut table = Table::open(&folder.join("events.csv"), &EVENT_COLUMNS)?;
    let mut events = Vec::new();
    while table.next()? {
        events.push(read_event(&table, &mut tracks)?);
    }
    match tracks.pop_first() {
        None => Ok(events),
        Some((key, _)) => {
            let problem = "has tracks but no row here";
            Err(table.error_of_file(TableErrorKind::BadKey { key, problem }))
        }
    }
}

/// Tracks by event and vehicle.
type Tracks = BTreeMap<String, BTreeMap<u32, Track>>;

fn read_tracks(path: &Path) -> Result<Tracks, TableError> {
    let mut table = Table::open(path, &TRACK_COLUMNS)?;
    let mut tracks = Tracks::new();
    while table.next()? {
        let point = TrackPoint {
            time_s: table.number("t_s", TIMES_S)?,
            s_m: table.number("s_m", POSITIONS_M)?,
            d_m: table.number("d_m", LATERAL_M)?,
            speed_mps: table.number("vs_mps", SPEEDS_MPS)?,
        };
        let vehicle_id = table.index("vehicle_id")?;
        let (length_m, width_m) = (table.number("length_m", SIZES_M)?, table.number("width_m", SIZES_M)?);
        let event = tracks.entry(table.text("event_id")?.to_owned()).or_default();
        let track =
            event.entry(vehicle_id).or_insert_with(|| Track { vehicle_id, length_m, width_m, points: Vec::new() });
        if track.points.last().is_some_and(|last| last.time_s >= point.time_s) {
            let problem = "the times of this vehicle do not rise";
            return Err(table.error(TableErrorKind::BadKey { key: vehicle_id.to_string(), problem }));
        }
        track.points.push(point);
    }
    Ok(tracks)
}

/// The event of the present row of `table`, whose tracks are taken out of `tracks`.
fn read_event(table: &Table, tracks: &mut Tracks) -> Result<LaneChangeEvent, TableError> {
    let id = table.text("event_id")?.to_owned();
    let bad_key = |problem| table.error(TableErrorKind::BadKey { key: id.clone(), problem });
    let mut vehicles = tracks.remove(&id).ok_or_else(|| bad_key("has no tracks, or appears twice"))?;
    let ego = vehicles.remove(&table.index("ego_id")?).ok_or_else(|| bad_key("the ego has no track"))?;
    let start_s = table.number("t_start_s", TIMES_S)?;
    let target = CENTER_COLUMNS.into_iter().find(|column| table.has(column)).unwrap_or("d_end_m");
    Ok(LaneChangeEvent {
        site: table.text("site")?.to_owned(),
        road: [RoadKind::Freeway, RoadKind::Arterial][table.word("road", &["freeway", "arterial"])?],
        side: Side::BOTH[table.word("direction", &["left", "right"])?],
        start_s,
        end_s: table.number("t_end_s", (start_s, TIMES_S.1))?,
        start_d_m: table.number("d_start_m", LATERAL_M)?,
        end_d_m: table.number("d_end_m", LATERAL_M)?,
        target_d_m: table.number(target, LATERAL_M)?,
        mean_speed_mps: table.number("speed_mean_mps", (0.5, SPEEDS_MPS.1))?,
        ego,
        neighbors: vehicles.into_values().collect(),
        id,
    })
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::GzEncoder;

    use super::*;

    const EVENTS: &str = "event_id,site,road,ego_id,direction,t_start_s,t_end_s,d_start_m,d_end_m,speed_mean_mps\n\
                          e1,here,freeway,7,left,-2.0,2.0,0.0,3.5,20.0\n";
    const TRACKS: &str = "event_id,vehicle_id,t_s,s_m,d_m,vs_mps,length_m,width_m\n\
                          e1,7,-2.0,0.0,0.0,20.0,4.5,1.8\n\
                          e1,7,2.0,80.0,3.5,20.0,4.5,1.8\n\
                          e1,9,-2.0,30.0,3.5,18.0,5.0,2.0\n\
                          e1,9,0.0,66.0,3.5,18.0,5.0,2.0\n";

    fn read(name: &str, events: &str, tracks: &str, cut_bytes: usize) -> Result<Vec<LaneChangeEvent>, TableError> {
        let folder = std::env::temp_dir().join(format!("lanecraft-events-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("events.csv"), events).unwrap();
        let mut packed = GzEncoder::new(Vec::new(), Compression::default());
        packed.write_all(tracks.as_bytes()).unwrap();
        let packed = packed.finish().unwrap();
        std::fs::write(folder.join("tracks.csv.gz"), &packed[..packed.len() - cut_bytes]).unwrap();
        let result = read_events(&folder);
        std::fs::remove_dir_all(&folder).unwrap();
        result
    }

    #[test]
    fn an_event_comes_with_its_tracks() {
        let events = read("good", EVENTS, TRACKS, 0).unwrap();
        assert_eq!(events.len(), 1);
        let event = &events[0];
        assert_eq!((event.site.as_str(), event.side, event.road), ("here", Side::Left, RoadKind::Freeway));
        assert_eq!((event.ego.vehicle_id, event.neighbors.len()), (7, 1));
        assert_eq!(event.ego.position_m(0.0), (40.0, 1.75));
        // Beyond its track a vehicle keeps its speed.
        assert_eq!(event.neighbors[0].position_m(1.0), (84.0, 3.5));
        assert_eq!(event.neighbors[0].position_m(-3.0), (12.0, 3.5));
    }

    #[test]
    fn whatever_is_wrong_is_named_with_its_place() {
        let wrong = |name: &str, events: &str, tracks: &str, expected: &str| {
            let message = read(name, events, tracks, 0).unwrap_err().to_string();
            assert!(message.contains(expected), "{name}: {message}");
        };
        let swap = |text: &str, from: &str, to: &str| {
            assert!(text.contains(from));
            text.replacen(from, to, 1)
        };
        wrong("nan", EVENTS, &swap(TRACKS, "80.0", "NaN"), "tracks.csv.gz, line 3: column `s_m`: `NaN` is no number");
        wrong("missing", EVENTS, &swap(TRACKS, "18.0", ""), "line 4: column `vs_mps`: `` is no number");
        wrong("range", &swap(EVENTS, "2.0,0.0", "-3.0,0.0"), TRACKS, "events.csv, line 2: column `t_end_s`");
        wrong("column", &swap(EVENTS, "d_end_m", "d_last_m"), TRACKS, "events.csv, line 1: has no column `d_end_m`");
        wrong("word", &swap(EVENTS, "left", "up"), TRACKS, "`up` is none of [\"left\", \"right\"]");
        wrong("short", EVENTS, &swap(TRACKS, "e1,7,2.0,80.0,", "e1,7,"), "line 3: cannot be read");
        wrong("empty", EVENTS, "", "has no column `event_id`");
        wrong("header", EVENTS, TRACKS.lines().next().unwrap(), "holds no rows");
        wrong("none", EVENTS.lines().next().unwrap(), TRACKS, "events.csv, line 0: holds no rows");
        wrong("order", EVENTS, &swap(TRACKS, "e1,7,2.0", "e1,7,-2.0"), "line 3: `7`: the times");
        wrong("ego", &swap(EVENTS, ",7,", ",8,"), TRACKS, "`e1`: the ego has no track");
        wrong("other", &swap(EVENTS, "e1", "e2"), TRACKS, "`e2`: has no tracks");
        let twice = format!("{EVENTS}{}", EVENTS.lines().nth(1).unwrap());
        wrong("twice", &twice, TRACKS, "line 3: `e1`: has no tracks, or appears twice");
        wrong("extra", EVENTS, &format!("{TRACKS}e3,1,0,0,0,0,4,2\n"), "`e3`: has tracks but no row here");
    }

    #[test]
    fn a_file_that_was_cut_off_or_is_not_there_is_an_error() {
        let cut = read("cut", EVENTS, TRACKS, 12).unwrap_err();
        assert!(matches!(cut.kind, TableErrorKind::Row(_)), "{cut}");
        let absent = read_events(Path::new("no/such/folder")).unwrap_err();
        assert!(matches!(absent.kind, TableErrorKind::Open(_)) && absent.to_string().contains("tracks.csv.gz"));
    }
}
