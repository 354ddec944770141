//! `lanecraft quickstart`, also the command when none is given.

use std::path::{Path, PathBuf};

use clap::Args;
use lanecraft_lab::human_reward::Source;
use lanecraft_lab::judge::read_episodes;
use lanecraft_lab::quickstart::{QUICKSTART_DECISIONS, quickstart, with_human_reward};
use lanecraft_lab::run_dir::{Manifest, RunDir};

use crate::args::{ConfigArgs, ThreadsArg, folder};
use crate::output::{Output, answer};
use crate::table::print_results;

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
        let mut config = self.config.resolve(vec![format!("training.decisions={QUICKSTART_DECISIONS}")])?;
        let source = self.data.clone().map_or(Source::Synthetic, Source::At);
        let irl = with_human_reward(&source, &mut config)?;
        output.note(&format!("learned how {} change lanes", irl.model.source));
        let manifest = Manifest::new("quickstart", self.config.preset.preset().name(), &config);
        let run = RunDir::create_numbered(Path::new("runs"), "quickstart", &manifest, &config)?;
        let page =
            self.threads.run(|| output.with_progress(|progress| quickstart(&run, &config, &irl, progress)))??;
        print_results(&read_episodes(run.path())?)?;
        Ok(answer(&format!("Report: {}", page.display()))?)
    }
}
