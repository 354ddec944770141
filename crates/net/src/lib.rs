//! Small neural networks with hand-written backward passes and reproducible bits.
//!
//! Every result is the same bits at any batch size and on any processor: sums run in one fixed order, no multiplication
//! is fused with an addition, and vector lanes hold independent outputs only.
//!
//! ```
//! use lanecraft_net::{Ensemble, NetShape, Workspace, random::Stream};
//!
//! let shape = NetShape { inputs: 4, core: vec![16], head: vec![8], outputs: 3, heads: 6 };
//! let network = Ensemble::new(shape, &mut Stream::new(1, "example"))?;
//! let mut workspace = Workspace::new(&network, 1);
//! let q = network.forward(&[0.1, -0.2, 0.3, 0.0], &mut workspace);
//! assert_eq!(q.len(), 6 * 3);
//! # Ok::<(), lanecraft_net::ShapeError>(())
//! ```

mod activation;
mod adam;
mod ensemble;
mod kernel;
mod lstm;
pub mod protobuf;
pub mod random;
mod shape;
pub mod tensors;

pub use adam::Adam;
pub use ensemble::{Ensemble, Workspace};
pub use lstm::{Lstm, LstmShape, LstmWorkspace};
pub use shape::{NetShape, ShapeError, TensorSlot};
