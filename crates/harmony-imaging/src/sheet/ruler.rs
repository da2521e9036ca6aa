//! A piece of the photo with a ruler in thousandths of the whole photo along its border.

use harmony_scene::PixelBox;
use image::{Rgb, RgbImage, imageops};

use super::font::{GLYPH_PX, draw_text, put, text_width};

/// Width of the border, pixels: four digits and a tick.
const BORDER: u32 = 44;
/// Ticks along the longer side, about.
const TICKS: f64 = 8.0;

/// The window of the photo, enlarged or shrunk so that its longer side has about `longest_px` pixels, in a white border
/// with ticks whose numbers are thousandths of the photo's width (above) and height (left).
///
/// The window is cut to the photo; one without pixels gives a border around one pixel.
pub fn ruled_window(photo: &RgbImage, window: PixelBox, longest_px: u32) -> RgbImage {
    let (w, h) = (f64::from(photo.width()), f64::from(photo.height()));
    let x0 = window.x0.floor().clamp(0.0, w - 1.0);
    let y0 = window.y0.floor().clamp(0.0, h - 1.0);
    let cut_w = (window.x1.ceil().min(w) - x0).max(1.0);
    let cut_h = (window.y1.ceil().min(h) - y0).max(1.0);
    let cut = imageops::crop_imm(photo, x0 as u32, y0 as u32, cut_w as u32, cut_h as u32).to_image();
    let zoom = (f64::from(longest_px.clamp(64, 2048)) / cut_w.max(cut_h)).min(6.0);
    let (out_w, out_h) = ((cut_w * zoom).round().max(1.0) as u32, (cut_h * zoom).round().max(1.0) as u32);
    let piece = imageops::resize(&cut, out_w, out_h, imageops::FilterType::CatmullRom);
    let mut picture = RgbImage::from_pixel(out_w + BORDER + 8, out_h + 24, Rgb([255, 255, 255]));
    imageops::replace(&mut picture, &piece, i64::from(BORDER), 16);
    for (along_x, start, length, whole) in [(true, x0, cut_w, w), (false, y0, cut_h, h)] {
        for value in ticks(start / whole * 1000.0, (start + length) / whole * 1000.0) {
            let at = ((value / 1000.0 * whole - start) * zoom).round() as i64;
            let text = format!("{value}");
            for t in 0..4 {
                if along_x {
                    put(&mut picture, i64::from(BORDER) + at, 15 - t, [0, 0, 0]);
                } else {
                    put(&mut picture, i64::from(BORDER) - 1 - t, 16 + at, [0, 0, 0]);
                }
            }
            let half = i64::from(text_width(&text, 1)) / 2;
            let place = if along_x {
                (i64::from(BORDER) + at - half, 2)
            } else {
                (i64::from(BORDER) - 6 - 2 * half, 16 + at - i64::from(GLYPH_PX) / 2)
            };
            draw_text(&mut picture, &text, place, 1, [0, 0, 0]);
        }
    }
    picture
}

/// Round values between two numbers, about [`TICKS`] of them.
fn ticks(from: f64, to: f64) -> Vec<f64> {
    let step =
        [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0].into_iter().find(|s| (to - from) / s <= TICKS).unwrap_or(500.0);
    let first = (from / step).ceil() as i64;
    let last = (to / step).ceil() as i64;
    (first..=last).map(|k| k as f64 * step).filter(|v| *v <= to).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        assert_eq!(ticks(312.0, 371.0), [320.0, 330.0, 340.0, 350.0, 360.0, 370.0]);
        assert_eq!(ticks(0.0, 1000.0), [0.0, 200.0, 400.0, 600.0, 800.0, 1000.0]);
    }

    #[test]
    fn a_tick_stands_where_its_column_is() {
        // A photo with one red column at 500 thousandths.
        let photo = RgbImage::from_fn(200, 100, |x, _| if x == 100 { Rgb([255, 0, 0]) } else { Rgb([9, 9, 9]) });
        let window = PixelBox { x0: 80.0, y0: 20.0, x1: 120.0, y1: 60.0 };
        let ruled = ruled_window(&photo, window, 160);
        let red: Vec<u32> = (0..ruled.width())
            .filter(|x| ruled.get_pixel(*x, 60).0[0] > 150 && ruled.get_pixel(*x, 60).0[1] < 90)
            .collect();
        let middle = f64::from(red.iter().sum::<u32>()) / red.len() as f64;
        // The tick of 500 marks the column's left edge.
        let tick = BORDER + ((0.5 * 200.0 - 80.0) * 4.0) as u32;
        assert_eq!(ruled.get_pixel(tick, 13).0, [0, 0, 0]);
        assert!((middle - f64::from(tick) - 2.0).abs() < 2.0, "{middle} {tick}");
    }
}
