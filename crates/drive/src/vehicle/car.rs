//! Plants: the car that the driver drives, with what it carries between two steps.

use core::fmt;

use serde::{Deserialize, Serialize};

use crate::vehicle::plant::{self, Contact};
use crate::vehicle::{ControlInput, PlantConfig, VehicleParams, VehicleState};

/// A user's own model of the car, for example an imported co-simulation unit: the one escape from the built-in plant.
///
/// A step must depend on nothing but what it is given and what the model holds, and [`Self::clone_box`] must copy all
/// that it holds: a clone is a snapshot, which goes on with the same bits.
pub trait ExternalPlant: Send + Sync {
    /// The car `dt_s` later, with `input` held.
    ///
    /// `state` is what the step before returned (at first: where the car is placed), with `s_m` brought back onto the
    /// ring. Positions are in the road frame, and `contact` says how the road bends there. The speed must not be
    /// negative; numbers that are not finite are for the guard to find.
    fn step(&mut self, state: &VehicleState, input: &ControlInput, contact: &Contact, dt_s: f64) -> VehicleState;

    /// A copy with all its state.
    fn clone_box(&self) -> Box<dyn ExternalPlant>;
}

/// The car's dynamics. A clone is a snapshot.
#[expect(clippy::large_enum_variant, reason = "there is one in an environment, and the large one is the usual one")]
#[derive(Serialize, Deserialize)]
pub enum Plant {
    /// The built-in single-track model.
    SingleTrack(SingleTrack),
    /// A user's own, which cannot be stored.
    #[serde(skip)]
    External(Box<dyn ExternalPlant>),
}

impl Plant {
    /// The car `dt_s` later, with `input` held; see [`ExternalPlant::step`].
    pub fn step(&mut self, state: &VehicleState, input: &ControlInput, contact: &Contact, dt_s: f64) -> VehicleState {
        match self {
            Self::SingleTrack(car) => car.step(state, input, contact, dt_s),
            Self::External(car) => car.step(state, input, contact, dt_s),
        }
    }

    /// Commands still under way, steering then drive, oldest first; nothing for an external plant.
    pub fn commands_under_way(&self) -> impl Iterator<Item = f64> {
        let car = match self {
            Self::SingleTrack(car) => Some(car),
            Self::External(_) => None,
        };
        car.into_iter().flat_map(|car| car.steer.waiting().chain(car.drive.waiting()))
    }
}

impl Clone for Plant {
    fn clone(&self) -> Self {
        match self {
            Self::SingleTrack(car) => Self::SingleTrack(car.clone()),
            Self::External(car) => Self::External(car.clone_box()),
        }
    }
}

impl fmt::Debug for Plant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SingleTrack(car) => f.debug_tuple("SingleTrack").field(car).finish(),
            Self::External(_) => f.write_str("External"),
        }
    }
}

/// The built-in plant: the single-track model behind its actuators' delays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SingleTrack {
    params: VehicleParams,
    options: PlantConfig,
    steer: DelayLine,
    drive: DelayLine,
}

impl SingleTrack {
    /// A car at rest, in its delays too. Both parts must be valid; delays are rounded to whole steps of `plant_period_s`.
    pub fn new(params: &VehicleParams, options: &PlantConfig, plant_period_s: f64) -> Self {
        Self {
            params: params.clone(),
            options: options.clone(),
            steer: DelayLine::new(params.steer_delay_s, plant_period_s),
            drive: DelayLine::new(params.drive_delay_s, plant_period_s),
        }
    }

    fn step(&mut self, state: &VehicleState, input: &ControlInput, contact: &Contact, dt_s: f64) -> VehicleState {
        let input =
            ControlInput { accel_mps2: self.drive.pass(input.accel_mps2), steer_rad: self.steer.pass(input.steer_rad) };
        plant::step_with(&self.params, &self.options, state, &input, contact, dt_s)
    }
}

/// A pure delay by a fixed number of steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct DelayLine {
    /// A ring of commands; `oldest` is the next to come out.
    commands: Vec<f64>,
    oldest: usize,
}

impl DelayLine {
    fn new(delay_s: f64, step_s: f64) -> Self {
        Self { commands: vec![0.0; (delay_s / step_s).round() as usize], oldest: 0 }
    }

    /// Puts `command` in and gives what comes out.
    fn pass(&mut self, command: f64) -> f64 {
        let Some(slot) = self.commands.get_mut(self.oldest) else { return command };
        let out = core::mem::replace(slot, command);
        self.oldest = (self.oldest + 1) % self.commands.len();
        out
    }

    fn waiting(&self) -> impl Iterator<Item = f64> {
        self.commands[self.oldest..].iter().chain(&self.commands[..self.oldest]).copied()
    }
}
