//! `lanecraft irl`: the reward that human lane changes follow.

use std::path::PathBuf;

use anyhow::bail;
use clap::{Args, Subcommand};

use crate::args::{ConfigArgs, folder};
use crate::output::Output;

const EXAMPLES: &str = "\
Examples:
  lanecraft irl fit
  lanecraft irl fit --data path/to/recordings --out reward.json
  lanecraft irl fit --synthetic --json";

/// Learn how people change lanes, by inverse reinforcement learning
#[derive(Debug, Subcommand)]
pub(crate) enum Irl {
    Fit(Fit),
}

/// Fit the reward to lane changes and judge it on lane changes it has not seen
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Fit {
    /// Folder of recorded lane changes, instead of the built-in ones
    #[arg(long, value_name = "DIR", value_parser = folder)]
    data: Option<PathBuf>,
    /// Made-up drivers whose reward is known, instead of recorded ones
    #[arg(long, conflicts_with = "data")]
    synthetic: bool,
    /// File for the fitted weights
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
}

impl Fit {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        self.config.resolve(Vec::new())?;
        let source = match &self.data {
            Some(data) => data.display().to_string(),
            None if self.synthetic => "made-up drivers".to_owned(),
            None => "the built-in lane changes".to_owned(),
        };
        if !self.json {
            output.note(&format!("fitting to {source}"));
        }
        if let Some(out) = &self.out {
            output.note(&format!("weights go to {}", out.display()));
        }
        bail!("the fit is not built yet")
    }
}
