//! The world: vehicles, their collisions, and an externally driven ego.
//!
//! Human drivers follow IDM and MOBIL and are safe by construction: over IDM lies a cap that keeps every distance safe
//! ([`crate::models::safe_distance`]), and a lane change starts only if it leaves all distances safe. A vehicle that changes lane
//! occupies both lanes from start to end, so that two that swap lanes never lose sight of each other. Among human drivers
//! therefore nobody ever touches anybody, whatever the ego does: its presence adds a leader but never hides one. The end of a lane is a
//! leader, too.
//!
//! Vehicles stand in memory in the order of the road. A step is a few passes over them: those whose turn it is choose lanes, one
//! sweep finds everybody's leaders, all follow at once, all move at once, the order is restored, and neighbors are held against each
//! other.

mod collision;
mod command;
mod digest;
mod fleet;
mod flow;
mod following;
mod lane_choice;
mod mandatory;
mod motion;
mod neighbors;
mod overlaps;
mod placement;
mod recorded;
mod script;
mod snapshot;
mod world;

pub use collision::{Collision, FaultClass};
pub use command::{Command, TrackPoint};
pub use fleet::Vehicle;
pub use following::Obstacle;
pub use world::{ExternalBody, StepEvents, World};
