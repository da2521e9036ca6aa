//! Closed solids made of patches: welded points, charts with their own texture coordinates, smoothing groups.

use std::collections::HashMap;

use glam::{DAffine3, DVec2, DVec3};

/// A chart is cut in pieces when it is longer than this many times its width.
const MAX_CHART_ASPECT: f64 = 4.0;
/// Most pieces of one patch.
const MAX_CHART_PIECES: usize = 6;

/// A corner of a chart.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ChartVertex {
    /// Index into [`Solid::points`].
    pub point: u32,
    /// Unwrapped position in metres.
    pub uv: DVec2,
    /// Unit normal.
    pub normal: DVec3,
    group: u32,
}

/// A piece of surface that is unwrapped as one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Chart {
    pub vertices: Vec<ChartVertex>,
    /// Indices into `vertices`, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// A closed, consistently wound surface.
#[derive(Debug, Clone, Default)]
pub(crate) struct Solid {
    /// Welded positions.
    pub points: Vec<DVec3>,
    pub charts: Vec<Chart>,
    /// Sets of points whose hulls make up the solid for collision.
    pub pieces: Vec<Vec<DVec3>>,
}

impl Solid {
    /// Signed volume: positive when wound outwards.
    pub fn volume(&self) -> f64 {
        self.triangles()
            .map(|t| {
                let [a, b, c] = t.map(|i| self.points[i as usize]);
                a.dot(b.cross(c)) / 6.0
            })
            .sum()
    }

    /// Triangles as indices into `points`.
    pub fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.charts.iter().flat_map(|c| c.triangles.iter().map(|t| t.map(|i| c.vertices[i as usize].point)))
    }

    /// Moves the solid; a reflection keeps it wound outwards.
    pub fn transform(&mut self, map: &DAffine3) {
        for p in &mut self.points {
            *p = map.transform_point3(*p);
        }
        for p in self.pieces.iter_mut().flatten() {
            *p = map.transform_point3(*p);
        }
        let normal_map = map.matrix3.inverse().transpose();
        for v in self.charts.iter_mut().flat_map(|c| &mut c.vertices) {
            v.normal = (normal_map * v.normal).normalize_or(DVec3::Y);
        }
        if map.matrix3.determinant() < 0.0 {
            self.flip_winding();
        }
    }

    fn flip_winding(&mut self) {
        for chart in &mut self.charts {
            for t in &mut chart.triangles {
                t.swap(1, 2);
            }
        }
    }
}

/// Collects patches into a [`Solid`].
pub(super) struct SolidBuilder {
    solid: Solid,
    weld: HashMap<[i64; 3], Vec<u32>>,
    tolerance: f64,
    groups: u32,
}

impl SolidBuilder {
    /// `extent` sets the scale under which points count as the same.
    pub fn new(extent: f64) -> Self {
        Self { solid: Solid::default(), weld: HashMap::new(), tolerance: (extent * 1e-7).max(1e-12), groups: 0 }
    }

    /// A new smoothing group.
    pub fn group(&mut self) -> u32 {
        self.groups += 1;
        self.groups - 1
    }

    fn point(&mut self, p: DVec3) -> u32 {
        let cell = |v: f64| (v / (self.tolerance * 4.0)).floor() as i64;
        let key = [cell(p.x), cell(p.y), cell(p.z)];
        for dx in -1..=1 {
            for dy in -1..=1 {
                for dz in -1..=1 {
                    let near = self.weld.get(&[key[0] + dx, key[1] + dy, key[2] + dz]);
                    let hit = near.and_then(|list| {
                        list.iter()
                            .find(|i| self.solid.points[**i as usize].distance_squared(p) <= self.tolerance.powi(2))
                    });
                    if let Some(i) = hit {
                        return *i;
                    }
                }
            }
        }
        let i = self.solid.points.len() as u32;
        self.solid.points.push(p);
        self.weld.entry(key).or_default().push(i);
        i
    }

