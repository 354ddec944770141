//! Tells the library which commit it is built from, for the manifests of runs; without git or a repository it stays unknown.

use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=../../.git/HEAD");
    println!("cargo::rerun-if-changed=../../.git/refs/heads");
    let git = Command::new("git").args(["rev-parse", "HEAD"]).output();
    if let Some(output) = git.ok().filter(|output| output.status.success()) {
        println!("cargo::rustc-env=LANECRAFT_COMMIT={}", String::from_utf8_lossy(&output.stdout).trim());
    }
}
