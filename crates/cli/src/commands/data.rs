//! `lanecraft data`: recorded traffic.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use lanecraft_lab::data::DataError;
use lanecraft_lab::data::extract::extract;
use lanecraft_lab::data::inspect::inspect;
use lanecraft_lab::data::read::read;
use lanecraft_lab::data::recording::{Recording, Selection};
use serde_json::json;

use crate::args::file;
use crate::output::{Output, answer};

const INSPECT_EXAMPLES: &str = "\
Examples:
  lanecraft data inspect trajectories.csv
  lanecraft data inspect 01_tracks.csv USA_US101-1_1_T-1.xml --json
  lanecraft data inspect ngsim.csv --sites us-101

Formats: NGSIM tables of 25 or 18 columns (as text or CSV), highD (name the _tracks.csv), CommonRoad 2020a, traffic.csv.gz; each may be
compressed (.gz).";

const EXTRACT_EXAMPLES: &str = "\
Examples:
  lanecraft data extract trajectories.csv --out recorded
  lanecraft data extract *_tracks.csv --out recorded
  lanecraft irl fit --data recorded
  lanecraft traffic calibrate --data recorded --sites \"\"

No map is needed: the road and its lanes are found from the tracks. What is left out is counted in the summary.";

/// Look at recorded traffic, and find the lane changes in it
#[derive(Debug, Subcommand)]
pub(crate) enum Data {
    Inspect(Inspect),
    Extract(Extract),
}

/// Which recordings.
#[derive(Debug, Args)]
struct Source {
    /// Recordings
    #[arg(value_name = "FILE", required = true, value_parser = file)]
    files: Vec<PathBuf>,
    /// What the names of the sites to read begin with [default: all sites]
    #[arg(long, value_name = "PREFIX", default_value = "", hide_default_value = true)]
    sites: String,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
}

impl Source {
    fn read(&self) -> Result<Vec<Recording>, DataError> {
        let selection = Selection { sites: self.sites.clone(), ..Selection::default() };
        let mut recordings = Vec::new();
        for path in &self.files {
            recordings.extend(read(path, &selection)?);
        }
        Ok(recordings)
    }
}

/// Tell what recordings hold: vehicles, time, speeds, lanes, and what is odd about them
#[derive(Debug, Args)]
#[command(after_help = INSPECT_EXAMPLES)]
pub(crate) struct Inspect {
    #[command(flatten)]
    source: Source,
}

impl Inspect {
    pub(crate) fn run(self) -> anyhow::Result<()> {
        let mut inspections = Vec::new();
        for path in &self.source.files {
            inspections.extend(inspect(path, &self.source.sites)?);
        }
        for inspected in inspections {
            let text = if self.source.json { serde_json::to_string(&inspected)? } else { inspected.text() };
            answer(text.trim_end())?;
        }
        Ok(())
    }
}

/// Find the lane changes in recordings and write them for --data of other commands
#[derive(Debug, Args)]
#[command(after_help = EXTRACT_EXAMPLES)]
pub(crate) struct Extract {
    #[command(flatten)]
    source: Source,
    /// Folder for the tables, and for a page that shows what was found
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl Extract {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let found = extract(&self.source.read()?)?;
        for path in found.write(&self.out)? {
            output.note(&format!("wrote {}", path.display()));
        }
        if !self.source.json {
            return Ok(answer(found.report().text().trim_end())?);
        }
        let summary = json!({
            "sites": found.sites.len(),
            "vehicles": found.sites.iter().map(|site| site.tracks.len()).sum::<usize>(),
            "lane_changes": found.changes.len(),
            "left_out": found.skips,
        });
        Ok(answer(&summary.to_string())?)
    }
}
