//! The command line: what all commands share, and how its values are checked.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::{Args, Parser, ValueEnum};
use lanecraft_lab::config::{ConfigFileError, Preset, RunConfig, nearest};
use lanecraft_lab::scenarios::LoadedScenario;

use crate::commands::Command;

const EXAMPLES: &str = "\
Examples:
  lanecraft                                        learn, drive and report, with nothing else needed
  lanecraft irl fit --json                         fit the human reward to made-up drivers
  lanecraft train --out runs/mine --seed 3         train a policy
  lanecraft train --out runs/mine --resume         go on after an interruption
  lanecraft evaluate runs/mine rule:best-lane      compare it with a rule on the same scenarios
  lanecraft report runs/mine                       write runs/mine/report.html
  lanecraft scenario list                          scenes to drive in

Every number is a key: see presets/default.toml, and change it with --set key=value.";

/// Learn to drive on a busy highway: decide, plan and control in one closed loop.
#[derive(Debug, Parser)]
#[command(name = "lanecraft", version, after_help = EXAMPLES)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
    /// Print results and errors only
    #[arg(long, short, global = true)]
    pub(crate) quiet: bool,
}

impl Cli {
    /// Reads the command line; exits with help or with an error of its own.
    pub(crate) fn read() -> Self {
        Self::parse_from(with_command(std::env::args_os().collect()))
    }
}

/// Puts in `quickstart` where no command is given, so that its options may stand alone.
fn with_command(mut arguments: Vec<OsString>) -> Vec<OsString> {
    let first = arguments.iter().skip(1).position(|argument| argument != "-q" && argument != "--quiet");
    let at = first.map_or(arguments.len(), |position| position + 1);
    let is_own = |argument: &OsString| ["-h", "--help", "-V", "--version"].iter().any(|own| argument == own);
    let is_option = |argument: &OsString| argument.to_string_lossy().starts_with('-') && !is_own(argument);
    if arguments.get(at).is_none_or(is_option) {
        arguments.insert(at, "quickstart".into());
    }
    arguments
}

/// Which numbers a run uses.
#[derive(Debug, Args)]
pub(crate) struct ConfigArgs {
    /// Complete set of numbers to start from
    #[arg(long, value_enum, default_value = "default")]
    pub(crate) preset: PresetName,
    /// TOML file laid over the preset
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// One number laid over both, for example `traffic.density_veh_per_km_lane=20`; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) assignments: Vec<String>,
}

/// Name of a preset.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum PresetName {
    /// What works best
    Default,
    /// As the paper has it, wherever it says
    Paper,
}

impl PresetName {
    pub(crate) fn preset(self) -> Preset {
        match self {
            Self::Default => Preset::Default,
            Self::Paper => Preset::Paper,
        }
    }
}

impl ConfigArgs {
    /// The checked configuration; `flags` are assignments that stand for flags of the command, and `--set` goes over them.
    pub(crate) fn resolve(&self, flags: Vec<String>) -> Result<RunConfig, ConfigFileError> {
        RunConfig::resolve(self.preset.preset(), self.config.as_deref(), &self.over(flags))
    }

    /// The same over the complete configuration in `run`, that of a run that exists.
    pub(crate) fn resolve_over(&self, run: &Path, flags: Vec<String>) -> Result<RunConfig, ConfigFileError> {
        let file = self.config.as_deref().unwrap_or(run);
        RunConfig::resolve(self.preset.preset(), Some(file), &self.over(flags))
    }

    fn over(&self, flags: Vec<String>) -> Vec<String> {
        flags.into_iter().chain(self.assignments.iter().cloned()).collect()
    }
}

/// A scenario file in which everything takes place.
#[derive(Debug, Args)]
pub(crate) struct ScenarioArg {
    /// Scenario file, whose road and traffic stand for those of the configuration
    #[arg(long, value_name = "FILE", value_parser = file)]
    scenario: Option<PathBuf>,
}

impl ScenarioArg {
    /// The assignment that puts the checked file's text into the configuration.
    pub(crate) fn flag(&self) -> anyhow::Result<Option<String>> {
        let Some(path) = &self.scenario else { return Ok(None) };
        let scenario = LoadedScenario::read(path)?;
        Ok(flag("env.scenario", Some(scenario.into_value()?)))
    }
}

/// How many threads compute.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct ThreadsArg {
    /// Threads; the results are the same for any number [default: all]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

impl ThreadsArg {
    /// Runs `job` on so many threads.
    pub(crate) fn run<T: Send>(self, job: impl FnOnce() -> T + Send) -> anyhow::Result<T> {
        let threads = self.threads.map_or(0, usize::from);
        Ok(rayon::ThreadPoolBuilder::new().num_threads(threads).build()?.install(job))
    }
}

/// `key=value` for a flag that was given.
pub(crate) fn flag<T: std::fmt::Display>(key: &str, value: Option<T>) -> Option<String> {
    value.map(|value| format!("{key}={value}"))
}

/// A folder that exists.
pub(crate) fn folder(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.is_dir() {
        return Ok(path);
    }
    let what = if path.exists() { "this is no folder" } else { "there is no such folder" };
    Err(format!("{what}{}", neighbor(&path, Path::is_dir)))
}

/// A file or a folder that exists.
pub(crate) fn file_or_folder(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.exists() {
        Ok(path)
    } else {
        Err(format!("there is nothing of this name{}", neighbor(&path, Path::exists)))
    }
}

/// A file that exists.
pub(crate) fn file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.is_dir() {
        return Err("this is a folder, not a file".to_owned());
    }
    // Devices and pipes may be read, too.
    if path.exists() { Ok(path) } else { Err(format!("there is no such file{}", neighbor(&path, Path::is_file))) }
}

/// Points at the entry beside `path` whose name is nearest, if any is near.
fn neighbor(path: &Path, fits: fn(&Path) -> bool) -> String {
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(parent).into_iter().flatten().flatten();
    let mut names: Vec<String> =
        entries.filter(|entry| fits(&entry.path())).filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.sort();
    let wanted = path.file_name().unwrap_or_default().to_string_lossy();
    match nearest(&wanted, names.iter().map(String::as_str)) {
        Some(name) => format!("; did you mean `{}`?", path.with_file_name(name).display()),
        None => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::{Cli, with_command};

    #[test]
    fn quickstart_is_put_in_where_no_command_is() {
        for (given, expected) in [
            ("", "quickstart"),
            ("-q", "-q quickstart"),
            ("--data x", "quickstart --data x"),
            ("--quiet --set a=1", "--quiet quickstart --set a=1"),
            ("--quiet train", "--quiet train"),
            ("train --data x", "train --data x"),
            ("--help", "--help"),
            ("-V", "-V"),
        ] {
            let line =
                |words: &str| ["lanecraft"].into_iter().chain(words.split_whitespace()).map(Into::into).collect();
            let expected: Vec<std::ffi::OsString> = line(expected);
            assert_eq!(with_command(line(given)), expected, "{given}");
        }
    }

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }
}
