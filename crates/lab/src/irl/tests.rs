use std::path::Path;

use lanecraft_drive::plan::{Planner, PlannerConfig};
use lanecraft_drive::vehicle::VehicleParams;
use lanecraft_learn::irl::{IrlMethod, IrlNormalization, IrlVerdict};

use super::*;
use crate::candidates::CandidateConfig;
use crate::data::events::read_events;
use crate::demonstrations::Demonstrations;
use crate::demonstrations::synthetic::{SyntheticConfig, synthetic};

fn made_up(config: &CandidateConfig, seed: u64, count: u32) -> Choices {
    Choices::new(&synthetic(&SyntheticConfig::default(), config, seed, count), config)
}

fn paper(seed: u64, count: u32) -> Choices {
    made_up(&CandidateConfig::paper(), seed, count)
}

fn known() -> RewardModel {
    SyntheticConfig::default().known_reward(&CandidateConfig::paper().definition)
}

fn judge(model: &RewardModel, train: &Choices, test: &Choices) -> Judgment {
    Judgment::new(&test.config, &outcomes(model, train, test).unwrap())
}

#[test]
fn known_weights_are_recovered_in_what_they_predict() {
    let (train, test) = (paper(1, 50), paper(2, 200));
    // Drivers who are so sure of durations among so many need less ridge than people.
    let config = IrlConfig { ridge_choice: RidgeChoice::CrossValidation, ..IrlConfig::default() };
    let report = fit_and_test(&train, &test, &config).unwrap();
    let truth = judge(&known(), &train, &test);
    // Fifty choices leave four weights an expected loss of about 4/(2·50) = 0.04 per choice (Wilks); three times that.
    let (found, best) = (report.unseen.log_likelihood.mean, truth.log_likelihood.mean);
    assert!(found > best - 0.12, "{found} against {best}");
    assert!(report.unseen.log_likelihood.mean > report.unseen.uniform + 0.5);
    assert!(report.unseen.duration_error_s.mean < truth.duration_error_s.mean + 0.05);
    // Drivers who do as the model says are where it says: within a tenth at each level.
    for (level, observed) in truth.calibration.predicted.iter().zip(&truth.calibration.observed) {
        assert!((observed.mean - level).abs() < 0.1 && observed.low <= observed.high, "{level} {observed:?}");
    }
    assert!(truth.end_point_error_m.mean < truth.constant_end_point_error_m.mean);
}

/// Cosine between the true weights and those found, both of features of unit spread.
fn cosine(fit: &IrlFit, model: &RewardModel) -> f64 {
    let names = &CandidateConfig::paper().features;
    let truth: Vec<f64> = names
        .iter()
        .zip(&fit.scales)
        .map(|(name, scale)| {
            let index = model.features.iter().position(|known| known == name);
            index.map_or(0.0, |index| model.weights[index] / model.scale[index] * scale)
        })
        .collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let found = &fit.normalized_weights;
    dot(found, &truth) / (dot(found, found) * dot(&truth, &truth)).sqrt()
}

#[test]
fn the_direction_of_known_weights_is_found_from_many_drivers() {
    // The long test, of 20 seeds and 5 000 drivers, asks for 0.99.
    let long = std::env::var_os("LANECRAFT_LONG").is_some();
    let (seeds, drivers, wanted) = if long { (20, 5_000, 0.99) } else { (3, 500, 0.9) };
    let exact = SyntheticConfig { duration_noise_s: 0.0, end_noise_m: 0.0, ..SyntheticConfig::default() };
    let config = CandidateConfig::paper();
    let mut cosines: Vec<f64> = (0..seeds)
        .map(|seed| {
            let choices = Choices::new(&synthetic(&exact, &config, 100 + seed, drivers), &config);
            let problem = Problem::new(&choices.sets(), &choices.labels(), &IrlConfig::default()).unwrap();
            let begun = std::time::Instant::now();
            let fit = problem.fit(&IrlConfig::default()).unwrap();
            println!("fit of {drivers} in {:?}: cosine {:.4}", begun.elapsed(), cosine(&fit, &known()));
            assert_eq!(fit.verdict, IrlVerdict::Converged);
            cosine(&fit, &known())
        })
        .collect();
    cosines.sort_by(f64::total_cmp);
    let median = cosines[cosines.len() / 2];
    println!("median cosine {median:.4}");
    assert!(median > wanted, "{cosines:?}");
}

#[test]
fn the_papers_test_meets_its_figures_on_synthetic_drivers() {
    let judged = page::papers_test_judgment(&IrlConfig::default()).unwrap();
    println!("the paper's test on synthetic drivers: {:#?}", judged.features);
    let [_, collision, _, travel] = &judged.features[..] else { panic!("four features") };
    assert!(collision.ratio_of_means_error.mean <= 0.1 && travel.ratio_of_means_error.mean <= 0.1);
    for error in &judged.features {
        assert!(error.mean_absolute_error.mean >= 0.3 * error.ratio_of_means_error.mean);
    }
}

