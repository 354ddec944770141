//! The sequences as files of little-endian f64, for peers in other languages.

use std::fs;
use std::path::Path;

use anyhow::Context as _;
use lanecraft_qp::Problem;

/// Writes `<name>.bin` into `folder`: count, N, NX, NS; then for each problem `x_0` and the bounds of the input, and for each
/// stage A (row by row), B, c, Q, its reference, R, its reference, and for each row C, D, bounds and both weights; then, for
/// each problem, the first input and the time in µs that are given here.
pub fn write<const NX: usize, const NS: usize>(
    folder: &Path,
    name: &str,
    problems: &[Problem<NX, NS>],
    answers: &[(f64, f64)],
) -> anyhow::Result<()> {
    let horizon = problems.first().map_or(0, |problem| problem.stages.len());
    let mut numbers: Vec<f64> = [problems.len(), horizon, NX, NS].map(|n| n as f64).to_vec();
    for problem in problems {
        numbers.extend(problem.initial_state);
        numbers.extend([problem.input_min, problem.input_max]);
        for stage in &problem.stages {
            numbers.extend(stage.a.as_flattened());
            numbers.extend(stage.b.iter().chain(&stage.c).chain(&stage.state_weight).chain(&stage.state_reference));
            numbers.extend([stage.input_weight, stage.input_reference]);
            for row in &stage.rows {
                numbers.extend(row.state);
                numbers.extend([row.input, row.lower, row.upper, row.l1_weight, row.l2_weight]);
            }
        }
    }
    numbers.extend(answers.iter().flat_map(|(input, time_us)| [*input, *time_us]));
    let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
    fs::create_dir_all(folder).with_context(|| format!("cannot create `{}`", folder.display()))?;
    let path = folder.join(format!("{name}.bin"));
    fs::write(&path, bytes).with_context(|| format!("cannot write `{}`", path.display()))
}
