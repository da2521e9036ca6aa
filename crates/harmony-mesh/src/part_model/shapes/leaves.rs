//! Foliage: many small closed blades, placed by a seeded generator.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DVec3;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::part_model::solid::SolidBuilder;
use crate::part_model::{LeafHabit, Part};

/// Most leaves of a part.
const MAX_LEAVES: u32 = 300;

/// Width of what collides, as a share of the foliage's.
const CORE: f64 = 0.65;

/// One blade: a bent, pointed leaf.
struct Blade {
    base: DVec3,
    /// Unit, from base to tip at the base.
    along: DVec3,
    /// Unit, the upper side at the base.
    up: DVec3,
    length: f64,
    width: f64,
    /// Angle by which the tip droops, radians.
    droop: f64,
    /// Where it is widest, 0 base to 1 tip.
    widest: f64,
    segments: usize,
}

pub(super) fn leaves(b: &mut SolidBuilder, half: DVec3, part: &Part) {
    let habit = part.habit.unwrap_or_default();
    let mut random = ChaCha8Rng::seed_from_u64(u64::from(part.seed.unwrap_or(1)));
    let usual = match habit {
        LeafHabit::Bushy => 110,
        LeafHabit::Palm => 11,
        LeafHabit::Upright => 12,
        LeafHabit::Trailing => 60,
        LeafHabit::Flowers => 9,
    };
    let count = part.count.unwrap_or(usual).clamp(1, MAX_LEAVES);
    let smallest = 2.0 * half.min_element();
    let share = part.leaf_size.map(|s| s.clamp(0.02, 2.0));
    let blades = match habit {
        LeafHabit::Bushy => bushy(half, count, share.unwrap_or(0.3) * smallest, &mut random),
        LeafHabit::Palm => palm(half, count.min(24), share.unwrap_or(0.35) * smallest, &mut random),
        LeafHabit::Upright => upright(half, count, share.unwrap_or(0.14) * smallest, &mut random),
        LeafHabit::Trailing => trailing(half, count, share.unwrap_or(0.22) * smallest, &mut random),
        LeafHabit::Flowers => flowers(half, count.min(40), share.unwrap_or(0.3) * smallest, &mut random),
    };
    for blade in &blades {
        add_blade(b, blade);
    }
    b.map_points(|lo, hi, p| {
        let (c, h) = ((lo + hi) / 2.0, (hi - lo) / 2.0);
        (p - c) * half / h.max(DVec3::splat(1e-9))
    });
    // leaves give way: the solid core of the foliage is narrower
    let core = b.points().iter().map(|p| *p * DVec3::new(CORE, 1.0, CORE)).collect();
    b.piece(core);
}

/// Unit vector towards (azimuth about +Y from +Z, elevation).
fn heading(azimuth: f64, elevation: f64) -> DVec3 {
    DVec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos())
}

/// The upper side of a leaf that points along `along`.
fn upper(along: DVec3, random: &mut ChaCha8Rng) -> DVec3 {
    let wild = DVec3::new(random.random_range(-0.5..0.5), 1.0, random.random_range(-0.5..0.5));
    (wild - along * wild.dot(along)).try_normalize().unwrap_or_else(|| along.any_orthonormal_vector())
}

/// Leaves spread evenly over and inside an ellipsoid (golden angle), pointing out and a little down.
fn bushy(half: DVec3, count: u32, length: f64, random: &mut ChaCha8Rng) -> Vec<Blade> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    (0..count)
        .map(|k| {
            let y = 1.0 - 2.0 * (f64::from(k) + 0.5) / f64::from(count);
            let azimuth = golden * f64::from(k) + random.random_range(-0.3..0.3);
            let out = heading(azimuth, y.clamp(-1.0, 1.0).asin());
            let depth = random.random_range(0.35_f64..1.0).sqrt();
            let inside = (half - DVec3::splat(length * 0.55)).max(half * 0.25);
            let base = out * inside * depth - out * length * 0.15;
            let along = (out + DVec3::new(0.0, random.random_range(-0.15..0.45), 0.0)).normalize_or(out);
            let length = length * random.random_range(0.75..1.2);
            Blade {
                base,
                along,
                up: upper(along, random),
                length,
                width: length * random.random_range(0.5..0.68),
                droop: random.random_range(0.3..0.9),
                widest: 0.45,
                segments: 3,
            }
        })
        .collect()
}

