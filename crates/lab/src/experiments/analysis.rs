//! From rows to tables, figures and verdicts.

use super::definition::{Claim, Definition, Metric};
use super::rows::UnitRow;
use super::verdict::{Verdict, change_percent, lead};
use crate::metrics::{CurvePoint, Interval};
use crate::report::plots::{Outcome as Shown, reward_against_collisions};
use crate::report::svg::{Axis, Plot};
use crate::stats::{StatsError, Trend, mean_interval, rate_interval, spearman_trend};
use crate::studies::{Figure, StudyReport, Table};

/// The learning curves of a variant's seeds.
pub type Curves = Vec<(String, Vec<Vec<CurvePoint>>)>;

/// What a claim came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// What the paper says.
    pub claim: Claim,
    /// The relative change here, %, over seeds; none where there is nothing to compare.
    pub change_percent: Option<Interval>,
    /// What that says of the claim.
    pub verdict: Verdict,
}

/// Every claim of an experiment with what came of it.
///
/// # Errors
/// If a row holds a number that is not finite.
pub fn outcomes(definition: &Definition, rows: &[UnitRow]) -> Result<Vec<Outcome>, StatsError> {
    let judged = definition.claims.iter().map(|claim| {
        let change_percent = change_percent(claim.metric, &of(rows, &claim.variant), &of(rows, &claim.against))?;
        Ok(Outcome {
            claim: claim.clone(),
            change_percent,
            verdict: Verdict::new(change_percent, claim.change_percent),
        })
    });
    judged.collect()
}

/// Tables and figures of an experiment; `curves` may lack what was trained elsewhere.
///
/// # Errors
/// If a row holds a number that is not finite.
pub fn analyze(definition: &Definition, rows: &[UnitRow], curves: &Curves) -> Result<StudyReport, StatsError> {
    let outcomes = outcomes(definition, rows)?;
    let mut tables = vec![results(definition, rows)?];
    if !outcomes.is_empty() {
        tables.push(claims(&outcomes));
    }
    let mut figures = vec![safety(definition, rows)?];
    if curves.iter().any(|(_, seeds)| seeds.len() > 1) {
        figures.push(learning(curves)?);
    }
    let title = definition.title.clone();
    let summary = [Some(definition.summary.clone()), trends(definition, rows)?].into_iter().flatten();
    let summary = summary.collect::<Vec<_>>().join(" ");
    Ok(StudyReport { name: "experiment", title, summary, tables, figures })
}

/// All claims of several experiments on one page: paper, ours, interval, verdict.
pub fn overview(outcomes: &[Outcome]) -> StudyReport {
    let count = |verdict| outcomes.iter().filter(|outcome| outcome.verdict == verdict).count();
    let counts = [Verdict::Reproduced, Verdict::NotReproduced, Verdict::NotTestable]
        .map(|verdict| format!("{} {}", count(verdict), verdict.name()));
    StudyReport {
        name: "reproduction",
        title: "What the paper says, and what came out".to_owned(),
        summary: format!(
            "Of {} claims: {}. Reproduced is what lies on the paper's side of zero with its whole 95 % interval over training seeds; not testable \
             is what these runs cannot tell from zero nor from the paper's figure.",
            outcomes.len(),
            counts.join(", ")
        ),
        tables: vec![claims(outcomes)],
        figures: Vec::new(),
    }
}

/// Whether reward and collisions rise or fall with the variants' `x`, if all have one.
fn trends(definition: &Definition, rows: &[UnitRow]) -> Result<Option<String>, StatsError> {
    let place = |row: &UnitRow| definition.variants.iter().find(|variant| variant.name == row.variant)?.x;
    let Some(x) = rows.iter().map(place).collect::<Option<Vec<f64>>>() else { return Ok(None) };
    let mut sentences = Vec::new();
    for metric in [Metric::Reward, Metric::Collisions] {
        let trend = match spearman_trend(&x, &rows.iter().map(|row| metric.of(row)).collect::<Vec<_>>()) {
            // The same everywhere, such as no collision at all.
            Err(StatsError::Constant) => continue,
            trend => trend?,
        };
        let verdict = match trend {
            Trend { p_two_sided, .. } if p_two_sided > 0.05 => "shows no trend",
            Trend { rank_correlation, .. } if rank_correlation > 0.0 => "rises",
            _ => "falls",
        };
        let Trend { rank_correlation, p_two_sided, .. } = trend;
        sentences.push(format!(
            "Over all trainings, {} {verdict} (Spearman's rank correlation {rank_correlation:.2}, p = {p_two_sided:.3}).",
            metric.name()
        ));
    }
    Ok(Some(sentences.join(" ")))
}

