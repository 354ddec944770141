//! `lanecraft evaluate`.

use std::path::{Path, PathBuf};

use clap::Args;
use lanecraft_lab::baselines::{Rule, UnknownRule};
use lanecraft_lab::config::{EnvironmentConfig as Config, SeedRole, nearest};
use lanecraft_lab::evaluate::evaluate;
use lanecraft_lab::pairing::{Entrant, environments};
use lanecraft_lab::policy::Policy as Driver;
use lanecraft_lab::runs::RunError;

use crate::args::{ConfigArgs, ScenarioArg, ThreadsArg, flag, folder};
use crate::output::{Output, answer};
use crate::table::print_results;

const EXAMPLES: &str = "\
Examples:
  lanecraft evaluate rule:best-lane rule:keep-lane
  lanecraft evaluate runs/mine rule:best-lane --episodes 500
  lanecraft evaluate runs/a runs/b --json > results.jsonl
  lanecraft evaluate runs/mine rule:best-lane --scenario scenarios/splits/dense-ood.toml

All policies drive in the same scenarios, which no training sees.
Rules: rule:keep-lane, rule:random, rule:idm-mobil, rule:best-lane, rule:proposals.";

/// Drive policies in the same scenarios and compare them
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Evaluate {
    /// Folders of trained runs, and rules
    #[arg(value_name = "DIR|rule:NAME", required = true, value_parser = policy)]
    policies: Vec<Policy>,
    /// Scenarios to drive
    #[arg(long, value_name = "N")]
    episodes: Option<u64>,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    scenario: ScenarioArg,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

/// Who drives.
#[derive(Clone, Debug)]
pub(crate) enum Policy {
    Rule(Rule),
    Run(PathBuf),
}

pub(crate) fn policy(text: &str) -> Result<Policy, String> {
    let Some(name) = text.strip_prefix("rule:") else {
        return folder(text).map(Policy::Run).map_err(|error| {
            let known = nearest(text, Rule::NAMES).filter(|_| !error.contains("did you mean"));
            error + &known.map_or_else(String::new, |rule| format!("; did you mean `rule:{rule}`?"))
        });
    };
    name.parse().map(Policy::Rule).map_err(|error: UnknownRule| {
        let hint = nearest(name, Rule::NAMES).map_or_else(String::new, |name| format!("; did you mean `rule:{name}`?"));
        format!("{error}{hint}")
    })
}

impl Evaluate {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let scenario = self.scenario.flag()?;
        let flags = flag("evaluation.episodes", self.episodes).into_iter().chain(scenario.clone());
        let config = self.config.resolve(flags.collect())?;
        let drivers = self.policies.iter().map(Policy::entrant).collect::<Result<Vec<_>, _>>()?;
        let of_run = |path: &Path| self.config.resolve_over(path, scenario.iter().cloned().collect());
        let environments = environments(&drivers, &config.environment, of_run)?;
        let steps = drivers.len() * config.evaluation.episodes;
        let episodes = self.threads.run(|| {
            output.with_progress(|progress| {
                progress.stage("evaluate", steps as u64, |progress| {
                    let drive = |(driver, environment): (&Entrant, &Config)| {
                        evaluate(&driver.policy, environment, &config.evaluation, SeedRole::Test, progress)
                    };
                    drivers.iter().zip(&environments).map(drive).collect::<Result<Vec<_>, _>>()
                })
            })
        })??;
        if self.json {
            return episodes.iter().try_for_each(|of| Ok(answer(&serde_json::to_string(&of.result()?)?)?));
        }
        print_results(&episodes)
    }
}

impl Policy {
    pub(crate) fn entrant(&self) -> Result<Entrant, RunError> {
        match self {
            Self::Rule(rule) => Ok(Driver::Rule(*rule).into()),
            Self::Run(path) => Entrant::of_run(path),
        }
    }
}
