//! `lanecraft report`.

use std::path::PathBuf;

use clap::Args;
use lanecraft_lab::pages::report;

use crate::args::{ThreadsArg, folder};
use crate::output::{Output, answer};

const EXAMPLES: &str = "\
Examples:
  lanecraft report runs/quickstart
  lanecraft report runs/a runs/b";

/// Write report.html, one page with all figures and tables on these runs, into the first of them
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
        Ok(answer(&format!("Report: {}", page.display()))?)
    }
}
