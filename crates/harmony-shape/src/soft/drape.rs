//! A cloth that falls over what lies below it.

use glam::{DVec2, DVec3, Vec3};

use super::Cloth;
use super::cloth::{Sim, Stuff};
use super::collider::Collider;
use super::noise::{noise2, smoothstep};
use super::sheet::Middle;
use crate::Piece;

/// Most particles of a cloth.
const MAX_PARTICLES: f64 = 8000.0;
/// Smallest distance of particles, metres.
const MIN_CELL: f64 = 0.016;

/// Arguments of [`drape`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrapeSpec {
    /// Width (x) and length (z) of the flat cloth.
    pub size: [f64; 2],
    /// Middle of the cloth in x and z.
    pub at: [f64; 2],
    /// Turn about y, degrees, counter-clockwise seen from above.
    pub turn_deg: f64,
    /// 0 smooth to 1 rumpled.
    pub rumple: f64,
    /// Thickness.
    pub thick: f64,
    /// Length of the head end (-z before the turn) that is folded back over the rest, 0: none.
    pub fold: f64,
    /// 0 limp to 1 stiff.
    pub stiff: f64,
    /// Seed.
    pub seed: u32,
}

/// Lets a cloth fall over pieces and the floor at `y = 0`, in the pieces' coordinates.
///
/// `below` is everything it may meet, earlier cloths with them.
///
/// # Errors
/// When the cloth has no area or no finite place, with what would do.
pub fn drape(spec: &DrapeSpec, below: &[&Piece]) -> Result<Cloth, String> {
    let [width, length] = spec.size;
    let numbers =
        [width, length, spec.at[0], spec.at[1], spec.turn_deg, spec.rumple, spec.thick, spec.fold, spec.stiff];
    if numbers.iter().any(|v| !v.is_finite()) {
        return Err("a cloth needs finite numbers".to_owned());
    }
    if !(0.05..=20.0).contains(&width) || !(0.05..=20.0).contains(&length) {
        return Err(format!("a cloth of {width} x {length} m; 0.05 to 20 m a side would do"));
    }
    let thick = spec.thick.clamp(0.001, 0.08);
    let (start, cell) = laid(spec, thick);
    let nu = start.nu;
    let (lo, hi) = start.points.iter().fold(([f64::MAX; 2], [f64::MIN; 2]), |(lo, hi), p| {
        ([lo[0].min(p.x), lo[1].min(p.z)], [hi[0].max(p.x), hi[1].max(p.z)])
    });
    let collider = Collider::new(below, [lo[0] - 0.12, lo[1] - 0.12], [hi[0] + 0.12, hi[1] + 0.12]);
    let stuff = stuff(spec, thick, cell);
    let above = collider.top + f64::from(stuff.offset) + 0.008;
    let places: Vec<Vec3> = start.points.iter().map(|p| (*p + DVec3::Y * above).as_vec3()).collect();
    let mut sim = Sim::new(&places, nu, [cell[0] as f32, cell[1] as f32], stuff);
    // A second and a half, and the time to fall.
    let fall = (2.0 * collider.top / 9.81).sqrt();
    sim.settle(&collider, 90 + (fall * 40.0) as usize);

    let points = sim.positions().iter().map(|p| p.as_dvec3()).collect();
    let mut middle = Middle { points, ..start };
    middle.smooth(2);
    let mut fine = middle.divided();
    let least = (f64::from(stuff.offset) * 0.85) as f32;
    for p in &mut fine.points {
        let (distance, gradient) = collider.sample(p.as_vec3());
        if distance < least {
            *p += (gradient.normalize_or(Vec3::Y) * (least - distance).min(0.02)).as_dvec3();
        }
        p.y = p.y.max(f64::from(least));
    }
    let hems = fine.hems();
    let (flat, wide) = (fine.flat.clone(), fine.nu);
    let piece = fine.thickened(|i, j| half_thickness(flat[j * wide + i], spec, thick));
    Ok(Cloth { piece, hems, fittings: Piece::default() })
}

/// Half the thickness at a flat place: a rolled hem on a thin cloth, a thin seam and soft puffs on a padded one.
fn half_thickness(flat: DVec2, spec: &DrapeSpec, thick: f64) -> f64 {
    let [w, l] = spec.size;
    let inside = flat.x.min(w - flat.x).min(flat.y).min(l - flat.y).max(0.0);
    if thick < 0.015 {
        let roll = (0.002 - thick / 2.0).max(0.0);
        return thick / 2.0 + roll * (1.0 - smoothstep(0.0, 0.012, inside));
    }
    let seam = 0.004_f64.min(thick / 4.0);
    let t = 1.0 - (inside / (2.0 * thick)).min(1.0);
    let (x, y, seed) = (flat.x, flat.y, spec.seed.wrapping_add(77));
    let puff = 1.0 + 0.28 * noise2(x / 0.17, y / 0.17, seed) + 0.12 * noise2(x / 0.07, y / 0.07, seed);
    seam + (thick / 2.0 * puff - seam) * (1.0 - t * t).max(0.0).sqrt()
}

