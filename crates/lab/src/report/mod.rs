//! One offline HTML file that shows an experiment: an episode to watch, the results with their intervals, how the policies
//! were learned, what the learned reward predicts, and what it takes to run it all again.
//!
//! The page loads nothing, and says so to the browser by its content security policy. Equal data give equal bytes.

pub(crate) mod html;
mod irl;
mod methods;
mod player;
pub(crate) mod plots;
pub(crate) mod svg;
mod table;

pub use irl::{IrlFeature, IrlSummary};
pub use methods::{Difference, MethodResult};

use std::fmt::Write as _;

use lanecraft_drive::env::Trace;

use crate::metrics::{CurvePoint, Interval, PolicyResult};
use html::{escape, fill, number, range, section};

/// What a report shows. An empty list or `None` leaves its section out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReportData {
    /// The headline.
    pub title: String,
    /// The reading, a few sentences in plain text; if empty, one is written from the results.
    pub summary: Vec<String>,
    /// Results by the scenarios they were made in.
    pub sets: Vec<ScenarioSet>,
    /// Learning curves with their names.
    pub curves: Vec<(String, Vec<CurvePoint>)>,
    /// The learned human reward.
    pub irl: Option<IrlSummary>,
    /// An episode to watch.
    pub trace: Option<Trace>,
    /// Where the wall time went: what, and seconds.
    pub time_shares: Vec<(String, f64)>,
    /// The resolved configuration, as TOML.
    pub config_toml: String,
    /// Seeds: what for, and which.
    pub seeds: Vec<(String, String)>,
    /// What must be said beside the results, for example which baseline is not beaten.
    pub statements: Vec<String>,
}

/// Results in the same test scenarios.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScenarioSet {
    /// What to call it beside other sets; empty if it is the only one.
    pub name: String,
    /// Results, one for each policy; their intervals are over episodes.
    pub results: Vec<PolicyResult>,
    /// Results of methods over their training seeds, if runs were pooled.
    pub methods: Vec<MethodResult>,
    /// Methods minus other methods and rules.
    pub differences: Vec<Difference>,
    /// Probability that a seed of the row's method earns more than one of the column's, in the order of the methods.
    pub improvement: Vec<Vec<Interval>>,
}

/// The report as one HTML file.
pub fn render(data: &ReportData) -> String {
    let shown = data.trace.as_ref().and_then(|trace| Some((trace, player::player(trace)?)));
    let mut body = header(data);
    let mut scripts = String::new();
    if let Some((trace, (markup, player_scripts))) = shown {
        let policy = escape(&trace.header.policy);
        let note =
            format!("Scenario {}, driven by {policy}. Drag in a profile to move in time.", trace.header.scenario_seed);
        body += &section("Watch an episode", &note, &(markup + &plots::profiles(trace)));
        scripts = player_scripts;
    }
    body += &data.sets.iter().map(results).collect::<String>();
    if !data.curves.is_empty() {
        let note = "Each point averages the episodes that ended since the last one, explorations included.";
        body += &section("Learning", note, &plots::learning_curves(&data.curves));
    }
    if let Some(irl) = &data.irl {
        body += &section("Learned human reward", "", &irl::learned_reward(irl));
    }
    if !data.time_shares.is_empty() {
        body += &section("Where the time went", "", &plots::time_shares(data));
    }
    body += &reproduction(data);
    fill(
        include_str!("page.html"),
        &[("title", &escape(&data.title)), ("style", include_str!("page.css")), ("body", &body), ("scripts", &scripts)],
    )
}

/// Headline, reading, key figures and statements.
fn header(data: &ReportData) -> String {
    let results = data.sets.first().map_or(&[][..], |set| &set.results);
    let leader = leader(results);
    let reading = match leader {
        _ if !data.summary.is_empty() => data.summary.join(" "),
        Some(leader) => reading(results, leader),
        None => String::new(),
    };
    let mut html = format!("<header>\n<h1>{}</h1>\n", escape(&data.title));
    if !reading.is_empty() {
        let _ = writeln!(html, "<p class=\"lead\">{}</p>", escape(&reading));
    }
    let method = data.sets.first().and_then(|set| set.methods.first());
    html += &match (method, leader) {
        (Some(method), _) => tiles(&format!("{}, over its training seeds", method.name), method.outcome()),
        (None, Some(leader)) => {
            let result = &results[leader];
            tiles(&format!("{}, by highest mean reward", result.policy), methods::outcome(result))
        }
        (None, None) => String::new(),
    };
    if !data.statements.is_empty() {
        html += "<aside class=\"statements\"><h2>Read with this in mind</h2><ul>\n";
        for statement in &data.statements {
            let _ = writeln!(html, "<li>{}</li>", escape(statement));
        }
        html += "</ul></aside>\n";
    }
    html + "</header>\n"
}

