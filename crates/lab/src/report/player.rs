//! What the player needs of a trace, as compact JSON and HTML; `player.js` reads and draws it.
//!
//! Numbers are rounded to what a screen can show (1 cm, 0.1 mrad), which makes the page several times smaller than the trace.

use lanecraft_drive::control::GuardCause;
use lanecraft_drive::env::{CandidateRecord, Frame, TickRecord, Trace};
use serde::Serialize;
use std::collections::BTreeMap;

use super::html::{escape, fill, number};

/// Everything about the episode; the field names are those that `player.js` reads.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Episode {
    lanes: u8,
    lane_width: f64,
    ego_length: f64,
    ego_width: f64,
    control_period: f64,
    decision_period: f64,
    /// Slowest and fastest of the other vehicles, m/s.
    speed_range: [f64; 2],
    /// Largest magnitudes, the ends of the gauges.
    accel_span: f64,
    steer_span: f64,
    /// Time of the still that is shown first, s.
    poster: f64,
    /// Id, length and width of each vehicle.
    sizes: Vec<(u32, f64, f64)>,
    ticks: Vec<TickView>,
    fans: Vec<Vec<CandidateView>>,
    frames: Vec<FrameView>,
}

#[derive(Serialize)]
struct TickView {
    words: String,
    weights: String,
    path: Option<PathView>,
    /// Time at which the lane change started, s.
    start: f64,
    /// Index of its candidates in `fans`, or -1.
    fan: i64,
    /// 1 during a change to the left, -1 to the right, else 0.
    side: i8,
}

#[derive(Serialize)]
struct PathView {
    coefficients: [f64; 6],
    duration: f64,
}

#[derive(Serialize)]
struct CandidateView {
    coefficients: [f64; 6],
    duration: f64,
    /// 0 for the least and 1 for the most human-like of the fan.
    rank: f64,
}

#[derive(Serialize)]
struct FrameView {
    t: f64,
    tick: usize,
    s: f64,
    d: f64,
    heading: f64,
    v: f64,
    accel: f64,
    steer: f64,
    /// Why the guard acts; empty if it does not.
    guard: &'static str,
    /// Id, distance ahead, lateral position and speed of each vehicle in turn.
    vehicles: Vec<f64>,
}

/// A lane change of an episode.
pub(super) struct LaneChange {
    /// When it started and ended, s.
    pub(super) start_s: f64,
    pub(super) end_s: f64,
    /// Whether it went to the left.
    pub(super) left: bool,
}

/// The player's markup and its data as two `script` elements, or nothing for a trace without a frame.
pub(super) fn player(trace: &Trace) -> Option<(String, String)> {
    let episode = episode(trace)?;
    let json = serde_json::to_string(&episode).expect("a tree of numbers and strings serializes");
    let [slow, fast] = episode.speed_range.map(|v| number(3.6 * v, 0));
    let (first, last) = (episode.frames.first()?, episode.frames.last()?);
    let description = format!(
        "Top view of a road with {} lanes that moves with the ego car, driven by {}. The profiles below show the same episode.",
        episode.lanes, trace.header.policy
    );
    let markup = fill(
        include_str!("player.html"),
        &[
            ("description", &escape(&description)),
            ("start", &first.t.to_string()),
            ("end", &last.t.to_string()),
            ("slow", &slow),
            ("fast", &fast),
        ],
    );
    // `<` could end the element or open a comment in it; JSON has another way to write it.
    let json = json.replace('<', "\\u003c");
    let scripts = format!(
        "<script id=\"episode\" type=\"application/json\">{json}</script>\n<script>\n{}</script>\n",
        include_str!("player.js")
    );
    Some((markup, scripts))
}

/// The frames that can be shown: a view needs a time and a place.
fn frames(tick: &TickRecord) -> impl Iterator<Item = &Frame> {
    tick.frames.iter().filter(|f| f.time_s.is_finite() && f.ego.s_m.is_finite() && f.ego.d_m.is_finite())
}

/// Time at which a tick starts: one control period before its first frame.
fn tick_start_s(trace: &Trace, tick: &TickRecord) -> Option<f64> {
    Some(frames(tick).next()?.time_s - trace.header.control_period_s)
}

/// The lane changes of an episode, in order.
pub(super) fn lane_changes(trace: &Trace) -> Vec<LaneChange> {
    let mut changes: Vec<LaneChange> = Vec::new();
    let mut following = false;
    for tick in &trace.ticks {
        let span = tick_start_s(trace, tick).zip(frames(tick).last().map(|f| f.time_s));
        let (Some(path), Some((start_s, tick_end_s))) = (&tick.path, span) else {
            following = false;
            continue;
        };
        let left = goes_left(path.coefficients, path.duration_s);
        let end_s = tick_end_s.min(start_s - path.elapsed_s + path.duration_s);
        match changes.last_mut() {
            // A path that starts anew is another change, also right after the last one.
            Some(change) if following && path.elapsed_s > 0.0 => change.end_s = end_s,
            _ => changes.push(LaneChange { start_s, end_s, left }),
        }
        following = true;
    }
    changes
}

fn lateral_m(coefficients: [f64; 6], t: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * t + c)
}

fn goes_left(coefficients: [f64; 6], duration_s: f64) -> bool {
    lateral_m(coefficients, duration_s) > coefficients[0]
}

