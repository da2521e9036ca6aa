//! Intensities and colours of all lights at once, by non-negative least squares (beyond the paper; decision 0007;
//! key `light.fit`).
//!
//! Light adds up: with one linear image a light, the scene under any other intensities and colours is a weighted sum.
//! The weights that come nearest to the photo are the non-negative solution of a small linear system, one channel
//! at a time. The photo's light is read back through the renderer's own grey response, since a tone-mapped value is
//! not proportional to light.
//!
//! Robustness: residuals are relative to the mean of photo and render (the eye sees ratios, and neither a black chair
//! nor a lamp in the image decides), re-weighted over some rounds (an object that is not in the scene must not bend the
//! light), and a weak pull towards one common gain decides what the photo leaves open
//! (two lamps that light the same wall). A light's colour changes as its temperature does: red against blue, and hardly
//! towards green or purple, which is what a room of one colour would make of what it does not show. Known weak regime: where textures hold the photo's own light, the fit prefers
//! flat light, because the texture explains the shading already; see [`crate::Delight`].

use harmony_scene::{ImageSize, Lighting};
use serde::Serialize;

use crate::delta::bounds;
use crate::linear::luminance;
use crate::sources::is_unseen_id;
use crate::{LightPass, LinearImage};

/// Settings of the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitOptions {
    /// Longer side at which images are compared, pixels: misplacements of a few per cent are averaged away.
    pub longest_side: u32,
    /// Pull of each light's gain towards the common gain, as a share of its own evidence.
    pub intensity_ridge: f64,
    /// Pull of each light's colour towards the one it had, likewise.
    pub color_ridge: f64,
    /// Relative residual at which a pixel counts a quarter (Geman-McClure weights).
    pub outlier: f64,
    /// Most that a light's colour gets warmer or colder than it was said to be, log2 of half the ratio of the gains of red
    /// and blue.
    pub warmer: f64,
    /// The same of daylight through a window: the colour of a wall beside it is sooner paint than light.
    pub warmer_daylight: f64,
    /// Most that it gets greener or more purple, log2 of green over the mean of red and blue.
    pub greener: f64,
    /// Most that the sky of a window that the photo does not show is brighter than that of those that it shows.
    pub unseen_sky: f64,
    /// Rounds of re-weighting.
    pub rounds: usize,
    /// Exposure of the render in stops: the photo's light is compared before it.
    pub exposure: f64,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            longest_side: 80,
            intensity_ridge: 0.01,
            color_ridge: 0.2,
            outlier: 0.5,
            warmer: 0.6,
            warmer_daylight: 0.2,
            greener: 0.3,
            unseen_sky: 1.5,
            rounds: 12,
            exposure: 0.0,
        }
    }
}

/// Gains that bring the render nearest to the photo, with the evidence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LightFit {
    /// Light ids as in the passes, `None` = ambient.
    pub lights: Vec<Option<String>>,
    /// Gain by linear RGB channel, one a light.
    pub gains: Vec<[f64; 3]>,
    /// The one gain that would do best for all lights together.
    pub common_gain: f64,
    /// Median relative residual at the common gain.
    pub residual_before: f64,
    /// Median relative residual of the fit.
    pub residual_after: f64,
    /// Share of the photo's pixels that took part.
    pub coverage: f64,
}

/// Why there is no fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// No light has any effect on the pixels that count.
    #[error("none of the {lights} lights reaches the {pixels} pixels that count")]
    NoLight {
        /// Number of passes.
        lights: usize,
        /// Number of usable pixels.
        pixels: usize,
    },
    /// An image does not have the passes' size.
    #[error("an image has {found} pixels, the first pass has {expected}")]
    Sizes {
        /// Pixels found.
        found: usize,
        /// Pixels of the first pass.
        expected: usize,
    },
}