fn of<'a>(rows: &'a [UnitRow], variant: &str) -> Vec<&'a UnitRow> {
    rows.iter().filter(|row| row.variant == variant).collect()
}

fn claims(outcomes: &[Outcome]) -> Table {
    let head = ["where", "claim", "paper %", "ours %", "verdict"];
    let mut table =
        Table::new("claims", "Relative changes: the paper's, and ours with 95 % interval over training seeds", &head);
    for Outcome { claim, change_percent, verdict } in outcomes {
        let Claim { source, metric, variant, against, change_percent: claimed } = claim;
        let statement = format!("{} of {variant} over {against}", metric.name());
        let ours = change_percent.map_or_else(|| "none".to_owned(), |change| cell(change, 1));
        table.rows.push(vec![source.clone(), statement, format!("{claimed:+.2}"), ours, verdict.name().to_owned()]);
    }
    table
}

/// A line for each variant: collisions beside speed and reward.
fn results(definition: &Definition, rows: &[UnitRow]) -> Result<Table, StatsError> {
    let caption = format!(
        "Means over training seeds with 95 % intervals (over scenarios where there is one seed); collisions pooled over seeds; lead: reward over {}",
        definition.reference
    );
    let head = [
        "variant",
        "seeds",
        "episodes",
        "reward/tick",
        "lead",
        "speed m/s",
        "collisions",
        "at fault",
        "changes/min",
        "refusals/min",
        "jerk m/s³",
    ];
    let mut table = Table::new("results", &caption, &head);
    let reference = of(rows, &definition.reference);
    for variant in &definition.variants {
        let own = of(rows, &variant.name);
        let lead = if variant.name == definition.reference { None } else { lead(Metric::Reward, &own, &reference)? };
        let plain = |value: &dyn Fn(&UnitRow) -> f64| {
            format!("{:.2}", own.iter().map(|row| value(row)).sum::<f64>() / own.len().max(1) as f64)
        };
        table.rows.push(vec![
            variant.name.clone(),
            own.len().to_string(),
            own.iter().map(|row| row.episodes).sum::<usize>().to_string(),
            cell(reward(&own)?, 2),
            lead.map_or_else(String::new, |lead| cell(lead, 2)),
            plain(&|row| row.speed_mps),
            cell(rate(&own, |row| row.collisions)?, 4),
            cell(rate(&own, |row| row.at_fault)?, 4),
            plain(&|row| row.lane_changes_per_min),
            plain(&|row| row.refusals_per_min),
            plain(&|row| row.jerk_mps3),
        ]);
    }
    Ok(table)
}

/// The reward's mean over seeds; of a single row with its own interval over scenarios.
fn reward(rows: &[&UnitRow]) -> Result<Interval, StatsError> {
    if let [row] = rows {
        return Ok(Interval { mean: row.reward_per_tick, low: row.reward_low, high: row.reward_high });
    }
    mean_interval(&rows.iter().map(|row| row.reward_per_tick).collect::<Vec<_>>())
}

fn rate(rows: &[&UnitRow], events: impl Fn(&UnitRow) -> usize) -> Result<Interval, StatsError> {
    rate_interval(rows.iter().map(|row| events(row)).sum(), rows.iter().map(|row| row.episodes).sum())
}

/// Reward against collisions.
fn safety(definition: &Definition, rows: &[UnitRow]) -> Result<Figure, StatsError> {
    let mut outcomes = Vec::new();
    for variant in &definition.variants {
        let own = of(rows, &variant.name);
        let (reward, collisions) = (reward(&own)?, rate(&own, |row| row.collisions)?);
        outcomes.push(Shown { name: &variant.name, collisions, reward });
    }
    Ok(Figure {
        name: "safety".to_owned(),
        title: "Reward against collisions: better is up and to the left".to_owned(),
        svg: reward_against_collisions(&outcomes, &(0..outcomes.len()).collect::<Vec<_>>()),
        legend: legend(definition.variants.iter().map(|variant| &variant.name)),
    })
}

fn legend<'a>(names: impl Iterator<Item = &'a String>) -> Vec<(String, usize)> {
    names.enumerate().map(|(series, name)| (name.clone(), series)).collect()
}

