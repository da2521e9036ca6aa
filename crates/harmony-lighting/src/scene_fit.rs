//! The light of a photo from one measurement: intensities, colours, exposure and view transform together.
//!
//! Textures hold the photo's light already, so that fitting lights to them would find flat light: the texture explains
//! the shading. Here each node keeps only its texture's detail and has one unknown reflectance. Alternately the
//! lights are fitted with the reflectances given ([`crate::fit_lights`]), and each node's reflectance follows its median
//! residual, pulled towards what its texture says. What shades *within* a surface then has to be light.
//!
//! The photo's light depends on the view transform that the photo is read through. Every candidate gets its own fit, and
//! the one whose picture is nearest to the photo wins; plain sRGB wins ties, for it keeps blacks and colours.

use std::collections::BTreeMap;

use harmony_scene::{Lighting, ViewTransform};
use image::RgbImage;
use serde::Serialize;

use crate::delta::bounds;
use crate::linear::luminance;
use crate::smooth::{interior, smoothed};
use crate::view::{PictureError, display_linear, median, picture_error};
use crate::{FitOptions, LightFit, LightPass, LinearImage, ViewTable, fit_lights, relight};

/// Alternations of lights and reflectances.
const ROUNDS: usize = 14;
/// Share of a node's residual that its reflectance takes up; the rest is the pull of its texture.
const TRUST: f32 = 0.95;
/// Width over which a texture's slow variation is light, share of the image width.
const SLOW: f64 = 0.04;
/// Reflectance below which nothing diffuse is left to compare (metal, glass).
const MIN_ALBEDO: f32 = 0.02;
/// Pixels that a node needs to take part.
const MIN_PIXELS: usize = 24;
/// Luminance that the bright end (90th percentile) of the reflectances gets.
const BRIGHT: f64 = 0.55;
/// By how much another view must be nearer than plain sRGB, as a ratio of errors.
const VIEW_GAIN: f64 = 0.8;
/// A light that was said to be on keeps at least this share of the common gain.
const MIN_SHARE: f64 = 0.1;
/// Exposures that are given, stops.
const EXPOSURE: [f64; 2] = [-6.0, 6.0];

/// What one render with light groups says about a scene.
#[derive(Debug, Clone)]
pub struct Measured {
    /// Light of each source at the job's intensities, then the ambient light.
    pub lights: Vec<LightPass>,
    /// Base colour as rendered.
    pub albedo: LinearImage,
    /// Node seen, 1 for the first, 0 for none.
    pub ids: Vec<u32>,
    /// View transforms to choose from.
    pub views: Vec<ViewTable>,
}

impl Measured {
    /// The same as if some lights were not there.
    #[must_use]
    pub fn without(&self, left_out: impl Fn(&str) -> bool) -> Self {
        let stays = |pass: &&LightPass| !pass.light.as_deref().is_some_and(&left_out);
        Self { lights: self.lights.iter().filter(stays).cloned().collect(), ..self.clone() }
    }

    /// The same with one light for each group of equal ones (`group` names it), whose gains are then theirs: of two lamps
    /// of one kind the nearer to a window came out blue.
    #[must_use]
    pub fn grouped(&self, group: impl Fn(&str) -> Option<String>) -> Self {
        let mut first: BTreeMap<String, usize> = BTreeMap::new();
        let mut lights: Vec<LightPass> = Vec::new();
        for pass in &self.lights {
            let Some(name) = pass.light.as_deref().and_then(&group) else {
                lights.push(pass.clone());
                continue;
            };
            if let Some(at) = first.get(&name) {
                let sum = &mut lights[*at].image.rgb;
                sum.iter_mut().zip(&pass.image.rgb).for_each(|(s, p)| (0..3).for_each(|c| s[c] += p[c]));
            } else {
                first.insert(name, lights.len());
                lights.push(pass.clone());
            }
        }
        Self { lights, ..self.clone() }
    }
}

