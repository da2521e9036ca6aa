//! The crop around a prompt, at working size, and what the prompt says about its pixels.

use harmony_scene::{ImageSize, Mask, PixelBox};
use image::RgbImage;

use super::cut::{Known, Problem};
use super::{SegmentPrompt, SegmentSettings};
use crate::color::{distance_squared, lab_from_rgb8};
use crate::distance::{half_thickness, signed_distance};
use crate::polygon::rasterize;
use crate::resample::{Window, resize_window};

/// Log odds at one error's distance inside an outline.
const OUTLINE_ODDS: f32 = 2.2;
/// Error of an outline along a thin part, relative to half the part's thickness.
const THIN_ERROR: f32 = 0.6;
/// The middle of a thin part begins at this share of half its thickness.
const MIDDLE: f32 = 0.7;
/// Log odds of an unprompted box: at its centre, and how much less in its corners.
const BOX_ODDS: (f32, f32) = (1.6, 3.2);
/// Log odds added in a box that is edged on all its sides.
const FILLED_ODDS: f32 = 1.5;
/// Colour step that is an edge, Lab units.
const EDGE_STEP: f32 = 9.0;
/// Share of a side that is an edge: from here it may be the object's, from here it surely is.
const EDGED_SHARE: (f32, f32) = (0.55, 0.85);
/// Log odds against the object inside another object's outline, and inside another, smaller box.
const EXCLUDED_ODDS: (f32, f32) = (4.0, 0.8);

/// A crop of the photo and its working size.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub window: Window,
    pub work: ImageSize,
}

impl Frame {
    /// Working pixels per photo pixel (along x; the shape is kept but for rounding).
    pub(super) fn scale(&self) -> f64 {
        f64::from(self.work.width) / f64::from(self.window.width)
    }

    /// The same crop at another working size.
    pub(super) fn at_most(&self, longest: u32) -> Self {
        let work = ImageSize::new(self.window.width, self.window.height).fit_within(longest.max(1));
        Self { work, ..*self }
    }

    /// Photo pixels to working pixels.
    pub(super) fn to_work(self, p: [f64; 2]) -> [f64; 2] {
        [
            (p[0] - f64::from(self.window.x)) * f64::from(self.work.width) / f64::from(self.window.width),
            (p[1] - f64::from(self.window.y)) * f64::from(self.work.height) / f64::from(self.window.height),
        ]
    }

    fn box_to_work(self, b: &PixelBox) -> PixelBox {
        let ([x0, y0], [x1, y1]) = (self.to_work([b.x0, b.y0]), self.to_work([b.x1, b.y1]));
        PixelBox { x0, y0, x1, y1 }
    }

    /// The colours at working size.
    pub(super) fn lab(&self, photo: &RgbImage) -> Vec<[f32; 3]> {
        resize_window(photo, self.window, self.work).pixels().map(|p| lab_from_rgb8(p.0)).collect()
    }

    /// A working-size division as soft values, interpolated at a position in working pixels.
    pub(super) fn sample(&self, values: &[f32], x: f64, y: f64) -> f32 {
        let (w, h) = (self.work.width as usize, self.work.height as usize);
        let clamp = |v: f64, n: usize| (v - 0.5).clamp(0.0, (n - 1) as f64);
        let (x, y) = (clamp(x, w), clamp(y, h));
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
        let (tx, ty) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
        let top = values[y0 * w + x0] * (1.0 - tx) + values[y0 * w + x1] * tx;
        let bottom = values[y1 * w + x0] * (1.0 - tx) + values[y1 * w + x1] * tx;
        top * (1.0 - ty) + bottom * ty
    }

    /// A division at working size as a full-frame mask, its edge interpolated.
    pub(super) fn to_mask(self, object: &[bool], photo: ImageSize) -> Mask {
        let mut mask = Mask::empty(photo);
        let values: Vec<f32> = object.iter().map(|b| f32::from(u8::from(*b))).collect();
        let (kx, ky) = (
            f64::from(self.work.width) / f64::from(self.window.width),
            f64::from(self.work.height) / f64::from(self.window.height),
        );
        for y in 0..self.window.height {
            for x in 0..self.window.width {
                let on = self.sample(&values, (f64::from(x) + 0.5) * kx, (f64::from(y) + 0.5) * ky) >= 0.5;
                if on {
                    mask.set(self.window.x + x, self.window.y + y, true);
                }
            }
        }
        mask
    }
}