/// Arching fronds with leaflets on both sides.
fn palm(half: DVec3, count: u32, leaflet: f64, random: &mut ChaCha8Rng) -> Vec<Blade> {
    let mut out = Vec::new();
    let reach = half.x.min(half.z);
    let per_side = 9;
    for k in 0..count {
        let azimuth = TAU * f64::from(k) * 0.618 + random.random_range(-0.2..0.2);
        let inner = f64::from(k) / f64::from(count.max(1));
        let spread = reach * (0.45 + 0.55 * inner) * random.random_range(0.85..1.0);
        let rise = half.y * 2.0 * (1.0 - 0.35 * inner) * random.random_range(0.85..1.0);
        let fall = rise * (0.15 + 0.35 * inner);
        let flat = heading(azimuth, 0.0);
        let at = |t: f64| {
            let y = rise * (FRAC_PI_2 * (t * 1.15).min(1.0)).sin() - fall * (t - 0.55).max(0.0).powi(2) / 0.2;
            DVec3::new(0.0, -half.y, 0.0) + flat * spread * t.powf(1.4) + DVec3::Y * y
        };
        let side = flat.cross(DVec3::Y);
        // the stalk: slender blades end to end
        let steps = 5;
        for s in 0..steps {
            let (p, q) = (at(f64::from(s) / f64::from(steps)), at(f64::from(s + 1) / f64::from(steps)));
            let along = (q - p).normalize_or(DVec3::Y);
            out.push(Blade {
                base: p,
                along,
                up: side.cross(along).normalize_or(DVec3::Y),
                length: p.distance(q) * 1.15,
                width: leaflet * 0.07,
                droop: 0.05,
                widest: 0.4,
                segments: 2,
            });
        }
        for n in 0..per_side {
            let t = 0.28 + 0.72 * (f64::from(n) + 0.5) / f64::from(per_side);
            let base = at(t);
            let tangent = (at(t + 0.02) - at(t - 0.02)).normalize_or(DVec3::Y);
            let taper = 1.0 - 0.55 * ((t - 0.5) / 0.5).max(0.0).powi(2);
            for sign in [-1.0, 1.0] {
                let along = (side * sign * 0.8 + tangent * 0.75 - DVec3::Y * 0.12).normalize_or(side);
                let up = (DVec3::Y - along * along.y).normalize_or(side);
                out.push(Blade {
                    base,
                    along,
                    up,
                    length: leaflet * taper * random.random_range(0.85..1.1),
                    width: leaflet * 0.2,
                    droop: 0.7,
                    widest: 0.35,
                    segments: 2,
                });
            }
        }
    }
    out
}

/// Sword leaves that stand up from the middle.
fn upright(half: DVec3, count: u32, width: f64, random: &mut ChaCha8Rng) -> Vec<Blade> {
    (0..count)
        .map(|k| {
            let azimuth = TAU * f64::from(k) * 0.618 + random.random_range(-0.3..0.3);
            let ring = (f64::from(k) / f64::from(count)).sqrt();
            let flat = heading(azimuth, 0.0);
            let lean = 0.05 + 0.4 * ring * random.random_range(0.6..1.1);
            let along = (DVec3::Y + flat * lean).normalize_or(DVec3::Y);
            let base = DVec3::new(0.0, -half.y, 0.0) + flat * half * DVec3::new(0.35, 0.0, 0.35) * ring;
            let up = (flat - along * flat.dot(along)).normalize_or(DVec3::Z);
            Blade {
                base,
                along,
                up: -up,
                length: 2.0 * half.y * (1.0 - 0.45 * ring) * random.random_range(0.85..1.0),
                width: width * random.random_range(0.85..1.15),
                droop: random.random_range(0.05..0.35),
                widest: 0.35,
                segments: 5,
            }
        })
        .collect()
}

