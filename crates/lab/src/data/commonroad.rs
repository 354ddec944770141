//! CommonRoad 2020a (Althoff et al. 2017): the trajectories of dynamic obstacles. Lanes, signs and planning problems are passed over.
//!
//! The file is read as a stream of tags, of which only the open ones and one obstacle are held besides the samples that are kept.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::collect::{Collector, Held, Row, Source};
use super::error::{DataError, XmlErrorKind};
use super::events::RoadKind;
use super::recording::{Format, Oddity};
use super::table::{TableError, TableErrorKind};

/// Allowed positions, m.
const POSITIONS_M: (f64, f64) = (-1e7, 1e7);
/// Allowed sizes, m.
const SIZES_M: (f64, f64) = (0.1, 50.0);
/// Allowed speeds, m/s: an obstacle may move back.
const SPEEDS_MPS: (f64, f64) = (-120.0, 120.0);
/// Allowed numbers of a time step.
const STEPS: (f64, f64) = (0.0, 1e9);
/// Allowed time steps, s.
const STEPS_S: (f64, f64) = (0.01, 1.0);
/// Types of obstacles with a motor, all that keep to lanes.
const MOTOR_VEHICLES: [&str; 7] = ["car", "truck", "bus", "motorcycle", "priorityVehicle", "taxi", "unknown"];

/// Hands the rows of the file at `path` to `collector`, as the site `name`.
pub(super) fn read<S: Held>(path: &Path, name: &str, collector: &mut Collector<'_, S>) -> Result<Source, DataError> {
    let file = super::table::content(path).map_err(|error| open_error(path, error))?;
    let counted = CountedLines { inner: BufReader::new(file), line: 1, column: 1 };
    let mut parser = Parser {
        path,
        name,
        reader: Reader::from_reader(counted),
        open: String::new(),
        text: String::new(),
        text_at: (1, 1),
        rate_hz: 0.0,
        urban: false,
        ids: BTreeSet::new(),
        obstacle: None,
        collector,
    };
    let mut buffer = Vec::new();
    while parser.step(&mut buffer)? {
        buffer.clear();
    }
    let road: fn(&str) -> RoadKind = if parser.urban { |_| RoadKind::Arterial } else { |_| RoadKind::Freeway };
    Ok(Source { format: Format::Commonroad, rate_hz: parser.rate_hz, road })
}

fn open_error(path: &Path, error: std::io::Error) -> TableError {
    TableError { path: path.to_owned(), line: 0, kind: TableErrorKind::Open(error) }
}

/// A reader that knows in which line it is.
struct CountedLines<R> {
    inner: R,
    line: u64,
    column: u64,
}

impl<R: BufRead> Read for CountedLines<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let input = self.fill_buf()?;
        let count = input.len().min(out.len());
        out[..count].copy_from_slice(&input[..count]);
        self.consume(count);
        Ok(count)
    }
}

impl<R: BufRead> BufRead for CountedLines<R> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        self.inner.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        // What is consumed was filled before; if it cannot be had again, the position stays behind.
        for &byte in self.inner.fill_buf().unwrap_or_default().iter().take(count) {
            (self.line, self.column) = if byte == b'\n' { (self.line + 1, 1) } else { (self.line, self.column + 1) };
        }
        self.inner.consume(count);
    }
}

/// A dynamic obstacle that is being read.
#[derive(Default)]
struct Obstacle {
    id: u32,
    kind: String,
    length_m: Option<f64>,
    width_m: Option<f64>,
    state: State,
    rows: Vec<Row>,
    inexact: u64,
}

/// A state that is being read.
#[derive(Clone, Copy, Default)]
struct State {
    x_m: Option<f64>,
    y_m: Option<f64>,
    frame: Option<f64>,
    speed_mps: Option<f64>,
}

struct Parser<'a, 'b, R, S> {
    path: &'a Path,
    name: &'a str,
    reader: Reader<CountedLines<R>>,
    /// Names of the open elements, each after a slash.
    open: String,
    /// Text of the innermost open element, and where it begins.
    text: String,
    text_at: (u64, u64),
    rate_hz: f64,
    urban: bool,
    ids: BTreeSet<u32>,
    obstacle: Option<Obstacle>,
    collector: &'a mut Collector<'b, S>,
}

