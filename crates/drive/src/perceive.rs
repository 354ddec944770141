//! What the ego car perceives of the world.
