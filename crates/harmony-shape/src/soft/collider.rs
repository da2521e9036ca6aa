//! What a cloth meets: the pieces below it as a solid without hollows, in a grid of signed distances.
//!
//! A cloth comes from above, so the solid is everything below the upper surface (a table is filled down to the floor).
//! The upper surface is sampled in columns; for each level of height the distance to the filled columns is a lower
//! envelope of parabolas (Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions", 2012), exact in
//! height and good to half a column sideways.

use glam::{DVec3, Vec3};

use crate::Piece;

/// Most distance that is told apart, metres.
const FAR: f32 = 0.25;
/// Nodes a grid may have.
const MAX_NODES: f64 = 2.5e6;

/// Signed distances (negative inside) at the nodes of a grid.
#[derive(Debug)]
pub(super) struct Collider {
    origin: Vec3,
    pitch: f32,
    dims: [usize; 3],
    /// x fastest, then z, then y.
    values: Vec<f32>,
    /// Height of the upper surface, x fastest.
    heights: Vec<f32>,
    /// Greatest height of the upper surface within the area asked for; 0 with nothing there.
    pub top: f64,
}

impl Collider {
    /// Of pieces, within `lo` to `hi` in x and z.
    pub fn new(below: &[&Piece], lo: [f64; 2], hi: [f64; 2]) -> Self {
        let (w, d) = ((hi[0] - lo[0]).max(0.01), (hi[1] - lo[1]).max(0.01));
        let height = below
            .iter()
            .flat_map(|p| &p.positions)
            .filter(|p| p.x >= lo[0] && p.x <= hi[0] && p.z >= lo[1] && p.z <= hi[1])
            .fold(0.0_f64, |m, p| m.max(p.y))
            .max(below.iter().filter_map(|p| p.bounds()).map(|b| b.1.y).fold(0.0, f64::max).min(3.0));
        let volume = w * d * (height + 0.1);
        let pitch = 0.015_f64.max(libm::cbrt(volume / MAX_NODES));
        let nx = (w / pitch).ceil() as usize + 1;
        let nz = (d / pitch).ceil() as usize + 1;
        let heights = columns(below, lo, pitch, nx, nz);
        let top = heights.iter().fold(0.0_f32, |m, h| m.max(*h));
        let ny = ((f64::from(top) + 0.1) / pitch).ceil() as usize + 1;
        let mut values = vec![0.0; nx * nz * ny];
        let mut work = Envelope::new(nx.max(nz));
        let (mut outside, mut inside) = (vec![0.0; nx * nz], vec![0.0; nx * nz]);
        for (level, out) in values.chunks_exact_mut(nx * nz).enumerate() {
            let y = level as f32 * pitch as f32;
            let cells = |v: f32| (v / pitch as f32).min(FAR / pitch as f32).powi(2);
            for (k, h) in heights.iter().enumerate() {
                outside[k] = cells((y - h).max(0.0));
                inside[k] = cells((h - y).max(0.0));
            }
            work.spread(&mut outside, nx, nz);
            work.spread(&mut inside, nx, nz);
            for (k, v) in out.iter_mut().enumerate() {
                *v = if y >= heights[k] { outside[k].sqrt() } else { -inside[k].sqrt() } * pitch as f32;
            }
        }
        let origin = Vec3::new(lo[0] as f32, 0.0, lo[1] as f32);
        Self { origin, pitch: pitch as f32, dims: [nx, ny, nz], values, heights, top: f64::from(top) }
    }

    /// Height of the upper surface below or above a place; 0 outside the grid.
    pub fn height(&self, x: f32, z: f32) -> f32 {
        let (i, k) = ((x - self.origin.x) / self.pitch + 0.5, (z - self.origin.z) / self.pitch + 0.5);
        if i >= 0.0 && k >= 0.0 && i < self.dims[0] as f32 && k < self.dims[2] as f32 {
            self.heights[k as usize * self.dims[0] + i as usize]
        } else {
            0.0
        }
    }

