//! From the outputs of a network to the values of actions: how many outputs a head has, and what they mean.
//!
//! A pass gives each head *estimates* for each row that it sees: one number or several for each action, whose mean is Q. Learners draw the
//! estimates of the action taken to targets made of the estimates of a next action; everyone else sees Q.

use lanecraft_net::NetShape;
use serde::{Deserialize, Serialize};

use crate::loss::{clip, huber};
use crate::{dueling_dqn, quantile_dqn};

/// What the outputs of a network mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Readout {
    /// Each output is Q of an action.
    #[default]
    Plain,
    /// Two streams, a value and advantages, make Q (Wang et al., 2016).
    Dueling,
    /// Several outputs are quantiles of the return of an action, and Q is their mean (Dabney et al., 2018).
    Quantile {
        /// Quantiles of each action.
        quantiles: usize,
    },
}

impl Readout {
    /// Heads of the ensemble that make one head of Q.
    pub fn streams(self) -> usize {
        if self == Self::Dueling { 2 } else { 1 }
    }

    /// Estimates of each action.
    pub fn per_action(self) -> usize {
        if let Self::Quantile { quantiles } = self { quantiles } else { 1 }
    }

    /// The actions that an ensemble of this shape values.
    pub(crate) fn actions(self, shape: &NetShape) -> usize {
        shape.outputs / self.per_action()
    }

    /// The heads of Q of an ensemble of this shape.
    pub(crate) fn heads(self, shape: &NetShape) -> usize {
        shape.heads / self.streams()
    }

    /// Writes the estimates of a pass, for each head and row A × [`Self::per_action`], from its outputs.
    pub(crate) fn estimates(self, outputs: &[f32], actions: usize, to: &mut Vec<f32>) {
        to.clear();
        match self {
            Self::Plain | Self::Quantile { .. } => to.extend_from_slice(outputs),
            Self::Dueling => dueling_dqn::combine(outputs, actions, to),
        }
    }

    /// ∂L/∂outputs from ∂L/∂estimates; `to` is memory for it.
    pub(crate) fn pass_back<'a>(self, gradient: &'a [f32], actions: usize, to: &'a mut Vec<f32>) -> &'a [f32] {
        match self {
            Self::Plain | Self::Quantile { .. } => gradient,
            Self::Dueling => {
                dueling_dqn::pass_back(gradient, actions, to);
                to
            }
        }
    }

    /// Q of each action from its estimates; `to` is memory for it.
    pub(crate) fn q<'a>(self, estimates: &'a [f32], to: &'a mut Vec<f32>) -> &'a [f32] {
        match self {
            Self::Plain | Self::Dueling => estimates,
            Self::Quantile { quantiles } => {
                quantile_dqn::means(estimates, quantiles, to);
                to
            }
        }
    }

    /// The loss of the estimates of one action towards as many targets; writes ∂L/∂estimates.
    pub(crate) fn loss(self, estimates: &[f32], targets: &[f32], delta: f32, gradient: &mut [f32]) -> f32 {
        match self {
            Self::Plain | Self::Dueling => {
                let error = estimates[0] - targets[0];
                gradient[0] = clip(error, delta);
                huber(error, delta)
            }
            Self::Quantile { .. } => quantile_dqn::loss(estimates, targets, delta, gradient),
        }
    }
}

/// The estimates of all actions by one head for one observation.
#[derive(Clone, Copy)]
pub(crate) struct Estimates<'a> {
    values: &'a [f32],
    per_action: usize,
}

impl<'a> Estimates<'a> {
    /// `values`: A × `per_action`, or nothing.
    pub(crate) fn new(values: &'a [f32], per_action: usize) -> Self {
        Self { values, per_action }
    }

    /// The estimates of one action.
    pub(crate) fn of(self, action: usize) -> &'a [f32] {
        &self.values[action * self.per_action..(action + 1) * self.per_action]
    }

    /// The allowed action of the largest Q, the lowest index of equals; 0 if nothing is allowed.
    pub(crate) fn best(self, allowed: u32) -> usize {
        best_allowed(self.values.chunks_exact(self.per_action).map(quantile_dqn::mean), allowed)
    }
}

/// The allowed action of the largest value, the lowest index of equals; 0 if nothing is allowed.
pub(crate) fn best_allowed(values: impl IntoIterator<Item = f32>, allowed: u32) -> usize {
    let mut best: Option<(usize, f32)> = None;
    for (action, value) in values.into_iter().enumerate() {
        if allowed >> action & 1 == 1 && best.is_none_or(|(_, largest)| value > largest) {
            best = Some((action, value));
        }
    }
    best.map_or(0, |(action, _)| action)
}

#[cfg(test)]
mod tests {
    use super::{Estimates, best_allowed};

    #[test]
    fn ties_go_to_the_lowest_index() {
        assert_eq!(best_allowed([1.0, 2.0, 2.0], 0b111), 1);
        assert_eq!(best_allowed([1.0, 2.0, 2.0], 0b101), 2);
    }

    #[test]
    fn the_best_action_is_that_of_the_largest_mean() {
        // Action 0 has the largest estimate, action 2 the largest mean.
        let estimates = Estimates::new(&[9.0, -9.0, 1.0, 1.0, 4.0, 0.0], 2);
        assert_eq!((estimates.best(0b111), estimates.best(0b011)), (2, 1));
        assert_eq!(estimates.of(2), [4.0, 0.0]);
    }
}
