//! `lanecraft traffic`: the human drivers.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use lanecraft_lab::calibrate::{Calibration, calibrate};
use lanecraft_lab::run_dir::atomic;
use serde_json::json;

use crate::args::{ThreadsArg, folder};
use crate::output::{Output, answer};

const EXAMPLES: &str = "\
Examples:
  lanecraft traffic calibrate --data path/to/recordings
  lanecraft traffic calibrate --data path/to/recordings --out drivers.toml --report calibration
  lanecraft train --out runs/mine --config drivers.toml";

/// Look after the human drivers
#[derive(Debug, Subcommand)]
pub(crate) enum Traffic {
    Calibrate(Calibrate),
}

/// Fit the human drivers' parameters to recorded traffic and judge them on sites left out
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Calibrate {
    /// Folder of the recording, with `traffic.csv.gz`
    #[arg(long, value_name = "DIR", value_parser = folder)]
    data: PathBuf,
    /// What the names of the sites to use begin with: no streets with signals, which car following does not know
    #[arg(long, value_name = "PREFIX", default_value = "us101")]
    sites: String,
    /// File for the drivers found, to lay over a preset by --config
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Folder for tables, figures and a page that shows them
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Calibrate {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        let found = self.threads.run(|| calibrate(&self.data, &self.sites))??;
        if let Some(out) = &self.out {
            atomic::write(out, found.overlay_toml().as_bytes())?;
            output.note(&format!("drivers written to {}", out.display()));
        }
        if let Some(folder) = &self.report {
            for path in found.report().write(folder)? {
                output.note(&format!("wrote {}", path.display()));
            }
        }
        if self.json {
            return print_json(&found);
        }
        answer(found.report().text().trim_end())?;
        Ok(answer(&format!("\n{}", found.overlay_toml().trim_end()))?)
    }
}

fn print_json(found: &Calibration) -> anyhow::Result<()> {
    for judged in &found.judged {
        answer(&serde_json::to_string(judged)?)?;
    }
    for parameter in &found.parameters {
        answer(&serde_json::to_string(parameter)?)?;
    }
    let recorded = &found.lane_changes;
    let summary = json!({
        "episodes": found.episodes,
        "drivers": found.drivers,
        "sites": found.sites_used,
        "duration_s": found.duration_s,
        "own_gap_rmse_m": found.own_gap_rmse_m,
        "lane_changes_per_vehicle_km": recorded.per_vehicle_km(),
        "model_lane_changes_per_vehicle_km": found.model_traffic.map(|model| model.changes_per_vehicle_km),
        "speed_mps": recorded.speed_mps,
        "model_speed_mps": found.model_traffic.map(|model| model.speed_mps),
        "density_veh_per_km_lane": recorded.density_veh_per_km_lane,
    });
    Ok(answer(&summary.to_string())?)
}
