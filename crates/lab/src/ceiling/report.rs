//! How far widening the beam raises the ceiling, and how far below it policies stay.

use super::CeilingRow;
use crate::evaluate::{EpisodeResult, PolicyEpisodes};
use crate::metrics::Interval;
use crate::report::svg::{Axis, Plot};
use crate::stats::{StatsError, mean_interval, paired_ratio, rate_interval};
use crate::studies::{Figure, StudyReport, Table};

/// Tables and figure of `rows`, which hold each scenario at each width, and of policies that drove the same scenarios.
///
/// # Errors
/// With fewer than two scenarios there is no interval.
pub fn report(rows: &[CeilingRow], policies: &[PolicyEpisodes]) -> Result<StudyReport, StatsError> {
    let mut widths: Vec<usize> = rows.iter().map(|row| row.width).collect();
    widths.sort_unstable();
    widths.dedup();
    let of_width = |width: &usize| rows.iter().filter(|row| row.width == *width).collect::<Vec<_>>();
    let beams: Vec<Vec<&CeilingRow>> = widths.iter().map(of_width).collect();
    let mut tables = vec![widening(&beams)?];
    if let Some(widest) = beams.last().filter(|_| !policies.is_empty()) {
        tables.push(standings(widest, policies)?);
    }
    let scenarios = beams.first().map_or(0, Vec::len);
    let summary = format!(
        "Means and 95 % intervals over {scenarios} paired scenarios. The ceiling is the best drive that a beam search finds which knows \
         what the others will do."
    );
    Ok(StudyReport { name: "ceiling", title: "Ceiling".into(), summary, tables, figures: vec![convergence(&beams)?] })
}

fn rewards(rows: &[&CeilingRow]) -> Vec<f64> {
    rows.iter().map(|row| row.reward_per_tick).collect()
}

fn cell(Interval { mean, low, high }: Interval, decimals: usize) -> String {
    format!("{mean:.decimals$} [{low:.decimals$}, {high:.decimals$}]")
}

fn percent(share: Interval, offset: f64) -> Interval {
    let of = |value: f64| 100.0 * (value - offset);
    Interval { mean: of(share.mean), low: of(share.low), high: of(share.high) }
}

/// A row for each width.
fn widening(beams: &[Vec<&CeilingRow>]) -> Result<Table, StatsError> {
    let head = ["width", "reward/tick", "gain over the width before, %", "changes", "ticks simulated"];
    let mut table = Table::new("widths", "The ceiling by the width of the beam", &head);
    for (index, rows) in beams.iter().enumerate() {
        let gain = match index.checked_sub(1) {
            Some(before) => cell(percent(paired_ratio(&rewards(rows), &rewards(&beams[before]))?, 1.0), 2),
            None => String::new(),
        };
        let mean = |of: fn(&CeilingRow) -> f64| rows.iter().map(|row| of(row)).sum::<f64>() / rows.len() as f64;
        table.rows.push(vec![
            rows[0].width.to_string(),
            cell(mean_interval(&rewards(rows))?, 2),
            gain,
            format!("{:.1}", mean(|row| f64::from(row.lane_changes))),
            format!("{:.0}", mean(|row| row.simulated_ticks as f64)),
        ]);
    }
    Ok(table)
}

/// What each width finds as a share of what the widest one finds, scenario by scenario: the scenarios' own spread is left out.
fn convergence(beams: &[Vec<&CeilingRow>]) -> Result<Figure, StatsError> {
    let most = beams.last().map_or_else(Vec::new, |rows| rewards(rows));
    let doublings = |rows: &[&CeilingRow]| libm::log2(rows[0].width as f64);
    let share = |rows: &Vec<&CeilingRow>| Ok(percent(paired_ratio(&rewards(rows), &most)?, 0.0));
    let shares: Vec<Interval> = beams.iter().map(share).collect::<Result<_, _>>()?;
    let x = Axis::over("width of the beam, powers of two", beams.iter().map(|rows| doublings(rows)));
    let y = Axis::over("% of the reward that the widest finds", shares.iter().flat_map(|i| [i.mean, i.low, i.high]));
    let (mut plot, mut line) = (Plot::new(x, y), Vec::new());
    for (rows, &share) in beams.iter().zip(&shares) {
        let at = doublings(rows);
        plot.point_with_intervals(Interval { mean: at, low: f64::NAN, high: f64::NAN }, share, 0);
        line.push([at, share.mean]);
    }
    plot.line(&line, 0);
    let title = "The ceiling over the width of the beam".to_owned();
    let ends: Vec<String> = line.iter().map(|[at, share]| format!("2^{at:.1}: {share:.1} %")).collect();
    let svg = plot.finish(&format!("{title}; {}.", ends.join(", ")));
    Ok(Figure { name: "convergence".into(), title, svg, legend: Vec::new() })
}

/// A row for each policy and one for the ceiling.
fn standings(ceiling: &[&CeilingRow], policies: &[PolicyEpisodes]) -> Result<Table, StatsError> {
    let head = ["driver", "reward/tick", "of the ceiling, %", "speed m/s", "at fault/episode", "at fault/1000 km"];
    let mut table = Table::new("standings", "Policies below the ceiling", &head);
    let best = rewards(ceiling);
    for of in policies {
        let values = |value: fn(&EpisodeResult) -> f64| of.episodes.iter().map(value).collect::<Vec<_>>();
        let rewards = values(|episode| episode.reward_per_tick);
        let distance_km = values(|e| 1e-3 * e.speed_mps * e.duration_s).iter().sum::<f64>();
        let count = of.episodes.len();
        let rate = rate_interval(of.episodes.iter().filter(|e| e.at_fault).count(), count)?;
        let per_distance = |share: f64| 1e3 * share * count as f64 / distance_km;
        let Interval { mean, low, high } = rate;
        table.rows.push(vec![
            of.policy.clone(),
            cell(mean_interval(&rewards)?, 2),
            cell(percent(paired_ratio(&rewards, &best)?, 0.0), 1),
            cell(mean_interval(&values(|episode| episode.speed_mps))?, 2),
            cell(rate, 3),
            cell(Interval { mean: per_distance(mean), low: per_distance(low), high: per_distance(high) }, 1),
        ]);
    }
    let speeds: Vec<f64> = ceiling.iter().map(|row| row.speed_mps).collect();
    let name = format!("ceiling, beam of {}", ceiling[0].width);
    let none = "0, by construction".to_owned();
    let reward = cell(mean_interval(&best)?, 2);
    table.rows.push(vec![name, reward, "100".into(), cell(mean_interval(&speeds)?, 2), none.clone(), none]);
    Ok(table)
}
