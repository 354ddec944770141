//! The `lanecraft` binary: reads the command line, calls the library, prints.
//!
//! Exit codes: 0 done; 2 the input or the machine does not allow it, with a message that says what to change; 1 a bug of ours, or a
//! recorded episode that does not run as it was recorded.

mod args;
mod commands;
mod output;
mod table;

use std::io;
use std::process::ExitCode;

use crate::args::Cli;
use crate::output::complain;

fn main() -> ExitCode {
    let cli = Cli::read();
    // Wrong input is an `Err`; what panics is our own fault, and the panic has said where.
    match std::panic::catch_unwind(|| commands::run(cli)) {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(error)) if reader_left(&error) => ExitCode::SUCCESS,
        Ok(Err(error)) => {
            complain(&format!("error: {}", message(&error)));
            ExitCode::from(if error.is::<Mismatch>() { 1 } else { 2 })
        }
        Err(_) => {
            complain("error: this is a bug in lanecraft; please report it with the lines above and the command");
            ExitCode::from(1)
        }
    }
}

/// A recorded episode that does not run as it was recorded: the input is right, but the program does not do the same.
#[derive(Debug)]
pub(crate) struct Mismatch(pub(crate) String);

impl std::fmt::Display for Mismatch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Mismatch {}

/// The error and its causes in one line, without causes that the line has said already.
fn message(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if !text.contains(&cause) {
            text += if text.is_empty() { "" } else { ": " };
            text += &cause;
        }
    }
    text
}

/// Whether the reader of our output closed it, as `| head` does.
fn reader_left(error: &anyhow::Error) -> bool {
    error.downcast_ref::<io::Error>().is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
}