/// The scene's light as a weighted sum of per-light images.
pub fn relight(passes: &[LightPass], gains: &[[f64; 3]]) -> LinearImage {
    let Some(first) = passes.first() else { return LinearImage::black(ImageSize::new(0, 0)) };
    let mut sum = LinearImage::black(first.image.size);
    for (pass, gain) in passes.iter().zip(gains) {
        for (s, p) in sum.rgb.iter_mut().zip(&pass.image.rgb) {
            for c in 0..3 {
                s[c] += p[c] * gain[c] as f32;
            }
        }
    }
    sum
}

/// Fits gains to the photo's light.
///
/// `photo` is light (see [`crate::GreyResponse::to_linear`]) of the same view and size as the passes. `weights` says how
/// much each pixel counts: 0 for panes, lamp shades and whatever is not in the scene; empty = all 1.
///
/// # Errors
/// [`FitError`] when sizes differ or no light has an effect.
pub fn fit_lights(
    passes: &[LightPass],
    photo: &LinearImage,
    weights: &[f32],
    options: &FitOptions,
) -> Result<LightFit, FitError> {
    let n = passes.len();
    let Some(first) = passes.first() else { return Err(FitError::NoLight { lights: 0, pixels: 0 }) };
    let expected = first.image.size.pixels();
    let lengths = passes.iter().map(|p| p.image.rgb.len()).chain([photo.rgb.len()]);
    for found in lengths.chain((!weights.is_empty()).then_some(weights.len())) {
        if found != expected {
            return Err(FitError::Sizes { found, expected });
        }
    }
    let problem = Problem::new(passes, photo, weights, options);
    let lum = Channel::new(&problem, |rgb| luminance(rgb).into());
    let (common_gain, usable) = lum.common_gain();
    if !(common_gain.is_finite() && common_gain > 0.0) {
        return Err(FitError::NoLight { lights: n, pixels: usable });
    }
    let flat = vec![common_gain; n];
    let residual_before = lum.median_residual(&flat);
    // A light with no evidence keeps the common gain through its prior; one that the photo denies has gone to 0.
    let (intensities, tied) = under_one_sky(passes, &lum, &flat, options);
    let daylight: Vec<bool> = passes.iter().map(|p| p.is_daylight).collect();
    let gains = colors(&problem, &intensities, &tied, &daylight, options);
    let mean: Vec<f64> = gains.iter().map(|g| 0.2126 * g[0] + 0.7152 * g[1] + 0.0722 * g[2]).collect();
    Ok(LightFit {
        lights: passes.iter().map(|p| p.light.clone()).collect(),
        gains,
        common_gain,
        residual_before,
        residual_after: lum.median_residual(&mean),
        coverage: problem.coverage,
    })
}

/// Intensities of all lights; windows that the photo does not show have no brighter sky than those that it shows.
///
/// Powers before the fit are by area, so that gains of daylight are radiances beside one another. An unseen window that would
/// be brighter than it may is fitted as one light with the brightest seen one. Which are tied so, that one among them, is told.
fn under_one_sky(passes: &[LightPass], lum: &Channel, flat: &[f64], options: &FitOptions) -> (Vec<f64>, Vec<usize>) {
    let n = passes.len();
    let mut gains = lum.solve(flat, &vec![options.intensity_ridge; n], options);
    let unseen: Vec<bool> = passes.iter().map(|p| p.light.as_deref().is_some_and(is_unseen_id)).collect();
    let seen = (0..n).filter(|i| passes[*i].is_daylight && !unseen[*i]).max_by(|a, b| gains[*a].total_cmp(&gains[*b]));
    let Some(seen) = seen.filter(|i| gains[*i] > LightFit::OFF_SHARE * flat[0]) else { return (gains, Vec::new()) };
    let mut tied: Vec<usize> = Vec::new();
    loop {
        let most = options.unseen_sky * gains[seen] * (1.0 + 1e-6);
        let brighter: Vec<usize> = (0..n).filter(|i| unseen[*i] && !tied.contains(i) && gains[*i] > most).collect();
        if brighter.is_empty() {
            if !tied.is_empty() {
                tied.push(seen);
            }
            return (gains, tied);
        }
        tied.extend(brighter);
        let one = lum.with_tied(seen, &tied, options.unseen_sky);
        // What is tied has no light of its own there.
        gains = one.solve(flat, &vec![options.intensity_ridge; n], options);
        for i in &tied {
            gains[*i] = options.unseen_sky * gains[seen];
        }
    }
}

