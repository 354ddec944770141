//! `lanecraft quickstart`, also the command when none is given.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use lanecraft_lab::config::RunConfig;

use crate::args::{ConfigArgs, ThreadsArg, folder};
use crate::output::Output;

const EXAMPLES: &str = "\
Examples:
  lanecraft
  lanecraft quickstart --data path/to/recordings
  lanecraft --set traffic.density_veh_per_km_lane=20

Writes runs/quickstart, the next time runs/quickstart-2, and so on.";

/// Fit the human reward, train a policy, drive it beside the baselines and write a report
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Quickstart {
    /// Folder of recorded lane changes to learn the reward from, instead of the built-in ones
    #[arg(long, value_name = "DIR", value_parser = folder)]
    data: Option<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Quickstart {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let config = self.config.resolve(Vec::new())?;
        self.start(&config, output)
    }

    fn start(&self, config: &RunConfig, output: Output) -> anyhow::Result<()> {
        output.note(&format!("seed {}, {} threads", config.training.seed, self.threads.count()));
        if let Some(data) = &self.data {
            output.note(&format!("recordings from {}", data.display()));
        }
        bail!("the quick start is not built yet")
    }
}
