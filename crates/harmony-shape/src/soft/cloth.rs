//! The simulation of a rectangular cloth: extended position-based dynamics (Macklin, Muller and Chentanez, "XPBD",
//! 2016) with many small steps of one pass each (Macklin and others, "Small steps in physics simulation", 2019).
//!
//! Particles are the nodes of a grid. Constraints are distances: along the threads, across the cells (shear), and over
//! two or more cells (bending). Each family is solved row by row, so that the pairs of a sweep are independent.
//! `f32`, one thread, fixed order: the same input gives the same bits.

use glam::Vec3;

use super::collider::Collider;

/// Steps a second.
const RATE: f32 = 600.0;
/// Fastest particle, m/s.
const MAX_SPEED: f32 = 3.0;

/// What a cloth is made of, as the simulation sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stuff {
    /// Compliance of the diagonals.
    pub shear: f32,
    /// Compliance of bending over two cells.
    pub bend: f32,
    /// Cells and compliance of a longer bending constraint (padded cloth); 0 cells: none.
    pub padding: (usize, f32),
    /// Distance of the middle surface from what it lies on.
    pub offset: f32,
    /// Least distance of parts of the cloth that are not neighbours.
    pub apart: f32,
    /// Rows (first, last) that are folded sharply: no bending is felt across them.
    pub crease: Option<(usize, usize)>,
}

/// A cloth in motion.
#[derive(Debug)]
pub(super) struct Sim {
    /// Nodes a row and rows.
    pub nu: usize,
    pub nv: usize,
    cell: [f32; 2],
    stuff: Stuff,
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    velocity: Vec<Vec3>,
    before: Vec<Vec3>,
    /// Steps for which a particle is known to be away from the collider.
    clear: Vec<u8>,
    pairs: Vec<(u32, u32)>,
    /// Weight of each particle relative to its own.
    load: Vec<f32>,
    /// Friction relative to the usual one.
    slide: f32,
}

impl Sim {
    /// From a grid of places, `nu` a row; `cell` is the pitch along the rows and between them when flat.
    pub fn new(start: &[Vec3], nu: usize, cell: [f32; 2], stuff: Stuff) -> Self {
        let n = start.len();
        Self {
            nu,
            nv: n / nu,
            cell,
            stuff,
            x: start.iter().map(|p| p.x).collect(),
            y: start.iter().map(|p| p.y).collect(),
            z: start.iter().map(|p| p.z).collect(),
            velocity: vec![Vec3::ZERO; n],
            before: start.to_vec(),
            clear: vec![0; n],
            pairs: Vec::new(),
            load: vec![1.0; n],
            slide: 1.0,
        }
    }

    /// Where the particles are.
    pub fn positions(&self) -> Vec<Vec3> {
        (0..self.x.len()).map(|i| Vec3::new(self.x[i], self.y[i], self.z[i])).collect()
    }

    /// Runs `frames` of ten steps; the last fifth is damped so that it comes to rest. Stops when it rests.
    ///
    /// For the first half, what stands off from a seat or a bed is pressed down and all slides more easily: hands that lay a cloth
    /// push it into the corner of a seat.
    pub fn settle(&mut self, collider: &Collider, frames: usize) {
        for frame in 0..frames {
            let late = frame * 5 > frames * 4;
            self.find_pairs();
            let pressed = frame * 2 < frames;
            for (i, load) in self.load.iter_mut().enumerate() {
                let height = collider.height(self.x[i], self.z[i]);
                let held = pressed && height > 0.05 && self.y[i] > height + 0.06;
                *load = if held { 5.0 } else { 1.0 };
            }
            self.slide = if pressed { 0.6 } else { 1.0 };
            for _ in 0..10 {
                self.step(collider, if late { 12.0 } else { 1.5 });
            }
            let mean = self.velocity.iter().map(|v| v.length()).sum::<f32>() / self.velocity.len().max(1) as f32;
            if frame > 30 && !pressed && mean < 0.004 {
                break;
            }
        }
    }

    fn step(&mut self, collider: &Collider, damping: f32) {
        let dt = 1.0 / RATE;
        let reach = MAX_SPEED.min(0.45 * self.cell[0].min(self.cell[1]) * RATE);
        let keep = 1.0 - damping * dt;
        for i in 0..self.x.len() {
            let mut v = self.velocity[i] * keep;
            v.y -= 9.81 * self.load[i] * dt;
            let speed = v.length();
            if speed > reach {
                v *= reach / speed;
            }
            self.before[i] = Vec3::new(self.x[i], self.y[i], self.z[i]);
            self.x[i] += v.x * dt;
            self.y[i] += v.y * dt;
            self.z[i] += v.z * dt;
        }
        self.constrain();
        self.keep_apart();
        self.collide(collider, reach * dt);
        for i in 0..self.x.len() {
            self.velocity[i] = (Vec3::new(self.x[i], self.y[i], self.z[i]) - self.before[i]) * RATE;
        }
    }

