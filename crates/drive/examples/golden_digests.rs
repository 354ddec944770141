//! Compares the golden digests on whatever target this is built for; the exit status tells which one differs.
//!
//! Made for WebAssembly, where a program without an operating system can say no more than that.

use std::process::ExitCode;

#[path = "../tests/golden/mod.rs"]
mod golden;

fn main() -> ExitCode {
    let traffic_differs = golden::traffic_digest() != golden::TRAFFIC_DIGEST;
    let closed_loop_differs = golden::closed_loop_digest() != golden::CLOSED_LOOP_DIGEST;
    ExitCode::from(u8::from(traffic_differs) + 2 * u8::from(closed_loop_differs))
}