    /// A grid of `(nu + 1) x (nv + 1)` points; along u crossed with along v must point outwards. Long grids are cut
    /// into several charts.
    pub fn patch(&mut self, group: u32, nu: usize, nv: usize, f: impl Fn(usize, usize) -> DVec3) {
        self.patch_with_normals(group, nu, nv, |i, j| (f(i, j), DVec3::ZERO));
    }

    /// As [`SolidBuilder::patch`] with known unit normals (zero: computed from the faces of the group).
    pub fn patch_with_normals(&mut self, group: u32, nu: usize, nv: usize, f: impl Fn(usize, usize) -> (DVec3, DVec3)) {
        let grid: Vec<Vec<(DVec3, DVec3)>> = (0..=nu).map(|i| (0..=nv).map(|j| f(i, j)).collect()).collect();
        let step_u = |i: usize| (0..=nv).map(|j| grid[i][j].0.distance(grid[i + 1][j].0)).sum::<f64>();
        let step_v = |j: usize| (0..=nu).map(|i| grid[i][j].0.distance(grid[i][j + 1].0)).sum::<f64>();
        let us = cumulative((0..nu).map(|i| step_u(i) / (nv + 1) as f64));
        let vs = cumulative((0..nv).map(|j| step_v(j) / (nu + 1) as f64));
        let (u_len, v_len) = (us[nu].max(1e-9), vs[nv].max(1e-9));
        for [i0, i1] in cuts(&us, u_len / v_len) {
            for [j0, j1] in cuts(&vs, v_len / u_len) {
                self.grid_chart(group, &grid, (&us, &vs), [i0, i1], [j0, j1]);
            }
        }
    }

    fn grid_chart(
        &mut self,
        group: u32,
        grid: &[Vec<(DVec3, DVec3)>],
        (us, vs): (&[f64], &[f64]),
        [i0, i1]: [usize; 2],
        [j0, j1]: [usize; 2],
    ) {
        let mut chart = Chart::default();
        for i in i0..=i1 {
            for j in j0..=j1 {
                let (p, normal) = grid[i][j];
                let uv = DVec2::new(us[i] - us[i0], vs[j] - vs[j0]);
                let point = self.point(p);
                chart.vertices.push(ChartVertex { point, uv, normal, group });
            }
        }
        let columns = (j1 - j0 + 1) as u32;
        for i in 0..(i1 - i0) as u32 {
            for j in 0..(j1 - j0) as u32 {
                let a = i * columns + j;
                let [b, c, d] = [a + columns, a + columns + 1, a + 1];
                // the shorter diagonal gives the rounder surface
                let at = |k: u32| self.solid.points[chart.vertices[k as usize].point as usize];
                let pair = if at(a).distance_squared(at(c)) <= at(b).distance_squared(at(d)) * (1.0 + 1e-9) {
                    [[a, b, c], [a, c, d]]
                } else {
                    [[a, b, d], [b, c, d]]
                };
                let kept = pair.into_iter().filter(|t| distinct(&chart, *t)).collect::<Vec<_>>();
                chart.triangles.extend(kept);
            }
        }
        if !chart.triangles.is_empty() {
            self.solid.charts.push(chart);
        }
    }

    /// A flat polygon, counter-clockwise seen from the tip of `normal`, triangulated as given.
    pub fn flat(&mut self, outline: &[DVec3], normal: DVec3, triangles: &[[u32; 3]]) {
        let group = self.group();
        let u = normal.any_orthonormal_vector();
        // boxes and boards read best with chart axes along the object's axes
        let u = [DVec3::X, DVec3::Z, DVec3::Y].into_iter().find(|a| a.dot(normal).abs() < 1e-6).unwrap_or(u);
        let v = normal.cross(u);
        let vertices = outline
            .iter()
            .map(|p| ChartVertex { point: self.point(*p), uv: DVec2::new(p.dot(u), p.dot(v)), normal, group })
            .collect();
        let mut chart = Chart { vertices, triangles: triangles.to_vec() };
        let kept: Vec<[u32; 3]> = chart.triangles.iter().copied().filter(|t| distinct(&chart, *t)).collect();
        chart.triangles = kept;
        if !chart.triangles.is_empty() {
            self.solid.charts.push(chart);
        }
    }

