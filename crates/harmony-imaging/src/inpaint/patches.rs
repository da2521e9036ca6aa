//! Patch matching and voting on one picture.
//!
//! C. Barnes, E. Shechtman, A. Finkelstein, D. Goldman, "PatchMatch", SIGGRAPH 2009 (propagation and random search);
//! Y. Wexler, E. Shechtman, M. Irani, "Space-Time Completion of Video", PAMI 29(3), 2007 (match and vote in turns).
//! A patch may be copied with a bounded constant added to each channel, as in S. Darabi et al., "Image Melding",
//! SIGGRAPH 2012: light gradients go on smoothly while the detail is copied. Known weak regime: large structures that
//! the surroundings show only once.

use rayon::prelude::*;

use super::canvas::{Canvas, Texel};
use crate::distance::distance_to;
use crate::noise::{Random, hash};

/// Half width of a patch: 7 x 7 pixels.
pub(super) const RADIUS: i32 = 3;
/// "No match".
pub(super) const NONE: u32 = u32::MAX;
/// Rows are worked on in this many bands, whatever the number of threads.
const BANDS: usize = 8;
/// Fewer whole patches than this are no texture to copy from.
const MIN_CANDIDATES: usize = 48;
/// What adding a constant costs, relative to what it saves.
const OFFSET_COST: f32 = 0.15;
/// What sums of floats may be off by, when patches are told apart early.
const ROUNDING: f32 = 1.001;

/// Where each target patch is copied from.
#[derive(Debug, Clone)]
pub(crate) struct Matches {
    /// Index of the source patch's centre, or [`NONE`].
    pub(super) source: Vec<u32>,
    /// Mean squared difference.
    cost: Vec<f32>,
    /// Constant added to the source.
    pub(super) offset: Vec<Texel>,
}

/// Which patches have a say in a pixel's colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Vote {
    /// All that cover it.
    Wide,
    /// Those nearly centred on it: crisper.
    Sharp,
}

/// One level: the picture, and what may be copied where.
pub(super) struct Matcher<'a> {
    canvas: &'a Canvas,
    /// Pixels whose patch meets the hole.
    target: Vec<bool>,
    /// 1 for pixels that a copy should agree with: the hole and the sources, not what else is in the picture.
    weight: Vec<f32>,
    /// Centres of whole patches of sources.
    valid: Vec<bool>,
    /// The same, listed by label.
    candidates: Vec<Vec<u32>>,
    max_offset: f32,
    seed: u64,
}

impl<'a> Matcher<'a> {
    pub(super) fn new(canvas: &'a Canvas, max_offset: f32, seed: u64) -> Self {
        let (w, h) = (canvas.width, canvas.height);
        let blocked: Vec<bool> = canvas.hole.iter().zip(&canvas.source).map(|(h, s)| *h || !s).collect();
        let weight = canvas.hole.iter().zip(&canvas.source).map(|(h, s)| f32::from(u8::from(*h || *s))).collect();
        let near_hole = box_any(&canvas.hole, w, h);
        let near_blocked = box_any(&blocked, w, h);
        let r = RADIUS as usize;
        let mut valid = vec![false; w * h];
        let mut candidates = vec![Vec::new(); 256];
        for y in r..h.saturating_sub(r) {
            for x in r..w.saturating_sub(r) {
                let i = y * w + x;
                if !near_blocked[i] {
                    valid[i] = true;
                    candidates[canvas.label[i] as usize].push(i as u32);
                }
            }
        }
        for list in &mut candidates {
            if list.len() < MIN_CANDIDATES {
                list.clear();
            }
        }
        Self { canvas, target: near_hole, weight, valid, candidates, max_offset, seed }
    }

    /// Matches from those of the picture of half the size, or at random.
    pub(super) fn start(&self, half: Option<(&Matches, usize)>) -> Matches {
        let (w, n) = (self.canvas.width, self.canvas.pixels.len());
        let source = (0..n)
            .into_par_iter()
            .map(|i| {
                let list = &self.candidates[self.canvas.label[i] as usize];
                if !self.target[i] || list.is_empty() {
                    return NONE;
                }
                if let Some((matches, half_width)) = half {
                    let (x, y) = (i % w, i / w);
                    let s = matches.source[y / 2 * half_width + x / 2];
                    if s != NONE {
                        let (sx, sy) = (s as usize % half_width * 2 + x % 2, s as usize / half_width * 2 + y % 2);
                        if sx < w && sy < self.canvas.height && self.usable(sy * w + sx, i) {
                            return (sy * w + sx) as u32;
                        }
                    }
                }
                list[Random::new(self.seed ^ (i as u64) << 20).below(list.len())]
            })
            .collect();
        Matches { source, cost: vec![f32::INFINITY; n], offset: vec![[0.0; 4]; n] }
    }