    /// One pass over all distances.
    fn constrain(&mut self) {
        let (nu, nv) = (self.nu, self.nv);
        let [cu, cv] = self.cell;
        let soft = |compliance: f32| 1.0 / (2.0 + compliance * RATE * RATE);
        self.along(1, cu, soft(0.0));
        for j in 0..nv - 1 {
            self.between(j * nu, (j + 1) * nu, nu, cv, soft(0.0));
        }
        let diagonal = (cu * cu + cv * cv).sqrt();
        let shear = soft(self.stuff.shear);
        for j in 0..nv - 1 {
            self.between(j * nu, (j + 1) * nu + 1, nu - 1, diagonal, shear);
            self.between(j * nu + 1, (j + 1) * nu, nu - 1, diagonal, shear);
        }
        self.bend(2, soft(self.stuff.bend));
        let (skip, compliance) = self.stuff.padding;
        if skip > 2 {
            self.bend(skip, soft(compliance));
        }
    }

    fn bend(&mut self, skip: usize, k: f32) {
        let (nu, nv) = (self.nu, self.nv);
        if nu > skip {
            self.along(skip, self.cell[0] * skip as f32, k);
        }
        for j in 0..nv.saturating_sub(skip) {
            if self.stuff.crease.is_some_and(|(first, last)| j < last && j + skip > first) {
                continue;
            }
            self.between(j * nu, (j + skip) * nu, nu, self.cell[1] * skip as f32, k);
        }
    }

    /// Distances of particles `skip` apart within every row.
    fn along(&mut self, skip: usize, rest: f32, k: f32) {
        for offset in [0, skip] {
            for j in 0..self.nv {
                let row = j * self.nu + offset..(j + 1) * self.nu;
                if row.start >= row.end {
                    continue;
                }
                let (x, y, z) = (&mut self.x[row.clone()], &mut self.y[row.clone()], &mut self.z[row]);
                let n = x.len();
                let mut first = 0;
                while first + skip < n {
                    let end = (first + 2 * skip).min(n);
                    let (xs, ys, zs) = (&mut x[first..end], &mut y[first..end], &mut z[first..end]);
                    for i in 0..end - first - skip {
                        let d = [xs[i + skip] - xs[i], ys[i + skip] - ys[i], zs[i + skip] - zs[i]];
                        let s = pull(d, rest, k);
                        xs[i] += d[0] * s;
                        ys[i] += d[1] * s;
                        zs[i] += d[2] * s;
                        xs[i + skip] -= d[0] * s;
                        ys[i + skip] -= d[1] * s;
                        zs[i + skip] -= d[2] * s;
                    }
                    first += 2 * skip;
                }
            }
        }
    }

    /// Distances of `len` pairs: particle `a + i` and particle `b + i`, a later row.
    fn between(&mut self, a: usize, b: usize, len: usize, rest: f32, k: f32) {
        let (xa, xb) = self.x.split_at_mut(b);
        let (ya, yb) = self.y.split_at_mut(b);
        let (za, zb) = self.z.split_at_mut(b);
        let (xa, ya, za) = (&mut xa[a..a + len], &mut ya[a..a + len], &mut za[a..a + len]);
        let (xb, yb, zb) = (&mut xb[..len], &mut yb[..len], &mut zb[..len]);
        for i in 0..len {
            let d = [xb[i] - xa[i], yb[i] - ya[i], zb[i] - za[i]];
            let s = pull(d, rest, k);
            xa[i] += d[0] * s;
            ya[i] += d[1] * s;
            za[i] += d[2] * s;
            xb[i] -= d[0] * s;
            yb[i] -= d[1] * s;
            zb[i] -= d[2] * s;
        }
    }

