//! Brightness and tone of a render against the photo, measured.
//!
//! The paper leaves both to the model's eye. Measured, they let the program refine light without a model, and refuse
//! a model's change that makes the match clearly worse.

use harmony_scene::{ImageSize, Lighting, Mask};
use image::RgbImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::delta::bounds;
use crate::linear::luminance;
use crate::{AmbientDelta, DirectionalDelta, GreyResponse, LightingDelta, LightingVerdict};
use crate::{LinearImage, PointLightDelta, WindowDelta};

/// Brightness difference that counts as none, stops.
pub const BRIGHTNESS_TOLERANCE_STOPS: f64 = 0.25;
/// Tone difference that counts as none, log2 of red to blue.
pub const TONE_TOLERANCE: f64 = 0.2;
/// Growth of the error, relative and absolute, up to which a change is kept.
pub const WORSE_SLACK: [f64; 2] = [1.10, 0.05];

/// Columns of the comparison grid; rows follow the photo's shape.
const GRID_COLUMNS: u32 = 16;
/// Linear value below which a cell is too dark to speak about colour.
const DARK: f64 = 0.004;
/// Largest difference of a cell that counts, stops.
const MAX_STOPS: f64 = 4.0;

/// A preview's brightness against the photo.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the paper's words")]
pub enum Brightness {
    TooBright,
    #[default]
    Matches,
    TooDim,
}

/// A preview's tone against the photo.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the paper's words")]
pub enum Tone {
    TooWarm,
    #[default]
    Matches,
    TooCool,
}

/// What the comparison found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Assessment {
    /// Verdict on brightness.
    pub brightness: Brightness,
    /// Verdict on tone.
    pub tone: Tone,
    /// Render over photo in stops (log2 of display-linear luminance), mean of the middle half of the cells.
    pub stops: f64,
    /// Warmth of the render over the photo: log2 of red to blue, mean of the middle half of the cells.
    pub warmth: f64,
    /// Ratio of the mean luminances, render over photo.
    pub luminance_ratio: f64,
    /// Stops by ninths of the image, row-major from the top left.
    pub regions: [f64; 9],
    /// Root mean square of the cells' stops, together with the warmth: the number that refinement lowers.
    pub error: f64,
}

impl Assessment {
    /// Whether nothing needs to change.
    pub fn matches(&self) -> bool {
        self.brightness == Brightness::Matches && self.tone == Tone::Matches
    }
}

/// Whether a change of light is kept.
#[derive(Debug, Clone, PartialEq)]
pub enum Judgement {
    /// It did not make things clearly worse.
    Keep,
    /// It did.
    Refuse {
        /// In words, with the numbers.
        reason: String,
    },
}

/// Compares a render with the photo; they may differ in size but should show the same view.
///
/// Both are averaged, display-linear, in cells of a 16-column grid, so that small misplacements of objects don't
/// count; the summary values are means over the middle half of the cells, so that a window or a lamp in the image
/// doesn't decide. `ignore` marks pixels of the photo that don't count at all.
pub fn assess(photo: &RgbImage, render: &RgbImage, ignore: Option<&Mask>) -> Assessment {
    let columns = GRID_COLUMNS.min(photo.width().max(1));
    let rows = (f64::from(columns) * f64::from(photo.height()) / f64::from(photo.width().max(1))).round() as u32;
    let grid = ImageSize::new(columns, rows.clamp(1, 64));
    let srgb = GreyResponse::srgb();
    let (photo, render) = (srgb.to_linear(photo).shrunk(grid), srgb.to_linear(render).shrunk(grid));
    let counted: Vec<bool> = ignore.map_or_else(|| vec![true; grid.pixels()], |mask| mostly_clear(mask, grid));

    let mut stops = Vec::new();
    let mut warmth = Vec::new();
    let mut by_region: [Vec<f64>; 9] = Default::default();
    let (mut sum_photo, mut sum_render) = (0.0, 0.0);
    for (i, ((p, r), counts)) in photo.rgb.iter().zip(&render.rgb).zip(&counted).enumerate() {
        if !counts {
            continue;
        }
        let (lp, lr) = (f64::from(luminance(*p)), f64::from(luminance(*r)));
        sum_photo += lp;
        sum_render += lr;
        let d = ((lr + DARK) / (lp + DARK)).log2().clamp(-MAX_STOPS, MAX_STOPS);
        stops.push(d);
        let (column, row) = (i as u32 % grid.width, i as u32 / grid.width);
        by_region[(row * 3 / grid.height * 3 + column * 3 / grid.width) as usize].push(d);
        if lp > DARK && lr > DARK {
            warmth.push(red_to_blue(*r) - red_to_blue(*p));
        }
    }
    let rms =
        if stops.is_empty() { 0.0 } else { (stops.iter().map(|d| d * d).sum::<f64>() / stops.len() as f64).sqrt() };
    let (stops, warmth) = (middle_mean(&mut stops), middle_mean(&mut warmth));
    Assessment {
        brightness: match stops {
            d if d > BRIGHTNESS_TOLERANCE_STOPS => Brightness::TooBright,
            d if d < -BRIGHTNESS_TOLERANCE_STOPS => Brightness::TooDim,
            _ => Brightness::Matches,
        },
        tone: match warmth {
            d if d > TONE_TOLERANCE => Tone::TooWarm,
            d if d < -TONE_TOLERANCE => Tone::TooCool,
            _ => Tone::Matches,
        },
        stops,
        warmth,
        luminance_ratio: if sum_photo > 0.0 { sum_render / sum_photo } else { 1.0 },
        regions: by_region.map(|mut cells| middle_mean(&mut cells)),
        error: rms.hypot(warmth),
    }
}

