//! What can be wrong with a configuration that somebody wrote, said so that it can be put right at once.

use std::fmt;
use std::path::{Path, PathBuf};

/// Where a value was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Origin {
    /// In the built-in preset of this name.
    Preset(&'static str),
    /// On the command line.
    CommandLine,
    /// In a program that called.
    Caller,
    /// In a file.
    File {
        /// The file.
        path: Box<Path>,
        /// Line, counted from 1.
        line: u32,
    },
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Preset(name) => write!(f, "preset {name}"),
            Self::CommandLine => write!(f, "command line"),
            Self::Caller => write!(f, "config"),
            Self::File { path, line } => write!(f, "{}:{line}", path.display()),
        }
    }
}

/// What the struct of a section says against its values.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
#[non_exhaustive]
pub enum SectionError {
    /// Of the driving and its world, or of the lab.
    Drive(#[from] lanecraft_drive::config::ConfigError),
    /// Of the learners.
    Learn(#[from] lanecraft_learn::ConfigError),
    /// Of the file with the predictor's weights.
    Model(#[from] Box<PredictorFileError>),
}

/// A file with the predictor's weights that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("`{PREDICTION_MODEL}` is {path:?}, which must be built-in or a predictor's weights: {reason}")]
pub struct PredictorFileError {
    /// The file.
    pub path: String,
    /// What is wrong with it.
    pub reason: PredictorFileProblem,
}

/// The key that names the file.
const PREDICTION_MODEL: &str = "prediction.model";

/// What is wrong with a file of weights.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
#[non_exhaustive]
pub enum PredictorFileProblem {
    /// It cannot be read.
    Read(#[from] std::io::Error),
    /// It holds something else.
    Model(#[from] lanecraft_drive::predict::lstm::ModelError),
}

impl SectionError {
    /// The key it is about; empty if it names none that is known here.
    pub(super) fn key(&self) -> &'static str {
        match self {
            Self::Learn(error) => error.key,
            Self::Drive(error) => error.key(),
            Self::Model(_) => PREDICTION_MODEL,
        }
    }
}

/// A configuration that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigFileError {
    /// A key that does not exist.
    #[error("{origin}: there is no key `{key}` (value {value}){}", suggestion(nearest.as_deref(), allowed))]
    UnknownKey {
        /// Where it was written.
        origin: Origin,
        /// The key as written.
        key: String,
        /// Its value as written.
        value: String,
        /// The nearest key that exists, if any is near.
        nearest: Option<Box<str>>,
        /// The keys beside it, or the sections.
        allowed: Box<[String]>,
    },
    /// A value of the wrong type.
    #[error("{origin}: `{key}` is {value}, but must be {expected}")]
    WrongType {
        /// Where it was written.
        origin: Origin,
        /// Dotted key.
        key: String,
        /// The value as written.
        value: String,
        /// The type in words.
        expected: &'static str,
    },
    /// NaN or infinity.
    #[error("{origin}: `{key}` is {value}, but must be a finite number")]
    NotFinite {
        /// Where it was written.
        origin: Origin,
        /// Dotted key.
        key: String,
        /// The value as written.
        value: String,
    },
    /// A value of the right type that the key does not know, for example a misspelt name.
    #[error("{origin}: `{key}` is {value}: {reason}{}", suggestion(nearest.as_deref(), &[]))]
    UnknownValue {
        /// Where it was written.
        origin: Origin,
        /// Dotted key.
        key: String,
        /// The value as written.
        value: String,
        /// What is allowed.
        reason: String,
        /// The nearest allowed name, if any is near.
        nearest: Option<Box<str>>,
    },
    /// A value outside its range, or values that do not fit together.
    #[error("{origin}: {source}")]
    Invalid {
        /// Where the key was written.
        origin: Origin,
        /// What is wrong, with the key, the value and what is allowed.
        source: SectionError,
    },
    /// A text that is no TOML.
    #[error("{origin}: {message}")]
    Syntax {
        /// Where.
        origin: Origin,
        /// What the parser says.
        message: String,
    },
    /// An assignment without `=`.
    #[error("`{text}` is no assignment; write it as `key=value`, for example `training.seed=7`")]
    NoAssignment {
        /// The text as written.
        text: String,
    },
    /// A file that cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file too large to be a configuration.
    #[error("{} is larger than {limit_bytes} bytes, too large for a configuration", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The limit.
        limit_bytes: u64,
    },
}

pub(super) fn suggestion(nearest: Option<&str>, allowed: &[String]) -> String {
    match nearest {
        Some(name) => format!("; did you mean `{name}`?"),
        None if allowed.is_empty() => String::new(),
        None => format!("; allowed are {}", allowed.join(", ")),
    }
}