    /// Pairs of particles that may meet within the next frame, neighbours in the cloth left out: a grid of cells,
    /// particles sorted by cell.
    fn find_pairs(&mut self) {
        self.pairs.clear();
        let apart = self.stuff.apart;
        if apart <= 0.0 {
            return;
        }
        let reach = apart * 1.6;
        let n = self.x.len();
        let low = Vec3::new(
            self.x.iter().copied().fold(f32::INFINITY, f32::min),
            self.y.iter().copied().fold(f32::INFINITY, f32::min),
            self.z.iter().copied().fold(f32::INFINITY, f32::min),
        );
        let cell = |i: usize| {
            let q = |v: f32| (v / reach).clamp(0.0, 1_000_000.0) as u64;
            [q(self.x[i] - low.x), q(self.y[i] - low.y), q(self.z[i] - low.z)]
        };
        let key = |c: [u64; 3]| c[1] << 42 | c[2] << 21 | c[0];
        let mut order: Vec<(u64, u32)> = (0..n).map(|i| (key(cell(i)), i as u32)).collect();
        order.sort_unstable();
        let far = (3.0 * apart / self.cell[0].min(self.cell[1])).ceil().max(2.0) as usize;
        let starts: Vec<u64> = order.iter().map(|o| o.0).collect();
        // Half of the neighbouring rows of cells; each row of three along x is one range.
        let rows: [(i64, i64); 4] = [(0, 1), (1, -1), (1, 0), (1, 1)];
        let mut cursor = [0_usize; 4];
        for (k, (code, i)) in order.iter().enumerate() {
            let mut test = |j: u32| {
                let (a, b) = (*i as usize, j as usize);
                let apart_u = (a % self.nu).abs_diff(b % self.nu);
                let apart_v = (a / self.nu).abs_diff(b / self.nu);
                if apart_u.max(apart_v) <= far {
                    return;
                }
                let d = Vec3::new(self.x[a] - self.x[b], self.y[a] - self.y[b], self.z[a] - self.z[b]);
                if d.length_squared() < reach * reach {
                    self.pairs.push((*i, j));
                }
            };
            for (next, j) in &order[k + 1..] {
                if *next > code + 1 {
                    break;
                }
                test(*j);
            }
            for (m, (dy, dz)) in rows.iter().enumerate() {
                let shift = (dy << 42) + (dz << 21);
                let middle = code.wrapping_add_signed(shift);
                let from = middle.wrapping_sub(1);
                let c = &mut cursor[m];
                while *c < n && starts[*c] < from {
                    *c += 1;
                }
                for (next, j) in &order[*c..] {
                    if *next > middle + 1 {
                        break;
                    }
                    test(*j);
                }
            }
        }
    }

    fn keep_apart(&mut self) {
        let apart = self.stuff.apart;
        for (a, b) in &self.pairs {
            let (a, b) = (*a as usize, *b as usize);
            let d = Vec3::new(self.x[b] - self.x[a], self.y[b] - self.y[a], self.z[b] - self.z[a]);
            let square = d.length_squared();
            if square >= apart * apart || square < 1e-12 {
                continue;
            }
            let length = square.sqrt();
            let push = d * (0.5 * (apart - length) / length);
            // Layers that touch rub: a part of their slip in this step is taken back.
            let slip = (Vec3::new(self.x[b], self.y[b], self.z[b]) - self.before[b])
                - (Vec3::new(self.x[a], self.y[a], self.z[a]) - self.before[a]);
            let normal = d / length;
            let rub = (slip - normal * slip.dot(normal)) * 0.1;
            self.x[a] += rub.x - push.x;
            self.y[a] += rub.y - push.y;
            self.z[a] += rub.z - push.z;
            self.x[b] += push.x - rub.x;
            self.y[b] += push.y - rub.y;
            self.z[b] += push.z - rub.z;
        }
    }

    fn collide(&mut self, collider: &Collider, step: f32) {
        let offset = self.stuff.offset;
        for i in 0..self.x.len() {
            let mut p = Vec3::new(self.x[i], self.y[i], self.z[i]);
            if p.y < offset {
                let depth = offset - p.y;
                p.y = offset;
                p = rub(p, self.before[i], Vec3::Y, depth, self.slide);
            }
            if self.clear[i] > 0 {
                self.clear[i] -= 1;
            } else {
                let (distance, gradient) = collider.sample(p);
                let depth = offset - distance;
                if depth > 0.0 {
                    let normal = gradient.normalize_or(Vec3::Y);
                    p += normal * depth.min(2.0 * step + 0.002);
                    p = rub(p, self.before[i], normal, depth, self.slide);
                } else {
                    // Constraints can move a particle as well as its speed can: half of the way is trusted.
                    self.clear[i] = (-depth / (2.0 * step)).min(20.0) as u8;
                }
            }
            self.x[i] = p.x;
            self.y[i] = p.y;
            self.z[i] = p.z;
        }
    }
}

/// Friction: the slip along the surface is taken back by four times the depth, and by 30 % of what is left.
fn rub(p: Vec3, before: Vec3, normal: Vec3, depth: f32, amount: f32) -> Vec3 {
    let slip = p - before;
    let slip = slip - normal * slip.dot(normal);
    let length = slip.length();
    if length < 1e-9 {
        return p;
    }
    let stick = (4.0 * depth * amount).min(length);
    p - slip * ((stick + 0.3 * amount * (length - stick)) / length)
}

/// How far both ends of a distance move along it.
#[inline]
fn pull(d: [f32; 3], rest: f32, k: f32) -> f32 {
    let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    k * (1.0 - rest / length.max(1e-9))
}
