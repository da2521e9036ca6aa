//! Cuts objects out of a photo: graph cut over colour models, from a box and perhaps a rough outline.

mod cut;
mod frame;
mod joint;
mod mixture;

use harmony_scene::{ImageSize, Mask, PixelBox};
use image::RgbImage;
use rayon::prelude::*;

use cut::{Known, Models, Problem};
use frame::Frame;

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
    /// And at most this fraction of the square root of the outline's area: small things are drawn finer.
    pub outline_error_of_object: f64,
    /// Expected error of a box edge, as a fraction of the box's size.
    pub box_error: f64,
    /// Colour model updates.
    pub iterations: u32,
    /// Weight of the contrast-sensitive edges; 1 counts a free edge as 14 natural log units of a pixel's evidence.
    pub smoothness: f64,
    /// Weight of the colours against the prompt, 1 = usual.
    pub color_weight: f64,
}

impl Default for SegmentSettings {
    fn default() -> Self {
        Self {
            working_px: 400,
            outline_error: 0.015,
            outline_error_of_object: 0.15,
            box_error: 0.02,
            iterations: 4,
            smoothness: 0.7,
            color_weight: 1.0,
        }
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

/// Change of the odds under which a stable mask should not change much, natural log units.
const STABILITY_BIAS: f32 = 1.0;
/// Longest side of a crop whose edge is refined pixel by pixel; larger ones are refined at this size.
const REFINE_PX: u32 = 1400;

/// Cuts one object out.
pub fn segment_box(photo: &RgbImage, prompt: &SegmentPrompt, settings: &SegmentSettings) -> Segmented {
    match cut_out(photo, prompt, settings) {
        Some(cut) => Segmented { mask: cut.mask, score: cut.score },
        None => Segmented { mask: Mask::empty(crate::size_of(photo)), score: 0.0 },
    }
}

/// Cuts all objects of a photo out; each pixel goes to at most one. One answer a prompt, in order.
///
/// Prompts know of each other: every prompt is an [`Exclusion`] for the others.
pub fn segment_all(photo: &RgbImage, prompts: &[SegmentPrompt], settings: &SegmentSettings) -> Vec<Segmented> {
    let informed: Vec<SegmentPrompt> = prompts.iter().enumerate().map(|(i, _)| joint::informed(prompts, i)).collect();
    let cuts: Vec<Option<CutOut>> = informed.par_iter().map(|prompt| cut_out(photo, prompt, settings)).collect();
    joint::share_out(crate::size_of(photo), prompts, cuts)
}

/// A cut with what is needed to weigh it against others.
struct CutOut {
    mask: Mask,
    score: f64,
    frame: Frame,
    /// Log odds of the working pixels.
    odds: Vec<f32>,
}

/// `None` when the prompt has nothing in the photo.
fn cut_out(photo: &RgbImage, prompt: &SegmentPrompt, settings: &SegmentSettings) -> Option<CutOut> {
    let size = crate::size_of(photo);
    let bounds = frame::prompt_box(prompt, size)?;
    let outline = frame::usable_outline(prompt);
    let error = outline.map_or(0.0, |o| frame::outline_error_px(o, size, settings));
    let frame = frame::frame(&bounds, 2.0 * error, size, settings);
    let problem = frame::problem(photo, prompt, &bounds, &frame, settings);
    let first = first_division(&problem);
    let (mut object, odds, models) = problem.solve(first.clone(), settings.iterations);
    let expected = first.iter().filter(|b| **b).count();
    if object.iter().filter(|b| **b).count() * 12 < expected {
        object = first; // the colours say nothing: keep the prompt's shape
    }
    let score = stability(&problem, &odds);
    // With an outline the parts of an object may lie apart; without one only what is large belongs to it.
    let share = if outline.is_some() { 60 } else { 8 };
    let count = object.iter().filter(|b| **b).count();
    crate::components::clean(&mut object, problem.width, problem.height, count / share, count / 100 + 4);
    let mut mask = refine(photo, &frame, &object, models.as_ref(), settings);
    if let Some(outline) = outline {
        frame::add_thin_parts(&mut mask, outline, prompt, error, &frame);
    }
    Some(CutOut { mask, score, frame, odds })
}

/// What the prompt alone says.
fn first_division(problem: &Problem) -> Vec<bool> {
    let mut first: Vec<bool> = problem
        .known
        .iter()
        .zip(&problem.prior)
        .map(|(k, p)| *k == Known::Object || (*k == Known::Free && *p > 0.0))
        .collect();
    if !first.contains(&true) {
        for (f, k) in first.iter_mut().zip(&problem.known) {
            *f = *k == Known::Free;
        }
    }
    first
}

/// Overlap of the cuts at a little more and a little less likely.
fn stability(problem: &Problem, odds: &[f32]) -> f64 {
    let more = problem.cut(odds, STABILITY_BIAS);
    let less = problem.cut(odds, -STABILITY_BIAS);
    let both = more.iter().zip(&less).filter(|(a, b)| **a && **b).count();
    let either = more.iter().zip(&less).filter(|(a, b)| **a || **b).count();
    if either == 0 { 0.0 } else { both as f64 / either as f64 }
}

/// The division at the photo's resolution: a second cut in a band around the enlarged edge.
fn refine(
    photo: &RgbImage,
    frame: &Frame,
    object: &[bool],
    models: Option<&Models>,
    settings: &SegmentSettings,
) -> Mask {
    let size: ImageSize = crate::size_of(photo);
    let fine = frame.at_most(REFINE_PX);
    let enlargement = f64::from(fine.work.width) / f64::from(frame.work.width);
    let Some(models) = models.filter(|_| enlargement > 1.1) else {
        return frame.to_mask(object, size);
    };
    let (w, h) = (fine.work.width as usize, fine.work.height as usize);
    let soft: Vec<f32> = object.iter().map(|b| f32::from(u8::from(*b))).collect();
    let (kx, ky) = (1.0 / enlargement, f64::from(frame.work.height) / f64::from(fine.work.height));
    let enlarged: Vec<bool> = (0..w * h)
        .map(|i| frame.sample(&soft, ((i % w) as f64 + 0.5) * kx, ((i / w) as f64 + 0.5) * ky) >= 0.5)
        .collect();
    let band = (1.5 * enlargement) as f32;
    let depth = crate::distance::signed_distance(&enlarged, w, h);
    let thickness = crate::distance::half_thickness(&depth, w, h, 2.0 * band);
    let known = depth
        .iter()
        .zip(&thickness)
        .map(|(d, t)| match d {
            d if *d > band || frame::is_middle(*d, *t, 2.0 * band) => Known::Object,
            d if *d < -band => Known::Background,
            _ => Known::Free,
        })
        .collect();
    let prior = depth.iter().map(|d| (d / band).clamp(-1.0, 1.0)).collect();
    let problem = Problem {
        width: w,
        height: h,
        lab: fine.lab(photo),
        known,
        prior,
        color_weight: 0.6 * settings.color_weight as f32,
        smoothness: settings.smoothness as f32,
    };
    let refined = problem.cut(&problem.odds(Some(models)), 0.0);
    fine.to_mask(&refined, size)
}

#[cfg(test)]
mod tests;
