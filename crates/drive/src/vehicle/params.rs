//! The ego car's parameters (Table I) and their presets.

use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_range};

/// Longest pure delay of an actuator, s.
pub const MAX_DELAY_S: f64 = 0.5;

/// How lateral tire force follows from slip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TireModel {
    /// F = −2 K α (Eq. 3 with the restoring sign).
    Linear,
    /// Linear up to half of μ F_z, then bending towards it (Dugoff, Fancher and Segel, 1970, without longitudinal slip).
    Dugoff,
    /// The magic formula (Pacejka), with the linear model's slope at the origin and μ F_z as its peak.
    Pacejka,
}

/// Named sets of parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VehiclePreset {
    /// Table I as printed, with its yaw inertia of 606.1 kg m².
    Paper,
    /// The same hatchback with a plausible yaw inertia.
    CClass,
}

/// Parameters of the car, the same in the plant and in the controllers' model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VehicleParams {
    /// Mass M, kg (Table I).
    pub mass_kg: f64,
    /// Yaw inertia J_z, kg m². Table I prints 606.1, which has the size of a roll inertia; 1536.7 is that of public
    /// models of the same car.
    pub yaw_inertia_kgm2: f64,
    /// Center of gravity to front axle L_f, m (Table I).
    pub front_axle_m: f64,
    /// Center of gravity to rear axle L_r, m (Table I).
    pub rear_axle_m: f64,
    /// Cornering stiffness of one front tire K_f, N/rad (Table I).
    pub front_stiffness_nprad: f64,
    /// Cornering stiffness of one rear tire K_r, N/rad (Table I).
    pub rear_stiffness_nprad: f64,
    /// Tire model of the plant; the controllers' model is always linear.
    pub tires: TireModel,
    /// Length, m.
    pub length_m: f64,
    /// Width, m.
    pub width_m: f64,
    /// Largest road-wheel angle, rad (10°).
    pub max_steer_rad: f64,
    /// Largest road-wheel rate, rad/s (30°/s, rounded down).
    pub max_steer_rate_radps: f64,
    /// First-order lag of the steering, s; 0 = none, as in the paper.
    pub steer_lag_s: f64,
    /// First-order lag of the drive train, s; 0 = none, as in the paper.
    pub drive_lag_s: f64,
    /// Pure delay of the steering before its lag, s, a whole multiple of the plant's step. The paper has none.
    pub steer_delay_s: f64,
    /// Pure delay of the drive train and the brakes before their lag, s, likewise. The paper has none.
    pub drive_delay_s: f64,
    /// Hardest braking the plant can do on a dry road, m/s² (positive); μ g bounds it further.
    pub max_brake_mps2: f64,
    /// Largest acceleration, m/s².
    pub max_accel_mps2: f64,
}

impl Default for VehicleParams {
    fn default() -> Self {
        Self::preset(VehiclePreset::CClass)
    }
}

impl VehicleParams {
    /// The parameters of a preset.
    pub fn preset(preset: VehiclePreset) -> Self {
        let c_class = Self {
            mass_kg: 1274.0,
            yaw_inertia_kgm2: 1536.7,
            front_axle_m: 1.016,
            rear_axle_m: 1.562,
            front_stiffness_nprad: 85_000.0,
            rear_stiffness_nprad: 112_000.0,
            tires: TireModel::Pacejka,
            length_m: 4.8,
            width_m: 1.9,
            max_steer_rad: 0.174_533,
            max_steer_rate_radps: 0.52,
            steer_lag_s: 0.1,
            drive_lag_s: 0.2,
            steer_delay_s: 0.0,
            drive_delay_s: 0.0,
            max_brake_mps2: 8.0,
            max_accel_mps2: 2.0,
        };
        match preset {
            VehiclePreset::CClass => c_class,
            VehiclePreset::Paper => Self {
                yaw_inertia_kgm2: 606.1,
                tires: TireModel::Linear,
                steer_lag_s: 0.0,
                drive_lag_s: 0.0,
                ..c_class
            },
        }
    }

    /// Wheelbase L = L_f + L_r, m.
    pub fn wheelbase_m(&self) -> f64 {
        self.front_axle_m + self.rear_axle_m
    }

    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("vehicle.mass_kg", self.mass_kg, 300.0, 10_000.0)?;
        check_range("vehicle.yaw_inertia_kgm2", self.yaw_inertia_kgm2, 100.0, 50_000.0)?;
        check_range("vehicle.front_axle_m", self.front_axle_m, 0.5, 5.0)?;
        check_range("vehicle.rear_axle_m", self.rear_axle_m, 0.5, 5.0)?;
        check_range("vehicle.front_stiffness_nprad", self.front_stiffness_nprad, 1e4, 1e6)?;
        check_range("vehicle.rear_stiffness_nprad", self.rear_stiffness_nprad, 1e4, 1e6)?;
        check_range("vehicle.length_m", self.length_m, 2.0, 20.0)?;
        check_range("vehicle.width_m", self.width_m, 1.0, 2.6)?;
        check_range("vehicle.max_steer_rad", self.max_steer_rad, 0.01, 0.8)?;
        check_range("vehicle.max_steer_rate_radps", self.max_steer_rate_radps, 0.05, 5.0)?;
        check_range("vehicle.steer_lag_s", self.steer_lag_s, 0.0, 1.0)?;
        check_range("vehicle.drive_lag_s", self.drive_lag_s, 0.0, 1.0)?;
        check_range("vehicle.steer_delay_s", self.steer_delay_s, 0.0, MAX_DELAY_S)?;
        check_range("vehicle.drive_delay_s", self.drive_delay_s, 0.0, MAX_DELAY_S)?;
        check_range("vehicle.max_brake_mps2", self.max_brake_mps2, 4.0, 12.0)?;
        check_range("vehicle.max_accel_mps2", self.max_accel_mps2, 0.5, 6.0)
    }
}
