//! The `lanecraft` binary.
fn main() {}
