//! What drivers weigh when they change lanes (Eqs. 18–20): stability, collision risk, comfort and travel efficiency of a path.
//!
//! All four are costs, so that a reward learned from people has negative weights. Departures from the paper: the collision feature
//! is taken on normalized distances (in meters it vanishes until the bodies overlap), and the number of samples η is that of
//! [0, t_c] (the text says of the interval of allowed durations, which would not make H_tra a measure of duration).

use serde::{Deserialize, Serialize};

use super::quintic::Quintic;
use crate::config::{ConfigError, check_range};

/// Number of features.
pub const FEATURES: usize = 4;

/// Names of the features, in the order of every feature vector.
pub const FEATURE_NAMES: [&str; FEATURES] = ["stability", "collision", "comfort", "travel"];

/// Terms of the collision sum with an exponent below this are left out: each is below 2e-4, against sums of about 0.5.
const NEGLIGIBLE_EXPONENT: f64 = -9.0;

/// Sampling step that makes H_tra = t_c²/η the printed values of Table IV (0.05 t_c), s.
const TRAVEL_STEP_S: f64 = 0.05;

/// Units of the features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FeatureUnits {
    /// rad², dimensionless, (rad/s)², s².
    Si,
    /// As far as Table IV can be decoded: (m/s per km/h)², hundredths, (deg/s)², s².
    Table,
}

/// How the features are computed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FeatureConfig {
    /// Time between two samples of a path, s: 0.1 in the text (Table IV was made with 0.05).
    pub sample_step_s: f64,
    /// σ₁ on the squared lateral distance in units of `lateral_scale_m`: −3 (the paper has meters).
    pub sigma_lateral: f64,
    /// Unit of lateral distance, m: a lane's width.
    pub lateral_scale_m: f64,
    /// σ₂ on the squared longitudinal distance in units of `longitudinal_scale_m`: −0.5 (the paper has meters).
    pub sigma_longitudinal: f64,
    /// Unit of longitudinal distance, m.
    pub longitudinal_scale_m: f64,
    /// Units of the result.
    pub units: FeatureUnits,
}

impl Default for FeatureConfig {
    fn default() -> Self {
        Self {
            sample_step_s: 0.1,
            sigma_lateral: -3.0,
            lateral_scale_m: 3.75,
            sigma_longitudinal: -0.5,
            longitudinal_scale_m: 10.0,
            units: FeatureUnits::Si,
        }
    }
}

impl FeatureConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("planner.features.sample_step_s", self.sample_step_s, 0.01, 0.5)?;
        check_range("planner.features.sigma_lateral", self.sigma_lateral, -100.0, 0.0)?;
        check_range("planner.features.lateral_scale_m", self.lateral_scale_m, 0.1, 10.0)?;
        check_range("planner.features.sigma_longitudinal", self.sigma_longitudinal, -100.0, 0.0)?;
        check_range("planner.features.longitudinal_scale_m", self.longitudinal_scale_m, 0.1, 100.0)
    }

    /// Number of samples η of a path of this duration.
    pub fn samples(&self, duration_s: f64) -> u32 {
        (duration_s / self.sample_step_s).round().max(1.0) as u32
    }

    /// Factors from SI to `units`.
    fn unit_factors(&self) -> [f64; FEATURES] {
        let degrees = 180.0 / core::f64::consts::PI;
        match self.units {
            FeatureUnits::Si => [1.0; FEATURES],
            FeatureUnits::Table => [1.0 / (3.6 * 3.6), 100.0, degrees * degrees, 1.0],
        }
    }
}

/// H = [H_sta, H_col, H_com, H_tra] of one path at constant `speed_mps`; see [`features_of_set`].
pub fn features(
    config: &FeatureConfig,
    path: &Quintic,
    speed_mps: f64,
    neighbors: usize,
    position_m: impl Fn(usize, f64) -> (f64, f64),
) -> [f64; FEATURES] {
    let mut result = [[0.0; FEATURES]];
    features_of_set(config, (std::slice::from_ref(path), speed_mps), neighbors, position_m, &mut result);
    result[0]
}

