//! A ring of transitions in flat arrays, one for each field.

use crate::Transition;

/// The last `capacity` transitions, uniformly sampled by the learner (Mnih et al., 2015).
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayBuffer {
    pub(crate) capacity: usize,
    pub(crate) inputs: usize,
    pub(crate) actions: usize,
    /// Transitions ever pushed; the next one goes to this number modulo the capacity.
    pub(crate) pushed: u64,
    pub(crate) fields: Fields,
}

/// The arrays: observations are length × inputs row-major, all others have one value for each transition.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Fields {
    pub(crate) observation: Vec<f32>,
    pub(crate) next_observation: Vec<f32>,
    pub(crate) action: Vec<u32>,
    pub(crate) reward: Vec<f32>,
    pub(crate) discount: Vec<f32>,
    pub(crate) next_action_mask: Vec<u32>,
    pub(crate) bootstrap_mask: Vec<u32>,
}

/// A transition that cannot be learned from.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// An observation of the wrong length.
    #[error("`{field}` has {found} numbers, but must have {expected}")]
    Length {
        /// Which observation.
        field: &'static str,
        /// Length required.
        expected: usize,
        /// Length found.
        found: usize,
    },
    /// A number that is infinite or not a number.
    #[error("`{field}` holds {value}, but must be finite")]
    NotFinite {
        /// Which field.
        field: &'static str,
        /// The value found.
        value: f32,
    },
    /// A discount outside 0..=1.
    #[error("`discount` is {value}, but must be in 0..=1")]
    Discount {
        /// The value found.
        value: f32,
    },
    /// An action there is not.
    #[error("`action` is {found}, but must be below {actions}")]
    Action {
        /// The action found.
        found: usize,
        /// Number of actions.
        actions: usize,
    },
    /// The episode goes on, but no action is allowed next.
    #[error("`next_action_mask` {mask:#b} allows none of the {actions} actions, but the episode has not terminated")]
    NothingAllowed {
        /// The mask found.
        mask: u32,
        /// Number of actions.
        actions: usize,
    },
}

impl ReplayBuffer {
    /// An empty buffer of `capacity` transitions (at least 1) with observations of `inputs` numbers and `actions` actions.
    pub fn new(capacity: usize, inputs: usize, actions: usize) -> Self {
        Self { capacity: capacity.max(1), inputs, actions, pushed: 0, fields: Fields::default() }
    }

    /// Number of transitions held.
    pub fn len(&self) -> usize {
        self.fields.action.len()
    }

    /// Whether nothing was pushed yet.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Transitions ever pushed, those overwritten included; the index of the next one.
    pub fn pushed(&self) -> u64 {
        self.pushed
    }

    /// The largest number of transitions held.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Adds a transition, in place of the oldest when full.
    pub fn push(&mut self, transition: &Transition) -> Result<(), ReplayError> {
        self.check(transition)?;
        let slot = (self.pushed % self.capacity as u64) as usize;
        let fields = &mut self.fields;
        write(&mut fields.observation, slot, &transition.observation);
        write(&mut fields.next_observation, slot, &transition.next_observation);
        write(&mut fields.action, slot, &[transition.action as u32]);
        write(&mut fields.reward, slot, &[transition.reward]);
        write(&mut fields.discount, slot, &[transition.discount]);
        write(&mut fields.next_action_mask, slot, &[transition.next_action_mask]);
        write(&mut fields.bootstrap_mask, slot, &[transition.bootstrap_mask]);
        self.pushed += 1;
        Ok(())
    }

    /// The transition in a slot.
    pub fn get(&self, slot: usize) -> Option<Transition> {
        if slot >= self.len() {
            return None;
        }
        let (fields, row) = (&self.fields, slot * self.inputs..(slot + 1) * self.inputs);
        Some(Transition {
            observation: fields.observation[row.clone()].to_vec(),
            action: fields.action[slot] as usize,
            reward: fields.reward[slot],
            discount: fields.discount[slot],
            next_observation: fields.next_observation[row].to_vec(),
            next_action_mask: fields.next_action_mask[slot],
            bootstrap_mask: fields.bootstrap_mask[slot],
        })
    }

