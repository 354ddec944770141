//! `lanecraft report`.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use lanecraft_lab::run_dir::RunDir;

use crate::args::folder;
use crate::output::Output;

const EXAMPLES: &str = "\
Examples:
  lanecraft report runs/quickstart
  lanecraft report runs/a runs/b";

/// Write report.html, one page with all figures and tables, into each run
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Report {
    /// Folders of runs
    #[arg(value_name = "RUN", required = true, value_parser = folder)]
    runs: Vec<PathBuf>,
}

impl Report {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        for path in &self.runs {
            let (run, _) = RunDir::open(path)?;
            output.note(&run.path().display().to_string());
        }
        bail!("the report is not built yet")
    }
}
