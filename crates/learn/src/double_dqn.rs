//! Double deep Q-learning (van Hasselt, Guez and Silver, 2016): `y = r + γᵏ Q⁻(s', argmax_a Q(s', a))`, so that the network that
//! picks the action is not the one that values it, and the maximum over errors no longer inflates the values.

use crate::algorithm::{Next, best_allowed};

/// The target y.
pub(crate) fn target(next: &Next<'_>) -> f32 {
    next.target_from(next.target[best_allowed(next.online, next.allowed)])
}
