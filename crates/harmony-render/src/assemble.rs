//! Vertex projection and triangle assembly: culling, clipping, snapping and sorting into bands of rows.
//!
//! Vertices snap to 1/256 pixel, and coverage is decided by whole-number edge functions with the top-left rule
//! (Pineda, "A parallel algorithm for polygon rasterization", SIGGRAPH 1988): two triangles that share an edge
//! leave no gap and cover no pixel twice. Clipping (Sutherland and Hodgman, CACM 1974) is done in double precision
//! and only for triangles that reach behind the near plane or far outside the image.

use glam::DVec3;
use rayon::prelude::*;

use crate::prepare::{Draw, Faces, Placed, View};

/// Sub-pixel steps a pixel.
pub(crate) const STEPS: i32 = 256;

/// Raster coordinates beyond this are clipped, pixels; what the fixed-point format holds, less some air.
const GUARD: f32 = 16_000.0;

/// Adding this to a single-precision number leaves its value in 1/256 in the low mantissa bits (the sum lies in
/// 2^15..2^16, where neighbours are 2^-8 apart), rounded to nearest.
const SNAP: f32 = 49_152.0;

/// A vertex in fixed-point raster coordinates; `inverse_depth` is one of the two marks below when it needs clipping.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Projected {
    x: i32,
    y: i32,
    inverse_depth: f32,
}

const BEHIND: f32 = -1.0;
const OUTSIDE: f32 = -2.0;

/// A piece of a triangle that may cover pixels, oriented so that its edge functions are positive inside.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece {
    pub(crate) x: [i32; 3],
    pub(crate) y: [i32; 3],
    pub(crate) inverse_depth: [f32; 3],
    /// Triangle number in the pass.
    pub(crate) triangle: u32,
}

/// How samples lie and how rows are shared out.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layout {
    /// Rows of a band, as a power of two.
    pub(crate) band_shift: u32,
    /// Number of bands.
    pub(crate) bands: usize,
    /// Largest distance of a sample from its pixel centre, in sub-pixel steps.
    pub(crate) spread: i32,
}

/// Projects all vertices into `out`.
pub(crate) fn project(draw: &Draw, out: &mut Vec<Projected>) {
    const CHUNK: usize = 16_384;
    out.resize(draw.vertices, Projected::default());
    let mut jobs = Vec::new();
    let mut rest = out.as_mut_slice();
    for placed in &draw.placed {
        let (mine, other) = rest.split_at_mut(placed.mesh.positions.len());
        rest = other;
        jobs.extend(mine.chunks_mut(CHUNK).enumerate().map(|(i, chunk)| (placed, i * CHUNK, chunk)));
    }
    jobs.into_par_iter().for_each(|(placed, start, chunk)| project_chunk(&draw.view, placed, start, chunk));
}

fn project_chunk(view: &View, placed: &Placed, start: usize, out: &mut [Projected]) {
    // x_raster = (fx X + cx Z) / Z, with the numerator as one affine map of the object's coordinates.
    let (m, t) = (placed.linear.transpose(), placed.translation);
    let rx = (m.x_axis * view.fx + m.z_axis * view.cx).as_vec3();
    let ry = (m.y_axis * view.fy + m.z_axis * view.cy).as_vec3();
    let rz = m.z_axis.as_vec3();
    let (tx, ty, tz) = ((t.x * view.fx + t.z * view.cx) as f32, (t.y * view.fy + t.z * view.cy) as f32, t.z as f32);
    let near = view.near as f32;
    for (o, p) in out.iter_mut().zip(&placed.mesh.positions[start..]) {
        let z = rz.x * p.x + rz.y * p.y + rz.z * p.z + tz;
        let inverse = 1.0 / z;
        let x = (rx.x * p.x + rx.y * p.y + rx.z * p.z + tx) * inverse;
        let y = (ry.x * p.x + ry.y * p.y + ry.z * p.z + ty) * inverse;
        // Comparisons are false for NaN, so such a vertex is marked outside and dropped when it is clipped.
        let mark = if z < near {
            BEHIND
        } else if x.abs() <= GUARD && y.abs() <= GUARD {
            inverse
        } else {
            OUTSIDE
        };
        *o = Projected { x: snap(x), y: snap(y), inverse_depth: mark };
    }
}

