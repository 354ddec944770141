//! Traces on disk: JSON Lines, the header on the first line and one tick on each further line, so that a file can be read,
//! cut and compared line by line. A name that ends in `.gz` is compressed.
//!
//! Numbers are written with as many digits as it takes to read the same bits back. The reader is strict: an unknown or missing
//! key, a blank line, another schema, a line that is too long or a compressed file cut short is an error that names the line.

use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use flate2::{Compression, GzBuilder, read::MultiGzDecoder, write::GzEncoder};
use lanecraft_drive::env::{Frame, TRACE_SCHEMA, TickRecord, Trace, TraceHeader, VehicleFrame};
use serde::{Serialize, de::DeserializeOwned};

/// Longest line that is read, bytes: a tick of 10 control steps with 500 vehicles takes less than 1 MiB.
const MAX_LINE_BYTES: u64 = 16 << 20;

/// Why a trace could not be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TraceFileError {
    /// The file cannot be opened or created.
    #[error("{}: cannot open the trace", .path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Reading or writing failed part way, for example because the compressed file was cut short.
    #[error("{}:{line}: cannot read or write the trace", .path.display())]
    Transfer {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// The system's reason.
        source: io::Error,
    },
    /// A line is not the JSON that a trace has there.
    #[error("{}:{line}: not {expected}", .path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What the line should hold.
        expected: &'static str,
        /// Where in the line and why; its own line number counts within the line.
        source: serde_json::Error,
    },
    /// The header is of another version of the format.
    #[error("{}:1: trace schema {found}, but only {TRACE_SCHEMA} can be read", .path.display())]
    Schema {
        /// The file.
        path: PathBuf,
        /// Its schema.
        found: u32,
    },
    /// A line is longer than any that this program writes.
    #[error("{}:{line}: the line is longer than {MAX_LINE_BYTES} bytes", .path.display())]
    LongLine {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
    },
    /// The last line does not end in a line break, so the writer was interrupted.
    #[error("{}:{line}: the last line is cut short", .path.display())]
    CutShort {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
    },
    /// A number that JSON has no word for.
    #[error("{}:{line}: `{field}` is not finite, which a trace cannot hold", .path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// The line it would have been, from 1.
        line: usize,
        /// The field.
        field: &'static str,
    },
}

/// Writes a trace, compressed if the name ends in `.gz`. Equal traces give equal bytes.
///
/// # Errors
/// If the file cannot be written, or a number of the trace is not finite.
pub fn write_trace(path: &Path, trace: &Trace) -> Result<(), TraceFileError> {
    check_finite(path, trace)?;
    let file = File::create(path).map_err(|source| TraceFileError::Open { path: path.into(), source })?;
    let file = BufWriter::new(file);
    if is_compressed(path) {
        // No time stamp and no name in the gzip header, so that equal traces give equal bytes.
        let mut encoder: GzEncoder<_> = GzBuilder::new().write(file, Compression::default());
        write_lines(path, trace, &mut encoder)?;
        let mut file = encoder.finish().map_err(|e| transfer(path, trace.ticks.len() + 1, e))?;
        return file.flush().map_err(|e| transfer(path, trace.ticks.len() + 1, e));
    }
    write_lines(path, trace, file)
}

/// Reads a trace, decompressed if the name ends in `.gz`.
///
/// # Errors
/// If the file cannot be read or is not exactly what [`write_trace`] writes; the error names the line.
pub fn read_trace(path: &Path) -> Result<Trace, TraceFileError> {
    let file = File::open(path).map_err(|source| TraceFileError::Open { path: path.into(), source })?;
    if is_compressed(path) { read_lines(path, MultiGzDecoder::new(file)) } else { read_lines(path, file) }
}

fn is_compressed(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "gz")
}

fn transfer(path: &Path, line: usize, source: io::Error) -> TraceFileError {
    TraceFileError::Transfer { path: path.into(), line, source }
}

