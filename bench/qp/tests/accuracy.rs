//! The answers on the sequences: against Clarabel, against themselves polished, and on random problems.

use lanecraft_bench_qp::long;
use lanecraft_bench_qp::peer::Clarabel;
use lanecraft_bench_qp::sequences::{Visitor, visit_all};
use lanecraft_qp::{Problem, Solver, Start, Status};

/// Problems of a case.
const COUNT: usize = 400;
/// Of every so many problems, Clarabel solves one.
const SHARE: usize = 12;
/// Of the input range. Clarabel at 1e-11 itself leaves up to 8e-6.
const PEER_TOLERANCE: f64 = 1e-5;
/// Of the input range, between answers whose active sets have come about on different ways.
const POLISHED_TOLERANCE: f64 = 1e-6;
const KKT_TOLERANCE: f64 = 1e-8;
/// Without the interior point the stress case takes up to 380.
const STEPS_MAX: u32 = 120;

#[derive(Default)]
struct Judge {
    compared: usize,
}

impl Visitor for Judge {
    fn visit<const NX: usize, const NS: usize>(&mut self, name: &'static str, problems: &[Problem<NX, NS>]) {
        let horizon = problems[0].stages.len();
        let (mut warm, mut polished) = (Solver::new(horizon), Solver::new(horizon));
        for (i, problem) in problems.iter().enumerate() {
            let verdict = warm.solve(problem, Start::Shifted(1));
            assert_eq!(verdict.status, Status::Solved, "{name} {i}: {verdict:?}");
            assert!(verdict.kkt_residual <= KKT_TOLERANCE, "{name} {i}: {verdict:?}");
            assert!(verdict.iterations <= STEPS_MAX, "{name} {i}: {verdict:?}");
            let range = problem.input_max - problem.input_min;
            // Solved from nothing, then once more from its own active set.
            let _ = polished.solve(problem, Start::Cold);
            let _ = polished.solve(problem, Start::Shifted(0));
            let apart = (warm.inputs()[0] - polished.inputs()[0]).abs() / range;
            assert!(apart < POLISHED_TOLERANCE, "{name} {i}: {apart} of the range from the polished answer");
            if i % SHARE == 0 {
                let (inputs, solved) = Clarabel::new(1e-11).solve(problem);
                let apart = (warm.inputs()[0] - inputs[0]).abs() / range;
                assert!(!solved || apart < PEER_TOLERANCE, "{name} {i}: {apart} of the range from Clarabel");
                self.compared += usize::from(solved);
            }
        }
    }
}

#[test]
fn first_inputs_agree_with_a_second_source_and_with_the_polished_answer() {
    let mut judge = Judge::default();
    visit_all(COUNT, &mut judge);
    assert!(judge.compared > 150, "Clarabel solved only {}", judge.compared);
}

#[test]
fn random_problems_keep_all_promises() {
    let report = long::run(20_000);
    assert_eq!(report.failures, 0, "{report}");
    assert!(report.refused > 3000 && report.solved > 15_000, "{report}");
}