#[inline]
fn snap(v: f32) -> i32 {
    ((v + SNAP).to_bits() as i32).wrapping_sub(SNAP.to_bits() as i32)
}

/// Sorts the pieces of triangles `from..to` into bands, in triangle order.
pub(crate) fn assemble(
    draw: &Draw,
    vertices: &[Projected],
    from: u32,
    to: u32,
    layout: Layout,
    bands: &mut [Vec<Piece>],
) {
    let mut out = Output::new(&draw.view, layout, bands);
    let mut run = draw.run_of(from, 0);
    let mut triangle = from;
    while triangle < to {
        let r = &draw.runs[run];
        let placed = &draw.placed[r.placed];
        let mine = &vertices[placed.first_vertex..placed.first_vertex + placed.mesh.positions.len()];
        let skip = (triangle - r.first) as usize;
        let take = ((to - triangle) as usize).min(r.triangles.len() - skip);
        for t in &r.triangles[skip..skip + take] {
            let i = [t[0] as usize, t[1] as usize, t[2] as usize];
            if let (Some(a), Some(b), Some(c)) = (mine.get(i[0]), mine.get(i[1]), mine.get(i[2])) {
                let v = [*a, *b, *c];
                if a.inverse_depth > 0.0 && b.inverse_depth > 0.0 && c.inverse_depth > 0.0 {
                    out.add(v, r.faces, triangle);
                } else if !v.iter().all(|v| v.inverse_depth == BEHIND) {
                    let corners = i.map(|i| placed.mesh.positions[i].as_dvec3());
                    clip(&draw.view, placed, corners, v, |piece| out.add_clipped(piece, r.faces, triangle));
                }
            }
            triangle += 1;
        }
        run += 1;
    }
}

/// Where pieces go: the window and its bands.
struct Output<'b> {
    x: [i32; 2],
    y: [i32; 2],
    layout: Layout,
    bands: &'b mut [Vec<Piece>],
}

impl<'b> Output<'b> {
    fn new(view: &View, layout: Layout, bands: &'b mut [Vec<Piece>]) -> Self {
        let w = view.window;
        let range = |start: u32, n: u32| [start as i32, (start as i32).saturating_add(n as i32) - 1];
        Self { x: range(w.x0, w.size.width), y: range(w.y0, w.size.height), layout, bands }
    }

    #[expect(
        clippy::inline_always,
        reason = "runs for each triangle of the scene, from one hot place: 10 % of a frame"
    )]
    #[inline(always)]
    fn add(&mut self, v: [Projected; 3], faces: Faces, triangle: u32) {
        let [a, b, c] = v;
        let spread = self.layout.spread;
        let left = first_pixel(a.x.min(b.x).min(c.x) - spread).max(self.x[0]);
        let right = last_pixel(a.x.max(b.x).max(c.x) + spread).min(self.x[1]);
        let top = first_pixel(a.y.min(b.y).min(c.y) - spread).max(self.y[0]);
        let bottom = last_pixel(a.y.max(b.y).max(c.y) + spread).min(self.y[1]);
        if left > right || top > bottom {
            return;
        }
        let area = i64::from(b.x - a.x) * i64::from(c.y - a.y) - i64::from(c.x - a.x) * i64::from(b.y - a.y);
        // With y down, a counter-clockwise triangle has a negative area.
        let drawn = match faces {
            Faces::Front => area < 0,
            Faces::Mirrored => area > 0,
            Faces::Both => area != 0,
        };
        if !drawn {
            return;
        }
        let (b, c) = if area < 0 { (c, b) } else { (b, c) };
        if left == right && top == bottom && spread == 0 {
            let (px, py) = (left * STEPS, top * STEPS);
            if outside(a, b, px, py) || outside(b, c, px, py) || outside(c, a, px, py) {
                return;
            }
        }
        let piece = Piece {
            x: [a.x, b.x, c.x],
            y: [a.y, b.y, c.y],
            inverse_depth: [a.inverse_depth, b.inverse_depth, c.inverse_depth],
            triangle,
        };
        let band = |row: i32| (row - self.y[0]) as usize >> self.layout.band_shift;
        let (first, last) = (band(top), band(bottom));
        for b in &mut self.bands[first..=last] {
            b.push(piece);
        }
    }
}

impl Output<'_> {
    #[cold]
    fn add_clipped(&mut self, v: [Projected; 3], faces: Faces, triangle: u32) {
        self.add(v, faces, triangle);
    }
}

