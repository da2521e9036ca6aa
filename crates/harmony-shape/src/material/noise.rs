//! Repeatable noise by hashing: periodic over a tile's torus, or free within a piece.

use super::space::Space;

/// SplitMix64's mixing of a counter (Steele, Lea, Flood, OOPSLA 2014).
const fn mixed(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A hash of a seed and two numbers.
pub(super) const fn hash(seed: u64, x: i64, y: i64) -> u64 {
    in_column(column(seed, x), y)
}

/// The first half of a hash, of a seed and its first number.
const fn column(seed: u64, x: i64) -> u64 {
    mixed(seed ^ (x as u64).wrapping_mul(0xd6e8_feb8_6659_fd93))
}

/// The second half of a hash, with its second number.
const fn in_column(column: u64, y: i64) -> u64 {
    mixed(column ^ (y as u64).wrapping_mul(0xa076_1d64_78bd_642f))
}

/// The whole number at or below a value: `f64::floor` is a call where the processor is not known to have it.
fn floor(x: f64) -> i64 {
    let whole = x as i64;
    whole - i64::from(whole as f64 > x)
}

/// A number in a period; divides only what is outside of it.
fn wrapped(i: i64, period: i64) -> i64 {
    if (0..period).contains(&i) { i } else { i.rem_euclid(period) }
}

/// Uniform in 0 to 1, drawn from a hash; `salt` gives independent draws.
pub(super) fn unit(hash: u64, salt: u64) -> f64 {
    (mixed(hash ^ salt.wrapping_mul(0x9e6c_63d0_76cc_4b69)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Nearly normal, variance 1, between -3 and 3.
pub(super) fn gauss(hash: u64, salt: u64) -> f64 {
    let s = unit(hash, salt * 3 + 101) + unit(hash, salt * 3 + 102) + unit(hash, salt * 3 + 103);
    (s - 1.5) * 2.0
}

/// Unit gradients every 22.5 degrees, the first shifted off the axes.
const GRADIENTS: [[f64; 2]; 16] = {
    const A: f64 = 0.980_785_280_403_230_4;
    const B: f64 = 0.195_090_322_016_128_27;
    const C: f64 = 0.831_469_612_302_545_2;
    const D: f64 = 0.555_570_233_019_602_2;
    [
        [A, B],
        [C, D],
        [D, C],
        [B, A],
        [-B, A],
        [-D, C],
        [-C, D],
        [-A, B],
        [-A, -B],
        [-C, -D],
        [-D, -C],
        [-B, -A],
        [B, -A],
        [D, -C],
        [C, -D],
        [A, -B],
    ]
};

/// Periods of free noise: longer than anything is.
const FREE: i64 = 1 << 20;

/// Gradient noise (Perlin, SIGGRAPH 1985 and 2002: quintic fade) on a lattice of whole cells.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    cells: [i64; 2],
    /// Cells a metre.
    per_m: [f64; 2],
    seed: u64,
}

impl Noise {
    /// Noise with the tile's period and cells of about the given size, metres.
    pub(super) fn periodic(space: &Space, scale: [f64; 2], salt: u64) -> Self {
        let count = |side: f64, s: f64| (side / s).round().max(1.0);
        let n = [count(space.w, scale[0]), count(space.h, scale[1])];
        Self {
            cells: [n[0] as i64, n[1] as i64],
            per_m: [n[0] / space.w, n[1] / space.h],
            seed: hash(space.seed, salt as i64, 7),
        }
    }

    /// Noise without a period that matters, for coordinates within a piece.
    pub(super) fn free(space: &Space, scale: [f64; 2], salt: u64) -> Self {
        Self { cells: [FREE; 2], per_m: [1.0 / scale[0], 1.0 / scale[1]], seed: hash(space.seed, salt as i64, 11) }
    }

    /// Value between about -1 and 1, mean 0.
    pub(super) fn at(&self, u: f64, v: f64) -> f64 {
        self.octave(u, v, 0)
    }

    fn octave(&self, u: f64, v: f64, octave: u32) -> f64 {
        let k = f64::from(1_u32 << octave);
        let cells = [self.cells[0] << octave, self.cells[1] << octave];
        let (x, y) = (u * self.per_m[0] * k, v * self.per_m[1] * k);
        let (x0, y0) = (floor(x), floor(y));
        let (fx, fy) = (x - x0 as f64, y - y0 as f64);
        let (i0, j0) = (wrapped(x0, cells[0]), wrapped(y0, cells[1]));
        let (i1, j1) = (wrapped(i0 + 1, cells[0]), wrapped(j0 + 1, cells[1]));
        let seed = self.seed.wrapping_add(u64::from(octave).wrapping_mul(0x51_7cc1));
        let (left, right) = (column(seed, i0), column(seed, i1));
        let dot = |column: u64, j: i64, dx: f64, dy: f64| {
            let g = GRADIENTS[(in_column(column, j) >> 60) as usize];
            g[0] * dx + g[1] * dy
        };
        let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
        let (sx, sy) = (fade(fx), fade(fy));
        let top = lerp(dot(left, j0, fx, fy), dot(right, j0, fx - 1.0, fy), sx);
        let bottom = lerp(dot(left, j1, fx, fy - 1.0), dot(right, j1, fx - 1.0, fy - 1.0), sx);
        lerp(top, bottom, sy) * 1.5
    }

    /// Sum of octaves, each at half the size and half the strength, scaled back to about -1 to 1.
    pub(super) fn fbm(&self, u: f64, v: f64, octaves: u32) -> f64 {
        let (mut sum, mut all, mut k) = (0.0, 0.0, 1.0);
        for o in 0..octaves {
            sum += k * self.octave(u, v, o);
            all += k * k;
            k *= 0.5;
        }
        sum / f64::sqrt(all)
    }

    /// Sum of octaves folded at zero: thin valleys, 0 in them and about 1 away from them.
    pub(super) fn ridged(&self, u: f64, v: f64, octaves: u32) -> f64 {
        let (mut sum, mut all, mut k) = (0.0, 0.0, 1.0);
        for o in 0..octaves {
            sum += k * self.octave(u, v, o).abs();
            all += k;
            k *= 0.5;
        }
        (sum / all * 2.0).min(1.0)
    }
}

/// The nearest points of a jittered lattice (Worley, SIGGRAPH 1996), periodic over the tile.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cells {
    count: [i64; 2],
    size: [f64; 2],
    jitter: f64,
    seed: u64,
}

/// Where a place lies among the points.
#[derive(Debug, Clone, Copy)]
pub(super) struct Near {
    /// Distance to the nearest point, cells.
    pub d1: f64,
    /// Distance to the second nearest, cells.
    pub d2: f64,
    /// From the nearest point to the place, cells.
    pub to: [f64; 2],
    /// Hash of the nearest point.
    pub id: u64,
}

impl Cells {
    /// Whole cells of about the given size, metres; `jitter` 0 (a lattice) to 1.
    pub(super) fn new(space: &Space, scale: [f64; 2], jitter: f64, salt: u64) -> Self {
        let n = [(space.w / scale[0]).round().max(1.0), (space.h / scale[1]).round().max(1.0)];
        Self {
            count: [n[0] as i64, n[1] as i64],
            size: [space.w / n[0], space.h / n[1]],
            jitter,
            seed: hash(space.seed, salt as i64, 13),
        }
    }

    fn place(&self, i: i64, j: i64) -> (f64, f64, u64) {
        let id = hash(self.seed, wrapped(i, self.count[0]), wrapped(j, self.count[1]));
        let at = |k: i64, salt: u64| k as f64 + 0.5 + (unit(id, salt) - 0.5) * self.jitter;
        (at(i, 1), at(j, 2), id)
    }

    /// The nearest two.
    pub(super) fn at(&self, u: f64, v: f64) -> Near {
        let (x, y) = (u / self.size[0], v / self.size[1]);
        let (i, j) = (floor(x), floor(y));
        let mut near = Near { d1: f64::INFINITY, d2: f64::INFINITY, to: [0.0; 2], id: 0 };
        for b in j - 1..=j + 1 {
            for a in i - 1..=i + 1 {
                let (px, py, id) = self.place(a, b);
                let (dx, dy) = (x - px, y - py);
                let d = dx * dx + dy * dy;
                if d < near.d1 {
                    near = Near { d1: d, d2: near.d1, to: [dx, dy], id };
                } else if d < near.d2 {
                    near.d2 = d;
                }
            }
        }
        Near { d1: near.d1.sqrt(), d2: near.d2.sqrt(), ..near }
    }

    /// Calls `f` with every point of the 3 x 3 cells around a place: offset to the place in metres, and hash.
    pub(super) fn around(&self, u: f64, v: f64, mut f: impl FnMut([f64; 2], u64)) {
        let (x, y) = (u / self.size[0], v / self.size[1]);
        let (i, j) = (floor(x), floor(y));
        for b in j - 1..=j + 1 {
            for a in i - 1..=i + 1 {
                let (px, py, id) = self.place(a, b);
                f([(x - px) * self.size[0], (y - py) * self.size[1]], id);
            }
        }
    }
}

/// Between `a` (t = 0) and `b` (t = 1).
pub(super) fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// Cubic step from 0 at `a` to 1 at `b`; also downwards.
pub(super) fn smooth(a: f64, b: f64, x: f64) -> f64 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn space() -> Space {
        Space { w: 0.9, h: 1.3, px: 0.002, seed: 5, slot: [0.5; 3] }
    }

    #[test]
    fn noise_has_the_period_of_the_tile_and_no_mean() {
        let s = space();
        let n = Noise::periodic(&s, [0.07, 0.02], 3);
        let c = Cells::new(&s, [0.05, 0.05], 1.0, 4);
        let mut sum = 0.0;
        for k in 0..4000 {
            let (u, v) = (unit(k, 1) * s.w, unit(k, 2) * s.h);
            for (a, b) in [(n.fbm(u, v, 3), n.fbm(u + s.w, v - s.h, 3)), (c.at(u, v).d1, c.at(u - s.w, v + s.h).d1)] {
                assert!((a - b).abs() <= 1e-9, "{a} {b}");
            }
            sum += n.at(u, v);
        }
        assert!((sum / 4000.0).abs() <= 0.05, "{}", sum / 4000.0);
    }

    #[test]
    fn draws_are_spread_evenly() {
        let mean = (0..10_000).map(|k| unit(hash(9, k, 0), 1)).sum::<f64>() / 1e4;
        let var = (0..10_000).map(|k| gauss(hash(9, k, 0), 1)).map(|g| g * g).sum::<f64>() / 1e4;
        assert!((mean - 0.5).abs() <= 0.02 && (var - 1.0).abs() <= 0.05, "{mean} {var}");
    }
}
