//! A scene as a picture: the road at its start, and how everybody moved relative to the ego.
//!
//! Plain SVG with fixed colors, so that it can be shown anywhere. Equal traces give equal bytes.

use std::fmt::Write as _;

use lanecraft_drive::env::{Frame, Trace};
use lanecraft_drive::road::Road;

use crate::report::html::escape;

/// Width of the drawing, of its margins left and right, and of the plots between them, px.
const WIDTH_PX: f64 = 880.0;
const LEFT_PX: f64 = 62.0;
const PLOT_PX: f64 = WIDTH_PX - LEFT_PX - 26.0;
/// What is shown of the road, behind and ahead of the ego, m.
const WINDOW_M: (f64, f64) = (-150.0, 250.0);
/// Lanes are drawn this wide, px: three times as wide as they are long, or vehicles would be slivers.
const LANE_PX: f64 = 19.0;
/// Top and height of the plot of distances, relative to the end of the road's strip, px.
const PATHS_PX: (f64, f64) = (44.0, 250.0);
/// Height of each of the two strips below it, px.
const STRIP_PX: f64 = 62.0;
/// Pieces of the road at the start whose lanes and grip are looked at.
const STRETCHES: u32 = 200;
/// Frames between two points of a line.
const STRIDE: usize = 20;
/// Speeds from slow to fast: what each color begins at, m/s.
const SPEED_COLORS: [(f64, &str); 6] =
    [(0.0, "#a50026"), (3.0, "#e34a33"), (10.0, "#f4a13a"), (16.0, "#8fb84a"), (21.0, "#2c9c8f"), (27.0, "#2a6fb5")];
const EGO: &str = "#111111";
/// Where there is no lane, where the road is slippery, and the speed limit.
const NO_LANE: &str = "#b9b9b9";
const SLIPPERY: &str = "#bfe0f5";
const LIMIT: &str = "#c2185b";

/// The picture of a recorded episode on `road`.
pub fn picture(title: &str, trace: &Trace, road: &Road) -> String {
    let frames: Vec<&Frame> = trace.ticks.iter().flat_map(|tick| &tick.frames).collect();
    let Some(first) = frames.first() else { return String::new() };
    let mut drawing = Drawing { svg: String::new(), duration_s: frames.last().map_or(1.0, |frame| frame.time_s) };
    let lanes_px = f64::from(road.config().lanes) * LANE_PX;
    let road_top_px = 40.0;
    drawing.title(title, trace);
    drawing.road(road, trace, first, road_top_px);
    let paths_top_px = road_top_px + lanes_px + PATHS_PX.0;
    drawing.paths(&frames, paths_top_px);
    let lateral_top_px = paths_top_px + PATHS_PX.1 + 26.0;
    drawing.lateral(&frames, road, lateral_top_px);
    let speed_top_px = lateral_top_px + STRIP_PX + 22.0;
    drawing.speed(&frames, road, speed_top_px);
    let height_px = speed_top_px + STRIP_PX + 62.0;
    drawing.legend(height_px - 16.0);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH_PX} {height_px:.0}\" \
         font-family=\"sans-serif\" font-size=\"12\" fill=\"#333\">\n\
         <rect width=\"{WIDTH_PX}\" height=\"{height_px:.0}\" fill=\"#fff\"/>\n{}</svg>\n",
        drawing.svg
    )
}

struct Drawing {
    svg: String,
    duration_s: f64,
}

impl Drawing {
    fn line(&mut self, text: &str) {
        self.svg.push_str(text);
        self.svg.push('\n');
    }