/// First pixel whose centre is at or after a fixed-point coordinate.
#[inline]
pub(crate) fn first_pixel(v: i32) -> i32 {
    (v + STEPS - 1) >> 8
}

/// Last pixel whose centre is at or before a fixed-point coordinate.
#[inline]
pub(crate) fn last_pixel(v: i32) -> i32 {
    v >> 8
}

#[inline]
fn outside(a: Projected, b: Projected, px: i32, py: i32) -> bool {
    let (dx, dy) = (b.x - a.x, b.y - a.y);
    let e = i64::from(dx) * i64::from(py - a.y) - i64::from(dy) * i64::from(px - a.x);
    e < i64::from(edge_bias(dx, dy))
}

/// Least value of an edge function that counts as inside: 0 on top and left edges, 1 on the others.
#[inline]
pub(crate) fn edge_bias(dx: i32, dy: i32) -> i32 {
    i32::from(!(dy < 0 || (dy == 0 && dx > 0)))
}

/// A corner during clipping: camera coordinates, and the projection if it is an unclipped vertex.
#[derive(Clone, Copy)]
struct Corner {
    p: DVec3,
    projected: Option<Projected>,
}

/// Clips a triangle against the near plane and the guard band and hands out the pieces as a fan.
fn clip(
    view: &View,
    placed: &Placed,
    corners: [DVec3; 3],
    projected: [Projected; 3],
    mut piece: impl FnMut([Projected; 3]),
) {
    let mut polygon: Vec<Corner> = corners
        .iter()
        .zip(projected)
        .map(|(c, v)| Corner {
            p: placed.linear * *c + placed.translation,
            projected: (v.inverse_depth > 0.0).then_some(v),
        })
        .collect();
    if !polygon.iter().all(|c| c.p.is_finite()) {
        return;
    }
    let guard = f64::from(GUARD);
    let planes = [
        (DVec3::Z, -view.near),
        (DVec3::new(-view.fx, 0.0, guard - view.cx), 0.0),
        (DVec3::new(view.fx, 0.0, guard + view.cx), 0.0),
        (DVec3::new(0.0, -view.fy, guard - view.cy), 0.0),
        (DVec3::new(0.0, view.fy, guard + view.cy), 0.0),
    ];
    for (normal, offset) in planes {
        polygon = cut(&polygon, normal, offset);
        if polygon.len() < 3 {
            return;
        }
    }
    let fan: Vec<Projected> = polygon.iter().map(|c| c.projected.unwrap_or_else(|| project_one(view, c.p))).collect();
    for i in 1..fan.len() - 1 {
        piece([fan[0], fan[i], fan[i + 1]]);
    }
}

/// The part of a polygon where `normal . p + offset >= 0`.
fn cut(polygon: &[Corner], normal: DVec3, offset: f64) -> Vec<Corner> {
    // A vertex that the fast path accepted is inside by definition, whatever the rounding says here.
    let side = |c: &Corner| if c.projected.is_some() { f64::MAX } else { normal.dot(c.p) + offset };
    let mut out = Vec::with_capacity(polygon.len() + 1);
    for (i, a) in polygon.iter().enumerate() {
        let b = &polygon[(i + 1) % polygon.len()];
        let (sa, sb) = (side(a), side(b));
        if sa >= 0.0 {
            out.push(*a);
        }
        if (sa >= 0.0) != (sb >= 0.0) {
            // Always from the inside corner, so that a neighbour that shares the edge finds the same point.
            let (from, to) = if sa >= 0.0 { (a.p, b.p) } else { (b.p, a.p) };
            let (sf, st) = (normal.dot(from) + offset, normal.dot(to) + offset);
            let k = (sf / (sf - st)).clamp(0.0, 1.0);
            out.push(Corner { p: from + (to - from) * k, projected: None });
        }
    }
    out
}

fn project_one(view: &View, p: DVec3) -> Projected {
    let z = p.z.max(view.near);
    let guard = f64::from(GUARD) + 1.0;
    let fix = |v: f64| (v.clamp(-guard, guard) * f64::from(STEPS)).round() as i32;
    Projected {
        x: fix(view.fx * p.x / z + view.cx),
        y: fix(view.fy * p.y / z + view.cy),
        inverse_depth: (1.0 / z) as f32,
    }
}
