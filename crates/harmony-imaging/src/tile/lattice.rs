//! Patterns that repeat in two directions: tiles, checks, bricks, printed paper.
//!
//! Two shifts that carry what was seen onto itself span a lattice (H.-C. Lin, L.-L. Wang, S.-N. Yang, "Extracting
//! Periodicity of a Regular Texture Based on Autocorrelation Functions", Pattern Recognition Letters 18, 1997). All
//! observations of a place of the unit cell are averaged, so that the pattern goes on anywhere, in step with the part
//! that was seen. Weak regime: fewer than some three periods seen, and patterns finer than five texels of the search.

use glam::{DMat2, DVec2, IVec2};

use super::base::Color;

/// Longest side of the observed part while shifts are searched, texels.
const SEARCH_PX: usize = 128;
/// Shortest period, texels of the search.
const SHORTEST: f64 = 5.0;
/// Known texels that must meet known texels under a shift, as a share of all.
const OVERLAP: f64 = 0.15;
/// Least correlation under a shift of the lattice.
const ALIKE: f32 = 0.3;
/// How far the correlation must have dropped on the way to the shift.
const PROMINENCE: f32 = 0.25;
/// Share of the variance of one half of the cells that the mean of the other half must explain.
const EXPLAINED: f64 = 0.25;
/// Contrast below which there is no pattern to look for (standard deviation of the ratio to the light).
const MIN_CONTRAST: f64 = 0.012;
/// Cells that must have been seen.
const MIN_CELLS: f64 = 6.0;
/// Longest side of the stored cell, texels.
const CELL_PX: usize = 320;
/// Deviation from the cell's mean at which an observation is left out of it.
const OUTLIER: f32 = 0.25;

/// What the pattern multiplies the light by, on a plane; `None` where unknown. Row-major.
pub(super) struct Ratios<'a> {
    pub width: usize,
    pub height: usize,
    pub values: &'a [Option<Color>],
}

/// A repeating pattern, in step with the plane that it was found on.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    /// Cell coordinates (0 to 1 along both periods) of texel coordinates.
    cell_from_texel: DMat2,
    width: usize,
    height: usize,
    cell: Vec<Color>,
}

/// Two planes at the search's resolution: brightness and warmth, means removed.
struct Small {
    width: usize,
    height: usize,
    scale: f64,
    values: Vec<Option<[f32; 2]>>,
    known: usize,
}

impl Ratios<'_> {
    fn observed_box(&self) -> Option<[usize; 4]> {
        let mut bounds: Option<[usize; 4]> = None;
        for (i, _) in self.values.iter().enumerate().filter(|(_, v)| v.is_some()) {
            let (x, y) = (i % self.width, i / self.width);
            let b = bounds.get_or_insert([x, y, x, y]);
            *b = [b[0].min(x), b[1].min(y), b[2].max(x), b[3].max(y)];
        }
        bounds
    }

    /// Means of blocks inside the observed part.
    fn small(&self) -> Option<Small> {
        let [x0, y0, x1, y1] = self.observed_box()?;
        let k = (x1 - x0 + 1).max(y1 - y0 + 1).div_ceil(SEARCH_PX).max(1);
        let (width, height) = ((x1 - x0 + 1).div_ceil(k), (y1 - y0 + 1).div_ceil(k));
        let mut values: Vec<Option<[f32; 2]>> = (0..width * height)
            .map(|i| {
                let (left, top) = (x0 + i % width * k, y0 + i / width * k);
                let (mut sum, mut n) = ([0.0; 2], 0);
                for y in top..(top + k).min(self.height) {
                    for c in
                        self.values[y * self.width + left..y * self.width + (left + k).min(self.width)].iter().flatten()
                    {
                        sum = [sum[0] + c[0] + c[1] + c[2], sum[1] + c[0] - c[2]];
                        n += 1;
                    }
                }
                (2 * n >= k * k).then(|| [sum[0] / (3 * n) as f32, sum[1] / n as f32])
            })
            .collect();
        let known = values.iter().flatten().count();
        let mut mean = [0.0_f32; 2];
        for v in values.iter().flatten() {
            mean = [mean[0] + v[0], mean[1] + v[1]];
        }
        let mean = mean.map(|m| m / known.max(1) as f32);
        for v in values.iter_mut().flatten() {
            *v = [v[0] - mean[0], v[1] - mean[1]];
        }
        Some(Small { width, height, scale: k as f64, values, known })
    }

    /// Mean squared difference of known texels under a shift, over every `stride`-th texel; `None` when few meet.
    fn difference(&self, shift: IVec2, stride: usize) -> Option<f64> {
        let (mut sum, mut n, mut known) = (0.0, 0_usize, 0_usize);
        for y in (0..self.height).step_by(stride) {
            for x in (0..self.width).step_by(stride) {
                let Some(a) = self.values[y * self.width + x] else { continue };
                known += 1;
                let (u, v) = (x as i32 + shift.x, y as i32 + shift.y);
                if u < 0 || v < 0 || u as usize >= self.width || v as usize >= self.height {
                    continue;
                }
                if let Some(b) = self.values[v as usize * self.width + u as usize] {
                    // Bounded, so that a stain on one of both sides does not decide.
                    sum += (0..3).map(|k| f64::from((a[k] - b[k]).abs().min(0.5)).powi(2)).sum::<f64>();
                    n += 1;
                }
            }
        }
        (n as f64 > 0.5 * OVERLAP * known as f64 && n > 50).then(|| sum / n as f64)
    }

    /// A period, found to a texel of the search, made exact: first alone, then by its multiples, as far as was seen.
    fn refined(&self, period: DVec2, reach: i32) -> DVec2 {
        let stride = ((self.width * self.height) as f64 / 20_000.0).sqrt().ceil().max(1.0) as usize;
        let mut best = period;
        let mut reach = reach.max(1);
        for multiple in [1.0, 2.0, 4.0, 8.0] {
            let around = (best * multiple).round().as_ivec2();
            let mut found: Option<(f64, IVec2)> = None;
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let shift = around + IVec2::new(dx, dy);
                    let Some(d) = self.difference(shift, stride) else { continue };
                    if found.is_none_or(|(least, _)| d < least) {
                        found = Some((d, shift));
                    }
                }
            }
            let Some((_, shift)) = found else { break };
            best = shift.as_dvec2() / multiple;
            reach = 2;
        }
        best
    }
}

