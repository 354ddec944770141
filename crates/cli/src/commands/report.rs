//! `lanecraft report`.

use std::path::PathBuf;

use clap::Args;
use lanecraft_lab::pages::{LeftOut, report};

use crate::args::{ThreadsArg, folder};
use crate::output::{Output, answer};

const EXAMPLES: &str = "\
Examples:
  lanecraft report runs/quickstart
  lanecraft report runs/a runs/b
  lanecraft report runs/dqn-seed-* runs/bootstrapped-dqn-seed-*

Runs that differ only in their training seed are pooled as one method, with intervals over its seeds.
Runs that were judged in other scenarios have tables of their own. Runs that are not finished are left out, and the page says so.";

/// Compare runs on one page, report.html, written into the first of them
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Report {
    /// Folders of runs
    #[arg(value_name = "RUN", required = true, value_parser = folder)]
    runs: Vec<PathBuf>,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Report {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let page = self.threads.run(|| output.with_progress(|progress| report(&self.runs, progress)))??;
        for LeftOut { run, reason } in &page.left_out {
            output.note(&format!("{} is left out: {reason}", run.display()));
        }
        Ok(answer(&format!("Report: {}", page.path.display()))?)
    }
}
