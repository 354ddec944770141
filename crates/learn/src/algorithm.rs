//! What tells the learners apart: the next action of the targets, the heads that learn, and what the outputs of the network mean.

use serde::{Deserialize, Serialize};

use crate::readout::Estimates;
use crate::{LearnerConfig, Readout, bootstrapped_dqn, double_dqn, dqn};

/// The value learners. All train the same kind of network by the same steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Algorithm {
    /// Deep Q-learning (Mnih et al., 2015).
    Dqn,
    /// Double deep Q-learning (van Hasselt et al., 2016).
    DoubleDqn,
    /// Bootstrapped deep Q-learning (Osband et al., 2016), the paper's learner.
    BootstrappedDqn,
    /// Double deep Q-learning with a stream for the value and one for the advantages (Wang et al., 2016).
    DuelingDqn,
    /// Deep Q-learning of the quantiles of returns (QR-DQN; Dabney et al., 2018).
    QuantileDqn,
}

/// What one head knows about the end of one transition.
pub(crate) struct Next<'a> {
    /// Reward until the next decision.
    pub(crate) reward: f32,
    /// γᵏ, 0 after a terminated episode.
    pub(crate) discount: f32,
    /// Actions allowed at the next decision.
    pub(crate) allowed: u32,
    /// Estimates of the next observation by this head of the online network; empty where the algorithm does not ask for them.
    pub(crate) online: Estimates<'a>,
    /// The same by the target network.
    pub(crate) target: Estimates<'a>,
}

impl Next<'_> {
    /// r + γᵏ · value; a terminated episode has no next value, whatever the network says.
    fn target_from(&self, value: f32) -> f32 {
        if self.discount == 0.0 { self.reward } else { self.reward + self.discount * value }
    }
}

impl Algorithm {
    /// Whether targets need the online network's estimates of the next observation.
    pub(crate) fn needs_online_next(self, config: &LearnerConfig) -> bool {
        match self {
            Self::Dqn | Self::QuantileDqn => false,
            Self::DoubleDqn | Self::DuelingDqn => true,
            Self::BootstrappedDqn => config.double_targets,
        }
    }

    /// Writes the targets that a head's estimates of the action taken are drawn to.
    pub(crate) fn targets(self, next: &Next<'_>, config: &LearnerConfig, to: &mut Vec<f32>) {
        let action = match self {
            Self::Dqn | Self::QuantileDqn => dqn::next_action(next),
            Self::DoubleDqn | Self::DuelingDqn => double_dqn::next_action(next),
            Self::BootstrappedDqn => bootstrapped_dqn::next_action(next, config.double_targets),
        };
        to.clear();
        to.extend(next.target.of(action).iter().map(|value| next.target_from(*value)));
    }

    /// The heads that learn from a transition with this bootstrap mask, head 0 in the lowest bit.
    pub(crate) fn learning_heads(self, bootstrap_mask: u32) -> u32 {
        match self {
            // d in Eq. 9.
            Self::BootstrappedDqn => bootstrap_mask,
            _ => 1,
        }
    }

    /// What the outputs of its network mean.
    pub(crate) fn readout(self, config: &LearnerConfig) -> Readout {
        match self {
            Self::Dqn | Self::DoubleDqn | Self::BootstrappedDqn => Readout::Plain,
            Self::DuelingDqn => Readout::Dueling,
            Self::QuantileDqn => Readout::Quantile { quantiles: config.quantiles },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Algorithm, Next};
    use crate::LearnerConfig;
    use crate::readout::Estimates;

    fn targets(algorithm: Algorithm, config: &LearnerConfig, next: &Next<'_>) -> Vec<f32> {
        let mut found = Vec::new();
        algorithm.targets(next, config, &mut found);
        found
    }

    #[test]
    fn masked_actions_are_never_bootstrapped() {
        // Action 2 has the largest values of both networks, but is not allowed.
        let online = Estimates::new(&[0.0, 3.0, 9.0], 1);
        let target = Estimates::new(&[4.0, 2.0, 8.0], 1);
        let next = |allowed, discount| Next { reward: 1.0, discount, allowed, online, target };
        let max = LearnerConfig { double_targets: false, ..LearnerConfig::default() };
        let double = LearnerConfig { double_targets: true, ..LearnerConfig::default() };
        for (algorithm, config, expected) in [
            (Algorithm::Dqn, &max, 1.0 + 0.5 * 4.0),
            (Algorithm::DoubleDqn, &max, 1.0 + 0.5 * 2.0),
            (Algorithm::DuelingDqn, &max, 1.0 + 0.5 * 2.0),
            (Algorithm::BootstrappedDqn, &max, 1.0 + 0.5 * 4.0),
            (Algorithm::BootstrappedDqn, &double, 1.0 + 0.5 * 2.0),
        ] {
            assert_eq!(targets(algorithm, config, &next(0b011, 0.5)), [expected]);
            assert_eq!(targets(algorithm, config, &next(0, 0.0)), [1.0]);
        }
    }

    #[test]
    fn every_quantile_of_the_best_allowed_action_is_a_target() {
        // Means 1, 2 and 5; action 2 is not allowed.
        let target = Estimates::new(&[9.0, -7.0, 0.0, 4.0, 5.0, 5.0], 2);
        let next = |discount| Next { reward: 1.0, discount, allowed: 0b011, online: target, target };
        let config = LearnerConfig::default();
        assert_eq!(targets(Algorithm::QuantileDqn, &config, &next(0.5)), [1.0, 3.0]);
        assert_eq!(targets(Algorithm::QuantileDqn, &config, &next(0.0)), [1.0, 1.0]);
    }
}
