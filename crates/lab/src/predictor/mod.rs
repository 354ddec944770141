//! The recurrent predictor: films of traffic, training, and how far it is off beside plainer ones.

mod errors;
mod film;
mod output;
mod recorded;
mod run;
mod samples;
mod swap;
mod train;

use std::path::{Path, PathBuf};

use lanecraft_drive::config::{ConfigError, check_range};
use lanecraft_drive::predict::lstm::{LstmModel, ModelError};
use lanecraft_drive::predict::{PredictionConfig, Predictor};
use lanecraft_drive::scenario::ScenarioError;
use lanecraft_net::ShapeError;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use self::errors::{ErrorRow, Errors, JUDGED_S};
pub use self::film::Film;
pub use self::output::{report, swap_report};
pub use self::recorded::FilmError;
pub use self::run::{CURVE, WEIGHTS, train_run};
use self::samples::{Sample, samples};
pub use self::swap::{SWAPPED, Swap, swap};
pub use self::train::EpochPoint;
use crate::config::{RunConfig, SeedRole};
use crate::data::DataError;
use crate::data::read::read;
use crate::data::recording::Selection;
use crate::progress::Progress;
use crate::run_dir::RunDirError;
use crate::stats::StatsError;

/// How the predictor is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PredictorConfig {
    /// Width of the network's state. The paper gives none.
    pub hidden: usize,
    /// Times that every sample is learned from.
    pub epochs: u32,
    /// Samples in a batch.
    pub batch: usize,
    /// Step size of Adam at the start; it falls linearly to zero.
    pub learning_rate: f64,
    /// Scenarios whose simulated traffic is learned from.
    pub scenarios: usize,
    /// Length of each, s.
    pub scenario_s: f64,
}

impl Default for PredictorConfig {
    fn default() -> Self {
        Self { hidden: 64, epochs: 15, batch: 64, learning_rate: 2e-3, scenarios: 10, scenario_s: 60.0 }
    }
}

impl PredictorConfig {
    /// Checks every field.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("predictor.hidden", self.hidden as f64, 1.0, 512.0)?;
        check_range("predictor.epochs", f64::from(self.epochs), 1.0, 1e4)?;
        check_range("predictor.batch", self.batch as f64, 1.0, 4096.0)?;
        check_range("predictor.learning_rate", self.learning_rate, 1e-7, 1.0)?;
        check_range("predictor.scenarios", self.scenarios as f64, 0.0, 1e4)?;
        check_range("predictor.scenario_s", self.scenario_s, 10.0, 3600.0)
    }
}