/// The prompt's box or the outline's box, cut to the photo; `None` when nothing of it is in the photo.
pub(super) fn prompt_box(prompt: &SegmentPrompt, photo: ImageSize) -> Option<PixelBox> {
    let outline = usable_outline(prompt);
    let b = outline.map_or(prompt.bounds, |o| SegmentPrompt::from_outline(o.to_vec()).bounds);
    let finite = [b.x0, b.y0, b.x1, b.y1].iter().all(|v| v.is_finite());
    let b = b.clamped(photo);
    (finite && b.width() >= 0.5 && b.height() >= 0.5).then_some(b)
}

/// The outline, when it has an inside.
pub(super) fn usable_outline(prompt: &SegmentPrompt) -> Option<&[[f64; 2]]> {
    let outline = prompt.outline.as_deref()?;
    let area: f64 =
        outline.iter().zip(outline.iter().cycle().skip(1)).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>().abs()
            / 2.0;
    (outline.len() >= 3 && outline.iter().flatten().all(|v| v.is_finite()) && area >= 1.0).then_some(outline)
}

/// Expected error of the outline, photo pixels.
pub(super) fn outline_error_px(outline: &[[f64; 2]], photo: ImageSize, settings: &SegmentSettings) -> f64 {
    let longest = f64::from(photo.width.max(photo.height));
    let doubled: f64 = outline.iter().zip(outline.iter().cycle().skip(1)).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum();
    let relative = settings.outline_error_of_object * (doubled.abs() / 2.0).sqrt();
    (settings.outline_error * longest).min(relative).max(1.0)
}

/// The crop for a prompt: its box with surroundings to learn the background from.
pub(super) fn frame(bounds: &PixelBox, margin_px: f64, photo: ImageSize, settings: &SegmentSettings) -> Frame {
    let pad = |side: f64| (side * 0.15).max(8.0) + margin_px;
    let x0 = (bounds.x0 - pad(bounds.width())).floor().max(0.0) as u32;
    let y0 = (bounds.y0 - pad(bounds.height())).floor().max(0.0) as u32;
    let x1 = ((bounds.x1 + pad(bounds.width())).ceil() as u32).min(photo.width);
    let y1 = ((bounds.y1 + pad(bounds.height())).ceil() as u32).min(photo.height);
    let window = Window { x: x0, y: y0, width: x1.saturating_sub(x0).max(1), height: y1.saturating_sub(y0).max(1) };
    Frame { window, work: ImageSize::new(window.width, window.height) }.at_most(settings.working_px.clamp(16, 4096))
}

/// The problem at the frame's working size.
pub(super) fn problem(
    photo: &RgbImage,
    prompt: &SegmentPrompt,
    bounds: &PixelBox,
    frame: &Frame,
    settings: &SegmentSettings,
) -> Problem {
    let (width, height) = (frame.work.width as usize, frame.work.height as usize);
    let size = crate::size_of(photo);
    let lab = frame.lab(photo);
    let (mut known, mut prior) = match usable_outline(prompt) {
        Some(outline) => {
            let error = outline_error_px(outline, size, settings) * frame.scale();
            from_outline(outline, error as f32, frame)
        }
        None => from_box(bounds, frame, size, &lab, settings),
    };
    exclude(prompt, bounds, frame, &mut known, &mut prior);
    let color_weight = if usable_outline(prompt).is_some() { 0.6 } else { 1.0 } * settings.color_weight as f32;
    Problem { width, height, lab: frame.lab(photo), known, prior, color_weight, smoothness: settings.smoothness as f32 }
}

