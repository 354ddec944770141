//! `lanecraft train`.

use std::path::PathBuf;

use anyhow::bail;
use clap::{Args, ValueEnum};
use lanecraft_lab::config::RunConfig;
use lanecraft_lab::run_dir::{CONFIG, Existing, MANIFEST, Manifest, RunDir};
use lanecraft_lab::runs;

use crate::args::{ConfigArgs, ScenarioArg, ThreadsArg, flag};
use crate::output::{Output, answer};

const EXAMPLES: &str = "\
Examples:
  lanecraft train --out runs/mine
  lanecraft train --preset paper --algorithm dqn --seed 3 --out runs/paper-dqn-3
  lanecraft train --decisions 20000 --set learner.discount=0.97 --out runs/short
  lanecraft train --out runs/mine --resume
  lanecraft train --scenario scenarios/splits/train.toml --out runs/split

The folder gets config.toml, manifest.json, the logs and the checkpoint.
--resume goes on from the checkpoint; without one it starts anew, and on a finished run it does nothing.";

/// Train a policy and write everything about it to a folder
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Train {
    /// Folder of the run
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Learner
    #[arg(long, value_enum)]
    algorithm: Option<Algorithm>,
    /// Seed of everything random
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Decisions to take in all
    #[arg(long, value_name = "N")]
    decisions: Option<u64>,
    /// Go on with an interrupted run
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Replace a run that has this folder
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    scenario: ScenarioArg,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

/// Name of a learner.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Algorithm {
    /// Several heads that vote (Osband et al., 2016)
    BootstrappedDqn,
    /// One head (Mnih et al., 2015)
    Dqn,
    /// One head, chosen by one net and valued by the other (van Hasselt et al., 2016)
    DoubleDqn,
    /// Double DQN with streams for value and advantages (Wang et al., 2016)
    DuelingDqn,
    /// One head of quantiles of the return (Dabney et al., 2018)
    QuantileDqn,
}

impl Algorithm {
    fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

impl Train {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let resumed = self.resume && self.out.join(MANIFEST).exists();
        let (run, config, finished) = if resumed { self.reopen()? } else { self.create()? };
        if !finished {
            self.threads.run(|| output.with_progress(|progress| runs::train(&run, &config, progress)))??;
        }
        Ok(answer(&format!("{} is finished", run.path().display()))?)
    }

    fn flags(&self) -> anyhow::Result<Vec<String>> {
        let flags = [
            self.scenario.flag()?,
            flag("learner.algorithm", self.algorithm.map(Algorithm::name)),
            flag("training.seed", self.seed),
            flag("training.decisions", self.decisions),
        ];
        Ok(flags.into_iter().flatten().collect())
    }

    fn create(&self) -> anyhow::Result<(RunDir, RunConfig, bool)> {
        let config = self.config.resolve(self.flags()?)?;
        let manifest = Manifest::new("train", self.config.preset.preset().name(), &config);
        let existing = if self.force { Existing::Replace } else { Existing::Refuse };
        Ok((RunDir::create(&self.out, existing, &manifest, &config)?, config, false))
    }

    /// The run that goes on, with its own configuration, which the command line may repeat but not change.
    fn reopen(&self) -> anyhow::Result<(RunDir, RunConfig, bool)> {
        let (run, manifest) = RunDir::open(&self.out)?;
        let stored = runs::read_config(&self.out)?;
        if self.config.resolve_over(&self.out.join(CONFIG), self.flags()?)? != stored {
            bail!(
                "{} was begun with other numbers; a run goes on only as it began, or anew with `--force`",
                run.path().display()
            );
        }
        Ok((run, stored, manifest.finished))
    }
}
