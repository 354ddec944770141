//! What training and judging leave: tables, figures and a page.

use lanecraft_drive::predict::Predictor;

use super::errors::{Errors, JUDGED_S};
use super::swap::Swap;
use super::train::EpochPoint;
use crate::metrics::Interval;
use crate::report::svg::{Axis, Plot};
use crate::stats::StatsError;
use crate::studies::{Figure, StudyReport, Table};

/// Time that the verdict is about, s.
const VERDICT_S: f64 = 2.0;

/// A page on how far the predictors are off, one table and one figure for each named kind of traffic.
///
/// # Errors
/// If a kind has fewer than two vehicles.
pub fn report(found: &[(&str, Errors)]) -> Result<StudyReport, StatsError> {
    let mut report = StudyReport {
        name: "predictor",
        title: "How far the predictors are off".to_owned(),
        summary: String::new(),
        tables: Vec::new(),
        figures: Vec::new(),
    };
    let mut verdicts = Vec::new();
    for (kind, errors) in found {
        verdicts.push(verdict(kind, errors)?);
        report.tables.push(table(kind, errors)?);
        report.figures.push(figure(kind, errors)?);
    }
    report.summary = verdicts.join(" ");
    Ok(report)
}

/// Whether the network is better than every baseline at [`VERDICT_S`], in a sentence.
fn verdict(kind: &str, errors: &Errors) -> Result<String, StatsError> {
    let rows: Vec<_> = errors.rows()?.into_iter().filter(|row| row.horizon_s == VERDICT_S).collect();
    let lstm_m = rows.iter().find(|row| row.predictor == "lstm").map_or(f64::NAN, |row| row.error_m.mean);
    let beaten = rows.iter().filter(|row| row.predictor != "lstm");
    let unbeaten: Vec<&str> = beaten.filter(|row| row.behind_lstm_m.low <= 0.0).map(|row| row.predictor).collect();
    let verdict = if unbeaten.is_empty() {
        "nearer than every baseline, with the whole interval".to_owned()
    } else {
        format!("not clearly better than {}", unbeaten.join(", "))
    };
    let vehicles = errors.vehicles();
    Ok(format!("On {kind} ({vehicles} vehicles), after {VERDICT_S} s lstm is {lstm_m:.2} m off: {verdict}."))
}

fn table(kind: &str, errors: &Errors) -> Result<Table, StatsError> {
    let caption = format!(
        "Displacement error in m on {kind}: mean over {} vehicles with 95 % interval ({} forecasts); behind: how much further off than lstm",
        errors.vehicles(),
        errors.forecasts()
    );
    let mut table =
        Table::new(&kind.replace(' ', "-"), &caption, &["predictor", "after s", "error m", "behind lstm m"]);
    for row in errors.rows()? {
        let cells = [row.error_m, row.behind_lstm_m].map(|interval| cell(interval, 2));
        let [error, behind] = cells;
        table.rows.push(vec![row.predictor.to_owned(), format!("{}", row.horizon_s), error, behind]);
    }
    Ok(table)
}

fn cell(Interval { mean, low, high }: Interval, decimals: usize) -> String {
    format!("{mean:.decimals$} [{low:.decimals$}, {high:.decimals$}]")
}

fn figure(kind: &str, errors: &Errors) -> Result<Figure, StatsError> {
    let rows = errors.rows()?;
    let x = Axis::over("after, s", JUDGED_S.into_iter().chain([0.0]));
    let mut plot = Plot::new(x, Axis::over("displacement error, m", rows.iter().map(|r| r.error_m.high).chain([0.0])));
    let mut legend = Vec::new();
    for (series, of) in rows.chunks(JUDGED_S.len()).enumerate() {
        let line: Vec<[f64; 2]> = of.iter().map(|row| [row.horizon_s, row.error_m.mean]).collect();
        plot.line(&line, series);
        for point in &line {
            plot.point(*point, series);
        }
        legend.push((of[0].predictor.to_owned(), series));
    }
    let svg = plot
        .finish(&format!("Displacement error over time for each predictor on {kind}; the numbers are in the table."));
    Ok(Figure { name: kind.replace(' ', "-"), title: format!("Displacement error on {kind}"), svg, legend })
}

