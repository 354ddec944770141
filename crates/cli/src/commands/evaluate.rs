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

use crate::args::{ConfigArgs, ThreadsArg, flag, folder};
use crate::output::{Output, answer};
use crate::table::print_results;

const EXAMPLES: &str = "\
Examples:
  lanecraft evaluate rule:best-lane rule:keep-lane
  lanecraft evaluate runs/mine rule:best-lane --episodes 500
  lanecraft evaluate runs/a runs/b --json > results.jsonl

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
    config: ConfigArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

/// Who drives.
#[derive(Clone, Debug)]
enum Policy {
    Rule(Rule),
    Run(PathBuf),
}

fn policy(text: &str) -> Result<Policy, String> {
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
        let flags = flag("evaluation.episodes", self.episodes);
        let config = self.config.resolve(flags.into_iter().collect())?;
        let drivers = self.drivers(&config)?;
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
    fn drivers(&self, config: &RunConfig) -> anyhow::Result<Vec<(Driver, Config)>> {
        let mut first: Option<(&PathBuf, Config)> = None;
        let mut drivers = Vec::new();
        for policy in &self.policies {
            let Policy::Run(path) = policy else { continue };
            RunDir::open(path)?;
            let environment = self.config.resolve_over(&path.join(CONFIG), Vec::new())?.environment;
            let (other, expected) = first.get_or_insert_with(|| (path, environment.clone()));
            if (&environment.road, &environment.traffic) != (&expected.road, &expected.traffic) {
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
