//! Lateral tire forces (Eq. 3): how the force of an axle follows from its slip angle.
//!
//! Departure: Eq. 3 prints F = 2 K α with the positive stiffness of Table I, which makes the car unstable. The force
//! restores: F = −2 K α.

use crate::vehicle::{TireModel, VehicleParams};

/// Acceleration of gravity, m/s².
pub const GRAVITY_MPS2: f64 = 9.81;
/// Shape factor C of the magic formula: the customary value for lateral force.
const PACEJKA_SHAPE: f64 = 1.3;

/// Vertical loads of the front and the rear axle at rest, N.
pub fn axle_loads_n(params: &VehicleParams) -> (f64, f64) {
    let weight_n = params.mass_kg * GRAVITY_MPS2;
    let wheelbase_m = params.wheelbase_m();
    (weight_n * params.rear_axle_m / wheelbase_m, weight_n * params.front_axle_m / wheelbase_m)
}

/// Slip angles at which linear tires reach μ F_z, front and rear, rad: the bounds of Eq. 26 (after Beal and Gerdes,
/// 2013).
pub fn slip_limits_rad(params: &VehicleParams, adhesion: f64) -> (f64, f64) {
    let (front_n, rear_n) = axle_loads_n(params);
    (
        libm::atan(adhesion * front_n / (2.0 * params.front_stiffness_nprad)),
        libm::atan(adhesion * rear_n / (2.0 * params.rear_stiffness_nprad)),
    )
}

/// Slip angles of the front and the rear axle, rad (below Eq. 3). `speed_mps` must be positive.
pub fn slip_angles_rad(
    params: &VehicleParams,
    speed_mps: f64,
    lateral_speed_mps: f64,
    yaw_rate_radps: f64,
    steer_rad: f64,
) -> (f64, f64) {
    let front = (lateral_speed_mps + params.front_axle_m * yaw_rate_radps) / speed_mps - steer_rad;
    let rear = (lateral_speed_mps - params.rear_axle_m * yaw_rate_radps) / speed_mps;
    (front, rear)
}

/// Force of both tires of an axle at slip α, N, positive to the left.
///
/// `stiffness_nprad` is one tire's K; `peak_n` is μ F_z of the axle, at which all but linear tires saturate.
pub fn axle_force_n(model: TireModel, stiffness_nprad: f64, peak_n: f64, slip_rad: f64) -> f64 {
    let slope = 2.0 * stiffness_nprad;
    match model {
        TireModel::Linear => -slope * slip_rad,
        TireModel::Dugoff => {
            // λ = μ F_z / (2 · 2 K |α|); the force is linear while λ ≥ 1 and μ F_z (1 − λ / 2) below.
            let linear_n = slope * slip_rad;
            let twice_n = 2.0 * linear_n.abs();
            if twice_n <= peak_n { -linear_n } else { (peak_n * (1.0 - 0.5 * peak_n / twice_n)).copysign(-slip_rad) }
        }
        TireModel::Pacejka => {
            // F = −D sin(C atan(B α)) with D = μ F_z and B C D = 2 K.
            let b = slope / (PACEJKA_SHAPE * peak_n);
            -peak_n * libm::sin(PACEJKA_SHAPE * libm::atan(b * slip_rad))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_models_agree_at_small_slip() {
        // The magic formula departs from its tangent by (B α)² (1 + C²/2) / 3 to second order: 3e-5 at this slip.
        let slip_rad = 1e-4;
        let linear = axle_force_n(TireModel::Linear, 85_000.0, 6400.0, slip_rad);
        let pacejka = axle_force_n(TireModel::Pacejka, 85_000.0, 6400.0, slip_rad);
        assert!((pacejka / linear - 1.0).abs() < 1e-3);
        assert!(linear < 0.0, "the force restores");
    }

    #[test]
    fn pacejka_saturates_at_its_peak() {
        let peak_n = 6400.0;
        let largest = (0..2000)
            .map(|i| -axle_force_n(TireModel::Pacejka, 85_000.0, peak_n, f64::from(i) * 1e-3))
            .fold(0.0, f64::max);
        assert!(largest <= peak_n && largest > 0.999 * peak_n, "{largest}");
    }

    #[test]
    fn slip_limits_are_those_of_the_audit() {
        // Independent figures in degrees for μ = 0.85: 2.17 front, 1.07 rear, given to 0.01.
        let (front, rear) = slip_limits_rad(&VehicleParams::default(), 0.85);
        assert!((front.to_degrees() - 2.17).abs() < 0.01);
        assert!((rear.to_degrees() - 1.07).abs() < 0.01);
    }
}
