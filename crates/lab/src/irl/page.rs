//! The judgment of a reward as tables and figures.

use lanecraft_drive::plan::{FeatureConfig, FeatureUnits};
use lanecraft_learn::irl::{IrlConfig, RidgeChoice};

use super::{Fan, IrlReport, Judgment, LearnError, Outcome, fit_and_test, gain, leave_one_group_out, table_iv};
use crate::candidates::{CandidateConfig, Choices};
use crate::demonstrations::Demonstrations;
use crate::demonstrations::synthetic::{SyntheticConfig, synthetic};
use crate::metrics::Interval;
use crate::report::svg::{Axis, Plot};
use crate::studies::{Figure, StudyReport, Table};

/// Everything that is said of the reward of the drivers of `demonstrations`: what it predicts of groups left out, on the paper's features
/// and candidates and on wider ones; its weights and features on those of `config`; Table IV, and the paper's test on synthetic drivers.
///
/// # Errors
/// If there are fewer than two groups, or a fit fails.
pub fn judged(
    demonstrations: &Demonstrations,
    config: &CandidateConfig,
    irl: &IrlConfig,
) -> Result<StudyReport, LearnError> {
    let choices = Choices::new(demonstrations, config);
    let report = super::fit(&choices, irl)?;
    let tables = vec![
        comparison(demonstrations, config, irl)?,
        feature_errors(&report.unseen),
        weights(&report),
        correlations(&report),
        table_iv_again(),
        papers_test(irl)?,
    ];
    let summary = format!("{} {}", reading(&report), table_iv::STATEMENT);
    Ok(StudyReport {
        name: "human-reward",
        title: format!("Reward of {}", demonstrations.source),
        summary,
        tables,
        figures: figures(&report.unseen),
    })
}

/// What was predicted, in a few sentences.
fn reading(report: &IrlReport) -> String {
    let unseen = &report.unseen;
    format!(
        "{} lane changes of {} groups, one group left out in turn. The duration of an unseen driver has a log-likelihood of {}; all \
         durations alike {:.2}, a density of the other drivers' durations {:.2}. The gain on that density is {} per driver. Weights are no \
         finding: the smallest singular value of the features is {:.2}, the largest {:.1}.",
        unseen.events,
        unseen.groups,
        with_interval(unseen.duration_log_likelihood, 2),
        unseen.uniform_duration,
        unseen.duration_density,
        with_interval(unseen.gain_on_density, 2),
        report.identifiability.singular_values.last().copied().unwrap_or(0.0),
        report.identifiability.singular_values.first().copied().unwrap_or(0.0),
    )
}

fn with_interval(interval: Interval, decimals: usize) -> String {
    let Interval { mean, low, high } = interval;
    format!("{mean:.decimals$} ({low:.decimals$} to {high:.decimals$})")
}

/// The paper's features and candidates, all there are, and what lies between.
fn comparison(demonstrations: &Demonstrations, config: &CandidateConfig, irl: &IrlConfig) -> Result<Table, LearnError> {
    let mut table = Table::new(
        "judgment",
        "Groups left out: log-likelihood of a driver's duration, gain on the first row, errors of duration and of the end point",
        &[
            "features, candidates",
            "candidates",
            "log-likelihood of the duration",
            "gain",
            "error of t_c s",
            "end point, best of 3, m",
        ],
    );
    let paper = CandidateConfig {
        driver_duration: config.driver_duration,
        definition: config.definition.clone(),
        ..CandidateConfig::paper()
    };
    let wide = paper.clone().wide();
    let validated = IrlConfig { ridge_choice: RidgeChoice::CrossValidation, ..irl.clone() };
    let all = CandidateConfig { features: wide.features.clone(), ..paper.clone() };
    let ends = CandidateConfig { features: paper.features.clone(), ..wide.clone() };
    let cases = [
        ("paper's, paper's", &paper, irl),
        ("the same, ridge by cross-validation", &paper, &validated),
        ("all, paper's, ridge by cross-validation", &all, &validated),
        ("paper's, over three ends, by cross-validation", &ends, &validated),
        ("all, over three ends, by cross-validation", &wide, &validated),
    ];
    let mut first: Option<Vec<Outcome>> = None;
    for (name, case, irl) in cases {
        let choices = Choices::new(demonstrations, case);
        let outcomes = leave_one_group_out(&choices, irl)?;
        let judged = Judgment::new(case, &outcomes);
        let gained = first.as_ref().map_or_else(String::new, |first| with_interval(gain(&outcomes, first), 2));
        let count = choices.items[0].candidates.motions.len();
        table.rows.push(vec![
            name.to_owned(),
            count.to_string(),
            with_interval(judged.duration_log_likelihood, 2),
            gained,
            with_interval(judged.duration_error_s, 2),
            with_interval(judged.end_point_error_m, 2),
        ]);
        if first.is_none() {
            table.rows.extend(baselines(&judged));
            first = Some(outcomes);
        }
    }
    Ok(table)
}

/// What is known without a reward.
fn baselines(judged: &Judgment) -> [Vec<String>; 3] {
    let row = |name: &str, cells: [String; 3]| {
        let [likelihood, error, end_point] = cells;
        vec![name.to_owned(), String::new(), likelihood, String::new(), error, end_point]
    };
    let none = String::new;
    [
        row("all durations alike", [format!("{:.2}", judged.uniform_duration), none(), none()]),
        row("density of durations", [format!("{:.2}", judged.duration_density), none(), none()]),
        row(
            "constant duration and speed",
            [
                none(),
                with_interval(judged.constant_duration_error_s, 2),
                with_interval(judged.constant_end_point_error_m, 2),
            ],
        ),
    ]
}

