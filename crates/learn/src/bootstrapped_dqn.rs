//! Bootstrapped deep Q-learning (Osband et al., 2016; Eqs. 9 to 11, Algorithm 1): K heads on a shared core.
//!
//! Each head has the targets of its own target head and learns from the transitions whose mask names it. One head, drawn
//! for each episode, drives in training; afterwards the heads vote. How far they agree measures how sure they are.
//!
//! Departures from the paper: the target copies all heads and the core (the text copies one head); the option of double
//! targets and that of a prior under each head are added; ties of votes, common with 6 heads, go to the larger mean value, then to the lowest index.

use crate::algorithm::Next;
use crate::config::MAX_MASK_BITS;
use crate::readout::best_allowed;
use crate::{Choice, double_dqn, dqn};

/// The next action whose value one head's target takes over (Eq. 10), or its double form.
pub(crate) fn next_action(next: &Next<'_>, double: bool) -> usize {
    if double { double_dqn::next_action(next) } else { dqn::next_action(next) }
}

/// The heads' vote on their values `q`, K × A, among the allowed actions.
pub(crate) fn vote(q: &[f32], actions: usize, allowed: u32) -> Choice {
    let mut votes = [0_u32; MAX_MASK_BITS];
    let mut sums = [0.0_f64; MAX_MASK_BITS];
    for values in q.chunks_exact(actions) {
        votes[best_allowed(values.iter().copied(), allowed)] += 1;
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += f64::from(*value);
        }
    }
    let mut winner = best_allowed(q[..actions].iter().copied(), allowed);
    for action in (0..actions).filter(|action| allowed >> action & 1 == 1) {
        let ahead = (votes[action], sums[action]) > (votes[winner], sums[winner]);
        let level = votes[action] == votes[winner] && sums[action] == sums[winner];
        if ahead || (level && action < winner) {
            winner = action;
        }
    }
    let heads = (q.len() / actions) as f64;
    Choice { action: winner, agreement: f64::from(votes[winner]) / heads, q: sums[winner] / heads }
}

#[cfg(test)]
mod tests {
    use super::vote;

    #[test]
    fn most_votes_win_before_values() {
        // Heads 1 and 2 prefer action 0 by a little, head 3 prefers action 1 by a lot.
        let choice = vote(&[1.0, 0.9, 1.0, 0.9, 0.0, 50.0], 2, 0b11);
        assert_eq!(choice.action, 0);
        assert!((choice.agreement - 2.0 / 3.0).abs() < 1e-12);
        assert!((choice.q - 2.0 / 3.0).abs() < 1e-6);
    }

    #[test]
    fn a_tie_of_votes_goes_to_the_mean_and_then_to_the_lowest_index() {
        assert_eq!(vote(&[1.0, 0.0, 0.0, 3.0], 2, 0b11).action, 1);
        assert_eq!(vote(&[3.0, 0.0, 0.0, 1.0], 2, 0b11).action, 0);
        assert_eq!(vote(&[0.0, 1.0, 0.0, 0.0, 0.0, 1.0], 3, 0b111).action, 1);
    }

    #[test]
    fn masked_actions_get_no_vote() {
        let choice = vote(&[9.0, 1.0, 0.0, 9.0, 0.0, 1.0], 3, 0b110);
        assert_eq!((choice.action, choice.agreement), (1, 0.5));
    }
}
