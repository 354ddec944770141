//! `lanecraft evaluate`.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use lanecraft_lab::config::nearest;
use lanecraft_lab::run_dir::RunDir;

use crate::args::{ConfigArgs, ThreadsArg, flag, folder};
use crate::output::Output;

const EXAMPLES: &str = "\
Examples:
  lanecraft evaluate rule:best-lane rule:keep-lane
  lanecraft evaluate runs/mine rule:best-lane --episodes 500
  lanecraft evaluate runs/a runs/b --json > results.jsonl

All policies drive in the same scenarios, which no training sees.
Rules: rule:keep-lane, rule:random, rule:idm-mobil, rule:best-lane.";

/// Names of the rules that can be evaluated.
const RULES: [&str; 4] = ["rule:keep-lane", "rule:random", "rule:idm-mobil", "rule:best-lane"];

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
    Rule(&'static str),
    Run(PathBuf),
}

fn policy(text: &str) -> Result<Policy, String> {
    if let Some(rule) = RULES.into_iter().find(|&rule| rule == text) {
        return Ok(Policy::Rule(rule));
    }
    let Some(name) = text.strip_prefix("rule:") else {
        return folder(text).map(Policy::Run).map_err(|error| {
            let known = nearest(&format!("rule:{text}"), RULES).filter(|_| !error.contains("did you mean"));
            error + &known.map_or_else(String::new, |rule| format!("; did you mean `{rule}`?"))
        });
    };
    let names = RULES.map(|rule| &rule["rule:".len()..]);
    let hint = nearest(name, names).map_or_else(String::new, |name| format!("; did you mean `rule:{name}`?"));
    Err(format!("there is no such rule{hint} (rules: {})", RULES.join(", ")))
}

impl Evaluate {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let flags = flag("evaluation.episodes", self.episodes);
        let config = self.config.resolve(flags.into_iter().collect())?;
        for policy in &self.policies {
            match policy {
                Policy::Rule(name) => output.note(name),
                Policy::Run(path) => {
                    let (run, manifest) = RunDir::open(path)?;
                    output.note(&format!("{} ({}, seed {})", run.path().display(), manifest.command, manifest.seed));
                }
            }
        }
        let (episodes, threads) = (config.evaluation.episodes, self.threads.count());
        let form = if self.json { "lines" } else { "a table" };
        bail!("evaluation ({episodes} episodes on {threads} threads, as {form}) is not built yet")
    }
}