/// The fitted light.
#[derive(Debug, Clone)]
pub struct SceneFit {
    /// The view that the photo was read through.
    pub view: ViewTable,
    /// Gains of the lights; their common gain becomes exposure.
    pub fit: LightFit,
    /// The photo's light under that view, at exposure 0.
    pub photo: LinearImage,
    /// Picture of the fit against the photo.
    pub error: PictureError,
    /// The same for every candidate, in order.
    pub candidates: Vec<ViewError>,
}

/// How near one view comes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ViewError {
    /// The view.
    pub view: ViewTransform,
    /// Its picture's error.
    #[serde(flatten)]
    pub error: PictureError,
}

/// Fits lights, exposure and view to the photo; `photo` has the measurement's size, `weights` says what counts.
///
/// # Errors
/// [`crate::fit::FitError`] when sizes differ or no light has an effect.
pub fn fit_scene(
    measured: &Measured,
    photo: &RgbImage,
    weights: &[f32],
    options: &FitOptions,
) -> Result<SceneFit, crate::fit::FitError> {
    let weights = usable(measured, photo, weights);
    let start = Reflectances::new(measured, &weights);
    let mut best: Option<SceneFit> = None;
    let mut candidates = Vec::new();
    let mut failed = crate::fit::FitError::NoLight { lights: measured.lights.len(), pixels: 0 };
    for view in &measured.views {
        let found = match fit_under(measured, start.clone(), view, photo, &weights, options) {
            Ok(found) => found,
            Err(error) => {
                failed = error;
                continue;
            }
        };
        candidates.push(ViewError { view: view.view, error: found.error });
        let better = best.as_ref().is_none_or(|b| {
            let slack = if b.view.view == ViewTransform::Standard { VIEW_GAIN } else { 1.0 };
            found.error.total() < slack * b.error.total()
        });
        if better {
            best = Some(found);
        }
    }
    let mut best = best.ok_or(failed)?;
    best.candidates = candidates;
    Ok(best)
}

/// Weights without what cannot be compared: borders, small nodes, metal and glass, blown and black pixels.
fn usable(measured: &Measured, photo: &RgbImage, weights: &[f32]) -> Vec<f32> {
    let inside = interior(&measured.ids, measured.albedo.size);
    let nodes = measured.ids.iter().copied().max().unwrap_or(0) as usize + 1;
    let mut counts = vec![0usize; nodes];
    let mut out: Vec<f32> = photo
        .pixels()
        .enumerate()
        .map(|(i, p)| {
            let id = measured.ids.get(i).copied().unwrap_or(0);
            let albedo = measured.albedo.rgb.get(i).copied().unwrap_or_default();
            let weight = weights.get(i).copied().unwrap_or(1.0);
            let clear = p.0.iter().all(|v| *v < 250) && p.0.iter().any(|v| *v > 4);
            let counts_here = id > 0 && inside[i] && clear && luminance(albedo) > MIN_ALBEDO && weight > 0.0;
            if counts_here {
                counts[id as usize] += 1;
                weight
            } else {
                0.0
            }
        })
        .collect();
    for (w, id) in out.iter_mut().zip(&measured.ids) {
        if counts[*id as usize] < MIN_PIXELS {
            *w = 0.0;
        }
    }
    out
}

fn fit_under(
    measured: &Measured,
    mut nodes: Reflectances,
    view: &ViewTable,
    photo: &RgbImage,
    weights: &[f32],
    options: &FitOptions,
) -> Result<SceneFit, crate::fit::FitError> {
    let light = view.to_linear(photo);
    let mut fit = fit_lights(&nodes.lit(measured), &light, weights, options)?;
    for _ in 0..ROUNDS {
        nodes.follow(&relight(&nodes.lit(measured), &fit.gains), &light, weights);
        fit = fit_lights(&nodes.lit(measured), &light, weights, options)?;
    }
    let shown = display_linear(&view.to_picture(&relight(&nodes.lit(measured), &fit.gains)));
    let error = picture_error(&display_linear(photo), &shown, weights);
    let k = nodes.brightness(weights);
    for gain in &mut fit.gains {
        *gain = gain.map(|g| g * k);
    }
    fit.common_gain *= k;
    Ok(SceneFit { view: view.clone(), fit, photo: light, error, candidates: Vec::new() })
}