/// The features of several paths that start together and run at the same constant speed.
///
/// With β = Ẏ/V and φ̇ = Ÿ/V (Eq. 16), means over the samples l = 1 … η: H_sta of β², H_com of φ̇², H_col of
/// Σ_m exp(σ₁ (ΔY/scale)² + σ₂ (ΔX/scale)²); H_tra = 0.05 s · t_c.
///
/// `position_m(m, t)` is where neighbor `m` of 0..`neighbors` is at time t: distance along the road from the ego's *first* position,
/// and lateral position. `out` has one vector for each path.
pub fn features_of_set(
    config: &FeatureConfig,
    (paths, speed_mps): (&[Quintic], f64),
    neighbors: usize,
    position_m: impl Fn(usize, f64) -> (f64, f64),
    out: &mut [[f64; FEATURES]],
) {
    debug_assert_eq!(paths.len(), out.len());
    let samples: Vec<u32> = paths.iter().map(|path| config.samples(path.duration_s)).collect();
    for ((path, &samples), sums) in paths.iter().zip(&samples).zip(out.iter_mut()) {
        *sums = own_motion(config, (path, samples), speed_mps);
    }
    let by_scale = |sigma: f64, scale_m: f64| sigma / (scale_m * scale_m);
    let longitudinal = by_scale(config.sigma_longitudinal, config.longitudinal_scale_m);
    let lateral = by_scale(config.sigma_lateral, config.lateral_scale_m);
    let mut near = Vec::with_capacity(neighbors);
    for sample in 1..=samples.iter().copied().max().unwrap_or(0) {
        let time_s = f64::from(sample) * config.sample_step_s;
        near.clear();
        near.extend((0..neighbors).filter_map(|neighbor| {
            let (ahead_m, d_m) = position_m(neighbor, time_s);
            let along_m = ahead_m - speed_mps * time_s;
            let exponent = longitudinal * along_m * along_m;
            (exponent >= NEGLIGIBLE_EXPONENT).then_some((exponent, d_m))
        }));
        for ((path, &samples), sums) in paths.iter().zip(&samples).zip(out.iter_mut()) {
            if sample <= samples && !near.is_empty() {
                sums[1] += potential(&near, lateral, path.at(time_s).0);
            }
        }
    }
    let factors = config.unit_factors();
    for (&samples, sums) in samples.iter().zip(out.iter_mut()) {
        sums[1] /= f64::from(samples);
        for (sum, factor) in sums.iter_mut().zip(factors) {
            *sum *= factor;
        }
    }
}

/// Σ exp(longitudinal exponent + `lateral` · ΔY²) over the neighbors `near`, given by that exponent and their lateral position.
fn potential(near: &[(f64, f64)], lateral: f64, d_m: f64) -> f64 {
    let mut sum = 0.0;
    for &(longitudinal_exponent, neighbor_d_m) in near {
        let across_m = d_m - neighbor_d_m;
        let exponent = longitudinal_exponent + lateral * across_m * across_m;
        if exponent >= NEGLIGIBLE_EXPONENT {
            sum += libm::exp(exponent);
        }
    }
    sum
}

/// The three features of the path alone, and no collision risk yet.
fn own_motion(config: &FeatureConfig, (path, samples): (&Quintic, u32), speed_mps: f64) -> [f64; FEATURES] {
    let per_speed = 1.0 / speed_mps;
    let (mut course, mut yaw_rate) = (0.0, 0.0);
    for sample in 1..=samples {
        let (_, speed, accel, _) = path.at(f64::from(sample) * config.sample_step_s);
        course += (speed * per_speed) * (speed * per_speed);
        yaw_rate += (accel * per_speed) * (accel * per_speed);
    }
    let samples = f64::from(samples);
    [course / samples, 0.0, yaw_rate / samples, TRAVEL_STEP_S * path.duration_s]
}

/// A reward learned from drivers: r = Σ ϖᵢ (Hᵢ − meanᵢ)/scaleᵢ (Eq. 20 on normalized features), with all that is needed to use it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RewardModel {
    /// Names of the features, to be [`FEATURE_NAMES`].
    pub features: [String; FEATURES],
    /// How the features were computed.
    pub definition: FeatureConfig,
    /// Mean of each feature over the candidates it was learned from.
    pub mean: [f64; FEATURES],
    /// Standard deviation of each feature over the same candidates.
    pub scale: [f64; FEATURES],
    /// Weights ϖ of the normalized features; negative where the driver avoids them.
    pub weights: [f64; FEATURES],
    /// Which drivers it was learned from, in words.
    pub source: String,
}

/// A learned reward that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RewardError {
    /// Learned on other features, or in another order.
    #[error("the reward's features are {found:?}, but must be {FEATURE_NAMES:?}")]
    Names {
        /// The names found.
        found: [String; FEATURES],
    },
    /// A number out of its range.
    #[error("the learned reward: {0}")]
    Value(#[from] ConfigError),
}

impl RewardModel {
    /// Checks names and ranges, as of a model read from a file.
    pub fn validate(&self) -> Result<(), RewardError> {
        if self.features != FEATURE_NAMES {
            return Err(RewardError::Names { found: self.features.clone() });
        }
        self.definition.validate()?;
        for i in 0..FEATURES {
            check_range("reward.mean", self.mean[i], -1e6, 1e6)?;
            check_range("reward.scale", self.scale[i], 1e-12, 1e6)?;
            check_range("reward.weights", self.weights[i], -1e6, 1e6)?;
        }
        Ok(())
    }

    /// r of a feature vector.
    pub fn reward(&self, features: &[f64; FEATURES]) -> f64 {
        reward(&self.weights, (&self.mean, &self.scale), features)
    }
}

