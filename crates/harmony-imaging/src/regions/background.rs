//! What colour a bare room surface has.

use super::UNKNOWN_SURFACE;
use crate::color::{distance_squared, farthest_points, nearest};

/// Weight of a difference of lightness: light falls off over a surface, hue stays.
const LIGHTNESS: f32 = 0.4;
/// Clusters a surface's colours are put in.
const CLUSTERS: usize = 6;
/// A cluster of this share of its surface's (weighted) pixels counts as bare surface.
const BARE_SHARE: f32 = 0.2;
/// Weight of a pixel in the lower half of a wall, against 1 above: furniture stands below.
const LOWER_WALL: f32 = 0.15;

/// Bare colours of every surface, lightness scaled.
pub(super) struct Background {
    colors: Vec<Vec<[f32; 3]>>,
}

fn scaled(lab: [f32; 3]) -> [f32; 3] {
    [lab[0] * LIGHTNESS, lab[1], lab[2]]
}

impl Background {
    /// Looks at the largest clusters of each surface's pixels; on walls (labels 2 to 5) mostly at the upper ones.
    pub(super) fn of(lab: &[[f32; 3]], surfaces: &[u8], width: usize) -> Self {
        let mut colors = vec![Vec::new(); 256];
        for surface in 0..=u8::MAX {
            let is_wall = (2..=5).contains(&surface);
            let row = |i: usize| i / width.max(1);
            let first = surfaces.iter().position(|s| *s == surface).map_or(0, row);
            let last = surfaces.iter().rposition(|s| *s == surface).map_or(0, row);
            let members: Vec<(f32, [f32; 3])> = surfaces
                .iter()
                .zip(lab)
                .enumerate()
                .filter(|(_, (s, _))| **s == surface)
                .map(|(i, (_, lab))| {
                    let lower = is_wall && row(i) > usize::midpoint(first, last);
                    (if lower { LOWER_WALL } else { 1.0 }, scaled(*lab))
                })
                .collect();
            if members.len() < 20 {
                continue;
            }
            colors[surface as usize] = bare_colors(&members);
        }
        Self { colors }
    }

    /// Distance of a colour to the nearest bare colour of the surface; 0 when nothing is known of it.
    pub(super) fn distance(&self, surface: u8, lab: [f32; 3]) -> f32 {
        let own = &self.colors[surface as usize];
        let known = if own.is_empty() { &self.colors[UNKNOWN_SURFACE as usize] } else { own };
        let least = known.iter().map(|c| distance_squared(*c, scaled(lab))).fold(f32::INFINITY, f32::min);
        if least.is_finite() { least.sqrt() } else { 0.0 }
    }
}

fn bare_colors(members: &[(f32, [f32; 3])]) -> Vec<[f32; 3]> {
    let step = members.len().div_ceil(4000);
    let samples: Vec<(f32, [f32; 3])> = members.iter().copied().step_by(step).collect();
    let labs: Vec<[f32; 3]> = samples.iter().map(|s| s.1).collect();
    let mut centres = farthest_points(&labs, CLUSTERS);
    let mut weight = vec![0.0_f32; centres.len()];
    for _ in 0..10 {
        let mut sums = vec![[0.0_f32; 3]; centres.len()];
        weight.fill(0.0);
        for (w, lab) in &samples {
            let k = nearest(&centres, *lab);
            weight[k] += w;
            for (s, c) in sums[k].iter_mut().zip(lab) {
                *s += w * c;
            }
        }
        for ((centre, sum), w) in centres.iter_mut().zip(&sums).zip(&weight) {
            if *w > 0.0 {
                *centre = sum.map(|s| s / w);
            }
        }
    }
    let total: f32 = weight.iter().sum();
    let most = weight.iter().copied().fold(0.0, f32::max);
    centres.iter().zip(&weight).filter(|(_, w)| **w >= most || **w > BARE_SHARE * total).map(|(c, _)| *c).collect()
}