impl<R: BufRead, S: Held> Parser<'_, '_, R, S> {
    /// Takes the next tag or text; false at the end.
    fn step(&mut self, buffer: &mut Vec<u8>) -> Result<bool, DataError> {
        match self.reader.read_event_into(buffer) {
            Ok(Event::Start(tag)) => self.begin(&tag)?,
            Ok(Event::Empty(tag)) => {
                self.begin(&tag)?;
                self.end()?;
            }
            Ok(Event::End(_)) => self.end()?,
            Ok(Event::Text(text)) => self.text += &String::from_utf8_lossy(&text),
            Ok(Event::Eof) if self.open.is_empty() => return Ok(false),
            Ok(Event::Eof) => {
                let element = innermost(&self.open).to_owned();
                return Err(self.error(XmlErrorKind::CutOff { element }));
            }
            Ok(_) => {}
            Err(error) => return Err(self.error(XmlErrorKind::Syntax(error))),
        }
        Ok(true)
    }

    fn begin(&mut self, tag: &BytesStart<'_>) -> Result<(), DataError> {
        self.open.push('/');
        self.open += &String::from_utf8_lossy(tag.name().as_ref());
        self.text.clear();
        self.text_at = self.here();
        match self.open.as_str() {
            "/commonRoad" => {
                let version = self.attribute(tag, "commonRoadVersion")?;
                if version != "2020a" {
                    return Err(self.error(XmlErrorKind::Version { version }));
                }
                let step = self.attribute(tag, "timeStepSize")?;
                self.rate_hz = 1.0 / self.parsed(&step, STEPS_S)?;
            }
            open if open.rfind('/') == Some(0) => {
                let element = innermost(open).to_owned();
                return Err(self.error(XmlErrorKind::OtherRoot { element }));
            }
            "/commonRoad/scenarioTags/urban" => self.urban = true,
            "/commonRoad/dynamicObstacle" => {
                let id = self.attribute(tag, "id")?;
                let id = self.parsed(&id, (0.0, f64::from(u32::MAX)))? as u32;
                if !self.ids.insert(id) {
                    return Err(self.error(XmlErrorKind::IdTwice { id }));
                }
                self.obstacle = Some(Obstacle { id, ..Obstacle::default() });
            }
            _ => {}
        }
        Ok(())
    }

    fn end(&mut self) -> Result<(), DataError> {
        let text = std::mem::take(&mut self.text);
        if let Some(mut obstacle) = self.obstacle.take() {
            let part = self.open.strip_prefix("/commonRoad/dynamicObstacle").unwrap_or_default();
            match part {
                "/type" => text.trim().clone_into(&mut obstacle.kind),
                "/shape/rectangle/length" => obstacle.length_m = Some(self.parsed(&text, SIZES_M)?),
                "/shape/rectangle/width" => obstacle.width_m = Some(self.parsed(&text, SIZES_M)?),
                "/initialState" | "/trajectory/state" => obstacle.end_state(),
                _ => {
                    let inside = part.strip_prefix("/initialState").or_else(|| part.strip_prefix("/trajectory/state"));
                    self.state_value(&mut obstacle.state, inside.unwrap_or_default(), &text)?;
                }
            }
            if part.is_empty() {
                self.take(&obstacle)?;
            } else {
                self.obstacle = Some(obstacle);
            }
        }
        let parent = self.open.rfind('/').unwrap_or(0);
        self.open.truncate(parent);
        Ok(())
    }

    fn state_value(&self, state: &mut State, place: &str, text: &str) -> Result<(), DataError> {
        match place {
            "/position/point/x" => state.x_m = Some(self.parsed(text, POSITIONS_M)?),
            "/position/point/y" => state.y_m = Some(self.parsed(text, POSITIONS_M)?),
            "/time/exact" => state.frame = Some(self.parsed(text, STEPS)?),
            "/velocity/exact" => state.speed_mps = Some(self.parsed(text, SPEEDS_MPS)?),
            _ => {}
        }
        Ok(())
    }