/// Gains by channel around the intensities. A light whose colour is none that a light has gets the nearest that is, and
/// the others are fitted again beside it.
fn colors(
    problem: &Problem,
    intensities: &[f64],
    tied: &[usize],
    daylight: &[bool],
    options: &FitOptions,
) -> Vec<[f64; 3]> {
    let n = intensities.len();
    let channels = [0, 1, 2].map(|c| Channel::new(problem, |rgb| rgb[c].into()));
    let mut prior: Vec<[f64; 3]> = intensities.iter().map(|g| [*g; 3]).collect();
    let mut ridge: Vec<f64> = intensities.iter().map(|g| if *g > 0.0 { options.color_ridge } else { HELD }).collect();
    // What shines by one sky has its colour.
    for i in tied {
        ridge[*i] = HELD;
    }
    loop {
        let by_channel = [0, 1, 2].map(|c| {
            let prior: Vec<f64> = prior.iter().map(|g| g[c]).collect();
            channels[c].solve(&prior, &ridge, options)
        });
        let gains: Vec<[f64; 3]> = (0..n).map(|i| [0, 1, 2].map(|c| by_channel[c][i])).collect();
        let mut all_are_lights = true;
        for i in 0..n {
            if ridge[i] >= HELD {
                continue;
            }
            let warmer = if daylight[i] { options.warmer_daylight } else { options.warmer };
            if let Some(color) = nearest_light(gains[i], warmer, options.greener) {
                (prior[i], ridge[i]) = (color.map(|c| c * intensities[i]), HELD);
                all_are_lights = false;
            }
        }
        if all_are_lights {
            return gains;
        }
    }
}

/// Pull that holds a gain where it is.
const HELD: f64 = 1e6;

/// The colour (luminance 1) that these gains come nearest to within the limits; `None` when they are within.
fn nearest_light(gains: [f64; 3], warmer: f64, greener: f64) -> Option<[f64; 3]> {
    // A channel that is said to give no light at all is some 30 times darker than the brightest.
    let least = gains.iter().copied().fold(0.0, f64::max) / 32.0;
    let [r, g, b] = gains.map(|v| v.max(least).max(f64::MIN_POSITIVE).log2());
    let (warm, green) = ((r - b) / 2.0, g - f64::midpoint(r, b));
    let kept = (warm.clamp(-warmer, warmer), green.clamp(-greener, greener));
    let color = [kept.0, kept.1, -kept.0].map(f64::exp2);
    let luminance = 0.2126 * color[0] + 0.7152 * color[1] + 0.0722 * color[2];
    (kept != (warm, green)).then(|| color.map(|c| c / luminance))
}

impl LightFit {
    /// Gain below this share of the common gain means that a light is off: so little is within the fit's error.
    pub const OFF_SHARE: f64 = 0.08;

    /// Writes the gains into the lighting that the passes were made with; every value stays in
    /// [`crate::delta::bounds`]. Returns what had to be changed or switched off.
    pub fn apply(&self, lighting: &mut Lighting) -> Vec<String> {
        let mut notes = Vec::new();
        for (id, gain) in self.lights.iter().zip(&self.gains) {
            let name = id.as_deref().unwrap_or("ambient");
            let off = gain.iter().copied().fold(0.0, f64::max) <= self.common_gain * Self::OFF_SHARE;
            let colored = |color: [f64; 3]| [0, 1, 2].map(|c| color[c] * gain[c]);
            match id {
                None => {
                    let target = colored(lighting.ambient_color);
                    let top = target.iter().copied().fold(0.0, f64::max);
                    lighting.ambient_intensity = bounds::ambient(lighting.ambient_intensity * top);
                    if !off {
                        lighting.ambient_color = bounds::color(target, lighting.ambient_color, name, &mut notes);
                    }
                }
                Some(id) => {
                    let Some(light) = lighting.lights.iter_mut().find(|l| l.id == *id) else { continue };
                    if off {
                        light.on = false;
                        notes.push(format!("{name}: the photo shows no light of it, switched off"));
                        continue;
                    }
                    let target = colored(light.color);
                    let top = target.iter().copied().fold(0.0, f64::max);
                    let wanted = light.intensity * top;
                    light.intensity = bounds::intensity(&light.kind, wanted);
                    if light.intensity != wanted {
                        notes.push(format!("{name}: {wanted:.3} W brought to {:.3} W", light.intensity));
                    }
                    light.color = bounds::color(target, light.color, name, &mut notes);
                }
            }
        }
        notes
    }
}

