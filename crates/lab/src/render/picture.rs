//! The road from above, in pixels.

use lanecraft_drive::road::{LaneIndex, Side};
use lanecraft_drive::scenario::VehicleKind;
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint as Ink, PathBuilder, Pixmap, PremultipliedColorU8, Rect, Stroke,
    Transform,
};

use super::view::{Body, Paint, View};
use super::{EGO_COLOR, EGO_SHARE, RenderError, speed_color, text};

/// The smallest picture: width and height, px.
pub const SIZE_MIN_PX: (u32, u32) = (128, 64);
/// The largest picture, px.
pub const SIZE_MAX_PX: (u32, u32) = (4096, 2160);

/// At least this much of the road is seen along it, m.
const SPAN_M: f64 = 100.0;
/// Shoulders beside the outermost lanes that are seen at least, m.
const SHOULDER_M: f64 = 1.5;
/// Heights below this have the smallest letters, each further one enlarges them, px.
const ZOOM_PX: u32 = 150;

const VERGE: [u8; 3] = [0xb9, 0xc4, 0xae];
const ASPHALT: [u8; 3] = [0x3c, 0x42, 0x4d];
const SLIPPERY: [u8; 3] = [0x55, 0x7c, 0x9c];
const MARK: [u8; 3] = [0xea, 0xec, 0xf0];
const LANE_END: [u8; 3] = [0xe3, 0x4a, 0x33];
pub(super) const PATH: [u8; 3] = [0x74, 0xb4, 0xf5];
pub(super) const SIGNAL: [u8; 3] = [0xff, 0xe0, 0x2e];
const OUTLINE: [u8; 3] = [0x14, 0x18, 0x1e];
pub(super) const CRASH: [u8; 3] = [0xff, 0x2d, 0x2d];
const STRIP: [u8; 3] = [0x1d, 0x21, 0x27];
const INK: [u8; 3] = [0xf0, 0xf4, 0xfa];

/// A picture of `width_px` × `height_px` pixels of three bytes (red, green, blue), row by row from the top left.
///
/// Vehicles are colored from violet (standing) to yellow (as fast as the limit or, without one, as 33.3 m/s), the ego is orange; its
/// path and the lane it changes into are blue, turn signals yellow, the ends of lanes and a collision red.
///
/// # Errors
/// If the size is below [`SIZE_MIN_PX`] or above [`SIZE_MAX_PX`].
pub fn rgb(view: &View, width_px: u32, height_px: u32) -> Result<Vec<u8>, RenderError> {
    let allowed =
        (SIZE_MIN_PX.0..=SIZE_MAX_PX.0).contains(&width_px) && (SIZE_MIN_PX.1..=SIZE_MAX_PX.1).contains(&height_px);
    let pixmap = Pixmap::new(width_px, height_px).filter(|_| allowed);
    let mut canvas = Canvas::new(view, pixmap.ok_or(RenderError::Size { width_px, height_px })?);
    canvas.road();
    canvas.lines();
    canvas.plan();
    for vehicle in &view.vehicles {
        let color = speed_color(vehicle.speed_mps, view.road.speed_limit_mps(vehicle.s_m));
        canvas.body(vehicle, color, OUTLINE);
    }
    canvas.body(&view.ego, EGO_COLOR, INK);
    canvas.collision();
    canvas.strip();
    Ok(canvas.pixmap.pixels().iter().flat_map(|pixel| [pixel.red(), pixel.green(), pixel.blue()]).collect())
}

struct Canvas<'a> {
    view: &'a View,
    pixmap: Pixmap,
    /// Enlargement of letters.
    zoom: u32,
    /// Pixels for each meter.
    scale: f64,
    /// Where the ego's center is along the picture, px.
    ego_px: f64,
    /// Where the right edge of the road is from the top, px.
    right_edge_px: f64,
}

