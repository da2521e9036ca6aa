//! Closed surfaces that objects are put together from: surfaces of revolution, lofts, bent sheets, superellipsoids.
//!
//! Every patch is closed and wound outward, so that the winding number of a whole object tells inside from outside.

use std::f32::consts::{PI, TAU};

use glam::{Quat, Vec3};

/// A closed triangle surface.
#[derive(Debug, Clone, Default)]
pub(super) struct Patch {
    /// Points, shared by neighbouring triangles.
    pub(super) points: Vec<Vec3>,
    /// Counter-clockwise seen from outside.
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Patch {
    /// Shifted.
    pub(super) fn moved(mut self, x: f32, y: f32, z: f32) -> Self {
        self.points.iter_mut().for_each(|p| *p += Vec3::new(x, y, z));
        self
    }

    /// Turned about the origin.
    pub(super) fn turned(mut self, rotation: Quat) -> Self {
        self.points.iter_mut().for_each(|p| *p = rotation * *p);
        self
    }

    /// Turned about x, y, z by angles (x first).
    pub(super) fn tilted(self, x: f32, y: f32, z: f32) -> Self {
        self.turned(Quat::from_rotation_z(z) * Quat::from_rotation_y(y) * Quat::from_rotation_x(x))
    }

    /// Deformed; the map must not turn the patch inside out.
    pub(super) fn warped(mut self, f: impl Fn(Vec3) -> Vec3) -> Self {
        self.points.iter_mut().for_each(|p| *p = f(*p));
        self
    }

    /// Displaced by a smooth noise.
    pub(super) fn lumpy(self, amplitude: f32, frequency: f32, phase: f32) -> Self {
        self.warped(|p| {
            let q = p * frequency;
            let wave = |a: f32, b: f32, k: f32| (a + 1.7 * b.sin() + phase * k).sin();
            p + amplitude * Vec3::new(wave(q.y, q.z, 1.0), wave(q.z, q.x, 2.3), wave(q.x, q.y, 3.1))
        })
    }

    /// Smallest and largest corner.
    pub(super) fn bounds(&self) -> (Vec3, Vec3) {
        self.points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), p| (lo.min(*p), hi.max(*p)))
    }

    /// Wound outward, whatever it was.
    fn outward(mut self) -> Self {
        let volume: f32 = self
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| self.points[i as usize]);
                a.dot(b.cross(c))
            })
            .sum();
        if volume < 0.0 {
            self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        self
    }
}

/// A skin over rings of equally many points, closed at both ends towards a point.
pub(super) fn skin_to(rings: &[Vec<Vec3>], first: Vec3, last: Vec3) -> Patch {
    let n = rings.first().map_or(0, Vec::len) as u32;
    let mut patch = Patch::default();
    if n < 3 {
        return patch;
    }
    patch.points.extend(rings.iter().flatten());
    for i in 0..rings.len() as u32 - 1 {
        for j in 0..n {
            let (a, b) = (i * n + j, i * n + (j + 1) % n);
            patch.triangles.extend([[a, b, b + n], [a, b + n, a + n]]);
        }
    }
    let top = (rings.len() as u32 - 1) * n;
    let end = patch.points.len() as u32;
    patch.points.extend([first, last]);
    for j in 0..n {
        let k = (j + 1) % n;
        patch.triangles.extend([[end, k, j], [end + 1, top + j, top + k]]);
    }
    patch.outward()
}

/// A skin over rings, closed at both ends.
pub(super) fn skin(rings: &[Vec<Vec3>]) -> Patch {
    let middle = |r: &Vec<Vec3>| r.iter().sum::<Vec3>() / r.len().max(1) as f32;
    match (rings.first(), rings.last()) {
        (Some(first), Some(last)) => skin_to(rings, middle(first), middle(last)),
        _ => Patch::default(),
    }
}

fn signed_power(v: f32, e: f32) -> f32 {
    v.signum() * v.abs().powf(e)
}

/// A level superellipse; `power` 2 is an ellipse, large ones are nearly rectangles.
pub(super) fn oval(a: f32, b: f32, power: f32, y: f32, n: usize) -> Vec<Vec3> {
    (0..n)
        .map(|i| {
            let angle = (i as f32 + 0.5) / n as f32 * TAU;
            let (s, c) = angle.sin_cos();
            Vec3::new(a * signed_power(c, 2.0 / power), y, -b * signed_power(s, 2.0 / power))
        })
        .collect()
}