/// The policy with the highest mean reward; the first of equals.
fn leader(results: &[PolicyResult]) -> Option<usize> {
    let reward = |i: usize| results[i].reward_per_tick.mean;
    let finite = (0..results.len()).filter(|i| reward(*i).is_finite());
    finite.reduce(|best, i| if reward(i) > reward(best) { i } else { best })
}

/// A paragraph on who leads and how sure that is.
fn reading(results: &[PolicyResult], leader: usize) -> String {
    let best = &results[leader];
    let mut text = format!(
        "Over {} episodes, {} has the highest mean reward: {} per tick, at {}\u{a0}km/h and with collisions in {}\u{a0}% of episodes.",
        best.episodes,
        best.policy,
        number(best.reward_per_tick.mean, 2),
        number(3.6 * best.speed_mps.mean, 1),
        number(100.0 * best.collisions_per_episode.mean, 2)
    );
    let reaches = |r: &&PolicyResult| r.policy != best.policy && r.reward_per_tick.high >= best.reward_per_tick.low;
    let close: Vec<&str> = results.iter().filter(reaches).map(|r| r.policy.as_str()).collect();
    if !close.is_empty() {
        let _ =
            write!(text, " Its interval overlaps that of {}, so the order of these is not settled.", close.join(", "));
    } else if results.len() > 1 {
        text += " Its interval lies above all others.";
    }
    text
}

/// Key figures of one policy or method, speed and collisions side by side.
fn tiles(of: &str, [speed_mps, collisions, at_fault, reward]: [Interval; 4]) -> String {
    let figures = [
        ("Speed", "km/h", 3.6, 1, speed_mps),
        ("Collisions", "% of episodes", 100.0, 2, collisions),
        ("At fault", "% of episodes", 100.0, 2, at_fault),
        ("Reward", "per tick", 1.0, 2, reward),
    ];
    let of = escape(of);
    let mut html = format!("<p class=\"note tiles-name\">Key figures of {of}</p>\n<dl class=\"tiles\">\n");
    for (name, unit, scale, decimals, interval) in figures {
        let _ = writeln!(
            html,
            "<div class=\"tile\"><dt>{name}</dt><dd>{} <span>{unit}</span><small>{}</small></dd></div>",
            number(scale * interval.mean, decimals),
            range(interval, scale, decimals)
        );
    }
    html + "</dl>\n"
}

/// What methods and policies reached in one set of scenarios.
fn results(set: &ScenarioSet) -> String {
    if set.results.is_empty() {
        return String::new();
    }
    let heading = |name: &str| {
        if set.name.is_empty() { name.to_owned() } else { format!("{name} in the scenarios of {}", escape(&set.name)) }
    };
    let note = "Means with 95 % intervals below. A star marks a policy whose interval lies apart from all others on the better \
                side (arrow); without one, the intervals do not settle who is best. Differences on the same scenarios can be \
                clearer than overlapping intervals suggest.";
    let tables = table::results_table(&set.results) + &table::guard_table(&set.results);
    if set.methods.is_empty() {
        return section(&heading("Results"), note, &(tables + &plots::scatter(&set.results)));
    }
    let alone =
        format!("<details><summary>Each run and rule alone</summary><p class=\"note\">{note}</p>{tables}</details>\n");
    section(&heading("Methods over training seeds"), methods::NOTE, &(methods::methods(set) + &alone))
}

/// Configuration and seeds, folded.
fn reproduction(data: &ReportData) -> String {
    let mut html = String::new();
    if !data.seeds.is_empty() {
        html += "<details><summary>Seeds</summary><table><tbody>\n";
        for (name, seed) in &data.seeds {
            let _ = writeln!(html, "<tr><th scope=\"row\">{}</th><td>{}</td></tr>", escape(name), escape(seed));
        }
        html += "</tbody></table></details>\n";
    }
    if !data.config_toml.is_empty() {
        let config = escape(&data.config_toml);
        let _ = writeln!(html, "<details><summary>Configuration</summary><pre>{config}</pre></details>");
    }
    section("Run it again", "", &html)
}

#[cfg(test)]
mod tests;