    /// Distance to the surface (negative inside) and its gradient; far away outside the grid.
    #[inline]
    pub fn sample(&self, p: Vec3) -> (f32, Vec3) {
        let q = (p - self.origin) / self.pitch;
        let [nx, ny, nz] = self.dims;
        let y = q.y.max(0.0);
        if !(q.x >= 0.0 && q.z >= 0.0 && q.x < (nx - 1) as f32 && q.z < (nz - 1) as f32 && y < (ny - 1) as f32) {
            return (FAR, Vec3::Y);
        }
        let (i, j, k) = (q.x as usize, y as usize, q.z as usize);
        let f = Vec3::new(q.x - i as f32, y - j as f32, q.z - k as f32);
        let at = (j * nz + k) * nx + i;
        let up = nx * nz;
        let v = |o: usize| self.values[at + o];
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let (a00, a10, a01, a11) = (v(0), v(1), v(nx), v(nx + 1));
        let (b00, b10, b01, b11) = (v(up), v(up + 1), v(up + nx), v(up + nx + 1));
        let (a0, a1) = (mix(a00, a10, f.x), mix(a01, a11, f.x));
        let (b0, b1) = (mix(b00, b10, f.x), mix(b01, b11, f.x));
        let (a, b) = (mix(a0, a1, f.z), mix(b0, b1, f.z));
        let gx = mix(mix(a10 - a00, a11 - a01, f.z), mix(b10 - b00, b11 - b01, f.z), f.y);
        let gz = mix(a1 - a0, b1 - b0, f.y);
        (mix(a, b, f.y), Vec3::new(gx, b - a, gz))
    }
}

/// Greatest height of the pieces over each column; 0 (the floor) where there is nothing.
fn columns(below: &[&Piece], lo: [f64; 2], pitch: f64, nx: usize, nz: usize) -> Vec<f32> {
    let mut heights = vec![0.0_f32; nx * nz];
    let mut raise = |i: f64, k: f64, y: f64| {
        if i >= 0.0 && k >= 0.0 && i < nx as f64 && k < nz as f64 {
            let h = &mut heights[k as usize * nx + i as usize];
            *h = h.max(y as f32);
        }
    };
    for piece in below {
        for t in &piece.triangles {
            let corner = t.map(|i| {
                let p = piece.positions[i as usize];
                DVec3::new((p.x - lo[0]) / pitch, p.y, (p.z - lo[1]) / pitch)
            });
            let [a, b, c] = corner;
            let low = a.min(b).min(c);
            let high = a.max(b).max(c);
            if high.x < -1.0 || high.z < -1.0 || low.x > nx as f64 || low.z > nz as f64 {
                continue;
            }
            // Edges: the nearest column, so that walls are right on average and nothing thin is missed.
            for (p, q) in [(a, b), (b, c), (c, a)] {
                let steps = ((q.x - p.x).abs().max((q.z - p.z).abs()) * 1.5).ceil().clamp(1.0, 4000.0);
                for s in 0..=steps as usize {
                    let m = p.lerp(q, s as f64 / steps);
                    raise((m.x + 0.5).floor(), (m.z + 0.5).floor(), m.y);
                }
            }
            let area = (b.x - a.x) * (c.z - a.z) - (c.x - a.x) * (b.z - a.z);
            if area.abs() < 1e-9 {
                continue;
            }
            let (k0, k1) = (low.z.max(0.0).ceil() as usize, high.z.min(nz as f64 - 1.0).max(-1.0).floor());
            let (i0, i1) = (low.x.max(0.0).ceil() as usize, high.x.min(nx as f64 - 1.0).max(-1.0).floor());
            let mut k = k0;
            while (k as f64) <= k1 {
                let mut i = i0;
                while (i as f64) <= i1 {
                    let (x, z) = (i as f64, k as f64);
                    let v = ((x - a.x) * (c.z - a.z) - (c.x - a.x) * (z - a.z)) / area;
                    let w = ((b.x - a.x) * (z - a.z) - (x - a.x) * (b.z - a.z)) / area;
                    if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
                        raise(x, z, a.y + (b.y - a.y) * v + (c.y - a.y) * w);
                    }
                    i += 1;
                }
                k += 1;
            }
        }
    }
    heights
}