/// A level rectangle with cut corners.
pub(super) fn cut_rectangle(a: f32, b: f32, cut: f32, y: f32) -> Vec<Vec3> {
    let c = cut.min(a * 0.9).min(b * 0.9);
    [(a, -b + c), (a - c, -b), (-a + c, -b), (-a, -b + c), (-a, b - c), (-a + c, b), (a - c, b), (a, b - c)]
        .map(|(x, z)| Vec3::new(x, y, z))
        .to_vec()
}

/// A box standing on the origin, with bevelled edges and flat faces.
pub(super) fn block(w: f32, h: f32, d: f32, bevel: f32) -> Patch {
    let (a, b) = (w / 2.0, d / 2.0);
    let v = bevel.min(h * 0.45).min(a * 0.9).min(b * 0.9);
    let k = v * 0.8;
    skin(&[
        cut_rectangle(a - k, b - k, v, 0.0),
        cut_rectangle(a, b, v, v),
        cut_rectangle(a, b, v, h - v),
        cut_rectangle(a - k, b - k, v, h),
    ])
}

/// A box standing on the origin with sharp edges.
pub(super) fn brick(w: f32, h: f32, d: f32) -> Patch {
    let (a, b) = (w / 2.0, d / 2.0);
    let ring = |y: f32| [(a, -b), (-a, -b), (-a, b), (a, b)].map(|(x, z)| Vec3::new(x, y, z)).to_vec();
    skin(&[ring(0.0), ring(h)])
}

/// A box whose top has other sides than its bottom.
pub(super) fn tapered(bottom: [f32; 2], top: [f32; 2], h: f32, bevel: f32) -> Patch {
    let bevel = bevel.min(h * 0.4);
    let ring = |t: f32, inset: f32| {
        let w = bottom[0] + (top[0] - bottom[0]) * t;
        let d = bottom[1] + (top[1] - bottom[1]) * t;
        cut_rectangle(w / 2.0 - inset, d / 2.0 - inset, bevel, h * t)
    };
    let e = bevel / h;
    skin(&[ring(0.0, bevel * 0.8), ring(e, 0.0), ring(1.0 - e, 0.0), ring(1.0, bevel * 0.8)])
}

/// A slab standing on the origin with a superellipse outline and rounded edges.
pub(super) fn slab(w: f32, h: f32, d: f32, power: f32, n: usize) -> Patch {
    let e = (h * 0.3).min(0.02);
    let ring = |y: f32, inset: f32| oval(w / 2.0 - inset, d / 2.0 - inset, power, y, n);
    skin(&[ring(0.0, e), ring(e, 0.0), ring(h - e, 0.0), ring(h, e)])
}

/// A surface of revolution from (radius, height) pairs, lowest outer point first; lobes make it fluted.
pub(super) fn lathe(profile: &[(f32, f32)], n: usize, lobes: (f32, f32)) -> Patch {
    let rings: Vec<Vec<Vec3>> = profile
        .iter()
        .filter(|(r, _)| *r > 1e-4)
        .map(|(r, y)| {
            (0..n)
                .map(|i| {
                    let angle = i as f32 / n as f32 * TAU;
                    let r = r * (1.0 + lobes.0 * (angle * lobes.1).cos());
                    Vec3::new(r * angle.cos(), *y, -r * angle.sin())
                })
                .collect()
        })
        .collect();
    let (first, last) = (profile.first().map_or(0.0, |p| p.1), profile.last().map_or(0.0, |p| p.1));
    skin_to(&rings, Vec3::Y * first, Vec3::Y * last)
}

/// A superellipsoid about the origin; small exponents make it a box with soft edges, 1 an ellipsoid.
pub(super) fn pillow(half: Vec3, vertical: f32, level: f32, around: usize, up: usize) -> Patch {
    let rings: Vec<Vec<Vec3>> = (1..up)
        .map(|i| {
            let (s, c) = ((i as f32 / up as f32 - 0.5) * PI).sin_cos();
            let r = signed_power(c, vertical);
            oval(half.x * r, half.z * r, 2.0 / level, half.y * signed_power(s, vertical), around)
        })
        .collect();
    skin_to(&rings, Vec3::NEG_Y * half.y, Vec3::Y * half.y)
}

