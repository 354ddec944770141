//! The file of demonstrations: JSON lines, a header and one lane change a line, compressed if the name ends in `.gz`.
//!
//! ```text
//! {"format":"lanecraft-demonstrations","version":1,"source":"…","known_reward":null}
//! {"id":"…","group":"…","device":"camera","start_s":-1.7,"end_s":1.9,"start_d_m":0.9,"end_d_m":-2.3,"target_d_m":-2.4,
//!  "ego":{"vehicle_id":1,"length_m":4.5,"width_m":1.8,"t_s":[…],"s_m":[…],"d_m":[…],"speed_mps":[…]},"others":[…]}
//! ```

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Write as _};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;
use lanecraft_drive::plan::{RewardError, RewardModel};
use serde::{Deserialize, Serialize};

use super::{Demonstration, Demonstrations, Device};
use crate::data::content;
use crate::data::events::{Track, TrackPoint};
use crate::run_dir::{RunDirError, atomic};

/// What the header calls the format.
const FORMAT: &str = "lanecraft-demonstrations";
/// Version of the format.
pub const DEMONSTRATIONS_VERSION: u32 = 1;

/// Longest gap in the ego's track during the change, s.
const LONGEST_GAP_S: f64 = 0.5;
/// Shares of the way by positions over the way by speeds that are believed.
const SPEED_RATIOS: (f64, f64) = (0.8, 1.25);
/// Speed from which they are compared, m/s.
const FAST_MPS: f64 = 3.0;

/// A file of demonstrations that cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// Something is wrong in a line.
    #[error("{}, line {line}: {kind}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: u64,
        /// What is wrong.
        kind: LineError,
    },
    /// It could not be written.
    #[error(transparent)]
    Write(#[from] RunDirError),
}

/// What is wrong in a line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LineError {
    /// It cannot be read: the file is not there, cut off or no text.
    #[error("cannot be read: {0}")]
    Read(#[source] std::io::Error),
    /// It is no JSON of this form; the message names the column.
    #[error("{0}")]
    Json(#[source] serde_json::Error),
    /// The header names another format.
    #[error("is `{found}`, not `{FORMAT}`")]
    Format {
        /// What it names.
        found: String,
    },
    /// Another version.
    #[error("has version {found} of the format, but only version {DEMONSTRATIONS_VERSION} can be read")]
    Version {
        /// The version found.
        found: u32,
    },
    /// The known reward cannot be used.
    #[error("`known_reward`: {0}")]
    Reward(#[source] RewardError),
    /// A number outside its range.
    #[error("`{field}` is {value}, but must be in {min}..={max}")]
    Range {
        /// Name of the field.
        field: &'static str,
        /// The value.
        value: f64,
        /// Smallest allowed value.
        min: f64,
        /// Largest allowed value.
        max: f64,
    },
    /// A change that ends before it begins, or at once.
    #[error("the change begins at {start_s} s and ends at {end_s} s: its duration must be positive")]
    Duration {
        /// Begin, s.
        start_s: f64,
        /// End, s.
        end_s: f64,
    },
    /// Columns of a track with different numbers of values, or none.
    #[error("the columns of vehicle {vehicle_id} have {counts:?} values; they must have as many, at least one")]
    Columns {
        /// Which vehicle.
        vehicle_id: u32,
        /// Values of `t_s`, `s_m`, `d_m` and `speed_mps`.
        counts: [usize; 4],
    },
    /// Times that do not rise.
    #[error("the times of vehicle {vehicle_id} do not rise after {time_s} s")]
    Times {
        /// Which vehicle.
        vehicle_id: u32,
        /// After which time, s.
        time_s: f64,
    },
    /// The ego's track has a gap during the change, or does not cover it.
    #[error(
        "the ego's track has no point for {gap_s:.1} s after {time_s:.1} s, during the change; at most {LONGEST_GAP_S} s are allowed"
    )]
    Gap {
        /// After which time, s.
        time_s: f64,
        /// How long, s.
        gap_s: f64,
    },
    /// Positions and speeds that cannot be in the same unit.
    #[error(
        "the ego's way by positions is {ratio:.2} of that by speeds, not in {}..={}: the units are mixed",
        SPEED_RATIOS.0,
        SPEED_RATIOS.1
    )]
    Units {
        /// The ratio.
        ratio: f64,
    },
    /// An id or a vehicle that was there.
    #[error("{what} `{id}` appears twice")]
    Twice {
        /// What it names.
        what: &'static str,
        /// The id.
        id: String,
    },
    /// No lane change after the header.
    #[error("holds no demonstrations")]
    Empty,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    format: String,
    version: u32,
    source: String,
    known_reward: Option<RewardModel>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    id: String,
    group: String,
    device: Device,
    start_s: f64,
    end_s: f64,
    start_d_m: f64,
    end_d_m: f64,
    target_d_m: f64,
    ego: Columns,
    others: Vec<Columns>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Columns {
    vehicle_id: u32,
    length_m: f64,
    width_m: f64,
    t_s: Vec<f64>,
    s_m: Vec<f64>,
    d_m: Vec<f64>,
    speed_mps: Vec<f64>,
}

