//! A reward learned from drivers, with all that is needed to use it.

use serde::{Deserialize, Serialize};

use super::features::{FEATURE_NAMES, FEATURES, FeatureConfig, Selection};
use crate::config::{ConfigError, check_range};

/// A reward learned from drivers: r = Σ ϖᵢ (Hᵢ − meanᵢ)/scaleᵢ (Eq. 20 on normalized features), with all that is needed to use it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RewardModel {
    /// Names of the features, each one of [`FEATURE_NAMES`] and none twice; all lists below are in their order.
    pub features: Vec<String>,
    /// How the features were computed.
    pub definition: FeatureConfig,
    /// Mean of each feature over the candidates it was learned from.
    pub mean: Vec<f64>,
    /// Standard deviation of each feature over the same candidates.
    pub scale: Vec<f64>,
    /// Weights ϖ of the normalized features; negative where the driver avoids them.
    pub weights: Vec<f64>,
    /// Which drivers it was learned from, in words.
    pub source: String,
}

/// A learned reward that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RewardError {
    /// Learned on features that are not known, or one of them twice.
    #[error("the reward's features are {found:?}, but must be some of {FEATURE_NAMES:?}, none of them twice")]
    Names {
        /// The names found.
        found: Vec<String>,
    },
    /// Not as many numbers as features.
    #[error("`reward.{list}` has {found} numbers, but there are {expected} features")]
    Count {
        /// Which list.
        list: &'static str,
        /// Numbers found.
        found: usize,
        /// Number of features.
        expected: usize,
    },
    /// A number out of its range.
    #[error("the learned reward: {0}")]
    Value(#[from] ConfigError),
}

/// Where the feature of this name stands in a vector.
pub fn feature_index(name: &str) -> Option<usize> {
    FEATURE_NAMES.iter().position(|known| *known == name)
}

impl RewardModel {
    /// Checks names and ranges, as of a model read from a file.
    pub fn validate(&self) -> Result<(), RewardError> {
        let mut seen = [false; FEATURES];
        for name in &self.features {
            match feature_index(name) {
                Some(index) if !seen[index] => seen[index] = true,
                _ => return Err(RewardError::Names { found: self.features.clone() }),
            }
        }
        let expected = self.features.len();
        for (list, values) in [("mean", &self.mean), ("scale", &self.scale), ("weights", &self.weights)] {
            if values.len() != expected {
                return Err(RewardError::Count { list, found: values.len(), expected });
            }
        }
        self.definition.validate()?;
        for i in 0..expected {
            check_range("reward.mean", self.mean[i], -1e6, 1e6)?;
            check_range("reward.scale", self.scale[i], 1e-12, 1e6)?;
            check_range("reward.weights", self.weights[i], -1e6, 1e6)?;
        }
        Ok(())
    }

    /// The features that it needs.
    pub fn selection(&self) -> Selection {
        let mut selection = [false; FEATURES];
        self.indices().for_each(|index| selection[index] = true);
        selection
    }

    /// Where each of its features stands in a vector.
    pub fn indices(&self) -> impl Iterator<Item = usize> {
        self.features.iter().filter_map(|name| feature_index(name))
    }

    /// r of a feature vector.
    pub fn reward(&self, features: &[f64; FEATURES]) -> f64 {
        let terms = self.indices().zip(&self.weights).zip(self.mean.iter().zip(&self.scale));
        terms.map(|((index, weight), (mean, scale))| weight * (features[index] - mean) / scale).sum()
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

    #[test]
    fn a_reward_on_other_features_is_refused() {
        let good = RewardModel {
            features: FEATURE_NAMES[..4].iter().map(|&name| name.to_owned()).collect(),
            definition: FeatureConfig::default(),
            mean: vec![0.0; 4],
            scale: vec![1.0; 4],
            weights: vec![-1.0; 4],
            source: String::new(),
        };
        assert_eq!(good.validate(), Ok(()));
        let mut strange = good.clone();
        strange.features[1] = "mood".into();
        assert!(strange.validate().unwrap_err().to_string().contains("\"mood\""));
        let mut twice = good.clone();
        twice.features[1] = "stability".into();
        assert!(matches!(twice.validate(), Err(RewardError::Names { .. })));
        let short = RewardModel { mean: vec![0.0; 3], ..good.clone() };
        assert_eq!(short.validate(), Err(RewardError::Count { list: "mean", found: 3, expected: 4 }));
        let flat = RewardModel { scale: vec![1.0, 0.0, 1.0, 1.0], ..good.clone() };
        assert!(matches!(flat.validate(), Err(RewardError::Value(_))));
        assert!(RewardModel { weights: vec![f64::NAN; 4], ..good }.validate().is_err());
    }

    #[test]
    fn features_may_come_in_any_order() {
        let model = |order: [usize; 2]| RewardModel {
            features: order.map(|i| ["travel", "jerk"][i].to_owned()).to_vec(),
            definition: FeatureConfig::default(),
            mean: order.map(|i| [0.1, 2.0][i]).to_vec(),
            scale: order.map(|i| [0.2, 4.0][i]).to_vec(),
            weights: order.map(|i| [-1.0, -3.0][i]).to_vec(),
            source: String::new(),
        };
        let h = [9.0, 9.0, 9.0, 0.3, 6.0, 9.0, 9.0, 9.0, 9.0];
        for order in [[0, 1], [1, 0]] {
            assert!((model(order).reward(&h) - (-1.0 - 3.0)).abs() < 1e-12);
            assert_eq!(model(order).selection().iter().filter(|wanted| **wanted).count(), 2);
        }
    }
}