impl<'a> Canvas<'a> {
    fn new(view: &'a View, mut pixmap: Pixmap) -> Self {
        pixmap.fill(solid(VERGE));
        let (width, height) = (f64::from(pixmap.width()), f64::from(pixmap.height()));
        let zoom = (pixmap.height() / ZOOM_PX).max(1);
        let (right_m, left_m) = view.road.edges_m();
        let strip_px = f64::from(strip_px(zoom));
        let free_px = height - strip_px;
        let scale = (width / SPAN_M).min(free_px / (left_m - right_m + 2.0 * SHOULDER_M));
        let right_edge_px = strip_px + 0.5 * (free_px + scale * (left_m - right_m));
        Self { view, pixmap, zoom, scale, ego_px: EGO_SHARE * width, right_edge_px }
    }

    fn x_px(&self, ahead_m: f64) -> f64 {
        self.ego_px + self.scale * ahead_m
    }

    fn y_px(&self, d_m: f64) -> f64 {
        self.right_edge_px - self.scale * (d_m - self.view.road.edges_m().0)
    }

    /// The place that a column of pixels shows.
    fn s_m(&self, column: u32) -> f64 {
        self.view.s_ahead_m((f64::from(column) + 0.5 - self.ego_px) / self.scale)
    }

    /// First column and number of columns of each stretch on which something holds.
    fn runs(&self, holds: impl Fn(f64) -> bool) -> Vec<(u32, u32)> {
        let mut runs: Vec<(u32, u32)> = Vec::new();
        for column in (0..self.pixmap.width()).filter(|&column| holds(self.s_m(column))) {
            match runs.last_mut().filter(|(first, count)| first + count == column) {
                Some((_, count)) => *count += 1,
                None => runs.push((column, 1)),
            }
        }
        runs
    }

    fn rect(&mut self, (left, top): (f64, f64), (width, height): (f64, f64), color: Color) {
        let rect = Rect::from_xywh(left as f32, top as f32, width as f32, height as f32);
        if let Some(rect) = rect {
            self.pixmap.fill_rect(rect, &ink(color), Transform::identity(), None);
        }
    }

    /// Top and height of a lane in whole pixels, so that no seam shows between two, px.
    fn band(&self, lane: LaneIndex) -> (f64, f64) {
        let (center_m, half_m) = (self.view.road.lane_center_m(lane), 0.5 * self.view.road.lane_width_m());
        let [top_px, bottom_px] = [half_m, -half_m].map(|side_m| self.y_px(center_m + side_m).round());
        (top_px, bottom_px - top_px)
    }

    /// The surface of every lane where it exists, and a bar where one ends.
    fn road(&mut self) {
        let road = &self.view.road;
        for lane in road.lanes() {
            let (top_px, height_px) = self.band(lane);
            let exists = |s_m| road.lane_holds(lane, s_m, 0.0);
            let slippery = |s_m| exists(s_m) && road.adhesion_at(s_m) < road.adhesion();
            let surfaces = self.runs(exists);
            let patches = if road.is_uniform() { Vec::new() } else { self.runs(slippery) };
            for (runs, color) in [(&surfaces, ASPHALT), (&patches, SLIPPERY)] {
                for &(first, count) in runs {
                    self.rect((f64::from(first), top_px), (f64::from(count), height_px), solid(color));
                }
            }
            let ends = surfaces.iter().map(|(first, count)| first + count).filter(|&end| end < self.pixmap.width());
            let bar_px = 0.5 * self.scale;
            for end in ends.collect::<Vec<_>>() {
                self.rect((f64::from(end) - bar_px, top_px), (bar_px, height_px), solid(LANE_END));
            }
        }
    }

    fn lines(&mut self) {
        let (view, line_px) = (self.view, (0.2 * self.scale).max(1.0));
        for line in view.lines() {
            let d_m = (f64::from(line) - 0.5) * view.road.lane_width_m();
            let top_px = self.y_px(d_m) - 0.5 * line_px;
            let painted = self.runs(|s_m| matches!(view.paint(line, s_m), Paint::Solid | Paint::Dash));
            for (first, count) in painted {
                self.rect((f64::from(first), top_px), (f64::from(count), line_px), solid(MARK));
            }
        }
    }

