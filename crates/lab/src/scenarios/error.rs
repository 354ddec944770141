//! What is wrong with a scenario file, and where.

use std::path::{Path, PathBuf};

use lanecraft_drive::scenario::ScenarioError;
use toml::de::{DeTable, DeValue};

use crate::config::{Origin, nearest};
use crate::data::TableError;

/// A scenario file that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScenarioFileError {
    /// It cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is too large to be a scenario.
    #[error("{} is larger than {limit_bytes} bytes, too large for a scenario", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The limit.
        limit_bytes: u64,
    },
    /// Something in it is wrong.
    #[error("{origin}: {message}{}", hint(nearest.as_deref()))]
    Wrong {
        /// The file and the line.
        origin: Origin,
        /// The dotted key, with indices from 0; empty if there is none.
        key: String,
        /// What is wrong.
        message: String,
        /// The nearest name that is allowed, if any is near.
        nearest: Option<String>,
    },
    /// It needs more than its text.
    #[error("{} needs a recording; only `lanecraft scenario` drives in it", path.display())]
    NeedsRecording {
        /// The file.
        path: PathBuf,
    },
    /// Neither a file nor the name of a scenario that comes with the program.
    #[error(
        "there is no file and no scenario `{name}`{}",
        nearest(name, names.iter().map(String::as_str))
            .map_or_else(|| format!("; the scenarios are {}", names.join(", ")), |near| hint(Some(near)))
    )]
    NoSuchName {
        /// As given.
        name: String,
        /// The names that exist.
        names: Vec<String>,
    },
    /// Its recording is not there.
    #[error(
        "{origin}: there is no recording `{file}`, neither beside the scenario nor in the folder LANECRAFT_DATA{}",
        if *data_is_set { "" } else { ", which is not set" }
    )]
    NoRecording {
        /// The file and the line.
        origin: Origin,
        /// As written.
        file: String,
        /// Whether `LANECRAFT_DATA` is set.
        data_is_set: bool,
    },
    /// Its recording cannot be read.
    #[error(transparent)]
    Recording(#[from] TableError),
}

fn hint(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |name| format!("; did you mean `{name}`?"))
}

/// `error` with its line in `text` and the nearest name.
pub(super) fn place(path: &Path, text: &str, error: &ScenarioError) -> ScenarioFileError {
    let key = error.key();
    let (offset, message, nearest) = match error {
        ScenarioError::Parse(error) => {
            let message = error.message().lines().next().unwrap_or_default().to_owned();
            let nearest = nearest_of_reason(&message);
            (error.span().map_or(0, |span| span.start), message, nearest)
        }
        ScenarioError::UnknownVehicle { name, known, .. } => {
            let near = nearest(name, known.iter().map(String::as_str)).map(str::to_owned);
            (offset(text, &key), error.to_string(), near)
        }
        ScenarioError::UnknownRange { key: wanted, known } => {
            let near = nearest(wanted, known.iter().map(String::as_str)).map(str::to_owned);
            (offset(text, &key), error.to_string(), near)
        }
        _ => (offset(text, &key), error.to_string(), None),
    };
    ScenarioFileError::Wrong { origin: origin(path, text, offset), key, message, nearest }
}

/// The line of `key` in `text`.
pub(super) fn line_of(path: &Path, text: &str, key: &str) -> Origin {
    origin(path, text, offset(text, key))
}

fn origin(path: &Path, text: &str, offset: usize) -> Origin {
    let line = 1 + text.bytes().take(offset).map(|byte| u32::from(byte == b'\n')).sum::<u32>();
    Origin::File { path: path.into(), line }
}

/// serde names the wrong word in backquotes before the word `expected`, and those it allows behind it.
fn nearest_of_reason(reason: &str) -> Option<String> {
    let (wrong, allowed) = reason.split_once("expected")?;
    let wrong = wrong.split('`').nth(1)?;
    nearest(wrong, allowed.split('`').skip(1).step_by(2)).map(str::to_owned)
}

/// Where the longest part of `key` that stands in `text` begins.
fn offset(text: &str, key: &str) -> usize {
    let Ok(document) = DeTable::parse(text) else { return 0 };
    let mut parts = key.split('.');
    let Some((name, mut value)) = parts.next().and_then(|part| document.get_ref().get_key_value(part)) else {
        return 0;
    };
    let mut offset = name.span().start;
    for part in parts {
        match value.get_ref() {
            DeValue::Table(table) => {
                let Some((name, inner)) = table.get_key_value(part) else { break };
                (offset, value) = (name.span().start, inner);
            }
            DeValue::Array(items) => {
                let Some(item) = part.parse().ok().and_then(|index: usize| items.get(index)) else { break };
                (offset, value) = (item.span().start, item);
            }
            _ => break,
        }
    }
    offset
}