/// One reflectance a node, with its texture's detail.
#[derive(Clone)]
struct Reflectances {
    /// Factor by pixel that takes the rendered base colour to its detail around 1 (base colour cancels).
    detail: Vec<[f32; 3]>,
    /// Reflectance by node as its texture says.
    said: Vec<[f32; 3]>,
    /// What the fit adds, log2.
    offset: Vec<[f32; 3]>,
    ids: Vec<u32>,
}

impl Reflectances {
    fn new(measured: &Measured, weights: &[f32]) -> Self {
        let size = measured.albedo.size;
        let nodes = measured.ids.iter().copied().max().unwrap_or(0) as usize + 1;
        let log: Vec<[f32; 3]> = measured.albedo.rgb.iter().map(|a| a.map(|v| v.max(1e-3).log2())).collect();
        let mut said = vec![[0.0f32; 3]; nodes];
        let mut detail = vec![[1.0f32; 3]; log.len()];
        for (id, said) in said.iter_mut().enumerate() {
            let own: Vec<f32> =
                measured.ids.iter().zip(weights).map(|(i, w)| if *i as usize == id { *w } else { 0.0 }).collect();
            if own.iter().all(|w| *w <= 0.0) {
                continue;
            }
            *said = middle(&log, &own);
            let rest: Vec<[f32; 3]> = log.iter().map(|l| [0, 1, 2].map(|c| l[c] - said[c])).collect();
            let slow = smoothed(&rest, &own, size, SLOW * f64::from(size.width));
            for (i, w) in own.iter().enumerate() {
                if *w > 0.0 {
                    detail[i] = [0, 1, 2].map(|c| (rest[i][c] - slow[i][c]).exp2());
                }
            }
        }
        Self { detail, said, offset: vec![[0.0; 3]; nodes], ids: measured.ids.clone() }
    }

    /// The passes as they would be with these reflectances.
    fn lit(&self, measured: &Measured) -> Vec<LightPass> {
        let factor: Vec<[f32; 3]> = (0..self.detail.len())
            .map(|i| {
                let (albedo, node) = (measured.albedo.rgb[i], self.ids[i] as usize);
                [0, 1, 2].map(|c| {
                    let wanted = (self.said[node][c] + self.offset[node][c]).exp2() * self.detail[i][c];
                    wanted / albedo[c].max(1e-3)
                })
            })
            .collect();
        let scaled = |pass: &LightPass| {
            let rgb = pass.image.rgb.iter().zip(&factor).map(|(p, f)| [0, 1, 2].map(|c| p[c] * f[c])).collect();
            LightPass { image: LinearImage { size: pass.image.size, rgb }, ..pass.clone() }
        };
        measured.lights.iter().map(scaled).collect()
    }

    /// Takes up each node's median residual.
    fn follow(&mut self, sum: &LinearImage, photo: &LinearImage, weights: &[f32]) {
        let floor = 1e-3;
        let log: Vec<[f32; 3]> = sum
            .rgb
            .iter()
            .zip(&photo.rgb)
            .map(|(s, p)| [0, 1, 2].map(|c| ((p[c] + floor) / (s[c] + floor)).log2()))
            .collect();
        for (id, offset) in self.offset.iter_mut().enumerate() {
            let own: Vec<f32> =
                self.ids.iter().zip(weights).map(|(i, w)| if *i as usize == id { *w } else { 0.0 }).collect();
            if own.iter().any(|w| *w > 0.0) {
                let rest = middle(&log, &own);
                *offset = [0, 1, 2].map(|c| (TRUST * (offset[c] + rest[c])).clamp(-2.0, 2.0));
            }
        }
    }

