//! The seen piece of a surface, and its profiles along an axis.

use image::RgbaImage;

use super::super::color::{encoded, linear_of, luminance};
use super::super::space::Rgb;

/// Pixels of a surface in its own plane.
pub(super) struct View {
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Pixels a metre.
    pub px_per_m: f64,
    /// Which pixels are seen.
    pub seen: Vec<bool>,
    /// Linear colour.
    pub color: Vec<Rgb>,
    /// Encoded (sRGB) colour: steps of equal size look equal.
    pub look: Vec<Rgb>,
}

/// What is measured at a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) enum Signal {
    /// Size of the step across the axis: joints, edges of pieces.
    Step,
    /// How much darker than both sides: grooves, light or dark.
    Line,
    /// Position of the colour on a line through color space, given by its direction.
    Along(Rgb),
}

/// Sums over the pixels in each bin of a coordinate.
pub(super) struct Profile {
    /// Coordinate of the first bin's centre, metres.
    pub start: f64,
    /// Bin, metres.
    pub step: f64,
    /// Mean of the signal, slow changes taken out.
    pub value: Vec<f64>,
    /// Number of pixels.
    pub weight: Vec<f64>,
}

impl View {
    pub(super) fn new(image: &RgbaImage, px_per_m: f64) -> Self {
        let size = [image.width() as usize, image.height() as usize];
        let seen: Vec<bool> = image.pixels().map(|p| p.0[3] > 127).collect();
        let color: Vec<Rgb> = image.pixels().map(|p| linear_of([p.0[0], p.0[1], p.0[2]])).collect();
        let look = color.iter().map(|c| c.map(encoded)).collect();
        Self { size, px_per_m, seen, color, look }
    }

    /// Place of a pixel, metres.
    pub(super) fn place(&self, k: usize) -> [f64; 2] {
        let (x, y) = (k % self.size[0], k / self.size[0]);
        [(x as f64 + 0.5) / self.px_per_m, (y as f64 + 0.5) / self.px_per_m]
    }

