//! Laws of the likelihood, recovery of known weights and refusals.

use super::objective::{Choices, Objective};
use super::{
    CandidateSet, IrlConfig, IrlError, IrlFit, IrlMethod, IrlNormalization, IrlVerdict, Problem, RidgeChoice, fit,
};
use lanecraft_net::random::Stream;

/// Features of very different sizes, as mean squares of angles and proximity sums are.
const SIZES: [f64; 4] = [1e-3, 10.0, 1.0, 0.1];
const TRUE_WEIGHTS: [f64; 4] = [-1.0, -0.5, -0.3, -0.8];

/// Events whose choices follow `TRUE_WEIGHTS` (in units of `SIZES`).
fn sampled(count: usize, seed: u64) -> Vec<CandidateSet> {
    let mut stream = Stream::new(seed, "events");
    (0..count).map(|_| sampled_event(&mut stream)).collect()
}

fn sampled_event(stream: &mut Stream) -> CandidateSet {
    let features: Vec<Vec<f64>> =
        (0..12).map(|_| SIZES.iter().map(|size| size * (2.0 + stream.normal())).collect()).collect();
    let weights: Vec<f64> =
        features.iter().map(|h| libm::exp((0..4).map(|i| TRUE_WEIGHTS[i] * h[i] / SIZES[i]).sum())).collect();
    let mut left = stream.uniform() * weights.iter().sum::<f64>();
    let chosen = weights.iter().position(|weight| {
        left -= weight;
        left < 0.0
    });
    CandidateSet { features, chosen: chosen.unwrap_or(weights.len() - 1) }
}

/// The default, with its ridge by cross-validation.
fn validated() -> IrlConfig {
    IrlConfig { ridge_choice: RidgeChoice::CrossValidation, ..IrlConfig::default() }
}

fn cosine(x: &[f64], y: &[f64]) -> f64 {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    dot(x, y) / (dot(x, x) * dot(y, y)).sqrt()
}

#[test]
fn the_gradient_and_the_curvature_are_those_of_central_differences() {
    let choices = Choices::new(&sampled(20, 1), IrlNormalization::ZScore);
    // An event that counts twice, and one that does not.
    let counts: Vec<f64> = (0..20).map(|event| [2.0, 0.0, 1.0][event % 3]).collect();
    let objective = Objective::new(&choices, &counts, 0.3);
    let weights = [0.4, -0.7, 0.2, -1.1];
    let at = objective.evaluate(&weights);
    // For a step of 1e-5 the truncation is of the order 1e-10 and the rounding of the order 1e-11 · |Ω| / step.
    let step = 1e-5;
    for i in 0..4 {
        let moved = |shift: f64| {
            let mut weights = weights;
            weights[i] += shift;
            objective.evaluate(&weights)
        };
        let (up, down) = (moved(step), moved(-step));
        let numeric = (up.value - down.value) / (2.0 * step);
        assert!((numeric - at.gradient[i]).abs() < 1e-7 * (1.0 + numeric.abs()));
        for j in 0..4 {
            let numeric = -(up.gradient[j] - down.gradient[j]) / (2.0 * step);
            assert!((numeric - at.curvature[4 * i + j]).abs() < 1e-6 * (1.0 + numeric.abs()));
        }
    }
}

#[test]
fn known_weights_are_recovered_from_sampled_choices() {
    let found = fit(&sampled(5_000, 2), &IrlConfig::default()).unwrap();
    assert_eq!(found.verdict, IrlVerdict::Converged);
    assert!(found.iterations < 20, "{} iterations", found.iterations);
    let in_sizes: Vec<f64> = found.weights.iter().zip(SIZES).map(|(w, size)| w * size).collect();
    assert!(cosine(&in_sizes, &TRUE_WEIGHTS) > 0.99, "{in_sizes:?}");
    // The standard error of a weight is about 1/√(5000 · variance) = 0.02.
    assert!(in_sizes.iter().zip(TRUE_WEIGHTS).all(|(w, truth)| (w - truth).abs() < 0.1), "{in_sizes:?}");
    assert!(found.log_likelihood_per_event > found.uniform_log_likelihood_per_event + 0.3);
}

