//! Scripted closed-loop maneuvers: the controllers and the guard on the plant, with single scripted cars around them.
//!
//! A [`Maneuver`] is data: a start, scripts for the ego car and the others, a duration and named [`Check`]s. [`Maneuver::run`]
//! drives it once, without chance and without a second try, and [`Check::verdict`] compares what was measured with its bounds.

pub(crate) mod car;
mod catalogue;
pub(crate) mod measure;
mod runner;

pub use car::{CarScript, LaneMove, LateralShape, Phase};
pub use catalogue::catalogue;
pub use measure::{Check, Gate, Measure, Verdict};
pub use runner::{LateralLaw, Run, Sample, SpeedLaw, Stack};

use lanecraft_drive::config::ConfigError;
use lanecraft_drive::control::ControlConfig;
use lanecraft_drive::road::{RoadConfig, Topology};
use lanecraft_drive::vehicle::{PlantConfig, VehicleParams};
use serde::Serialize;

/// A lane change of the ego's reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// When it begins, s; not before the end of the one before.
    pub at_s: f64,
    /// How long it takes, s.
    pub duration_s: f64,
    /// Lateral position at its end, m.
    pub d_m: f64,
}

/// How the ego is steered.
#[derive(Clone, Debug, PartialEq)]
pub enum Steering {
    /// By the lateral controller along quintics, at the first position before and between them.
    Legs(Vec<Leg>),
    /// Open loop: nothing, then this road-wheel angle from `at_s` on.
    Step {
        /// When, s.
        at_s: f64,
        /// How far, rad.
        steer_rad: f64,
    },
    /// Open loop: one sine whose second peak is held (FMVSS 126).
    SineWithDwell {
        /// When it begins, s.
        at_s: f64,
        /// Peak, rad.
        steer_rad: f64,
        /// Frequency, Hz.
        frequency_hz: f64,
        /// How long the second peak is held, s.
        dwell_s: f64,
    },
}

/// What the ego is to do.
#[derive(Clone, Debug, PartialEq)]
pub struct EgoScript {
    /// Speed at the start, m/s.
    pub speed_mps: f64,
    /// Lateral position at the start, m.
    pub d_m: f64,
    /// Heading at the start, relative to the road, rad.
    pub heading_rad: f64,
    /// Yaw rate at the start, rad/s.
    pub yaw_rate_radps: f64,
    /// Speed to hold, m/s.
    pub target_speed_mps: f64,
    /// a_ref, m/s².
    pub reference_accel_mps2: f64,
    /// q_1, 1/s².
    pub speed_ratio: f64,
    /// q_2.
    pub path_ratio: f64,
    /// Lateral position to hold before the first leg, m.
    pub reference_d_m: f64,
    /// Steering.
    pub steering: Steering,
}

impl EgoScript {
    /// Holds its lane and this speed, with the action set's middle weights.
    pub fn hold(speed_mps: f64) -> Self {
        Self {
            speed_mps,
            d_m: 0.0,
            heading_rad: 0.0,
            yaw_rate_radps: 0.0,
            target_speed_mps: speed_mps,
            reference_accel_mps2: 0.0,
            speed_ratio: 0.025,
            path_ratio: 1e-3,
            reference_d_m: 0.0,
            steering: Steering::Legs(Vec::new()),
        }
    }

    /// The same along these legs.
    pub fn along(speed_mps: f64, legs: Vec<Leg>) -> Self {
        Self { steering: Steering::Legs(legs), ..Self::hold(speed_mps) }
    }
}

/// One scripted drive.
#[derive(Clone, Debug)]
pub struct Maneuver {
    /// Its name on the command line.
    pub name: String,
    /// What happens, and where it is from.
    pub about: String,
    /// The road.
    pub road: RoadConfig,
    /// The car as it is.
    pub plant: VehicleParams,
    /// Its surroundings, and what the controllers do not know of it.
    pub options: PlantConfig,
    /// The car as the controllers believe it to be.
    pub model: VehicleParams,
    /// The controllers.
    pub control: ControlConfig,
    /// The ego's script.
    pub ego: EgoScript,
    /// The other cars.
    pub cars: Vec<CarScript>,
    /// How long it lasts, s.
    pub duration_s: f64,
    /// What is asked of it.
    pub checks: Vec<Check>,
}

impl Maneuver {
    /// A maneuver of the default car on a dry straight road with two lanes, without other cars.
    pub fn new(name: impl Into<String>, about: impl Into<String>, ego: EgoScript, duration_s: f64) -> Self {
        let plant = VehicleParams::default();
        Self {
            name: name.into(),
            about: about.into(),
            road: RoadConfig { lanes: 2, topology: Topology::Open, ..RoadConfig::default() },
            model: plant.clone(),
            plant,
            options: PlantConfig::default(),
            control: ControlConfig::default(),
            ego,
            cars: Vec::new(),
            duration_s,
            checks: Vec::new(),
        }
    }

    /// The same with these cars.
    #[must_use]
    pub fn with_cars(mut self, cars: Vec<CarScript>) -> Self {
        self.cars = cars;
        self
    }

    /// The same on a road of this adhesion, which the controllers know.
    #[must_use]
    pub fn on_adhesion(mut self, adhesion: f64) -> Self {
        self.road.adhesion = adhesion;
        self
    }

    /// The same with these checks as well.
    #[must_use]
    pub fn checked(mut self, checks: impl IntoIterator<Item = Check>) -> Self {
        self.checks.extend(checks);
        self
    }

    /// Drives it with these controllers.
    pub fn run(&self, stack: Stack) -> Result<Run, ConfigError> {
        runner::run(self, stack)
    }

    /// Drives it and judges every check.
    pub fn judge(&self, stack: Stack) -> Result<Outcome, ConfigError> {
        let run = self.run(stack)?;
        let verdicts = self.checks.iter().map(|check| check.verdict(&run)).collect();
        Ok(Outcome { maneuver: self.name.clone(), about: self.about.clone(), verdicts })
    }
}

/// A maneuver's verdicts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// Name of the maneuver.
    pub maneuver: String,
    /// What happens in it.
    pub about: String,
    /// One for each check.
    pub verdicts: Vec<Verdict>,
}

impl Outcome {
    /// Whether every check passes but those that state a known shortfall.
    pub fn passed(&self) -> bool {
        self.verdicts.iter().all(|verdict| verdict.passed || !verdict.shortfall.is_empty())
    }
}
