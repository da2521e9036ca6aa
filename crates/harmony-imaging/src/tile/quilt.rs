//! Quilting on a torus: a tileable picture from overlapping blocks of a sample.
//!
//! A. Efros, W. Freeman, "Image Quilting for Texture Synthesis and Transfer", SIGGRAPH 2001 (blocks chosen by their
//! overlap); V. Kwatra et al., "Graphcut Textures", SIGGRAPH 2003 (the seam as a minimum cut). The grid of blocks wraps
//! around, so the outer edges are seams like any other.

use crate::maxflow::{GridGraph, STEPS};
use crate::noise::Random;

use super::base::Color;

/// Blocks along a side to try, fewest first: large blocks keep more of the pattern.
const BLOCKS: [usize; 6] = [2, 3, 4, 6, 8, 12];
/// Positions looked at for each block.
const TRIES: usize = 240;
/// Places a block needs to be chosen from, for each block of the tile.
const MIN_CHOICE: usize = 6;

/// Capacity that no seam is worth.
const CERTAIN: i32 = 1 << 24;

/// A texture to take blocks from.
pub(super) struct Sample<'a> {
    pub width: usize,
    pub height: usize,
    pub colors: &'a [Color],
    pub observed: &'a [bool],
}

/// A `side` x `side` tile, or `None` when no block of a useful size is wholly observed.
pub(super) fn quilt(sample: &Sample<'_>, side: usize, seed: u64) -> Option<Vec<Color>> {
    let sums = integral(sample);
    for count in BLOCKS {
        let step = side.div_ceil(count);
        let overlap = (step / 4).max(2);
        let block = step + overlap;
        if step < 4 || block > side {
            continue;
        }
        let places = most_even(sample, whole_blocks(sample, &sums, block), block);
        if places.len() >= MIN_CHOICE * count * count {
            return Some(lay(sample, &places, (side, count, step, block), seed));
        }
    }
    None
}

/// Number of observed texels above and left of each corner.
fn integral(sample: &Sample<'_>) -> Vec<u32> {
    let w = sample.width + 1;
    let mut sums = vec![0_u32; w * (sample.height + 1)];
    for y in 0..sample.height {
        let mut row = 0;
        for x in 0..sample.width {
            row += u32::from(sample.observed[y * sample.width + x]);
            sums[(y + 1) * w + x + 1] = sums[y * w + x + 1] + row;
        }
    }
    sums
}

/// Top-left corners of all blocks without a hole.
fn whole_blocks(sample: &Sample<'_>, sums: &[u32], block: usize) -> Vec<(usize, usize)> {
    let w = sample.width + 1;
    let mut places = Vec::new();
    if block > sample.width || block > sample.height {
        return places;
    }
    // Some ten thousand places are choice enough.
    let stride = (sample.width * sample.height / 40_000).max(1).isqrt();
    for y in (0..=sample.height - block).step_by(stride) {
        for x in (0..=sample.width - block).step_by(stride) {
            let count = sums[(y + block) * w + x + block] + sums[y * w + x]
                - sums[y * w + x + block]
                - sums[(y + block) * w + x];
            if count as usize == block * block {
                places.push((x, y));
            }
        }
    }
    places
}

/// The half of the places whose quarters are most like all others in mean colour and in spread: a shadow at the edge of
/// what was observed, a stain or a highlight would show in every repetition of the tile.
fn most_even(sample: &Sample<'_>, places: Vec<(usize, usize)>, block: usize) -> Vec<(usize, usize)> {
    let half = block / 2;
    let step = (half / 6).max(1);
    let quarter = |x0: usize, y0: usize| {
        let inside = (0..half).step_by(step).flat_map(|y| (0..half).step_by(step).map(move |x| (x, y)));
        let (mut sum, mut squares, mut n) = ([0.0_f32; 3], 0.0_f32, 0.0_f32);
        for (x, y) in inside {
            let color = sample.colors[(y0 + y) * sample.width + x0 + x];
            for (s, c) in sum.iter_mut().zip(color) {
                *s += c;
            }
            squares += squared(color, [0.0; 3]);
            n += 1.0;
        }
        let mean = sum.map(|s| s / n.max(1.0));
        let spread = (squares / n.max(1.0) - squared(mean, [0.0; 3])).max(0.0).sqrt();
        [mean[0], mean[1], mean[2], spread]
    };
    let quarters: Vec<[[f32; 4]; 4]> = places
        .iter()
        .map(|&(x, y)| [quarter(x, y), quarter(x + half, y), quarter(x, y + half), quarter(x + half, y + half)])
        .collect();
    let middle: [f32; 4] = std::array::from_fn(|k| {
        let mut values: Vec<f32> = quarters.iter().flatten().map(|q| q[k]).collect();
        let at = values.len() / 2;
        if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(at, f32::total_cmp).1 }
    });
    let off = |q: &[f32; 4]| q.iter().zip(middle).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
    let mut ranked: Vec<(f32, (usize, usize))> =
        quarters.iter().map(|q| q.iter().map(off).fold(0.0, f32::max)).zip(places).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    ranked.truncate(ranked.len().div_ceil(2));
    ranked.into_iter().map(|r| r.1).collect()
}