    /// Whether a patch may be copied to the target.
    fn usable(&self, source: usize, target: usize) -> bool {
        self.valid[source] && self.canvas.label[source] == self.canvas.label[target]
    }

    /// Mean squared difference of two patches after the best constant, and the constant; `None` when the difference
    /// is not below `limit`, which mostly shows before all rows have been looked at.
    fn compare(&self, target: usize, source: usize, limit: f32) -> Option<(f32, Texel)> {
        // No constant brings the rows so far below their variance, and no patch has more pixels than a whole one.
        let most = limit * ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32 * ROUNDING;
        let (w, h) = (self.canvas.width as i32, self.canvas.height as i32);
        let (tx, ty) = (target as i32 % w, target as i32 / w);
        let (x0, x1) = ((-RADIUS).max(-tx), RADIUS.min(w - 1 - tx));
        let (y0, y1) = ((-RADIUS).max(-ty), RADIUS.min(h - 1 - ty));
        let mut sum = [0.0_f32; 4];
        let mut squares = [0.0_f32; 4];
        let mut n = 0.0_f32;
        for dy in y0..=y1 {
            let t = (target as i32 + dy * w + x0) as usize;
            let s = (source as i32 + dy * w + x0) as usize;
            let len = (x1 - x0 + 1) as usize;
            let pixels = self.canvas.pixels[t..t + len].iter().zip(&self.canvas.pixels[s..s + len]);
            for ((a, b), weight) in pixels.zip(&self.weight[t..t + len]) {
                for c in 0..4 {
                    let d = a[c] - b[c];
                    sum[c] += weight * d;
                    squares[c] += weight * d * d;
                }
                n += weight;
            }
            let variance = |c: usize| squares[c] - sum[c] * sum[c] / n.max(1.0);
            if variance(0) + variance(1) + variance(2) > most {
                return None;
            }
        }
        let n = n.max(1.0);
        let mut cost = 0.0;
        let mut offset = [0.0; 4];
        for c in 0..3 {
            let b = (sum[c] / n).clamp(-self.max_offset, self.max_offset);
            cost += squares[c] / n - 2.0 * b * sum[c] / n + b * b + OFFSET_COST * b * b;
            offset[c] = b;
        }
        (cost < limit).then_some((cost, offset))
    }

    /// One pass of propagation and random search; `pass` alternates the direction.
    pub(super) fn improve(&self, matches: &mut Matches, pass: u64) {
        let (w, h) = (self.canvas.width, self.canvas.height);
        let before = matches.source.clone();
        let rows = h.div_ceil(BANDS).max(1);
        let span = rows * w;
        let bands = matches
            .source
            .par_chunks_mut(span)
            .zip(matches.cost.par_chunks_mut(span))
            .zip(matches.offset.par_chunks_mut(span))
            .enumerate();
        bands.for_each(|(band, ((source, cost), offset))| {
            let first = band * span;
            let step: i64 = if pass.is_multiple_of(2) { -1 } else { 1 };
            let n = source.len();
            for k in 0..n {
                let local = if step < 0 { k } else { n - 1 - k };
                let i = first + local;
                if source[local] == NONE {
                    continue;
                }
                let x = i % w;
                let mut best = (cost[local], source[local] as usize, offset[local]);
                let mut consider = |candidate: usize| {
                    if candidate != best.1
                        && let Some((cost, offset)) = self.compare(i, candidate, best.0)
                    {
                        best = (cost, candidate, offset);
                    }
                };
                // The neighbours already visited, in this band or as they were.
                for (ok, delta) in [
                    (if step < 0 { x > 0 } else { x + 1 < w }, step),
                    (if step < 0 { i >= w } else { i + w < w * h }, step * w as i64),
                ] {
                    if !ok {
                        continue;
                    }
                    let j = (i as i64 + delta) as usize;
                    let s = if j >= first && j < first + n { source[j - first] } else { before[j] };
                    if s == NONE {
                        continue;
                    }
                    let candidate = i64::from(s) - delta;
                    if candidate >= 0 && (candidate as usize) < w * h && self.usable(candidate as usize, i) {
                        consider(candidate as usize);
                    }
                }
                let mut random = Random::new(self.seed ^ hash(pass) ^ i as u64);
                let list = &self.candidates[self.canvas.label[i] as usize];
                consider(list[random.below(list.len())] as usize);
                let centre = source[local] as usize;
                let (cx, cy) = ((centre % w) as i32, (centre / w) as i32);
                let mut reach = (w.max(h) / 4) as i32;
                while reach >= 1 {
                    let (sx, sy) = (cx + random.within(reach), cy + random.within(reach));
                    if sx >= 0 && sy >= 0 && sx < w as i32 && sy < h as i32 {
                        let s = sy as usize * w + sx as usize;
                        if self.usable(s, i) {
                            consider(s);
                        }
                    }
                    reach /= 3;
                }
                (cost[local], source[local], offset[local]) = (best.0, best.1 as u32, best.2);
            }
        });
    }

