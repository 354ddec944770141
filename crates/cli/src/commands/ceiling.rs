//! `lanecraft ceiling`.

use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Args;
use lanecraft_lab::ceiling::{CEILING, ceilings, report};
use lanecraft_lab::config::{EnvironmentConfig, EvaluationConfig, RunConfig, SeedRole};
use lanecraft_lab::evaluate::{EvaluateError, PolicyEpisodes, evaluate};
use lanecraft_lab::pairing::{Entrant, environments};
use lanecraft_lab::progress::Progress;
use lanecraft_lab::run_dir::{CONFIG, Existing, MANIFEST, Manifest, RunDir};
use lanecraft_lab::runs;

use super::evaluate::{Policy, policy};
use crate::args::{ConfigArgs, ScenarioArg, ThreadsArg};
use crate::output::{Output, answer};

const EXAMPLES: &str = "\
Examples:
  lanecraft ceiling --out runs/ceiling
  lanecraft ceiling rule:best-lane models/highway --episodes 20 --width 25 50 100 --out runs/ceiling
  lanecraft ceiling --set traffic.density_veh_per_km_lane=20 --out runs/dense
  lanecraft ceiling --episodes 40 --out runs/ceiling --resume

Drives the first of the scenarios that `lanecraft evaluate` drives, knowing what the others will do: what no policy can beat by more than
the beam's width leaves open. Writes a row for each scenario and width as it comes; --resume computes the missing ones.";

/// Search for the best drive in each scenario, to hold policies against
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Ceiling {
    /// Folders of trained runs, and rules, to be held against it
    #[arg(value_name = "DIR|rule:NAME", value_parser = policy)]
    policies: Vec<Policy>,
    /// Folder for the drives
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Scenarios to search
    #[arg(long, value_name = "N", default_value = "20", value_parser = clap::value_parser!(u32).range(2..=100_000))]
    episodes: u32,
    /// Widths of the beam; a minute of a scenario takes a core about half a second for each member
    #[arg(long, value_name = "W", num_args = 1.., default_value = "100", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    width: Vec<u32>,
    /// Keep what is in the folder and add what is missing
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Replace a run that has this folder
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    scenario: ScenarioArg,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Ceiling {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let scenario: Vec<String> = self.scenario.flag()?.into_iter().collect();
        let drivers = self.policies.iter().map(Policy::entrant).collect::<Result<Vec<_>, _>>()?;
        let of_run = |path: &Path| self.config.resolve_over(path, scenario.clone());
        let without_run = self.config.resolve(scenario.clone())?;
        let environments = environments(&drivers, &without_run.environment, of_run)?;
        // The search drives in the environment of the first policy.
        let environment = environments.first().cloned().unwrap_or_else(|| without_run.environment.clone());
        let config = RunConfig { environment, ..without_run };
        let run = self.folder(&config)?;
        let widths: Vec<usize> = self.width.iter().map(|&width| width as usize).collect();
        let (rows, episodes) = self.threads.run(|| {
            output.with_progress(|progress| {
                let rows = ceilings(&run, &config, (self.episodes as usize, &widths), progress)?;
                let pairs: Vec<_> = drivers.into_iter().zip(environments).collect();
                Ok::<_, anyhow::Error>((rows, self.drive(&pairs, &config.evaluation, progress)?))
            })
        })??;
        let report = report(&rows, &episodes)?;
        run.finish(&[CONFIG, CEILING])?;
        answer(report.text().trim_end())?;
        for path in report.write(&self.out)? {
            output.note(&format!("wrote {}", path.display()));
        }
        Ok(())
    }

    /// The policies in the scenarios of the search.
    fn drive(
        &self,
        pairs: &[(Entrant, EnvironmentConfig)],
        evaluation: &EvaluationConfig,
        progress: &Progress,
    ) -> Result<Vec<PolicyEpisodes>, EvaluateError> {
        let evaluation = EvaluationConfig { episodes: self.episodes as usize, ..evaluation.clone() };
        progress.stage("evaluate", (pairs.len() * evaluation.episodes) as u64, |progress| {
            let drive = |(driver, environment): &(Entrant, EnvironmentConfig)| {
                evaluate(&driver.policy, environment, &evaluation, SeedRole::Test, progress)
            };
            pairs.iter().map(drive).collect()
        })
    }

    fn folder(&self, config: &RunConfig) -> anyhow::Result<RunDir> {
        if self.resume && self.out.join(MANIFEST).exists() { self.reopen(config) } else { self.create(config) }
    }

    fn create(&self, config: &RunConfig) -> anyhow::Result<RunDir> {
        let manifest = Manifest::new("ceiling", self.config.preset.preset().name(), config);
        let existing = if self.force { Existing::Replace } else { Existing::Refuse };
        Ok(RunDir::create(&self.out, existing, &manifest, config)?)
    }

    /// The folder with what was found so far, if it is of the same scenarios.
    fn reopen(&self, config: &RunConfig) -> anyhow::Result<RunDir> {
        let (run, manifest) = RunDir::open(&self.out)?;
        if manifest.command != "ceiling" || runs::read_config(&self.out)? != *config {
            bail!(
                "{} was begun with other numbers; it is added to only as it began, or anew with `--force`",
                run.path().display()
            );
        }
        Ok(run)
    }
}
