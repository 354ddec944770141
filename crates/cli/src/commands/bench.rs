//! `lanecraft bench`.

use clap::Args;
use lanecraft_lab::bench::{BenchRow, Group};
use lanecraft_lab::config::nearest;

use crate::args::ConfigArgs;
use crate::output::{Output, answer};

const EXAMPLES: &str = "\
Examples:
  lanecraft bench
  lanecraft bench traffic --json";

/// Measure how fast the parts are on this machine
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Bench {
    /// Only this group [default: those that are done in seconds]
    #[arg(value_name = "GROUP", value_parser = group)]
    group: Option<Group>,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
}

impl Bench {
    pub(crate) fn run(self, _output: Output) -> anyhow::Result<()> {
        let config = self.config.resolve(Vec::new())?;
        let groups = self.group.map_or(Group::SHORT.to_vec(), |group| vec![group]);
        for group in groups {
            let mut printed = Ok(());
            group.run(&config, &mut |row| {
                if printed.is_ok() {
                    printed = self.print(&row);
                }
            })?;
            printed?;
        }
        Ok(())
    }

    fn print(&self, row: &BenchRow) -> anyhow::Result<()> {
        if self.json {
            return Ok(answer(&serde_json::to_string(row)?)?);
        }
        Ok(answer(&format!("{:<38} {:>14} {}", row.bench, figure(row.value), row.unit))?)
    }
}

/// Four significant digits, without an exponent.
fn figure(value: f64) -> String {
    match value.abs() {
        size if size >= 1000.0 => format!("{value:.0}"),
        size if size >= 10.0 => format!("{value:.1}"),
        _ => format!("{value:.4}"),
    }
}

fn group(text: &str) -> Result<Group, String> {
    let names = Group::ALL.map(Group::name);
    Group::ALL.into_iter().find(|group| group.name() == text).ok_or_else(|| {
        let hint = nearest(text, names).map_or_else(String::new, |name| format!("; did you mean `{name}`?"));
        format!("there is no such group{hint} (groups: {})", names.join(", "))
    })
}
