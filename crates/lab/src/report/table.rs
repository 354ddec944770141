//! The table of results: every metric of every policy with its interval.

use std::fmt::Write as _;

use lanecraft_drive::control::GuardCause;

use super::html::{escape, number, range};
use crate::metrics::{Interval, PolicyResult};

/// Which way a metric is better, if there is one.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Better {
    Higher,
    Lower,
    /// Counts of what was done say neither good nor bad.
    Neither,
}

/// A column. Collisions stand next to speed, so that neither is read alone.
struct Column {
    name: &'static str,
    unit: &'static str,
    better: Better,
    /// From SI units to the printed ones.
    scale: f64,
    decimals: usize,
    of: fn(&PolicyResult) -> Interval,
}

const fn column(
    name: &'static str,
    unit: &'static str,
    better: Better,
    (scale, decimals): (f64, usize),
    of: fn(&PolicyResult) -> Interval,
) -> Column {
    Column { name, unit, better, scale, decimals, of }
}

/// How many of the columns judge an outcome; the others count what was done.
const OUTCOMES: usize = 6;

const COLUMNS: [Column; 11] = [
    column("Speed", "km/h", Better::Higher, (3.6, 1), |r| r.speed_mps),
    column("Colli\u{ad}sions", "% of episodes", Better::Lower, (100.0, 2), |r| r.collisions_per_episode),
    column("At fault", "% of episodes", Better::Lower, (100.0, 2), |r| r.at_fault_collisions_per_episode),
    column("Reward", "per tick", Better::Higher, (1.0, 2), |r| r.reward_per_tick),
    column("Smallest TTC", "s", Better::Higher, (1.0, 2), |r| r.min_time_to_collision_s),
    column("Jerk", "m/s³", Better::Lower, (1.0, 2), |r| r.jerk_mps3),
    column("Lane changes", "per min", Better::Neither, (1.0, 2), |r| r.lane_changes_per_min),
    column("Refusals", "per min", Better::Neither, (1.0, 2), |r| r.refusals_per_min),
    column("Fall-backs", "per min", Better::Neither, (1.0, 3), |r| r.fallbacks_per_min),
    column("Guard", "per min", Better::Neither, (1.0, 2), |r| r.guard_interventions_per_min),
    column("Shield", "per min", Better::Neither, (1.0, 2), |r| r.shield_interventions_per_min),
];

/// Which policy is clearly best: its interval lies apart from, and on the better side of, everybody else's.
pub(super) fn clear_best(intervals: &[Interval], higher_is_better: bool) -> Option<usize> {
    let beats = |a: &Interval, b: &Interval| if higher_is_better { a.low > b.high } else { a.high < b.low };
    let best_of_all = |i: usize| {
        let others = intervals.iter().enumerate().filter(|(j, _)| *j != i);
        intervals.len() > 1 && others.into_iter().all(|(_, other)| beats(&intervals[i], other))
    };
    (0..intervals.len()).find(|i| best_of_all(*i))
}

/// The table, in a card that scrolls sideways on narrow screens.
pub(super) fn results_table(results: &[PolicyResult]) -> String {
    let best: Vec<Option<usize>> = COLUMNS
        .iter()
        .map(|column| {
            let intervals: Vec<Interval> = results.iter().map(column.of).collect();
            (column.better != Better::Neither).then(|| clear_best(&intervals, column.better == Better::Higher))?
        })
        .collect();
    let mut html = head();
    for (row, result) in results.iter().enumerate() {
        let _ = write!(
            html,
            "<tr><th class=\"policy\" scope=\"row\">{}<small>{} episodes</small></th>",
            escape(&result.policy),
            result.episodes
        );
        for (index, column) in COLUMNS.iter().enumerate() {
            let interval = (column.of)(result);
            let class = match (best[index] == Some(row), is_edge(index)) {
                (true, true) => " class=\"best edge\"",
                (true, false) => " class=\"best\"",
                (false, true) => " class=\"edge\"",
                (false, false) => "",
            };
            let value = number(column.scale * interval.mean, column.decimals);
            let range = range(interval, column.scale, column.decimals);
            let _ = write!(html, "<td{class}>{value}<small>{range}</small></td>");
        }
        html += "</tr>\n";
    }
    html + "</tbody></table></div>\n"
}

/// What the guard acted for, by policy; nothing if it never did.
pub(super) fn guard_table(results: &[PolicyResult]) -> String {
    let mean = |r: &PolicyResult, cause| r.guard_causes_per_min.get(&cause).map_or(0.0, |interval| interval.mean);
    let met = |cause: &GuardCause| results.iter().any(|r| mean(r, *cause) > 0.0);
    let causes: Vec<GuardCause> = GuardCause::ALL.into_iter().filter(met).collect();
    if causes.is_empty() {
        return String::new();
    }
    let head: Vec<(&str, &str)> = causes.iter().map(|cause| (cause.name(), "per min")).collect();
    let row = |result: &PolicyResult| {
        (escape(&result.policy), causes.iter().map(|cause| number(mean(result, *cause), 2)).collect())
    };
    table("What the guard acted for", &head, &results.iter().map(row).collect::<Vec<_>>())
}

/// A table whose rows have a name (HTML) and cells (HTML) under these heads with their units (text), in a card that scrolls sideways.
pub(super) fn table(name: &str, head: &[(&str, &str)], rows: &[(String, Vec<String>)]) -> String {
    let mut html = format!(
        "<div class=\"card results scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{name}\"><table>\n\
         <thead><tr><th class=\"policy\" scope=\"col\">{name}</th>"
    );
    for (column, unit) in head {
        let _ = write!(html, "<th scope=\"col\">{}<small>{unit}</small></th>", escape(column));
    }
    html += "</tr></thead>\n<tbody>\n";
    for (row, cells) in rows {
        let _ = write!(html, "<tr><th class=\"policy\" scope=\"row\">{row}</th>");
        for cell in cells {
            let _ = write!(html, "<td>{cell}</td>");
        }
        html += "</tr>\n";
    }
    html + "</tbody></table></div>\n"
}

fn is_edge(index: usize) -> bool {
    index == 0 || index == OUTCOMES
}

fn head() -> String {
    let mut html = String::from(
        "<div class=\"card results scroll\" tabindex=\"0\" role=\"region\" aria-label=\"Results\"><table>",
    );
    let _ = write!(
        html,
        "<thead><tr><th class=\"policy\" rowspan=\"2\" scope=\"col\">Policy</th><th class=\"group\" colspan=\"{OUTCOMES}\">Outcome</th>\
         <th class=\"group\" colspan=\"{}\">What was done</th></tr>\n<tr>",
        COLUMNS.len() - OUTCOMES
    );
    for (index, Column { name, unit, better, .. }) in COLUMNS.iter().enumerate() {
        let class = if is_edge(index) { " class=\"edge\"" } else { "" };
        let arrow = match better {
            Better::Higher => "\u{a0}↑",
            Better::Lower => "\u{a0}↓",
            Better::Neither => "",
        };
        let _ = write!(html, "<th scope=\"col\"{class}>{name}{arrow}<small>{unit}</small></th>");
    }
    html + "</tr></thead>\n<tbody>\n"
}