    fn text(&mut self, (x, y): (f64, f64), anchor: &str, text: &str) {
        let text = escape(text);
        let _ = writeln!(self.svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>");
    }

    fn frame(&mut self, top_px: f64, height_px: f64) {
        let _ = writeln!(
            self.svg,
            "<rect x=\"{LEFT_PX}\" y=\"{top_px:.1}\" width=\"{PLOT_PX}\" height=\"{height_px:.1}\" fill=\"#fafafa\" \
             stroke=\"#bbb\"/>"
        );
    }

    fn title(&mut self, title: &str, trace: &Trace) {
        let _ = writeln!(
            self.svg,
            "<text x=\"12\" y=\"22\" font-size=\"15\" font-weight=\"bold\">{}</text>",
            escape(title)
        );
        let end = trace.ticks.last().and_then(|tick| tick.frames.last()).map_or(0.0, |frame| frame.time_s);
        let note = format!("{}, seed {}, {end:.0} s", trace.header.policy, trace.header.scenario_seed);
        self.text((WIDTH_PX - 26.0, 22.0), "end", &note);
    }

    /// The road around the ego at the start, with every vehicle to scale along it.
    fn road(&mut self, road: &Road, trace: &Trace, first: &Frame, top_px: f64) {
        let lanes = f64::from(road.config().lanes);
        let bottom_px = top_px + lanes * LANE_PX;
        let y_px = |d_m: f64| bottom_px - (d_m / road.lane_width_m() + 0.5) * LANE_PX;
        let _ = writeln!(
            self.svg,
            "<rect x=\"{LEFT_PX}\" y=\"{top_px}\" width=\"{PLOT_PX}\" height=\"{:.1}\" fill=\"#e6e6e6\"/>",
            lanes * LANE_PX
        );
        let start_m = first.ego.s_m;
        let places =
            || (0..=STRETCHES).map(|k| WINDOW_M.0 + f64::from(k) * (WINDOW_M.1 - WINDOW_M.0) / f64::from(STRETCHES));
        let slippery = stretches(places().map(|m| (x_of_ahead(m), is_slippery(road, road.wrap_m(start_m + m)))));
        self.shade(&slippery, (top_px, lanes * LANE_PX), SLIPPERY);
        for lane in road.lanes() {
            let missing =
                stretches(places().map(|m| (x_of_ahead(m), !road.lane_holds(lane, road.wrap_m(start_m + m), 0.0))));
            self.shade(&missing, (bottom_px - f64::from(lane.0 + 1) * LANE_PX, LANE_PX), NO_LANE);
        }
        for lane in 1..road.config().lanes {
            let y = bottom_px - f64::from(lane) * LANE_PX;
            let _ = writeln!(
                self.svg,
                "<path d=\"M{LEFT_PX} {y:.1}h{PLOT_PX}\" stroke=\"#fff\" stroke-width=\"1.5\" stroke-dasharray=\"9 14\"/>"
            );
        }
        for vehicle in &first.vehicles {
            let color = speed_color(vehicle.speed_mps);
            self.body(vehicle.ahead_m, y_px(vehicle.d_m), vehicle.length_m, color);
        }
        self.body(0.0, y_px(first.ego.d_m), trace.header.ego_length_m, EGO);
        for ahead_m in [-100.0, 0.0, 100.0, 200.0] {
            self.text((x_of_ahead(ahead_m), bottom_px + 15.0), "middle", &format!("{ahead_m:.0} m"));
        }
        self.text((LEFT_PX - 8.0, 0.5 * (top_px + bottom_px) + 4.0), "end", "start");
    }

    /// Rectangles over these stretches from left to right, with this top and height.
    fn shade(&mut self, stretches: &[(f64, f64)], (top_px, height_px): (f64, f64), color: &str) {
        for (from, to) in stretches {
            let width = to - from;
            self.line(&format!(
                "<rect x=\"{from:.1}\" y=\"{top_px:.1}\" width=\"{width:.1}\" height=\"{height_px:.1}\" fill=\"{color}\"/>"
            ));
        }
    }

    fn body(&mut self, ahead_m: f64, y_px: f64, length_m: f64, color: &str) {
        let (rear_m, front_m) = (ahead_m - 0.5 * length_m, ahead_m + 0.5 * length_m);
        if front_m < WINDOW_M.0 || rear_m > WINDOW_M.1 {
            return;
        }
        let (from, to) = (x_of_ahead(rear_m.max(WINDOW_M.0)), x_of_ahead(front_m.min(WINDOW_M.1)));
        let height = 0.5 * LANE_PX;
        let _ = writeln!(
            self.svg,
            "<rect x=\"{from:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{height}\" rx=\"1.5\" fill=\"{color}\"/>",
            y_px - 0.5 * height,
            to - from
        );
    }

    fn x_of_time(&self, time_s: f64) -> f64 {
        LEFT_PX + PLOT_PX * time_s / self.duration_s
    }

    /// Where everybody was relative to the ego: a line that falls through 0 is a vehicle overtaken.
    fn paths(&mut self, frames: &[&Frame], top_px: f64) {
        let height_px = PATHS_PX.1;
        self.frame(top_px, height_px);
        let y_px = |ahead_m: f64| top_px + height_px * (WINDOW_M.1 - ahead_m) / (WINDOW_M.1 - WINDOW_M.0);
        let shown: Vec<&&Frame> = frames.iter().step_by(STRIDE).chain(frames.last()).collect();
        let ids: std::collections::BTreeSet<u32> =
            shown.iter().flat_map(|frame| frame.vehicles.iter().map(|vehicle| vehicle.id)).collect();
        for id in ids {
            let mut path = ColoredPath::default();
            for frame in &shown {
                let found = frame.vehicles.iter().find(|vehicle| vehicle.id == id);
                let found = found.filter(|vehicle| (WINDOW_M.0..=WINDOW_M.1).contains(&vehicle.ahead_m));
                match found {
                    Some(v) => path.point((self.x_of_time(frame.time_s), y_px(v.ahead_m)), speed_color(v.speed_mps)),
                    None => path.lift(),
                }
            }
            self.line(&path.finish());
        }
        let (left, zero) = (LEFT_PX, y_px(0.0));
        self.line(&format!("<path d=\"M{left} {zero:.1}h{PLOT_PX}\" stroke=\"{EGO}\" stroke-width=\"2.2\"/>"));
        for ahead_m in [-100.0, 0.0, 100.0, 200.0] {
            self.text((LEFT_PX - 6.0, y_px(ahead_m) + 4.0), "end", &format!("{ahead_m:.0} m"));
        }
        self.text((LEFT_PX, top_px - 7.0), "start", "distance ahead of the ego, colored by speed");
    }

    fn lateral(&mut self, frames: &[&Frame], road: &Road, top_px: f64) {
        self.frame(top_px, STRIP_PX);
        let (right_m, left_m) = road.edges_m();
        let y_px = |d_m: f64| top_px + STRIP_PX * (left_m - d_m) / (left_m - right_m);
        let over_time = |is: &dyn Fn(f64) -> bool| {
            stretches(frames.iter().map(|frame| (self.x_of_time(frame.time_s), is(road.wrap_m(frame.ego.s_m)))))
        };
        let slippery = over_time(&|s_m| is_slippery(road, s_m));
        let missing: Vec<_> = road.lanes().map(|lane| over_time(&|s_m| !road.lane_holds(lane, s_m, 0.0))).collect();
        self.shade(&slippery, (top_px, STRIP_PX), SLIPPERY);
        for (lane, missing) in road.lanes().zip(&missing) {
            let y = y_px(road.lane_center_m(lane));
            let lane_px = STRIP_PX / f64::from(road.config().lanes);
            self.shade(missing, (y - 0.5 * lane_px, lane_px), NO_LANE);
            self.line(&format!("<path d=\"M{LEFT_PX} {y:.1}h{PLOT_PX}\" stroke=\"#ddd\"/>"));
            // More than four numbers would run into each other.
            if lane.0 % (1 + road.config().lanes / 5) == 0 {
                self.text((LEFT_PX - 6.0, y + 4.0), "end", &lane.0.to_string());
            }
        }
        self.curve(frames, |frame| y_px(frame.ego.d_m));
        let mut label = "the ego's lane".to_owned();
        if missing.iter().any(|stretches| !stretches.is_empty()) {
            label += "; gray: no lane there";
        }
        if !slippery.is_empty() {
            label += "; blue: slippery";
        }
        self.text((LEFT_PX, top_px - 6.0), "start", &label);
    }

    fn speed(&mut self, frames: &[&Frame], road: &Road, top_px: f64) {
        self.frame(top_px, STRIP_PX);
        let y_px = |speed_mps: f64| top_px + STRIP_PX * (1.0 - speed_mps / 40.0);
        for speed_mps in [0.0, 20.0, 40.0] {
            self.text((LEFT_PX - 6.0, y_px(speed_mps) + 4.0), "end", &format!("{speed_mps:.0}"));
        }
        let mut label = "its speed, m/s";
        if !road.config().speed_limits.is_empty() {
            label = "its speed and the limit (red), m/s";
            let mut path = ColoredPath::default();
            for frame in frames {
                let limit_mps = road.speed_limit_mps(road.wrap_m(frame.ego.s_m));
                if limit_mps <= 40.0 {
                    path.point((self.x_of_time(frame.time_s), y_px(limit_mps)), LIMIT);
                } else {
                    path.lift();
                }
            }
            self.line(&path.finish());
        }
        self.curve(frames, |frame| y_px(frame.ego.speed_mps));
        self.text((LEFT_PX, top_px - 6.0), "start", label);
        let step_s = if self.duration_s > 30.0 { 10.0 } else { 5.0 };
        for k in 0..=(self.duration_s / step_s) as u32 {
            let time_s = f64::from(k) * step_s;
            self.text((self.x_of_time(time_s), top_px + STRIP_PX + 15.0), "middle", &format!("{time_s:.0} s"));
        }
    }

    fn curve(&mut self, frames: &[&Frame], y_px: impl Fn(&Frame) -> f64) {
        let mut path = ColoredPath::default();
        for frame in frames.iter().step_by(STRIDE / 4).chain(frames.last()) {
            path.point((self.x_of_time(frame.time_s), y_px(frame)), EGO);
        }
        self.line(&path.finish());
    }

    fn legend(&mut self, y_px: f64) {
        let mut x_px = LEFT_PX;
        self.body_of_legend(&mut x_px, y_px, EGO, "the ego");
        for (index, (from_mps, color)) in SPEED_COLORS.into_iter().enumerate() {
            let label = match SPEED_COLORS.get(index + 1) {
                Some((to_mps, _)) => format!("{from_mps:.0} to {to_mps:.0} m/s"),
                None => format!("from {from_mps:.0} m/s on"),
            };
            self.body_of_legend(&mut x_px, y_px, color, &label);
        }
    }

    fn body_of_legend(&mut self, x_px: &mut f64, y_px: f64, color: &str, label: &str) {
        let (x, y) = (*x_px, y_px - 9.0);
        self.line(&format!("<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"11\" height=\"10\" fill=\"{color}\"/>"));
        self.text((x + 15.0, y_px), "start", label);
        *x_px += 32.0 + 6.6 * label.chars().count() as f64;
    }
}

fn is_slippery(road: &Road, s_m: f64) -> bool {
    road.adhesion_at(s_m) < road.adhesion()
}

/// The stretches from left to right on which something holds, given at points.
fn stretches(points: impl Iterator<Item = (f64, bool)>) -> Vec<(f64, f64)> {
    let mut found: Vec<(f64, f64)> = Vec::new();
    let mut open = false;
    for (x, holds) in points {
        match (holds, open) {
            (true, true) => found.last_mut().expect("one is open").1 = x,
            (true, false) => found.push((x, x)),
            (false, _) => {}
        }
        open = holds;
    }
    found
}

fn x_of_ahead(ahead_m: f64) -> f64 {
    LEFT_PX + PLOT_PX * (ahead_m - WINDOW_M.0) / (WINDOW_M.1 - WINDOW_M.0)
}

fn speed_color(speed_mps: f64) -> &'static str {
    let reached = SPEED_COLORS.iter().rev().find(|(from_mps, _)| speed_mps >= *from_mps);
    reached.map_or(SPEED_COLORS[0].1, |(_, color)| color)
}

