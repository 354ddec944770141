//! One decision and what came of it, in the form learners use.
//!
//! An action may last several ticks (an option, Sutton, Precup and Singh, 1999). With k ticks and rewards `r_1 … r_k` its
//! return is `R = Σ γ^(j-1) r_j`, and the value of the state after it counts γᵏ times. An episode that ends (`terminated`)
//! has no value after it, so its discount is 0; one that is only cut off by a time limit keeps γᵏ.

use crate::LearnerConfig;

/// One decision: what was seen, done and received, and what was seen next.
#[derive(Clone, Debug, PartialEq)]
pub struct Transition {
    /// Observation before the action.
    pub observation: Vec<f32>,
    /// Index of the action.
    pub action: usize,
    /// Discounted sum of the rewards until the next decision, scaled by `reward_scale`.
    pub reward: f32,
    /// γᵏ after k ticks; 0 if the episode terminated.
    pub discount: f32,
    /// Observation at the next decision.
    pub next_observation: Vec<f32>,
    /// Actions allowed at the next decision, action 0 in the lowest bit; may be 0 only if the episode terminated.
    pub next_action_mask: u32,
    /// Heads that learn from this transition, head 0 in the lowest bit.
    pub bootstrap_mask: u32,
}

/// Collects the ticks of one action into a [`Transition`].
#[derive(Clone, Debug, PartialEq)]
pub struct OptionAccumulator {
    observation: Vec<f32>,
    action: usize,
    tick_discount: f64,
    reward_scale: f64,
    reward: f64,
    discount: f64,
}

impl OptionAccumulator {
    /// Begins with the observation and the action of a decision.
    pub fn start(observation: Vec<f32>, action: usize, config: &LearnerConfig) -> Self {
        let (tick_discount, reward_scale) = (config.discount, config.reward_scale);
        Self { observation, action, tick_discount, reward_scale, reward: 0.0, discount: 1.0 }
    }

    /// Adds the reward of the next tick, as the environment gave it.
    pub fn tick(&mut self, reward: f64) {
        self.reward += self.discount * reward;
        self.discount *= self.tick_discount;
    }

    /// The transition to the next decision. `terminated` says that the episode ended by itself, not by a time limit.
    pub fn finish(
        self,
        next_observation: Vec<f32>,
        next_action_mask: u32,
        terminated: bool,
        bootstrap_mask: u32,
    ) -> Transition {
        Transition {
            observation: self.observation,
            action: self.action,
            reward: (self.reward_scale * self.reward) as f32,
            discount: if terminated { 0.0 } else { self.discount as f32 },
            next_observation,
            next_action_mask,
            bootstrap_mask,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::OptionAccumulator;
    use crate::LearnerConfig;

    #[test]
    fn three_ticks_give_the_discounted_sum_and_the_third_power() {
        let config = LearnerConfig { discount: 0.5, reward_scale: 0.1, ..LearnerConfig::default() };
        let mut option = OptionAccumulator::start(vec![1.0], 4, &config);
        for reward in [8.0, 4.0, 2.0] {
            option.tick(reward);
        }
        // 8 + 4/2 + 2/4 = 10.5, scaled by 0.1; 0.5³ = 0.125.
        let cut = option.clone().finish(vec![2.0], 0b1, false, 0b11);
        assert!((cut.reward - 1.05).abs() < 1e-6);
        assert_eq!((cut.action, cut.discount, cut.next_action_mask, cut.bootstrap_mask), (4, 0.125, 1, 3));
        assert_eq!(option.finish(vec![2.0], 0, true, 0).discount, 0.0);
    }
}
