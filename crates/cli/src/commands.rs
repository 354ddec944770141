//! The commands, one file each: check the arguments, call the library, print what it found.

pub(crate) mod bench;
pub(crate) mod ceiling;
pub(crate) mod data;
pub(crate) mod evaluate;
pub(crate) mod export;
pub(crate) mod irl;
pub(crate) mod maneuvers;
pub(crate) mod predictor;
pub(crate) mod quickstart;
pub(crate) mod replay;
pub(crate) mod report;
pub(crate) mod reproduce;
pub(crate) mod scenario;
pub(crate) mod study;
pub(crate) mod traffic;
pub(crate) mod train;

use std::path::Path;

use clap::Subcommand;
use lanecraft_lab::run_dir::atomic;
use lanecraft_lab::studies::{StudyReport, Table};

use crate::args::Cli;
use crate::output::Output;

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Quickstart(quickstart::Quickstart),
    #[command(subcommand)]
    Irl(irl::Irl),
    Train(train::Train),
    Evaluate(evaluate::Evaluate),
    Report(report::Report),
    Export(export::Export),
    Replay(replay::Replay),
    Bench(bench::Bench),
    Ceiling(ceiling::Ceiling),
    Maneuvers(maneuvers::Maneuvers),
    Study(study::Study),
    Reproduce(reproduce::Reproduce),
    Sweep(reproduce::Sweep),
    #[command(subcommand)]
    Predictor(predictor::Predictor),
    #[command(subcommand)]
    Traffic(traffic::Traffic),
    #[command(subcommand)]
    Scenario(scenario::Scenario),
    #[command(subcommand)]
    Data(data::Data),
}

/// Runs the command.
pub(crate) fn run(cli: Cli) -> anyhow::Result<()> {
    let output = Output::new(cli.quiet);
    match cli.command {
        Command::Quickstart(command) => command.run(output),
        Command::Irl(command) => command.run(output),
        Command::Train(command) => command.run(output),
        Command::Evaluate(command) => command.run(output),
        Command::Report(command) => command.run(output),
        Command::Export(command) => command.run(),
        Command::Replay(command) => command.run(output),
        Command::Bench(command) => command.run(output),
        Command::Ceiling(command) => command.run(output),
        Command::Maneuvers(command) => command.run(output),
        Command::Study(command) => command.run(output),
        Command::Reproduce(command) => command.run(output),
        Command::Sweep(command) => command.run(output),
        Command::Predictor(predictor::Predictor::Train(command)) => command.run(output),
        Command::Predictor(predictor::Predictor::Evaluate(command)) => command.run(output),
        Command::Predictor(predictor::Predictor::Swap(command)) => command.run(output),
        Command::Traffic(traffic::Traffic::Calibrate(command)) => command.run(output),
        Command::Scenario(command) => command.run(output),
        Command::Data(data::Data::Inspect(command)) => command.run(),
        Command::Data(data::Data::Extract(command)) => command.run(output),
    }
}

/// The files of a report, and its tables as Markdown.
fn write_report(report: &StudyReport, folder: &Path, output: Output) -> anyhow::Result<()> {
    let mut written = report.write(folder)?;
    let markdown: Vec<String> = report.tables.iter().map(Table::markdown).collect();
    let path = folder.join(format!("{}.md", report.name));
    atomic::write(&path, format!("{}\n{}\n", markdown.join("\n"), report.summary).as_bytes())?;
    written.push(path);
    for path in &written {
        output.note(&format!("wrote {}", path.display()));
    }
    Ok(())
}