    /// Hands the finished obstacle on, if it is one of those that we take.
    fn take(&mut self, obstacle: &Obstacle) -> Result<(), DataError> {
        self.collector.count(Oddity::InexactStates, obstacle.inexact);
        if !MOTOR_VEHICLES.contains(&obstacle.kind.as_str()) {
            self.collector.count(Oddity::NoMotorVehicles, 1);
            return Ok(());
        }
        let (Some(length_m), Some(width_m)) = (obstacle.length_m, obstacle.width_m) else {
            self.collector.count(Oddity::NoRectangles, 1);
            return Ok(());
        };
        if obstacle.rows.len() < 2 {
            self.collector.count(Oddity::NoTrajectories, 1);
            return Ok(());
        }
        let (vehicle_id, rate_hz) = (obstacle.id, self.rate_hz);
        for (index, row) in obstacle.rows.iter().enumerate() {
            let speed_mps = if row.speed_mps.is_nan() { obstacle.speed_mps(index, rate_hz) } else { row.speed_mps };
            self.collector.push(self.name, rate_hz, &Row { vehicle_id, length_m, width_m, speed_mps, ..*row })?;
        }
        Ok(())
    }

    fn attribute(&self, tag: &BytesStart<'_>, name: &'static str) -> Result<String, DataError> {
        let found = tag.attributes().flatten().find(|attribute| attribute.key.as_ref() == name.as_bytes());
        let value = found.map(|attribute| String::from_utf8_lossy(&attribute.value).into_owned());
        value.ok_or_else(|| {
            let element = innermost(&self.open).to_owned();
            self.error(XmlErrorKind::Missing { element, missing: name })
        })
    }

    fn parsed(&self, text: &str, (min, max): (f64, f64)) -> Result<f64, DataError> {
        match text.trim().parse::<f64>() {
            Ok(value) if (min..=max).contains(&value) => Ok(value),
            _ => {
                let element = innermost(&self.open).to_owned();
                let kind = XmlErrorKind::BadNumber { element, value: text.trim().to_owned(), min, max };
                let (line, column) = self.text_at;
                Err(DataError::Xml { path: self.path.to_owned(), line, column, kind: Box::new(kind) })
            }
        }
    }

    fn here(&self) -> (u64, u64) {
        let counted = self.reader.get_ref();
        (counted.line, counted.column)
    }

    /// An error where the reader is.
    fn error(&self, kind: XmlErrorKind) -> DataError {
        let (line, column) = self.here();
        DataError::Xml { path: self.path.to_owned(), line, column, kind: Box::new(kind) }
    }
}

impl Obstacle {
    /// Keeps the state that has been read, if it is exact.
    fn end_state(&mut self) {
        let State { x_m: Some(x_m), y_m: Some(y_m), frame: Some(frame), speed_mps } = std::mem::take(&mut self.state)
        else {
            self.inexact += 1;
            return;
        };
        let speed_mps = speed_mps.unwrap_or(f64::NAN).abs();
        let (length_m, width_m) = (0.0, 0.0);
        self.rows.push(Row {
            vehicle_id: self.id,
            length_m,
            width_m,
            frame: frame as i64,
            lane: 0,
            x_m,
            y_m,
            speed_mps,
        });
    }

    /// The speed to or from the neighboring state, for a state that has none.
    fn speed_mps(&self, index: usize, rate_hz: f64) -> f64 {
        let (a, b) = (&self.rows[index.saturating_sub(1)], &self.rows[(index + 1).min(self.rows.len() - 1)]);
        let time_s = (b.frame - a.frame).abs().max(1) as f64 / rate_hz;
        libm::hypot(b.x_m - a.x_m, b.y_m - a.y_m) / time_s
    }
}

/// The last name of a path of elements.
fn innermost(open: &str) -> &str {
    open.rsplit('/').next().unwrap_or_default()
}
