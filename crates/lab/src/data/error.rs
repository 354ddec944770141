//! What can be wrong with a recording.

use std::path::PathBuf;

use super::table::TableError;
use crate::run_dir::RunDirError;
use crate::studies::StudyError;

/// A recording that cannot be read, or events that cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DataError {
    /// A table is wrong.
    #[error(transparent)]
    Table(#[from] TableError),
    /// A CommonRoad file is wrong.
    #[error("{}, line {line}, column {column}: {kind}", path.display())]
    Xml {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: u64,
        /// The byte within the line, counted from 1.
        column: u64,
        /// What is wrong there.
        kind: Box<XmlErrorKind>,
    },
    /// A file of no known format.
    #[error(
        "{}, line 1: `{first_line}` begins no recording that is known (NGSIM tables of 25 or 18 columns, highD's `_tracks.csv`, \
         CommonRoad 2020a, `traffic.csv.gz` of this program)", path.display()
    )]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// Its first characters.
        first_line: String,
    },
    /// A table that is read together with another one.
    #[error("{} is read along with {}: name that one", path.display(), tracks.display())]
    NotTheTracks {
        /// The file.
        path: PathBuf,
        /// The one to name.
        tracks: PathBuf,
    },
    /// Frames that lie too far apart to be counted.
    #[error("{}: the times at site `{site}` lie years apart: one of them is wrong", path.display())]
    Times {
        /// The file.
        path: PathBuf,
        /// The site.
        site: String,
    },
    /// More samples than memory is set aside for.
    #[error("{} holds more than {limit} samples; take some of its sites by --sites, or split it", path.display())]
    TooBig {
        /// The file.
        path: PathBuf,
        /// The most samples that are held.
        limit: usize,
    },
    /// Numbers that cannot be in the unit of the format.
    #[error("{}: {what} is {measured:.2}, not in {min}..={max}: the units are not those of the format, or are mixed", path.display())]
    Units {
        /// The file.
        path: PathBuf,
        /// What was measured, with its unit.
        what: &'static str,
        /// The value.
        measured: f64,
        /// Smallest value to be believed.
        min: f64,
        /// Largest value to be believed.
        max: f64,
    },
    /// No vehicle is left.
    #[error("{} holds no vehicles that were asked for", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// Two recordings of one name.
    #[error("two of the files hold a site `{site}`; extract them into folders of their own")]
    SiteTwice {
        /// The name.
        site: String,
    },
    /// A folder with events in it.
    #[error("{} is there already; choose another folder", path.display())]
    Occupied {
        /// The file in the way.
        path: PathBuf,
    },
    /// A table could not be put together or packed.
    #[error("cannot write {}: {source}", path.display())]
    Pack {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file could not be written.
    #[error(transparent)]
    Write(#[from] RunDirError),
    /// A figure could not be written.
    #[error(transparent)]
    Report(#[from] StudyError),
}

/// What is wrong with a CommonRoad file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum XmlErrorKind {
    /// It is no well-formed XML.
    #[error("cannot be read: {0}")]
    Syntax(#[source] quick_xml::Error),
    /// It ends before its elements are closed.
    #[error("the file ends inside of <{element}>")]
    CutOff {
        /// The innermost open element.
        element: String,
    },
    /// It is XML of another kind.
    #[error("is <{element}>, not <commonRoad>")]
    OtherRoot {
        /// The outermost element.
        element: String,
    },
    /// It is of another version.
    #[error("is CommonRoad `{version}`, but only 2020a is read")]
    Version {
        /// The version.
        version: String,
    },
    /// Something that is needed is not there.
    #[error("<{element}> has no {missing}")]
    Missing {
        /// In which element.
        element: String,
        /// What is missing.
        missing: &'static str,
    },
    /// Something else than a number in its range.
    #[error("<{element}>: `{value}` is no number in {min}..={max}")]
    BadNumber {
        /// In which element.
        element: String,
        /// What stands there.
        value: String,
        /// Smallest allowed value.
        min: f64,
        /// Largest allowed value.
        max: f64,
    },
    /// Two obstacles of one id.
    #[error("there are two dynamic obstacles `{id}`")]
    IdTwice {
        /// The id.
        id: u32,
    },
}
