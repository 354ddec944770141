//! Runs the units of an experiment that have no row yet.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::analysis::Curves;
use super::definition::{Budget, Definition, DefinitionError, Variant};
use super::rows::{ROWS, UnitRow, read_rows, write_rows};
use crate::config::{RunConfig, SeedRole};
use crate::evaluate::{EvaluateError, evaluate};
use crate::metrics::CurvePoint;
use crate::policy::Policy;
use crate::progress::Progress;
use crate::run_dir::{Existing, Manifest, RunDir, RunDirError, sha256_hex};
use crate::runs::{self, CURVE_JSONL, RunError};
use crate::stats::StatsError;

/// Why an experiment stopped; the rows that were written stay.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExperimentError {
    /// Its definition.
    #[error(transparent)]
    Definition(#[from] DefinitionError),
    /// Its folder or a file in it.
    #[error(transparent)]
    Dir(#[from] RunDirError),
    /// A training.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A test.
    #[error("{}: {source}", unit.display())]
    Evaluate {
        /// The unit.
        unit: PathBuf,
        /// Why.
        source: EvaluateError,
    },
    /// The intervals.
    #[error(transparent)]
    Stats(#[from] StatsError),
    /// The operating system gave no threads.
    #[error("cannot start a thread: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// Units without a row.
    #[error("experiment `{experiment}` has no row of {}; run it without `--rows-only`", missing.join(", "))]
    Missing {
        /// The experiment.
        experiment: String,
        /// The units.
        missing: Vec<String>,
    },
}

/// One variant with one training seed.
struct Unit<'a> {
    variant: &'a Variant,
    seed: u64,
    /// Digest of all that is laid over the preset.
    settings: String,
    /// The same without what is for the test alone: units with the same training share its run.
    training: String,
}

impl Unit<'_> {
    fn name(&self) -> String {
        format!("{}, seed {}", self.variant.name, self.seed)
    }

    fn is_in(&self, rows: &[UnitRow]) -> bool {
        self.row(rows).is_some()
    }

    fn row<'r>(&self, rows: &'r [UnitRow]) -> Option<&'r UnitRow> {
        rows.iter()
            .find(|row| (&row.variant, row.seed, &row.settings) == (&self.variant.name, self.seed, &self.settings))
    }
}

/// Runs what is missing of `definition`, `jobs` units at a time, and gives all its rows, in the order of the variants and seeds. Each unit
/// is a step of progress. `folder` holds the rows and the trained runs; a unit that was interrupted goes on from its checkpoint.
///
/// # Errors
/// If a unit fails; those that run beside it are finished first, and their rows written.
pub fn run(
    definition: &Definition,
    budget: Budget,
    folder: &Path,
    jobs: usize,
    progress: &Progress,
) -> Result<Vec<UnitRow>, ExperimentError> {
    std::fs::create_dir_all(folder).map_err(RunDirError::io("make", folder))?;
    let units = units(definition, budget)?;
    let path = folder.join(ROWS);
    let rows = Mutex::new(read_rows(&path)?);
    let missing: Vec<&Unit> = units.iter().filter(|unit| !unit.is_in(&lock(&rows))).collect();
    let groups = by_training(&missing);
    let run_group = |pool: &rayon::ThreadPool, group: &[&Unit]| {
        for unit in group {
            let row = pool.install(|| run_unit(definition, budget, unit, folder))?;
            progress.note(&format!("{}: reward {:.2}", unit.name(), row.reward_per_tick));
            let mut rows = lock(&rows);
            rows.push(row);
            write_rows(&path, &mut rows)?;
            progress.advance(1);
        }
        Ok::<(), ExperimentError>(())
    };
    let (next, failure) = (AtomicUsize::new(0), Mutex::new(None));
    let work = |pool: &rayon::ThreadPool| {
        while let Some(group) = groups.get(next.fetch_add(1, Ordering::Relaxed)) {
            if let Err(error) = run_group(pool, group) {
                next.store(groups.len(), Ordering::Relaxed);
                lock(&failure).get_or_insert(error);
            }
        }
    };
    progress.stage(&definition.name, missing.len() as u64, |_| {
        let jobs = jobs.clamp(1, groups.len().max(1));
        let threads = (rayon::current_num_threads() / jobs).max(1);
        let pool = || rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pools = (0..jobs).map(|_| pool()).collect::<Result<Vec<_>, _>>()?;
        std::thread::scope(|scope| pools.iter().for_each(|pool| drop(scope.spawn(|| work(pool)))));
        Ok::<(), ExperimentError>(())
    })?;
    if let Some(error) = failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(error);
    }
    collect(definition, &units, &lock(&rows))
}

/// The rows of all units in `folder`, in the order of the variants and seeds; nothing is run.
///
/// # Errors
/// If a unit has no row; all of those are named.
pub fn rows_of(definition: &Definition, budget: Budget, folder: &Path) -> Result<Vec<UnitRow>, ExperimentError> {
    collect(definition, &units(definition, budget)?, &read_rows(&folder.join(ROWS))?)
}

