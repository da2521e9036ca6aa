//! Depth of one mesh in a small window, for the inner loop of placement.
//!
//! Placement draws thousands of windows of some 128 pixels; this pass does nothing but the depth of one posed mesh
//! into a buffer that it is given. Everything that a person or a model looks at comes from `harmony_render`.

use std::cell::RefCell;
use std::ops::Range;

use glam::DVec3;
use harmony_scene::{Camera, Pose};

use crate::observe::proxy::Proxy;

/// Nearest depth that is drawn, metres.
pub(crate) const NEAR: f64 = 0.05;

/// Pixels of a row that are drawn at a time.
const LANES: usize = 4;

/// A corner in the window: column, row, and inverse depth (which is linear in the window).
type Corner = [f32; 3];

/// Columns and rows of a window, half open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Span {
    pub(crate) x: [usize; 2],
    pub(crate) y: [usize; 2],
}

/// Buffers of one thread, so that a render allocates nothing.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Vertices in the camera's frame.
    pub(crate) points: Vec<DVec3>,
    corners: Vec<Corner>,
    /// Planar depth, 0 = nothing; a few unused ones follow the last row.
    pub(crate) depth: Vec<f32>,
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// Lends this thread's buffers; `work` must not draw by itself.
pub(crate) fn with_scratch<T>(work: impl FnOnce(&mut Scratch) -> T) -> T {
    SCRATCH.with_borrow_mut(work)
}

/// Vertices of a posed mesh in the camera's frame.
pub(crate) fn to_camera(camera: &Camera, proxy: &Proxy, pose: &Pose, points: &mut Vec<DVec3>) {
    let linear = camera.rotation * pose.linear();
    let offset = camera.to_camera(pose.position);
    points.clear();
    points.extend(proxy.points.iter().map(|p| linear * p.as_dvec3() + offset));
}

/// Draws a posed mesh into a depth buffer (planar depth in metres, 0 = nothing; row-major, `camera.size`).
///
/// A pixel is covered when its centre is; both sides of a triangle are drawn.
pub(crate) fn rasterise(camera: &Camera, proxy: &Proxy, pose: &Pose, depth: &mut [f32]) {
    with_scratch(|scratch| {
        let span = scratch.draw_alone(camera, proxy, pose);
        for row in span.rows(camera.size.width as usize) {
            for (z, near) in depth[row.clone()].iter_mut().zip(&scratch.depth[row]) {
                *z = if *near > 0.0 && (*z == 0.0 || near < z) { *near } else { *z };
            }
        }
    });
}

impl Scratch {
    /// Draws a posed mesh alone into [`Scratch::depth`]; outside of the span nothing is drawn.
    pub(crate) fn draw_alone(&mut self, camera: &Camera, proxy: &Proxy, pose: &Pose) -> Span {
        self.depth.clear();
        self.depth.resize(camera.size.pixels() + LANES, 0.0);
        to_camera(camera, proxy, pose, &mut self.points);
        let span = draw(camera, proxy, &self.points, &mut self.corners, &mut self.depth);
        for row in span.rows(camera.size.width as usize) {
            for z in &mut self.depth[row] {
                let depth = 1.0 / *z;
                *z = if *z > 0.0 { depth } else { 0.0 };
            }
        }
        span
    }
}

impl Span {
    /// Where its rows lie in an image of that width.
    pub(crate) fn rows(self, width: usize) -> impl Iterator<Item = Range<usize>> {
        let Self { x, y } = self;
        (y[0]..y[1].max(y[0])).map(move |row| row * width + x[0]..row * width + x[1].max(x[0]))
    }
}

/// Draws a mesh whose vertices are in the camera's frame, as inverse depth: that is linear in the window, so that no
/// pixel of a triangle costs a division.
fn draw(camera: &Camera, proxy: &Proxy, points: &[DVec3], corners: &mut Vec<Corner>, inverse: &mut [f32]) -> Span {
    let k = camera.intrinsics;
    let corner = |c: DVec3| -> Corner {
        [(k.fx * c.x / c.z + k.cx) as f32, (k.fy * c.y / c.z + k.cy) as f32, (1.0 / c.z) as f32]
    };
    let (w, h) = (camera.size.width as usize, camera.size.height as usize);
    let (mut low, mut high, mut cut) = ([f32::MAX; 2], [f32::MIN; 2], false);
    corners.clear();
    corners.extend(points.iter().map(|c| {
        if c.z <= NEAR {
            cut = true;
            return [0.0; 3];
        }
        let corner = corner(*c);
        for i in 0..2 {
            low[i] = low[i].min(corner[i]);
            high[i] = high[i].max(corner[i]);
        }
        corner
    }));
    if cut {
        for t in &proxy.triangles {
            let corner_points = t.map(|i| points[i as usize]);
            if corner_points.iter().all(|p| p.z > NEAR) {
                fill::<false>(inverse, w, h, t.map(|i| corners[i as usize]));
                continue;
            }
            let polygon: Vec<Corner> = clip(corner_points).into_iter().map(corner).collect();
            for i in 2..polygon.len() {
                fill::<false>(inverse, w, h, [polygon[0], polygon[i - 1], polygon[i]]);
            }
        }
        return Span { x: [0, w], y: [0, h] };
    }
    let (closed, open) = proxy.triangles.split_at(proxy.closed);
    for t in closed {
        fill::<true>(inverse, w, h, t.map(|i| corners[i as usize]));
    }
    for t in open {
        fill::<false>(inverse, w, h, t.map(|i| corners[i as usize]));
    }
    let [x, y] = [(0, w), (1, h)].map(|(i, most)| [(first(low[i])).min(most), (last(high[i])).min(most)]);
    Span { x, y }
}