/// Whether a changed lighting is kept: not when its error is clearly above the one before.
pub fn judge(before: &Assessment, after: &Assessment) -> Judgement {
    let limit = before.error * WORSE_SLACK[0] + WORSE_SLACK[1];
    if after.error <= limit {
        Judgement::Keep
    } else {
        Judgement::Refuse {
            reason: format!(
                "the change raises the measured error from {:.2} to {:.2} stops (brightness {:+.2} to {:+.2}, \
                 warmth {:+.2} to {:+.2})",
                before.error, after.error, before.stops, after.stops, before.warmth, after.warmth
            ),
        }
    }
}

/// The answer that the measurement alone would give, in the paper's form.
///
/// Brightness is met by the global multiplier, tone by turning every active colour half of the way.
pub fn propose(found: &Assessment, lighting: &Lighting) -> LightingDelta {
    if found.matches() {
        return LightingDelta { verdict: LightingVerdict::Converged, ..LightingDelta::default() };
    }
    let mut delta = LightingDelta {
        brightness_assessment: found.brightness,
        tone_assessment: found.tone,
        verdict: LightingVerdict::Adjust,
        ..LightingDelta::default()
    };
    if found.brightness != Brightness::Matches {
        let [low, high] = bounds::GLOBAL_MULT;
        delta.global_intensity_mult = Some((-found.stops).exp2().clamp(low, high));
    }
    if found.tone != Tone::Matches {
        let turn = |color: [f64; 3]| Some(color_step(color, found.warmth));
        delta.ambient_delta = Some(AmbientDelta { color_delta: turn(lighting.ambient_color), intensity_mult: None });
        let mut suns = 0;
        for light in &lighting.lights {
            let color_delta = light.on.then(|| turn(light.color)).flatten();
            match light.kind {
                harmony_scene::LightKind::Sun { .. } => {
                    if color_delta.is_some() {
                        let sun = DirectionalDelta { index: suns, color_delta, intensity_mult: None };
                        delta.directional_delta.push(sun);
                    }
                    suns += 1;
                }
                harmony_scene::LightKind::Point { .. } if color_delta.is_some() => {
                    delta.point_light_deltas.push(PointLightDelta {
                        id: light.id.clone(),
                        color_delta,
                        ..PointLightDelta::default()
                    });
                }
                harmony_scene::LightKind::Area { .. } if color_delta.is_some() => {
                    delta.window_deltas.push(WindowDelta {
                        id: light.id.clone(),
                        color_delta,
                        ..WindowDelta::default()
                    });
                }
                _ => {}
            }
        }
    }
    delta
}

/// Change of a colour that takes away half of `warmth` (log2 of red to blue).
fn color_step(color: [f64; 3], warmth: f64) -> [f64; 3] {
    let k = (warmth / 4.0).clamp(-0.5, 0.5);
    let turned = [color[0] * (-k).exp2(), color[1], color[2] * k.exp2()];
    let top = turned.iter().copied().fold(1e-9, f64::max);
    [0, 1, 2].map(|c| turned[c] / top - color[c])
}

fn red_to_blue(rgb: [f32; 3]) -> f64 {
    ((f64::from(rgb[0]) + DARK) / (f64::from(rgb[2]) + DARK)).log2().clamp(-MAX_STOPS, MAX_STOPS)
}