/// Everything at the size of comparison.
struct Problem {
    lights: Vec<Vec<[f32; 3]>>,
    target: Vec<[f32; 3]>,
    weights: Vec<f64>,
    coverage: f64,
}

impl Problem {
    fn new(passes: &[LightPass], photo: &LinearImage, weights: &[f32], options: &FitOptions) -> Self {
        let size = passes[0].image.size;
        let to = size.fit_within(options.longest_side.max(1));
        let weight = |i: usize| weights.get(i).map_or(1.0, |w| if w.is_finite() { w.max(0.0) } else { 0.0 });
        let weighted = |image: &LinearImage| {
            let rgb =
                image.rgb.iter().enumerate().map(|(i, p)| p.map(|v| if v.is_finite() { v * weight(i) } else { 0.0 }));
            LinearImage { size, rgb: rgb.collect() }.shrunk(to).rgb
        };
        let mass = LinearImage { size, rgb: (0..size.pixels()).map(|i| [weight(i); 3]).collect() }.shrunk(to);
        let divide = |rgb: Vec<[f32; 3]>| -> Vec<[f32; 3]> {
            rgb.iter().zip(&mass.rgb).map(|(p, m)| p.map(|v| if m[0] > 1e-6 { v / m[0] } else { 0.0 })).collect()
        };
        let scale = (-options.exposure).exp2() as f32;
        let counted = (0..size.pixels()).filter(|i| weight(*i) > 0.0).count();
        Self {
            lights: passes.iter().map(|p| divide(weighted(&p.image))).collect(),
            target: divide(weighted(photo)).into_iter().map(|p| p.map(|v| v * scale)).collect(),
            weights: mass.rgb.iter().map(|m| f64::from(m[0])).collect(),
            coverage: counted as f64 / size.pixels().max(1) as f64,
        }
    }
}

/// One channel (or luminance) of the problem, in `f64`.
struct Channel {
    /// `lights[i][p]`.
    lights: Vec<Vec<f64>>,
    target: Vec<f64>,
    weights: Vec<f64>,
    /// Added to the target where residuals are made relative: a tenth of the median.
    floor: f64,
}

impl Channel {
    fn new(problem: &Problem, f: impl Fn([f32; 3]) -> f64) -> Self {
        let target: Vec<f64> = problem.target.iter().map(|p| f(*p)).collect();
        let mut lit: Vec<f64> =
            target.iter().zip(&problem.weights).filter(|(_, w)| **w > 0.0).map(|(t, _)| *t).collect();
        lit.sort_by(f64::total_cmp);
        let median = lit.get(lit.len() / 2).copied().unwrap_or(0.0);
        Self {
            lights: problem.lights.iter().map(|l| l.iter().map(|p| f(*p)).collect()).collect(),
            target,
            weights: problem.weights.clone(),
            floor: (median * 0.1).max(1e-6),
        }
    }

    /// The same with the light of some at a fixed ratio in that of one.
    fn with_tied(&self, to: usize, tied: &[usize], ratio: f64) -> Self {
        let mut lights = self.lights.clone();
        for i in tied {
            let own = std::mem::replace(&mut lights[*i], vec![0.0; self.target.len()]);
            for (all, more) in lights[to].iter_mut().zip(own) {
                *all += ratio * more;
            }
        }
        Self { lights, target: self.target.clone(), weights: self.weights.clone(), floor: self.floor }
    }