/// The part of a triangle before the near plane.
pub(crate) fn clip(triangle: [DVec3; 3]) -> Vec<DVec3> {
    let mut out = Vec::with_capacity(4);
    for i in 0..3 {
        let (p, q) = (triangle[i], triangle[(i + 1) % 3]);
        if p.z > NEAR {
            out.push(p);
        }
        if (p.z > NEAR) != (q.z > NEAR) {
            let mut cut = p + (q - p) * ((NEAR - p.z) / (q.z - p.z));
            cut.z = NEAR;
            out.push(cut);
        }
    }
    out
}

/// Draws a triangle; with `FACING` only when it looks at the camera, which makes its area in the window negative (the
/// window's second axis points down).
///
/// Pixels go [`LANES`] at a time, the last of a row together with what follows them, which stays as it is.
#[expect(clippy::inline_always, reason = "three of four triangles are refused at once: they must not cost a call")]
#[expect(clippy::needless_bitwise_bool, reason = "without branches the lanes go together")]
#[inline(always)]
fn fill<const FACING: bool>(inverse: &mut [f32], w: usize, h: usize, [a, b, c]: [Corner; 3]) {
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if area.is_nan() || area.abs() <= 1e-12 || (FACING && area > 0.0) {
        return;
    }
    // Unlike `min` and `max` these are one instruction; a corner that is no number made the area none.
    let low = |i: usize| if a[i] < b[i] { a[i] } else { b[i] };
    let low = |i: usize| if low(i) < c[i] { low(i) } else { c[i] };
    let high = |i: usize| if a[i] > b[i] { a[i] } else { b[i] };
    let high = |i: usize| if high(i) > c[i] { high(i) } else { c[i] };
    let (x0, y0) = (first(low(0)), first(low(1)));
    let (x1, y1) = (last(high(0)).min(w), last(high(1)).min(h));
    if x0 >= x1 || y0 >= y1 {
        return;
    }
    let inv = 1.0 / area;
    // Barycentric weights of b and c: their steps along a row and from row to row.
    let (ux, uy) = ((c[1] - a[1]) * inv, -(c[0] - a[0]) * inv);
    let (vx, vy) = (-(b[1] - a[1]) * inv, (b[0] - a[0]) * inv);
    let (db, dc) = (b[2] - a[2], c[2] - a[2]);
    let n = (x1 - x0).next_multiple_of(LANES);
    let right = w as f32 - a[0];
    let begin: [f32; LANES] = std::array::from_fn(|k| (x0 + k) as f32 + 0.5 - a[0]);
    for y in y0..y1 {
        let py = y as f32 + 0.5 - a[1];
        let (u0, v0) = (py * uy, py * vy);
        let mut px = begin;
        for nearest in inverse[y * w + x0..y * w + x0 + n].as_chunks_mut::<LANES>().0 {
            for (px, nearest) in px.iter_mut().zip(nearest) {
                let (u, v) = (u0 + *px * ux, v0 + *px * vx);
                let here = a[2] + u * db + v * dc;
                // Without branches, so that the lanes go together.
                let inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (*px < right);
                *nearest = if inside & (here > *nearest) { here } else { *nearest };
                *px += LANES as f32;
            }
        }
    }
}

/// The first column (row) whose centre is not before a position: `ceil(v - 0.5)` without a call. `as` saturates, so
/// that far-off corners are safe.
fn first(v: f32) -> usize {
    let v = v - 0.5;
    let whole = v as i32;
    whole.saturating_add(i32::from(v > whole as f32)).max(0) as usize
}

