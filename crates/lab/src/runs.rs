//! Runs on disk: training that survives being killed, and what a finished run can be asked for.

use std::fs;
use std::io;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::config::{ConfigFileError, RunConfig};
use crate::metrics::CurvePoint;
use crate::policy::{Policy, run_name};
use crate::progress::Progress;
use crate::run_dir::{CONFIG, RunDir, RunDirError, RunLog, sha256_hex, tensorboard};
use crate::train::{TrainError, Trainer, TrainingState};

/// The checkpoint of a run, from which it goes on; it names the file with its tensors.
pub const CHECKPOINT: &str = "checkpoint.json";
/// The trained network alone.
pub const POLICY: &str = "policy.safetensors";
/// Its shape.
pub const POLICY_SHAPE: &str = "policy.json";
/// The learning curve, a row for each point.
pub const CURVE_CSV: &str = "training.csv";
/// The same as JSON lines.
pub const CURVE_JSONL: &str = "training.jsonl";

/// The same as events for TensorBoard, which finds files by this part of their name.
pub const CURVE_EVENTS: &str = "training.tfevents";

/// Why a run on disk cannot go on or be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// Its folder or a file in it cannot be used.
    #[error(transparent)]
    Dir(#[from] RunDirError),
    /// Training stopped; the last checkpoint is kept.
    #[error("{}: {source}", path.display())]
    Train {
        /// The run or its file.
        path: std::path::PathBuf,
        /// Why.
        source: TrainError,
    },
    /// Its configuration cannot be read.
    #[error(transparent)]
    Config(#[from] ConfigFileError),
    /// The run has not come to its end.
    #[error("{} is not finished: it has no {POLICY}; `lanecraft train --resume` goes on with it", path.display())]
    Unfinished {
        /// The run.
        path: std::path::PathBuf,
    },
}

/// What `checkpoint.json` holds.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Checkpoint {
    /// Name of the file with the tensors.
    tensors: String,
    /// Its SHA-256.
    tensors_sha256: String,
    /// Lengths of the logs: what was written after the checkpoint is cut off when the run goes on.
    logs: LogLengths,
    /// Everything else.
    state: TrainingState,
}

/// Lengths of a run's logs, bytes.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LogLengths {
    csv: u64,
    jsonl: u64,
    events: u64,
}

/// Trains in `run` until all decisions are taken, from its checkpoint if it has one. Returns the time spent in updates, s, which ran
/// beside the driving.
pub fn train(run: &RunDir, config: &RunConfig, progress: &Progress) -> Result<f64, RunError> {
    let (mut trainer, lengths) = match read_checkpoint(run, config)? {
        Some(resumed) => resumed,
        None => (Trainer::new(config).map_err(fail(run.path()))?, LogLengths::default()),
    };
    let mut logs = Logs::open(run, lengths)?;
    let total = config.training.decisions;
    progress.stage("train", total, |progress| {
        progress.advance(trainer.decisions());
        while !trainer.is_finished() {
            let before = trainer.decisions();
            let point = trainer.round().map_err(fail(run.path()))?;
            if let Some(point) = &point {
                logs.append(point)?;
                progress.note(&describe(point));
            }
            progress.advance(trainer.decisions().min(total).saturating_sub(before));
            let every = config.training.checkpoint_every_decisions;
            if trainer.decisions() / every != before / every {
                write_checkpoint(run, &trainer, logs.sync()?)?;
            }
        }
        Ok::<(), RunError>(())
    })?;
    write_checkpoint(run, &trainer, logs.sync()?)?;
    let (shape, network) = trainer.policy().to_bytes().map_err(|error| fail(run.path())(error.into()))?;
    run.write(POLICY, &network)?;
    run.write(POLICY_SHAPE, &to_json(&shape))?;
    run.finish(&[CONFIG, CHECKPOINT, POLICY, POLICY_SHAPE, CURVE_CSV, CURVE_JSONL, CURVE_EVENTS])?;
    Ok(trainer.learning_time().as_secs_f64())
}

/// Removes the checkpoint of a finished run, by far its largest file: the run cannot go on any more, but all else can be done with it.
pub fn drop_checkpoint(run: &RunDir) -> Result<(), RunError> {
    run.finish(&[CONFIG, POLICY, POLICY_SHAPE, CURVE_CSV, CURVE_JSONL, CURVE_EVENTS])?;
    let path = run.path().join(CHECKPOINT);
    fs::remove_file(&path).map_err(RunDirError::io("remove", &path))?;
    remove_other_tensors(run, "")
}

fn fail(path: &Path) -> impl FnOnce(TrainError) -> RunError {
    let path = path.to_owned();
    move |source| RunError::Train { path, source }
}

fn to_json<T: Serialize>(value: &T) -> Vec<u8> {
    let mut text = serde_json::to_vec(value).expect("plain numbers and names serialize");
    text.push(b'\n');
    text
}

/// The tensors go into a file of their own name first; the checkpoint that names them then replaces the last one in a single step,
/// so that at every instant there is one that can be read.
fn write_checkpoint(run: &RunDir, trainer: &Trainer, logs: LogLengths) -> Result<(), RunError> {
    let (state, bytes) = trainer.checkpoint().map_err(fail(run.path()))?;
    let tensors = format!("checkpoint-{:09}.safetensors", trainer.decisions());
    run.write(&tensors, &bytes)?;
    let checkpoint = Checkpoint { tensors_sha256: sha256_hex(&bytes), logs, state, tensors };
    run.write(CHECKPOINT, &to_json(&checkpoint))?;
    remove_other_tensors(run, &checkpoint.tensors)
}