    /// Seen pixels.
    pub(super) fn pixels(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.seen.len()).filter(|k| self.seen[*k])
    }

    fn at(&self, x: f64, y: f64) -> Option<Rgb> {
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let mut sum = [0.0; 3];
        for (dx, dy, w) in
            [(0, 0, (1.0 - fx) * (1.0 - fy)), (1, 0, fx * (1.0 - fy)), (0, 1, (1.0 - fx) * fy), (1, 1, fx * fy)]
        {
            if w <= 1e-9 {
                continue;
            }
            let (i, j) = (x0 as i64 + dx, y0 as i64 + dy);
            if i < 0 || j < 0 || i >= self.size[0] as i64 || j >= self.size[1] as i64 {
                return None;
            }
            let k = j as usize * self.size[0] + i as usize;
            if !self.seen[k] {
                return None;
            }
            for (s, c) in sum.iter_mut().zip(self.look[k]) {
                *s += w * c;
            }
        }
        Some(sum)
    }

    /// Profile of a signal along `axis` (unit, pixels and metres alike); `class` tells which of several profiles a pixel
    /// belongs to by its place, `None` leaves it out.
    pub(super) fn profiles(
        &self,
        axis: [f64; 2],
        signal: Signal,
        slow: f64,
        classes: usize,
        class: impl Fn([f64; 2]) -> Option<usize>,
    ) -> Vec<Profile> {
        let step = 0.5 / self.px_per_m;
        let along = |p: [f64; 2]| p[0] * axis[0] + p[1] * axis[1];
        let (w, h) = (self.size[0] as f64 / self.px_per_m, self.size[1] as f64 / self.px_per_m);
        let ends = [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]].map(along);
        let low = ends.iter().copied().fold(f64::INFINITY, f64::min);
        let high = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let bins = ((high - low) / step).ceil() as usize + 1;
        let mut out: Vec<Profile> = (0..classes)
            .map(|_| Profile { start: low + step / 2.0, step, value: vec![0.0; bins], weight: vec![0.0; bins] })
            .collect();
        for k in self.pixels() {
            let p = self.place(k);
            let Some(c) = class(p) else { continue };
            let (x, y) = ((k % self.size[0]) as f64, (k / self.size[0]) as f64);
            let side = |d: f64| self.at(x + axis[0] * d, y + axis[1] * d);
            let value = match signal {
                Signal::Along(axis) => {
                    let c = self.look[k];
                    c[0] * axis[0] + c[1] * axis[1] + c[2] * axis[2]
                }
                Signal::Step => match (side(1.0), side(-1.0)) {
                    (Some(a), Some(b)) => a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>() / 3.0,
                    _ => continue,
                },
                Signal::Line => match (side(2.5), side(-2.5)) {
                    (Some(a), Some(b)) => {
                        let own = self.look[k];
                        (0..3).map(|i| f64::midpoint(a[i], b[i]) - own[i]).sum::<f64>() / 3.0
                    }
                    _ => continue,
                },
            };
            let s = along(p);
            let bin = (((s - low) / step) as usize).min(bins - 1);
            out[c].value[bin] += value;
            out[c].weight[bin] += 1.0;
        }
        for p in &mut out {
            for (v, w) in p.value.iter_mut().zip(&p.weight) {
                if *w > 0.0 {
                    *v /= *w;
                }
            }
            p.remove_slow((slow / step) as usize);
        }
        out
    }

    /// Mean linear colour of the pixels that `take` accepts, darkest and brightest fiftieth left out; how many they are.
    pub(super) fn mean_color(&self, take: impl Fn([f64; 2]) -> bool) -> Option<(Rgb, usize)> {
        let mut picked: Vec<usize> = self.pixels().filter(|k| take(self.place(*k))).collect();
        if picked.len() < 24 {
            return None;
        }
        picked.sort_by(|a, b| luminance(self.color[*a]).total_cmp(&luminance(self.color[*b])).then(a.cmp(b)));
        let cut = picked.len() / 50;
        let kept = &picked[cut..picked.len() - cut];
        let mut sum = [0.0; 3];
        for k in kept {
            for (s, c) in sum.iter_mut().zip(self.color[*k]) {
                *s += c / kept.len() as f64;
            }
        }
        Some((sum, picked.len()))
    }

    /// Direction of the strongest change of (encoded) colour, unit; by power iteration on the covariance.
    pub(super) fn main_axis(&self) -> Rgb {
        let n = self.pixels().count().max(1) as f64;
        let mut mean = [0.0; 3];
        for k in self.pixels() {
            for (m, c) in mean.iter_mut().zip(self.look[k]) {
                *m += c / n;
            }
        }
        let mut cov = [[0.0; 3]; 3];
        for k in self.pixels() {
            let d: Rgb = std::array::from_fn(|i| self.look[k][i] - mean[i]);
            for i in 0..3 {
                for j in 0..3 {
                    cov[i][j] += d[i] * d[j] / n;
                }
            }
        }
        let mut axis = [0.6, 0.58, 0.55];
        for _ in 0..40 {
            let next: Rgb = std::array::from_fn(|i| (0..3).map(|j| cov[i][j] * axis[j]).sum());
            let length = next.iter().map(|c| c * c).sum::<f64>().sqrt();
            if length < 1e-12 {
                break;
            }
            axis = next.map(|c| c / length);
        }
        axis
    }
}

impl Profile {
    /// Takes out the weighted mean over windows of `bins` each side.
    fn remove_slow(&mut self, bins: usize) {
        let n = self.value.len();
        let mut sum = vec![(0.0, 0.0); n + 1];
        for k in 0..n {
            let (v, w) = (self.value[k], self.weight[k]);
            sum[k + 1] = (sum[k].0 + v * w, sum[k].1 + w);
        }
        let bins = bins.max(1);
        let slow: Vec<f64> = (0..n)
            .map(|k| {
                let (a, b) = (k.saturating_sub(bins), (k + bins + 1).min(n));
                let (v, w) = (sum[b].0 - sum[a].0, sum[b].1 - sum[a].1);
                if w > 0.0 { v / w } else { 0.0 }
            })
            .collect();
        for ((v, s), w) in self.value.iter_mut().zip(slow).zip(&self.weight) {
            *v = if *w > 0.0 { *v - s } else { 0.0 };
        }
    }
}
