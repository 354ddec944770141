//! The Python package: its wheel in a virtual environment of its own, tested and type-checked there.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};

use super::{command, execute, root};

/// What the tests need beside what the package itself needs.
const TOOLS: [&str; 5] = ["maturin>=1.9.4,<2", "pytest>=8,<10", "mypy>=1.15,<3", "pyright>=1.1.400,<2", "pandas>=2,<4"];
/// What a test with Stable-Baselines3 needs: some gigabytes.
const SB3_TOOLS: [&str; 2] = ["stable-baselines3>=2.4", "sb3-contrib>=2.4"];

/// Builds the package, installs it, and runs its tests and the checks of its types.
pub(crate) fn python(arguments: &[&str]) -> anyhow::Result<()> {
    let (with_sb3, arguments): (Vec<&str>, Vec<&str>) =
        arguments.iter().partition(|argument| **argument == "--with-sb3");
    let folder = root().join("target/python");
    let programs = virtual_environment(&folder, !with_sb3.is_empty())?;
    install_wheel(&folder, &programs)?;
    // In this folder the installed package is found, not the sources, which have no compiled half.
    let tests = root().join("python/tests");
    let run = |program: &str, arguments: &[&str]| {
        execute(command(&text(&programs.join(program)), arguments).current_dir(&tests), "")
    };
    run("python", &[["-m", "pytest"].as_slice(), &arguments].concat())?;
    if !arguments.is_empty() {
        return Ok(());
    }
    run("python", &["-m", "mypy.stubtest", "lanecraft._lanecraft"])?;
    run("pyright", &["--project", "..", "--pythonpath", &text(&programs.join("python"))])
}

/// A virtual environment with the tools, made where it is missing; the folder of its programs.
fn virtual_environment(folder: &Path, with_sb3: bool) -> anyhow::Result<PathBuf> {
    let environment = folder.join("venv");
    let programs = environment.join(if cfg!(windows) { "Scripts" } else { "bin" });
    if !programs.exists() {
        let python = ["python3", "python"].into_iter().find(|python| super::answers(python, &["--version"]));
        let Some(python) = python else { bail!("the tests of the Python package need Python 3.10 or later") };
        execute(&mut command(python, &["-m", "venv", &text(&environment)]), "")?;
    }
    let tools = if with_sb3 { [TOOLS.as_slice(), SB3_TOOLS.as_slice()].concat() } else { TOOLS.to_vec() };
    let install = [["-m", "pip", "install", "--quiet", "--disable-pip-version-check"].as_slice(), &tools].concat();
    execute(&mut command(&text(&programs.join("python")), &install), "")?;
    Ok(programs)
}

fn install_wheel(folder: &Path, programs: &Path) -> anyhow::Result<()> {
    let wheels = folder.join("wheels");
    if wheels.exists() {
        std::fs::remove_dir_all(&wheels).context("cannot remove the old wheels")?;
    }
    let build =
        ["build", "--locked", "--profile", "dev", "--manifest-path", "python/Cargo.toml", "--out", &text(&wheels)];
    execute(&mut command(&text(&programs.join("maturin")), &build), "")?;
    let wheel = std::fs::read_dir(&wheels)?.next().context("no wheel was built")??.path();
    let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--force-reinstall"];
    execute(&mut command(&text(&programs.join("python")), &[install.as_slice(), &[&text(&wheel)]].concat()), "")
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}
