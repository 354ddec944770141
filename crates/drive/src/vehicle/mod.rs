//! The car: parameters (Table I), tires, actuators, the controllers' linear model and the plant that stands for the truth.

mod params;
mod state;

pub use params::{TireModel, VehicleParams, VehiclePreset};
pub use state::{ControlInput, VehicleState};
