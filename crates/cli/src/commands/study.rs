//! `lanecraft study`.

use std::path::PathBuf;

use clap::Args;
use lanecraft_lab::config::nearest;
use lanecraft_lab::studies::Study as Kind;

use crate::args::ThreadsArg;
use crate::output::{Output, answer};

const EXAMPLES: &str = "\
Examples:
  lanecraft study margins
  lanecraft study phase-plane --out figures

Writes each table as CSV, each figure as SVG and one page that shows all of them.";

/// Study the motion control: phase-plane, pareto, preventable, margins or string-stability; or the traffic: fundamental-diagram
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Study {
    /// Which study
    #[arg(value_name = "STUDY", value_parser = study)]
    name: Kind,
    /// Folder for the files
    #[arg(long, value_name = "DIR", default_value = "studies")]
    out: PathBuf,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Study {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let report = self.threads.run(|| self.name.run())??;
        answer(report.text().trim_end())?;
        for path in report.write(&self.out)? {
            output.note(&format!("wrote {}", path.display()));
        }
        Ok(())
    }
}

fn study(text: &str) -> Result<Kind, String> {
    let names = Kind::ALL.map(Kind::name);
    Kind::ALL.into_iter().find(|study| study.name() == text).ok_or_else(|| {
        let hint = nearest(text, names).map_or_else(String::new, |name| format!("; did you mean `{name}`?"));
        format!("there is no such study{hint} (studies: {})", names.join(", "))
    })
}