/// A line in pieces of one color each.
#[derive(Default)]
struct ColoredPath {
    svg: String,
    piece: String,
    color: &'static str,
    last: Option<(f64, f64)>,
}

impl ColoredPath {
    fn point(&mut self, (x, y): (f64, f64), color: &'static str) {
        match self.last {
            Some((last_x, last_y)) if color == self.color => {
                // Relative coordinates are shorter; rounded positions are subtracted, so that nothing adds up.
                let (dx, dy) = (tenths(x) - tenths(last_x), tenths(y) - tenths(last_y));
                let _ = write!(self.piece, "l{} {}", short(dx), short(dy));
            }
            Some((last_x, last_y)) => {
                self.close();
                let _ = write!(self.piece, "M{last_x:.1} {last_y:.1}L{x:.1} {y:.1}");
            }
            None => {
                self.close();
                let _ = write!(self.piece, "M{x:.1} {y:.1}");
            }
        }
        (self.color, self.last) = (color, Some((x, y)));
    }

    fn lift(&mut self) {
        self.close();
        self.last = None;
    }

    fn close(&mut self) {
        // A lone point draws nothing.
        if self.piece.contains(['l', 'L']) {
            let (piece, color) = (&self.piece, self.color);
            let _ = write!(self.svg, "<path d=\"{piece}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.3\"/>");
        }
        self.piece.clear();
    }

    fn finish(mut self) -> String {
        self.close();
        self.svg
    }
}

fn tenths(x: f64) -> i64 {
    (10.0 * x).round() as i64
}

/// A number of tenths, without digits that say nothing.
fn short(tenths: i64) -> String {
    if tenths % 10 == 0 { (tenths / 10).to_string() } else { format!("{:.1}", tenths as f64 / 10.0) }
}
