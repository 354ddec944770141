//! `lanecraft bench`.

use anyhow::bail;
use clap::Args;

use crate::output::Output;

const EXAMPLES: &str = "\
Examples:
  lanecraft bench
  lanecraft bench qp --json";

/// Measure how fast the parts are on this machine
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Bench {
    /// Only this group
    #[arg(value_name = "GROUP")]
    group: Option<String>,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
}

impl Bench {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        if !self.json {
            output.note(self.group.as_deref().unwrap_or("all groups"));
        }
        bail!("the measurements are not built yet")
    }
}