    /// Checks what [`Self::push`] requires of every transition.
    pub(crate) fn check(&self, transition: &Transition) -> Result<(), ReplayError> {
        check_observation("observation", &transition.observation, self.inputs)?;
        check_observation("next_observation", &transition.next_observation, self.inputs)?;
        if transition.action >= self.actions {
            return Err(ReplayError::Action { found: transition.action, actions: self.actions });
        }
        if !transition.reward.is_finite() {
            return Err(ReplayError::NotFinite { field: "reward", value: transition.reward });
        }
        if !(0.0..=1.0).contains(&transition.discount) {
            return Err(ReplayError::Discount { value: transition.discount });
        }
        let mask = transition.next_action_mask;
        if transition.discount > 0.0 && mask & all_actions(self.actions) == 0 {
            return Err(ReplayError::NothingAllowed { mask, actions: self.actions });
        }
        Ok(())
    }
}

/// The mask that allows all of `actions` actions.
pub(crate) fn all_actions(actions: usize) -> u32 {
    if actions >= 32 { u32::MAX } else { (1 << actions) - 1 }
}

fn check_observation(field: &'static str, values: &[f32], expected: usize) -> Result<(), ReplayError> {
    if values.len() != expected {
        return Err(ReplayError::Length { field, expected, found: values.len() });
    }
    match values.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(ReplayError::NotFinite { field, value: *value }),
        None => Ok(()),
    }
}

/// Writes the row `slot`, which is an existing one or the next new one.
fn write<T: Copy>(array: &mut Vec<T>, slot: usize, row: &[T]) {
    let start = slot * row.len();
    if start == array.len() {
        array.extend_from_slice(row);
    } else {
        array[start..start + row.len()].copy_from_slice(row);
    }
}

#[cfg(test)]
mod tests {
    use super::{ReplayBuffer, ReplayError};
    use crate::Transition;

    fn transition(value: f32) -> Transition {
        Transition {
            observation: vec![value, 1.0],
            action: 1,
            reward: value,
            discount: 0.9,
            next_observation: vec![-value, 2.0],
            next_action_mask: 0b101,
            bootstrap_mask: 0b11,
        }
    }

    #[test]
    fn the_oldest_is_overwritten_and_the_rest_returns_unchanged() {
        let mut replay = ReplayBuffer::new(3, 2, 3);
        for value in [0.0, 1.0, 2.0, 3.0] {
            replay.push(&transition(value)).unwrap();
        }
        assert_eq!((replay.len(), replay.pushed()), (3, 4));
        for (slot, value) in [(0, 3.0), (1, 1.0), (2, 2.0)] {
            assert_eq!(replay.get(slot).unwrap(), transition(value));
        }
        assert!(replay.get(3).is_none());
    }

    #[test]
    fn what_cannot_be_learned_from_is_refused_and_leaves_the_buffer_alone() {
        type Change = fn(&mut Transition);
        let cases: [Change; 7] = [
            |t| t.observation = vec![1.0],
            |t| t.next_observation[1] = f32::NAN,
            |t| t.action = 3,
            |t| t.reward = f32::INFINITY,
            |t| t.discount = f32::NAN,
            |t| t.discount = 1.5,
            |t| t.next_action_mask = 0b1000,
        ];
        let mut replay = ReplayBuffer::new(3, 2, 3);
        for change in cases {
            let mut bad = transition(1.0);
            change(&mut bad);
            assert!(replay.push(&bad).is_err(), "{bad:?}");
        }
        assert!(replay.is_empty());
        let end = Transition { next_action_mask: 0, discount: 0.0, ..transition(1.0) };
        replay.push(&end).unwrap();
        let cut = Transition { next_action_mask: 0, ..transition(1.0) };
        assert_eq!(replay.push(&cut), Err(ReplayError::NothingAllowed { mask: 0, actions: 3 }));
    }
}
