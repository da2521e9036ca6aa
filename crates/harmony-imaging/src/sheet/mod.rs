//! Pictures for questions: contact sheets, boxes, overlays, grids, crops.

mod font;
mod ruler;

use harmony_scene::{ImageSize, Mask, PixelBox};
use image::{Rgb, RgbImage, Rgba, RgbaImage, imageops};

use crate::color::rgb8_from_lab;
use crate::resample::resize_rgba;
pub use ruler::ruled_window;

use font::{GLYPH_PX, draw_tag, draw_text, fitted, put, text_width};

/// A cell of a contact sheet.
#[derive(Debug, Clone)]
pub struct Cell<'a> {
    /// Drawn above the picture, after the number.
    pub label: String,
    /// The picture; transparent parts show a light checkerboard.
    pub image: &'a RgbaImage,
}

/// A box to draw.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelledBox {
    /// Box in pixels.
    pub bounds: PixelBox,
    /// Drawn at its top left corner; nothing when empty.
    pub label: String,
    /// sRGB.
    pub color: [u8; 3],
}

/// Whether a line returns to its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineEnds {
    /// From the first point to the last.
    Open,
    /// And back to the first.
    Closed,
}

/// Distinct colours for objects 0, 1, 2, ...: hues a golden angle apart, at three lightnesses.
pub fn palette(index: usize) -> [u8; 3] {
    let hue = (index % 4096) as f32 * 2.399_963;
    let lightness = [62.0, 45.0, 78.0][index % 3];
    rgb8_from_lab([lightness, 70.0 * hue.cos(), 70.0 * hue.sin()])
}

/// A size of text that suits a picture.
fn text_scale(width: u32, height: u32) -> u32 {
    (width.max(height) / 640).clamp(1, 6)
}