/// Certain deep inside and far outside, a ramp between.
///
/// Who draws a thin part (a leg, a cord) errs by less than its width: there the ramp is steeper, and the middle of the
/// part is certain. A cut would shorten it away otherwise.
fn from_outline(outline: &[[f64; 2]], error: f32, frame: &Frame) -> (Vec<Known>, Vec<f32>) {
    let (w, h) = (frame.work.width as usize, frame.work.height as usize);
    let points: Vec<[f64; 2]> = outline.iter().map(|p| frame.to_work(*p)).collect();
    let depth = signed_distance(&rasterize(&points, w, h), w, h);
    let error = error.max(0.75);
    let thickness = half_thickness(&depth, w, h, 2.0 * error);
    let (mut known, mut prior) = (Vec::with_capacity(depth.len()), Vec::with_capacity(depth.len()));
    for (d, t) in depth.iter().zip(&thickness) {
        let error = if *d > 0.0 { (THIN_ERROR * t).clamp(0.75, error) } else { error };
        known.push(if *d > 2.0 * error || is_middle(*d, *t, 2.0 * error) {
            Known::Object
        } else if *d < -2.0 * error {
            Known::Background
        } else {
            Known::Free
        });
        prior.push((d / error).clamp(-2.0, 2.0) * OUTLINE_ODDS);
    }
    (known, prior)
}

/// Whether a pixel at depth `d` is the middle of a part that is thinner than `thick` (half thickness `t`).
pub(super) fn is_middle(d: f32, t: f32, thick: f32) -> bool {
    t >= 0.5 && t < thick && d >= MIDDLE * t
}

/// Adds the middles of an outline's thin parts to a mask, at the photo's resolution: at working size a wire or a thin
/// leg is no pixel wide. What other outlines claim is left to them.
pub(super) fn add_thin_parts(mask: &mut Mask, outline: &[[f64; 2]], prompt: &SegmentPrompt, error: f64, frame: &Frame) {
    let window = frame.window;
    let (w, h) = (window.width as usize, window.height as usize);
    let local = |outline: &[[f64; 2]]| -> Vec<[f64; 2]> {
        outline.iter().map(|p| [p[0] - f64::from(window.x), p[1] - f64::from(window.y)]).collect()
    };
    let depth = signed_distance(&rasterize(&local(outline), w, h), w, h);
    let thick = 2.0 * error as f32;
    let thickness = half_thickness(&depth, w, h, thick);
    let mut middles: Vec<bool> = depth.iter().zip(&thickness).map(|(d, t)| is_middle(*d, *t, thick)).collect();
    for other in prompt.not.iter().filter_map(|n| n.outline.as_deref()) {
        for (middle, claimed) in middles.iter_mut().zip(rasterize(&local(other), w, h)) {
            *middle &= !claimed;
        }
    }
    for (i, _) in middles.iter().enumerate().filter(|(_, middle)| **middle) {
        mask.set(window.x + (i % w) as u32, window.y + (i / w) as u32, true);
    }
}