#[test]
fn the_start_does_not_matter_and_the_maximum_is_one() {
    // The objective is concave: along any line through the maximum it falls on both sides.
    let events = sampled(60, 3);
    let config = IrlConfig::default();
    let found = fit(&events, &config).unwrap();
    let (choices, counts) = (Choices::new(&events, IrlNormalization::ZScore), vec![1.0; events.len()]);
    let objective = Objective::new(&choices, &counts, 0.1);
    let top = objective.evaluate(&found.normalized_weights).value;
    let mut stream = Stream::new(4, "directions");
    for _ in 0..50 {
        let direction: Vec<f64> = (0..4).map(|_| stream.normal()).collect();
        let value = |t: f64| {
            let at: Vec<f64> = found.normalized_weights.iter().zip(&direction).map(|(w, d)| w + t * d).collect();
            objective.evaluate(&at).value
        };
        assert!(value(0.1) < top && value(-0.1) < top && value(0.2) < value(0.1) && value(-0.2) < value(-0.1));
        assert!(value(0.1) >= 0.5 * (top + value(0.2)));
    }
}

#[test]
fn algorithm_2_reaches_the_same_weights_with_the_printed_settings() {
    let events = sampled(50, 5);
    let shared = IrlConfig { normalization: IrlNormalization::Mean, ridge: 0.0, ..IrlConfig::default() };
    let newton = fit(&events, &shared).unwrap();
    let ascent = fit(&events, &IrlConfig { method: IrlMethod::GradientAscent, ..shared }).unwrap();
    assert_eq!(ascent.iterations, 150);
    assert!((newton.log_likelihood_per_event - ascent.log_likelihood_per_event).abs() < 1e-3);
    assert!(cosine(&newton.normalized_weights, &ascent.normalized_weights) > 0.99);
}

#[test]
fn weights_of_zero_make_all_candidates_equal() {
    let events = sampled(1, 6);
    let choices = Choices::new(&events, IrlNormalization::ZScore);
    let objective = Objective::new(&choices, &[1.0], 0.0);
    let at = objective.evaluate(&[0.0; 4]);
    assert!((at.log_likelihood + libm::log(12.0)).abs() < 1e-12);
    let found = IrlFit { weights: vec![0.0; 4], ..fit(&events, &IrlConfig::default()).unwrap() };
    assert!(found.probabilities(&events[0]).unwrap().iter().all(|p| (p - 1.0 / 12.0).abs() < 1e-12));
    assert_eq!(found.best(&events[0]).unwrap(), 0);
}

