//! A tile laid without a visible repeat.
//!
//! E. Heitz, F. Neyret, "High-Performance By-Example Noise using a Histogram-Preserving Blending Operator", HPG 2018: a
//! place is a blend of three pieces of the tile, each taken from anywhere in it, on a grid of triangles; the blend is
//! stretched so that the spread stays what it was. That holds for what looks like noise. Of lines, joints and knots
//! three would show at once, faintly: a tile with such is repeated as it is.

use crate::noise::hash;

use super::base::Color;

/// Sides of the triangles in a tile's side.
const TRIANGLES: f32 = 3.0;
/// Fourth moment over the squared second from which a tile has lines or blots: 3 is a normal distribution's.
const MAX_PEAKED: f32 = 8.0;
/// Correlation of places far from each other from which a tile has stripes or a repeat.
const MAX_ALIKE: f32 = 0.4;
/// Distances at which that is looked for, as parts of the side.
const FAR: [usize; 3] = [4, 3, 2];

/// Whether a tile of ratios around 1 looks like noise.
pub(super) fn is_noise(ratios: &[Color], side: usize) -> bool {
    let off: Vec<f32> = ratios.iter().map(|c| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2] - 1.0).collect();
    let mean = |f: &dyn Fn(usize) -> f32| (0..off.len()).map(f).sum::<f32>() / off.len().max(1) as f32;
    let second = mean(&|i| off[i].powi(2));
    if second <= 0.0 || mean(&|i| off[i].powi(4)) > MAX_PEAKED * second * second {
        return false;
    }
    let alike = |dx: usize, dy: usize| {
        mean(&|i| off[i] * off[(i / side + dy) % side * side + (i % side + dx) % side]).abs() / second
    };
    FAR.iter()
        .map(|part| side / part)
        .all(|d| [(d, 0), (0, d), (d, d), (d, side - d)].iter().all(|(dx, dy)| alike(*dx, *dy) < MAX_ALIKE))
}

/// The ratio at a place of a surface that the tile goes over.
pub(super) fn at(ratios: &[Color], side: usize, x: u32, y: u32) -> Color {
    let edge = side as f32 / TRIANGLES;
    let (u, v) = (x as f32 / edge, y as f32 / edge);
    // Sheared, so that the halves of squares are equilateral triangles.
    let (s, t) = (u - v / 3.0_f32.sqrt(), v * 2.0 / 3.0_f32.sqrt());
    let (i, j) = (s.floor(), t.floor());
    let (a, b) = (s - i, t - j);
    let corners = if a + b < 1.0 {
        [(0.0, 0.0, 1.0 - a - b), (1.0, 0.0, a), (0.0, 1.0, b)]
    } else {
        [(1.0, 1.0, a + b - 1.0), (1.0, 0.0, 1.0 - b), (0.0, 1.0, 1.0 - a)]
    };
    let (mut sum, mut squares) = ([0.0_f32; 3], 0.0_f32);
    for (di, dj, weight) in corners {
        let key = hash((((i + di) as i64 as u64) << 32) ^ ((j + dj) as i64 as u64 & 0xffff_ffff));
        let (column, row) = ((x as usize + key as u32 as usize) % side, (y as usize + (key >> 32) as usize) % side);
        for (s, r) in sum.iter_mut().zip(ratios[row * side + column]) {
            *s += weight * (r - 1.0);
        }
        squares += weight * weight;
    }
    sum.map(|s| 1.0 + s / squares.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::Random;

    const SIDE: usize = 48;

    /// A tile of soft noise with something in it.
    fn tile(with: impl Fn(usize, usize) -> f32) -> Vec<Color> {
        let mut random = Random::new(3);
        let mut sum = || (0..4).map(|_| random.unit()).sum::<f32>() / 4.0 - 0.5;
        (0..SIDE * SIDE).map(|i| [1.0 + 0.4 * sum() + with(i % SIDE, i / SIDE); 3]).collect()
    }

    #[test]
    fn what_is_laid_does_not_repeat_and_is_as_rough() {
        let tile = tile(|_, _| 0.0);
        assert!(is_noise(&tile, SIDE));
        let laid: Vec<f32> = (0..480_u32 * 480).map(|i| at(&tile, SIDE, i % 480, i / 480)[1] - 1.0).collect();
        let power = |f: &dyn Fn(usize) -> f32| (SIDE * 480..480 * 480).map(|i| f(i).powi(2)).sum::<f32>() / 207_360.0;
        let own = tile.iter().map(|c| (c[1] - 1.0).powi(2)).sum::<f32>() / (SIDE * SIDE) as f32;
        let all = power(&|i| laid[i]);
        assert!((all / own - 1.0).abs() < 0.1, "{all} against {own}");
        // A tile further nothing is the same: the difference is as large as that of two strangers.
        let apart = power(&|i| laid[i] - laid[i - SIDE * 480]);
        assert!(apart > 1.6 * own, "{apart} against {own}");
    }

    #[test]
    fn joints_and_stripes_are_no_noise() {
        assert!(!is_noise(&tile(|x, y| if x == 7 && y < 40 { -0.6 } else { 0.0 }), SIDE));
        assert!(!is_noise(&tile(|x, _| if x % 12 < 6 { -0.2 } else { 0.2 }), SIDE));
    }
}