/// Why a predictor could not be trained or judged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PredictorError {
    /// A recording cannot be used.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// A recording cannot be read.
    #[error(transparent)]
    Data(#[from] DataError),
    /// A scenario cannot be built.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A number is out of range, or weights are missing.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The network cannot be built.
    #[error(transparent)]
    Shape(#[from] ShapeError),
    /// The weights cannot be written.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The run's folder cannot be used.
    #[error(transparent)]
    Dir(#[from] RunDirError),
    /// Too few vehicles for an interval.
    #[error(transparent)]
    Stats(#[from] StatsError),
    /// A policy failed.
    #[error(transparent)]
    Evaluate(#[from] crate::evaluate::EvaluateError),
    /// No site has such a name.
    #[error("no site in {} has a name that begins with `{prefix}`", path.display())]
    NoSites {
        /// The recording.
        path: PathBuf,
        /// What names were to begin with.
        prefix: String,
    },
    /// There is nothing to learn from.
    #[error(
        "no vehicle is in sight for long enough to learn from; give recordings by --data, or a `predictor.scenarios` above 0"
    )]
    NoSamples,
}

/// Films of the recording at `path`, a file or a folder with `traffic.csv.gz`: of its sites whose names begin with `prefix`.
///
/// # Errors
/// If it cannot be read, or has no such site.
pub fn recorded_films(path: &Path, prefix: &str) -> Result<Vec<Film>, PredictorError> {
    let file = if path.is_dir() { path.join("traffic.csv.gz") } else { path.to_owned() };
    let selection = Selection { sites: prefix.to_owned(), ..Selection::default() };
    let found = match read(&file, &selection) {
        Err(DataError::Empty { path }) if !prefix.is_empty() => {
            return Err(PredictorError::NoSites { path, prefix: prefix.to_owned() });
        }
        found => found?,
    };
    let films: Result<Vec<Vec<Film>>, FilmError> = found.par_iter().map(recorded::films).collect();
    Ok(films?.into_iter().flatten().collect())
}

/// Films of simulated traffic, `count` scenarios of `role`; each is a step of progress.
///
/// # Errors
/// If a scenario cannot be built.
pub fn simulated_films(
    config: &RunConfig,
    role: SeedRole,
    count: usize,
    progress: &Progress,
) -> Result<Vec<Film>, PredictorError> {
    let film = |index: usize| {
        let (environment, duration_s) = (&config.environment, config.predictor.scenario_s);
        let film = Film::simulated(environment, role, config.training.seed, index as u64, duration_s);
        progress.advance(1);
        Ok(film?)
    };
    (0..count).into_par_iter().map(film).collect()
}

/// Share of the films of each kind whose samples are not learned from but watched: one in so many.
const VALIDATED: usize = 8;

/// Trains on `films`, of which every eighth is watched only, and hands each point of the curve on as it comes.
///
/// # Errors
/// If there is nothing to learn from.
pub fn train(
    config: &RunConfig,
    films: &[&Film],
    point: &mut dyn FnMut(EpochPoint),
) -> Result<LstmModel, PredictorError> {
    let found: Vec<Vec<Sample>> = films.par_iter().map(|film| samples(film)).collect();
    let (watched, learned): (Vec<_>, Vec<_>) =
        found.into_iter().enumerate().partition(|(index, _)| index % VALIDATED == VALIDATED - 1);
    let [learned, watched] =
        [learned, watched].map(|films| films.into_iter().flat_map(|(_, samples)| samples).collect::<Vec<Sample>>());
    if learned.is_empty() {
        return Err(PredictorError::NoSamples);
    }
    Ok(train::train(&config.predictor, config.training.seed, [&learned, &watched], point)?)
}

/// Errors on recorded sites, each by a network that was trained without it, and without the others of its fold, on `simulated` and the other
/// sites. Each fold is a step of progress.
///
/// # Errors
/// If there is nothing to learn from.
pub fn cross_validate(
    config: &RunConfig,
    [simulated, recorded]: [&[Film]; 2],
    folds: usize,
    progress: &Progress,
) -> Result<Errors, PredictorError> {
    let fold = |fold: usize| -> Result<Errors, PredictorError> {
        let (left_out, used): (Vec<_>, Vec<_>) =
            recorded.iter().enumerate().partition(|(index, _)| index % folds == fold);
        let films: Vec<&Film> = simulated.iter().chain(used.into_iter().map(|(_, film)| film)).collect();
        let mut with = PredictionConfig { predictor: Predictor::Lstm, model: "fold".to_owned().into() };
        with.model.attach(std::sync::Arc::new(train(config, &films, &mut |_| ())?));
        let mut errors = Errors::default();
        for (_, film) in left_out {
            errors.extend(Errors::on(film, &with)?);
        }
        progress.advance(1);
        Ok(errors)
    };
    let mut all = Errors::default();
    let found: Result<Vec<Errors>, PredictorError> = (0..folds).into_par_iter().map(fold).collect();
    found?.into_iter().for_each(|errors| all.extend(errors));
    Ok(all)
}

/// Errors on films that no training saw.
///
/// # Errors
/// If the weights were not loaded.
pub fn judge(films: &[Film], config: &PredictionConfig) -> Result<Errors, PredictorError> {
    let mut all = Errors::default();
    let found: Result<Vec<Errors>, ConfigError> = films.par_iter().map(|film| Errors::on(film, config)).collect();
    found?.into_iter().for_each(|errors| all.extend(errors));
    Ok(all)
}
