//! What moves: the state of a car in the road frame and the commands it is given.

use serde::{Deserialize, Serialize};

/// The state of a single-track car in the road frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct VehicleState {
    /// Position of the center of gravity along the road, m.
    pub s_m: f64,
    /// Position to the left of the reference line, m.
    pub d_m: f64,
    /// Heading relative to the road's tangent φ, rad, positive to the left.
    pub heading_rad: f64,
    /// Longitudinal speed in the body frame V_x, m/s, never negative.
    pub speed_mps: f64,
    /// Lateral speed in the body frame V_y, m/s, positive to the left.
    pub lateral_speed_mps: f64,
    /// Yaw rate γ, rad/s.
    pub yaw_rate_radps: f64,
    /// Front road-wheel angle δ after the actuator, rad.
    pub steer_rad: f64,
    /// Longitudinal acceleration after the drive train, m/s².
    pub accel_mps2: f64,
}

impl VehicleState {
    /// Speed along the road, m/s (to first order in κ d, which is below 0.01 on highways).
    pub fn road_speed_mps(&self) -> f64 {
        self.speed_mps * libm::cos(self.heading_rad) - self.lateral_speed_mps * libm::sin(self.heading_rad)
    }

    /// Speed to the left in the road frame ḋ, m/s.
    pub fn road_lateral_speed_mps(&self) -> f64 {
        self.speed_mps * libm::sin(self.heading_rad) + self.lateral_speed_mps * libm::cos(self.heading_rad)
    }
}

/// What the controllers ask of the car.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ControlInput {
    /// Demanded longitudinal acceleration, m/s².
    pub accel_mps2: f64,
    /// Demanded front road-wheel angle, rad.
    pub steer_rad: f64,
}
