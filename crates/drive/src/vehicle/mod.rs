//! The car: parameters (Table I), tires, actuators, the controllers' linear model and the plant that stands for the
//! truth.

mod actuator;
pub mod bicycle;
mod params;
mod plant;
mod state;
#[cfg(test)]
mod tests;
pub mod tire;

pub(crate) use actuator::lag_response;
pub use params::{TireModel, VehicleParams, VehiclePreset};
pub use plant::{Contact, step};
pub use state::{ControlInput, VehicleState};
