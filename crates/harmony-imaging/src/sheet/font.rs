//! Text in pictures: the 8x8 bitmap font, enlarged by whole factors.

use font8x8::UnicodeFonts;
use image::{Rgb, RgbImage};

/// Side of a glyph at scale 1.
pub(super) const GLYPH_PX: u32 = 8;

/// Width of a line of text, pixels.
pub(super) fn text_width(text: &str, scale: u32) -> u32 {
    text.chars().count() as u32 * GLYPH_PX * scale
}

/// As much of the text as fits the width, ending in ".." when cut.
pub(super) fn fitted(text: &str, scale: u32, width: u32) -> String {
    let room = (width / (GLYPH_PX * scale.max(1))) as usize;
    if text.chars().count() <= room {
        return text.to_owned();
    }
    let head: String = text.chars().take(room.saturating_sub(2)).collect();
    if room >= 3 { head + ".." } else { text.chars().take(room).collect() }
}

/// Writes text with its top-left corner at (x, y); parts outside the image are left out, characters without a glyph
/// become `?`.
pub(super) fn draw_text(image: &mut RgbImage, text: &str, (x, y): (i64, i64), scale: u32, color: [u8; 3]) {
    for (i, character) in text.chars().enumerate() {
        let glyph = font8x8::BASIC_FONTS
            .get(character)
            .or_else(|| font8x8::LATIN_FONTS.get(character))
            .or_else(|| font8x8::BASIC_FONTS.get('?'))
            .unwrap_or([0; 8]);
        let left = x + i as i64 * i64::from(GLYPH_PX * scale);
        for (row, bits) in glyph.iter().enumerate() {
            for column in 0..8_u32 {
                if bits >> column & 1 == 0 {
                    continue;
                }
                for dy in 0..scale {
                    for dx in 0..scale {
                        let px = left + i64::from(column * scale + dx);
                        let py = y + (row as i64) * i64::from(scale) + i64::from(dy);
                        put(image, px, py, color);
                    }
                }
            }
        }
    }
}

/// Width and height of the ground of a text.
pub(super) fn tag_size(text: &str, scale: u32) -> (i64, i64) {
    let margin = i64::from(scale);
    (i64::from(text_width(text, scale)) + 2 * margin, i64::from(GLYPH_PX * scale) + 2 * margin)
}

/// Text on a filled ground with a margin; moved to stay inside the image.
pub(super) fn draw_tag(image: &mut RgbImage, text: &str, (x, y): (i64, i64), scale: u32, ground: [u8; 3]) {
    let margin = i64::from(scale);
    let (w, h) = tag_size(text, scale);
    let x = x.min(i64::from(image.width()) - w).max(0);
    let y = y.min(i64::from(image.height()) - h).max(0);
    for py in y..y + h {
        for px in x..x + w {
            put(image, px, py, ground);
        }
    }
    draw_text(image, text, (x + margin, y + margin), scale, readable_on(ground));
}

/// Black or white, whichever is easier to read on the colour.
pub(super) fn readable_on(ground: [u8; 3]) -> [u8; 3] {
    if crate::color::lab_from_rgb8(ground)[0] > 60.0 { [0, 0, 0] } else { [255, 255, 255] }
}

/// Sets a pixel, if it is in the image.
pub(super) fn put(image: &mut RgbImage, x: i64, y: i64, color: [u8; 3]) {
    if x >= 0 && y >= 0 && x < i64::from(image.width()) && y < i64::from(image.height()) {
        image.put_pixel(x as u32, y as u32, Rgb(color));
    }
}
