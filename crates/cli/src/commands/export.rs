//! `lanecraft export`.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use lanecraft_lab::policy::Policy;
use lanecraft_lab::run_dir::atomic;
use lanecraft_lab::runs;

use crate::args::folder;
use crate::output::answer;

const EXAMPLES: &str = "\
Examples:
  lanecraft export models/highway --out highway.onnx
  lanecraft export runs/mine --out mine.onnx --force

The model takes `observation` (batch x inputs) and `action_mask` (batch x actions, true where allowed), and gives `q_heads`, `q` and `action`, the
choice that this program would make.";

/// Write the policy of a run as an ONNX model, for other programs
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Export {
    /// Folder of a trained run
    #[arg(value_name = "RUN", value_parser = folder)]
    run: PathBuf,
    /// File to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Replace a file of this name
    #[arg(long)]
    force: bool,
}

impl Export {
    pub(crate) fn run(self) -> anyhow::Result<()> {
        if self.out.exists() && !self.force {
            bail!("{} exists; `--force` replaces it", self.out.display());
        }
        if let Policy::Learned { network, .. } = runs::read_policy(&self.run)? {
            atomic::write(&self.out, &network.to_onnx())?;
        }
        Ok(answer(&format!("wrote {}", self.out.display()))?)
    }
}
