//! `lanecraft replay`.

use std::path::PathBuf;

use clap::Args;
use lanecraft_lab::replay::{ReplayVerdict, check};
use lanecraft_lab::trace_file::read_trace;

use crate::Mismatch;
use crate::args::file;
use crate::output::{Output, answer};

const EXAMPLES: &str = "\
Examples:
  lanecraft replay runs/quickstart/episode.jsonl.gz
  lanecraft replay runs/quickstart/episode.jsonl.gz --check

--check runs the episode again and names the first step that differs; the exit code is then 1.";

/// Print a recorded episode, or run it again and compare
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Replay {
    /// Recorded episode
    #[arg(value_name = "TRACE", value_parser = file)]
    trace: PathBuf,
    /// Run it again and compare every step
    #[arg(long)]
    check: bool,
}

impl Replay {
    pub(crate) fn run(self, _output: Output) -> anyhow::Result<()> {
        let trace = read_trace(&self.trace)?;
        if self.check {
            return match check(&trace)? {
                ReplayVerdict::Same { steps } => Ok(answer(&format!("all {steps} steps are the same"))?),
                ReplayVerdict::Differs { step, field, recorded, now } => {
                    Err(Mismatch(format!("step {step} differs in `{field}`: {recorded} in the trace, {now} now"))
                        .into())
                }
            };
        }
        answer(&format!("{} in scenario {}", trace.header.policy, trace.header.scenario_seed))?;
        for tick in &trace.ticks {
            let Some(frame) = tick.frames.last() else { continue };
            let ego = &frame.ego;
            answer(&format!(
                "{:6.2} s  {:6.2} m/s  {:+6.2} m/s²  d {:6.2} m  score {:6.2}  {}",
                frame.time_s, ego.speed_mps, ego.accel_mps2, ego.d_m, tick.score, tick.action_name
            ))?;
        }
        Ok(())
    }
}
