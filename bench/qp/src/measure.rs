//! Time of each solver on each case: of every problem the shortest of three passes, so that what is left of it is a property of
//! the problem; then mean, 99.9 % quantile and maximum over the problems. One thread, one run.

use std::path::PathBuf;
use std::time::Instant;

use lanecraft_qp::{Problem, Solver, Start, Status, Verdict};

use crate::dump;
use crate::peer::Clarabel;
use crate::sequences::Visitor;

const PASSES: usize = 3;
/// Tolerance of the peer: its own default.
const PEER_TOLERANCE: f64 = 1e-8;

/// Shortest times of one solver on the problems of one case, in µs.
#[derive(Clone, Debug, Default)]
pub struct Times {
    us: Vec<f64>,
}

impl Times {
    /// Calls `solve` on all problems, three times. Each is first copied into the same memory, as a controller would write it.
    fn measure<const NX: usize, const NS: usize>(
        problems: &[Problem<NX, NS>],
        mut solve: impl FnMut(usize, &Problem<NX, NS>) -> f64,
    ) -> Self {
        let mut us = vec![f64::INFINITY; problems.len()];
        let mut written = problems[0].clone();
        for _ in 0..PASSES {
            for (i, problem) in problems.iter().enumerate() {
                written.initial_state = problem.initial_state;
                (written.input_min, written.input_max) = (problem.input_min, problem.input_max);
                written.stages.clone_from(&problem.stages);
                us[i] = us[i].min(solve(i, &written));
            }
        }
        Self { us }
    }

    /// Mean, in µs.
    pub fn mean(&self) -> f64 {
        self.us.iter().sum::<f64>() / self.us.len() as f64
    }

    /// The time that all but `share` of the problems stay within, in µs.
    pub fn quantile(&self, share: f64) -> f64 {
        let mut sorted = self.us.clone();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len() - 1;
        sorted[((sorted.len() as f64 * share) as usize).min(last)]
    }
}

/// What was measured on one case.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Its name.
    pub case: String,
    /// In the order of [`SOLVERS`].
    pub times: [Times; 3],
    /// Most steps of one solve, warm and cold.
    pub iterations_max: [u32; 2],
    /// Problems that ours did not solve, warm and cold.
    pub unsolved: [usize; 2],
}

/// Ours with `Start::Shifted(0)`, which keeps the factor of the active set as the peer in `bench/peers` does, ours with nothing remembered, and Clarabel with its object re-used.
pub const SOLVERS: [&str; 3] = ["ours-warm", "ours-cold", "clarabel"];

/// Measures every case it is shown; the parts of a case, named `<case>-<part>`, are joined.
#[derive(Debug, Default)]
pub struct Stopwatch {
    /// One for each case.
    pub outcomes: Vec<Outcome>,
    /// Where to write the sequences, if anywhere.
    pub folder: Option<PathBuf>,
    /// The error that kept a sequence from being written.
    pub error: Option<anyhow::Error>,
}

impl Visitor for Stopwatch {
    fn visit<const NX: usize, const NS: usize>(&mut self, name: &'static str, problems: &[Problem<NX, NS>]) {
        let case = name.split('-').next().unwrap_or(name);
        if self.outcomes.last().is_none_or(|outcome| outcome.case != case) {
            let times = Default::default();
            self.outcomes.push(Outcome { case: case.to_owned(), times, iterations_max: [0; 2], unsolved: [0; 2] });
        }
        let Some(outcome) = self.outcomes.last_mut() else { return };
        let mut firsts = vec![0.0; problems.len()];
        for (i, warm) in [true, false].into_iter().enumerate() {
            let (times, answers) = ours(problems, warm);
            for (first, (input, verdict)) in firsts.iter_mut().zip(&answers) {
                *first = *input;
                outcome.iterations_max[i] = outcome.iterations_max[i].max(verdict.iterations);
                outcome.unsolved[i] += usize::from(verdict.status != Status::Solved);
            }
            outcome.times[i].us.extend(&times.us);
            if let Some(folder) = self.folder.as_ref().filter(|_| warm) {
                let answers: Vec<_> = firsts.iter().copied().zip(times.us).collect();
                self.error = self.error.take().or(dump::write(folder, name, problems, &answers).err());
            }
        }
        outcome.times[2].us.extend(peer(problems).us);
    }
}

fn ours<const NX: usize, const NS: usize>(problems: &[Problem<NX, NS>], warm: bool) -> (Times, Vec<(f64, Verdict)>) {
    let mut solver = Solver::new(problems[0].stages.len());
    let mut answers = Vec::with_capacity(problems.len());
    let times = Times::measure(problems, |i, problem| {
        if i == 0 || !warm {
            solver.reset();
        }
        let start = Instant::now();
        let verdict = solver.solve(problem, if warm { Start::Shifted(0) } else { Start::Cold });
        let us = start.elapsed().as_secs_f64() * 1e6;
        if answers.len() < problems.len() {
            answers.push((solver.inputs()[0], verdict));
        }
        us
    });
    (times, answers)
}

fn peer<const NX: usize, const NS: usize>(problems: &[Problem<NX, NS>]) -> Times {
    let mut peer = Clarabel::new(PEER_TOLERANCE);
    Times::measure(problems, |_, problem| {
        let start = Instant::now();
        let _ = peer.solve(problem);
        start.elapsed().as_secs_f64() * 1e6
    })
}
