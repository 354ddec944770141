//! The same bits in WebAssembly: the golden digests, built for the browser's target and run by Node.js.

use std::path::Path;

use crate::{answers, cargo, command, execute};

const TARGET: &str = "wasm32-unknown-unknown";
/// Ends with the status of the program's `main`.
const NODE_SCRIPT: &str = "\
    const program = new WebAssembly.Module(require('fs').readFileSync(process.argv[1]));\
    process.exit(new WebAssembly.Instance(program, {}).exports.main(0, 0));";

/// Builds the crates for WebAssembly and compares the golden digests there; says what is missing where it cannot.
pub(crate) fn wasm() -> anyhow::Result<()> {
    if !has_target() {
        eprintln!("xtask: target {TARGET} is not installed (rustup target add {TARGET}): skipped");
        return Ok(());
    }
    let build = ["build", "--locked", "--release", "--target", TARGET, "--target-dir", "target/wasm"];
    // `learn` also runs in a browser, beside the driver.
    cargo(&[&build, ["--package", "lanecraft-learn"].as_slice()].concat())?;
    cargo(&[&build, ["--package", "lanecraft-drive", "--example", "golden_digests"].as_slice()].concat())?;
    if !answers("node", &["--version"]) {
        eprintln!("xtask: node is not installed: the golden digests are not compared in WebAssembly");
        return Ok(());
    }
    let program = format!("target/wasm/{TARGET}/release/examples/golden_digests.wasm");
    execute(&mut command("node", &["--eval", NODE_SCRIPT, &program]), "")
}

/// Whether the standard library of the target is there, however it was installed.
fn has_target() -> bool {
    let output = command("rustc", &["--print", "target-libdir", "--target", TARGET]).output();
    output.is_ok_and(|output| {
        output.status.success() && Path::new(String::from_utf8_lossy(&output.stdout).trim()).is_dir()
    })
}
