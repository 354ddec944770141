//! The section `[plant]`: how the true car and its surroundings differ from what the controllers' model knows.

use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_range};
use crate::vehicle::VehicleParams;
use crate::vehicle::tire::GRAVITY_MPS2;

/// Density of air, kg/m³ (15 °C at sea level).
const AIR_DENSITY_KGPM3: f64 = 1.225;

/// How the axle loads follow the acceleration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LoadTransfer {
    /// Not at all, as in the paper.
    Static,
    /// At once: braking loads the front axle by M a h / L and unloads the rear one; stiffness goes with the load.
    QuasiStatic,
}

/// What the plant has and the controllers' model has not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlantConfig {
    /// Axle loads under braking and driving.
    pub load_transfer: LoadTransfer,
    /// Height of the center of gravity h, m.
    pub gravity_center_height_m: f64,
    /// Whether braking and driving use up grip that cornering then lacks (friction ellipse). The paper's forces are
    /// independent.
    pub combined_grip: bool,
    /// Mass and yaw inertia over those the controllers know. Commands are forces for the known mass, so a heavier car
    /// answers less.
    pub mass_factor: f64,
    /// Side wind, m/s, positive towards the left. The paper has none.
    pub wind_mps: f64,
    /// Amplitude of the gusts on top of it, m/s: a sine in time.
    pub gust_mps: f64,
    /// Period of the gusts, s.
    pub gust_period_s: f64,
    /// Side area times side-force coefficient, m².
    pub wind_area_m2: f64,
    /// How far ahead of the center of gravity the wind's force acts, m.
    pub wind_lever_m: f64,
}

impl Default for PlantConfig {
    fn default() -> Self {
        Self {
            load_transfer: LoadTransfer::Static,
            gravity_center_height_m: 0.54,
            combined_grip: false,
            mass_factor: 1.0,
            wind_mps: 0.0,
            gust_mps: 0.0,
            gust_period_s: 4.0,
            wind_area_m2: 4.0,
            wind_lever_m: 0.3,
        }
    }
}

impl PlantConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("plant.gravity_center_height_m", self.gravity_center_height_m, 0.0, 1.0)?;
        check_range("plant.mass_factor", self.mass_factor, 0.8, 1.2)?;
        check_range("plant.wind_mps", self.wind_mps, -30.0, 30.0)?;
        check_range("plant.gust_mps", self.gust_mps, 0.0, 20.0)?;
        check_range("plant.gust_period_s", self.gust_period_s, 0.5, 60.0)?;
        check_range("plant.wind_area_m2", self.wind_area_m2, 0.0, 30.0)?;
        check_range("plant.wind_lever_m", self.wind_lever_m, -2.0, 2.0)
    }

    /// Side wind at `time_s`, m/s.
    pub fn wind_mps_at(&self, time_s: f64) -> f64 {
        if self.gust_mps == 0.0 {
            return self.wind_mps;
        }
        self.wind_mps + self.gust_mps * libm::sin(core::f64::consts::TAU * time_s / self.gust_period_s)
    }

    /// Force to the left, N, and moment about the vertical axis, N m, on a car at this speed: ½ ρ A w √(V² + w²), the
    /// component across the car of a force along the flow.
    pub fn wind_load(&self, speed_mps: f64, time_s: f64) -> (f64, f64) {
        let wind_mps = self.wind_mps_at(time_s);
        if wind_mps == 0.0 {
            return (0.0, 0.0);
        }
        let flow_mps = (speed_mps * speed_mps + wind_mps * wind_mps).sqrt();
        let force_n = 0.5 * AIR_DENSITY_KGPM3 * self.wind_area_m2 * wind_mps * flow_mps;
        (force_n, force_n * self.wind_lever_m)
    }

    /// Vertical loads of the front and the rear axle, N, while the tires accelerate the car by `accel_mps2`: static
    /// ones, and M a h / L from the front to the rear.
    pub fn axle_loads_n(&self, params: &VehicleParams, accel_mps2: f64) -> (f64, f64) {
        let scale = self.mass_factor * params.mass_kg / params.wheelbase_m();
        let (front_n, rear_n) = (scale * GRAVITY_MPS2 * params.rear_axle_m, scale * GRAVITY_MPS2 * params.front_axle_m);
        match self.load_transfer {
            LoadTransfer::Static => (front_n, rear_n),
            LoadTransfer::QuasiStatic => {
                let moved_n = scale * accel_mps2 * self.gravity_center_height_m;
                (front_n - moved_n, rear_n + moved_n)
            }
        }
    }
}