/// A tube along a path, its radius going through `radii`.
pub(super) fn tube(path: &[Vec3], radii: &[f32], n: usize) -> Patch {
    let mut side = Vec3::ZERO;
    let mut rings = Vec::with_capacity(path.len());
    for (i, p) in path.iter().enumerate() {
        let ahead = path[(i + 1).min(path.len() - 1)] - path[i.saturating_sub(1)];
        let along = ahead.normalize_or(Vec3::Y);
        if side == Vec3::ZERO {
            side = along.any_orthonormal_vector();
        }
        side = (side - along * side.dot(along)).normalize_or(Vec3::X);
        let other = along.cross(side);
        let t = i as f32 / (path.len() - 1).max(1) as f32 * (radii.len() - 1) as f32;
        let k = (t as usize).min(radii.len() - 1);
        let r = radii[k] + (radii[(k + 1).min(radii.len() - 1)] - radii[k]) * (t - k as f32);
        rings.push(
            (0..n)
                .map(|j| {
                    let (s, c) = (j as f32 / n as f32 * TAU).sin_cos();
                    *p + (side * c + other * s) * r
                })
                .collect(),
        );
    }
    skin(&rings)
}

/// A straight rod from one point to another, `r0` thick at the start.
pub(super) fn rod(from: Vec3, to: Vec3, r0: f32, r1: f32, n: usize) -> Patch {
    tube(&[from, to], &[r0, r1], n)
}

/// A leg from a hip down to the floor whose foot is cut level.
pub(super) fn leg(hip: Vec3, foot: Vec3, r0: f32, r1: f32, n: usize) -> Patch {
    let power = 2.0 + 3.0 * (r0 * 77.0).fract();
    let ring = |c: Vec3, r: f32| oval(r, r, power, 0.0, n).into_iter().map(|p| p + c).collect::<Vec<_>>();
    skin(&[ring(foot, r1), ring(foot.lerp(hip, 0.45), r1 * 0.4 + r0 * 0.6), ring(hip, r0)])
}

/// A bent sheet: a grid of points with thickness along its local normal.
pub(super) fn sheet(nu: usize, nv: usize, thickness: f32, f: impl Fn(f32, f32) -> Vec3) -> Patch {
    let at = |i: usize, j: usize| f(i as f32 / nu as f32, j as f32 / nv as f32);
    let e = 1e-2;
    let normal = |i: usize, j: usize| {
        let (u, v) = (i as f32 / nu as f32, j as f32 / nv as f32);
        let du = f((u + e).min(1.0), v) - f((u - e).max(0.0), v);
        let dv = f(u, (v + e).min(1.0)) - f(u, (v - e).max(0.0));
        du.cross(dv).normalize_or(Vec3::Z)
    };
    let mut patch = Patch::default();
    for side in [0.5, -0.5] {
        for j in 0..=nv {
            for i in 0..=nu {
                patch.points.push(at(i, j) + normal(i, j) * thickness * side);
            }
        }
    }
    let (row, back) = (nu as u32 + 1, ((nu + 1) * (nv + 1)) as u32);
    for j in 0..nv as u32 {
        for i in 0..nu as u32 {
            let a = j * row + i;
            let (b, c, d) = (a + 1, a + row + 1, a + row);
            patch.triangles.extend([[a, b, c], [a, c, d]]);
            patch.triangles.extend([[back + a, back + c, back + b], [back + a, back + d, back + c]]);
        }
    }
    let mut strip = |a: u32, b: u32| patch.triangles.extend([[a, back + a, back + b], [a, back + b, b]]);
    for i in 0..nu as u32 {
        strip(i, i + 1);
        strip(nv as u32 * row + i + 1, nv as u32 * row + i);
    }
    for j in 0..nv as u32 {
        strip((j + 1) * row, j * row);
        strip(j * row + row - 1, (j + 1) * row + row - 1);
    }
    patch.outward()
}

/// A thin leaf from its stem, curving down; eight triangles a segment.
pub(super) fn leaf(stem: Vec3, direction: Vec3, length: f32, width: f32, droop: f32) -> Patch {
    let along = direction.normalize_or(Vec3::Y);
    let side = along.cross(Vec3::Y).try_normalize().unwrap_or(Vec3::X);
    let up = side.cross(along).normalize_or(Vec3::Y);
    let at = |t: f32| stem + along * (length * t) - Vec3::Y * (droop * length * t * t);
    let ring = |t: f32, w: f32| {
        let c = at(t);
        let thin = 0.002 + 0.02 * w;
        vec![c + side * w, c + up * thin, c - side * w, c - up * thin]
    };
    let w = width / 2.0;
    skin_to(&[ring(0.25, w * 0.75), ring(0.55, w), ring(0.8, w * 0.6)], stem, at(1.0))
}