#[test]
fn probabilities_follow_the_raw_weights() {
    let events = sampled(200, 7);
    let found = fit(&events, &IrlConfig::default()).unwrap();
    let mut total = 0.0;
    for event in &events {
        let probabilities = found.probabilities(event).unwrap();
        assert!((probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let best = found.best(event).unwrap();
        assert!(probabilities.iter().all(|p| *p <= probabilities[best]));
        total += libm::log(probabilities[event.chosen]);
        assert!((found.log_likelihood(event).unwrap() - libm::log(probabilities[event.chosen])).abs() < 1e-9);
    }
    assert!((total / 200.0 - found.log_likelihood_per_event).abs() < 1e-9);
}

#[test]
fn a_feature_that_never_varies_gets_no_weight_and_harms_nothing() {
    for ridge in [0.0, 0.1] {
        let config = IrlConfig { ridge, ..IrlConfig::default() };
        let events = sampled(100, 8);
        let mut with_constant = events.clone();
        for features in with_constant.iter_mut().flat_map(|event| &mut event.features) {
            features.push(0.1);
        }
        let (plain, found) = (fit(&events, &config).unwrap(), fit(&with_constant, &config).unwrap());
        assert_eq!(found.verdict, IrlVerdict::Converged);
        assert_eq!((found.weights[4], found.normalized_weights[4]), (0.0, 0.0));
        assert!(plain.weights.iter().zip(&found.weights).all(|(x, y)| (x - y).abs() <= 1e-6 * x.abs()));
    }
}

#[test]
fn the_ridge_keeps_weights_finite_where_the_choices_are_certain() {
    // The lowest value is always chosen, so without a penalty the weight has no bound.
    let events: Vec<CandidateSet> =
        (0..10).map(|_| CandidateSet { features: vec![vec![1.0], vec![2.0], vec![3.0]], chosen: 0 }).collect();
    let found = fit(&events, &IrlConfig::default()).unwrap();
    assert_eq!(found.verdict, IrlVerdict::Converged);
    assert!(found.weights[0] < 0.0 && found.weights[0] > -20.0);
}

#[test]
fn an_ascent_with_too_large_steps_is_not_called_converged() {
    let config = IrlConfig { method: IrlMethod::GradientAscent, learning_rate: 50.0, ..IrlConfig::default() };
    match fit(&sampled(50, 9), &config) {
        Ok(found) => assert_eq!(found.verdict, IrlVerdict::NotConverged),
        Err(refused) => assert!(matches!(refused, IrlError::Diverged { .. })),
    }
}

#[test]
fn events_that_cannot_be_fitted_are_refused() {
    let config = IrlConfig::default();
    let set =
        |features: &[&[f64]], chosen| CandidateSet { features: features.iter().map(|h| h.to_vec()).collect(), chosen };
    let refused = |sets: &[CandidateSet]| fit(sets, &config).unwrap_err();
    assert_eq!(refused(&[]), IrlError::NoEvents);
    assert_eq!(refused(&[set(&[&[1.0]], 0), set(&[], 0)]), IrlError::EmptySet { event: 1 });
    assert_eq!(refused(&[set(&[&[1.0]], 1)]), IrlError::Chosen { event: 0, chosen: 1, count: 1 });
    let lengths = IrlError::FeatureCount { event: 0, candidate: 1, expected: 1, found: 2 };
    assert_eq!(refused(&[set(&[&[1.0], &[1.0, 2.0]], 0)]), lengths);
    assert!(matches!(refused(&[set(&[&[]], 0)]), IrlError::FeatureCount { .. }));
    assert!(matches!(refused(&[set(&[&[1.0], &[f64::NAN]], 0)]), IrlError::Feature { candidate: 1, .. }));
    assert!(matches!(refused(&[set(&[&[1e101], &[-1e101]], 0)]), IrlError::Feature { candidate: 0, .. }));
    let bad = IrlConfig { ridge: f64::NAN, ..config.clone() };
    let falling = IrlConfig { ridges: vec![1.0, 0.1], ..config.clone() };
    assert!(matches!(fit(&sampled(2, 1), &falling), Err(IrlError::Config(config)) if config.key == "irl.ridges"));
    let refused = fit(&sampled(2, 1), &bad).unwrap_err();
    assert!(matches!(refused, IrlError::Config(config) if config.key == "irl.ridge"));
}

#[test]
fn cross_validation_prefers_little_ridge_for_much_data_and_more_for_less() {
    let chosen = |count: usize| fit(&sampled(count, 10), &validated()).unwrap().ridge;
    let ridges = IrlConfig::default().ridges;
    assert!(ridges.contains(&chosen(8)) && chosen(8) >= 1.0, "{}", chosen(8));
    // With 2 000 events a ridge of 10 shrinks the weights by about 10/(2 000 · variance) and so by more than their error.
    assert!(chosen(2_000) < 10.0, "{}", chosen(2_000));
}

#[test]
fn cross_validation_judges_each_fold_by_the_others() {
    let config = IrlConfig { ridges: vec![0.5], folds: 2, ..IrlConfig::default() };
    let events = sampled(6, 11);
    let groups = ["a", "b", "a", "b", "c", "c"];
    let problem = Problem::new(&events, &groups, &config).unwrap();
    // Groups a and c are one fold, b is the other; a fit of each on the other's events in the normalization of all.
    let choices = Choices::new(&events, config.normalization);
    let mut expected = 0.0;
    for (train, test) in
        [([1.0, 0.0, 1.0, 0.0, 1.0, 1.0], [1, 3].as_slice()), ([0.0, 1.0, 0.0, 1.0, 0.0, 0.0], &[0, 2, 4, 5])]
    {
        let objective = Objective::new(&choices, &train, 0.5);
        let weights = super::solve::newton(&objective, vec![0.0; 4], 100, 1e-9).weights;
        expected += test.iter().map(|event| choices.log_likelihood(*event, &weights)).sum::<f64>() / 6.0;
    }
    let found = problem.cross_validate(&config)[0].log_likelihood;
    assert!((found - expected).abs() < 1e-6, "{found} {expected}");
}

#[test]
fn bootstrap_intervals_are_as_wide_as_the_weights_scatter() {
    let config = IrlConfig { bootstrap_replicates: 100, ..IrlConfig::default() };
    let spread = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / values.len() as f64).sqrt()
    };
    let events = sampled(300, 12);
    let groups: Vec<usize> = (0..events.len()).collect();
    let problem = Problem::new(&events, &groups, &config).unwrap();
    let drawn = problem.bootstrap(&problem.fit(&config).unwrap(), &config);
    let fits: Vec<Vec<f64>> =
        (0..40).map(|seed| fit(&sampled(300, 100 + seed), &config).unwrap().normalized_weights).collect();
    for feature in 0..4 {
        let of = |sets: &[Vec<f64>]| spread(&sets.iter().map(|weights| weights[feature]).collect::<Vec<_>>());
        // Of 100 and 40 draws a standard deviation is known to about a tenth each.
        assert!((0.6..1.7).contains(&(of(&drawn) / of(&fits))), "{feature}: {} {}", of(&drawn), of(&fits));
    }
}