/// Reads the file at `path`.
///
/// # Errors
/// Whatever is wrong, with its line.
pub fn read(path: &Path) -> Result<Demonstrations, FileError> {
    let mut number = 0;
    read_lines(path, &mut number).map_err(|kind| FileError::Line { path: path.to_owned(), line: number, kind })
}

/// The same, with the number of the line that was read last.
fn read_lines(path: &Path, number: &mut u64) -> Result<Demonstrations, LineError> {
    let mut lines = BufReader::new(content(path).map_err(LineError::Read)?).lines();
    let mut next = || {
        let line = lines.next().transpose();
        *number += 1;
        line.map_err(LineError::Read)
    };
    let header: Header = serde_json::from_str(&next()?.ok_or(LineError::Empty)?).map_err(LineError::Json)?;
    if header.format != FORMAT {
        return Err(LineError::Format { found: header.format });
    }
    if header.version != DEMONSTRATIONS_VERSION {
        return Err(LineError::Version { found: header.version });
    }
    header.known_reward.as_ref().map_or(Ok(()), RewardModel::validate).map_err(LineError::Reward)?;
    let mut ids = BTreeSet::new();
    let mut items = Vec::new();
    while let Some(text) = next()? {
        let item = demonstration(serde_json::from_str(&text).map_err(LineError::Json)?)?;
        if !ids.insert(item.id.clone()) {
            return Err(LineError::Twice { what: "demonstration", id: item.id });
        }
        items.push(item);
    }
    if items.is_empty() {
        return Err(LineError::Empty);
    }
    Ok(Demonstrations { source: header.source, known_reward: header.known_reward, items })
}

fn in_range(field: &'static str, value: f64, (min, max): (f64, f64)) -> Result<f64, LineError> {
    if (min..=max).contains(&value) { Ok(value) } else { Err(LineError::Range { field, value, min, max }) }
}

/// Allowed times, s.
const TIMES_S: (f64, f64) = (-1e6, 1e6);
/// Allowed lateral positions, m.
const LATERAL_M: (f64, f64) = (-1e3, 1e3);
/// Longest change, s.
const LONGEST_S: f64 = 60.0;

fn demonstration(line: Line) -> Result<Demonstration, LineError> {
    let start_s = in_range("start_s", line.start_s, TIMES_S)?;
    let end_s = in_range("end_s", line.end_s, TIMES_S)?;
    if end_s <= start_s {
        return Err(LineError::Duration { start_s, end_s });
    }
    in_range("end_s − start_s", end_s - start_s, (0.0, LONGEST_S))?;
    let ego = track(line.ego)?;
    let mut vehicles = BTreeSet::from([ego.vehicle_id]);
    let mut others = Vec::with_capacity(line.others.len());
    for columns in line.others {
        if !vehicles.insert(columns.vehicle_id) {
            return Err(LineError::Twice { what: "vehicle", id: columns.vehicle_id.to_string() });
        }
        others.push(track(columns)?);
    }
    let item = Demonstration {
        id: line.id,
        group: line.group,
        device: line.device,
        start_s,
        end_s,
        start_d_m: in_range("start_d_m", line.start_d_m, LATERAL_M)?,
        end_d_m: in_range("end_d_m", line.end_d_m, LATERAL_M)?,
        target_d_m: in_range("target_d_m", line.target_d_m, LATERAL_M)?,
        ego,
        others,
    };
    check_gaps(&item)?;
    check_units(&item)?;
    in_range("mean speed", item.mean_speed_mps(), (0.5, 120.0))?;
    Ok(item)
}