fn squared(a: Color, b: Color) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

fn lay(
    sample: &Sample<'_>,
    places: &[(usize, usize)],
    (side, count, step, block): (usize, usize, usize, usize),
    seed: u64,
) -> Vec<Color> {
    let mut tile: Vec<Option<Color>> = vec![None; side * side];
    let mut random = Random::new(seed);
    let texel = |place: (usize, usize), x: usize, y: usize| sample.colors[(place.1 + y) * sample.width + place.0 + x];
    for row in 0..count {
        for column in 0..count {
            let on_tile = |x: usize, y: usize| (row * step + y) % side * side + (column * step + x) % side;
            let mut best = (f32::INFINITY, places[0]);
            for _ in 0..TRIES {
                let place = places[random.below(places.len())];
                let mut cost = 0.0;
                for y in (0..block).step_by(2) {
                    for x in (0..block).step_by(2) {
                        if let Some(old) = tile[on_tile(x, y)] {
                            cost += squared(old, texel(place, x, y));
                        }
                    }
                    if cost >= best.0 {
                        break;
                    }
                }
                if cost < best.0 {
                    best = (cost, place);
                }
            }
            let place = best.1;
            let new = |x: usize, y: usize| texel(place, x, y);
            let keep_new = seam(block, |x, y| tile[on_tile(x, y)].map(|old| (old, new(x, y))));
            for (i, takes) in keep_new.iter().enumerate() {
                if *takes {
                    tile[on_tile(i % block, i / block)] = Some(new(i % block, i / block));
                }
            }
        }
    }
    tile.into_iter().map(|c| c.unwrap_or([128.0; 3])).collect()
}

/// Which texels of a block are taken: all without an old colour, and of the others those on the new side of the
/// cheapest seam. The block's outer edge stays old where there is something old.
fn seam(block: usize, pair: impl Fn(usize, usize) -> Option<(Color, Color)>) -> Vec<bool> {
    let mismatch: Vec<Option<f32>> =
        (0..block * block).map(|i| pair(i % block, i / block).map(|(old, new)| squared(old, new).sqrt())).collect();
    let overlapped: Vec<bool> = mismatch.iter().map(Option::is_some).collect();
    let mut keep: Vec<bool> = overlapped.iter().map(|o| !o).collect();
    let mut graph = GridGraph::new(block, block, &overlapped);
    for node in 0..graph.pixels().len() {
        let i = graph.pixels()[node] as usize;
        let (x, y) = (i % block, i / block);
        if x == 0 || y == 0 || x + 1 == block || y + 1 == block {
            graph.pull(node, -CERTAIN);
        }
        for (d, (dx, dy)) in STEPS.iter().enumerate().take(4) {
            let (nx, ny) = (x as i32 + dx, y as i32 + dy);
            if nx < 0 || ny < 0 || nx >= block as i32 || ny >= block as i32 {
                continue;
            }
            let j = ny as usize * block + nx as usize;
            match mismatch[j] {
                Some(other) => graph.connect(node, d, ((mismatch[i].unwrap_or(0.0) + other) * 16.0) as i32 + 1),
                None => graph.pull(node, CERTAIN),
            }
        }
    }
    let nodes = graph.pixels().to_vec();
    for (i, new) in nodes.into_iter().zip(graph.solve()) {
        keep[i as usize] = new;
    }
    keep
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rough_patch_is_not_taken_for_what_is_usual() {
        // A third of the carpet is brushed up, in the colour of the whole; the rest is a little lighter or darker.
        let rough = |x: usize| (80..160).contains(&x);
        let tone = |x: usize, y: usize| {
            let up = if (x + y).is_multiple_of(2) { 1.0 } else { -1.0 };
            let side = if x < 80 { -1.0 } else { 1.0 };
            if rough(x) { 130.0 + 40.0 * up } else { 130.0 + side + 10.0 * up }
        };
        let colors: Vec<Color> = (0..240 * 60).map(|i| [tone(i % 240, i / 240); 3]).collect();
        let sample = Sample { width: 240, height: 60, colors: &colors, observed: &vec![true; colors.len()] };
        let places: Vec<(usize, usize)> = (0..220).flat_map(|x| (0..40).map(move |y| (x, y))).collect();
        let even = most_even(&sample, places, 20);
        assert!(even.len() > 4000 && even.iter().all(|(x, _)| !rough(*x) && !rough(x + 19)));
    }
}
