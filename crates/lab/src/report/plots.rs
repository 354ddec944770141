//! The report's figures.

use std::fmt::Write as _;

use lanecraft_drive::env::{Frame, Trace};

use super::ReportData;
use super::html::{escape, number, range};
use super::irl::IrlFeature;
use super::player::lane_changes;
use super::svg::{Axis, Plot, classes, drawable, element, mark};
use crate::metrics::{CurvePoint, Interval, PolicyResult};

/// More points than this on a line cannot be told apart.
const MAX_POINTS: usize = 400;

/// A card of the page's grid.
pub(super) fn card(heading: &str, content: &str) -> String {
    format!("<figure class=\"card\" style=\"margin:0\"><h3>{heading}</h3>\n{content}</figure>\n")
}

/// A legend: each series' mark, line and name.
pub(super) fn legend(names: &[&str], class: &str, with_line: bool) -> String {
    let mut html = format!("<ul class=\"series {class}\">\n");
    for (series, name) in names.iter().enumerate() {
        let line = if with_line {
            format!("<path class=\"curve {}\" d=\"M0 8H30\"/>", classes(series))
        } else {
            String::new()
        };
        let mark = mark(15.0, 8.0, series);
        let _ = writeln!(
            html,
            "<li><svg viewBox=\"0 0 30 16\" aria-hidden=\"true\">{line}{}</svg><span>{}</span></li>",
            mark.trim_end(),
            escape(name)
        );
    }
    html + "</ul>\n"
}

/// What a policy or a method reached: never its reward alone.
pub(crate) struct Outcome<'a> {
    /// Its name.
    pub(crate) name: &'a str,
    /// Share of episodes that ended in a collision.
    pub(crate) collisions: Interval,
    /// Reward of a tick.
    pub(crate) reward: Interval,
}

impl<'a> From<&'a PolicyResult> for Outcome<'a> {
    fn from(result: &'a PolicyResult) -> Self {
        Self { name: &result.policy, collisions: result.collisions_per_episode, reward: result.reward_per_tick }
    }
}

/// Reward against collisions, every policy with its intervals; beside it the better half at a larger scale.
pub(super) fn scatter(results: &[PolicyResult]) -> String {
    let outcomes: Vec<Outcome> = results.iter().map(Outcome::from).collect();
    let names: Vec<&str> = outcomes.iter().map(|outcome| outcome.name).collect();
    let all: Vec<usize> = (0..results.len()).collect();
    let mut cards = card("All policies", &reward_against_collisions(&outcomes, &all));
    let better = better_half(results);
    if better.len() < all.len() {
        cards += &card("The better half by reward", &reward_against_collisions(&outcomes, &better));
    }
    format!("<div class=\"card\">{}</div>\n<div class=\"grid\">\n{cards}</div>\n", legend(&names, "", false))
}

/// The policies whose mean reward is in the upper half, in their order; all, if they are few.
fn better_half(results: &[PolicyResult]) -> Vec<usize> {
    let reward = |i: &usize| results[*i].reward_per_tick.mean;
    let mut order: Vec<usize> = (0..results.len()).filter(|i| drawable(reward(i))).collect();
    if order.len() < 4 {
        return (0..results.len()).collect();
    }
    order.sort_by(|a, b| reward(b).total_cmp(&reward(a)).then(a.cmp(b)));
    order.truncate(order.len().div_ceil(2));
    order.sort_unstable();
    order
}

/// The outcomes at the places `shown`, each with its intervals in both directions.
pub(crate) fn reward_against_collisions(outcomes: &[Outcome], shown: &[usize]) -> String {
    let percent = |i: Interval| Interval { mean: 100.0 * i.mean, low: 100.0 * i.low, high: 100.0 * i.high };
    let ends = |i: Interval| [i.mean, i.low, i.high];
    let collisions = || shown.iter().flat_map(|i| ends(percent(outcomes[*i].collisions)));
    let rewards = shown.iter().flat_map(|i| ends(outcomes[*i].reward));
    let x = Axis::over("collisions, % of episodes", collisions().chain([0.0]));
    let mut plot = Plot::new(x, Axis::over("reward per tick", rewards));
    let mut alternative = String::from("Reward per tick against collisions in percent of episodes.");
    for series in shown {
        let Outcome { name, collisions, reward } = &outcomes[*series];
        plot.point_with_intervals(percent(*collisions), *reward, *series);
        let _ = write!(alternative, " {name}: {}, {} %.", number(reward.mean, 2), number(100.0 * collisions.mean, 2));
    }
    plot.finish(&alternative)
}