/// Learning curves: the mean over seeds and its interval.
fn learning(curves: &Curves) -> Result<Figure, StatsError> {
    let mut bands = Vec::new();
    for (name, seeds) in curves {
        let mut band = Vec::new();
        for point in seeds.first().into_iter().flatten() {
            // Points of equal decisions; a seed without one at this place leaves it out.
            let at = |curve: &Vec<CurvePoint>| curve.iter().find(|other| other.decisions == point.decisions).copied();
            let rewards: Vec<f64> = seeds.iter().filter_map(at).map(|point| point.reward_per_tick).collect();
            if rewards.len() == seeds.len() && rewards.len() > 1 {
                band.push((point.decisions as f64, mean_interval(&rewards)?));
            }
        }
        bands.push((name.clone(), band));
    }
    let all = || bands.iter().flat_map(|(_, band)| band);
    let x = Axis::over("decisions", all().map(|(decisions, _)| *decisions).chain([0.0]));
    let y = Axis::over("reward per tick in training", all().map(|(_, reward)| reward.mean));
    let mut plot = Plot::new(x, y);
    for (series, (_, band)) in bands.iter().enumerate() {
        let ribbon: Vec<[f64; 3]> = band.iter().map(|(x, reward)| [*x, reward.low, reward.high]).collect();
        plot.ribbon(&ribbon, series);
        plot.line(&band.iter().map(|(x, reward)| [*x, reward.mean]).collect::<Vec<_>>(), series);
    }
    let title = "Learning curves: mean over training seeds with 95 % interval";
    Ok(Figure {
        name: "learning".to_owned(),
        title: title.to_owned(),
        svg: plot.finish(title),
        legend: legend(bands.iter().map(|band| &band.0)),
    })
}

fn cell(Interval { mean, low, high }: Interval, decimals: usize) -> String {
    format!("{mean:.decimals$} [{low:.decimals$}, {high:.decimals$}]")
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::row;
    use super::*;

    fn definition() -> Definition {
        let variant = |name: &str| super::super::Variant { name: name.to_owned(), ..Default::default() };
        let claim = Claim {
            source: "Fig. 12".to_owned(),
            metric: Metric::Collisions,
            variant: "a".to_owned(),
            against: "b".to_owned(),
            change_percent: -62.31,
        };
        Definition {
            name: "t".to_owned(),
            title: "T".to_owned(),
            summary: "S".to_owned(),
            figures: Vec::new(),
            preset: "default".to_owned(),
            base: toml::Table::new(),
            reference: "b".to_owned(),
            variants: ["a", "b", "rule"].map(variant).into(),
            claims: vec![claim],
        }
    }

    #[test]
    fn every_variant_has_its_line_and_every_claim_its_verdict() {
        let rows = [
            row("a", 0, 7.0, 2),
            row("a", 1, 7.2, 3),
            row("a", 2, 7.1, 2),
            row("b", 0, 6.0, 9),
            row("b", 1, 6.2, 10),
            row("b", 2, 6.3, 10),
            row("rule", 0, 5.0, 0),
        ];
        let report = analyze(&definition(), &rows, &Vec::new()).unwrap();
        let results = &report.tables[0];
        assert_eq!(results.rows.len(), 3);
        assert!(results.rows[0][4].starts_with("0.93 ["), "{:?}", results.rows[0]);
        assert!(results.rows[2][3].starts_with("5.00 [4.90, 5.10]"), "{:?}", results.rows[2]);
        assert_eq!(results.rows[1][4], "");
        assert_eq!(report.tables[1].rows[0][4], "reproduced");
        let page = overview(&outcomes(&definition(), &rows).unwrap());
        assert!(page.summary.starts_with("Of 1 claims: 1 reproduced, 0 not reproduced"), "{}", page.summary);
    }

    #[test]
    fn a_trend_is_told_where_all_variants_have_a_place() {
        let mut definition = definition();
        let rows: Vec<UnitRow> = (0..4)
            .flat_map(|seed| ["a", "b", "rule"].map(|name| row(name, seed, name.len() as f64 + 0.01 * seed as f64, 1)))
            .collect();
        assert_eq!(trends(&definition, &rows).unwrap(), None);
        for (variant, x) in definition.variants.iter_mut().zip([1.0, 1.0, 4.0]) {
            variant.x = Some(x);
        }
        let told = trends(&definition, &rows).unwrap().unwrap();
        assert!(told.contains("reward per tick rises"), "{told}");
        assert!(!told.contains("collisions"), "all have one: {told}");
    }

    #[test]
    fn curves_are_averaged_where_every_seed_has_a_point() {
        let point = |decisions: u64, reward_per_tick: f64| CurvePoint {
            decisions,
            updates: 0,
            reward_per_tick,
            speed_mps: 20.0,
            collisions_per_episode: 0.0,
            loss: 0.0,
            agreement: 1.0,
            epsilon: 0.0,
        };
        let curves = vec![(
            "a".to_owned(),
            vec![vec![point(1000, 1.0), point(2000, 2.0), point(3000, 3.0)], vec![point(1000, 2.0), point(3000, 4.0)]],
        )];
        let figure = learning(&curves).unwrap();
        assert_eq!(figure.svg.matches("class=\"curve").count(), 1);
        assert_eq!(figure.svg.matches("ribbon").count(), 1);
    }
}