    fn sum(&self, gains: &[f64], p: usize) -> f64 {
        self.lights.iter().zip(gains).map(|(l, g)| l[p] * g).sum()
    }

    /// Median ratio of photo to render over pixels that have light, and how many there are.
    fn common_gain(&self) -> (f64, usize) {
        let ones = vec![1.0; self.lights.len()];
        let mut ratios: Vec<f64> = (0..self.target.len())
            .filter(|p| self.weights[*p] > 0.0)
            .map(|p| (self.target[p], self.sum(&ones, p)))
            .filter(|(_, render)| *render > 1e-9)
            .map(|(photo, render)| photo / render)
            .collect();
        ratios.sort_by(f64::total_cmp);
        (ratios.get(ratios.len() / 2).copied().unwrap_or(f64::NAN), ratios.len())
    }

    fn residual(&self, gains: &[f64], p: usize) -> f64 {
        let sum = self.sum(gains, p);
        (sum - self.target[p]) / (f64::midpoint(sum, self.target[p]) + self.floor)
    }

    fn median_residual(&self, gains: &[f64]) -> f64 {
        let counted = (0..self.target.len()).filter(|p| self.weights[*p] > 0.0);
        let mut all: Vec<f64> = counted.map(|p| self.residual(gains, p).abs()).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or(0.0)
    }

    /// Iteratively re-weighted, non-negative ridge regression towards `prior`.
    fn solve(&self, prior: &[f64], ridge: &[f64], options: &FitOptions) -> Vec<f64> {
        let n = self.lights.len();
        let mut gains = prior.to_vec();
        for _ in 0..options.rounds.max(1) {
            let mut h = vec![vec![0.0; n]; n];
            let mut b = vec![0.0; n];
            for p in 0..self.target.len() {
                let robust = 1.0 / (1.0 + (self.residual(&gains, p) / options.outlier).powi(2)).powi(2);
                let scale = f64::midpoint(self.sum(&gains, p), self.target[p]) + self.floor;
                let w = self.weights[p] * robust / (scale * scale);
                if w <= 0.0 || !w.is_finite() {
                    continue;
                }
                for i in 0..n {
                    let wi = w * self.lights[i][p];
                    b[i] += wi * self.target[p];
                    for (hij, light) in h[i].iter_mut().zip(&self.lights[..=i]) {
                        *hij += wi * light[p];
                    }
                }
            }
            let largest = (0..n).map(|i| h[i][i]).fold(0.0, f64::max);
            for i in 0..n {
                // A light that hardly reaches the image is held by the prior alone.
                let pull = ridge[i] * h[i][i].max(largest * 1e-3);
                h[i][i] += pull;
                b[i] += pull * prior[i];
                let lower = h[i][..i].to_vec();
                for (row, v) in h.iter_mut().zip(lower) {
                    row[i] = v;
                }
            }
            gains = non_negative_minimum(&h, &b, gains);
        }
        gains
    }
}