/// One past the last column (row) whose centre is not beyond a position: `floor(v - 0.5) + 1`.
fn last(v: f32) -> usize {
    let v = v - 0.5;
    let whole = v as i32;
    whole.saturating_sub(i32::from(v < whole as f32)).saturating_add(1).max(0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::box_mesh;
    use harmony_mesh::{Group, Material, Mesh};
    use harmony_scene::{ImageSize, Intrinsics, Vec3};

    fn floor() -> Proxy {
        let mut mesh = Mesh {
            metric_uvs: Vec::new(),
            colors: Vec::new(),
            positions: [[-9.0, 0.0, -9.0], [9.0, 0.0, -9.0], [9.0, 0.0, 9.0], [-9.0, 0.0, 9.0]]
                .map(glam::Vec3::from)
                .to_vec(),
            uvs: vec![glam::Vec2::ZERO; 4],
            groups: vec![Group { material: 0, triangles: vec![[0, 2, 1], [0, 3, 2]] }],
            materials: vec![Material::plain("floor", [0.5; 3])],
            normals: Vec::new(),
        };
        mesh.recompute_normals();
        Proxy::new(&mesh)
    }

    #[test]
    fn first_and_last_pixels_are_those_of_ceil_and_floor() {
        let far = [f32::INFINITY, f32::NEG_INFINITY, 3e9, -3e9, f32::MAX, f32::MIN, 1e-30];
        for v in far.into_iter().chain((-4000..4000).map(|i| i as f32 / 64.0)) {
            assert_eq!(first(v).min(999), ((v - 0.5).ceil().max(0.0) as usize).min(999), "{v}");
            assert_eq!(last(v).min(999), (((v - 0.5).floor() + 1.0).max(0.0) as usize).min(999), "{v}");
        }
    }

    #[test]
    fn a_mesh_alone_is_drawn_within_its_span() {
        let size = ImageSize::new(80, 60);
        let lens = Intrinsics::from_horizontal_fov(size, 1.0);
        let camera = Camera::looking(size, lens, Vec3::new(0.0, 4.0, 3.0), Vec3::new(0.0, -1.0, -0.6));
        let small = Pose::new(Vec3::new(0.4, 0.0, 0.2), 0.3, 0.06);
        let mut scratch = Scratch::default();
        let mut all = vec![0.0; size.pixels()];
        // The second drawing must not show anything of the first.
        for pose in [Pose::new(Vec3::ZERO, 0.0, 1.0), small] {
            let span = scratch.draw_alone(&camera, &floor(), &pose);
            all.fill(0.0);
            rasterise(&camera, &floor(), &pose, &mut all);
            assert_eq!(scratch.depth[..all.len()], all);
            let inside =
                |i: usize| (span.x[0]..span.x[1]).contains(&(i % 80)) && (span.y[0]..span.y[1]).contains(&(i / 80));
            assert!((0..all.len()).all(|i| all[i] == 0.0 || inside(i)), "{span:?}");
        }
        assert!(all.iter().filter(|z| **z > 0.0).count() > 20);
    }

    #[test]
    fn a_floor_through_the_camera_is_clipped_and_has_the_depth_of_its_rays() {
        let size = ImageSize::new(64, 48);
        let lens = Intrinsics::from_horizontal_fov(size, 1.2);
        let camera = Camera::looking(size, lens, Vec3::new(0.3, 1.5, 2.0), Vec3::new(0.1, -0.2, -1.0));
        let mut depth = vec![0.0; size.pixels()];
        rasterise(&camera, &floor(), &Pose::new(Vec3::ZERO, 0.0, 1.0), &mut depth);
        let mut drawn = 0;
        for y in 0..size.height {
            for x in 0..size.width {
                let ray = camera.ray(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
                let z = depth[(y * size.width + x) as usize];
                if ray.direction.y >= -0.15 {
                    continue;
                }
                let hit = ray.at(-ray.origin.y / ray.direction.y);
                let want = camera.depth(hit);
                assert!((f64::from(z) - want).abs() <= 1e-3 * want, "{x},{y}: {z} for {want}");
                drawn += 1;
            }
        }
        assert!(drawn > 1000);
    }

    #[test]
    fn what_looks_away_is_hidden_by_what_faces_the_camera() {
        let size = ImageSize::new(96, 72);
        let lens = Intrinsics::from_horizontal_fov(size, 1.1);
        let camera = Camera::looking(size, lens, Vec3::new(0.5, 1.7, 3.0), Vec3::new(-0.1, -0.4, -1.0));
        let closed = Proxy::new(&box_mesh(Vec3::new(0.8, 0.6, 0.5)));
        let both_sides = Proxy { closed: 0, ..closed.clone() };
        assert_eq!(closed.closed, 12);
        let (mut one, mut two) = (Scratch::default(), Scratch::default());
        for k in 0..40 {
            let at = Vec3::new(-1.0 + 0.05 * f64::from(k), 0.02 * f64::from(k), 0.04 * f64::from(k));
            let pose = Pose::new(at, 0.3 * f64::from(k), 0.6 + 0.05 * f64::from(k));
            one.draw_alone(&camera, &closed, &pose);
            two.draw_alone(&camera, &both_sides, &pose);
            let drawn = one.depth.iter().filter(|z| **z > 0.0).count();
            assert!(drawn > 50, "{k}: {drawn}");
            // A pixel on an edge may fall between two triangles of either.
            let other = one.depth.iter().zip(&two.depth).filter(|(a, b)| (*a - *b).abs() > 1e-4).count();
            assert!(other <= 1, "{k}: {other} of {drawn}");
        }
    }
}