    /// Factor on the light that brings the bright end of the reflectances to [`BRIGHT`].
    fn brightness(&self, weights: &[f32]) -> f64 {
        let mut all: Vec<f64> = (self.ids.iter().zip(weights).filter(|(_, w)| **w > 0.0))
            .map(|(id, _)| {
                let node = *id as usize;
                f64::from(luminance([0, 1, 2].map(|c| (self.said[node][c] + self.offset[node][c]).exp2())))
            })
            .collect();
        all.sort_by(f64::total_cmp);
        let bright = all.get(all.len() * 9 / 10).copied().unwrap_or(BRIGHT);
        (bright / BRIGHT).clamp(0.25, 4.0)
    }
}

/// Median by channel where the weight is positive.
fn middle(values: &[[f32; 3]], weights: &[f32]) -> [f32; 3] {
    [0, 1, 2].map(|c| {
        let mut all: Vec<f64> =
            values.iter().zip(weights).filter(|(_, w)| **w > 0.0).map(|(v, _)| f64::from(v[c])).collect();
        median(&mut all) as f32
    })
}

impl SceneFit {
    /// Gives every light of a group (see [`Measured::grouped`]) the gains of the one that was fitted.
    pub fn ungroup(&mut self, all: &[String], group: impl Fn(&str) -> Option<String>) {
        for light in all {
            if self.fit.lights.iter().any(|id| id.as_ref() == Some(light)) {
                continue;
            }
            let name = group(light);
            let twin = self.fit.lights.iter().position(|id| name.is_some() && id.as_deref().and_then(&group) == name);
            if let Some(twin) = twin {
                self.fit.lights.push(Some(light.clone()));
                self.fit.gains.push(self.fit.gains[twin]);
            }
        }
    }

    /// Writes light, exposure and view into the lighting that was measured.
    ///
    /// The common gain becomes exposure, so that the powers stay those of real lamps; a light that shines by the model's
    /// word stays on, however little of it the photo shows: at a share of its `typical` power, so that a scene which is lit again
    /// does not dim it once more. Returns what had to be changed.
    pub fn apply(&self, lighting: &mut Lighting, typical: &Lighting) -> Vec<String> {
        let mut notes = Vec::new();
        let common = self.fit.common_gain.max(1e-9);
        // Lights were measured before exposure: the one that the lighting had says nothing.
        let exposure = common.log2().clamp(EXPOSURE[0], EXPOSURE[1]);
        let common = exposure.exp2();
        lighting.exposure = (exposure * 100.0).round() / 100.0;
        lighting.view = self.view.view;
        for (id, gain) in self.fit.lights.iter().zip(&self.fit.gains) {
            let gain = gain.map(|g| g / common);
            let name = id.as_deref().unwrap_or("ambient");
            let colored = |color: [f64; 3]| [0, 1, 2].map(|c| color[c] * gain[c].max(1e-3));
            let level = 0.2126 * gain[0] + 0.7152 * gain[1] + 0.0722 * gain[2];
            match id {
                None => {
                    let target = colored(lighting.ambient_color);
                    let top = target.iter().copied().fold(0.0, f64::max);
                    lighting.ambient_color = bounds::color(target, lighting.ambient_color, name, &mut notes);
                    lighting.ambient_intensity = bounds::ambient(lighting.ambient_intensity * top);
                }
                Some(id) => {
                    let Some(light) = lighting.lights.iter_mut().find(|l| l.id == *id) else { continue };
                    if level < MIN_SHARE {
                        notes.push(format!("{name}: the photo shows little light of it"));
                        let usual = typical.lights.iter().find(|l| l.id == *id).map_or(0.0, |l| l.intensity);
                        let least = MIN_SHARE * light.intensity.max(usual);
                        light.intensity = bounds::intensity(&light.kind, light.intensity.min(least));
                        continue;
                    }
                    let target = colored(light.color);
                    let top = target.iter().copied().fold(0.0, f64::max);
                    light.intensity = bounds::intensity(&light.kind, light.intensity * top);
                    light.color = bounds::color(target, light.color, name, &mut notes);
                }
            }
        }
        notes
    }