    /// A flat convex polygon.
    pub fn flat_convex(&mut self, outline: &[DVec3], normal: DVec3) {
        let n = outline.len() as u32;
        let fan: Vec<[u32; 3]> = (1..n.saturating_sub(1)).map(|k| [0, k, k + 1]).collect();
        self.flat(outline, normal, &fan);
    }

    /// A convex piece for collision.
    pub fn piece(&mut self, points: Vec<DVec3>) {
        self.solid.pieces.push(points);
    }

    /// All points so far as one convex piece.
    pub fn piece_of_all(&mut self) {
        let points = self.solid.points.clone();
        self.solid.pieces.push(points);
    }

    /// Points collected so far.
    pub fn points(&self) -> &[DVec3] {
        &self.solid.points
    }

    /// Moves all points and pieces by `f(lowest, highest, point)`; nothing may be added afterwards.
    pub fn map_points(&mut self, f: impl Fn(DVec3, DVec3, DVec3) -> DVec3) {
        let lo = self.solid.points.iter().fold(DVec3::INFINITY, |a, p| a.min(*p));
        let hi = self.solid.points.iter().fold(DVec3::NEG_INFINITY, |a, p| a.max(*p));
        let pieces = self.solid.pieces.iter_mut().flatten();
        for p in self.solid.points.iter_mut().chain(pieces) {
            *p = f(lo, hi, *p);
        }
    }

    /// Computes missing normals and turns the solid outside out.
    pub fn finish(mut self) -> Solid {
        if self.solid.volume() < 0.0 {
            self.solid.flip_winding();
            for v in self.solid.charts.iter_mut().flat_map(|c| &mut c.vertices) {
                v.normal = -v.normal;
            }
        }
        let mut sums: HashMap<(u32, u32), DVec3> = HashMap::new();
        for chart in &self.solid.charts {
            for t in &chart.triangles {
                let corners = t.map(|i| chart.vertices[i as usize]);
                let p = corners.map(|c| self.solid.points[c.point as usize]);
                let Some(normal) = (p[1] - p[0]).cross(p[2] - p[0]).try_normalize() else { continue };
                for k in 0..3 {
                    let (e, f) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
                    let angle = e.angle_between(f);
                    if angle.is_finite() {
                        *sums.entry((corners[k].point, corners[k].group)).or_default() += normal * angle;
                    }
                }
            }
        }
        for v in self.solid.charts.iter_mut().flat_map(|c| &mut c.vertices) {
            if v.normal == DVec3::ZERO {
                let sum = sums.get(&(v.point, v.group)).copied().unwrap_or(DVec3::Y);
                v.normal = sum.normalize_or(DVec3::Y);
            }
        }
        self.solid
    }
}

fn distinct(chart: &Chart, t: [u32; 3]) -> bool {
    let [a, b, c] = t.map(|i| chart.vertices[i as usize].point);
    a != b && b != c && a != c
}

fn cumulative(steps: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sum = 0.0;
    std::iter::once(0.0)
        .chain(steps.map(|s| {
            sum += s;
            sum
        }))
        .collect()
}

/// Ranges of grid lines so that each piece is at most [`MAX_CHART_ASPECT`] times longer than wide.
fn cuts(lengths: &[f64], aspect: f64) -> Vec<[usize; 2]> {
    let n = lengths.len() - 1;
    let wanted = ((aspect / MAX_CHART_ASPECT).ceil() as usize).clamp(1, MAX_CHART_PIECES.min(n.max(1)));
    let longest_step = lengths.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
    if wanted == 1 || longest_step > 0.7 * lengths[n] {
        return vec![[0, n]]; // nothing gained: one step is most of the length
    }
    let mut out = Vec::with_capacity(wanted);
    let mut start = 0;
    for k in 1..=wanted {
        let goal = lengths[n] * k as f64 / wanted as f64;
        let end = if k == wanted { n } else { (start + 1..n).find(|i| lengths[*i] >= goal - 1e-12).unwrap_or(n) };
        if end > start {
            out.push([start, end]);
            start = end;
        }
    }
    out
}