impl Small {
    /// Correlation under a shift; `None` when too few known texels meet.
    fn correlation(&self, shift: IVec2) -> Option<f32> {
        let (mut ab, mut aa, mut bb, mut n) = (0.0_f32, 0.0_f32, 0.0_f32, 0_usize);
        let x0 = (-shift.x).max(0) as usize;
        let x1 = (self.width as i32 - shift.x.max(0)).max(0) as usize;
        for y in (-shift.y).max(0) as usize..(self.height as i32 - shift.y.max(0)).max(0) as usize {
            let row = y * self.width;
            let other = (y as i32 + shift.y) as usize * self.width;
            for x in x0..x1 {
                let (Some(a), Some(b)) = (self.values[row + x], self.values[other + (x as i32 + shift.x) as usize])
                else {
                    continue;
                };
                ab += a[0] * b[0] + a[1] * b[1];
                aa += a[0] * a[0] + a[1] * a[1];
                bb += b[0] * b[0] + b[1] * b[1];
                n += 1;
            }
        }
        (n as f64 >= OVERLAP * self.known as f64 && n > 30).then(|| ab / (aa * bb).sqrt().max(1e-9))
    }

    /// The two shortest good shifts that don't lie on a line, texels of the full picture.
    fn periods(&self) -> Option<[DVec2; 2]> {
        use rayon::prelude::*;
        let n = self.known.max(1) as f64;
        let variance = self.values.iter().flatten().map(|v| f64::from(v[0] * v[0] + v[1] * v[1])).sum::<f64>() / n;
        if variance.sqrt() < MIN_CONTRAST {
            return None;
        }
        let (rx, ry) = (self.width as i32 * 2 / 3, self.height as i32 * 2 / 3);
        let across = (2 * rx + 1) as usize;
        let map: Vec<Option<f32>> = (0..across * (ry + 1) as usize)
            .into_par_iter()
            .map(|i| self.correlation(IVec2::new((i % across) as i32 - rx, (i / across) as i32)))
            .collect();
        let at = |x: i32, y: i32| {
            // The correlation of a shift is that of the shift back.
            let (x, y) = if y < 0 { (-x, -y) } else { (x, y) };
            (x.abs() <= rx && y <= ry).then(|| map[y as usize * across + (x + rx) as usize]).flatten()
        };
        let mut peaks: Vec<(f32, DVec2)> = Vec::new();
        for y in 0..=ry {
            for x in -rx..=rx {
                let shift = DVec2::new(f64::from(x), f64::from(y));
                let Some(here) = at(x, y).filter(|c| *c >= ALIKE && shift.length() >= SHORTEST) else { continue };
                if y == 0 && x < 0 {
                    continue;
                }
                let peak = (-1..=1).all(|dy| (-1..=1).all(|dx| at(x + dx, y + dy).is_none_or(|c| c <= here)));
                let steps = shift.length().ceil();
                let lowest = (1..steps as i32)
                    .filter_map(|k| {
                        let p = (shift * f64::from(k) / steps).round();
                        at(p.x as i32, p.y as i32)
                    })
                    .fold(f32::INFINITY, f32::min);
                if peak && here - lowest >= PROMINENCE {
                    peaks.push((here, shift));
                }
            }
        }
        let best = peaks.iter().map(|p| p.0).fold(0.0, f32::max);
        let shortest = |least: f32, beside: Option<DVec2>| {
            peaks
                .iter()
                .filter(|(c, _)| *c >= least)
                .filter(|(_, s)| beside.is_none_or(|a| a.perp_dot(*s).abs() > 0.5 * a.length() * s.length()))
                .min_by(|a, b| a.1.length().total_cmp(&b.1.length()).then(b.0.total_cmp(&a.0)))
                .map(|p| p.1)
        };
        let a = shortest(0.85 * best, None)?;
        let b = shortest(0.7 * best, Some(a))?;
        Some([a * self.scale, b * self.scale])
    }
}

