//! Acting: a snapshot of the network and what takes decisions with it.

use lanecraft_net::Ensemble;
use lanecraft_net::random::Stream;

use crate::Readout;
use crate::bootstrapped_dqn::vote;
use crate::loss::all_finite;
use crate::q_network::{QNetwork, QWorkspace};
use crate::readout::best_allowed;
use crate::replay::all_actions;

/// A network that no longer changes. Cloning shares it, so that threads can act with it while the learner goes on.
#[derive(Clone, Debug)]
pub struct Policy {
    pub(crate) network: QNetwork,
}

/// A decision of all heads together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// The action.
    pub action: usize,
    /// Share of the heads that voted for it, a measure of certainty; 1 with one head.
    pub agreement: f64,
    /// Its value, the mean over the heads, in units of scaled reward.
    pub q: f64,
}

/// How to decide in training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exploration {
    /// The head that decides, drawn for each episode.
    pub head: usize,
    /// Share of decisions drawn uniformly from the allowed actions.
    pub epsilon: f64,
}

/// A decision that cannot be taken.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ActError {
    /// An observation of the wrong length.
    #[error("the observation has {found} numbers, but the network takes {expected}")]
    Length {
        /// Length required.
        expected: usize,
        /// Length found.
        found: usize,
    },
    /// No action is allowed.
    #[error("the mask {mask:#b} allows none of the {actions} actions")]
    NothingAllowed {
        /// The mask.
        mask: u32,
        /// Number of actions.
        actions: usize,
    },
    /// The observation or the network leads to values that are infinite or not numbers.
    #[error("the network's values of this observation are not finite; look for NaN in the observation")]
    NotFinite,
    /// A head there is not.
    #[error("head {found} was asked to decide, but there are {heads}")]
    Head {
        /// The head asked for.
        found: usize,
        /// Number of heads.
        heads: usize,
    },
}

impl Policy {
    /// Length of an observation.
    pub fn inputs(&self) -> usize {
        self.network.inputs()
    }

    /// Number of actions.
    pub fn actions(&self) -> usize {
        self.network.actions()
    }

    /// Number of heads.
    pub fn heads(&self) -> usize {
        self.network.heads()
    }

    /// The trained network.
    pub fn network(&self) -> &Ensemble {
        &self.network.trained
    }

    /// How its outputs are read.
    pub fn readout(&self) -> Readout {
        self.network.readout
    }

    /// The prior under the heads with its scale, if there is one.
    pub fn prior(&self) -> Option<(&Ensemble, f32)> {
        self.network.prior.as_ref().map(|prior| (&prior.network, prior.scale as f32))
    }
}

/// Takes decisions with a policy; one for each thread, since it owns the memory of a forward pass.
#[derive(Clone, Debug)]
pub struct Actor {
    policy: Policy,
    workspace: QWorkspace,
    estimates: Vec<f32>,
    q: Vec<f32>,
}

impl Actor {
    /// An actor with this policy.
    pub fn new(policy: Policy) -> Self {
        let workspace = policy.network.workspace(1);
        Self { policy, workspace, estimates: Vec::new(), q: Vec::new() }
    }

    /// The policy.
    pub fn policy(&self) -> &Policy {
        &self.policy
    }

    /// Goes on with another policy.
    pub fn set_policy(&mut self, policy: Policy) {
        if policy.network.is_like(&self.policy.network) {
            self.policy = policy;
        } else {
            *self = Self::new(policy);
        }
    }

    /// Q of every head for each action, heads × A, in units of scaled reward.
    pub fn q_heads(&mut self, observation: &[f32]) -> Result<&[f32], ActError> {
        Ok(self.values(observation, u32::MAX, u32::MAX)?.0)
    }

    /// The vote of all heads among the actions of `mask` (action 0 in the lowest bit).
    pub fn greedy(&mut self, observation: &[f32], mask: u32) -> Result<Choice, ActError> {
        let actions = self.policy.actions();
        let (q, allowed) = self.values(observation, mask, u32::MAX)?;
        Ok(vote(q, actions, allowed))
    }

    /// A decision in training: random among the actions of `mask` with the share `epsilon`, else the best of one head.
    pub fn act(
        &mut self,
        observation: &[f32],
        mask: u32,
        exploration: Exploration,
        stream: &mut Stream,
    ) -> Result<usize, ActError> {
        let (head, heads) = (exploration.head, self.policy.heads());
        if head >= heads {
            return Err(ActError::Head { found: head, heads });
        }
        let (q, allowed) = self.values(observation, mask, 1 << head)?;
        if stream.bernoulli(exploration.epsilon) {
            return Ok(nth_allowed(allowed, stream.below(allowed.count_ones() as usize)));
        }
        Ok(best_allowed(q.iter().copied(), allowed))
    }

