//! Small neural networks with hand-written backward passes and reproducible bits.

pub mod random;