    /// The lane that the ego changes into, and its path there.
    fn plan(&mut self) {
        let view = self.view;
        if view.target_lane != view.road.nearest_lane(view.ego.d_m) || !view.path.is_empty() {
            self.target_lane(view.target_lane);
        }
        let points: Vec<_> =
            view.path.iter().map(|(s_m, d_m)| (self.x_px(view.ahead_m(*s_m)), self.y_px(*d_m))).collect();
        if let Some(&(x, y)) = points.last() {
            self.stroke(&points, 0.45 * self.scale, PATH);
            let mut circle = PathBuilder::new();
            circle.push_circle(x as f32, y as f32, (0.6 * self.scale) as f32);
            self.fill(circle, PATH);
        }
    }

    fn target_lane(&mut self, lane: LaneIndex) {
        let (top_px, height_px) = self.band(lane);
        let [red, green, blue] = PATH;
        let width_px = f64::from(self.pixmap.width()) - self.ego_px;
        self.rect((self.ego_px, top_px), (width_px, height_px), Color::from_rgba8(red, green, blue, 0x38));
    }

    /// A vehicle: body, windows, turn signals.
    fn body(&mut self, body: &Body, color: [u8; 3], outline: [u8; 3]) {
        let ahead_m = self.view.ahead_m(body.s_m);
        let x_px = self.x_px(ahead_m);
        let reach_px = self.scale * (body.length_m + body.width_m);
        if !(-reach_px..=f64::from(self.pixmap.width()) + reach_px).contains(&x_px) {
            return;
        }
        let shape = Shape { body, center_px: (x_px, self.y_px(body.d_m)), scale: self.scale };
        let hull = shape.hull();
        self.fill(polygon(&hull), color);
        for window in shape.windows() {
            self.fill(polygon(&window), OUTLINE);
        }
        let closed: Vec<_> = hull.iter().chain(&hull[..2]).copied().collect();
        self.stroke(&closed, (0.14 * self.scale).max(1.0), outline);
        for lamp in shape.lamps() {
            self.fill(polygon(&lamp), SIGNAL);
        }
    }

    /// Rays around the place where the ego touches the other vehicle.
    fn collision(&mut self) {
        let Some(index) = self.view.collision else { return };
        let ego = &self.view.ego;
        let other = self.view.vehicles.get(index).unwrap_or(ego);
        let (x, y) = (self.x_px(0.5 * self.view.ahead_m(other.s_m)), self.y_px(0.5 * (ego.d_m + other.d_m)));
        let radius_px = 2.6 * self.scale;
        let mut star = Vec::new();
        for corner in 0..16 {
            let (sin, cos) = libm::sincos(f64::from(corner) * core::f64::consts::PI / 8.0);
            let reach_px = if corner % 2 == 0 { radius_px } else { 0.5 * radius_px };
            star.push((x + reach_px * cos, y + reach_px * sin));
        }
        star.extend_from_within(..2);
        self.stroke(&star, (0.35 * self.scale).max(2.0), CRASH);
    }

    fn strip(&mut self) {
        let (width, height, pad) =
            (f64::from(self.pixmap.width()), strip_px(self.zoom), self.zoom * text::GLYPH_PX / 2);
        self.rect((0.0, 0.0), (width, f64::from(height)), solid(STRIP));
        let [red, green, blue] = if self.view.collision.is_some() { [0xff, 0x8c, 0x8c] } else { INK };
        if let Some(color) = PremultipliedColorU8::from_rgba(red, green, blue, u8::MAX) {
            text::write(&mut self.pixmap, &self.view.status(), (pad, pad), self.zoom, color);
        }
    }

    fn fill(&mut self, path: PathBuilder, color: [u8; 3]) {
        if let Some(path) = path.finish() {
            self.pixmap.fill_path(&path, &ink(solid(color)), FillRule::Winding, Transform::identity(), None);
        }
    }

