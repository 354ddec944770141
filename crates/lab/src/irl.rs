//! Learning the planner's reward from demonstrations, and judging it on drivers it has not seen (Eqs. 20–24, Table IV).
//!
//! Candidates that differ in duration alone leave the weights hardly identifiable, so that a fit is judged by what it predicts, not
//! by its weights. The "average learning errors" of the paper are errors of the columns' means, in which signs cancel; the mean
//! absolute error stands beside them.

use lanecraft_drive::plan::{FEATURE_NAMES, FEATURES, RewardModel};
use lanecraft_learn::irl::{IrlConfig, IrlError, IrlFit, IrlNormalization};
use serde::{Deserialize, Serialize};

use crate::demonstrations::{Demonstration, Demonstrations, log_probabilities, rewards};

/// Width of the Gaussian kernel of the duration baseline, s.
const KERNEL_S: f64 = 0.8;

/// How well one feature of the preferred candidate meets the driver's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeatureError {
    /// Name of the feature.
    pub feature: String,
    /// |mean of ours / mean of the drivers' − 1|: the paper's figure.
    pub ratio_of_means_error: f64,
    /// Mean of |ours / the driver's − 1|.
    pub mean_absolute_error: f64,
}

/// How well a reward predicts drivers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Judgment {
    /// Lane changes judged.
    pub events: usize,
    /// Errors of the features.
    pub features: Vec<FeatureError>,
    /// Mean |duration of the preferred candidate − the driver's|, s.
    pub duration_error_s: f64,
    /// Mean log-likelihood of the candidate nearest to the driver's path.
    pub log_likelihood: f64,
    /// The same if all candidates are equally likely.
    pub uniform: f64,
    /// The same if the duration is drawn from a smoothed histogram of the other drivers' durations.
    pub duration_density: f64,
}

/// A reward, how it was found and what it is worth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IrlReport {
    /// The reward learned from all drivers of the training set.
    pub model: RewardModel,
    /// The fit behind it.
    pub fit: IrlFit,
    /// On drivers that were not in training.
    pub unseen: Judgment,
}

/// Learns from all demonstrations; judged by leaving out each group in turn.
///
/// # Errors
/// If there are fewer than two groups, or a fit fails.
pub fn fit(demonstrations: &Demonstrations, config: &IrlConfig) -> Result<IrlReport, IrlError> {
    let mut outcomes = Vec::new();
    for group in demonstrations.groups() {
        let train = demonstrations.filtered(|item| item.group != group);
        let (model, _) = learn(&train, config)?;
        let tested = demonstrations.items.iter().filter(|item| item.group == group);
        outcomes.extend(tested.map(|item| Outcome::new(&model, &train, item)));
    }
    let (model, fit) = learn(demonstrations, config)?;
    Ok(IrlReport { model, fit, unseen: judgment(&outcomes) })
}

/// Learns from `train`; judged on `test`.
///
/// # Errors
/// If either is empty, or the fit fails.
pub fn fit_and_test(train: &Demonstrations, test: &Demonstrations, config: &IrlConfig) -> Result<IrlReport, IrlError> {
    let (model, fit) = learn(train, config)?;
    let unseen = judge(&model, train, test)?;
    Ok(IrlReport { model, fit, unseen })
}

/// How well `model`, learned from `train`, predicts `test`.
///
/// # Errors
/// If `test` is empty.
pub fn judge(model: &RewardModel, train: &Demonstrations, test: &Demonstrations) -> Result<Judgment, IrlError> {
    if test.items.is_empty() {
        return Err(IrlError::NoEvents);
    }
    let outcomes: Vec<Outcome> = test.items.iter().map(|item| Outcome::new(model, train, item)).collect();
    Ok(judgment(&outcomes))
}

/// The reward that explains `train` best.
fn learn(train: &Demonstrations, config: &IrlConfig) -> Result<(RewardModel, IrlFit), IrlError> {
    let fit = lanecraft_learn::irl::fit(&train.candidate_sets(), config)?;
    let (mean, scale) = normalization(train, config.normalization);
    let model = RewardModel {
        features: FEATURE_NAMES.map(str::to_owned),
        definition: train.definition.clone(),
        mean,
        scale,
        weights: std::array::from_fn(|i| fit.weights[i] * scale[i]),
        source: train.source.clone(),
    };
    Ok((model, fit))
}