/// Buffers of the lower envelope.
#[derive(Debug)]
struct Envelope {
    line: Vec<f32>,
    at: Vec<usize>,
    from: Vec<f32>,
}

impl Envelope {
    fn new(longest: usize) -> Self {
        Self { line: vec![0.0; longest], at: vec![0; longest], from: vec![0.0; longest + 1] }
    }

    /// Replaces `f` by the least of `f(q) + |p - q|^2` over the plane.
    fn spread(&mut self, f: &mut [f32], nx: usize, nz: usize) {
        for row in f.chunks_exact_mut(nx) {
            self.line[..nx].copy_from_slice(row);
            self.lowest(nx, row, 1);
        }
        for i in 0..nx {
            for k in 0..nz {
                self.line[k] = f[k * nx + i];
            }
            self.lowest(nz, &mut f[i..], nx);
        }
    }

    fn lowest(&mut self, n: usize, out: &mut [f32], stride: usize) {
        let line = &self.line[..n];
        // A flat line is its own envelope.
        if line.iter().all(|v| *v == line[0]) {
            return;
        }
        let meet = |q: usize, p: usize| {
            let (q2, p2) = ((q * q) as f32, (p * p) as f32);
            ((line[q] + q2) - (line[p] + p2)) / (2.0 * (q - p) as f32)
        };
        let mut k = 0;
        self.at[0] = 0;
        self.from[0] = f32::NEG_INFINITY;
        for q in 1..n {
            let mut s = meet(q, self.at[k]);
            while s <= self.from[k] {
                k -= 1;
                s = meet(q, self.at[k]);
            }
            k += 1;
            self.at[k] = q;
            self.from[k] = s;
        }
        let mut m = 0;
        for p in 0..n {
            while m < k && self.from[m + 1] < p as f32 {
                m += 1;
            }
            let q = self.at[m];
            let d = p.abs_diff(q) as f32;
            out[p * stride] = line[q] + d * d;
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use glam::DVec2;

    use super::*;

    /// A box by its corners, for tests.
    pub fn block(lo: DVec3, hi: DVec3) -> Piece {
        let mut p = Piece { closed: true, ..Piece::default() };
        for i in 0..8 {
            let pick = |bit: u32, a: f64, b: f64| if i >> bit & 1 == 0 { a } else { b };
            p.positions.push(DVec3::new(pick(0, lo.x, hi.x), pick(1, lo.y, hi.y), pick(2, lo.z, hi.z)));
            p.normals.push(DVec3::Y);
            p.uvs.push(DVec2::ZERO);
        }
        for [a, b, c, d] in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 4, 6, 2], [1, 3, 7, 5], [2, 6, 7, 3], [0, 1, 5, 4]] {
            p.triangles.extend([[a, b, c], [a, c, d]]);
        }
        p
    }

    #[test]
    fn distances_of_a_box_are_right() {
        let b = block(DVec3::new(-0.4, 0.2, -0.3), DVec3::new(0.4, 0.5, 0.3));
        let c = Collider::new(&[&b], [-0.8, -0.8], [0.8, 0.8]);
        assert!((c.top - 0.5).abs() < 1e-6);
        let cases = [
            ([0.0, 0.55, 0.0], 0.05, [0.0, 1.0, 0.0]),
            ([0.0, 0.46, 0.0], -0.04, [0.0, 1.0, 0.0]),
            ([0.46, 0.3, 0.0], 0.06, [1.0, 0.0, 0.0]),
            ([0.0, 0.1, 0.35], 0.05, [0.0, 0.0, 1.0]), // below the box counts as solid
            ([0.44, 0.53, 0.0], 0.05, [0.8, 0.6, 0.0]),
        ];
        for (p, distance, direction) in cases {
            let (d, g) = c.sample(Vec3::from_array(p.map(|v| v as f32)));
            assert!((d - distance).abs() < 0.009, "{p:?}: {d}, not {distance}");
            assert!(g.normalize().dot(Vec3::from_array(direction)) > 0.9, "{p:?}: {g}");
        }
    }
}
