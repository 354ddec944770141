//! Tables with named columns, separated by commas or by blanks.

use std::cell::Cell;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use flate2::read::MultiGzDecoder;

use super::decimal;

/// A table that cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("{}, line {line}: {kind}", path.display())]
pub struct TableError {
    /// The file.
    pub path: PathBuf,
    /// The line, counted from 1; 0 where the file as a whole is meant.
    pub line: u64,
    /// What is wrong; part of the message.
    pub kind: TableErrorKind,
}

/// What is wrong with a table.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableErrorKind {
    /// It cannot be opened.
    #[error("cannot be opened: {0}")]
    Open(#[source] std::io::Error),
    /// A row that cannot be read: cut off, no text, or with another number of fields than the header.
    #[error("cannot be read: {0}")]
    Row(#[source] csv::Error),
    /// No row after the header.
    #[error("holds no rows")]
    Empty,
    /// A column that is needed is not there.
    #[error("has no column `{column}`")]
    MissingColumn {
        /// Its name.
        column: &'static str,
    },
    /// A field that is not a number in its range.
    #[error("column `{column}`: `{value}` is no number in {min}..={max}")]
    BadNumber {
        /// Name of the column.
        column: &'static str,
        /// What stands there.
        value: String,
        /// Smallest allowed value.
        min: f64,
        /// Largest allowed value.
        max: f64,
    },
    /// A field that is none of the allowed words.
    #[error("column `{column}`: `{value}` is none of {allowed:?}")]
    BadWord {
        /// Name of the column.
        column: &'static str,
        /// What stands there.
        value: String,
        /// The allowed words.
        allowed: &'static [&'static str],
    },
    /// A key that appears in no other table, twice, or not at all.
    #[error("`{key}`: {problem}")]
    BadKey {
        /// The key.
        key: String,
        /// What is wrong with it.
        problem: &'static str,
    },
}

/// How a table's fields are separated and named.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layout {
    /// By commas; the first row holds the names.
    Named,
    /// By commas; the first row holds the names, in letters of either case, which are read as small ones.
    NamedInAnyCase,
    /// By commas; there are no names, but the columns are these.
    Commas(&'static [&'static str]),
    /// The same by blanks.
    Blanks(&'static [&'static str]),
}

/// The content of the file at `path`, decompressed if its name ends in `.gz`.
pub(crate) fn content(path: &Path) -> std::io::Result<Box<dyn Read>> {
    let file = File::open(path)?;
    let packed = path.extension().is_some_and(|end| end == "gz");
    Ok(if packed { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) })
}

/// The longest row, bytes: a quote that is never closed must not swallow a file into memory.
const LONGEST_ROW: usize = 1 << 20;

/// Bytes that are asked for at once.
const BUFFER: usize = 1 << 16;

/// Drops carriage returns, which would let the lines of the reader behind it lag by one, and ends where a row does not.
struct Rows<R> {
    inner: R,
    /// Bytes since the last row was complete.
    since_row: Rc<Cell<usize>>,
}

impl<R: Read> Read for Rows<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        loop {
            let count = self.inner.read(out)?;
            self.since_row.set(self.since_row.get() + count);
            if self.since_row.get() > LONGEST_ROW {
                return Err(std::io::Error::other("a row is longer than 1 MiB; is a quote left open?"));
            }
            if !out[..count].contains(&b'\r') {
                return Ok(count);
            }
            let mut kept = 0;
            for index in 0..count {
                if out[index] != b'\r' {
                    out[kept] = out[index];
                    kept += 1;
                }
            }
            // Nothing kept of something read must not look like the end.
            if kept > 0 || count == 0 {
                return Ok(kept);
            }
        }
    }
}

/// Puts one comma for each run of blanks between fields and none at the ends of a line.
struct BlanksAsCommas<R> {
    inner: R,
    line_begun: bool,
    blank_seen: bool,
}

impl<R: BufRead> Read for BlanksAsCommas<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let mut written = 0;
        while written < out.len() {
            let Some(&byte) = self.inner.fill_buf()?.first() else { break };
            match byte {
                b' ' | b'\t' => self.blank_seen = true,
                b'\n' => (self.line_begun, self.blank_seen) = (false, false),
                _ if self.blank_seen && self.line_begun => {
                    self.blank_seen = false;
                    out[written] = b',';
                    written += 1;
                    continue;
                }
                _ => (self.line_begun, self.blank_seen) = (true, false),
            }
            self.inner.consume(1);
            if !self.blank_seen {
                out[written] = byte;
                written += 1;
            }
        }
        Ok(written)
    }
}

