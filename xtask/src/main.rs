//! `cargo xtask`: the checks of the workspace, with nothing to install beforehand.
//!
//! `check` is what the continuous integration runs; `test` is a part of it; `bench` measures on this machine.

mod python;
mod wasm;

use std::env;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

use anyhow::{Context as _, bail};

const HELP: &str = "\
cargo xtask check          everything, in this order: format, lints, documentation, wasm, tests, extra tools
cargo xtask wasm           the same bits in WebAssembly: builds for it and compares the golden digests there
cargo xtask test           all tests, of the Python package, too; it is built into a wheel and tested in target/python
cargo xtask test ARGS      those of the crates alone; ARGS go to the test runner
cargo xtask python [--with-sb3] [ARGS]
                           the Python package alone; ARGS go to pytest; by choice beside Stable-Baselines3 (some gigabytes)
cargo xtask test --long    all tests in their long form, in the release build
cargo xtask bench [ARGS]   lanecraft bench in the release build; ARGS go to it
cargo xtask bench qp [--json] [--dump DIR] | --long [COUNT]
                           the quadratic-program solver beside a peer, or on random problems";

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("xtask: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[String]) -> anyhow::Result<()> {
    let rest: Vec<&str> = arguments.iter().skip(1).map(String::as_str).collect();
    match arguments.first().map(String::as_str) {
        Some("check") if rest.is_empty() => check(),
        Some("wasm") if rest.is_empty() => wasm::wasm(),
        Some("test") if rest == ["--long"] => {
            let arguments = ["test", "--locked", "--release", "--workspace"];
            execute(command("cargo", &arguments).env("LANECRAFT_LONG", "1"), "LANECRAFT_LONG=1 ")
        }
        Some("test") if rest.is_empty() || rest == ["--with-sb3"] => {
            test(&[])?;
            python::python(&rest)
        }
        Some("test") => test(&rest),
        Some("python") => python::python(&rest),
        Some("bench") if rest.first() == Some(&"qp") => {
            let release = ["run", "--locked", "--release", "--package", "lanecraft-bench-qp", "--"];
            cargo(&[&release, &rest[1..]].concat())
        }
        Some("bench") => {
            let release = ["run", "--locked", "--release", "--package", "lanecraft", "--", "bench"];
            cargo(&[&release, rest.as_slice()].concat())
        }
        Some("help" | "--help" | "-h") => {
            eprintln!("{HELP}");
            Ok(())
        }
        _ => bail!("no such command\n{HELP}"),
    }
}

fn check() -> anyhow::Result<()> {
    cargo(&["fmt", "--all", "--check"])?;
    cargo(&["clippy", "--locked", "--workspace", "--all-targets", "--", "-D", "warnings"])?;
    let doc = ["doc", "--locked", "--workspace", "--no-deps"];
    execute(command("cargo", &doc).env("RUSTDOCFLAGS", "-D warnings"), "RUSTDOCFLAGS='-D warnings' ")?;
    wasm::wasm()?;
    test(&[])?;
    python::python(&[])?;
    extra("typos", command("typos", &[]))?;
    // The list of known weaknesses would have to be fetched, so it is left out here.
    extra("cargo-deny", command("cargo", &["deny", "check", "licenses", "bans", "sources"]))
}

/// Runs a check by a tool that not everybody has.
fn extra(tool: &str, mut command_line: Command) -> anyhow::Result<()> {
    if answers(tool, &["--version"]) {
        return execute(&mut command_line, "");
    }
    eprintln!("xtask: {tool} is not installed: skipped");
    Ok(())
}

/// Runs all tests. They need nothing but the repository; set `LANECRAFT_DATA` to a folder of recordings to test with these, too.
fn test(arguments: &[&str]) -> anyhow::Result<()> {
    if answers("cargo", &["nextest", "--version"]) {
        cargo(&[["nextest", "run", "--locked", "--workspace"].as_slice(), arguments].concat())?;
        // The runner above leaves out the examples in the documentation.
        if arguments.is_empty() { cargo(&["test", "--locked", "--workspace", "--doc"]) } else { Ok(()) }
    } else {
        cargo(&[["test", "--locked", "--workspace"].as_slice(), arguments].concat())
    }
}

fn cargo(arguments: &[&str]) -> anyhow::Result<()> {
    execute(&mut command("cargo", arguments), "")
}

/// The root of the workspace.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("xtask is a folder of the workspace")
}

/// A command that runs in the root of the workspace and gets no input.
fn command(program: &str, arguments: &[&str]) -> Command {
    let program =
        if program == "cargo" { env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned()) } else { program.to_owned() };
    let mut command = Command::new(program);
    command.args(arguments).current_dir(root()).stdin(Stdio::null());
    command
}

/// Shows the command, runs it, says how long it took.
fn execute(command: &mut Command, prefix: &str) -> anyhow::Result<()> {
    let name = Path::new(command.get_program()).file_name().unwrap_or_default().to_string_lossy().into_owned();
    let arguments: Vec<_> = command.get_args().map(|argument| argument.to_string_lossy()).collect();
    let line = format!("{name} {}", arguments.join(" "));
    eprintln!("xtask: {prefix}{line}");
    let start = Instant::now();
    let status = command.status().with_context(|| format!("cannot start `{line}`"))?;
    if !status.success() {
        bail!("`{line}` failed ({status})");
    }
    eprintln!("xtask: done in {:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}

fn answers(program: &str, arguments: &[&str]) -> bool {
    command(program, arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}