/// Four panels over the number of decisions.
pub(super) fn learning_curves(curves: &[(String, Vec<CurvePoint>)]) -> String {
    type Panel = (&'static str, &'static str, fn(&CurvePoint) -> f64);
    const PANELS: [Panel; 4] = [
        ("Reward", "reward per tick", |p| p.reward_per_tick),
        ("Collisions", "% of episodes", |p| 100.0 * p.collisions_per_episode),
        ("Speed", "km/h", |p| 3.6 * p.speed_mps),
        ("Loss", "mean loss of an update", |p| p.loss),
    ];
    let names: Vec<&str> = curves.iter().map(|(name, _)| name.as_str()).collect();
    let mut html = format!("{}<div class=\"grid\">\n", legend(&names, "", true));
    for (heading, unit, of) in PANELS {
        let points = || curves.iter().flat_map(|(_, points)| points);
        let x = Axis::over("decisions", points().map(|p| p.decisions as f64).chain([0.0]));
        let mut plot = Plot::new(x, Axis::over(unit, points().map(of)));
        for (series, (_, points)) in curves.iter().enumerate() {
            let line: Vec<[f64; 2]> = thinned(points).map(|p| [p.decisions as f64, of(p)]).collect();
            plot.line(&line, series);
            line.last().into_iter().for_each(|end| plot.point(*end, series));
        }
        let mut alternative = format!("{heading}, {unit}, over decisions; last values:");
        for (name, points) in curves {
            let last = points.last().map_or(f64::NAN, of);
            let _ = write!(alternative, " {name}: {};", number(last, 3));
        }
        html += &card(heading, &plot.finish(&alternative));
    }
    html + "</div>\n"
}

/// At most about [`MAX_POINTS`] of the items, evenly, with the last one.
fn thinned<T>(items: &[T]) -> impl Iterator<Item = &T> {
    let stride = items.len().div_ceil(MAX_POINTS).max(1);
    let last = (items.len() % stride != 1 && stride > 1).then(|| items.last()).flatten();
    items.iter().step_by(stride).chain(last)
}

/// Speed and lateral position over time, as the paper's Fig. 8, with the lane changes marked.
pub(super) fn profiles(trace: &Trace) -> String {
    let frames: Vec<&Frame> = trace.ticks.iter().flat_map(|tick| &tick.frames).collect();
    let line = |of: fn(&Frame) -> f64| -> Vec<[f64; 2]> { thinned(&frames).map(|f| [f.time_s, of(f)]).collect() };
    let lane_width_m = trace.header.lane_width_m;
    let edges: Vec<f64> = (0..=trace.header.lanes).map(|lane| (f64::from(lane) - 0.5) * lane_width_m).collect();
    format!(
        "<div class=\"grid\">\n{}{}</div>\n",
        card("Speed", &profile(trace, "speed, km/h", &line(|f| 3.6 * f.ego.speed_mps), &[])),
        card("Lateral position", &profile(trace, "m to the left of the rightmost lane", &line(|f| f.ego.d_m), &edges))
    )
}