/// Σ ϖᵢ (Hᵢ − meanᵢ)/scaleᵢ.
pub(super) fn reward(
    weights: &[f64; FEATURES],
    (mean, scale): (&[f64; FEATURES], &[f64; FEATURES]),
    features: &[f64; FEATURES],
) -> f64 {
    (0..FEATURES).map(|i| weights[i] * (features[i] - mean[i]) / scale[i]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::quintic::LateralState;

    fn path() -> Quintic {
        Quintic::new(LateralState::default(), 3.75, 2.5)
    }

    #[test]
    fn features_of_a_path_on_an_empty_road_are_the_integrals() {
        let config = FeatureConfig { sample_step_s: 0.01, ..FeatureConfig::default() };
        let h = features(&config, &path(), 25.0, 0, |_, _| (0.0, 0.0));
        // Means of the squared derivatives of Eq. 14: ∫s'² = 10/7, ∫s''² = 120/7 on the unit interval. Both integrands and their
        // first derivatives vanish or repeat at the ends, so that the rectangle rule converges fast: 1e-6 at 250 samples.
        let (f, t, v) = (3.75, 2.5, 25.0);
        let expected =
            [(f / (t * v)) * (f / (t * v)) * 10.0 / 7.0, 0.0, (f / (t * t * v)) * (f / (t * t * v)) * 120.0 / 7.0];
        for i in 0..3 {
            assert!((h[i] - expected[i]).abs() <= 1e-6 * expected[i].max(1e-3), "{i}: {} {}", h[i], expected[i]);
        }
        assert_eq!(h[3], 0.125);
    }

    #[test]
    fn collision_risk_is_the_mean_of_the_potentials() {
        // Two samples; a car 5 m ahead in the new lane at the same speed, one too far away to count.
        let config = FeatureConfig { sample_step_s: 1.0, ..FeatureConfig::default() };
        let path = Quintic::new(LateralState::default(), 3.75, 2.0);
        let h = features(&config, &path, 20.0, 2, |m, t| ([5.0, 80.0][m] + 20.0 * t, 3.75));
        // Half way the car is half a lane aside: exponents −3/4 − 1/8, then −1/8.
        let expected = 0.5 * (libm::exp(-0.875) + libm::exp(-0.125));
        assert!((h[1] - expected).abs() < 1e-12);
    }

    #[test]
    fn table_units_are_those_decoded_from_table_iv() {
        let at = |_: usize, t: f64| (25.0 * t, 3.75);
        let si = features(&FeatureConfig::default(), &path(), 25.0, 1, at);
        let table =
            features(&FeatureConfig { units: FeatureUnits::Table, ..FeatureConfig::default() }, &path(), 25.0, 1, at);
        assert!((table[0] * 12.96 - si[0]).abs() < 1e-15);
        assert!((table[1] - 100.0 * si[1]).abs() < 1e-12);
        assert!((table[2] - si[2] * 57.295_779_513 * 57.295_779_513).abs() < 1e-7);
        assert_eq!(table[3], si[3]);
        // Orders of magnitude of Table IV: 2e-4 … 5e-4, 17 … 30, 0.095 … 0.14.
        assert!((1e-4..1e-3).contains(&table[0]) && (10.0..40.0).contains(&table[2]));
    }

    #[test]
    fn a_reward_on_other_features_is_refused() {
        let good = RewardModel {
            features: FEATURE_NAMES.map(str::to_owned),
            definition: FeatureConfig::default(),
            mean: [0.0; FEATURES],
            scale: [1.0; FEATURES],
            weights: [-1.0; FEATURES],
            source: String::new(),
        };
        assert_eq!(good.validate(), Ok(()));
        let mut swapped = good.clone();
        swapped.features.swap(0, 1);
        assert!(swapped.validate().unwrap_err().to_string().contains("[\"stability\", \"collision\""));
        let flat = RewardModel { scale: [1.0, 0.0, 1.0, 1.0], ..good.clone() };
        assert!(matches!(flat.validate(), Err(RewardError::Value(_))));
        assert!(RewardModel { weights: [f64::NAN; FEATURES], ..good }.validate().is_err());
    }

    #[test]
    fn a_set_gives_what_each_path_gives_alone() {
        let config = FeatureConfig::default();
        let at = |m: usize, t: f64| (12.0 * m as f64 - 10.0 + 23.0 * t, 3.75);
        let paths = [1.5, 2.2, 4.0].map(|t| Quintic::new(LateralState::default(), 3.75, t));
        let mut set = [[0.0; FEATURES]; 3];
        features_of_set(&config, (&paths, 25.0), 3, at, &mut set);
        for (path, together) in paths.iter().zip(set) {
            assert_eq!(features(&config, path, 25.0, 3, at), together);
        }
    }
}
