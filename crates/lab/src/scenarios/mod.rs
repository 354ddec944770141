//! Scenario files on disk: read with the line, the key and a suggestion where something is wrong, driven, recorded and drawn.

mod builtin;
mod error;
mod gallery;
mod picture;
mod recorded;

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lanecraft_drive::env::{Env, Episode, Trace};
use lanecraft_drive::road::Road;
use lanecraft_drive::scenario::{Recording, Scenario, ScenarioFile};
use lanecraft_drive::traffic::World;

pub use builtin::{named, names};
pub use error::ScenarioFileError;
pub use gallery::{gallery_page, name_of};
pub use picture::picture;

use crate::config::EnvironmentConfig;
use crate::evaluate::{EvaluateError, record};
use crate::policy::Policy;
use error::place;

/// Largest scenario file that is read.
const FILE_LIMIT_BYTES: u64 = 1 << 20;

/// A checked scenario file.
#[derive(Clone, Debug)]
pub struct LoadedScenario {
    /// Where it was read from.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
    /// What stands in it.
    pub file: ScenarioFile,
    recording: Option<Arc<Recording>>,
}

impl LoadedScenario {
    /// Reads a file and what it refers to, and checks that a world can begin with it.
    ///
    /// # Errors
    /// If the file cannot be read or is wrong; the error has the line, the key and the nearest name.
    pub fn read(path: &Path) -> Result<Self, ScenarioFileError> {
        Self::checked(path, read_text(path)?)
    }

    fn checked(path: &Path, text: String) -> Result<Self, ScenarioFileError> {
        let loaded = Self::parse(path, text)?;
        let scenario = loaded.scenario(0)?;
        World::new(&scenario).map_err(|error| place(path, &loaded.text, &error))?;
        Ok(loaded)
    }

    fn parse(path: &Path, text: String) -> Result<Self, ScenarioFileError> {
        let file = ScenarioFile::from_toml(&text).map_err(|error| place(path, &text, &error))?;
        let recording = match &file.recording {
            Some(config) => Some(Arc::new(recorded::read(path, config)?)),
            None => None,
        };
        Ok(Self { path: path.to_owned(), text, file, recording })
    }

    /// Whether it needs more than its text.
    pub fn needs_recording(&self) -> bool {
        self.recording.is_some()
    }

    /// Its text as a value of the key `env.scenario`.
    ///
    /// # Errors
    /// If it needs a recording, which no run and no trace can hold.
    pub fn into_value(self) -> Result<String, ScenarioFileError> {
        if self.needs_recording() {
            return Err(ScenarioFileError::NeedsRecording { path: self.path });
        }
        Ok(self.text)
    }

    /// The road.
    pub fn road(&self) -> Result<Road, ScenarioFileError> {
        Road::new(self.file.road.clone()).map_err(|error| place(&self.path, &self.text, &error.into()))
    }

    /// Its complete text, with every key.
    pub fn to_toml(&self) -> String {
        toml::to_string(&self.file).expect("all keys are plain values")
    }

    /// The scene of this seed.
    pub fn scenario(&self, seed: u64) -> Result<Scenario, ScenarioFileError> {
        let scenario = match &self.recording {
            Some(recording) => self.file.scenario_with(Arc::clone(recording), seed),
            None => self.file.scenario(seed),
        };
        scenario.map_err(|error| place(&self.path, &self.text, &error))
    }

    /// Lets `policy` drive in it; returns the recorded episode and its figures. The trace holds the scenario's text, so that it can be run again.
    pub fn drive(
        &self,
        policy: &Policy,
        config: &EnvironmentConfig,
        seed: u64,
    ) -> Result<(Trace, Episode), DriveError> {
        let mut config = config.clone();
        config.env.scenario.clone_from(&self.text);
        let mut env = Env::in_scenario(&Arc::new(config), &self.scenario(seed)?).map_err(EvaluateError::from)?;
        let trace = record(policy, &mut env, seed)?;
        Ok((trace, *env.episode()))
    }
}

/// Why a scenario cannot be driven.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
#[non_exhaustive]
pub enum DriveError {
    /// The scene cannot be built.
    Scenario(#[from] ScenarioFileError),
    /// The policy or the environment stopped.
    Drive(#[from] EvaluateError),
}

fn read_text(path: &Path) -> Result<String, ScenarioFileError> {
    let read = |source| ScenarioFileError::Read { path: path.to_owned(), source };
    let mut text = String::new();
    let file = std::fs::File::open(path).map_err(read)?;
    file.take(FILE_LIMIT_BYTES + 1).read_to_string(&mut text).map_err(read)?;
    if text.len() as u64 > FILE_LIMIT_BYTES {
        return Err(ScenarioFileError::TooLarge { path: path.to_owned(), limit_bytes: FILE_LIMIT_BYTES });
    }
    Ok(text)
}

/// The JSON Schema of scenario files, with a line break at the end.
pub fn schema() -> String {
    let schema = schemars::schema_for!(ScenarioFile);
    let mut text = serde_json::to_string_pretty(&schema).expect("a schema is plain JSON");
    text.push('\n');
    text
}

/// The scenario files in a folder, by name.
pub fn list(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder)?.flatten().map(|entry| entry.path());
    let mut paths: Vec<PathBuf> = entries.filter(|path| path.extension().is_some_and(|end| end == "toml")).collect();
    paths.sort();
    Ok(paths)
}
