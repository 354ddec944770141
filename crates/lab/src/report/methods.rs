//! Methods over their training seeds: table, plots, differences. Collisions stand beside speed and reward everywhere.

use std::fmt::Write as _;

use super::ScenarioSet;
use super::html::{escape, number, range};
use super::plots::{self, Outcome};
use super::svg::{Axis, Plot};
use super::table::table;
use crate::metrics::{Interval, PolicyResult};

/// What a method's trainings reached. Intervals are over training seeds, but those of collisions, which are exact for independent episodes.
#[derive(Clone, Debug, PartialEq)]
pub struct MethodResult {
    /// The method.
    pub name: String,
    /// Its runs, one for each seed.
    pub runs: Vec<String>,
    /// Episodes of all runs together.
    pub episodes: usize,
    /// Time mean of the speed, m/s.
    pub speed_mps: Interval,
    /// Mean reward of a tick.
    pub reward_per_tick: Interval,
    /// Interquartile mean over seeds of the reward of a tick.
    pub reward_interquartile_mean: Interval,
    /// Share of episodes that ended in a collision.
    pub collisions_per_episode: Interval,
    /// Share of episodes that ended in a collision by the ego's own fault.
    pub at_fault_collisions_per_episode: Interval,
    /// Collisions per 1 000 km.
    pub collisions_per_1000_km: Interval,
    /// Collisions by the ego's own fault per 1 000 km.
    pub at_fault_collisions_per_1000_km: Interval,
    /// Share of episodes of each seed that ended in a collision.
    pub collisions_by_seed: Vec<f64>,
    /// Performance profile: thresholds of the reward of a tick, and the share of episodes above each.
    pub profile: Vec<(f64, Interval)>,
}

/// A method minus another one, or a rule, over seeds.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// The one.
    pub method: String,
    /// The other.
    pub other: String,
    /// How they were compared.
    pub unit: String,
    /// Of the speed, m/s.
    pub speed_mps: Interval,
    /// Of the share of episodes that ended in a collision.
    pub collisions_per_episode: Interval,
    /// Of the share of those by the ego's own fault.
    pub at_fault_collisions_per_episode: Interval,
    /// Of the reward of a tick.
    pub reward_per_tick: Interval,
}

impl MethodResult {
    /// Speed, collisions, those at fault, reward.
    pub(super) fn outcome(&self) -> [Interval; 4] {
        let Self { speed_mps, collisions_per_episode, at_fault_collisions_per_episode, reward_per_tick, .. } = self;
        [*speed_mps, *collisions_per_episode, *at_fault_collisions_per_episode, *reward_per_tick]
    }
}

/// Speed, collisions, those at fault, reward.
pub(super) fn outcome(result: &PolicyResult) -> [Interval; 4] {
    let PolicyResult { speed_mps, collisions_per_episode, at_fault_collisions_per_episode, reward_per_tick, .. } =
        result;
    [*speed_mps, *collisions_per_episode, *at_fault_collisions_per_episode, *reward_per_tick]
}

impl<'a> From<&'a MethodResult> for Outcome<'a> {
    fn from(method: &'a MethodResult) -> Self {
        Self { name: &method.name, collisions: method.collisions_per_episode, reward: method.reward_per_tick }
    }
}

/// How to read the section.
pub(super) const NOTE: &str = "Runs that differ only in their training seed are one method. The seed is the unit: each run is averaged over its \
     scenarios, and the 95 % intervals of speed, reward and differences are over seeds; they speak of further trainings on these scenarios. \
     Collisions are pooled over all episodes, with exact intervals for independent episodes; beside them the seeds with fewest and most. \
     Their differences have the wider of the intervals over seeds and over episodes. Rules are not trained: their intervals are over episodes.";

/// The section's content.
pub(super) fn methods(set: &ScenarioSet) -> String {
    let mut html = outcomes(&set.methods) + &scatter(set);
    if !set.differences.is_empty() {
        html += &differences(set);
    }
    if set.methods.len() > 1 {
        html += &improvement(set);
    }
    html
}

/// A number with its interval below, for a cell.
fn cell(interval: Interval, scale: f64, decimals: usize) -> String {
    format!("{}<small>{}</small>", number(scale * interval.mean, decimals), range(interval, scale, decimals))
}

