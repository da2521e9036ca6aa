//! Random numbers and smooth noise, the same bits on every platform.

use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Random numbers of one purpose: the seed of the call and a salt that names the purpose.
#[derive(Debug)]
pub(super) struct Dice(ChaCha8Rng);

impl Dice {
    /// A fresh sequence.
    pub fn new(seed: u32, salt: u32) -> Self {
        Self(ChaCha8Rng::seed_from_u64(u64::from(seed) << 32 | u64::from(salt)))
    }

    /// 0 to 1, evenly.
    pub fn unit(&mut self) -> f64 {
        self.0.random::<f64>()
    }

    /// `a` to `b`, evenly.
    pub fn range(&mut self, a: f64, b: f64) -> f64 {
        a + (b - a) * self.unit()
    }

    /// -1 to 1, values near 0 more often (the sum of three even ones).
    pub fn bell(&mut self) -> f64 {
        (self.unit() + self.unit() + self.unit()) * (2.0 / 3.0) - 1.0
    }
}

/// A well-mixed number of a lattice point (finaliser of MurmurHash3 over the three coordinates and the seed).
pub(super) fn hash(x: i64, y: i64, z: i64, seed: u32) -> u32 {
    let mut h = seed.wrapping_mul(0x9e37_79b9) ^ 0x85eb_ca6b;
    for v in [x, y, z] {
        h ^= v as u32;
        h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
        h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
        h ^= h >> 16;
    }
    h
}

/// Gradient noise (Perlin 2002) of lattice pitch 1: about -1 to 1, zero on average.
pub(super) fn noise3(p: DVec3, seed: u32) -> f64 {
    let cell = p.floor();
    let f = p - cell;
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v, w) = (fade(f.x), fade(f.y), fade(f.z));
    let (x, y, z) = (cell.x as i64, cell.y as i64, cell.z as i64);
    let corner = |i: i64, j: i64, k: i64| {
        let d = f - DVec3::new(i as f64, j as f64, k as f64);
        match hash(x + i, y + j, z + k, seed) % 12 {
            0 => d.x + d.y,
            1 => d.x - d.y,
            2 => d.y - d.x,
            3 => -d.x - d.y,
            4 => d.x + d.z,
            5 => d.x - d.z,
            6 => d.z - d.x,
            7 => -d.x - d.z,
            8 => d.y + d.z,
            9 => d.y - d.z,
            10 => d.z - d.y,
            _ => -d.y - d.z,
        }
    };
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let plane = |k: i64| mix(mix(corner(0, 0, k), corner(1, 0, k), u), mix(corner(0, 1, k), corner(1, 1, k), u), v);
    mix(plane(0), plane(1), w)
}

/// [`noise3`] of a plane.
pub(super) fn noise2(x: f64, y: f64, seed: u32) -> f64 {
    noise3(DVec3::new(x, y, 0.37), seed)
}

/// [`noise3`] of a line.
pub(super) fn noise1(x: f64, seed: u32) -> f64 {
    noise3(DVec3::new(x, 0.41, 0.37), seed)
}

/// 0 below `a`, 1 above `b`, smooth between.
pub(super) fn smoothstep(a: f64, b: f64, x: f64) -> f64 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_zero_on_the_lattice_bounded_and_continuous() {
        assert_eq!(noise3(DVec3::new(3.0, -2.0, 5.0), 7), 0.0);
        let mut previous = noise2(0.0, 0.2, 3);
        for i in 1..2000 {
            let v = noise2(f64::from(i) * 0.01, 0.2, 3);
            assert!(v.abs() <= 1.2 && (v - previous).abs() < 0.06, "{i}: {v} after {previous}");
            previous = v;
        }
    }

    #[test]
    fn seeds_differ_and_repeat() {
        let take = |seed| (0..4).map(|_| Dice::new(seed, 1).unit()).collect::<Vec<_>>();
        assert_eq!(take(5), take(5));
        assert_ne!(take(5), take(6));
        let mut dice = Dice::new(1, 2);
        let mean = (0..4000).map(|_| dice.bell()).sum::<f64>() / 4000.0;
        assert!(mean.abs() < 0.03, "{mean}");
    }
}
