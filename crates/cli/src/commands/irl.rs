//! `lanecraft irl`: the reward that human lane changes follow.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use lanecraft_lab::config::RunConfig;
use lanecraft_lab::demonstrations::file;
use lanecraft_lab::human_reward::{Source, demonstrations, learn_human_reward};
use lanecraft_lab::irl::page::judged;
use lanecraft_lab::irl::planners::planners;
use lanecraft_lab::irl::{IrlReport, Judgment};
use lanecraft_lab::metrics::Interval;
use lanecraft_lab::run_dir::atomic;
use lanecraft_lab::studies::StudyReport;
use serde_json::json;

use crate::args::{ConfigArgs, file_or_folder};
use crate::output::{Output, answer};

const FIT_EXAMPLES: &str = "\
Examples:
  lanecraft irl fit
  lanecraft irl fit --data path/to/recordings --out reward.json
  lanecraft irl fit --data path/to/recordings --wide
  lanecraft irl fit --preset paper --json";

const JUDGE_EXAMPLES: &str = "\
Examples:
  lanecraft irl judge --data path/to/recordings
  lanecraft irl judge --data path/to/recordings --wide --out judged

Writes each table as CSV, each figure as SVG and one page that shows all of them.";

const PLANNERS_EXAMPLES: &str = "\
Examples:
  lanecraft irl planners --data path/to/recordings

Writes the tables as CSV and as a page.";

const EXPORT_EXAMPLES: &str = "\
Examples:
  lanecraft irl export --data path/to/recordings --out recorded.jsonl.gz
  lanecraft irl export --out synthetic.jsonl
  lanecraft irl fit --data synthetic.jsonl";

/// Learn how people change lanes, by inverse reinforcement learning
#[derive(Debug, Subcommand)]
pub(crate) enum Irl {
    Fit(Fit),
    Judge(Judge),
    Planners(Planners),
    Export(Export),
}

impl Irl {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        match self {
            Self::Fit(command) => command.run(output),
            Self::Judge(command) => command.run(output),
            Self::Planners(command) => command.run(output),
            Self::Export(command) => command.run(output),
        }
    }
}

/// Whose lane changes.
#[derive(Debug, Args)]
struct Drivers {
    /// Folder of recorded lane changes, or file of demonstrations, instead of the built-in synthetic drivers
    #[arg(long, value_name = "PATH", value_parser = file_or_folder)]
    data: Option<PathBuf>,
    /// All features, and candidates over duration, lateral end and speed at the end
    #[arg(long)]
    wide: bool,
    #[command(flatten)]
    config: ConfigArgs,
}

impl Drivers {
    fn resolve(&self) -> anyhow::Result<(Source, RunConfig)> {
        let mut config = self.config.resolve(Vec::new())?;
        if self.wide {
            config.candidates = config.candidates.wide();
        }
        Ok((self.data.clone().map_or(Source::Synthetic, Source::At), config))
    }
}

/// Fit the reward to lane changes and judge it on lane changes it has not seen
#[derive(Debug, Args)]
#[command(after_help = FIT_EXAMPLES)]
pub(crate) struct Fit {
    #[command(flatten)]
    drivers: Drivers,
    /// File for the fitted weights
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
}

impl Fit {
    fn run(self, output: Output) -> anyhow::Result<()> {
        let (source, config) = self.drivers.resolve()?;
        let report = learn_human_reward(&source, &config.candidates, &config.irl)?;
        if let Some(out) = &self.out {
            let mut text = serde_json::to_vec_pretty(&report.model)?;
            text.push(b'\n');
            atomic::write(out, &text)?;
            output.note(&format!("weights written to {}", out.display()));
        }
        if self.json { print_json(&report.unseen) } else { print_table(&report) }
    }
}

/// Judge the reward: what it predicts beside what is known without it, what its weights are worth, and Table IV of the paper
#[derive(Debug, Args)]
#[command(after_help = JUDGE_EXAMPLES)]
pub(crate) struct Judge {
    #[command(flatten)]
    drivers: Drivers,
    /// Folder for the files
    #[arg(long, value_name = "DIR", default_value = "studies")]
    out: PathBuf,
}

impl Judge {
    fn run(self, output: Output) -> anyhow::Result<()> {
        let (source, config) = self.drivers.resolve()?;
        let drivers = demonstrations(&source, &config.candidates)?;
        print_report(&judged(&drivers, &config.candidates, &config.irl)?, &self.out, output)
    }
}