fn outcomes(methods: &[MethodResult]) -> String {
    let head = [
        ("Speed ↑", "km/h"),
        ("Colli\u{ad}sions ↓", "% of episodes"),
        ("At fault ↓", "% of episodes"),
        ("Reward ↑", "mean per tick"),
        ("Reward ↑", "interquartile mean"),
        ("Colli\u{ad}sions ↓", "per 1 000 km"),
        ("At fault ↓", "per 1 000 km"),
        ("By seed", "collisions, % of episodes"),
    ];
    let row = |method: &MethodResult| {
        let by_seed = method.collisions_by_seed.iter();
        let (fewest, most) = by_seed.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        let name =
            format!("{}<small>{} seeds, {} episodes</small>", escape(&method.name), method.runs.len(), method.episodes);
        let [speed, collisions, at_fault, reward] = method.outcome();
        let cells = vec![
            cell(speed, 3.6, 1),
            cell(collisions, 100.0, 2),
            cell(at_fault, 100.0, 2),
            cell(reward, 1.0, 2),
            cell(method.reward_interquartile_mean, 1.0, 2),
            cell(method.collisions_per_1000_km, 1.0, 1),
            cell(method.at_fault_collisions_per_1000_km, 1.0, 1),
            format!("{} to {}", number(100.0 * fewest, 1), number(100.0 * most, 1)),
        ];
        (name, cells)
    };
    table("Method", &head, &methods.iter().map(row).collect::<Vec<_>>())
}

/// Methods and rules by reward and collisions, and the methods' profiles.
fn scatter(set: &ScenarioSet) -> String {
    let rules = set.results.iter().filter(|result| result.policy.starts_with("rule:"));
    let all: Vec<Outcome> = set.methods.iter().map(Outcome::from).chain(rules.map(Outcome::from)).collect();
    let shown: Vec<usize> = (0..all.len()).collect();
    let names: Vec<&str> = all.iter().map(|outcome| outcome.name).collect();
    format!(
        "<div class=\"card\">{}</div>\n<div class=\"grid\">\n{}{}</div>\n",
        plots::legend(&names, "", true),
        plots::card("Reward against collisions", &plots::reward_against_collisions(&all, &shown)),
        plots::card("Performance profile", &profiles(&set.methods))
    )
}

fn profiles(methods: &[MethodResult]) -> String {
    let thresholds = methods.iter().flat_map(|method| method.profile.iter().map(|(threshold, _)| *threshold));
    let x = Axis::over("threshold of the reward per tick", thresholds);
    let mut plot = Plot::new(x, Axis::over("share of episodes above it, %", [0.0, 100.0]));
    let mut alternative = String::from("Share of episodes above each threshold of the reward; half of them are above:");
    for (series, method) in methods.iter().enumerate() {
        let band = |(x, share): &(f64, Interval)| [*x, 100.0 * share.low, 100.0 * share.high];
        plot.ribbon(&method.profile.iter().map(band).collect::<Vec<_>>(), series);
    }
    for (series, method) in methods.iter().enumerate() {
        let line: Vec<[f64; 2]> = method.profile.iter().map(|(x, share)| [*x, 100.0 * share.mean]).collect();
        plot.line(&line, series);
        let median = method.profile.iter().find(|(_, share)| share.mean <= 0.5).map_or(f64::NAN, |(x, _)| *x);
        let _ = write!(alternative, " {}: {};", method.name, number(median, 2));
    }
    plot.finish(&alternative)
}

fn differences(set: &ScenarioSet) -> String {
    let head = [
        ("Speed", "km/h"),
        ("Colli\u{ad}sions", "% of episodes"),
        ("At fault", "% of episodes"),
        ("Reward", "mean per tick"),
    ];
    let row = |d: &Difference| {
        let name = format!("{} − {}<small>{}</small>", escape(&d.method), escape(&d.other), escape(&d.unit));
        let cells = vec![
            cell(d.speed_mps, 3.6, 2),
            cell(d.collisions_per_episode, 100.0, 2),
            cell(d.at_fault_collisions_per_episode, 100.0, 2),
            cell(d.reward_per_tick, 1.0, 3),
        ];
        (name, cells)
    };
    table("Difference over seeds", &head, &set.differences.iter().map(row).collect::<Vec<_>>())
}

fn improvement(set: &ScenarioSet) -> String {
    let head: Vec<(&str, &str)> = set.methods.iter().map(|method| (method.name.as_str(), "")).collect();
    let row = |(place, method): (usize, &MethodResult)| {
        let cells = set.improvement[place].iter().enumerate();
        let cell = |(other, i): (usize, &Interval)| if other == place { "–".into() } else { cell(*i, 100.0, 0) };
        (escape(&method.name), cells.map(cell).collect())
    };
    let rows: Vec<(String, Vec<String>)> = set.methods.iter().enumerate().map(row).collect();
    table("Chance that a seed of the row earns more than one of the column, %", &head, &rows)
}
