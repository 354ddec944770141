//! `lanecraft irl`: the reward that human lane changes follow.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use lanecraft_lab::human_reward::{Source, learn_human_reward};
use lanecraft_lab::irl::{IrlReport, Judgment};
use lanecraft_lab::run_dir::atomic;
use serde_json::json;

use crate::args::{ConfigArgs, folder};
use crate::output::{Output, answer};

const EXAMPLES: &str = "\
Examples:
  lanecraft irl fit
  lanecraft irl fit --data path/to/recordings --out reward.json
  lanecraft irl fit --synthetic --json";

/// Learn how people change lanes, by inverse reinforcement learning
#[derive(Debug, Subcommand)]
pub(crate) enum Irl {
    Fit(Fit),
}

/// Fit the reward to lane changes and judge it on lane changes it has not seen
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Fit {
    /// Folder of recorded lane changes, instead of the built-in ones
    #[arg(long, value_name = "DIR", value_parser = folder)]
    data: Option<PathBuf>,
    /// Made-up drivers whose reward is known, instead of recorded ones
    #[arg(long, conflicts_with = "data")]
    synthetic: bool,
    /// File for the fitted weights
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
}

impl Fit {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let config = self.config.resolve(Vec::new())?;
        let source = self.data.clone().map_or(Source::Synthetic, Source::Recorded);
        let report = learn_human_reward(&source, &config.irl)?;
        if let Some(out) = &self.out {
            let mut text = serde_json::to_vec_pretty(&report.model)?;
            text.push(b'\n');
            atomic::write(out, &text)?;
            output.note(&format!("weights written to {}", out.display()));
        }
        if self.json { print_json(&report.unseen) } else { print_table(&report) }
    }
}

fn print_json(judgment: &Judgment) -> anyhow::Result<()> {
    for feature in &judgment.features {
        answer(&serde_json::to_string(feature)?)?;
    }
    let Judgment { events, log_likelihood, uniform, duration_density, duration_error_s, .. } = judgment;
    let summary = json!({
        "events": events,
        "log_likelihood": log_likelihood,
        "uniform": uniform,
        "duration_density": duration_density,
        "duration_error_s": duration_error_s,
    });
    Ok(answer(&summary.to_string())?)
}

fn print_table(report: &IrlReport) -> anyhow::Result<()> {
    let judgment = &report.unseen;
    answer(&format!("Reward of {}, judged on {} lane changes it has not seen.", report.model.source, judgment.events))?;
    answer(&format!("{:<10} {:>8} {:>20} {:>20}", "feature", "weight", "ratio of means error", "mean absolute error"))?;
    for (feature, weight) in judgment.features.iter().zip(report.model.weights) {
        let [ratio, absolute] = [feature.ratio_of_means_error, feature.mean_absolute_error].map(|error| 100.0 * error);
        answer(&format!("{:<10} {weight:>8.2} {ratio:>18.1} % {absolute:>18.1} %", feature.feature))?;
    }
    let Judgment { log_likelihood, uniform, duration_density, duration_error_s, .. } = judgment;
    answer(&format!(
        "log-likelihood of a lane change {log_likelihood:.2} (uniform {uniform:.2}, density of durations {duration_density:.2})"
    ))?;
    Ok(answer(&format!("mean error of the duration {duration_error_s:.2} s"))?)
}