impl Lattice {
    /// The repeating pattern of what was seen, when there is one.
    pub(super) fn find(ratios: &Ratios<'_>) -> Option<Self> {
        let small = ratios.small()?;
        let periods = small.periods()?;
        let [a, b] = periods.map(|p| ratios.refined(p, small.scale as i32 + 1));
        let area = a.perp_dot(b).abs();
        let known = ratios.values.iter().flatten().count();
        if area < 16.0 || (known as f64) < MIN_CELLS * area {
            return None;
        }
        let lattice = Self::averaged(ratios, a, b)?;
        (lattice.foretold(ratios) >= EXPLAINED).then_some(lattice)
    }

    /// A picture of one period, laid out by the map from texels to its coordinates (0 to 1 across and down). `None`
    /// when it has no area or the map is singular.
    pub(super) fn printed(picture: &image::RgbaImage, cell_from_texel: DMat2) -> Option<Self> {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let sound = cell_from_texel.is_finite() && cell_from_texel.determinant().abs() > 1e-12;
        if width == 0 || height == 0 || !sound {
            return None;
        }
        let n = (width * height) as f32;
        let sum = picture.pixels().fold([0.0_f32; 3], |s, p| std::array::from_fn(|c| s[c] + f32::from(p.0[c])));
        let mean = sum.map(|s| (s / n).max(1.0));
        let cell = picture.pixels().map(|p| std::array::from_fn(|c| f32::from(p.0[c]) / mean[c])).collect();
        Some(Self { cell_from_texel, width, height, cell })
    }

    /// The same pattern, its ratios to the power given.
    pub(super) fn with_contrast(&self, times: f32) -> Self {
        Self { cell: self.cell.iter().map(|c| c.map(|v| v.max(1e-3).powf(times))).collect(), ..self.clone() }
    }

    /// The same periods, averaged anew (the light is known better now).
    pub(super) fn averaged_again(&self, ratios: &Ratios<'_>) -> Option<Self> {
        let texel_from_cell = self.cell_from_texel.inverse();
        Self::averaged(ratios, texel_from_cell.x_axis, texel_from_cell.y_axis)
    }

    fn averaged(ratios: &Ratios<'_>, a: DVec2, b: DVec2) -> Option<Self> {
        let side = |p: DVec2| (p.length().round() as usize).clamp(4, CELL_PX);
        let (width, height) = (side(a), side(b));
        let cell_from_texel = DMat2::from_cols(a, b).inverse();
        if !cell_from_texel.is_finite() {
            return None;
        }
        let mut lattice = Self { cell_from_texel, width, height, cell: vec![[1.0; 3]; width * height] };
        for pass in 0..3 {
            let mut sums = vec![([0.0_f32; 3], 0.0_f32); width * height];
            for (i, c) in ratios.values.iter().enumerate() {
                let Some(c) = c else { continue };
                let (x, y) = ((i % ratios.width) as f64 + 0.5, (i / ratios.width) as f64 + 0.5);
                let bin = lattice.bin(x, y);
                let mean = lattice.cell[bin];
                if pass > 0 && (0..3).any(|k| (c[k] - mean[k]).abs() > OUTLIER) {
                    continue;
                }
                for (s, v) in sums[bin].0.iter_mut().zip(c) {
                    *s += v;
                }
                sums[bin].1 += 1.0;
            }
            let means: Vec<Option<Color>> = sums.iter().map(|(s, n)| (*n > 0.0).then(|| s.map(|v| v / n))).collect();
            if means.iter().flatten().count() * 5 < means.len() * 4 {
                return None;
            }
            lattice.cell = filled(means, width, height);
        }
        Some(lattice)
    }