/// Compare the planner with others on the lane changes: how near to the driver, how comfortable, how long, how often refused
#[derive(Debug, Args)]
#[command(after_help = PLANNERS_EXAMPLES)]
pub(crate) struct Planners {
    #[command(flatten)]
    drivers: Drivers,
    /// Folder for the files
    #[arg(long, value_name = "DIR", default_value = "studies")]
    out: PathBuf,
}

impl Planners {
    fn run(self, output: Output) -> anyhow::Result<()> {
        let (source, config) = self.drivers.resolve()?;
        let drivers = demonstrations(&source, &config.candidates)?;
        let report = planners(&drivers, &config.candidates, &config.irl, &config.environment.planner)?;
        print_report(&report, &self.out, output)
    }
}

/// Write lane changes as a file of demonstrations
#[derive(Debug, Args)]
#[command(after_help = EXPORT_EXAMPLES)]
pub(crate) struct Export {
    #[command(flatten)]
    drivers: Drivers,
    /// The file, compressed if its name ends in .gz
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

impl Export {
    fn run(self, output: Output) -> anyhow::Result<()> {
        let (source, config) = self.drivers.resolve()?;
        let drivers = demonstrations(&source, &config.candidates)?;
        file::write(&self.out, &drivers)?;
        output.note(&format!("{} lane changes written to {}", drivers.items.len(), self.out.display()));
        Ok(())
    }
}

/// Prints the tables of a report and writes its files.
fn print_report(report: &StudyReport, out: &std::path::Path, output: Output) -> anyhow::Result<()> {
    answer(report.text().trim_end())?;
    for path in report.write(out)? {
        output.note(&format!("wrote {}", path.display()));
    }
    Ok(())
}

fn print_json(judgment: &Judgment) -> anyhow::Result<()> {
    for feature in &judgment.features {
        answer(&serde_json::to_string(feature)?)?;
    }
    let summary = json!({
        "events": judgment.events,
        "log_likelihood": judgment.log_likelihood,
        "uniform": judgment.uniform,
        "duration_log_likelihood": judgment.duration_log_likelihood,
        "uniform_duration": judgment.uniform_duration,
        "duration_density": judgment.duration_density,
        "duration_error_s": judgment.duration_error_s,
        "constant_duration_error_s": judgment.constant_duration_error_s,
        "end_point_error_m": judgment.end_point_error_m,
    });
    Ok(answer(&summary.to_string())?)
}

fn print_table(report: &IrlReport) -> anyhow::Result<()> {
    let judgment = &report.unseen;
    answer(&format!("Reward of {}, judged on {} lane changes it has not seen.", report.model.source, judgment.events))?;
    answer(&format!(
        "{:<20} {:>24} {:>26} {:>26}",
        "feature", "weight", "ratio of means error %", "mean absolute error %"
    ))?;
    for (feature, weight) in judgment.features.iter().zip(&report.weights) {
        let [ratio, absolute] =
            [feature.ratio_of_means_error, feature.mean_absolute_error].map(|i| interval(i, 100.0, 1));
        answer(&format!("{:<20} {:>24} {ratio:>26} {absolute:>26}", feature.feature, interval(*weight, 1.0, 2)))?;
    }
    answer(&format!(
        "log-likelihood of a duration {} (uniform {:.2}, density of durations {:.2})",
        interval(judgment.duration_log_likelihood, 1.0, 2),
        judgment.uniform_duration,
        judgment.duration_density
    ))?;
    answer(&format!(
        "mean error of the duration {} s (constant duration {} s)",
        interval(judgment.duration_error_s, 1.0, 2),
        interval(judgment.constant_duration_error_s, 1.0, 2)
    ))?;
    Ok(answer(&format!(
        "end point, best of the three most likely {} m (constant duration {} m)",
        interval(judgment.end_point_error_m, 1.0, 2),
        interval(judgment.constant_end_point_error_m, 1.0, 2)
    ))?)
}

/// With its 95 % interval.
fn interval(of: Interval, factor: f64, decimals: usize) -> String {
    let [mean, low, high] = [of.mean, of.low, of.high].map(|x| factor * x);
    format!("{mean:.decimals$} ({low:.decimals$} to {high:.decimals$})")
}
