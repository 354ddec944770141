//! A map of cells over two figures, each with a color and a mark that says the same without color.

use std::fmt::Write as _;

use crate::report::html::{escape, number};
use crate::report::svg::element;

/// How a cell looks: class of the style and mark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Look {
    pub(super) class: &'static str,
    pub(super) mark: &'static str,
}

/// One axis: its name and the cells' values with their decimals.
pub(super) struct CellAxis<'a> {
    pub(super) name: &'a str,
    pub(super) values: &'a [f64],
    pub(super) decimals: usize,
}

const CELL_PX: [f64; 2] = [36.0, 26.0];
const LEFT_PX: f64 = 58.0;
const TOP_PX: f64 = 34.0;
const BOTTOM_PX: f64 = 46.0;

/// The map; `looks` row by row from the lowest value of `y` on.
pub(super) fn cell_map(x: &CellAxis<'_>, y: &CellAxis<'_>, looks: &[Look], alternative: &str) -> String {
    let [width, height] = CELL_PX;
    let (columns, rows) = (x.values.len(), y.values.len());
    let bottom = TOP_PX + height * rows as f64;
    let mut body = String::new();
    for (index, look) in looks.iter().enumerate() {
        let (column, row) = (index % columns, index / columns);
        let (left, top) = (LEFT_PX + width * column as f64, bottom - height * (row + 1) as f64);
        let _ = writeln!(
            body,
            "<rect class=\"cell {}\" x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\"/>\
             <text class=\"cell-mark\" x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            look.class,
            left + 0.5 * width,
            top + 0.5 * height + 4.5,
            look.mark
        );
    }
    for (column, value) in x.values.iter().enumerate() {
        let at = LEFT_PX + width * (column as f64 + 0.5);
        let label = number(*value, x.decimals);
        let _ = writeln!(body, "<text x=\"{at}\" y=\"{}\" text-anchor=\"middle\">{label}</text>", bottom + 17.0);
    }
    for (row, value) in y.values.iter().enumerate() {
        let at = bottom - height * (row as f64 + 0.5) + 4.5;
        let label = number(*value, y.decimals);
        let _ = writeln!(body, "<text x=\"{}\" y=\"{at}\" text-anchor=\"end\">{label}</text>", LEFT_PX - 8.0);
    }
    let middle = LEFT_PX + 0.5 * width * columns as f64;
    let _ = writeln!(
        body,
        "<text class=\"axis-name\" x=\"0\" y=\"16\">{}</text>\
         <text class=\"axis-name\" x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
        escape(y.name),
        bottom + 37.0,
        escape(x.name)
    );
    let size = [LEFT_PX + width * columns as f64 + 12.0, bottom + BOTTOM_PX];
    element(size, alternative, "", &body)
}
