//! A training run in its folder.

use super::output::training_report;
use super::{EpochPoint, Film, PredictorError, simulated_films, train};
use crate::config::{RunConfig, SeedRole};
use crate::pages::REPORT;
use crate::progress::Progress;
use crate::run_dir::{CONFIG, RunDir, RunLog};

/// The trained weights.
pub const WEIGHTS: &str = "predictor.safetensors";
/// The learning curve, a row for each epoch.
pub const CURVE: &str = "training.csv";

/// Trains on simulated traffic and on `recorded` films, and fills the folder of `run`.
///
/// # Errors
/// If there is nothing to learn from, or the folder cannot be written.
pub fn train_run(
    run: &RunDir,
    config: &RunConfig,
    recorded: Vec<Film>,
    progress: &Progress,
) -> Result<(), PredictorError> {
    let settings = &config.predictor;
    let mut films = progress.stage("simulate", settings.scenarios as u64, |progress| {
        simulated_films(config, SeedRole::Prediction, settings.scenarios, progress)
    })?;
    let counts = (films.len(), recorded.len());
    films.extend(recorded);
    let mut log = RunLog::resume(&run.path().join(CURVE), 0)?;
    let (mut points, mut written) = (Vec::new(), Ok(()));
    let model = progress.stage("train", u64::from(settings.epochs), |progress| {
        let films: Vec<_> = films.iter().collect();
        train(config, &films, &mut |point: EpochPoint| {
            progress.note(&format!("loss {:.4}, watched {:.4}", point.loss, point.validation_loss));
            progress.advance(1);
            points.push(point);
            if written.is_ok() {
                written = log.csv(&point);
            }
        })
    })?;
    written?;
    log.sync()?;
    run.write(WEIGHTS, &model.to_bytes()?)?;
    let sources = format!("Learned from {} simulated scenarios and {} recorded sites.", counts.0, counts.1);
    run.write(REPORT, training_report(&points, &sources).page().as_bytes())?;
    Ok(run.finish(&[CONFIG, WEIGHTS, CURVE])?)
}