fn feature_errors(judged: &Judgment) -> Table {
    errors_table("features", "Features of the preferred candidate against the driver's, %", judged)
}

fn errors_table(name: &str, caption: &str, judged: &Judgment) -> Table {
    let mut table = Table::new(name, caption, &["feature", "error of the means %", "mean absolute error %"]);
    for error in &judged.features {
        let percent = |i: Interval| Interval { mean: 100.0 * i.mean, low: 100.0 * i.low, high: 100.0 * i.high };
        let cells = [error.ratio_of_means_error, error.mean_absolute_error].map(|i| with_interval(percent(i), 1));
        table.rows.push([vec![error.feature.clone()], cells.to_vec()].concat());
    }
    table
}

fn weights(report: &IrlReport) -> Table {
    let caption = format!(
        "Normalized weights, ridge {}, with 95 % intervals; by falling size the singular values",
        report.fit.ridge
    );
    let mut table = Table::new("weights", &caption, &["feature", "weight", "singular value"]);
    let values = report.weights.iter().zip(&report.identifiability.singular_values);
    for (name, (weight, singular)) in report.model.features.iter().zip(values) {
        table.rows.push(vec![name.clone(), with_interval(*weight, 2), format!("{singular:.2}")]);
    }
    table
}

fn correlations(report: &IrlReport) -> Table {
    let mut head = vec![""];
    head.extend(report.model.features.iter().map(String::as_str));
    let mut table = Table::new("correlations", "Correlations of the features within the candidates of a driver", &head);
    for (name, row) in report.model.features.iter().zip(&report.identifiability.correlations) {
        let cells = row.iter().map(|value| format!("{value:.2}"));
        table.rows.push(std::iter::once(name.clone()).chain(cells).collect());
    }
    table
}

fn table_iv_again() -> Table {
    let mut table = Table::new(
        "table-iv",
        "Table IV of the paper from its rows: errors, %",
        &["feature", "stated", "error of the means", "mean absolute error"],
    );
    let (ratio, absolute) = (table_iv::ratio_of_means_percent(), table_iv::mean_absolute_percent());
    for (column, name) in table_iv::COLUMNS.iter().enumerate() {
        let cells = [table_iv::STATED_PERCENT[column], ratio[column], absolute[column]];
        table.rows.push(std::iter::once((*name).to_owned()).chain(cells.map(|x| format!("{x:.2}"))).collect());
    }
    table
}

/// Drivers to learn from and to be judged by, as in the paper's test.
const PAPER_TRAIN: u32 = 50;
const PAPER_TEST: u32 = 10;

/// The paper's test on as many synthetic drivers, in the units of its table.
///
/// # Errors
/// If the fit fails.
pub fn papers_test_judgment(irl: &IrlConfig) -> Result<Judgment, LearnError> {
    let definition = FeatureConfig { sample_step_s: 0.05, units: FeatureUnits::Table, ..FeatureConfig::default() };
    let config = CandidateConfig { definition, ..CandidateConfig::paper() };
    let drivers = |seed, count| Choices::new(&synthetic(&SyntheticConfig::default(), &config, seed, count), &config);
    Ok(fit_and_test(&drivers(3, PAPER_TRAIN), &drivers(4, PAPER_TEST), irl)?.unseen)
}

fn papers_test(irl: &IrlConfig) -> Result<Table, LearnError> {
    let caption = format!(
        "The same on synthetic drivers of known weights, {PAPER_TRAIN} to learn from and {PAPER_TEST} to be judged by"
    );
    Ok(errors_table("paper-test", &caption, &papers_test_judgment(irl)?))
}

/// Calibration of the durations, and some drivers among their candidates.
pub fn figures(judged: &Judgment) -> Vec<Figure> {
    let mut figures = vec![calibration(judged)];
    figures.extend(judged.fans.iter().enumerate().map(|(number, fan)| fan_figure(number, fan)));
    figures
}

fn calibration(judged: &Judgment) -> Figure {
    let mut plot = Plot::new(
        Axis::exactly("level of the predicted distribution of t_c", 0.0, 1.0),
        Axis::exactly("share of unseen drivers below it", 0.0, 1.0),
    );
    plot.line(&[[0.0, 0.0], [1.0, 1.0]], 6);
    for (level, observed) in judged.calibration.predicted.iter().zip(&judged.calibration.observed) {
        plot.point_with_intervals(Interval { mean: *level, low: *level, high: *level }, *observed, 0);
    }
    let title = "Calibration of the predicted durations, with 95 % intervals".to_owned();
    let legend = vec![("unseen drivers".to_owned(), 0), ("right".to_owned(), 6)];
    Figure { name: "calibration".into(), svg: plot.finish(&title), title, legend }
}

fn fan_figure(number: usize, fan: &Fan) -> Figure {
    let lines = || fan.candidates.iter().map(|curve| &curve.points).chain([&fan.driver, &fan.preferred]);
    let axis = |name: &str, index: usize| Axis::over(name, lines().flatten().map(|point| point[index]));
    let mut plot = Plot::new(axis("along the road, m", 0), axis("to the left, m", 1));
    for curve in &fan.candidates {
        // What is unlikely is still to be seen.
        plot.faint_line(&curve.points, 6, 0.25 + 0.75 * curve.likelihood);
    }
    plot.line(&fan.preferred, 0);
    plot.line(&fan.driver, 1);
    let title = format!("{}: driver and preferred path among candidates, darker where more likely", fan.group);
    let legend = vec![("driver".to_owned(), 1), ("preferred".to_owned(), 0), ("candidates".to_owned(), 6)];
    Figure { name: format!("fan-{}", number + 1), svg: plot.finish(&title), title, legend }
}