/// One profile; `levels` are drawn as dashed lines and kept in view.
fn profile(trace: &Trace, name: &str, line: &[[f64; 2]], levels: &[f64]) -> String {
    let extent = |of: usize| {
        let values = line.iter().map(move |p| p[of]).filter(|v| drawable(*v));
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    let ((start, end), (low, high)) = (extent(0), extent(1));
    let y = match (levels.first(), levels.last()) {
        // A road has its own range; other values extend to whole ticks.
        (Some(right), Some(left)) => Axis::exactly(name, right.min(low) - 0.5, left.max(high) + 0.5),
        _ => Axis::over(name, [low, high]),
    };
    let mut plot = Plot::new(Axis::exactly("time, s", start, end), y);
    let changes = lane_changes(trace);
    for change in &changes {
        plot.band(change.start_s.max(start), change.end_s.min(end), if change.left { "left" } else { "right" });
    }
    for level in levels {
        plot.level(*level);
    }
    plot.line(line, 0);
    let (low, high) = (number(low, 1), number(high, 1));
    let alternative = format!("{name} over time in s: from {low} to {high}, with {} lane changes.", changes.len());
    plot.finish_with_cursor(&alternative)
}

/// The learned weights as horizontal bars from zero, with their intervals.
pub(super) fn weight_bars(features: &[IrlFeature]) -> String {
    const WIDTH: f64 = 500.0;
    const ROW: f64 = 46.0;
    let ends = features.iter().flat_map(|f| f.interval.map_or([0.0; 2], |i| [i.low, i.high]));
    let values = || features.iter().map(|f| f.weight).chain([0.0]);
    let drawn: Vec<f64> = ends.chain(values()).filter(|x| drawable(*x)).collect();
    let (low, high) = drawn.iter().fold((0.0_f64, 0.0_f64), |(l, h), x| (l.min(*x), h.max(*x)));
    let span = if high > low { high - low } else { 1.0 };
    let px = |x: f64| 4.0 + (x - low) / span * (WIDTH - 8.0);
    let mut body = String::new();
    let mut alternative = String::from("Learned weights:");
    for (row, feature) in features.iter().enumerate() {
        let y = ROW * row as f64;
        let value = number(feature.weight, 3);
        let _ = write!(alternative, " {} {value};", feature.name);
        let _ =
            write!(body, "<text class=\"axis-name\" x=\"4\" y=\"{:.1}\">{}</text>", y + 15.0, escape(&feature.name));
        let _ = write!(body, "<text x=\"{WIDTH}\" y=\"{:.1}\" text-anchor=\"end\">{value}</text>", y + 15.0);
        if drawable(feature.weight) {
            let (x0, x1) = (px(feature.weight.min(0.0)), px(feature.weight.max(0.0)));
            let _ = write!(
                body,
                "<rect class=\"bar-shape s0\" x=\"{x0:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"14\" rx=\"2\"/>",
                y + 22.0,
                x1 - x0
            );
        }
        if let Some(i) = feature.interval.filter(|i| drawable(i.low) && drawable(i.high)) {
            let (y0, x0, x1) = (y + 25.0, px(i.low), px(i.high));
            let _ = write!(body, "<path class=\"weight-interval\" d=\"M{x0:.1} {y0:.1}v8m0 -4H{x1:.1}m0 -4v8\"/>");
        }
        body.push('\n');
    }
    let height = ROW * features.len() as f64;
    let zero = px(0.0);
    let _ = writeln!(body, "<path class=\"zero\" d=\"M{zero:.1} 0V{height}\"/>");
    card("Weights", &element([WIDTH, height], &alternative, "", &body))
}

/// Where the wall time went, largest first as given.
pub(super) fn time_shares(data: &ReportData) -> String {
    let seconds = |s: f64| if drawable(s) { s.max(0.0) } else { 0.0 };
    let total: f64 = data.time_shares.iter().map(|(_, s)| seconds(*s)).sum();
    let largest = data.time_shares.iter().map(|(_, s)| seconds(*s)).fold(0.0, f64::max);
    let mut html = String::from("<div class=\"card\"><ul class=\"shares\">\n");
    for (name, s) in &data.time_shares {
        let of = |whole: f64| if whole > 0.0 { 100.0 * seconds(*s) / whole } else { 0.0 };
        let _ = writeln!(
            html,
            "<li><span>{}</span><i style=\"width:{:.2}%\"></i><b>{} s · {} %</b></li>",
            escape(name),
            of(largest),
            number(*s, if largest < 100.0 { 2 } else { 0 }),
            number(of(total), 1)
        );
    }
    html + "</ul></div>\n"
}

/// A weight with its interval, for tables.
pub(super) fn weight_cell(feature: &IrlFeature) -> String {
    let range = feature.interval.map_or(String::new(), |i| range(i, 1.0, 3));
    format!("{}<small>{range}</small>", number(feature.weight, 3))
}

#[cfg(test)]
mod tests {
    use super::{MAX_POINTS, thinned};

    #[test]
    fn thinned_items_keep_both_ends() {
        for count in [0, 1, 2, MAX_POINTS, MAX_POINTS + 1, 1201, 12_000] {
            let items: Vec<usize> = (0..count).collect();
            let kept: Vec<&usize> = thinned(&items).collect();
            assert!(kept.len() <= MAX_POINTS + 1 && kept.is_sorted_by(|a, b| a < b));
            assert_eq!((kept.first(), kept.last()), (items.first().as_ref(), items.last().as_ref()));
        }
    }
}