fn remove_other_tensors(run: &RunDir, keep: &str) -> Result<(), RunError> {
    let entries = fs::read_dir(run.path()).map_err(RunDirError::io("read", run.path()))?;
    for entry in entries.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with("checkpoint-") && name.ends_with(".safetensors") && name != keep {
            fs::remove_file(entry.path()).map_err(RunDirError::io("remove", &entry.path()))?;
        }
    }
    Ok(())
}

fn read_checkpoint(run: &RunDir, config: &RunConfig) -> Result<Option<(Trainer, LogLengths)>, RunError> {
    let path = run.path().join(CHECKPOINT);
    let Some(text) = read_optional(&path)? else { return Ok(None) };
    let checkpoint: Checkpoint = serde_json::from_slice(&text).map_err(|error| broken(&path, error.to_string()))?;
    let tensors = run.path().join(&checkpoint.tensors);
    let bytes = fs::read(&tensors).map_err(RunDirError::io("read", &tensors))?;
    if sha256_hex(&bytes) != checkpoint.tensors_sha256 {
        return Err(broken(&tensors, format!("its content is not what {CHECKPOINT} says it is")));
    }
    let trainer = Trainer::resume(config, &checkpoint.state, &bytes).map_err(fail(&path))?;
    Ok(Some((trainer, checkpoint.logs)))
}

fn broken(path: &Path, message: String) -> RunError {
    RunDirError::Broken { path: path.to_owned(), message }.into()
}

fn describe(point: &CurvePoint) -> String {
    format!(
        "reward {:.2}, {:.1} m/s, collisions {:.1} %, agreement {:.0} %",
        point.reward_per_tick,
        point.speed_mps,
        100.0 * point.collisions_per_episode,
        100.0 * point.agreement
    )
}

/// The logs of a learning curve.
struct Logs {
    csv: RunLog,
    jsonl: RunLog,
    events: RunLog,
}

impl Logs {
    fn open(run: &RunDir, lengths: LogLengths) -> Result<Self, RunDirError> {
        let open = |name, len| RunLog::resume(&run.path().join(name), len);
        let mut events = open(CURVE_EVENTS, lengths.events)?;
        if lengths.events == 0 {
            events.append(&tensorboard::header())?;
        }
        Ok(Self { csv: open(CURVE_CSV, lengths.csv)?, jsonl: open(CURVE_JSONL, lengths.jsonl)?, events })
    }

    fn append(&mut self, point: &CurvePoint) -> Result<(), RunDirError> {
        self.csv.csv(point)?;
        self.jsonl.json(point)?;
        let CurvePoint { decisions, updates, reward_per_tick, speed_mps, .. } = *point;
        let values = [
            ("training/reward_per_tick", reward_per_tick),
            ("training/speed_mps", speed_mps),
            ("training/collisions_per_episode", point.collisions_per_episode),
            ("training/loss", point.loss),
            ("training/agreement", point.agreement),
            ("training/epsilon", point.epsilon),
            ("training/updates", updates as f64),
        ];
        self.events.append(&tensorboard::scalars(decisions, &values))
    }

    fn sync(&mut self) -> Result<LogLengths, RunDirError> {
        let logs = [&mut self.csv, &mut self.jsonl, &mut self.events];
        for log in logs {
            log.sync()?;
        }
        Ok(LogLengths { csv: self.csv.len_bytes(), jsonl: self.jsonl.len_bytes(), events: self.events.len_bytes() })
    }
}

/// The configuration of a run.
pub fn read_config(run: &Path) -> Result<RunConfig, RunError> {
    RunDir::open(run)?;
    let path = run.join(CONFIG);
    let text = fs::read_to_string(&path).map_err(RunDirError::io("read", &path))?;
    Ok(RunConfig::from_toml(&path, &text)?)
}

/// The trained policy of a finished run, under the name of its folder.
pub fn read_policy(run: &Path) -> Result<Policy, RunError> {
    RunDir::open(run)?;
    let (path, shape_path) = (run.join(POLICY), run.join(POLICY_SHAPE));
    let unfinished = || RunError::Unfinished { path: run.to_owned() };
    let shape = read_optional(&shape_path)?.ok_or_else(unfinished)?;
    let shape = serde_json::from_slice(&shape).map_err(|error| broken(&shape_path, error.to_string()))?;
    let bytes = read_optional(&path)?.ok_or_else(unfinished)?;
    let network = lanecraft_learn::Policy::from_bytes(&shape, &bytes).map_err(|e| fail(&path)(e.into()))?;
    Ok(Policy::Learned { name: run_name(run), network })
}

/// The learning curve of a run.
pub fn read_curve(run: &Path) -> Result<Vec<CurvePoint>, RunError> {
    let path = run.join(CURVE_JSONL);
    let text = fs::read_to_string(&path).map_err(RunDirError::io("read", &path))?;
    let parse = |(number, line): (usize, &str)| {
        serde_json::from_str(line).map_err(|error| broken(&path, format!("line {}: {error}", number + 1)))
    };
    text.lines().enumerate().map(parse).collect()
}

fn read_optional(path: &Path) -> Result<Option<Vec<u8>>, RunDirError> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(RunDirError::io("read", path)(error)),
    }
}
