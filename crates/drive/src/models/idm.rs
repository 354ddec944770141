//! Car following: the Intelligent Driver Model (Treiber, Hennecke and Helbing, 2000).
//!
//! a = a_max [1 − (v/v₀)⁴ − (s*/s)²] with s* = s₀ + max(0, v T + v Δv / (2 √(a_max b))), Δv = v − v_leader.
//! The model itself knows no limit of braking and no overlap; who uses it clamps its answer to what the vehicle can do.

use serde::{Deserialize, Serialize};

/// Gaps are taken as at least this long, m: the model diverges at contact.
pub(super) const SHORTEST_GAP_M: f64 = 0.1;

/// Parameters of one driver.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdmParams {
    /// Speed on an empty road v₀, m/s.
    pub desired_speed_mps: f64,
    /// Time headway T, s.
    pub time_headway_s: f64,
    /// Bumper-to-bumper gap at standstill s₀, m.
    pub min_gap_m: f64,
    /// Acceleration from standstill a_max, m/s².
    pub max_accel_mps2: f64,
    /// Comfortable deceleration b, m/s² (positive).
    pub comfort_decel_mps2: f64,
}

/// A driver's parameters with all that stays the same divided out, for those who ask often.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdmTerms {
    /// 1 / v₀, s/m.
    pub per_desired_speed_spm: f64,
    /// T, s.
    pub time_headway_s: f64,
    /// s₀, m.
    pub min_gap_m: f64,
    /// a_max, m/s².
    pub max_accel_mps2: f64,
    /// 1 / (2 √(a_max b)), s²/m.
    pub per_braking_scale_s2pm: f64,
}

impl From<&IdmParams> for IdmTerms {
    fn from(params: &IdmParams) -> Self {
        Self {
            per_desired_speed_spm: 1.0 / params.desired_speed_mps,
            time_headway_s: params.time_headway_s,
            min_gap_m: params.min_gap_m,
            max_accel_mps2: params.max_accel_mps2,
            per_braking_scale_s2pm: 0.5 / (params.max_accel_mps2 * params.comfort_decel_mps2).sqrt(),
        }
    }
}

// Must be inlined into the loops that `pulp` compiles for the processor's instruction set.
#[allow(clippy::inline_always)]
impl IdmTerms {
    /// Acceleration behind a leader, m/s²; the arguments are those of [`idm_accel`].
    #[inline(always)]
    pub fn accel_mps2(&self, gap_m: f64, speed_mps: f64, approach_mps: f64) -> f64 {
        let (v, dv) = (speed_mps, approach_mps);
        let wanted_gap_m = self.min_gap_m + (v * (self.time_headway_s + dv * self.per_braking_scale_s2pm)).max(0.0);
        let interaction = wanted_gap_m / gap_m.max(SHORTEST_GAP_M);
        self.free_accel_mps2(v) - self.max_accel_mps2 * interaction * interaction
    }

    /// Acceleration without a leader, m/s².
    #[inline(always)]
    pub fn free_accel_mps2(&self, speed_mps: f64) -> f64 {
        let ratio = speed_mps * self.per_desired_speed_spm;
        let square = ratio * ratio;
        self.max_accel_mps2 * (1.0 - square * square)
    }

    /// b, m/s².
    pub(super) fn comfort_decel_mps2(&self) -> f64 {
        0.25 / (self.max_accel_mps2 * self.per_braking_scale_s2pm * self.per_braking_scale_s2pm)
    }
}

/// Acceleration behind a leader, m/s².
///
/// `gap_m`: bumper to bumper, infinite without a leader; `approach_mps`: own speed minus the leader's.
pub fn idm_accel(gap_m: f64, speed_mps: f64, approach_mps: f64, params: &IdmParams) -> f64 {
    IdmTerms::from(params).accel_mps2(gap_m, speed_mps, approach_mps)
}

/// Acceleration without a leader, m/s².
pub fn idm_free_accel(speed_mps: f64, params: &IdmParams) -> f64 {
    IdmTerms::from(params).free_accel_mps2(speed_mps)
}

/// The gap at which a driver of this speed behind a leader of the same speed neither accelerates nor brakes, m.
///
/// s_e = (s₀ + v T) / √(1 − (v/v₀)⁴); infinite from the desired speed on.
pub fn idm_equilibrium_gap_m(speed_mps: f64, params: &IdmParams) -> f64 {
    let free = idm_free_accel(speed_mps, params) / params.max_accel_mps2;
    if free <= 0.0 {
        return f64::INFINITY;
    }
    (params.min_gap_m + speed_mps * params.time_headway_s) / free.sqrt()
}

#[cfg(test)]
mod tests {
    use super::{IdmParams, idm_accel, idm_equilibrium_gap_m, idm_free_accel};

    const DRIVER: IdmParams = IdmParams {
        desired_speed_mps: 30.0,
        time_headway_s: 1.5,
        min_gap_m: 2.0,
        max_accel_mps2: 1.5,
        comfort_decel_mps2: 2.0,
    };

    #[test]
    fn equilibrium_gap_gives_zero_acceleration() {
        for speed_mps in [0.0, 3.0, 11.0, 25.0, 29.9] {
            let gap_m = idm_equilibrium_gap_m(speed_mps, &DRIVER);
            // 1e-9: the bar for analytic checks; the gap near v0 is some hundred meters.
            assert!(idm_accel(gap_m, speed_mps, 0.0, &DRIVER).abs() < 1e-9, "at {speed_mps} m/s");
        }
        assert_eq!(idm_equilibrium_gap_m(30.1, &DRIVER), f64::INFINITY);
    }

    #[test]
    fn free_road_drives_to_the_desired_speed() {
        assert_eq!(idm_free_accel(0.0, &DRIVER), 1.5);
        // v/v₀ is a product with 1/v₀, which rounds.
        assert!(idm_free_accel(30.0, &DRIVER).abs() < 1e-15);
        assert!(idm_free_accel(33.0, &DRIVER) < 0.0);
        assert_eq!(idm_accel(f64::INFINITY, 20.0, 0.0, &DRIVER), idm_free_accel(20.0, &DRIVER));
        // Half the desired speed leaves 15/16 of the acceleration.
        assert!((idm_free_accel(15.0, &DRIVER) - 1.5 * 15.0 / 16.0).abs() < 1e-15);
    }

    #[test]
    fn closing_in_brakes_and_falling_back_does_not() {
        let behind = |approach_mps| idm_accel(40.0, 25.0, approach_mps, &DRIVER);
        assert!(behind(5.0) < behind(0.0) && behind(0.0) < behind(-5.0));
        // A leader that pulls away fast enough leaves only the standstill gap to be wanted.
        let pulled = idm_free_accel(25.0, &DRIVER) - 1.5 * (2.0 / 40.0) * (2.0 / 40.0);
        assert!((behind(-50.0) - pulled).abs() < 1e-15);
    }

    #[test]
    fn contact_stays_finite() {
        assert!(idm_accel(-3.0, 25.0, 25.0, &DRIVER).is_finite());
    }
}