/// Mean and scale of each feature over all candidates; a feature that never varies has the scale 1.
fn normalization(train: &Demonstrations, kind: IrlNormalization) -> ([f64; FEATURES], [f64; FEATURES]) {
    let vectors = || train.items.iter().flat_map(|item| &item.features);
    let count = vectors().count() as f64;
    let mean: [f64; FEATURES] = std::array::from_fn(|i| vectors().map(|vector| vector[i]).sum::<f64>() / count);
    let or_one = |scale: f64| if scale > 0.0 { scale } else { 1.0 };
    match kind {
        IrlNormalization::Mean => ([0.0; FEATURES], mean.map(|mean| or_one(mean.abs()))),
        IrlNormalization::ZScore => {
            let variance =
                |i: usize| vectors().map(|vector| (vector[i] - mean[i]) * (vector[i] - mean[i])).sum::<f64>();
            (mean, std::array::from_fn(|i| or_one((variance(i) / count).sqrt())))
        }
    }
}

/// What came of one driver.
struct Outcome {
    preferred: [f64; FEATURES],
    driver: [f64; FEATURES],
    duration_error_s: f64,
    log_likelihood: f64,
    uniform: f64,
    duration_density: f64,
}

impl Outcome {
    fn new(model: &RewardModel, train: &Demonstrations, item: &Demonstration) -> Self {
        let rewards = rewards(model, &item.features);
        let best = (1..rewards.len()).fold(0, |best, index| if rewards[index] > rewards[best] { index } else { best });
        Self {
            preferred: item.features[best],
            driver: item.driver_features,
            duration_error_s: (item.durations_s[best] - item.driver_duration_s).abs(),
            log_likelihood: log_probabilities(&rewards)[item.chosen],
            uniform: -libm::log(rewards.len() as f64),
            duration_density: log_probabilities(&log_density(train, &item.durations_s))[item.chosen],
        }
    }
}

/// Log of the Gaussian kernel density of the durations of `train`, up to a constant.
fn log_density(train: &Demonstrations, durations_s: &[f64]) -> Vec<f64> {
    let kernel = |a_s: f64, b_s: f64| -0.5 * (a_s - b_s) * (a_s - b_s) / (KERNEL_S * KERNEL_S);
    let at = |duration_s: f64| {
        let exponents = || train.items.iter().map(|item| kernel(duration_s, item.driver_duration_s));
        let highest = exponents().fold(f64::NEG_INFINITY, f64::max);
        highest + libm::log(exponents().map(|exponent| libm::exp(exponent - highest)).sum())
    };
    durations_s.iter().map(|&duration_s| at(duration_s)).collect()
}

fn judgment(outcomes: &[Outcome]) -> Judgment {
    let mean = |of: &dyn Fn(&Outcome) -> f64| outcomes.iter().map(of).sum::<f64>() / outcomes.len() as f64;
    let feature = |i: usize| FeatureError {
        feature: FEATURE_NAMES[i].to_owned(),
        ratio_of_means_error: relative_error(mean(&|outcome| outcome.preferred[i]), mean(&|outcome| outcome.driver[i])),
        mean_absolute_error: mean(&|outcome| relative_error(outcome.preferred[i], outcome.driver[i])),
    };
    Judgment {
        events: outcomes.len(),
        features: (0..FEATURES).map(feature).collect(),
        duration_error_s: mean(&|outcome| outcome.duration_error_s),
        log_likelihood: mean(&|outcome| outcome.log_likelihood),
        uniform: mean(&|outcome| outcome.uniform),
        duration_density: mean(&|outcome| outcome.duration_density),
    }
}

