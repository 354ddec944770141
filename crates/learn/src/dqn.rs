//! Deep Q-learning (Mnih et al., 2015; Eq. 10 with one head): `y = r + γᵏ max_a Q⁻(s', a)`, a among the actions allowed in s'.

use crate::algorithm::{Next, best_allowed};

/// The target y.
pub(crate) fn target(next: &Next<'_>) -> f32 {
    next.target_from(next.target[best_allowed(next.target, next.allowed)])
}