fn track(columns: Columns) -> Result<Track, LineError> {
    let Columns { vehicle_id, length_m, width_m, t_s, s_m, d_m, speed_mps } = columns;
    let counts = [t_s.len(), s_m.len(), d_m.len(), speed_mps.len()];
    if counts[0] == 0 || counts.iter().any(|count| *count != counts[0]) {
        return Err(LineError::Columns { vehicle_id, counts });
    }
    if let Some(pair) = t_s.windows(2).find(|pair| pair[1] <= pair[0]) {
        return Err(LineError::Times { vehicle_id, time_s: pair[0] });
    }
    let point = |index: usize| {
        Ok(TrackPoint {
            time_s: in_range("t_s", t_s[index], TIMES_S)?,
            s_m: in_range("s_m", s_m[index], (-1e6, 1e6))?,
            d_m: in_range("d_m", d_m[index], LATERAL_M)?,
            speed_mps: in_range("speed_mps", speed_mps[index], (-20.0, 120.0))?,
        })
    };
    Ok(Track {
        vehicle_id,
        length_m: in_range("length_m", length_m, (0.1, 50.0))?,
        width_m: in_range("width_m", width_m, (0.1, 50.0))?,
        points: (0..counts[0]).map(point).collect::<Result<_, _>>()?,
    })
}

/// The ego must be seen all through the change.
fn check_gaps(item: &Demonstration) -> Result<(), LineError> {
    let inside = item.ego.points.iter().map(|point| point.time_s);
    let mut last_s = item.start_s;
    for time_s in inside.filter(|time_s| (item.start_s..=item.end_s).contains(time_s)).chain([item.end_s]) {
        let gap_s = time_s - last_s;
        // The slack is the rounding of times in decimal.
        if gap_s > LONGEST_GAP_S + 1e-6 {
            return Err(LineError::Gap { time_s: last_s, gap_s });
        }
        last_s = time_s;
    }
    Ok(())
}

/// Positions and speeds of the ego must tell of the same way.
fn check_units(item: &Demonstration) -> Result<(), LineError> {
    let (mut by_positions_m, mut by_speeds_m, mut time_s) = (0.0, 0.0, 0.0);
    for pair in item.ego.points.windows(2) {
        let step_s = pair[1].time_s - pair[0].time_s;
        by_positions_m += (pair[1].s_m - pair[0].s_m).abs();
        by_speeds_m += 0.5 * step_s * (pair[0].speed_mps.abs() + pair[1].speed_mps.abs());
        time_s += step_s;
    }
    let ratio = by_positions_m / by_speeds_m.max(1e-9);
    let moves = by_positions_m.max(by_speeds_m) > FAST_MPS * time_s;
    if moves && !(SPEED_RATIOS.0..=SPEED_RATIOS.1).contains(&ratio) {
        return Err(LineError::Units { ratio });
    }
    Ok(())
}

/// Writes `demonstrations` to `path`, compressed if its name ends in `.gz`.
///
/// # Errors
/// If the file cannot be written.
pub fn write(path: &Path, demonstrations: &Demonstrations) -> Result<(), FileError> {
    let header = Header {
        format: FORMAT.to_owned(),
        version: DEMONSTRATIONS_VERSION,
        source: demonstrations.source.clone(),
        known_reward: demonstrations.known_reward.clone(),
    };
    let plain = "plain numbers and names serialize";
    let mut text = serde_json::to_vec(&header).expect(plain);
    text.push(b'\n');
    for item in &demonstrations.items {
        serde_json::to_writer(&mut text, &line(item)).expect(plain);
        text.push(b'\n');
    }
    if path.extension().is_some_and(|end| end == "gz") {
        let mut packed = GzEncoder::new(Vec::new(), Compression::default());
        let written = packed.write_all(&text).and_then(|()| packed.finish());
        text = written.map_err(RunDirError::io("pack", path))?;
    }
    Ok(atomic::write(path, &text)?)
}

fn line(item: &Demonstration) -> Line {
    Line {
        id: item.id.clone(),
        group: item.group.clone(),
        device: item.device,
        start_s: item.start_s,
        end_s: item.end_s,
        start_d_m: item.start_d_m,
        end_d_m: item.end_d_m,
        target_d_m: item.target_d_m,
        ego: columns(&item.ego),
        others: item.others.iter().map(columns).collect(),
    }
}