#[test]
fn what_cannot_be_told_apart_is_seen_in_the_singular_values() {
    let mut events = sampled(50, 13);
    for features in events.iter_mut().flat_map(|event| &mut event.features) {
        // The fifth is twice the first; the sixth differs between events alone, as a speed does.
        features.push(2.0 * features[0]);
    }
    for (number, event) in events.iter_mut().enumerate() {
        event.features.iter_mut().for_each(|features| features.push(number as f64));
    }
    let groups: Vec<usize> = (0..events.len()).collect();
    let found = Problem::new(&events, &groups, &IrlConfig::default()).unwrap().identifiability();
    assert!((found.correlations[0][4] - 1.0).abs() < 1e-9 && found.correlations[0][1].abs() < 0.2);
    assert_eq!((found.correlations[5][5], found.singular_values.len()), (0.0, 6));
    assert!(found.singular_values.windows(2).all(|pair| pair[0] >= pair[1]));
    // Independent features of unit variance: √(50 · 12) each, √2 of it for the doubled one, and twice nothing.
    assert!((found.singular_values[0] / (600.0_f64 * 2.0).sqrt() - 1.0).abs() < 0.15);
    assert!(found.singular_values[4] < 1e-5 && found.singular_values[5] < 1e-5);
}

#[test]
fn features_left_as_they_come_make_the_printed_learning_rate_diverge() {
    let config = IrlConfig {
        method: IrlMethod::GradientAscent,
        normalization: IrlNormalization::None,
        ridge: 0.0,
        ..IrlConfig::default()
    };
    match fit(&sampled(50, 5), &config) {
        Ok(found) => {
            assert_eq!(found.verdict, IrlVerdict::NotConverged);
            assert!(found.log_likelihood_per_event < found.uniform_log_likelihood_per_event);
        }
        Err(refused) => assert!(matches!(refused, IrlError::Diverged { .. })),
    }
}
