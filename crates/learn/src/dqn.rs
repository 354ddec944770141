//! Deep Q-learning (Mnih et al., 2015; Eq. 10 with one head): `y = r + γᵏ max_a Q⁻(s', a)`, a among the actions allowed in s'.

use crate::algorithm::Next;

/// The next action whose value the target takes over.
pub(crate) fn next_action(next: &Next<'_>) -> usize {
    next.target.best(next.allowed)
}