    /// How bright a light is, as a multiple of what was measured after the common gain; 0 for one that is not there.
    pub fn level(&self, light: &str) -> f64 {
        let at = self.fit.lights.iter().position(|id| id.as_deref() == Some(light));
        let gain = at.map_or([0.0; 3], |at| self.fit.gains[at]);
        (0.2126 * gain[0] + 0.7152 * gain[1] + 0.0722 * gain[2]) / self.fit.common_gain.max(1e-9)
    }

    /// The measured scene's light under the fit, before exposure: what a render with the applied lighting shows.
    pub fn predicted(&self, measured: &Measured) -> LinearImage {
        relight(&measured.lights, &self.fit.gains)
    }
}

#[cfg(test)]
mod tests {
    use harmony_scene::ImageSize;

    use super::*;
    use crate::delta::tests::evening;
    use crate::view::tests::soft;

    const SIZE: ImageSize = ImageSize { width: 120, height: 90 };

    /// Two walls and a floor of one paint each; base colours are the photo's pixels (light baked in), as in a real run.
    fn measured(truth: &[[f64; 3]], view: &ViewTable) -> (Measured, RgbImage) {
        let paints = [[0.7f32, 0.68, 0.65], [0.3, 0.4, 0.6], [0.4, 0.3, 0.2]];
        let ids: Vec<u32> = (0..SIZE.pixels())
            .map(|i| {
                let (x, y) = (i % 120, i / 120);
                if y >= 60 { 3 } else { 1 + u32::from(x >= 70) }
            })
            .collect();
        let irradiance: Vec<[f32; 3]> = (0..SIZE.pixels())
            .map(|i| {
                let (x, y) = ((i % 120) as f32 / 120.0, (i / 120) as f32 / 90.0);
                let lamp = 0.06 / (0.06 + (x - 0.2).powi(2) + (y - 0.3).powi(2));
                [lamp, 0.1 + 0.6 * x * x, 0.2]
            })
            .collect();
        let with = |gains: &[[f64; 3]], albedo: &dyn Fn(usize) -> [f32; 3]| LinearImage {
            size: SIZE,
            rgb: (0..SIZE.pixels())
                .map(|i| {
                    let a = albedo(i);
                    [0, 1, 2].map(|c| a[c] * (0..3).map(|l| irradiance[i][l] * gains[l][c] as f32).sum::<f32>())
                })
                .collect(),
        };
        let photo = view.to_picture(&with(truth, &|i| paints[ids[i] as usize - 1]));
        let albedo = display_linear(&photo);
        let passes = [Some("lamp_01"), Some("window_01"), None];
        let lights = passes
            .iter()
            .enumerate()
            .map(|(l, id)| {
                let mut one = [[0.0; 3]; 3];
                one[l] = [1.0; 3];
                LightPass { light: id.map(str::to_owned), is_daylight: false, image: with(&one, &|i| albedo.rgb[i]) }
            })
            .collect();
        let views = vec![ViewTable::standard(), soft()];
        (Measured { lights, albedo, ids, views }, photo)
    }

    #[test]
    fn the_lamps_share_comes_out_although_the_textures_hold_its_pool_of_light() {
        let truth = [[0.8, 0.6, 0.4], [0.3, 0.3, 0.32], [0.1, 0.1, 0.1]];
        let (measured, photo) = measured(&truth, &ViewTable::standard());
        let found = fit_scene(&measured, &photo, &[], &FitOptions::default()).unwrap();
        assert_eq!(found.view.view, ViewTransform::Standard);
        assert!(found.error.stops <= 0.1, "{:?}", found.error);
        let level = |l: usize| found.fit.gains[l][1];
        let (got, want) = (level(0) / level(1), 0.6 / 0.3);
        assert!(
            (got / want).log2().abs() <= 0.7,
            "lamp over window {got:.2}, {want:.2} in truth: {:?}",
            found.fit.gains
        );
        // With the light in the textures taken for reflectance the ambient light would do it all.
        let (lamp, ambient) = (0.3 * level(0), 0.2 * level(2));
        assert!(ambient < lamp, "means of what they give: {ambient} and {lamp}, 0.02 and 0.18 in truth");
    }