/// Minimises `x'Hx/2 - b'x` for `x >= 0`, `H` positive definite, by cyclic coordinate descent.
fn non_negative_minimum(h: &[Vec<f64>], b: &[f64], start: Vec<f64>) -> Vec<f64> {
    let mut x = start;
    for _ in 0..5000 {
        let mut change = 0.0f64;
        for i in 0..x.len() {
            if h[i][i] <= 0.0 {
                continue;
            }
            let others: f64 = (0..x.len()).filter(|j| *j != i).map(|j| h[i][j] * x[j]).sum();
            let next = ((b[i] - others) / h[i][i]).max(0.0);
            change = change.max((next - x[i]).abs() / (1e-9 + next.max(x[i])));
            x[i] = next;
        }
        if change < 1e-9 {
            break;
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delta::tests::evening;

    const SIZE: ImageSize = ImageSize { width: 96, height: 64 };

    /// Three lights with different fall-off, as linear images over a textured wall.
    fn passes() -> Vec<LightPass> {
        let pass = |id: Option<&str>, f: &dyn Fn(f32, f32) -> f32| LightPass {
            light: id.map(str::to_owned),
            is_daylight: false,
            image: LinearImage {
                size: SIZE,
                rgb: (0..SIZE.pixels())
                    .map(|i| {
                        let (x, y) = ((i % 96) as f32 / 96.0, (i / 96) as f32 / 64.0);
                        let albedo = if (i / 7) % 2 == 0 { 0.7 } else { 0.4 };
                        let v = f(x, y) * albedo;
                        [v, v * 0.9, v * 0.8]
                    })
                    .collect(),
            },
        };
        vec![
            pass(Some("lamp_01"), &|x, y| 0.3 / (0.05 + (x - 0.2).powi(2) + (y - 0.5).powi(2))),
            pass(Some("window_01"), &|x, _| 0.2 + 0.8 * x),
            pass(None, &|_, _| 0.3),
        ]
    }

    #[test]
    fn known_gains_come_back_although_a_fifth_of_the_photo_shows_something_else() {
        let passes = passes();
        let truth = [[0.5, 0.4, 0.3], [2.0, 2.0, 2.2], [1.0, 1.0, 1.0]];
        let mut photo = relight(&passes, &truth);
        for (i, p) in photo.rgb.iter_mut().enumerate() {
            if i % 96 > 70 && i / 96 > 20 {
                *p = [0.02, 0.3, 0.02];
            }
        }
        let options = FitOptions { intensity_ridge: 1e-4, color_ridge: 1e-3, ..FitOptions::default() };
        let fit = fit_lights(&passes, &photo, &[], &options).unwrap();
        // The window falls off gently, so that it and the ambient light can stand in for each other a little.
        for ((got, want), tolerance) in fit.gains.iter().zip(&truth).zip([0.05, 0.2]) {
            let near = got.iter().zip(want).all(|(g, w)| (g - w).abs() <= tolerance * w);
            assert!(near, "{:?}", fit.gains);
        }
        let (want, got) = (relight(&passes, &truth), relight(&passes, &fit.gains));
        for (w, g) in want.rgb.iter().zip(&got.rgb) {
            assert!((0..3).all(|c| (w[c] - g[c]).abs() <= 0.1 * w[c]), "{w:?} {g:?}");
        }
        assert!(fit.residual_after < fit.residual_before * 0.3, "{fit:?}");
    }

    #[test]
    fn no_lamp_shines_green_because_the_room_is_not_what_was_thought() {
        // What the photo shows around the lamp is five times as green as the scene has it: a plant, say, taken for a wall.
        let passes = passes();
        let photo = relight(&passes, &[[1.0, 5.0, 0.0], [1.0; 3], [1.0; 3]]);
        let free = FitOptions { greener: 9.0, warmer: 9.0, color_ridge: 1e-3, ..FitOptions::default() };
        let [r, g, b] = fit_lights(&passes, &photo, &[], &free).unwrap().gains[0];
        assert!(g > 3.0 * f64::midpoint(r, b), "a free fit follows it: {r} {g} {b}");
        let fit = fit_lights(&passes, &photo, &[], &FitOptions { color_ridge: 1e-3, ..FitOptions::default() }).unwrap();
        let [r, g, b] = fit.gains[0];
        assert!(g <= 1.24 * (r * b).sqrt(), "{:?}", fit.gains);
        assert!(r / b <= 2.0_f64.powf(1.21), "{:?}", fit.gains);
        let luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
        assert!((2.0..5.0).contains(&luminance), "as bright as the photo has it: {:?}", fit.gains);
    }

    #[test]
    fn daylight_does_not_turn_orange_beside_warm_paint() {
        let mut passes = passes();
        let photo = relight(&passes, &[[1.6, 1.0, 0.5], [1.0; 3], [1.0; 3]]);
        let options = FitOptions { color_ridge: 1e-3, ..FitOptions::default() };
        let [r, _, b] = fit_lights(&passes, &photo, &[], &options).unwrap().gains[0];
        assert!(r / b > 2.2, "a lamp may: {r} {b}");
        passes[0].is_daylight = true;
        let [r, _, b] = fit_lights(&passes, &photo, &[], &options).unwrap().gains[0];
        assert!((1.2..1.33).contains(&(r / b)), "{r} {b}");
    }

    #[test]
    fn a_window_that_nobody_sees_has_no_brighter_sky_than_the_one_that_is_seen() {
        let mut passes = passes();
        let photo = relight(&passes, &[[0.8; 3], [2.4; 3], [0.5; 3]]);
        let gains = |passes: &[LightPass]| {
            let fit = fit_lights(passes, &photo, &[], &FitOptions { intensity_ridge: 1e-3, ..FitOptions::default() });
            fit.unwrap().gains.into_iter().map(|g| g[1]).collect::<Vec<f64>>()
        };
        let free = gains(&passes);
        assert!(free[1] > 2.5 * free[0], "{free:?}");
        (passes[0].is_daylight, passes[1].is_daylight) = (true, true);
        passes[1].light = Some("daylight_front".to_owned());
        let tied = gains(&passes);
        assert!((tied[1] / tied[0] - 1.5).abs() < 0.02 && tied[0] > 0.3, "{tied:?} {free:?}");
    }

    #[test]
    fn a_light_that_is_off_in_the_photo_goes_off() {
        let passes = passes();
        let photo = relight(&passes, &[[0.0; 3], [1.5; 3], [0.5; 3]]);
        let options = FitOptions { intensity_ridge: 1e-3, ..FitOptions::default() };
        let fit = fit_lights(&passes, &photo, &[], &options).unwrap();
        let mut lighting = evening();
        lighting.lights[0].on = true;
        let notes = fit.apply(&mut lighting);
        assert!(!lighting.lights[0].on, "{fit:?}");
        assert!(lighting.lights[1].on);
        assert_eq!(lighting.lights[2], evening().lights[2], "a light without a pass stays as it is");
        assert!(notes.iter().any(|n| n.contains("switched off")));
    }

    #[test]
    fn a_masked_area_has_no_say_and_exposure_is_undone() {
        let passes = passes();
        let mut photo = relight(&passes, &[[1.0; 3]; 3]);
        for p in &mut photo.rgb {
            *p = p.map(|v| v * 4.0);
        }
        let weights: Vec<f32> = (0..SIZE.pixels()).map(|i| if i % 96 < 48 { 1.0 } else { 0.0 }).collect();
        for (p, w) in photo.rgb.iter_mut().zip(&weights) {
            if *w == 0.0 {
                *p = [f32::NAN; 3];
            }
        }
        let fit =
            fit_lights(&passes, &photo, &weights, &FitOptions { exposure: 2.0, ..FitOptions::default() }).unwrap();
        assert!(fit.gains.iter().flatten().all(|g| (g - 1.0).abs() <= 0.05), "{:?}", fit.gains);
        assert!((fit.coverage - 0.5).abs() <= 1e-9);
    }

    #[test]
    fn nothing_to_fit_is_an_error() {
        let dark = vec![LightPass { light: None, is_daylight: false, image: LinearImage::black(SIZE) }];
        let photo = LinearImage::black(SIZE);
        assert!(matches!(fit_lights(&dark, &photo, &[], &FitOptions::default()), Err(FitError::NoLight { .. })));
        assert!(matches!(fit_lights(&[], &photo, &[], &FitOptions::default()), Err(FitError::NoLight { .. })));
        let small = LinearImage::black(ImageSize::new(4, 4));
        assert!(matches!(fit_lights(&dark, &small, &[], &FitOptions::default()), Err(FitError::Sizes { .. })));
    }

    #[test]
    fn the_solver_finds_the_constrained_minimum() {
        // The free minimum is (2, -1); on x >= 0 it is (b0 / h00, 0).
        let h = vec![vec![2.0, 1.0], vec![1.0, 2.0]];
        let x = non_negative_minimum(&h, &[3.0, 0.0], vec![5.0, 5.0]);
        assert!((x[0] - 1.5).abs() <= 1e-8 && x[1] == 0.0, "{x:?}");
    }
}