    fn stroke(&mut self, points: &[(f64, f64)], width_px: f64, color: [u8; 3]) {
        let stroke = Stroke {
            width: width_px as f32,
            line_cap: LineCap::Round,
            line_join: LineJoin::Round,
            ..Stroke::default()
        };
        if let Some(path) = polyline(points).finish() {
            self.pixmap.stroke_path(&path, &ink(solid(color)), &stroke, Transform::identity(), None);
        }
    }
}

/// A vehicle on the canvas.
struct Shape<'a> {
    body: &'a Body,
    center_px: (f64, f64),
    scale: f64,
}

impl Shape<'_> {
    /// Points given in m to the front and to the left of the center.
    fn place<const N: usize>(&self, points_m: [(f64, f64); N]) -> [(f64, f64); N] {
        let (sin, cos) = libm::sincos(self.body.heading_rad);
        points_m.map(|(front_m, left_m)| {
            let (along_m, across_m) = (front_m * cos - left_m * sin, front_m * sin + left_m * cos);
            (self.center_px.0 + self.scale * along_m, self.center_px.1 - self.scale * across_m)
        })
    }

    /// The outline, its corners cut.
    fn hull(&self) -> [(f64, f64); 8] {
        let (x, y) = (0.5 * self.body.length_m, 0.5 * self.body.width_m);
        let cut = 0.25 * y;
        self.place([
            (x, y - cut),
            (x - cut, y),
            (cut - x, y),
            (-x, y - cut),
            (-x, cut - y),
            (cut - x, -y),
            (x - cut, -y),
            (x, cut - y),
        ])
    }

    /// Windshield and rear window of a car; windshield of a truck and the gap behind its cab.
    fn windows(&self) -> [[(f64, f64); 4]; 2] {
        let (x, y) = (0.5 * self.body.length_m, 0.5 * self.body.width_m);
        let pane = |from: f64, to: f64, rear: f64, front: f64| {
            self.place([(from * x, rear * y), (from * x, -rear * y), (to * x, -front * y), (to * x, front * y)])
        };
        match self.body.kind {
            VehicleKind::Car => [pane(0.15, 0.45, 0.6, 0.75), pane(-0.75, -0.55, 0.7, 0.6)],
            VehicleKind::Truck => [pane(0.84, 0.93, 0.75, 0.75), pane(0.62, 0.66, 1.0, 1.0)],
        }
    }

    /// Front and rear lamp of the signaling side.
    fn lamps(&self) -> Vec<[(f64, f64); 4]> {
        let Some(side) = self.body.signal else { return Vec::new() };
        let left = if side == Side::Left { 1.0 } else { -1.0 };
        let (x, y) = (0.5 * self.body.length_m, 0.5 * self.body.width_m * left);
        let (long_m, wide_m) = (0.8, 0.6 * left);
        let lamp =
            |from_m: f64, to_m: f64| self.place([(from_m, y), (to_m, y), (to_m, y - wide_m), (from_m, y - wide_m)]);
        vec![lamp(x - long_m, x), lamp(-x, long_m - x)]
    }
}

/// Height of the strip of text, px.
fn strip_px(zoom: u32) -> u32 {
    2 * zoom * text::GLYPH_PX
}

fn polyline(points: &[(f64, f64)]) -> PathBuilder {
    let mut path = PathBuilder::new();
    for (index, &(x, y)) in points.iter().enumerate() {
        if index == 0 {
            path.move_to(x as f32, y as f32);
        } else {
            path.line_to(x as f32, y as f32);
        }
    }
    path
}

fn polygon(points: &[(f64, f64)]) -> PathBuilder {
    let mut path = polyline(points);
    path.close();
    path
}

fn solid([red, green, blue]: [u8; 3]) -> Color {
    Color::from_rgba8(red, green, blue, u8::MAX)
}

fn ink(color: Color) -> Ink<'static> {
    let mut ink = Ink::default();
    ink.set_color(color);
    ink
}