/// The learning curves of the units whose runs are in `folder`, by variant; one that several variants share stands under the first.
///
/// # Errors
/// If a log cannot be read.
pub fn curves_of(definition: &Definition, budget: Budget, folder: &Path) -> Result<Curves, ExperimentError> {
    let units = units(definition, budget)?;
    let mut curves: Curves = Vec::new();
    for group in by_training(&units.iter().collect::<Vec<_>>()) {
        let (path, variant) = (unit_folder(folder, group[0]), &group[0].variant.name);
        if !path.join(CURVE_JSONL).exists() {
            continue;
        }
        let every = runs::read_config(&path)?.training.log_every_decisions;
        // A point is logged at the end of the round in which it falls due, which differs from seed to seed.
        let due = |point: CurvePoint| CurvePoint { decisions: point.decisions / every * every, ..point };
        let curve = runs::read_curve(&path)?.into_iter().map(due).collect();
        match curves.iter_mut().find(|(name, _)| name == variant) {
            Some((_, seeds)) => seeds.push(curve),
            None => curves.push((variant.clone(), vec![curve])),
        }
    }
    Ok(curves)
}

fn collect(definition: &Definition, units: &[Unit], rows: &[UnitRow]) -> Result<Vec<UnitRow>, ExperimentError> {
    let missing: Vec<String> = units.iter().filter(|unit| !unit.is_in(rows)).map(Unit::name).collect();
    if !missing.is_empty() {
        return Err(ExperimentError::Missing { experiment: definition.name.clone(), missing });
    }
    Ok(units.iter().filter_map(|unit| unit.row(rows).cloned()).collect())
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Units of the same training, which is done once, in one place; in the order of their first units.
fn by_training<'a>(units: &[&'a Unit<'a>]) -> Vec<Vec<&'a Unit<'a>>> {
    let mut groups: Vec<Vec<&Unit>> = Vec::new();
    for unit in units {
        match groups.iter_mut().find(|group| group[0].training == unit.training) {
            Some(group) => group.push(unit),
            None => groups.push(vec![unit]),
        }
    }
    groups
}

fn units(definition: &Definition, budget: Budget) -> Result<Vec<Unit<'_>>, DefinitionError> {
    let mut units = Vec::new();
    for variant in &definition.variants {
        // A rule learns nothing, so that one unit says all.
        let seeds = if definition.rule(variant)?.is_some() { 1 } else { budget.seeds };
        for seed in 0..seeds {
            let Budget { decisions, episodes, .. } = budget;
            let decisions = if variant.policy.is_empty() { decisions } else { 0 };
            let training = digest(&[
                &format!("{} {decisions} {seed} {}", definition.preset, variant.policy),
                &definition.base.to_string(),
                &variant.set.to_string(),
                &variant.train.to_string(),
            ]);
            let settings = digest(&[&training, &episodes.to_string(), &variant.test.to_string()]);
            units.push(Unit { variant, seed, settings, training });
        }
    }
    Ok(units)
}

/// Sixteen hexadecimal digits that stand for these texts.
fn digest(texts: &[&str]) -> String {
    let mut digits = sha256_hex(format!("{texts:?}").as_bytes());
    digits.truncate(16);
    digits
}

fn run_unit(definition: &Definition, budget: Budget, unit: &Unit, folder: &Path) -> Result<UnitRow, ExperimentError> {
    let [train, test] = definition.configs(unit.variant, budget, unit.seed)?;
    let path = unit_folder(folder, unit);
    let (policy, decisions) = match definition.rule(unit.variant)? {
        Some(rule) => (Policy::Rule(rule), 0),
        None => (trained(&path, &definition.preset, &train)?, budget.decisions),
    };
    let tested = evaluate(&policy, &test.environment, &test.evaluation, SeedRole::Test, &Progress::silent())
        .map_err(|source| ExperimentError::Evaluate { unit: path, source })?;
    Ok(UnitRow::new((&unit.variant.name, unit.seed), unit.settings.clone(), decisions, &tested)?)
}

/// The folder of a unit's training.
fn unit_folder(folder: &Path, unit: &Unit) -> PathBuf {
    folder.join("runs").join(&unit.training)
}

/// The policy of the run in `path`, which is begun, gone on with, or already finished.
fn trained(path: &Path, preset: &str, config: &RunConfig) -> Result<Policy, ExperimentError> {
    let (run, finished) = match RunDir::open(path) {
        Ok((run, manifest)) if runs::read_config(path)? == *config => (run, manifest.finished),
        _ => {
            let manifest = Manifest::new("train", preset, config);
            if let Some(parent) = path.parent() {
                std::fs::create_dir_all(parent).map_err(RunDirError::io("make", parent))?;
            }
            (RunDir::create(path, Existing::Replace, &manifest, config)?, false)
        }
    };
    if !finished {
        runs::train(&run, config, &Progress::silent())?;
        runs::drop_checkpoint(&run)?;
    }
    Ok(runs::read_policy(path)?)
}
