//! Highway traffic, the car and its driver: the method itself.
//!
//! The modules follow the method; each may use only those before it (a test of the workspace holds the order):
//! `config, snapshot, road, vehicle, models, scene`, then on one side `traffic, perceive` (the world and what is seen of it), on the other
//! `predict, plan, control, decide, driver` (the ego car's mind, which never sees the world itself), and `env`, the closed loop. `kinematic` is
//! the traffic with a simple ego car, for speed.

pub mod config;
pub mod control;
pub mod decide;
pub mod driver;
pub mod env;
pub mod kinematic;
pub mod models;
pub mod perceive;
pub mod plan;
pub mod predict;
pub mod road;
pub mod scenario;
pub mod scene;
pub mod snapshot;
pub mod traffic;
pub mod vehicle;
