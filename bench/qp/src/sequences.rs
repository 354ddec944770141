//! The cases, by name: lane keeping (K), lane changes at one speed (L) and at a varying one (V), steering rate as input (R),
//! each with its horizon; and states far outside every limit (stress).

use lanecraft_net::random::Stream;
use lanecraft_qp::Problem;

use crate::{keeping, steering};

/// Something to do with a sequence of whatever size its problems have.
pub trait Visitor {
    /// Takes the sequence of the case `name`.
    fn visit<const NX: usize, const NS: usize>(&mut self, name: &'static str, problems: &[Problem<NX, NS>]);
}

/// Shows all cases of `count` problems each to `visitor`; a stress case comes in its parts by the kind of problem.
pub fn visit_all(count: usize, visitor: &mut impl Visitor) {
    visitor.visit("K20", &keeping::sequence::<2>(20, 0.1, count));
    let k50 = keeping::sequence::<3>(50, 0.05, count);
    visitor.visit("K50", &k50);
    visitor.visit("L20", &steering::sequence::<4, 3>(20, false, count));
    let l50 = steering::sequence::<4, 3>(50, false, count);
    visitor.visit("L50", &l50);
    visitor.visit("V50", &steering::sequence::<4, 3>(50, true, count));
    let r50 = steering::sequence::<5, 4>(50, true, count);
    visitor.visit("R50", &r50);
    visitor.visit("stress-K50", &stress(&k50, far_keeping));
    visitor.visit("stress-L50", &stress(&l50, far_steering));
    visitor.visit("stress-R50", &stress(&r50, far_steering));
}

/// Every fifth problem, moved far out.
fn stress<const NX: usize, const NS: usize>(
    problems: &[Problem<NX, NS>],
    mut move_far: impl FnMut(&mut Problem<NX, NS>, &mut Stream),
) -> Vec<Problem<NX, NS>> {
    let mut stream = Stream::keyed(1, "bench.stress", NX as u64, NS as u64);
    let mut far: Vec<_> = problems.iter().step_by(5).cloned().collect();
    for problem in &mut far {
        move_far(problem, &mut stream);
    }
    far
}

/// Another speed, and a leader who jumps about by up to 60 m.
fn far_keeping(problem: &mut Problem<3, 2>, stream: &mut Stream) {
    problem.initial_state[1] += 15.0 * stream.normal();
    for stage in &mut problem.stages {
        stage.rows[1].upper -= 60.0 * stream.uniform();
    }
}

/// Sideways by some m/s and some meters, turning by half a radian per second.
fn far_steering<const NX: usize, const NS: usize>(problem: &mut Problem<NX, NS>, stream: &mut Stream) {
    for (state, size) in problem.initial_state.iter_mut().zip([3.0, 0.05, 0.5, 5.0]) {
        *state += size * stream.normal();
    }
}
