//! Text in pixels: the 8 × 8 glyphs of old terminals, enlarged by whole numbers.

use font8x8::legacy::BASIC_LEGACY;
use tiny_skia::{Pixmap, PremultipliedColorU8};

/// Width and height of a glyph, px.
pub(super) const GLYPH_PX: u32 = 8;

/// Writes `text` from (`left_px`, `top_px`) on, each pixel of a glyph `zoom` pixels wide and high; what does not fit is left out.
pub(super) fn write(
    pixmap: &mut Pixmap,
    text: &str,
    (left_px, top_px): (u32, u32),
    zoom: u32,
    color: PremultipliedColorU8,
) {
    let (width, height) = (pixmap.width(), pixmap.height());
    let pixels = pixmap.pixels_mut();
    for (index, letter) in text.chars().enumerate() {
        let glyph = BASIC_LEGACY.get(letter as usize).unwrap_or(&BASIC_LEGACY['?' as usize]);
        let glyph_left_px = left_px + index as u32 * GLYPH_PX * zoom;
        if glyph_left_px + GLYPH_PX * zoom > width {
            return;
        }
        for y in 0..GLYPH_PX * zoom {
            for x in 0..GLYPH_PX * zoom {
                let inked = glyph[(y / zoom) as usize] >> (x / zoom) & 1 == 1;
                if inked && top_px + y < height {
                    pixels[((top_px + y) * width + glyph_left_px + x) as usize] = color;
                }
            }
        }
    }
}