fn columns(track: &Track) -> Columns {
    let column = |of: fn(&TrackPoint) -> f64| track.points.iter().map(of).collect();
    Columns {
        vehicle_id: track.vehicle_id,
        length_m: track.length_m,
        width_m: track.width_m,
        t_s: column(|point| point.time_s),
        s_m: column(|point| point.s_m),
        d_m: column(|point| point.d_m),
        speed_mps: column(|point| point.speed_mps),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::candidates::CandidateConfig;
    use crate::demonstrations::synthetic::{SyntheticConfig, synthetic};

    fn few() -> Demonstrations {
        let mut made = synthetic(&SyntheticConfig::default(), &CandidateConfig::default(), 1, 5);
        // One of each kind, as if driven.
        for (item, device) in made.items.iter_mut().zip(Device::ALL) {
            item.device = device;
        }
        made
    }

    fn written(made: &Demonstrations, name: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        write(&path, made).unwrap();
        (folder, path)
    }

    #[test]
    fn all_kinds_survive_a_file_bit_for_bit() {
        for name in ["d.jsonl", "d.jsonl.gz"] {
            let (_folder, path) = written(&few(), name);
            let found = read(&path).unwrap();
            assert_eq!(found, few());
            assert_eq!(found.devices(), Device::ALL);
        }
    }

    #[test]
    fn whatever_is_wrong_is_named_with_its_line() {
        let (_folder, path) = written(&few(), "d.jsonl");
        let good = std::fs::read_to_string(&path).unwrap();
        let wrong = |line: usize, from: &str, to: &str, expected: &str| {
            let mut lines: Vec<String> = good.lines().map(str::to_owned).collect();
            assert!(lines[line].contains(from), "{}", lines[line]);
            lines[line] = lines[line].replacen(from, to, 1);
            std::fs::write(&path, lines.join("\n")).unwrap();
            let message = read(&path).unwrap_err().to_string();
            assert!(message.contains(&format!("line {}: ", line + 1)) && message.contains(expected), "{message}");
        };
        wrong(0, "lanecraft-demonstrations", "csv", "is `csv`, not `lanecraft-demonstrations`");
        wrong(0, "\"version\":1", "\"version\":9", "version 9 of the format");
        wrong(0, "\"stability\"", "\"mood\"", "`known_reward`: the reward's features are [\"mood\"");
        wrong(1, "\"device\":\"camera\"", "\"device\":\"kite\"", "unknown variant `kite`");
        wrong(2, "\"start_s\":0.0", "\"start_s\":99.0", "duration must be positive");
        wrong(2, "\"start_s\":0.0", "\"start_s\":1e999", "column");
        wrong(2, "\"width_m\":", "\"width_ft\":", "unknown field `width_ft`");
        wrong(3, "\"length_m\":4.8", "\"length_m\":4800.0", "`length_m` is 4800, but must be in 0.1..=50");
        wrong(3, "\"t_s\":[0.0,", "\"t_s\":[", "as many, at least one");
        wrong(3, "\"t_s\":[0.0,0.1,", "\"t_s\":[0.0,0.0,", "do not rise after 0 s");
        wrong(4, "\"id\":\"driver 3\"", "\"id\":\"driver 2\"", "demonstration `driver 2` appears twice");
        wrong(4, "\"vehicle_id\":2", "\"vehicle_id\":1", "vehicle `1` appears twice");
        wrong(5, "}", "", "column");
    }

    #[test]
    fn gaps_mixed_units_and_empty_or_truncated_files_are_errors() {
        let message = |made: &Demonstrations| {
            let (_folder, path) = written(made, "d.jsonl");
            read(&path).unwrap_err().to_string()
        };
        let mut gap = few();
        gap.items[1].ego.points.drain(5..12);
        assert!(
            message(&gap).contains("line 3: the ego's track has no point for 0.8 s after 0.4 s"),
            "{}",
            message(&gap)
        );
        let mut feet = few();
        feet.items[0].ego.points.iter_mut().for_each(|point| point.s_m /= 0.3048);
        assert!(message(&feet).contains("line 2: the ego's way by positions is 3.28 of that by speeds"));
        assert!(message(&Demonstrations { items: vec![], ..few() }).contains("line 2: holds no demonstrations"));
        let (_folder, path) = written(&few(), "d.jsonl.gz");
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("cannot be read"));
        std::fs::write(&path, "").unwrap();
        assert!(read(&path).is_err());
        assert!(read(Path::new("no/such/file")).unwrap_err().to_string().contains("cannot be read"));
    }
}