fn episode(trace: &Trace) -> Option<Episode> {
    let header = &trace.header;
    let mut views = Vec::new();
    let mut ticks = Vec::new();
    let mut fans = Vec::new();
    let mut fan: i64 = -1;
    for tick in &trace.ticks {
        if !tick.candidates.is_empty() {
            fan = fans.len() as i64;
            fans.push(fan_view(&tick.candidates));
        } else if tick.path.is_none() {
            fan = -1;
        }
        let start_s = tick_start_s(trace, tick).unwrap_or(0.0);
        views.extend(frames(tick).map(|frame| frame_view(frame, ticks.len())));
        ticks.push(tick_view(tick, start_s, fan));
    }
    let poster = lane_changes(trace).first().map_or(0.0, |c| c.start_s + 0.4 * (c.end_s - c.start_s));
    let largest = |least: f64, of: fn(&FrameView) -> f64| views.iter().map(of).fold(least, |a, b| a.max(b.abs()));
    let (accel_span, steer_span) = (largest(2.0, |f| f.accel), largest(0.005, |f| f.steer));
    (!views.is_empty()).then(|| Episode {
        lanes: header.lanes.max(1),
        lane_width: positive(header.lane_width_m, 3.75),
        ego_length: positive(header.ego_length_m, 4.5),
        ego_width: positive(header.ego_width_m, 1.8),
        control_period: positive(header.control_period_s, 0.05),
        decision_period: positive(header.decision_period_s, 0.5),
        speed_range: speed_range(trace),
        accel_span,
        steer_span,
        poster: round(poster, 2),
        sizes: sizes(trace),
        ticks,
        fans,
        frames: views,
    })
}

/// `value`, or something to draw if the trace has no such size.
fn positive(value: f64, otherwise: f64) -> f64 {
    if value > 0.0 && value.is_finite() { value } else { otherwise }
}

/// `value` rounded to some decimals; JSON has no other numbers than finite ones, so others become 0.
fn round(value: f64, decimals: u8) -> f64 {
    let scale = (0..decimals).fold(1.0, |scale, _| 10.0 * scale);
    let rounded = (value * scale).round() / scale;
    if rounded.is_finite() { rounded } else { 0.0 }
}

fn frame_view(frame: &Frame, tick: usize) -> FrameView {
    let ego = &frame.ego;
    FrameView {
        t: round(frame.time_s, 3),
        tick,
        s: round(ego.s_m, 2),
        d: round(ego.d_m, 3),
        heading: round(ego.heading_rad, 4),
        v: round(ego.speed_mps, 2),
        accel: round(ego.accel_mps2, 3),
        steer: round(ego.steer_rad, 5),
        guard: ego.guard.map_or("", GuardCause::name),
        vehicles: frame
            .vehicles
            .iter()
            .filter(|v| v.ahead_m.is_finite() && v.d_m.is_finite())
            .flat_map(|v| [f64::from(v.id), round(v.ahead_m, 2), round(v.d_m, 2), round(v.speed_mps, 1)])
            .collect(),
    }
}

fn tick_view(tick: &TickRecord, start_s: f64, fan: i64) -> TickView {
    // `change left q2=0.001`: the words, then the weights of the controllers.
    let (words, weights) = tick.action_name.split_once(" q").unwrap_or((&tick.action_name, ""));
    let weights = if weights.is_empty() { String::new() } else { format!("q{weights}").replace('=', " = ") };
    let mut letters = words.chars();
    let words = letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect());
    let elapsed_s = tick.path.as_ref().map_or(0.0, |p| p.elapsed_s);
    TickView {
        words,
        weights,
        start: round(start_s - elapsed_s, 3),
        fan,
        side: tick.path.as_ref().map_or(0, |p| if goes_left(p.coefficients, p.duration_s) { 1 } else { -1 }),
        path: tick
            .path
            .as_ref()
            .map(|p| PathView { coefficients: p.coefficients.map(coefficient), duration: round(p.duration_s, 3) }),
    }
}

/// Eight decimals keep a path within a millimeter over 10 s.
fn coefficient(c: f64) -> f64 {
    round(c, 8)
}

fn fan_view(candidates: &[CandidateRecord]) -> Vec<CandidateView> {
    let rewards = || candidates.iter().map(|c| c.reward).filter(|r| r.is_finite());
    let (low, high) = (rewards().fold(f64::INFINITY, f64::min), rewards().fold(f64::NEG_INFINITY, f64::max));
    let view = |c: &CandidateRecord| CandidateView {
        coefficients: c.coefficients.map(coefficient),
        duration: round(c.duration_s, 3),
        rank: if high > low { round((c.reward - low) / (high - low), 2) } else { 0.5 },
    };
    candidates.iter().map(view).collect()
}

fn speed_range(trace: &Trace) -> [f64; 2] {
    let frames = trace.ticks.iter().flat_map(|tick| &tick.frames);
    let speeds =
        frames.flat_map(|f| f.vehicles.iter().map(|v| v.speed_mps).chain([f.ego.speed_mps])).filter(|v| v.is_finite());
    let (low, high) = speeds.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
    if low < high { [round(low, 1), round(high, 1)] } else { [0.0, 40.0] }
}

fn sizes(trace: &Trace) -> Vec<(u32, f64, f64)> {
    let vehicles = trace.ticks.iter().flat_map(|tick| &tick.frames).flat_map(|frame| &frame.vehicles);
    let by_id: BTreeMap<u32, (f64, f64)> = vehicles.map(|v| (v.id, (v.length_m, v.width_m))).collect();
    by_id.into_iter().map(|(id, (length, width))| (id, round(length, 2), round(width, 2))).collect()
}