    /// Values of the heads in `heads` (head 0 in the lowest bit), heads × A, and the mask without bits beyond the actions.
    fn values(&mut self, observation: &[f32], mask: u32, heads: u32) -> Result<(&[f32], u32), ActError> {
        let (expected, actions) = (self.policy.inputs(), self.policy.actions());
        if observation.len() != expected {
            return Err(ActError::Length { expected, found: observation.len() });
        }
        let allowed = mask & all_actions(actions);
        if allowed == 0 {
            return Err(ActError::NothingAllowed { mask, actions });
        }
        let network = &self.policy.network;
        network.estimates(observation, &[heads], &mut self.workspace, &mut self.estimates);
        if !all_finite(&self.estimates) {
            return Err(ActError::NotFinite);
        }
        Ok((network.readout.q(&self.estimates, &mut self.q), allowed))
    }
}

/// The index of the n-th set bit, n from 0 and below the number of set bits.
fn nth_allowed(mut mask: u32, n: usize) -> usize {
    for _ in 0..n {
        mask &= mask - 1;
    }
    mask.trailing_zeros() as usize
}

#[cfg(test)]
mod tests {
    use super::{ActError, Actor, Exploration, Policy, nth_allowed};
    use crate::{Learner, LearnerConfig};
    use lanecraft_net::Workspace;
    use lanecraft_net::random::Stream;

    #[test]
    fn set_bits_are_counted_from_the_lowest() {
        assert_eq!([0, 1, 2].map(|n| nth_allowed(0b1010_0100, n)), [2, 5, 7]);
    }

    #[test]
    fn masked_actions_are_never_chosen_and_allowed_ones_all_are() {
        let learner = Learner::new(&LearnerConfig::default(), 3, 5, 1).unwrap();
        let mut actor = Actor::new(learner.policy());
        let mut stream = Stream::new(1, "test");
        let mut seen = 0_u32;
        for step in 0..500_u32 {
            let observation = [0, 1, 2].map(|_| stream.normal() as f32);
            let exploration = Exploration { head: step as usize % 6, epsilon: 0.5 };
            let action = actor.act(&observation, 0b10110, exploration, &mut stream).unwrap();
            seen |= 1 << action;
            let choice = actor.greedy(&observation, 0b01010).unwrap();
            assert!(choice.action == 1 || choice.action == 3);
            assert!((1.0 / 6.0..=1.0).contains(&choice.agreement));
        }
        assert_eq!(seen, 0b10110);
    }

    #[test]
    fn without_exploration_each_head_takes_its_own_best_action() {
        let learner = Learner::new(&LearnerConfig::default(), 3, 5, 1).unwrap();
        let mut actor = Actor::new(learner.policy());
        let observation = [0.3, -1.0, 0.7];
        let mut workspace = Workspace::new(learner.policy().network(), 1);
        let q = learner.policy().network().forward(&observation, &mut workspace).to_vec();
        for (head, values) in q.chunks_exact(5).enumerate() {
            let exploration = Exploration { head, epsilon: 0.0 };
            let action = actor.act(&observation, 0b11111, exploration, &mut Stream::new(1, "test")).unwrap();
            assert!(values.iter().all(|value| *value <= values[action]));
        }
    }

    #[test]
    fn policies_may_cross_threads() {
        fn shared<T: Send + Sync + 'static>() {}
        shared::<Policy>();
    }

    #[test]
    fn impossible_decisions_are_refused() {
        let learner = Learner::new(&LearnerConfig::default(), 2, 3, 1).unwrap();
        let mut actor = Actor::new(learner.policy());
        assert_eq!(actor.greedy(&[0.0], 1), Err(ActError::Length { expected: 2, found: 1 }));
        assert_eq!(actor.greedy(&[0.0, 0.0], 0b1000), Err(ActError::NothingAllowed { mask: 8, actions: 3 }));
        assert_eq!(actor.greedy(&[0.0, f32::NAN], 1), Err(ActError::NotFinite));
        let exploration = Exploration { head: 6, epsilon: 0.0 };
        let refused = actor.act(&[0.0, 0.0], 1, exploration, &mut Stream::new(1, "test"));
        assert_eq!(refused, Err(ActError::Head { found: 6, heads: 6 }));
    }
}
