//! Pictures of one instant, made without a display: RGB for videos and notebooks, a few lines of text for terminals.
//!
//! Both follow the ego along the road and show a curved road straightened: what is along the road runs to the right, what is to its
//! left is up. Lengths along and across have one scale, so headings keep their angle. Equal views give equal bytes.

mod picture;
mod terminal;
mod text;
mod view;

pub use self::picture::{SIZE_MAX_PX, SIZE_MIN_PX, rgb};
pub use self::terminal::{COLUMNS_MAX, COLUMNS_MIN, ansi};
pub use self::view::{Body, View};

/// Why there is no picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The size is out of range.
    #[error(
        "a picture of {width_px} × {height_px} px: it must be {min:?} to {max:?} px wide and high",
        min = SIZE_MIN_PX, max = SIZE_MAX_PX
    )]
    Size {
        /// Width asked for, px.
        width_px: u32,
        /// Height asked for, px.
        height_px: u32,
    },
    /// The width is out of range.
    #[error("{columns} columns: there must be {COLUMNS_MIN} to {COLUMNS_MAX}")]
    Columns {
        /// Width asked for.
        columns: usize,
    },
}

/// The ego is drawn at this share of the width.
const EGO_SHARE: f64 = 0.3;
/// A speed as high as the limit, or as this where there is none, has the last color, m/s (the paper's highest).
const FREE_SPEED_MPS: f64 = 33.333;
/// Colors from standing to the speed limit, those of the player in dark mode.
const SPEED_COLORS: [[u8; 3]; 4] = [[0x5a, 0x48, 0xb0], [0x3a, 0x86, 0xa8], [0x49, 0xc4, 0x97], [0xd6, 0xea, 0x76]];
/// Its ego.
const EGO_COLOR: [u8; 3] = [0xff, 0x8a, 0x4c];
/// Dashes of a lane line and their period, m.
const DASH_M: (f64, f64) = (6.0, 15.0);

/// The color of a speed where this limit holds.
fn speed_color(speed_mps: f64, limit_mps: f64) -> [u8; 3] {
    let share = (speed_mps / limit_mps.clamp(1.0, FREE_SPEED_MPS)).clamp(0.0, 1.0);
    let place = share * (SPEED_COLORS.len() - 1) as f64;
    let index = (place as usize).min(SPEED_COLORS.len() - 2);
    let (from, to) = (SPEED_COLORS[index], SPEED_COLORS[index + 1]);
    let mix = |a: u8, b: u8| (f64::from(a) + (place - index as f64) * (f64::from(b) - f64::from(a))).round() as u8;
    [mix(from[0], to[0]), mix(from[1], to[1]), mix(from[2], to[2])]
}

#[cfg(test)]
mod tests;