/// A curve's name and figure.
type Curve = (&'static str, fn(&EpochPoint) -> f64);

/// A page on a training run.
pub(super) fn training_report(points: &[EpochPoint], samples: &str) -> StudyReport {
    let losses = || points.iter().flat_map(|point| [point.loss, point.validation_loss]);
    let x = Axis::over("epochs", points.iter().map(|point| f64::from(point.epoch)).chain([0.0]));
    let mut plot = Plot::new(x, Axis::over("loss", losses().chain([0.0])));
    let curves: [Curve; 2] = [("learned from", |p| p.loss), ("watched only", |p| p.validation_loss)];
    for (series, (_, of)) in curves.iter().enumerate() {
        let line: Vec<[f64; 2]> = points.iter().map(|point| [f64::from(point.epoch), of(point)]).collect();
        plot.line(&line, series);
    }
    let last = points.last().map_or(f64::NAN, |point| point.validation_loss);
    let legend = curves.iter().enumerate().map(|(series, (name, _))| ((*name).to_owned(), series)).collect();
    let figure = Figure {
        name: "loss".to_owned(),
        title: "Loss".to_owned(),
        svg: plot.finish(&format!("Loss over epochs; the last of what is watched only is {last:.4}.")),
        legend,
    };
    StudyReport {
        name: "training",
        title: "The predictor's training".to_owned(),
        summary: format!("{samples} The loss of what is only watched ends at {last:.4}."),
        tables: Vec::new(),
        figures: vec![figure],
    }
}

/// A page on what the predictors do for a drive.
pub fn swap_report(swaps: &[Swap]) -> StudyReport {
    let episodes = swaps.first().map_or(0, |swap| swap.result.episodes);
    let caption = format!(
        "Each policy with each predictor in planner and controllers: mean over {episodes} paired scenarios with 95 % interval"
    );
    let head = [
        "policy",
        "predictor",
        "reward/tick",
        "lead over constant-velocity",
        "collisions",
        "changes/min",
        "refusals/min",
        "guard/min",
        "min TTC s",
    ];
    let mut table = Table::new("swap", &caption, &head);
    for swap in swaps {
        let result = &swap.result;
        let figures = [
            (result.reward_per_tick, 2),
            (swap.reward_lead, 3),
            (result.collisions_per_episode, 3),
            (result.lane_changes_per_min, 2),
            (result.refusals_per_min, 2),
            (result.guard_interventions_per_min, 2),
            (result.min_time_to_collision_s, 2),
        ];
        let cells = figures.into_iter().map(|(interval, decimals)| cell(interval, decimals));
        table.rows.push([result.policy.clone(), swap.predictor.to_owned()].into_iter().chain(cells).collect());
    }
    let baseline = Predictor::default().name();
    let leads: Vec<String> = swaps.iter().filter(|swap| swap.predictor != baseline).map(lead).collect();
    StudyReport {
        name: "predictor",
        title: "What a forecast does for the drive".to_owned(),
        summary: leads.join(" "),
        tables: vec![table],
        figures: Vec::new(),
    }
}

fn lead(swap: &Swap) -> String {
    let Interval { low, high, .. } = swap.reward_lead;
    let verdict = match swap.reward_lead {
        _ if low > 0.0 => "earns more than",
        _ if high < 0.0 => "earns less than",
        _ => "is not told apart from",
    };
    let (policy, predictor, lead) = (&swap.result.policy, swap.predictor, cell(swap.reward_lead, 3));
    format!("{policy} with {predictor} {verdict} with constant velocity: {lead} reward per tick.")
}
