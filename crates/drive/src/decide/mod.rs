//! Decisions: actions, observations, rewards and what is allowed.
