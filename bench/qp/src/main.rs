//! Times the solver beside Clarabel; see `cargo xtask bench qp`.
// The results go to the standard output: that is what this program is for.
#![allow(clippy::print_stdout)]

use std::path::PathBuf;

use anyhow::bail;
use lanecraft_bench_qp::long;
use lanecraft_bench_qp::measure::{Outcome, SOLVERS, Stopwatch};
use lanecraft_bench_qp::sequences::visit_all;

const HELP: &str = "\
bench qp [--json] [--dump DIR]   time the solver and Clarabel; DIR gets the problems, for bench/peers/daqp_qp.py
bench qp --long [COUNT]          solve COUNT random problems (1000000 if not given) and check every answer";
/// Problems of a case.
const COUNT: usize = 1000;
const LONG_COUNT: usize = 1_000_000;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut stopwatch = Stopwatch::default();
    let mut json = false;
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        match (argument.as_str(), rest.as_slice()) {
            ("--json", _) => json = true,
            ("--dump", [folder, ..]) => {
                stopwatch.folder = Some(PathBuf::from(folder));
                rest.next();
            }
            ("--long", []) => return long(LONG_COUNT),
            ("--long", [count]) => return long(count.parse()?),
            _ => bail!("`{argument}` is not understood here\n{HELP}"),
        }
    }
    visit_all(COUNT, &mut stopwatch);
    if let Some(error) = stopwatch.error {
        return Err(error);
    }
    for outcome in &stopwatch.outcomes {
        if json { print_json(outcome) } else { print_table(outcome) }
    }
    Ok(())
}

fn print_json(outcome: &Outcome) {
    for (solver, times) in SOLVERS.iter().zip(&outcome.times) {
        let values = [("mean", times.mean()), ("p999", times.quantile(0.999)), ("max", times.quantile(1.0))];
        for (name, value) in values {
            let case = &outcome.case;
            println!(r#"{{"bench": "qp/{case}/{solver}/{name}", "value": {value:.3}, "unit": "us"}}"#);
        }
    }
}

fn print_table(outcome: &Outcome) {
    let case = &outcome.case;
    for (i, (solver, times)) in SOLVERS.iter().zip(&outcome.times).enumerate() {
        let [median, p999, max] = [0.5, 0.999, 1.0].map(|share| times.quantile(share));
        let mean = times.mean();
        print!("{case:6} {solver:9} median {median:8.2} mean {mean:8.2} p99.9 {p999:8.2} max {max:8.2} us");
        match outcome.iterations_max.get(i) {
            Some(steps) => println!(", at most {steps} steps, {} unsolved", outcome.unsolved[i]),
            None => println!(", {:.0} times ours-warm", mean / outcome.times[0].mean()),
        }
    }
}

fn long(count: usize) -> anyhow::Result<()> {
    let report = long::run(count);
    println!("{report}");
    if report.failures > 0 {
        bail!("{} answers break a promise", report.failures);
    }
    Ok(())
}
