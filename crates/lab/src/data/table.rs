//! Comma-separated tables with named columns.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;

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

/// A table that is read row by row.
pub(crate) struct Table {
    path: PathBuf,
    reader: csv::Reader<Box<dyn Read>>,
    header: csv::StringRecord,
    row: csv::StringRecord,
    rows: u64,
}

impl Table {
    /// Opens the table at `path`, which is compressed if its name ends in `.gz`, and looks for `columns`.
    pub(crate) fn open(path: &Path, columns: &[&'static str]) -> Result<Self, TableError> {
        let at = |line, kind| TableError { path: path.to_owned(), line, kind };
        let file = File::open(path).map_err(|error| at(0, TableErrorKind::Open(error)))?;
        let content: Box<dyn Read> = if path.extension().is_some_and(|end| end == "gz") {
            Box::new(MultiGzDecoder::new(file))
        } else {
            Box::new(file)
        };
        let mut reader = csv::Reader::from_reader(content);
        let header = reader.headers().map_err(|error| at(1, TableErrorKind::Row(error)))?.clone();
        if let Some(column) = columns.iter().find(|column| !header.iter().any(|name| name == **column)) {
            return Err(at(1, TableErrorKind::MissingColumn { column }));
        }
        Ok(Self { path: path.to_owned(), reader, header, row: csv::StringRecord::new(), rows: 0 })
    }

    /// Goes to the next row; false after the last one. A table without rows is an error.
    pub(crate) fn next(&mut self) -> Result<bool, TableError> {
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
        let index = self.header.iter().position(|name| name == column);
        index.and_then(|index| self.row.get(index)).ok_or_else(|| self.error(TableErrorKind::MissingColumn { column }))
    }

    /// The number in `column`, which must lie in `min..=max`.
    pub(crate) fn number(&self, column: &'static str, (min, max): (f64, f64)) -> Result<f64, TableError> {
        let text = self.text(column)?;
        match text.trim().parse::<f64>() {
            Ok(value) if (min..=max).contains(&value) => Ok(value),
            _ => Err(self.error(TableErrorKind::BadNumber { column, value: text.to_owned(), min, max })),
        }
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