#[test]
fn the_model_scores_as_the_fit_does_and_drives_the_planner() {
    let train = paper(5, 30);
    let sets = train.sets();
    for normalization in [IrlNormalization::ZScore, IrlNormalization::Mean, IrlNormalization::None] {
        let config = IrlConfig { normalization, bootstrap_replicates: 20, ..IrlConfig::default() };
        let report = fit(&train, &config).unwrap();
        let judged = judge(&report.model, &train, &train);
        assert!((judged.log_likelihood.mean - report.fit.log_likelihood_per_event).abs() < 1e-9);
        let mut single = 0.0;
        for set in &sets {
            single += report.fit.log_likelihood(set).unwrap() / sets.len() as f64;
        }
        assert!((judged.log_likelihood.mean - single).abs() < 1e-9);
        assert_eq!(report.weights.len(), 4);
        assert!(report.weights.iter().all(|w| w.low <= w.high));
        let planner = PlannerConfig::default().with_reward(&report.model);
        assert!(Planner::new(&planner, &VehicleParams::default()).is_ok());
        let text = serde_json::to_string(&report).unwrap();
        assert_eq!(serde_json::from_str::<IrlReport>(&text).unwrap(), report);
    }
}

#[test]
fn candidates_over_three_ends_and_all_features_can_be_learned_from() {
    let config = CandidateConfig { duration_step_s: 0.5, duration_max_s: 6.0, ..CandidateConfig::default().wide() };
    let irl =
        IrlConfig { bootstrap_replicates: 20, ridge_choice: RidgeChoice::CrossValidation, ..IrlConfig::default() };
    let report = fit_and_test(&made_up(&config, 6, 60), &made_up(&config, 7, 60), &irl).unwrap();
    assert_eq!((report.fit.verdict, report.weights.len()), (IrlVerdict::Converged, 9));
    assert!(report.unseen.duration_log_likelihood.mean > report.unseen.uniform_duration + 0.5);
    assert!(report.unseen.duration_log_likelihood.mean >= report.unseen.log_likelihood.mean);
    assert_eq!(report.ridges.len(), irl.ridges.len());
}

#[test]
fn algorithm_2_to_the_letter_is_far_from_converged_and_with_means_it_is_near() {
    // Up to 4 s, about as far as Eq. 15 lets the paper's candidates go; with longer ones the printed settings are far from the end.
    let train = made_up(&CandidateConfig { duration_max_s: 4.0, ..CandidateConfig::paper() }, 8, 50);
    let letter = IrlConfig {
        method: IrlMethod::GradientAscent,
        normalization: IrlNormalization::Mean,
        ridge: 0.0,
        ..IrlConfig::default()
    };
    let newton = IrlConfig { method: IrlMethod::Newton, ..letter.clone() };
    let of = |config: &IrlConfig| learn(&train, config).map(|(_, fit, _)| fit.log_likelihood_per_event);
    let best = of(&newton).unwrap();
    assert!(of(&letter).unwrap() > best - 0.1, "{:?} {best}", of(&letter));
    let raw = IrlConfig { normalization: IrlNormalization::None, ..letter };
    assert!(of(&raw).is_err() || of(&raw).unwrap() < best - 0.2, "{:?} {best}", of(&raw));
}

#[test]
fn nothing_to_learn_from_or_to_judge_by_is_an_error() {
    let irl = IrlConfig::default();
    assert_eq!(fit(&paper(6, 0), &irl), Err(LearnError::Empty));
    let one = paper(6, 1);
    assert_eq!(fit(&one, &irl), Err(LearnError::OneGroup { group: "driver 0".into() }));
    assert_eq!(outcomes(&known(), &one, &paper(6, 0)), Err(LearnError::Empty));
}

#[test]
fn recorded_drivers_are_predicted_better_than_by_their_durations() {
    let Ok(data) = std::env::var("LANECRAFT_DATA") else {
        println!("skipped: LANECRAFT_DATA names no folder with recorded lane changes");
        return;
    };
    let events = read_events(&Path::new(&data).join("ngsim-lane-changes")).unwrap();
    let choices = Choices::new(&Demonstrations::recorded(&events), &CandidateConfig::paper());
    // The figures of the published extraction: 28 freeway changes, −ln 86 and the density of the other drivers' durations.
    let judged = |irl: &IrlConfig| Judgment::new(&choices.config, &leave_one_group_out(&choices, irl).unwrap());
    let fixed = judged(&IrlConfig::default());
    assert_eq!(fixed.events, 28);
    assert!((fixed.uniform + libm::log(86.0)).abs() < 1e-12 && (fixed.duration_density + 4.16).abs() < 0.005);
    assert!(fixed.log_likelihood.mean >= -4.0, "{:?}", fixed.log_likelihood);
    // To choose the ridge by nine sites costs a little of it.
    let chosen = judged(&IrlConfig { ridge_choice: RidgeChoice::CrossValidation, ..IrlConfig::default() });
    assert!(chosen.log_likelihood.mean > chosen.duration_density + 0.05, "{:?}", chosen.log_likelihood);
}