    fn bin(&self, x: f64, y: f64) -> usize {
        let p = self.cell_from_texel * DVec2::new(x, y);
        let along = |t: f64, n: usize| (((t - t.floor()) * n as f64) as usize).min(n - 1);
        along(p.y, self.height) * self.width + along(p.x, self.width)
    }

    /// What the pattern multiplies the light by, at texel coordinates (texel centres at halves).
    pub(super) fn at(&self, x: f64, y: f64) -> Color {
        let p = self.cell_from_texel * DVec2::new(x, y);
        let along = |t: f64, n: usize| {
            let s = (t - t.floor()) * n as f64 - 0.5;
            let low = s.floor();
            let wrap = |k: f64| k.rem_euclid(n as f64) as usize % n;
            (wrap(low), wrap(low + 1.0), (s - low) as f32)
        };
        let ((x0, x1, tx), (y0, y1, ty)) = (along(p.x, self.width), along(p.y, self.height));
        let get = |x: usize, y: usize| self.cell[y * self.width + x];
        std::array::from_fn(|c| {
            let top = get(x0, y0)[c] * (1.0 - tx) + get(x1, y0)[c] * tx;
            let bottom = get(x0, y1)[c] * (1.0 - tx) + get(x1, y1)[c] * tx;
            top * (1.0 - ty) + bottom * ty
        })
    }

    /// Both periods, texels.
    pub(super) fn periods(&self) -> [DVec2; 2] {
        let m = self.cell_from_texel.inverse();
        [m.x_axis, m.y_axis]
    }

    /// Share of the variance of every second cell that the mean of the other cells foretells.
    ///
    /// What was seen of few cells is always explained by its own mean: shapes that don't repeat would pass.
    fn foretold(&self, ratios: &Ratios<'_>) -> f64 {
        let texels = || {
            ratios.values.iter().enumerate().filter_map(|(i, c)| {
                let (x, y) = ((i % ratios.width) as f64 + 0.5, (i / ratios.width) as f64 + 0.5);
                let cell = (self.cell_from_texel * DVec2::new(x, y)).floor();
                c.map(|c| ((cell.x + cell.y).rem_euclid(2.0) > 0.5, self.bin(x, y), c))
            })
        };
        let mut sums = vec![([0.0_f32; 3], 0.0_f32); self.cell.len()];
        for (_, bin, c) in texels().filter(|t| !t.0) {
            for (s, v) in sums[bin].0.iter_mut().zip(c) {
                *s += v;
            }
            sums[bin].1 += 1.0;
        }
        let (mut sum, mut squares, mut rest, mut n) = ([0.0_f64; 3], [0.0_f64; 3], 0.0_f64, 0.0_f64);
        for (_, bin, c) in texels().filter(|t| t.0) {
            let (mean, count) = sums[bin];
            if count < 0.5 {
                continue;
            }
            for k in 0..3 {
                let v = f64::from(c[k]);
                sum[k] += v;
                squares[k] += v * v;
                rest += (v - f64::from(mean[k] / count)).powi(2);
            }
            n += 1.0;
        }
        if n < 100.0 {
            return 0.0;
        }
        let total: f64 = (0..3).map(|k| squares[k] - sum[k] * sum[k] / n).sum();
        1.0 - rest / total.max(1e-12)
    }
}

/// Bins without observation take the mean of their neighbours, around the corner too.
fn filled(mut bins: Vec<Option<Color>>, width: usize, height: usize) -> Vec<Color> {
    for _ in 0..width + height {
        if bins.iter().all(Option::is_some) {
            break;
        }
        let old = bins.clone();
        for (i, bin) in bins.iter_mut().enumerate().filter(|(_, b)| b.is_none()) {
            let (x, y) = (i % width, i / width);
            let around = [
                y * width + (x + 1) % width,
                y * width + (x + width - 1) % width,
                (y + 1) % height * width + x,
                (y + height - 1) % height * width + x,
            ];
            let (mut sum, mut n) = ([0.0_f32; 3], 0.0_f32);
            for c in around.iter().filter_map(|j| old[*j]) {
                sum = [sum[0] + c[0], sum[1] + c[1], sum[2] + c[2]];
                n += 1.0;
            }
            if n > 0.0 {
                *bin = Some(sum.map(|s| s / n));
            }
        }
    }
    bins.into_iter().map(|b| b.unwrap_or([1.0; 3])).collect()
}
