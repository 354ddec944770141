//! Double deep Q-learning (van Hasselt, Guez and Silver, 2016): `y = r + γᵏ Q⁻(s', argmax_a Q(s', a))`, so that the network that
//! picks the action is not the one that values it, and the maximum over errors no longer inflates the values.

use crate::algorithm::Next;

/// The next action whose value the target takes over.
pub(crate) fn next_action(next: &Next<'_>) -> usize {
    next.online.best(next.allowed)
}
