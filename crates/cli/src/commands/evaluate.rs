//! `lanecraft evaluate`.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use lanecraft_lab::baselines::{Rule, UnknownRule};
use lanecraft_lab::config::{EnvironmentConfig as Config, RunConfig, SeedRole, nearest};
use lanecraft_lab::evaluate::evaluate;
use lanecraft_lab::policy::Policy as Driver;
use lanecraft_lab::run_dir::{CONFIG, RunDir};
use lanecraft_lab::runs;

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
Rules: rule:keep-lane, rule:random, rule:idm-mobil, rule:best-lane.";

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

/// Whether the same seeds give the same scenarios in both: a scenario file stands for road and traffic.
fn same_scenarios(a: &Config, b: &Config) -> bool {
    a.env.scenario == b.env.scenario && (!a.env.scenario.is_empty() || (&a.road, &a.traffic) == (&b.road, &b.traffic))
}

impl Evaluate {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let scenario = self.scenario.flag()?;
        let flags = flag("evaluation.episodes", self.episodes).into_iter().chain(scenario.clone());
        let config = self.config.resolve(flags.collect())?;
        let drivers = self.drivers(&config, scenario.as_ref())?;
        let steps = drivers.len() * config.evaluation.episodes;
        let episodes = self.threads.run(|| {
            output.with_progress(|progress| {
                progress.stage("evaluate", steps as u64, |progress| {
                    let drive = |(policy, environment): &(Driver, Config)| {
                        evaluate(policy, environment, &config.evaluation, SeedRole::Test, progress)
                    };
                    drivers.iter().map(drive).collect::<Result<Vec<_>, _>>()
                })
            })
        })??;
        if self.json {
            return episodes.iter().try_for_each(|of| Ok(answer(&serde_json::to_string(&of.result()?)?)?));
        }
        print_results(&episodes)
    }

    /// Each policy with its environment: a run's own with what the command line sets over it, and for a rule that of the first run,
    /// or of the command line without any.
    fn drivers(&self, config: &RunConfig, scenario: Option<&String>) -> anyhow::Result<Vec<(Driver, Config)>> {
        let mut first: Option<(&PathBuf, Config)> = None;
        let mut drivers = Vec::new();
        for policy in &self.policies {
            let Policy::Run(path) = policy else { continue };
            RunDir::open(path)?;
            let flags = scenario.into_iter().cloned().collect();
            let environment = self.config.resolve_over(&path.join(CONFIG), flags)?.environment;
            let (other, expected) = first.get_or_insert_with(|| (path, environment.clone()));
            if !same_scenarios(&environment, expected) {
                bail!(
                    "{} and {} were trained on other roads or in other traffic, so their scenarios cannot be paired",
                    other.display(),
                    path.display()
                );
            }
            drivers.push((runs::read_policy(path)?, environment));
        }
        let environment = first.map_or_else(|| config.environment.clone(), |(_, environment)| environment);
        let mut runs = drivers.into_iter();
        let seat = |policy: &Policy| match policy {
            Policy::Rule(rule) => Some((Driver::Rule(*rule), environment.clone())),
            Policy::Run(_) => runs.next(),
        };
        Ok(self.policies.iter().filter_map(seat).collect())
    }
}