fn stuff(spec: &DrapeSpec, thick: f64, cell: [f64; 2]) -> Stuff {
    let stiff = spec.stiff.clamp(0.0, 1.0);
    let smaller = cell[0].min(cell[1]);
    // Limp cotton 2e-4 to felt 2e-6; what is thick is stiffer by itself.
    let bend = 2e-4 * libm::pow(10.0, -2.0 * stiff) / (1.0 + thick / 0.01);
    let padding = if thick >= 0.015 {
        ((0.1 / smaller).round().max(3.0) as usize, 1.5e-4 / (1.0 + 4.0 * stiff))
    } else if stiff > 0.5 {
        (4, 2e-4 * (1.1 - stiff))
    } else {
        (0, 0.0)
    };
    Stuff {
        shear: (4e-6 / (1.0 + 3.0 * stiff)) as f32,
        bend: bend as f32,
        padding: (padding.0, padding.1 as f32),
        offset: (thick / 2.0 + 0.004) as f32,
        apart: thick.max(0.6 * smaller).min(2.5 * smaller) as f32,
        crease: crease_rows(spec, thick, cell[1]),
    }
}

/// Length of the head end that is folded back, and the radius of the fold.
fn folding(spec: &DrapeSpec, thick: f64, pitch: f64) -> (f64, f64) {
    (spec.fold.clamp(0.0, spec.size[1] * 0.8), (0.75 * thick + 0.006).max(0.4 * pitch))
}

/// Rows of the grid within the fold.
fn crease_rows(spec: &DrapeSpec, thick: f64, pitch: f64) -> Option<(usize, usize)> {
    let (fold, radius) = folding(spec, thick, pitch);
    let first = (fold - std::f64::consts::PI * radius).max(0.0);
    (fold > 0.0).then(|| ((first / pitch) as usize, (fold / pitch).ceil() as usize + 1))
}

/// The cloth as it is laid down, heights above the top of what is below; the pitch of its grid.
///
/// A rumpled cloth is laid too small and uneven: what is too long for its place bunches into folds, as it does when
/// someone throws a cover over a bed.
fn laid(spec: &DrapeSpec, thick: f64) -> (Middle, [f64; 2]) {
    let [width, length] = spec.size;
    let rumple = spec.rumple.clamp(0.0, 1.0);
    let cell = MIN_CELL.max((width * length / MAX_PARTICLES).sqrt()).max(thick.min(0.03) * 0.8);
    let nu = (width / cell).round().max(2.0) as usize + 1;
    let nv = (length / cell).round().max(2.0) as usize + 1;
    let cell = [width / (nu - 1) as f64, length / (nv - 1) as f64];
    let (fold, radius) = folding(spec, thick, cell[1]);
    let crease = -length / 2.0 + fold;
    let (s, c) = libm::sincos(spec.turn_deg.to_radians());
    let small = 1.0 - 0.1 * rumple;
    let seed = spec.seed;
    let mut points = Vec::with_capacity(nu * nv);
    let mut flat = Vec::with_capacity(nu * nv);
    for j in 0..nv {
        for i in 0..nu {
            let (u, v) = (i as f64 * cell[0], j as f64 * cell[1]);
            let x = u - width / 2.0;
            let (mut z, mut y) = (v - length / 2.0, 0.0);
            let over = crease - z;
            if over > 0.0 {
                let angle = over / radius;
                if angle < std::f64::consts::PI {
                    z = crease - radius * libm::sin(angle);
                    y = radius * (1.0 - libm::cos(angle));
                } else {
                    z = crease + over - std::f64::consts::PI * radius;
                    y = 2.0 * radius;
                }
            }
            let bumps = 0.65 * noise2(x / 0.32, z / 0.32, seed) + 0.35 * noise2(x / 0.14, z / 0.14, seed ^ 0x55);
            y += rumple * 0.08 * (0.5 + bumps).max(0.0);
            // Nothing in the world is quite flat: a millimetre decides where folds begin.
            y += 0.001 * (1.0 + noise2(x / 0.09, z / 0.09, seed ^ 0xaa));
            let (x, z) = (x * small, z * small);
            points.push(DVec3::new(spec.at[0] + x * c + z * s, y, spec.at[1] - x * s + z * c));
            flat.push(DVec2::new(u, v));
        }
    }
    (Middle { points, flat, nu, nv }, cell)
}

#[cfg(test)]
mod tests {
    use super::super::collider::tests::block;
    use super::super::grid::testing::sound;
    use super::*;

