//! Returns over several decisions (Sutton, 1988; with deep Q-learning, Hessel et al., 2018).
//!
//! With n decisions from the present one on, of rewards `R_1 … R_n` and discounts `Γ_1 … Γ_n` (γ to the number of ticks of each, or
//! 0 at the end), the return is `R = Σ Γ_1 … Γ_(i-1) R_i`, and the value of the state after the n-th counts `Γ_1 … Γ_n` times. So an
//! n-step return is a [`Transition`] like any other, and no learner knows the difference.
//!
//! Nothing corrects for later actions that the policy of today would not take: returns are those of the behavior, as by Hessel
//! et al. At the end of an episode those that wait are given out with the decisions there were.

use std::collections::VecDeque;

use crate::Transition;

/// The decisions of one episode that still wait for later ones.
#[derive(Clone, Debug, PartialEq)]
pub struct NStepQueue {
    decisions: usize,
    waiting: VecDeque<Transition>,
}

impl NStepQueue {
    /// An empty queue for returns over `decisions` (at least 1).
    pub fn new(decisions: usize) -> Self {
        Self { decisions: decisions.max(1), waiting: VecDeque::with_capacity(decisions) }
    }

    /// Takes the next transition of the episode and returns what it completes, in the order of the decisions: one transition when
    /// there were enough before it, all of them when it terminates the episode.
    pub fn push(&mut self, transition: Transition) -> Vec<Transition> {
        let terminated = transition.discount == 0.0;
        for waiting in &mut self.waiting {
            waiting.reward += waiting.discount * transition.reward;
            waiting.discount *= transition.discount;
            waiting.next_observation.clone_from(&transition.next_observation);
            waiting.next_action_mask = transition.next_action_mask;
        }
        self.waiting.push_back(transition);
        if terminated {
            return self.flush();
        }
        let complete = usize::from(self.waiting.len() == self.decisions);
        self.waiting.drain(..complete).collect()
    }

    /// What still waits when an episode is cut off: returns over fewer decisions, which end in the last state known.
    pub fn flush(&mut self) -> Vec<Transition> {
        self.waiting.drain(..).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::NStepQueue;
    use crate::Transition;

    fn transition(number: usize, reward: f32, discount: f32) -> Transition {
        Transition {
            observation: vec![number as f32],
            action: number,
            reward,
            discount,
            next_observation: vec![number as f32 + 1.0],
            next_action_mask: 1 << number,
            bootstrap_mask: 0,
        }
    }

    /// What tells a return: first decision, sum, discount, state after it.
    fn returns(found: &[Transition]) -> Vec<(usize, f32, f32, f32, u32)> {
        let told = |t: &Transition| (t.action, t.reward, t.discount, t.next_observation[0], t.next_action_mask);
        found.iter().map(told).collect()
    }

    #[test]
    fn one_decision_passes_through_unchanged() {
        let mut queue = NStepQueue::new(1);
        for (number, discount) in [(0, 0.5), (1, 0.25), (2, 0.0)] {
            let own = transition(number, 3.0, discount);
            assert_eq!(queue.push(own.clone()), [own]);
        }
        assert_eq!(queue.flush(), []);
    }

    #[test]
    fn three_decisions_sum_to_the_return_worked_out_by_hand() {
        let mut queue = NStepQueue::new(3);
        assert_eq!(queue.push(transition(0, 1.0, 0.5)), []);
        // A decision of two ticks.
        assert_eq!(queue.push(transition(1, 2.0, 0.25)), []);
        // 1 + 0.5·2 + 0.125·4 = 2.5; 0.5·0.25·0.5 = 0.0625.
        assert_eq!(returns(&queue.push(transition(2, 4.0, 0.5))), [(0, 2.5, 0.0625, 3.0, 0b100)]);
        // 2 + 0.25·4 + 0.125·8 = 4.
        assert_eq!(returns(&queue.push(transition(3, 8.0, 0.5))), [(1, 4.0, 0.0625, 4.0, 0b1000)]);
        // The end of the time: 4 + 0.5·8 = 8 over two decisions, 8 over one.
        assert_eq!(returns(&queue.flush()), [(2, 8.0, 0.25, 4.0, 0b1000), (3, 8.0, 0.5, 4.0, 0b1000)]);
    }

    #[test]
    fn a_terminated_episode_has_no_value_after_any_of_its_decisions() {
        let mut queue = NStepQueue::new(3);
        queue.push(transition(0, 1.0, 0.5));
        let found = queue.push(transition(1, -4.0, 0.0));
        assert_eq!(returns(&found), [(0, -1.0, 0.0, 2.0, 0b10), (1, -4.0, 0.0, 2.0, 0b10)]);
        // The next episode begins anew.
        assert_eq!(queue.push(transition(2, 7.0, 0.5)), []);
    }
}