    #[test]
    fn lamps_of_one_group_have_one_gain_and_give_their_light_together() {
        let (mut measured, photo) = measured(&[[0.8, 0.6, 0.4], [0.3; 3], [0.1; 3]], &ViewTable::standard());
        // The lamp once more, as two that give half each.
        let half = measured.lights[0].image.rgb.iter().map(|p| p.map(|v| v / 2.0)).collect();
        let one = LightPass { image: LinearImage { size: SIZE, rgb: half }, ..measured.lights[0].clone() };
        measured.lights.splice(0..1, [one.clone(), LightPass { light: Some("lamp_02".to_owned()), ..one }]);
        let group = |id: &str| id.starts_with("lamp").then(|| "lamp".to_owned());
        let together = measured.grouped(group);
        let ids: Vec<Option<&str>> = together.lights.iter().map(|pass| pass.light.as_deref()).collect();
        assert_eq!(ids, [Some("lamp_01"), Some("window_01"), None]);
        let mut found = fit_scene(&together, &photo, &[], &FitOptions::default()).unwrap();
        let all: Vec<String> = measured.lights.iter().filter_map(|pass| pass.light.clone()).collect();
        found.ungroup(&all, group);
        assert_eq!(found.fit.lights.last().unwrap().as_deref(), Some("lamp_02"));
        assert_eq!(found.fit.gains.last(), found.fit.gains.first());
        assert!((found.level("lamp_01") - found.level("lamp_02")).abs() < 1e-12 && found.level("lamp_01") > 0.1);
    }

    #[test]
    fn the_view_that_made_the_photo_is_chosen() {
        let truth = [[2.5, 2.0, 1.4], [2.0, 2.0, 2.1], [0.4, 0.4, 0.4]];
        for (made, want) in [(ViewTable::standard(), ViewTransform::Standard), (soft(), ViewTransform::Agx)] {
            let gains = if want == ViewTransform::Standard { truth.map(|g| g.map(|v| v * 0.3)) } else { truth };
            let (measured, photo) = measured(&gains, &made);
            let found = fit_scene(&measured, &photo, &[], &FitOptions::default()).unwrap();
            assert_eq!(found.candidates.len(), 2);
            assert_eq!(found.view.view, want, "{:?}", found.candidates);
        }
    }

    #[test]
    fn a_shining_lamp_stays_on_and_the_common_gain_is_exposure() {
        let (measured, photo) = measured(&[[0.0; 3], [0.9; 3], [0.4; 3]], &ViewTable::standard());
        let found = fit_scene(&measured, &photo, &[], &FitOptions::default()).unwrap();
        let mut lighting = evening();
        lighting.lights[0].on = true;
        let before = lighting.clone();
        found.apply(&mut lighting, &before);
        assert!(lighting.lights[0].on);
        assert!(lighting.lights[0].intensity < 0.3 * before.lights[0].intensity, "{lighting:?}");
        let rendered = |l: &Lighting, i: usize| l.lights[i].intensity * l.exposure.exp2();
        let window = rendered(&lighting, 1) / rendered(&before, 1);
        let wanted = found.fit.gains[1].iter().copied().fold(0.0, f64::max);
        assert!((window / wanted).log2().abs() <= 0.1, "{window} for {wanted}");
    }

    #[test]
    fn a_scene_that_is_lit_again_has_the_exposure_of_the_photo_and_not_twice_its_own() {
        let (measured, photo) = measured(&[[0.0; 3], [0.9; 3], [0.4; 3]], &ViewTable::standard());
        let found = fit_scene(&measured, &photo, &[], &FitOptions::default()).unwrap();
        let mut first = evening();
        found.apply(&mut first, &evening());
        let mut again = Lighting { exposure: 3.0, ..evening() };
        found.apply(&mut again, &evening());
        assert_eq!(again, first);
        // What was dimmed for want of light is not dimmed again.
        let mut third = first.clone();
        found.apply(&mut third, &evening());
        assert_eq!(third.lights[0].intensity, first.lights[0].intensity);
    }
}