/// |ours/theirs − 1|; 0 where both are 0, as the collision risk on an empty road.
fn relative_error(ours: f64, theirs: f64) -> f64 {
    if ours == theirs { 0.0 } else { (ours / theirs - 1.0).abs() }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use lanecraft_drive::plan::{FeatureConfig, FeatureUnits, Planner, PlannerConfig};
    use lanecraft_drive::vehicle::VehicleParams;

    use super::*;
    use crate::data::events::read_events;
    use crate::demonstrations::{DriverDuration, RecordedConfig, SyntheticConfig, recorded, synthetic};

    #[test]
    fn hidden_weights_are_recovered_in_what_they_predict() {
        let config = SyntheticConfig::default();
        let (train, test) = (synthetic(&config, 1, 50), synthetic(&config, 2, 200));
        let report = fit_and_test(&train, &test, &IrlConfig::default()).unwrap();
        let truth = judge(&config.hidden_reward(), &train, &test).unwrap();
        // Fifty choices leave four weights an expected loss of about 4/(2·50) = 0.04 per choice (Wilks); three times that.
        assert!(report.unseen.log_likelihood > truth.log_likelihood - 0.12, "{report:?} against {truth:?}");
        assert!(report.unseen.log_likelihood > report.unseen.uniform + 0.5);
        assert!(report.unseen.duration_error_s < truth.duration_error_s + 0.05);
    }

    #[test]
    fn table_iv_is_reproduced_on_synthetic_drivers() {
        let features = FeatureConfig { sample_step_s: 0.05, units: FeatureUnits::Table, ..FeatureConfig::default() };
        let config = SyntheticConfig { features, ..SyntheticConfig::default() };
        let (train, test) = (synthetic(&config, 3, 50), synthetic(&config, 4, 10));
        let report = fit_and_test(&train, &test, &IrlConfig::default()).unwrap();
        println!("Table IV on synthetic drivers: {:#?}", report.unseen);
        let [_, collision, _, travel] = &report.unseen.features[..] else { panic!("four features") };
        assert!(collision.ratio_of_means_error <= 0.1 && travel.ratio_of_means_error <= 0.1);
        for error in &report.unseen.features {
            assert!(error.mean_absolute_error >= 0.3 * error.ratio_of_means_error);
        }
    }

    #[test]
    fn the_model_scores_as_the_fit_does_and_drives_the_planner() {
        let train = synthetic(&SyntheticConfig::default(), 5, 30);
        let sets = train.candidate_sets();
        for normalization in [IrlNormalization::ZScore, IrlNormalization::Mean] {
            let config = IrlConfig { normalization, ..IrlConfig::default() };
            let report = fit(&train, &config).unwrap();
            let judged = judge(&report.model, &train, &train).unwrap();
            assert!((judged.log_likelihood - report.fit.log_likelihood_per_event).abs() < 1e-9);
            let mut single = 0.0;
            for set in &sets {
                single += report.fit.log_likelihood(set).unwrap() / sets.len() as f64;
            }
            assert!((judged.log_likelihood - single).abs() < 1e-9);
            for (weight, normalized) in report.model.weights.iter().zip(&report.fit.normalized_weights) {
                assert!((weight - normalized).abs() < 1e-9 * normalized.abs().max(1.0));
            }
            let planner = PlannerConfig::default().with_reward(&report.model);
            assert!(Planner::new(&planner, &VehicleParams::default()).is_ok());
            let text = serde_json::to_string(&report).unwrap();
            assert_eq!(serde_json::from_str::<IrlReport>(&text).unwrap(), report);
        }
    }

    #[test]
    fn nothing_to_learn_from_is_an_error() {
        let none = synthetic(&SyntheticConfig::default(), 6, 0);
        assert!(fit(&none, &IrlConfig::default()).is_err());
        let one = synthetic(&SyntheticConfig::default(), 6, 1);
        assert!(fit(&one, &IrlConfig::default()).is_err());
        assert!(judge(&SyntheticConfig::default().hidden_reward(), &one, &none).is_err());
    }

    #[test]
    fn recorded_drivers_are_predicted_better_than_by_their_durations() {
        let Ok(data) = std::env::var("LANECRAFT_DATA") else {
            println!("skipped: LANECRAFT_DATA names no folder with recorded lane changes");
            return;
        };
        let events = read_events(&Path::new(&data).join("ngsim-lane-changes")).unwrap();
        for driver_duration in [DriverDuration::Record, DriverDuration::QuinticFit] {
            let config = RecordedConfig { driver_duration, ..RecordedConfig::default() };
            let demonstrations = recorded(&events, &config);
            let report = fit(&demonstrations, &IrlConfig::default()).unwrap();
            println!("{driver_duration:?}: {:#?} {:?}", report.unseen, report.model.weights);
            assert!((report.unseen.uniform + libm::log(86.0)).abs() < 1e-12);
            assert!(report.unseen.log_likelihood > report.unseen.uniform + 0.05);
            if driver_duration == DriverDuration::Record {
                assert!(report.unseen.log_likelihood > report.unseen.duration_density + 0.15);
            }
        }
    }
}