    fn spec() -> DrapeSpec {
        DrapeSpec {
            size: [1.2, 1.0],
            at: [0.0, 0.0],
            turn_deg: 0.0,
            rumple: 0.4,
            thick: 0.006,
            fold: 0.0,
            stiff: 0.2,
            seed: 5,
        }
    }

    fn bed() -> Piece {
        block(DVec3::new(-0.4, 0.0, -0.5), DVec3::new(0.4, 0.45, 0.5))
    }

    #[test]
    fn a_cloth_lies_on_the_bed_hangs_over_its_sides_and_keeps_its_lengths() {
        let bed = bed();
        let cloth = drape(&spec(), &[&bed]).unwrap();
        sound(&cloth.piece);
        // Never deeper than 1 cm inside the block, and not through the floor.
        for p in &cloth.piece.positions {
            let inside = (0.4 - p.x.abs()).min(0.45 - p.y).min(0.5 - p.z.abs());
            assert!(inside < 0.01 && p.y > -1e-9, "{p}");
        }
        // It hangs down on both sides by what is over, less what folds take.
        for side in [&cloth.hems.left, &cloth.hems.right] {
            let mean = side.iter().map(|p| p.y).sum::<f64>() / side.len() as f64;
            assert!((0.2..0.4).contains(&mean), "{mean}");
        }
        assert!(cloth.hems.left.iter().all(|p| p.x < -0.2) && cloth.hems.right.iter().all(|p| p.x > 0.2));
        // Lengths between neighbours of the middle surface, as on the flat cloth.
        let whole = |edge: &[DVec3]| edge.windows(2).map(|w| w[0].distance(w[1])).sum::<f64>();
        for (edge, length) in [(&cloth.hems.head, 1.2), (&cloth.hems.foot, 1.2), (&cloth.hems.left, 1.0)] {
            assert!((whole(edge) / length - 1.0).abs() < 0.04, "{} of {length}", whole(edge));
        }
    }

    #[test]
    fn threads_stretch_less_than_three_per_cent() {
        let bed = bed();
        let spec = spec();
        let thick = spec.thick;
        let (start, cell) = laid(&spec, thick);
        let collider = Collider::new(&[&bed], [-0.8, -0.8], [0.8, 0.8]);
        let stuff = stuff(&spec, thick, cell);
        let places: Vec<Vec3> =
            start.points.iter().map(|p| (*p + DVec3::Y * (collider.top + 0.02)).as_vec3()).collect();
        let mut sim = Sim::new(&places, start.nu, [cell[0] as f32, cell[1] as f32], stuff);
        sim.settle(&collider, 100);
        let p = sim.positions();
        let (mut sum, mut count) = (0.0, 0.0);
        for j in 0..sim.nv {
            for i in 0..sim.nu - 1 {
                let k = j * sim.nu + i;
                sum += (f64::from(p[k].distance(p[k + 1])) / cell[0] - 1.0).abs();
                count += 1.0;
            }
        }
        assert!(sum / count < 0.03, "{}", sum / count);
    }

    #[test]
    fn same_seed_same_bytes_and_another_seed_another_cloth() {
        let bed = bed();
        let one = drape(&spec(), &[&bed]).unwrap();
        assert_eq!(one, drape(&spec(), &[&bed]).unwrap());
        assert_ne!(one, drape(&DrapeSpec { seed: 6, ..spec() }, &[&bed]).unwrap());
    }

    #[test]
    fn a_folded_head_lies_on_the_cloth() {
        let bed = bed();
        let cloth = drape(&DrapeSpec { fold: 0.3, rumple: 0.0, ..spec() }, &[&bed]).unwrap();
        let mean = |edge: &[DVec3]| edge.iter().sum::<DVec3>() / edge.len() as f64;
        let (head, foot) = (mean(&cloth.hems.head), mean(&cloth.hems.foot));
        // Folded at z = -0.5 + 0.3 = -0.2; the edge lies 0.3 m behind that.
        assert!((head.z - 0.1).abs() < 0.05, "{head}");
        assert!((foot.z - 0.5).abs() < 0.06, "{foot}");
    }

    #[test]
    fn without_anything_below_it_lies_on_the_floor() {
        let cloth = drape(&DrapeSpec { rumple: 0.0, ..spec() }, &[]).unwrap();
        let (lo, hi) = cloth.piece.bounds().unwrap();
        assert!(lo.y >= 0.0 && hi.y < 0.03, "{lo} {hi}");
        assert!(drape(&DrapeSpec { size: [0.0, 1.0], ..spec() }, &[]).is_err());
        assert!(drape(&DrapeSpec { at: [f64::NAN, 1.0], ..spec() }, &[]).is_err());
    }
}