fn write_lines(path: &Path, trace: &Trace, mut to: impl Write) -> Result<(), TraceFileError> {
    write_line(path, 1, &trace.header, &mut to)?;
    for (index, tick) in trace.ticks.iter().enumerate() {
        write_line(path, index + 2, tick, &mut to)?;
    }
    to.flush().map_err(|e| transfer(path, trace.ticks.len() + 1, e))
}

fn write_line(path: &Path, line: usize, value: &impl Serialize, to: &mut impl Write) -> Result<(), TraceFileError> {
    serde_json::to_writer(&mut *to, value).map_err(|e| transfer(path, line, e.into()))?;
    to.write_all(b"\n").map_err(|e| transfer(path, line, e))
}

fn read_lines(path: &Path, from: impl Read) -> Result<Trace, TraceFileError> {
    let mut lines = Lines { path, from: BufReader::new(from), line: 0 };
    let header: TraceHeader = match lines.next_line()? {
        Some(text) => parse_header(path, &text)?,
        None => return Err(TraceFileError::CutShort { path: path.into(), line: 1 }),
    };
    let mut ticks = Vec::new();
    while let Some(text) = lines.next_line()? {
        ticks.push(parse::<TickRecord>(path, lines.line, "a tick of a trace", &text)?);
    }
    Ok(Trace { header, ticks })
}

/// The header; of another schema, only its number is read, since its keys may differ.
fn parse_header(path: &Path, text: &[u8]) -> Result<TraceHeader, TraceFileError> {
    #[derive(serde::Deserialize)]
    struct Version {
        schema: u32,
    }
    let expected = "the header of a trace";
    let Version { schema } = parse(path, 1, expected, text)?;
    if schema != TRACE_SCHEMA {
        return Err(TraceFileError::Schema { path: path.into(), found: schema });
    }
    parse(path, 1, expected, text)
}

fn parse<T: DeserializeOwned>(
    path: &Path,
    line: usize,
    expected: &'static str,
    text: &[u8],
) -> Result<T, TraceFileError> {
    serde_json::from_slice(text).map_err(|source| TraceFileError::Json { path: path.into(), line, expected, source })
}

struct Lines<'a, R> {
    path: &'a Path,
    from: BufReader<R>,
    /// Number of the line read last, from 1.
    line: usize,
}

impl<R: Read> Lines<'_, R> {
    fn next_line(&mut self) -> Result<Option<Vec<u8>>, TraceFileError> {
        self.line += 1;
        let mut text = Vec::new();
        let limited = &mut (&mut self.from).take(MAX_LINE_BYTES);
        limited.read_until(b'\n', &mut text).map_err(|e| transfer(self.path, self.line, e))?;
        match text.pop() {
            None => Ok(None),
            Some(b'\n') => Ok(Some(text)),
            Some(_) if text.len() as u64 + 1 == MAX_LINE_BYTES => {
                Err(TraceFileError::LongLine { path: self.path.into(), line: self.line })
            }
            Some(_) => Err(TraceFileError::CutShort { path: self.path.into(), line: self.line }),
        }
    }
}

fn check_finite(path: &Path, trace: &Trace) -> Result<(), TraceFileError> {
    let refuse = |line, field| Err(TraceFileError::NotFinite { path: path.into(), line, field });
    if let Some(field) = header_not_finite(&trace.header) {
        return refuse(1, field);
    }
    for (index, tick) in trace.ticks.iter().enumerate() {
        if let Some(field) = tick_not_finite(tick).or_else(|| tick.frames.iter().find_map(frame_not_finite)) {
            return refuse(index + 2, field);
        }
    }
    Ok(())
}

type Named = (&'static str, f64);

fn first_not_finite(values: &[Named]) -> Option<&'static str> {
    values.iter().find(|(_, value)| !value.is_finite()).map(|(name, _)| *name)
}