    /// Brings costs and constants up to date with the picture.
    pub(super) fn evaluate(&self, matches: &mut Matches) {
        let source = &matches.source;
        matches.cost.par_iter_mut().zip(matches.offset.par_iter_mut()).enumerate().for_each(|(i, (cost, offset))| {
            if source[i] != NONE
                && let Some(found) = self.compare(i, source[i] as usize, f32::INFINITY)
            {
                (*cost, *offset) = found;
            }
        });
    }

    /// New colours of the hole, each from the centre of its own match alone.
    pub(super) fn scatter(&self, matches: &Matches) -> Vec<Texel> {
        let mut pixels = self.canvas.pixels.clone();
        for (i, s) in matches.source.iter().enumerate() {
            if self.canvas.hole[i] && *s != NONE {
                let color = self.canvas.pixels[*s as usize];
                for c in 0..3 {
                    pixels[i][c] = color[c] + matches.offset[i][c];
                }
            }
        }
        pixels
    }

    /// New colours of the hole: the weighted mean of what the patches over each pixel say.
    pub(super) fn vote(&self, matches: &Matches, vote: Vote) -> Vec<Texel> {
        let (w, h) = (self.canvas.width, self.canvas.height);
        let mut costs: Vec<f32> =
            matches.source.iter().zip(&matches.cost).filter(|(s, _)| **s != NONE).map(|(_, c)| *c).collect();
        let scale = if costs.is_empty() {
            1.0
        } else {
            let k = (costs.len() * 3 / 4).min(costs.len() - 1);
            let (_, c, _) = costs.select_nth_unstable_by(k, f32::total_cmp);
            c.max(1.0)
        };
        let known: Vec<bool> = self.canvas.hole.iter().map(|b| !b).collect();
        let depth = distance_to(&known, w, h);
        // What a patch's word weighs: patches nearer to the known are surer.
        let weights: Vec<f32> = (matches.source.par_iter().zip(&matches.cost).zip(&depth))
            .map(|((source, cost), depth)| {
                let sure = (1.0 + 0.3 * depth.min(60.0)).recip();
                if *source == NONE { 0.0 } else { sure * (-2.0 * cost / scale).max(-30.0).exp() }
            })
            .collect();
        let radius = if vote == Vote::Sharp { 1 } else { RADIUS };
        (0..w * h)
            .into_par_iter()
            .map(|i| {
                if !self.canvas.hole[i] {
                    return self.canvas.pixels[i];
                }
                let (x, y) = ((i % w) as i32, (i / w) as i32);
                let mut sum = [0.0_f32; 4];
                let mut total = 0.0_f32;
                for dy in -radius..=radius {
                    for dx in -radius..=radius {
                        let (qx, qy) = (x - dx, y - dy);
                        if qx < 0 || qy < 0 || qx >= w as i32 || qy >= h as i32 {
                            continue;
                        }
                        let q = qy as usize * w + qx as usize;
                        let s = matches.source[q];
                        // A patch of another surface says nothing about this one.
                        if s == NONE || self.canvas.label[q] != self.canvas.label[i] {
                            continue;
                        }
                        let weight = weights[q];
                        let color = &self.canvas.pixels[(s as i32 + dy * w as i32 + dx) as usize];
                        for c in 0..3 {
                            sum[c] += weight * (color[c] + matches.offset[q][c]);
                        }
                        total += weight;
                    }
                }
                if total > 0.0 { sum.map(|s| (s / total).clamp(-255.0, 510.0)) } else { self.canvas.pixels[i] }
            })
            .collect()
    }
}

/// Whether any pixel of the patch around each pixel is set.
fn box_any(set: &[bool], width: usize, height: usize) -> Vec<bool> {
    let r = RADIUS as usize;
    let mut rows = vec![false; set.len()];
    for y in 0..height {
        for x in 0..width {
            let (a, b) = (x.saturating_sub(r), (x + r + 1).min(width));
            rows[y * width + x] = set[y * width + a..y * width + b].contains(&true);
        }
    }
    let mut out = vec![false; set.len()];
    for y in 0..height {
        let (a, b) = (y.saturating_sub(r), (y + r + 1).min(height));
        for x in 0..width {
            out[y * width + x] = (a..b).any(|k| rows[k * width + x]);
        }
    }
    out
}