/// Where a column stands.
#[derive(Clone, Copy, Debug)]
pub(super) struct Column {
    name: &'static str,
    place: usize,
}

/// A table that is read row by row.
pub(crate) struct Table {
    path: PathBuf,
    reader: csv::Reader<Box<dyn Read>>,
    header: csv::StringRecord,
    /// Where the columns that were looked for stand: there are fewer of them than of all.
    places: Vec<(&'static str, usize)>,
    row: csv::StringRecord,
    rows: u64,
    since_row: Rc<Cell<usize>>,
}

impl Table {
    /// Opens the table at `path`, which is compressed if its name ends in `.gz`, and looks for `columns`.
    pub(crate) fn open(path: &Path, columns: &[&'static str]) -> Result<Self, TableError> {
        Self::open_as(path, Layout::Named, columns)
    }

    /// The same for a table of any layout.
    pub(super) fn open_as(path: &Path, layout: Layout, columns: &[&'static str]) -> Result<Self, TableError> {
        let at = |line, kind| TableError { path: path.to_owned(), line, kind };
        let content = content(path).map_err(|error| at(0, TableErrorKind::Open(error)))?;
        let since_row = Rc::new(Cell::new(0));
        let mut content: Box<dyn Read> = Box::new(Rows { inner: content, since_row: Rc::clone(&since_row) });
        if let Layout::Blanks(_) = layout {
            let inner = BufReader::new(content);
            content = Box::new(BlanksAsCommas { inner, line_begun: false, blank_seen: false });
        }
        let named = matches!(layout, Layout::Named | Layout::NamedInAnyCase);
        let mut reader = csv::ReaderBuilder::new().has_headers(named).buffer_capacity(BUFFER).from_reader(content);
        let header = match layout {
            Layout::Commas(columns) | Layout::Blanks(columns) => csv::StringRecord::from(columns.to_vec()),
            Layout::Named | Layout::NamedInAnyCase => {
                let header = reader.headers().map_err(|error| at(1, TableErrorKind::Row(error)))?;
                let any_case = layout == Layout::NamedInAnyCase;
                let name = |name: &str| if any_case { name.trim().to_ascii_lowercase() } else { name.to_owned() };
                header.iter().map(name).collect()
            }
        };
        let mut places = Vec::with_capacity(columns.len());
        for &column in columns {
            let place = header.iter().position(|name| name == column);
            places.push((column, place.ok_or_else(|| at(1, TableErrorKind::MissingColumn { column }))?));
        }
        Ok(Self { path: path.to_owned(), reader, header, places, row: csv::StringRecord::new(), rows: 0, since_row })
    }

    /// Whether there is a column of this name.
    pub(super) fn has(&self, column: &str) -> bool {
        self.header.iter().any(|name| name == column)
    }

    /// Goes to the next row; false after the last one. A table without rows is an error.
    pub(crate) fn next(&mut self) -> Result<bool, TableError> {
        self.since_row.set(0);
        match self.reader.read_record(&mut self.row) {
            Ok(true) => {
                self.rows += 1;
                Ok(true)
            }
            Ok(false) if self.rows == 0 => Err(self.error_of_file(TableErrorKind::Empty)),
            Ok(false) => Ok(false),
            Err(error) => {
                let line = error.position().map_or_else(|| self.reader.position().line(), csv::Position::line);
                Err(TableError { path: self.path.clone(), line, kind: TableErrorKind::Row(error) })
            }
        }
    }

    /// An error in the present row.
    pub(crate) fn error(&self, kind: TableErrorKind) -> TableError {
        let line = self.row.position().map_or(0, csv::Position::line);
        TableError { path: self.path.clone(), line, kind }
    }

    /// An error of the file as a whole.
    pub(crate) fn error_of_file(&self, kind: TableErrorKind) -> TableError {
        TableError { path: self.path.clone(), line: 0, kind }
    }

    /// The field in `column`, one of the columns that were looked for.
    pub(crate) fn text(&self, column: &'static str) -> Result<&str, TableError> {
        let index = self.place(column);
        index.and_then(|index| self.row.get(index)).ok_or_else(|| self.error(TableErrorKind::MissingColumn { column }))
    }

    fn place(&self, column: &str) -> Option<usize> {
        let looked_for = self.places.iter().find(|(name, _)| *name == column).map(|(_, place)| *place);
        looked_for.or_else(|| self.header.iter().position(|name| name == column))
    }

    /// The number in `column`, which must lie in `min..=max`.
    pub(crate) fn number(&self, column: &'static str, (min, max): (f64, f64)) -> Result<f64, TableError> {
        let text = self.text(column)?;
        match text.trim().parse::<f64>() {
            Ok(value) if (min..=max).contains(&value) => Ok(value),
            _ => Err(self.error(TableErrorKind::BadNumber { column, value: text.to_owned(), min, max })),
        }
    }

    /// Where `column` stands, one of those that were looked for or any other.
    pub(super) fn column(&self, name: &'static str) -> Result<Column, TableError> {
        let place = self.place(name).ok_or_else(|| self.error(TableErrorKind::MissingColumn { column: name }))?;
        Ok(Column { name, place })
    }

    /// The field in `column`.
    pub(super) fn field(&self, column: Column) -> &str {
        // The header is as long as every row.
        self.row.get(column.place).unwrap_or_default()
    }

    /// The number in `column`, which must lie in `min..=max`, and whose thousands may be set apart by commas: `1,156`.
    pub(super) fn grouped(&self, column: Column, (min, max): (f64, f64)) -> Result<f64, TableError> {
        let text = self.field(column);
        match decimal::parse(text.trim()) {
            Some(value) if (min..=max).contains(&value) => Ok(value),
            _ => Err(self.bad_number(column, (min, max))),
        }
    }

    /// The whole number in `column`, not below 0, thousands set apart or not.
    pub(super) fn grouped_index(&self, column: Column) -> Result<u32, TableError> {
        let range = (0.0, f64::from(u32::MAX));
        let value = self.grouped(column, range)?;
        if value.fract() == 0.0 { Ok(value as u32) } else { Err(self.bad_number(column, range)) }
    }

    fn bad_number(&self, column: Column, (min, max): (f64, f64)) -> TableError {
        let value = self.field(column).to_owned();
        self.error(TableErrorKind::BadNumber { column: column.name, value, min, max })
    }

    /// The whole number in `column`, of either sign.
    pub(crate) fn integer(&self, column: &'static str) -> Result<i32, TableError> {
        let text = self.text(column)?;
        let (min, max) = (f64::from(i32::MIN), f64::from(i32::MAX));
        let bad = |_| self.error(TableErrorKind::BadNumber { column, value: text.to_owned(), min, max });
        text.trim().parse().map_err(bad)
    }

    /// The whole number in `column`, not below 0.
    pub(crate) fn index(&self, column: &'static str) -> Result<u32, TableError> {
        let text = self.text(column)?;
        text.trim().parse().map_err(|_| {
            self.error(TableErrorKind::BadNumber { column, value: text.to_owned(), min: 0.0, max: f64::from(u32::MAX) })
        })
    }

    /// The position among `allowed` of the word in `column`.
    pub(crate) fn word(&self, column: &'static str, allowed: &'static [&'static str]) -> Result<usize, TableError> {
        let text = self.text(column)?;
        allowed
            .iter()
            .position(|word| *word == text)
            .ok_or_else(|| self.error(TableErrorKind::BadWord { column, value: text.to_owned(), allowed }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_blanks_become_single_commas_however_small_the_pieces() {
        let text = "  1  2\t3 \n\n 4 5 6";
        for capacity in [1, 2, 3, 64] {
            let inner = BufReader::with_capacity(capacity, text.as_bytes());
            let mut out = String::new();
            BlanksAsCommas { inner, line_begun: false, blank_seen: false }.read_to_string(&mut out).unwrap();
            assert_eq!(out, "1,2,3\n\n4,5,6");
        }
    }

    #[test]
    fn a_quote_left_open_does_not_swallow_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        std::fs::write(&path, format!("a,b\n1,\"2\n{}", "3,4\n".repeat(LONGEST_ROW / 2))).unwrap();
        let error = Table::open(&path, &["b"]).unwrap().next().unwrap_err().to_string();
        assert!(error.contains("longer than 1 MiB; is a quote left open?"), "{error}");
    }

    #[test]
    fn lines_are_counted_where_they_end_in_returns_too() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        std::fs::write(&path, "a,b\r\n1,2\r\n3,x\r\n").unwrap();
        let mut table = Table::open(&path, &["b"]).unwrap();
        assert!(table.next().unwrap() && table.index("b").is_ok() && table.next().unwrap());
        assert_eq!(table.index("b").unwrap_err().line, 3);
    }
}
