//! Small plots as inline SVG: axes with round ticks, lines, points with error bars, bands.
//!
//! Colors come from classes of the page, so that a plot follows the light or dark scheme; a drawing library would write fixed ones.
//! Values that are not finite are left out, and lines are broken there.

use std::fmt::Write as _;

use super::html::escape;
use crate::metrics::Interval;

/// Width and height of a plot in its own units, about pixels on a wide screen.
const SIZE: [f64; 2] = [500.0, 290.0];
/// Space left of, right of, above and below the plotting area.
const MARGINS: [f64; 4] = [52.0, 12.0, 34.0, 44.0];

/// Whether a value can be drawn: finite, and so small that differences stay finite.
pub(crate) fn drawable(value: f64) -> bool {
    value.abs() < 1e12
}

/// One axis: its name with the unit, its range and the distance between ticks.
pub(crate) struct Axis {
    name: String,
    low: f64,
    high: f64,
    step: f64,
}

impl Axis {
    /// An axis over all drawable values, extended to whole ticks.
    pub(crate) fn over(name: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.into_iter().filter(|x| drawable(*x)) {
            (low, high) = (low.min(value), high.max(value));
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        if high - low < 1e-9 * high.abs().max(1e-3) {
            // All zero is the floor of what is counted, such as collisions; anything else stands in the middle.
            let half = 0.05 * low.abs();
            (low, high) = if low == 0.0 { (0.0, 1.0) } else { (low - half, high + half) };
        }
        let step = round_step((high - low) / 5.0);
        // The slack keeps a bound that lies on a tick, up to rounding, from adding another one.
        let (first, last) = ((low / step + 1e-6).floor(), (high / step - 1e-6).ceil());
        Self { name: name.into(), low: first * step, high: last * step, step }
    }

    /// An axis over exactly this range, for time.
    pub(crate) fn exactly(name: &str, low: f64, high: f64) -> Self {
        let (low, high) = if drawable(low) && drawable(high) && high > low { (low, high) } else { (0.0, 1.0) };
        Self { name: name.into(), low, high, step: round_step((high - low) / 8.0) }
    }

    fn share(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    fn ticks(&self) -> impl Iterator<Item = f64> {
        let first = (self.low / self.step - 1e-6).ceil();
        let count = (self.high / self.step - first + 1e-6).floor();
        (0..=count as u32).map(move |i| (first + f64::from(i)) * self.step)
    }

    /// A tick's label: thousands and millions shortened, else as many decimals as the step needs.
    fn label(&self, tick: f64) -> String {
        let largest = self.low.abs().max(self.high.abs());
        let (divisor, suffix) = match largest {
            x if x >= 1e6 => (1e6, "M"),
            x if x >= 1e4 => (1e3, "k"),
            _ => (1.0, ""),
        };
        let decimals = (-libm::log10(self.step / divisor) - 1e-6).ceil().clamp(0.0, 9.0) as usize;
        let text = super::html::number(tick / divisor, decimals);
        if tick.abs() < 1e-9 * self.step { "0".into() } else { text + suffix }
    }
}

/// The next larger of 1, 2 or 5 times a power of ten.
fn round_step(rough: f64) -> f64 {
    let power = libm::exp10(libm::log10(rough).floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= rough * (1.0 - 1e-9)).unwrap_or(10.0);
    factor * power
}

/// A plot that is being drawn.
pub(crate) struct Plot {
    x: Axis,
    y: Axis,
    body: String,
}

impl Plot {
    /// The frame: grid, tick labels and axis names.
    pub(crate) fn new(x: Axis, y: Axis) -> Self {
        let mut plot = Self { x, y, body: String::new() };
        let ([left, right], [top, bottom]) = (Self::sides(), Self::ends());
        let mut frame = String::new();
        for tick in plot.y.ticks() {
            let (at, label) = (plot.y_px(tick), plot.y.label(tick));
            let _ = write!(frame, "<path class=\"grid-line\" d=\"M{left} {at:.1}H{right}\"/>");
            let _ =
                write!(frame, "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>", left - 8.0, at + 4.5);
        }
        for tick in plot.x.ticks() {
            let (at, label) = (plot.x_px(tick), plot.x.label(tick));
            let _ = write!(frame, "<path class=\"grid-line\" d=\"M{at:.1} {bottom}v5\"/>");
            let _ = write!(frame, "<text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{label}</text>", bottom + 19.0);
        }
        let (x_name, y_name) = (escape(&plot.x.name), escape(&plot.y.name));
        let middle = f64::midpoint(left, right);
        let _ = write!(frame, "<text class=\"axis-name\" x=\"0\" y=\"{}\">{y_name}</text>", top - 19.0);
        let _ = writeln!(
            frame,
            "<text class=\"axis-name\" x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{x_name}</text>",
            bottom + 39.0
        );
        plot.body = frame;
        plot
    }

    fn sides() -> [f64; 2] {
        [MARGINS[0], SIZE[0] - MARGINS[1]]
    }

    fn ends() -> [f64; 2] {
        [MARGINS[2], SIZE[1] - MARGINS[3]]
    }

    fn x_px(&self, value: f64) -> f64 {
        let [left, right] = Self::sides();
        left + self.x.share(value) * (right - left)
    }

    fn y_px(&self, value: f64) -> f64 {
        let [top, bottom] = Self::ends();
        bottom - self.y.share(value) * (bottom - top)
    }

    /// A line through the points, broken where one cannot be drawn, with the series' mark at its end.
    pub(crate) fn line(&mut self, points: &[[f64; 2]], series: usize) {
        self.faint_line(points, series, 1.0);
    }

    /// The same, of this opacity from 0 to 1.
    pub(crate) fn faint_line(&mut self, points: &[[f64; 2]], series: usize, opacity: f64) {
        let (mut path, mut last) = (String::new(), None);
        for point in points {
            let before = last;
            last = Some(*point).filter(|p| p.iter().all(|v| drawable(*v)));
            if let Some([x, y]) = last {
                let command = if before.is_some() { 'L' } else { 'M' };
                let _ = write!(path, "{command}{:.1} {:.1}", self.x_px(x), self.y_px(y));
            }
        }
        let faint = if opacity < 1.0 { format!(" stroke-opacity=\"{opacity:.2}\"") } else { String::new() };
        let _ = writeln!(self.body, "<path class=\"curve {}\" d=\"{path}\"{faint}/>", classes(series));
    }

    /// A faint band around a line: at each x from a low to a high y. Points that cannot be drawn are left out.
    pub(crate) fn ribbon(&mut self, points: &[[f64; 3]], series: usize) {
        let points: Vec<_> = points.iter().filter(|point| point.iter().all(|value| drawable(*value))).collect();
        let (low, high) = (self.y.low, self.y.high);
        let corner = |x: f64, y: f64| format!("{:.1},{:.1} ", self.x_px(x), self.y_px(y.clamp(low, high)));
        let there = points.iter().map(|[x, _, high]| corner(*x, *high));
        let back = points.iter().rev().map(|[x, low, _]| corner(*x, *low));
        let corners: String = there.chain(back).collect();
        let _ = writeln!(self.body, "<polygon class=\"ribbon s{}\" points=\"{}\"/>", series % 8, corners.trim_end());
    }

    /// A series' mark at a point, if it can be drawn.
    pub(crate) fn point(&mut self, [x, y]: [f64; 2], series: usize) {
        if drawable(x) && drawable(y) {
            self.body += &mark(self.x_px(x), self.y_px(y), series);
        }
    }

    /// A point with its intervals in both directions.
    pub(crate) fn point_with_intervals(&mut self, x: Interval, y: Interval, series: usize) {
        if !drawable(x.mean) || !drawable(y.mean) {
            return;
        }
        let (cx, cy) = (self.x_px(x.mean), self.y_px(y.mean));
        let mut path = String::new();
        if drawable(x.low) && drawable(x.high) {
            let (low, high) = (self.x_px(x.low), self.x_px(x.high));
            let _ = write!(path, "M{low:.1} {:.1}v8m0 -4H{high:.1}m0 -4v8", cy - 4.0);
        }
        if drawable(y.low) && drawable(y.high) {
            let (low, high) = (self.y_px(y.low), self.y_px(y.high));
            let _ = write!(path, "M{:.1} {low:.1}h8m-4 0V{high:.1}m-4 0h8", cx - 4.0);
        }
        let _ = writeln!(self.body, "<path class=\"whisker {}\" d=\"{path}\"/>", classes(series));
        self.body += &mark(cx, cy, series);
    }

    /// A shaded range of x with a name above it.
    pub(crate) fn band(&mut self, low: f64, high: f64, name: &str) {
        let [top, bottom] = Self::ends();
        let (x0, x1) = (self.x_px(low), self.x_px(high));
        let (width, height) = (x1 - x0, bottom - top);
        let _ = write!(
            self.body,
            "<rect class=\"band\" x=\"{x0:.1}\" y=\"{top}\" width=\"{width:.1}\" height=\"{height}\"/>"
        );
        let middle = f64::midpoint(x0, x1);
        let _ = writeln!(
            self.body,
            "<text class=\"band-name\" x=\"{middle:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            top - 5.0,
            escape(name)
        );
    }

    /// A dashed horizontal line, if it is in range.
    pub(crate) fn level(&mut self, y: f64) {
        if (0.0..=1.0).contains(&self.y.share(y)) {
            let [left, right] = Self::sides();
            let _ = writeln!(self.body, "<path class=\"lane\" d=\"M{left} {:.1}H{right}\"/>", self.y_px(y));
        }
    }

    /// The finished element, with a text alternative.
    pub(crate) fn finish(self, alternative: &str) -> String {
        self.wrap(alternative, "")
    }

    /// The finished element with a cursor at x = 0 px that the player moves; attributes tell it the scale.
    pub(crate) fn finish_with_cursor(mut self, alternative: &str) -> String {
        let ([left, right], [top, bottom]) = (Self::sides(), Self::ends());
        let _ = writeln!(self.body, "<path class=\"cursor\" d=\"M0 {top}V{bottom}\"/>");
        let (low, high) = (self.x.low, self.x.high);
        let scale =
            format!(" data-time-low=\"{low}\" data-time-high=\"{high}\" data-left=\"{left}\" data-right=\"{right}\"");
        self.wrap(alternative, &scale)
    }

    fn wrap(self, alternative: &str, attributes: &str) -> String {
        element(SIZE, alternative, attributes, &self.body)
    }
}

/// An `svg` element of class `plot`. Inline, it needs no name space.
pub(crate) fn element([width, height]: [f64; 2], alternative: &str, attributes: &str, body: &str) -> String {
    let alternative = escape(alternative);
    format!(
        "<svg class=\"plot\" viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{alternative}\"{attributes}>\n{body}</svg>\n"
    )
}

/// Finished plots below each other as one element.
pub(crate) fn stack(plots: &[String], alternative: &str) -> String {
    let [width, height] = SIZE;
    let place = |(row, plot): (usize, &String)| {
        let place = format!("<svg y=\"{}\" width=\"{width}\" height=\"{height}\" ", height * row as f64);
        plot.replacen("<svg ", &place, 1)
    };
    let body: String = plots.iter().enumerate().map(place).collect();
    element([width, height * plots.len() as f64], alternative, "", &body)
}

/// Color and dash of a series: 8 colors, then the same dashed.
pub(crate) fn classes(series: usize) -> String {
    format!("s{} dash{}", series % 8, series / 8 % 3)
}

/// The mark of a series, a regular polygon that differs from its neighbors' also without color.
pub(crate) fn mark(x: f64, y: f64, series: usize) -> String {
    /// Corners, angle of the first one in degrees, radius.
    const SHAPES: [(u32, f64, f64); 8] = [
        (24, 0.0, 5.5),
        (4, 45.0, 6.5),
        (3, -90.0, 7.5),
        (4, 0.0, 7.0),
        (3, 90.0, 7.5),
        (5, -90.0, 6.5),
        (6, 0.0, 6.5),
        (3, 0.0, 7.5),
    ];
    let (corners, first, radius) = SHAPES[series % 8];
    let mut points = String::new();
    for corner in 0..corners {
        let angle = (first + 360.0 * f64::from(corner) / f64::from(corners)).to_radians();
        let _ = write!(points, "{:.1},{:.1} ", x + radius * libm::cos(angle), y + radius * libm::sin(angle));
    }
    format!("<polygon class=\"point s{}\" points=\"{}\"/>\n", series % 8, points.trim_end())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis) -> Vec<String> {
        axis.ticks().map(|t| axis.label(t)).collect()
    }

    #[test]
    fn ticks_are_round_and_cover_the_values() {
        assert_eq!(labels(&Axis::over("", [0.3, 9.1])), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(labels(&Axis::over("", [-0.02, 0.05])), ["−0.02", "0", "0.02", "0.04", "0.06"]);
        assert_eq!(labels(&Axis::over("", [0.0, 1e6])), ["0", "0.2M", "0.4M", "0.6M", "0.8M", "1.0M"]);
        assert_eq!(labels(&Axis::exactly("", 1.0, 31.0)), ["5", "10", "15", "20", "25", "30"]);
    }

    #[test]
    fn odd_values_give_an_axis_all_the_same() {
        for values in [vec![], vec![f64::NAN, f64::INFINITY], vec![3.0, 3.0], vec![0.0], vec![-1e11, 1e300, 1e11]] {
            let axis = Axis::over("", values);
            assert!(axis.low < axis.high && axis.step > 0.0);
            assert!((2..20).contains(&axis.ticks().count()));
        }
    }

    #[test]
    fn lines_are_broken_at_values_that_cannot_be_drawn() {
        let mut plot = Plot::new(Axis::exactly("", 0.0, 4.0), Axis::exactly("", 0.0, 1.0));
        plot.body.clear();
        plot.line(&[[0.0, 0.0], [1.0, 1.0], [2.0, f64::NAN], [3.0, 0.5]], 0);
        assert_eq!((plot.body.matches('M').count(), plot.body.matches('L').count()), (2, 1));
    }
}
