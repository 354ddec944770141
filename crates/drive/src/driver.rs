//! What the ego car carries from one step to the next.
