//! What the learners share: the choice among them and the data of one row of a batch.

use serde::{Deserialize, Serialize};

use crate::{LearnerConfig, bootstrapped_dqn, double_dqn, dqn};

/// The value learners. All three train the same kind of network by the same steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Algorithm {
    /// Deep Q-learning (Mnih et al., 2015).
    Dqn,
    /// Double deep Q-learning (van Hasselt et al., 2016).
    DoubleDqn,
    /// Bootstrapped deep Q-learning (Osband et al., 2016), the paper's learner.
    BootstrappedDqn,
}

/// What one head knows about the end of one transition.
pub(crate) struct Next<'a> {
    /// Reward until the next decision.
    pub(crate) reward: f32,
    /// γᵏ, 0 after a terminated episode.
    pub(crate) discount: f32,
    /// Actions allowed at the next decision.
    pub(crate) allowed: u32,
    /// Values of the next observation by this head of the online network; empty where the algorithm does not ask for them.
    pub(crate) online: &'a [f32],
    /// The same by the target network.
    pub(crate) target: &'a [f32],
}

impl Next<'_> {
    /// r + γᵏ · value; a terminated episode has no next value, whatever the network says.
    pub(crate) fn target_from(&self, value: f32) -> f32 {
        if self.discount == 0.0 { self.reward } else { self.reward + self.discount * value }
    }
}

impl Algorithm {
    /// Whether targets need the online network's values of the next observation.
    pub(crate) fn needs_online_next(self, config: &LearnerConfig) -> bool {
        match self {
            Self::Dqn => false,
            Self::DoubleDqn => true,
            Self::BootstrappedDqn => config.double_targets,
        }
    }

    /// The value that a head's Q of the action taken is drawn to.
    pub(crate) fn target(self, next: &Next<'_>, config: &LearnerConfig) -> f32 {
        match self {
            Self::Dqn => dqn::target(next),
            Self::DoubleDqn => double_dqn::target(next),
            Self::BootstrappedDqn => bootstrapped_dqn::target(next, config.double_targets),
        }
    }

    /// The heads that learn from a transition with this bootstrap mask, head 0 in the lowest bit.
    pub(crate) fn learning_heads(self, bootstrap_mask: u32) -> u32 {
        match self {
            Self::Dqn | Self::DoubleDqn => 1,
            // d in Eq. 9.
            Self::BootstrappedDqn => bootstrap_mask,
        }
    }
}

/// The allowed action of the largest value, the lowest index of equals; 0 if nothing is allowed.
pub(crate) fn best_allowed(values: &[f32], allowed: u32) -> usize {
    let mut best: Option<(usize, f32)> = None;
    for (action, &value) in values.iter().enumerate() {
        if allowed >> action & 1 == 1 && best.is_none_or(|(_, largest)| value > largest) {
            best = Some((action, value));
        }
    }
    best.map_or(0, |(action, _)| action)
}

#[cfg(test)]
mod tests {
    use super::{Algorithm, Next, best_allowed};
    use crate::LearnerConfig;

    fn next(allowed: u32, discount: f32) -> Next<'static> {
        Next { reward: 1.0, discount, allowed, online: &[0.0, 3.0, 9.0], target: &[4.0, 2.0, 8.0] }
    }

    #[test]
    fn masked_actions_are_never_bootstrapped() {
        let max = LearnerConfig { double_targets: false, ..LearnerConfig::default() };
        let double = LearnerConfig { double_targets: true, ..LearnerConfig::default() };
        // Action 2 has the largest values of both networks, but is not allowed.
        for (algorithm, config, expected) in [
            (Algorithm::Dqn, &max, 1.0 + 0.5 * 4.0),
            (Algorithm::DoubleDqn, &max, 1.0 + 0.5 * 2.0),
            (Algorithm::BootstrappedDqn, &max, 1.0 + 0.5 * 4.0),
            (Algorithm::BootstrappedDqn, &double, 1.0 + 0.5 * 2.0),
        ] {
            assert_eq!(algorithm.target(&next(0b011, 0.5), config), expected);
            assert_eq!(algorithm.target(&next(0, 0.0), config), 1.0);
        }
    }

    #[test]
    fn ties_go_to_the_lowest_index() {
        assert_eq!(best_allowed(&[1.0, 2.0, 2.0], 0b111), 1);
        assert_eq!(best_allowed(&[1.0, 2.0, 2.0], 0b101), 2);
    }
}
