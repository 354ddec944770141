//! `lanecraft scenario`.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use lanecraft_lab::config::{EnvironmentConfig, nearest};
use lanecraft_lab::evaluate::summarize;
use lanecraft_lab::policy::Policy as Driver;
use lanecraft_lab::run_dir::CONFIG;
use lanecraft_lab::runs;
use lanecraft_lab::scenarios::{LoadedScenario, list, name_of, picture, schema};
use lanecraft_lab::trace_file::write_trace;
use rayon::prelude::*;

use super::evaluate::{Policy, policy};
use crate::args::{ConfigArgs, file, folder};
use crate::output::{Output, answer};

const EXAMPLES: &str = "\
Examples:
  lanecraft scenario list
  lanecraft scenario check my.toml
  lanecraft scenario run my.toml --policy runs/mine --out my.svg
  lanecraft scenario schema > scenario.schema.json

docs/scenarios.md says how to write one.";

const LIST_EXAMPLES: &str = "\
Examples:
  lanecraft scenario list
  lanecraft scenario list scenarios/splits";

const SHOW_EXAMPLES: &str = "\
Examples:
  lanecraft scenario show scenarios/cut-in.toml
  lanecraft scenario show scenarios/splits/train.toml --seed 3";

const CHECK_EXAMPLES: &str = "\
Examples:
  lanecraft scenario check my.toml
  lanecraft scenario check scenarios/*.toml

Exits with 2 if one is wrong, with file, line and key.";

const RUN_EXAMPLES: &str = "\
Examples:
  lanecraft scenario run scenarios/cut-in.toml
  lanecraft scenario run scenarios/cut-in.toml --policy rule:keep-lane --seed 3 --json
  lanecraft scenario run scenarios/rush-hour.toml --policy runs/mine --out trace.jsonl.gz
  lanecraft scenario run scenarios/rush-hour.toml --out picture.svg

A name that ends in .svg gets a picture, .jsonl or .jsonl.gz a trace for `lanecraft replay`.";

const DRAW_EXAMPLES: &str = "\
Examples:
  lanecraft scenario draw my.toml --out my.svg
  lanecraft scenario draw scenarios/*.toml --out docs/gallery";

/// Check, drive and draw scenario files
#[derive(Debug, Subcommand)]
#[command(after_help = EXAMPLES)]
pub(crate) enum Scenario {
    List(List),
    Show(Show),
    Check(Check),
    Run(Run),
    Draw(Draw),
    Schema(Schema),
}

/// List the scenario files of a folder
#[derive(Debug, Args)]
#[command(after_help = LIST_EXAMPLES)]
pub(crate) struct List {
    /// The folder
    #[arg(value_name = "DIR", default_value = "scenarios", value_parser = folder)]
    folder: PathBuf,
}

/// Print a scenario with every key, and who starts where
#[derive(Debug, Args)]
#[command(after_help = SHOW_EXAMPLES)]
pub(crate) struct Show {
    /// Scenario file
    #[arg(value_name = "FILE", value_parser = file)]
    file: PathBuf,
    /// Seed of what is drawn
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
}

/// Check scenario files
#[derive(Debug, Args)]
#[command(after_help = CHECK_EXAMPLES)]
pub(crate) struct Check {
    /// Scenario files
    #[arg(value_name = "FILE", required = true, value_parser = file)]
    files: Vec<PathBuf>,
}

/// Let a policy drive in a scenario
#[derive(Debug, Args)]
#[command(after_help = RUN_EXAMPLES)]
pub(crate) struct Run {
    /// Scenario file
    #[arg(value_name = "FILE", value_parser = file)]
    file: PathBuf,
    /// Picture or trace to write
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    seat: Seat,
}

/// Draw scenarios
#[derive(Debug, Args)]
#[command(after_help = DRAW_EXAMPLES)]
pub(crate) struct Draw {
    /// Scenario files
    #[arg(value_name = "FILE", required = true, value_parser = file)]
    files: Vec<PathBuf>,
    /// Picture, or the folder for several
    #[arg(long, value_name = "FILE|DIR")]
    out: PathBuf,
    #[command(flatten)]
    seat: Seat,
}

/// Print the JSON Schema of scenario files
#[derive(Debug, Args)]
pub(crate) struct Schema {}

/// Who drives, and with which numbers.
#[derive(Debug, Args)]
struct Seat {
    /// Folder of a trained run, or a rule
    #[arg(long, value_name = "DIR|rule:NAME", default_value = "rule:best-lane", value_parser = policy)]
    policy: Policy,
    /// Seed of what is drawn
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// How long to drive, s [default: as the scenario says]
    #[arg(long, value_name = "T")]
    seconds: Option<f64>,
    #[command(flatten)]
    config: ConfigArgs,
}

impl Scenario {
    pub(crate) fn run(self, output: Output) -> anyhow::Result<()> {
        match self {
            Self::List(command) => command.run(),
            Self::Show(command) => command.run(),
            Self::Check(command) => command.run(output),
            Self::Run(command) => command.run(output),
            Self::Draw(command) => command.run(output),
            Self::Schema(Schema {}) => Ok(answer(schema().trim_end())?),
        }
    }
}

impl List {
    fn run(&self) -> anyhow::Result<()> {
        let paths = list(&self.folder).with_context(|| format!("cannot read {}", self.folder.display()))?;
        if paths.is_empty() {
            bail!("there is no scenario in {}", self.folder.display());
        }
        for path in paths {
            let stem = name_of(&path);
            match LoadedScenario::read(&path) {
                Ok(scenario) => answer(&format!("{stem:<24} {}", scenario.file.description))?,
                Err(error) => answer(&format!("{stem:<24} cannot be used: {error}"))?,
            }
        }
        Ok(())
    }
}

impl Show {
    fn run(&self) -> anyhow::Result<()> {
        let loaded = LoadedScenario::read(&self.file)?;
        answer(&loaded.to_toml())?;
        let scenario = loaded.scenario(self.seed)?;
        answer(&format!("# Seed {} draws {} vehicles at the start:", self.seed, scenario.vehicles.len()))?;
        for (index, vehicle) in scenario.vehicles.iter().enumerate() {
            answer(&format!(
                "#   {index:>3} lane {} at {:7.1} m, {:5.1} m/s, wants {:5.1} m/s, {}",
                vehicle.lane.0,
                vehicle.s_m,
                vehicle.speed_mps,
                vehicle.driver.desired_speed_mps,
                vehicle.kind.name()
            ))?;
        }
        Ok(())
    }
}

impl Check {
    fn run(&self, output: Output) -> anyhow::Result<()> {
        let errors = self.files.iter().filter_map(|path| LoadedScenario::read(path).err());
        let errors: Vec<String> = errors.map(|error| error.to_string()).collect();
        if !errors.is_empty() {
            bail!("{}", errors.join("\n"));
        }
        output.note(&match self.files.len() {
            1 => "the scenario is valid".to_owned(),
            count => format!("all {count} scenarios are valid"),
        });
        Ok(())
    }
}

/// What a file's name asks for.
enum Product {
    Picture,
    Trace,
}

impl Product {
    fn of(path: &Path) -> anyhow::Result<Self> {
        let unpacked = path.file_stem().map(Path::new).filter(|_| path.extension().is_some_and(|end| end == "gz"));
        let end = unpacked.unwrap_or(path).extension().unwrap_or_default().to_string_lossy();
        match end.as_ref() {
            "svg" if unpacked.is_none() => return Ok(Self::Picture),
            "jsonl" => return Ok(Self::Trace),
            _ => (),
        }
        let hint = nearest(&end, ["svg", "jsonl"]).map_or_else(String::new, |end| format!("; did you mean `.{end}`?"));
        bail!("{} is neither a picture (.svg) nor a trace (.jsonl, .jsonl.gz){hint}", path.display())
    }
}

impl Run {
    fn run(&self, output: Output) -> anyhow::Result<()> {
        let product = self.out.as_deref().map(|path| Ok::<_, anyhow::Error>((path, Product::of(path)?))).transpose()?;
        let loaded = LoadedScenario::read(&self.file)?;
        let (driver, config) = self.seat.take(&loaded)?;
        let (trace, episode) = loaded.drive(&driver, &config, self.seat.seed)?;
        let result = summarize(&driver, self.seat.seed, &episode, &config);
        if self.json {
            answer(&serde_json::to_string(&result)?)?;
        } else {
            let end = if result.collision.is_empty() { "no collision" } else { &result.collision };
            answer(&format!(
                "{}: {} drives {:.1} s at {:.1} m/s with {} lane changes, {end}",
                loaded.file.name, result.policy, result.duration_s, result.speed_mps, result.lane_changes
            ))?;
        }
        let Some((path, product)) = product else { return Ok(()) };
        match product {
            Product::Picture => write(path, &picture(&loaded.file.name, &trace, &loaded.road()?))?,
            Product::Trace => write_trace(path, &trace)?,
        }
        output.note(&format!("wrote {}", path.display()));
        Ok(())
    }
}

impl Draw {
    fn run(&self, output: Output) -> anyhow::Result<()> {
        let draw = |path: &PathBuf| {
            let loaded = LoadedScenario::read(path)?;
            let (driver, config) = self.seat.take(&loaded)?;
            let (trace, _) = loaded.drive(&driver, &config, self.seat.seed)?;
            let out = self.out_for(path)?;
            write(&out, &picture(&loaded.file.name, &trace, &loaded.road()?))?;
            output.note(&format!("wrote {}", out.display()));
            Ok(())
        };
        self.files.par_iter().map(draw).collect::<anyhow::Result<Vec<()>>>().map(drop)
    }

    fn out_for(&self, path: &Path) -> anyhow::Result<PathBuf> {
        if !self.out.is_dir() {
            if self.files.len() > 1 {
                bail!("{} is no folder, but there are {} pictures to draw", self.out.display(), self.files.len());
            }
            return Ok(self.out.clone());
        }
        Ok(self.out.join(path.with_extension("svg").file_name().unwrap_or_default()))
    }
}

impl Seat {
    /// The policy, with its run's environment if it has one, for as long as asked.
    fn take(&self, scenario: &LoadedScenario) -> anyhow::Result<(Driver, EnvironmentConfig)> {
        let (driver, mut config) = match &self.policy {
            Policy::Rule(rule) => (Driver::Rule(*rule), self.config.resolve(Vec::new())?.environment),
            Policy::Run(run) => {
                let config = self.config.resolve_over(&run.join(CONFIG), Vec::new())?;
                (runs::read_policy(run)?, config.environment)
            }
        };
        config.env.episode_s = self.seconds.unwrap_or(scenario.file.duration_s);
        config.validate()?;
        Ok((driver, config))
    }
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}