/// Mean of the middle half, 0 for nothing.
fn middle_mean(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    let middle = &values[n / 4..n - n / 4];
    if middle.is_empty() { 0.0 } else { middle.iter().sum::<f64>() / middle.len() as f64 }
}

/// Cells of which less than half is masked.
fn mostly_clear(mask: &Mask, grid: ImageSize) -> Vec<bool> {
    let rgb = mask.bits().iter().map(|b| [f32::from(u8::from(*b)); 3]).collect();
    LinearImage { size: mask.size(), rgb }.shrunk(grid).rgb.iter().map(|p| p[0] < 0.5).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delta::tests::{ROOM, evening};

    /// A room-like picture: gradient wall, dark floor, a bright window; `gain` on linear light by channel.
    fn picture(width: u32, gain: [f64; 3]) -> RgbImage {
        let height = width * 3 / 4;
        RgbImage::from_fn(width, height, |x, y| {
            let (u, v) = (f64::from(x) / f64::from(width), f64::from(y) / f64::from(height));
            let light = if v > 0.7 { 0.05 } else { 0.15 + 0.2 * u };
            let light = if u > 0.8 && v < 0.4 { 1.0 } else { light };
            image::Rgb(
                [0, 1, 2].map(|c| {
                    (crate::linear::linear_to_srgb(((light * gain[c]) as f32).min(1.0)) * 255.0).round() as u8
                }),
            )
        })
    }

    #[test]
    fn a_picture_matches_itself_at_any_size() {
        let found = assess(&picture(320, [1.0; 3]), &picture(96, [1.0; 3]), None);
        assert!(found.matches(), "{found:?}");
        assert!(found.error <= 0.1, "{found:?}");
    }

    #[test]
    fn one_stop_less_is_too_dim_by_one_stop() {
        let found = assess(&picture(320, [1.0; 3]), &picture(160, [0.5; 3]), None);
        assert_eq!(found.brightness, Brightness::TooDim);
        assert_eq!(found.tone, Tone::Matches);
        assert!((found.stops + 1.0).abs() <= 0.1, "{found:?}");
        assert!((found.luminance_ratio - 0.5).abs() <= 0.05);
    }

    #[test]
    fn orange_light_is_too_warm_whatever_the_window_does() {
        let found = assess(&picture(320, [1.0; 3]), &picture(160, [1.3, 1.0, 0.65]), None);
        assert_eq!(found.tone, Tone::TooWarm);
        assert!((found.warmth - 1.0).abs() <= 0.1, "{found:?}");
        assert_eq!(assess(&picture(320, [1.3, 1.0, 0.65]), &picture(160, [1.0; 3]), None).tone, Tone::TooCool);
    }

    #[test]
    fn what_is_ignored_does_not_count() {
        let photo = picture(320, [1.0; 3]);
        let mut render = photo.clone();
        for (x, _, p) in render.enumerate_pixels_mut() {
            if x < 220 {
                *p = image::Rgb([255; 3]);
            }
        }
        let mask = Mask::from_fn(ImageSize::new(320, 240), |x, _| x < 220);
        assert_eq!(assess(&photo, &render, None).brightness, Brightness::TooBright);
        assert!(assess(&photo, &render, Some(&mask)).matches());
    }

    #[test]
    fn the_measured_loop_goes_the_right_way_and_worse_is_refused() {
        let photo = picture(320, [1.0; 3]);
        let dim = assess(&photo, &picture(160, [0.5, 0.4, 0.25]), None);
        let delta = propose(&dim, &evening());
        assert_eq!(delta.global_intensity_mult, Some(1.3));
        let mut lighting = evening();
        assert!(delta.apply(&mut lighting, &ROOM).is_empty());
        assert!(lighting.ambient_color[2] > lighting.ambient_color[0], "cooler: {:?}", lighting.ambient_color);
        assert_eq!(lighting.lights[0].color, evening().lights[0].color, "a lamp that is off keeps its colour");
        let darker = assess(&photo, &picture(160, [0.2, 0.15, 0.05]), None);
        assert!(matches!(judge(&dim, &darker), Judgement::Refuse { .. }));
        assert_eq!(judge(&darker, &dim), Judgement::Keep);
        assert!(propose(&assess(&photo, &photo, None), &evening()).is_converged());
    }

    #[test]
    fn degenerate_pictures_do_not_panic() {
        let empty = RgbImage::new(0, 0);
        let dot = RgbImage::new(1, 1);
        for (a, b) in [(&empty, &dot), (&dot, &empty), (&empty, &empty), (&dot, &dot)] {
            assert!(assess(a, b, None).error.is_finite());
        }
    }
}
