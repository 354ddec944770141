//! The car: parameters (Table I), tires, actuators, the controllers' linear model and the plant that stands for the
//! truth.

mod actuator;
pub mod bicycle;
mod car;
#[cfg(test)]
mod commonroad;
mod options;
mod params;
mod plant;
mod state;
#[cfg(test)]
mod tests;
pub mod tire;
#[cfg(test)]
mod validity;

pub(crate) use actuator::{lag_response, lagged};
pub use car::{ExternalPlant, Plant, SingleTrack};
pub use options::{LoadTransfer, PlantConfig};
pub use params::{MAX_DELAY_S, TireModel, VehicleParams, VehiclePreset};
pub use plant::{Contact, step, step_with};
pub use state::{ControlInput, VehicleState};
