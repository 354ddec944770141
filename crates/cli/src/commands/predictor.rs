//! `lanecraft predictor`: what the others will do.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use lanecraft_lab::config::{RunConfig, SeedRole};
use lanecraft_lab::policy::Policy as Driver;
use lanecraft_lab::predictor::{
    Errors, Film, PredictorError, SWAPPED, cross_validate, judge, recorded_films, report, simulated_films, swap,
    swap_report, train_run,
};
use lanecraft_lab::progress::Progress;
use lanecraft_lab::run_dir::{Existing, Manifest, RunDir};
use lanecraft_lab::runs;

use super::evaluate::{Policy, policy};
use super::write_report;
use crate::args::{ConfigArgs, ThreadsArg, flag};
use crate::output::{Output, answer};

/// Train and judge the recurrent predictor
#[derive(Debug, Subcommand)]
pub(crate) enum Predictor {
    Train(Train),
    Evaluate(Evaluate),
    Swap(Swap),
}

/// Recorded traffic.
#[derive(Debug, Args)]
struct Recordings {
    /// Recording, or folder with `traffic.csv.gz`; may be repeated
    #[arg(long, value_name = "PATH")]
    data: Vec<PathBuf>,
    /// What the names of the sites to use begin with: no streets with signals, which are another matter
    #[arg(long, value_name = "PREFIX", default_value = "us101")]
    sites: String,
}

impl Recordings {
    fn films(&self) -> Result<Vec<Film>, PredictorError> {
        let films: Result<Vec<_>, _> = self.data.iter().map(|path| recorded_films(path, &self.sites)).collect();
        Ok(films?.into_iter().flatten().collect())
    }
}

const TRAIN_EXAMPLES: &str = "\
Examples:
  lanecraft predictor train --out runs/predictor
  lanecraft predictor train --data recordings --out runs/predictor
  lanecraft evaluate rule:best-lane --set prediction.predictor=lstm --set prediction.model=runs/predictor/predictor.safetensors";

/// Train the network on simulated and recorded traffic and write everything about it to a folder
#[derive(Debug, Args)]
#[command(after_help = TRAIN_EXAMPLES)]
pub(crate) struct Train {
    /// Folder of the run
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    recordings: Recordings,
    /// Seed of everything random
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Replace a run that has this folder
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Train {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let config = self.config.resolve(flag("training.seed", self.seed).into_iter().collect())?;
        let existing = if self.force { Existing::Replace } else { Existing::Refuse };
        RunDir::check(&self.out, existing)?;
        self.threads.run(|| -> Result<(), PredictorError> {
            let recorded = self.recordings.films()?;
            if recorded.is_empty() && config.predictor.scenarios == 0 {
                return Err(PredictorError::NoSamples);
            }
            let manifest = Manifest::new("predictor train", self.config.preset.preset().name(), &config);
            let run = RunDir::create(&self.out, existing, &manifest, &config)?;
            output.with_progress(|progress| train_run(&run, &config, recorded, progress))
        })??;
        Ok(answer(&format!("{} is finished", self.out.display()))?)
    }
}

const EVALUATE_EXAMPLES: &str = "\
Examples:
  lanecraft predictor evaluate
  lanecraft predictor evaluate --data recordings --out figures

On simulated traffic the weights of `prediction.model` are judged in test scenarios, which no training sees. On recorded sites the network is
trained anew, as `lanecraft predictor train` would, without the sites that it is judged on.";

/// How far the predictors are off on traffic that no training saw
#[derive(Debug, Args)]
#[command(after_help = EVALUATE_EXAMPLES)]
pub(crate) struct Evaluate {
    #[command(flatten)]
    recordings: Recordings,
    /// Groups of sites that are left out in turn
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(2..=100))]
    folds: u16,
    /// Simulated test scenarios
    #[arg(long, value_name = "N", default_value_t = 12)]
    scenarios: usize,
    /// Folder for tables, as CSV and Markdown, and a page that shows them
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Evaluate {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let config = self.config.resolve(Vec::new())?;
        let found = self.threads.run(|| output.with_progress(|progress| self.errors(&config, progress)))??;
        if self.json {
            for (kind, errors) in &found {
                for row in errors.rows()? {
                    let object = serde_json::json!({ "traffic": kind, "vehicles": errors.vehicles(), "row": row });
                    answer(&object.to_string())?;
                }
            }
        } else {
            answer(report(&found)?.text().trim_end())?;
        }
        self.out.as_ref().map_or(Ok(()), |folder| write_report(&report(&found)?, folder, output))
    }

    fn errors(&self, config: &RunConfig, progress: &Progress) -> anyhow::Result<Vec<(&'static str, Errors)>> {
        let recorded = self.recordings.films()?;
        let mut found = Vec::new();
        if self.scenarios > 0 {
            let films = progress.stage("simulate", self.scenarios as u64, |progress| {
                simulated_films(config, SeedRole::Test, self.scenarios, progress)
            })?;
            found.push(("simulated traffic", judge(&films, &config.environment.prediction)?));
        }
        if !recorded.is_empty() {
            let count = config.predictor.scenarios;
            let simulated = progress.stage("simulate", count as u64, |progress| {
                simulated_films(config, SeedRole::Prediction, count, progress)
            })?;
            let folds = usize::from(self.folds);
            let errors = progress.stage("train", folds as u64, |progress| {
                cross_validate(config, [&simulated, &recorded], folds, progress)
            })?;
            found.push(("recorded traffic", errors));
        }
        Ok(found)
    }
}

const SWAP_EXAMPLES: &str = "\
Examples:
  lanecraft predictor swap
  lanecraft predictor swap --policy rule:best-lane --policy runs/mine --episodes 500 --out figures";

/// Drive policies with each predictor in planner and controllers, and with the true future, in the same scenarios
#[derive(Debug, Args)]
#[command(after_help = SWAP_EXAMPLES)]
pub(crate) struct Swap {
    /// Folder of a trained run, or a rule; may be repeated
    #[arg(long, value_name = "DIR|rule:NAME", default_value = "rule:best-lane", value_parser = policy)]
    policy: Vec<Policy>,
    /// Scenarios to drive
    #[arg(long, value_name = "N")]
    episodes: Option<u64>,
    /// Folder for the table, as CSV and Markdown
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Swap {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let config = self.config.resolve(flag("evaluation.episodes", self.episodes).into_iter().collect())?;
        let drivers = self.policy.iter().map(|policy| match policy {
            Policy::Rule(rule) => Ok(Driver::Rule(*rule)),
            Policy::Run(path) => runs::read_policy(path),
        });
        let drivers = drivers.collect::<Result<Vec<_>, _>>()?;
        let steps = (drivers.len() * SWAPPED.len() * config.evaluation.episodes) as u64;
        let swaps = self.threads.run(|| {
            output
                .with_progress(|progress| progress.stage("drive", steps, |progress| swap(&drivers, &config, progress)))
        })??;
        if self.json {
            return swaps.iter().try_for_each(|swap| Ok(answer(&serde_json::to_string(swap)?)?));
        }
        let report = swap_report(&swaps);
        answer(report.text().trim_end())?;
        self.out.as_ref().map_or(Ok(()), |folder| write_report(&report, folder, output))
    }
}