/// Strands that fall over the edge, with a crown on top.
fn trailing(half: DVec3, count: u32, length: f64, random: &mut ChaCha8Rng) -> Vec<Blade> {
    (0..count)
        .map(|k| {
            let strand = k % 9;
            let azimuth = TAU * f64::from(strand) / 9.0 + random.random_range(-0.25..0.25);
            let t = f64::from(k / 9) / f64::from((count / 9).max(1));
            let flat = heading(azimuth, 0.0);
            let ring = 0.25 + 0.6 * (t * 2.5).min(1.0);
            let far = 0.5 + 0.5 * (f64::from(strand) * 2.4).sin().abs();
            let y = half.y * (0.75 - 1.6 * t * far);
            let base = flat * half * ring * DVec3::new(1.0, 0.0, 1.0) + DVec3::Y * y;
            let along = (flat * (1.0 - 0.6 * t) + DVec3::Y * (0.5 - 1.6 * t)).normalize_or(flat);
            let up = (flat + DVec3::Y * 0.6 - along * (flat + DVec3::Y * 0.6).dot(along)).normalize_or(DVec3::Y);
            Blade {
                base,
                along,
                up,
                length: length * random.random_range(0.8..1.2),
                width: length * 0.75,
                droop: 0.6,
                widest: 0.3,
                segments: 3,
            }
        })
        .collect()
}

/// Blossoms over the upper half, five petals each.
fn flowers(half: DVec3, count: u32, size: f64, random: &mut ChaCha8Rng) -> Vec<Blade> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    let mut out = Vec::new();
    for k in 0..count {
        let y = 1.0 - (f64::from(k) + 0.5) / f64::from(count) * 1.1;
        let facing = heading(golden * f64::from(k) + random.random_range(-0.2..0.2), y.clamp(-1.0, 1.0).asin());
        let inside = (half - DVec3::splat(size * 0.5)).max(half * 0.3);
        let centre = facing * inside * random.random_range(0.85..1.0);
        let facing = (facing + DVec3::Y * 0.5).normalize_or(DVec3::Y);
        let (u, v) = facing.any_orthonormal_pair();
        for ring in 0..2 {
            for petal in 0..5 {
                let a = TAU * (f64::from(petal) + 0.5 * f64::from(ring)) / 5.0;
                let lift = 0.35 + 0.8 * f64::from(ring);
                let along = (u * a.cos() + v * a.sin() + facing * lift).normalize_or(facing);
                let up = (facing - along * facing.dot(along)).normalize_or(u);
                out.push(Blade {
                    base: centre,
                    along,
                    up,
                    length: size * (0.55 - 0.15 * f64::from(ring)),
                    width: size * 0.42,
                    droop: 0.3,
                    widest: 0.65,
                    segments: 2,
                });
            }
        }
    }
    out
}

/// A blade as a closed body: an upper and a lower skin that share their rim, with a crease along the middle.
fn add_blade(b: &mut SolidBuilder, blade: &Blade) {
    let side = blade.along.cross(blade.up).normalize_or(DVec3::X);
    let n = blade.segments;
    let thickness = (blade.width * 0.03).max(2e-5);
    // the middle line bends down by `droop` towards the tip
    let mut spine = vec![(blade.base, blade.up)];
    for k in 0..n {
        let angle = blade.droop * (k as f64 + 0.5) / n as f64;
        let along = blade.along * angle.cos() - blade.up * angle.sin();
        let up = blade.up * angle.cos() + blade.along * angle.sin();
        let (p, _) = spine[k];
        spine.push((p + along * blade.length / n as f64, up));
    }
    let half_width = |k: usize| {
        let t = k as f64 / n as f64;
        let s = if t < blade.widest { t / blade.widest } else { (1.0 - t) / (1.0 - blade.widest) };
        if k == n { 0.0 } else { blade.width / 2.0 * (0.12 + 0.88 * (s * FRAC_PI_2).sin()) }
    };
    let at = |k: usize, across: usize, skin: f64| {
        let (p, up) = spine[k];
        let w = half_width(k);
        match across {
            0 => p + side * w + up * w * 0.3,
            2 => p - side * w + up * w * 0.3,
            _ if k == n => p,
            _ => p + up * (skin * thickness),
        }
    };
    let upper = b.group();
    b.patch(upper, n, 2, |k, across| at(k, across, 1.0));
    let lower = b.group();
    b.patch(lower, 2, n, |across, k| at(k, across, -1.0));
    // the open end at the stalk
    let end = b.group();
    b.patch(end, 1, 2, |k, across| at(0, across, if k == 0 { -1.0 } else { 1.0 }));
}