/// A grid of labelled, numbered pictures (`1`, `2`, ... in reading order, then the label). Each cell is `cell_px` wide
/// and high plus the line of text; pictures keep their shape and are not enlarged more than fourfold.
pub fn contact_sheet(cells: &[Cell<'_>], columns: u32, cell_px: u32) -> RgbImage {
    const GAP: u32 = 4;
    let cell = cell_px.clamp(16, 2048);
    let columns = columns.clamp(1, 64).min(cells.len().max(1) as u32);
    let rows = (cells.len().min(4096) as u32).div_ceil(columns).max(1);
    let scale = (cell / 160).clamp(1, 3);
    let text_height = GLYPH_PX * scale + 6;
    let (step_x, step_y) = (cell + GAP, cell + text_height + GAP);
    let mut sheet = RgbImage::from_pixel(columns * step_x + GAP, rows * step_y + GAP, Rgb([255, 255, 255]));
    for (i, entry) in cells.iter().take(4096).enumerate() {
        let (column, row) = (i as u32 % columns, i as u32 / columns);
        let (x, y) = (GAP + column * step_x, GAP + row * step_y);
        let number = (i + 1).to_string();
        draw_tag(&mut sheet, &number, (i64::from(x), i64::from(y)), scale, [0, 0, 0]);
        let after = text_width(&number, scale) + 4 * scale + 4;
        let label = fitted(&entry.label, scale, cell.saturating_sub(after));
        draw_text(&mut sheet, &label, (i64::from(x + after), i64::from(y + scale)), scale, [0, 0, 0]);
        place(&mut sheet, entry.image, (x, y + text_height), cell);
    }
    sheet
}

/// Draws a picture into a square, on a checkerboard where it is transparent.
fn place(sheet: &mut RgbImage, picture: &RgbaImage, (x, y): (u32, u32), side: u32) {
    let (w, h) = picture.dimensions();
    if w == 0 || h == 0 {
        return;
    }
    let k = (f64::from(side) / f64::from(w.max(h))).min(4.0);
    let to = ImageSize::new(
        ((f64::from(w) * k).round() as u32).clamp(1, side),
        ((f64::from(h) * k).round() as u32).clamp(1, side),
    );
    let small = resize_rgba(picture, to);
    let (left, top) = (x + (side - to.width) / 2, y + (side - to.height) / 2);
    for (px, py, Rgba([r, g, b, a])) in small.enumerate_pixels() {
        let ground = if (px / 8 + py / 8) % 2 == 0 { 236.0 } else { 214.0 };
        let alpha = f32::from(*a) / 255.0;
        let mixed = [*r, *g, *b].map(|c| (f32::from(c) * alpha + ground * (1.0 - alpha)).round() as u8);
        sheet.put_pixel(left + px, top + py, Rgb(mixed));
    }
}

/// The photo with boxes and their labels drawn in.
pub fn draw_boxes(photo: &RgbImage, boxes: &[LabelledBox]) -> RgbImage {
    let mut picture = photo.clone();
    let scale = text_scale(photo.width(), photo.height());
    let width = f64::from(scale) * 2.0;
    for b in boxes {
        let [x0, y0, x1, y1] = [b.bounds.x0, b.bounds.y0, b.bounds.x1, b.bounds.y1];
        line(&mut picture, &[[x0, y0], [x1, y0], [x1, y1], [x0, y1]], LineEnds::Closed, b.color, width);
    }
    // All tags after all lines, so that no line crosses a tag.
    draw_tags(&mut picture, boxes);
    picture
}

/// Draws the labels of boxes beside them: where they hide least of their own boxes, of small other ones and of each other.
pub fn draw_tags(picture: &mut RgbImage, boxes: &[LabelledBox]) {
    let scale = text_scale(picture.width(), picture.height());
    let whole = [0, 0, i64::from(picture.width()), i64::from(picture.height())];
    let corners = |b: &PixelBox| [b.x0, b.y0, b.x1, b.y1].map(|v| v.clamp(-1e6, 1e6) as i64);
    let all: Vec<[i64; 4]> = boxes.iter().map(|b| corners(&b.bounds)).collect();
    let mut tags: Vec<[i64; 4]> = Vec::new();
    // Small things first: they have the least room beside them.
    let mut order: Vec<usize> = (0..boxes.len()).filter(|i| !boxes[*i].label.is_empty()).collect();
    order.sort_by_key(|i| area(all[*i]));
    for i in order {
        let label = fitted(&boxes[i].label, scale, picture.width());
        let (w, h) = font::tag_size(&label, scale);
        let [x0, y0, x1, y1] = all[i];
        let places = [
            (x0, y0 - h),
            (x1 - w, y0 - h),
            (x0, y1),
            (x1 - w, y1),
            (x1, y0),
            (x0 - w, y0),
            (x1, y1 - h),
            (x0 - w, y1 - h),
            (x0, y0),
        ];
        let hidden = |tag: [i64; 4]| {
            let others = all.iter().enumerate().filter(|(j, b)| *j != i && area(**b) < SMALL_BOX * area(tag));
            let of_others: i64 = others.map(|(_, b)| common(tag, *b)).sum();
            let of_tags: i64 = tags.iter().map(|t| common(tag, *t)).sum();
            10 * of_tags + 2 * common(tag, all[i]) + of_others
        };
        let inside = |(x, y): (i64, i64)| (x.min(whole[2] - w).max(0), y.min(whole[3] - h).max(0));
        let tag = |(x, y): (i64, i64)| [x, y, x + w, y + h];
        let Some(best) = places.into_iter().map(inside).min_by_key(|at| hidden(tag(*at))) else { continue };
        draw_tag(picture, &label, best, scale, boxes[i].color);
        tags.push(tag(best));
    }
}

/// Boxes of fewer times a tag's area are not to be hidden by it.
const SMALL_BOX: i64 = 30;

fn area([x0, y0, x1, y1]: [i64; 4]) -> i64 {
    (x1 - x0).max(0) * (y1 - y0).max(0)
}

/// Area that two boxes have in common.
fn common(a: [i64; 4], b: [i64; 4]) -> i64 {
    area([a[0].max(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].min(b[3])])
}

/// The photo with a line through the points (pixels), `width` pixels thick.
pub fn draw_polyline(photo: &RgbImage, points: &[[f64; 2]], ends: LineEnds, color: [u8; 3], width: f64) -> RgbImage {
    let mut picture = photo.clone();
    line(&mut picture, points, ends, color, width);
    picture
}

/// Draws the pixels whose centre is within half the width of a segment.
fn line(picture: &mut RgbImage, points: &[[f64; 2]], ends: LineEnds, color: [u8; 3], width: f64) {
    let (w, h) = (f64::from(picture.width()), f64::from(picture.height()));
    let half = if width.is_finite() { (width / 2.0).clamp(0.5, 100.0) } else { 0.5 };
    let segments = match ends {
        LineEnds::Closed if points.len() > 2 => points.len(),
        _ => points.len().saturating_sub(1),
    };
    for i in 0..segments {
        let (a, b) = (points[i], points[(i + 1) % points.len()]);
        if ![a[0], a[1], b[0], b[1]].iter().all(|v| v.is_finite()) {
            continue;
        }
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let length2 = (dx * dx + dy * dy).max(1e-12);
        let rows = ((a[1].min(b[1]) - half).clamp(0.0, h) as u32, (a[1].max(b[1]) + half).ceil().clamp(0.0, h) as u32);
        for y in rows.0..rows.1 {
            let yc = f64::from(y) + 0.5;
            // The columns in reach of this row's part of the segment.
            let along = |v: f64| if dy.abs() < 1e-9 { v } else { v.clamp(0.0, 1.0) };
            let (t0, t1) = if dy.abs() < 1e-9 {
                (0.0, 1.0)
            } else {
                let (p, q) = ((yc - half - 1.0 - a[1]) / dy, (yc + half + 1.0 - a[1]) / dy);
                (along(p.min(q)), along(p.max(q)))
            };
            let (xa, xb) = (a[0] + t0 * dx, a[0] + t1 * dx);
            let columns =
                ((xa.min(xb) - half - 1.0).clamp(0.0, w) as u32, (xa.max(xb) + half + 1.0).ceil().clamp(0.0, w) as u32);
            for x in columns.0..columns.1 {
                let xc = f64::from(x) + 0.5;
                let t = (((xc - a[0]) * dx + (yc - a[1]) * dy) / length2).clamp(0.0, 1.0);
                if (a[0] + t * dx - xc).hypot(a[1] + t * dy - yc) <= half {
                    picture.put_pixel(x, y, Rgb(color));
                }
            }
        }
    }
}

/// The photo with light grid lines every `step` thousandths of its width and height, and their coordinates (0 to 1000)
/// along a border around the photo. The border adds to the size: `border` pixels on each side, see the return value.
pub fn grid_overlay(photo: &RgbImage, step: u32) -> GridOverlay {
    let (w, h) = photo.dimensions();
    let scale = text_scale(w, h);
    let border = text_width("1000", scale) + 4 * scale;
    let mut picture = RgbImage::from_pixel(w + 2 * border, h + 2 * border, Rgb([255, 255, 255]));
    imageops::replace(&mut picture, photo, i64::from(border), i64::from(border));
    let step = step.clamp(10, 1000);
    let half_glyph = i64::from(GLYPH_PX * scale / 2);
    for value in (0..=1000).step_by(step as usize) {
        let text = value.to_string();
        let x = i64::from(border) + (f64::from(w) * f64::from(value) / 1000.0).round() as i64;
        let y = i64::from(border) + (f64::from(h) * f64::from(value) / 1000.0).round() as i64;
        for py in i64::from(border)..i64::from(border + h) {
            lighten(&mut picture, x, py);
        }
        for px in i64::from(border)..i64::from(border + w) {
            lighten(&mut picture, px, y);
        }
        let text_px = i64::from(text_width(&text, scale));
        for top in [i64::from(2 * scale), i64::from(border + h + 4 * scale)] {
            draw_text(&mut picture, &text, (x - text_px / 2, top + i64::from(2 * scale)), scale, [0, 0, 0]);
        }
        for left in [i64::from(border) - text_px - i64::from(2 * scale), i64::from(border + w + 2 * scale)] {
            draw_text(&mut picture, &text, (left, y - half_glyph), scale, [0, 0, 0]);
        }
        for t in 0..i64::from(3 * scale) {
            put(&mut picture, x, i64::from(border) - 1 - t, [0, 0, 0]);
            put(&mut picture, x, i64::from(border + h) + t, [0, 0, 0]);
            put(&mut picture, i64::from(border) - 1 - t, y, [0, 0, 0]);
            put(&mut picture, i64::from(border + w) + t, y, [0, 0, 0]);
        }
    }
    GridOverlay { picture, border_px: border }
}

/// A photo with a coordinate grid and a border around it.
#[derive(Debug, Clone)]
pub struct GridOverlay {
    /// The picture, larger than the photo by the border on each side.
    pub picture: RgbImage,
    /// Width of the border, pixels.
    pub border_px: u32,
}

/// Blends a pixel with white, or with black where it is bright.
fn lighten(picture: &mut RgbImage, x: i64, y: i64) {
    if x < 0 || y < 0 || x >= i64::from(picture.width()) || y >= i64::from(picture.height()) {
        return;
    }
    let pixel = picture.get_pixel_mut(x as u32, y as u32);
    let bright = pixel.0.iter().map(|c| u32::from(*c)).sum::<u32>() > 3 * 140;
    let target = if bright { 0.0 } else { 255.0 };
    for c in &mut pixel.0 {
        *c = (f32::from(*c) * 0.6 + target * 0.4) as u8;
    }
}

/// The masked object on transparent ground, cut to its box grown by `pad` of its longer side (within the photo), and
/// the box that was cut out.
///
/// `None` when the mask is empty.
pub fn crop_rgba(photo: &RgbImage, mask: &Mask, pad: f64) -> Option<(RgbaImage, PixelBox)> {
    let mask = crate::fitted(mask, photo);
    let b = mask.bounds()?;
    let pad = if pad.is_finite() { (b.width().max(b.height()) * pad.clamp(0.0, 10.0)).round() } else { 0.0 };
    let grown = PixelBox { x0: b.x0 - pad, y0: b.y0 - pad, x1: b.x1 + pad, y1: b.y1 + pad }.clamped(mask.size());
    let (x0, y0) = (grown.x0 as u32, grown.y0 as u32);
    let crop = RgbaImage::from_fn(grown.width() as u32, grown.height() as u32, |x, y| {
        let (px, py) = (x0 + x, y0 + y);
        let Rgb([r, g, b]) = *photo.get_pixel(px, py);
        Rgba([r, g, b, if mask.get(i64::from(px), i64::from(py)) { 255 } else { 0 }])
    });
    Some((crop, grown))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_the_palette_differ() {
        for i in 0..12 {
            for j in 0..i {
                assert!(crate::color::lab_distance(palette(i), palette(j)) > 18.0, "{i} {j}");
            }
        }
    }

    #[test]
    fn a_sheet_shows_every_cell_in_its_place() {
        let red = RgbaImage::from_pixel(30, 60, Rgba([255, 0, 0, 255]));
        let clear = RgbaImage::new(10, 10);
        let cells = [
            Cell { label: "a long label that does not fit".into(), image: &red },
            Cell { label: "clear".into(), image: &clear },
            Cell { label: String::new(), image: &red },
        ];
        let sheet = contact_sheet(&cells, 2, 100);
        let text = GLYPH_PX + 6;
        assert_eq!(sheet.dimensions(), (2 * 104 + 4, 2 * (100 + text + 4) + 4));
        assert_eq!(sheet.get_pixel(54, 4 + text + 50).0, [255, 0, 0]);
        let ground = sheet.get_pixel(158, 4 + text + 50).0;
        assert!(ground[0] >= 200 && ground[0] == ground[1], "checkerboard");
        assert!(contact_sheet(&[], 0, 0).width() > 0);
        assert!(contact_sheet(&[Cell { label: "x".into(), image: &RgbaImage::new(0, 0) }], 3, 50).width() > 0);
    }

    #[test]
    fn lines_and_boxes_are_where_they_were_asked_for() {
        let photo = RgbImage::new(100, 80);
        let drawn =
            draw_polyline(&photo, &[[10.0, 10.0], [90.0, 10.0], [50.0, 70.0]], LineEnds::Closed, [9, 9, 9], 3.0);
        for (x, y, on) in [(50, 10, true), (30, 40, true), (70, 40, true), (50, 40, false), (5, 5, false)] {
            assert_eq!(drawn.get_pixel(x, y).0 == [9, 9, 9], on, "{x} {y}");
        }
        let far = PixelBox { x0: -1e9, y0: f64::NAN, x1: 1e9, y1: 50.0 };
        let _ = draw_boxes(&photo, &[LabelledBox { bounds: far, label: "far".into(), color: [255, 0, 0] }]);
        let b = PixelBox { x0: 20.0, y0: 20.0, x1: 60.0, y1: 60.0 };
        let boxed = draw_boxes(&photo, &[LabelledBox { bounds: b, label: String::new(), color: [255, 0, 0] }]);
        assert_eq!(boxed.get_pixel(40, 59).0, [255, 0, 0]);
        assert_eq!(boxed.get_pixel(40, 40).0, [0, 0, 0]);
    }

    #[test]
    fn ids_stand_beside_their_boxes_and_not_on_one_another() {
        let mut picture = RgbImage::new(400, 300);
        let labelled = |x0: f64, y0: f64, side: f64, color: [u8; 3]| {
            let bounds = PixelBox { x0, y0, x1: x0 + side, y1: y0 + side };
            LabelledBox { bounds, label: "cup_01".into(), color }
        };
        // Two small things side by side, one in the corner of the picture, and one that is all of it.
        let boxes = [
            labelled(100.0, 100.0, 20.0, [255, 0, 0]),
            labelled(122.0, 100.0, 20.0, [0, 255, 0]),
            labelled(0.0, 0.0, 30.0, [0, 0, 255]),
            labelled(0.0, 0.0, 400.0, [255, 255, 0]),
        ];
        draw_tags(&mut picture, &boxes);
        let (w, h) = font::tag_size("cup_01", text_scale(400, 300));
        for b in &boxes {
            let of_it = picture.enumerate_pixels().filter(|(_, _, p)| p.0 == b.color);
            let ground: Vec<(u32, u32)> = of_it.map(|(x, y, _)| (x, y)).collect();
            assert!(ground.len() as i64 > w * h / 2, "its whole tag is to be seen: {b:?}");
        }
        let on = |b: &LabelledBox| {
            let c = &b.bounds;
            (c.y0 as u32..c.y1 as u32)
                .any(|y| (c.x0 as u32..c.x1 as u32).any(|x| picture.get_pixel(x, y).0 != [0, 0, 0]))
        };
        assert!(!on(&boxes[0]) && !on(&boxes[1]) && !on(&boxes[2]));
    }

    #[test]
    fn the_grid_keeps_the_photo_inside_its_border() {
        let photo = RgbImage::from_pixel(200, 100, Rgb([10, 20, 30]));
        let grid = grid_overlay(&photo, 100);
        let b = grid.border_px;
        assert_eq!(grid.picture.dimensions(), (200 + 2 * b, 100 + 2 * b));
        assert_eq!(grid.picture.get_pixel(b + 30, b + 35).0, [10, 20, 30]);
        assert_ne!(grid.picture.get_pixel(b + 40, b + 35).0, [10, 20, 30], "line at 200 of 1000");
    }

    #[test]
    fn a_crop_is_transparent_outside_the_mask() {
        let photo = RgbImage::from_fn(50, 40, |x, y| Rgb([x as u8, y as u8, 0]));
        let mask = Mask::from_fn(ImageSize::new(50, 40), |x, y| (10..20).contains(&x) && (30..40).contains(&y));
        let (crop, b) = crop_rgba(&photo, &mask, 0.2).unwrap();
        assert_eq!(b, PixelBox { x0: 8.0, y0: 28.0, x1: 22.0, y1: 40.0 });
        assert_eq!(crop.get_pixel(0, 0).0[3], 0);
        assert_eq!(crop.get_pixel(2, 2).0, [10, 30, 0, 255]);
        assert!(crop_rgba(&photo, &Mask::empty(ImageSize::new(50, 40)), 0.1).is_none());
    }
}