/// Background outside the box; inside, the centre more likely than the corners.
fn from_box(
    bounds: &PixelBox,
    frame: &Frame,
    photo: ImageSize,
    lab: &[[f32; 3]],
    settings: &SegmentSettings,
) -> (Vec<Known>, Vec<f32>) {
    let b = frame.box_to_work(bounds);
    let slack = (b.width() * settings.box_error, b.height() * settings.box_error);
    // An object cut by the photo's border goes on behind it: no falling off towards that side.
    let reach = |low: f64, high: f64, at_low: bool, at_high: bool, v: f64| {
        let (centre, half) = (f64::midpoint(low, high), ((high - low) / 2.0).max(0.5));
        let r = (v - centre) / half;
        if (r < 0.0 && at_low) || (r > 0.0 && at_high) { 0.0 } else { r.abs() }
    };
    let cut = [
        bounds.x0 <= 1.0,
        bounds.x1 >= f64::from(photo.width) - 1.0,
        bounds.y0 <= 1.0,
        bounds.y1 >= f64::from(photo.height) - 1.0,
    ];
    // What is edged all along its box fills it: its corners are as likely as its centre.
    let fills = box_support(&b, cut, slack, lab, frame.work);
    let (middle, fall) = (BOX_ODDS.0 + FILLED_ODDS * fills, BOX_ODDS.1 * (1.0 - fills));
    let mut known = Vec::with_capacity(frame.work.pixels());
    let mut prior = Vec::with_capacity(frame.work.pixels());
    for y in 0..frame.work.height {
        for x in 0..frame.work.width {
            let (x, y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
            let outside = (b.x0 - x).max(x - b.x1).max(b.y0 - y).max(y - b.y1);
            if x < b.x0 - slack.0 || x > b.x1 + slack.0 || y < b.y0 - slack.1 || y > b.y1 + slack.1 {
                known.push(Known::Background);
                prior.push(-BOX_ODDS.1);
            } else {
                known.push(Known::Free);
                let (u, v) = (reach(b.x0, b.x1, cut[0], cut[1], x), reach(b.y0, b.y1, cut[2], cut[3], y));
                let r = (u.powi(4) + v.powi(4)).sqrt() as f32;
                let beyond = if outside > 0.0 { 2.0 } else { 0.0 };
                prior.push(middle - fall * r.min(1.4) - beyond);
            }
        }
    }
    (known, prior)
}

/// How surely all sides of a box (but those cut by the photo's border: left, right, top, bottom) are straight edges of
/// one thing, 0 to 1: the share of the weakest side's length with a colour step across one line near that side.
fn box_support(b: &PixelBox, cut: [bool; 4], slack: (f64, f64), lab: &[[f32; 3]], work: ImageSize) -> f32 {
    let (w, h) = (i64::from(work.width), i64::from(work.height));
    let color = |x: i64, y: i64| (x >= 0 && y >= 0 && x < w && y < h).then(|| lab[(y * w + x) as usize]);
    if b.width() < 12.0 || b.height() < 12.0 || cut.iter().all(|c| *c) {
        return 0.0;
    }
    let mut weakest = 1.0_f32;
    for (side, _) in cut.iter().enumerate().filter(|(_, is_cut)| !**is_cut) {
        let (at, from, to, reach) = match side {
            0 => (b.x0, b.y0, b.y1, slack.0),
            1 => (b.x1, b.y0, b.y1, slack.0),
            2 => (b.y0, b.x0, b.x1, slack.1),
            _ => (b.y1, b.x0, b.x1, slack.1),
        };
        let inset = (to - from) * 0.06;
        let (from, to) = ((from + inset) as i64, (to - inset) as i64);
        let reach = reach.ceil() as i64 + 1;
        let mut best = 0.0_f32;
        for line in at.round() as i64 - reach..=at.round() as i64 + reach {
            let edged = (from..to)
                .filter(|along| {
                    let pair = if side < 2 {
                        (color(line - 2, *along), color(line + 1, *along))
                    } else {
                        (color(*along, line - 2), color(*along, line + 1))
                    };
                    matches!(pair, (Some(a), Some(b)) if distance_squared(a, b) > EDGE_STEP * EDGE_STEP)
                })
                .count();
            best = best.max(edged as f32 / (to - from).max(1) as f32);
        }
        weakest = weakest.min(best);
    }
    ((weakest - EDGED_SHARE.0) / (EDGED_SHARE.1 - EDGED_SHARE.0)).clamp(0.0, 1.0)
}

/// Lowers the odds where other objects are known to be.
fn exclude(prompt: &SegmentPrompt, bounds: &PixelBox, frame: &Frame, known: &mut [Known], prior: &mut [f32]) {
    let (w, h) = (frame.work.width as usize, frame.work.height as usize);
    for other in &prompt.not {
        match &other.outline {
            Some(outline) => {
                let points: Vec<[f64; 2]> = outline.iter().map(|p| frame.to_work(*p)).collect();
                let inside = rasterize(&points, w, h);
                // What lies all around this object is what it stands before, not what hides it.
                let mine = known.iter().zip(prior.iter()).map(|(k, p)| *k != Known::Background && *p > 0.0);
                let (mut own, mut both) = (0_usize, 0_usize);
                for (m, o) in mine.zip(&inside) {
                    own += usize::from(m);
                    both += usize::from(m && *o);
                }
                if both * 10 > own * 6 {
                    continue;
                }
                for ((p, k), o) in prior.iter_mut().zip(known.iter_mut()).zip(&inside) {
                    if *o {
                        *p -= EXCLUDED_ODDS.0;
                        if *k == Known::Object {
                            *k = Known::Free;
                        }
                    }
                }
            }
            None if other.bounds.area() < 0.8 * bounds.area() => {
                let b = frame.box_to_work(&other.bounds);
                for (i, p) in prior.iter_mut().enumerate() {
                    let (x, y) = ((i % w) as f64 + 0.5, (i / w) as f64 + 0.5);
                    if x > b.x0 && x < b.x1 && y > b.y0 && y < b.y1 {
                        *p -= EXCLUDED_ODDS.1;
                    }
                }
            }
            None => {}
        }
    }
}