fn header_not_finite(header: &TraceHeader) -> Option<&'static str> {
    first_not_finite(&[
        ("lane_width_m", header.lane_width_m),
        ("ring_length_m", header.ring_length_m),
        ("ego_length_m", header.ego_length_m),
        ("ego_width_m", header.ego_width_m),
        ("control_period_s", header.control_period_s),
        ("decision_period_s", header.decision_period_s),
    ])
}

fn tick_not_finite(tick: &TickRecord) -> Option<&'static str> {
    let mut values: Vec<Named> = vec![("score", tick.score)];
    for candidate in &tick.candidates {
        values.extend(candidate.coefficients.map(|c| ("candidates.coefficients", c)));
        values.extend([("candidates.duration_s", candidate.duration_s), ("candidates.reward", candidate.reward)]);
    }
    if let Some(path) = &tick.path {
        values.extend(path.coefficients.map(|c| ("path.coefficients", c)));
        values.extend([("path.duration_s", path.duration_s), ("path.elapsed_s", path.elapsed_s)]);
    }
    first_not_finite(&values)
}

fn frame_not_finite(frame: &Frame) -> Option<&'static str> {
    let ego = &frame.ego;
    let vehicle = |v: &VehicleFrame| {
        first_not_finite(&[
            ("vehicles.ahead_m", v.ahead_m),
            ("vehicles.d_m", v.d_m),
            ("vehicles.speed_mps", v.speed_mps),
            ("vehicles.length_m", v.length_m),
            ("vehicles.width_m", v.width_m),
        ])
    };
    first_not_finite(&[
        ("time_s", frame.time_s),
        ("ego.s_m", ego.s_m),
        ("ego.d_m", ego.d_m),
        ("ego.heading_rad", ego.heading_rad),
        ("ego.speed_mps", ego.speed_mps),
        ("ego.sideslip_rad", ego.sideslip_rad),
        ("ego.yaw_rate_radps", ego.yaw_rate_radps),
        ("ego.accel_mps2", ego.accel_mps2),
        ("ego.steer_rad", ego.steer_rad),
    ])
    .or_else(|| frame.vehicles.iter().find_map(vehicle))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lanecraft_drive::control::GuardCause;
    use lanecraft_drive::env::{CandidateRecord, EgoFrame, PathRecord};
    use std::fs;

    fn trace() -> Trace {
        // Thirds and the smallest number need all digits to come back.
        let ego = EgoFrame {
            s_m: 1.0 / 3.0,
            d_m: 3.75,
            heading_rad: 1e-3 / 7.0,
            speed_mps: 29.0,
            sideslip_rad: -0.0,
            yaw_rate_radps: f64::MIN_POSITIVE,
            accel_mps2: -2.0 / 3.0,
            steer_rad: 0.1,
            guard: Some(GuardCause::OtherLane),
        };
        let vehicle = VehicleFrame { id: 3, ahead_m: 40.1, d_m: 0.0, speed_mps: 22.2, length_m: 4.5, width_m: 1.8 };
        let coefficients = [0.0, 0.0, 0.0, 0.1, -0.02, 1e-3];
        let tick = |index: u32| TickRecord {
            action: 4,
            action_name: "change left \"q2\"=0.001\n".into(),
            mask: 0b1_0111,
            candidates: vec![CandidateRecord { coefficients, duration_s: 4.2, reward: -1.5, chosen: true }],
            path: (index > 0).then_some(PathRecord { coefficients, duration_s: 4.2, elapsed_s: 0.5 }),
            score: 18.25,
            frames: vec![Frame {
                time_s: 0.05 * f64::from(index + 1),
                ego,
                vehicles: vec![vehicle],
                digest: "0123456789abcdef".into(),
            }],
        };
        let header = TraceHeader {
            schema: TRACE_SCHEMA,
            version: "0.1.0".into(),
            policy: "rule:best-lane".into(),
            scenario_seed: u64::MAX,
            config_toml: "a = 1\nb = 2\n".into(),
            lanes: 3,
            lane_width_m: 3.75,
            ring_length_m: 0.0,
            ego_length_m: 4.5,
            ego_width_m: 1.8,
            control_period_s: 0.05,
            decision_period_s: 0.5,
        };
        Trace { header, ticks: (0..3).map(tick).collect() }
    }

    /// Writes the sample, applies `edit` to its text, and reads it again.
    fn read_edited(edit: impl Fn(String) -> String) -> Result<Trace, TraceFileError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jsonl");
        write_trace(&path, &trace()).unwrap();
        fs::write(&path, edit(fs::read_to_string(&path).unwrap())).unwrap();
        read_trace(&path)
    }

    #[test]
    fn a_trace_comes_back_bit_for_bit_and_bytes_are_reproducible() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.jsonl", "a.jsonl.gz"] {
            let path = folder.path().join(name);
            write_trace(&path, &trace()).unwrap();
            let back = read_trace(&path).unwrap();
            assert_eq!(back, trace());
            assert!(back.ticks[0].frames[0].ego.sideslip_rad.is_sign_negative());
            let bytes = fs::read(&path).unwrap();
            write_trace(&path, &back).unwrap();
            assert_eq!(fs::read(&path).unwrap(), bytes);
            assert_eq!(bytes.starts_with(&[0x1f, 0x8b]), is_compressed(&path));
        }
    }

    #[test]
    fn one_line_for_the_header_and_each_tick() {
        read_edited(|text| {
            assert_eq!(text.lines().count(), 4);
            text
        })
        .unwrap();
    }

    #[test]
    fn broken_lines_are_named() {
        let unknown = read_edited(|t| t.replacen("\"score\"", "\"scores\"", 2).replacen("\"scores\"", "\"score\"", 1));
        assert!(matches!(unknown, Err(TraceFileError::Json { line: 3, .. })), "{unknown:?}");
        let null = read_edited(|t| t.replacen("29.0", "null", 1));
        assert!(matches!(null, Err(TraceFileError::Json { line: 2, .. })), "{null:?}");
        let blank = read_edited(|t| t + "\n");
        assert!(matches!(blank, Err(TraceFileError::Json { line: 5, .. })), "{blank:?}");
        let two = read_edited(|t| t.replacen("}\n{", "} {", 1));
        assert!(matches!(two, Err(TraceFileError::Json { line: 1, .. })), "{two:?}");
        let message = read_edited(|t| t.replacen("29.0", "null", 1)).unwrap_err().to_string();
        assert!(message.ends_with("a.jsonl:2: not a tick of a trace"), "{message}");
    }

    #[test]
    fn other_schemas_and_interrupted_files_are_refused() {
        let schema = read_edited(|t| t.replacen("\"schema\":2", "\"schema\":1,\"more\":0", 1));
        assert!(matches!(schema, Err(TraceFileError::Schema { found: 1, .. })), "{schema:?}");
        assert!(matches!(read_edited(|_| String::new()), Err(TraceFileError::CutShort { line: 1, .. })));
        let cut = read_edited(|t| t[..t.len() - 1].into());
        assert!(matches!(cut, Err(TraceFileError::CutShort { line: 4, .. })), "{cut:?}");
    }

    #[test]
    fn a_compressed_file_cut_short_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gz");
        write_trace(&path, &trace()).unwrap();
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..bytes.len() - 12]).unwrap();
        assert!(matches!(read_trace(&path), Err(TraceFileError::Transfer { .. })));
        assert!(matches!(read_trace(&folder.path().join("none")), Err(TraceFileError::Open { .. })));
    }

    #[test]
    fn numbers_that_json_lacks_are_refused_before_the_file_is_touched() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jsonl");
        let mut bad = trace();
        bad.ticks[1].frames[0].vehicles[0].ahead_m = f64::NAN;
        let error = write_trace(&path, &bad).unwrap_err();
        assert!(matches!(error, TraceFileError::NotFinite { line: 3, field: "vehicles.ahead_m", .. }), "{error}");
        assert!(!path.exists());
    }
}
