//! Depth of one mesh in a small window, for the inner loop of placement.
//!
//! Placement draws thousands of windows of some 128 pixels; this pass does nothing but the depth of one posed mesh
//! into a buffer that it is given. Everything that a person or a model looks at comes from `harmony_render`.

use std::cell::RefCell;

use glam::{DVec2, DVec3};
use harmony_mesh::Mesh;
use harmony_scene::{Camera, Pose};

/// Nearest depth that is drawn, metres.
pub(crate) const NEAR: f64 = 0.05;

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
    /// Vertices in pixels of an image, and on which sides of a box they are.
    pub(crate) pixels: Vec<DVec2>,
    pub(crate) sides: Vec<u8>,
    /// Planar depth, 0 = nothing.
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
pub(crate) fn to_camera(camera: &Camera, mesh: &Mesh, pose: &Pose, points: &mut Vec<DVec3>) {
    let linear = camera.rotation * pose.linear();
    let offset = camera.to_camera(pose.position);
    points.clear();
    points.extend(mesh.positions.iter().map(|p| linear * p.as_dvec3() + offset));
}

/// Draws a posed mesh into a depth buffer (planar depth in metres, 0 = nothing; row-major, `camera.size`).
///
/// A pixel is covered when its centre is; both sides of a triangle are drawn.
pub(crate) fn rasterise(camera: &Camera, mesh: &Mesh, pose: &Pose, depth: &mut [f32]) {
    with_scratch(|scratch| {
        to_camera(camera, mesh, pose, &mut scratch.points);
        draw(camera, mesh, &scratch.points, &mut scratch.corners, depth);
    });
}

impl Scratch {
    /// Draws a posed mesh alone into [`Scratch::depth`]; outside of the span nothing is drawn.
    pub(crate) fn draw_alone(&mut self, camera: &Camera, mesh: &Mesh, pose: &Pose) -> Span {
        self.depth.clear();
        self.depth.resize(camera.size.pixels(), 0.0);
        to_camera(camera, mesh, pose, &mut self.points);
        draw(camera, mesh, &self.points, &mut self.corners, &mut self.depth)
    }
}

/// Draws a mesh whose vertices are in the camera's frame.
fn draw(camera: &Camera, mesh: &Mesh, points: &[DVec3], corners: &mut Vec<Corner>, depth: &mut [f32]) -> Span {
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
    for t in mesh.groups.iter().flat_map(|g| &g.triangles) {
        let [a, b, c] = t.map(|i| i as usize);
        if a >= points.len() || b >= points.len() || c >= points.len() {
            continue;
        }
        if !cut || [a, b, c].iter().all(|i| points[*i].z > NEAR) {
            fill(depth, w, h, corners[a], corners[b], corners[c]);
        } else if [a, b, c].iter().any(|i| points[*i].z > NEAR) {
            let polygon = clip([points[a], points[b], points[c]]);
            let polygon: Vec<Corner> = polygon.into_iter().map(corner).collect();
            for i in 2..polygon.len() {
                fill(depth, w, h, polygon[0], polygon[i - 1], polygon[i]);
            }
        }
    }
    if cut {
        return Span { x: [0, w], y: [0, h] };
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

#[expect(clippy::needless_bitwise_bool, reason = "without branches several pixels go at a time")]
fn fill(depth: &mut [f32], w: usize, h: usize, a: Corner, b: Corner, c: Corner) {
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if area.is_nan() || area.abs() <= 1e-12 {
        return;
    }
    let low = |i: usize| a[i].min(b[i]).min(c[i]);
    let high = |i: usize| a[i].max(b[i]).max(c[i]);
    let (x0, y0) = (first(low(0)), first(low(1)));
    let (x1, y1) = (last(high(0)).min(w), last(high(1)).min(h));
    if x0 >= x1 || y0 >= y1 {
        return;
    }
    let inv = 1.0 / area;
    // Barycentric weights of b and c, and their steps along a row.
    let (bx, by) = ((c[1] - a[1]) * inv, -(c[0] - a[0]) * inv);
    let (cx, cy) = (-(b[1] - a[1]) * inv, (b[0] - a[0]) * inv);
    for y in y0..y1 {
        let py = y as f32 + 0.5 - a[1];
        let row = &mut depth[y * w..(y + 1) * w];
        for (x, z) in (x0 as i32..).zip(&mut row[x0..x1]) {
            let px = x as f32 + 0.5 - a[0];
            let (u, v) = (px * bx + py * by, px * cx + py * cy);
            // Without branches, so that several pixels go at a time.
            let near = 1.0 / (a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]));
            let inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0);
            let nearer = inside & (near > 0.0) & ((*z == 0.0) | (near < *z));
            *z = if nearer { near } else { *z };
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
    use harmony_mesh::{Group, Material};
    use harmony_scene::{ImageSize, Intrinsics, Vec3};

    fn floor() -> Mesh {
        let mut mesh = Mesh {
            positions: [[-9.0, 0.0, -9.0], [9.0, 0.0, -9.0], [9.0, 0.0, 9.0], [-9.0, 0.0, 9.0]]
                .map(glam::Vec3::from)
                .to_vec(),
            uvs: vec![glam::Vec2::ZERO; 4],
            groups: vec![Group { material: 0, triangles: vec![[0, 2, 1], [0, 3, 2]] }],
            materials: vec![Material::plain("floor", [0.5; 3])],
            normals: Vec::new(),
        };
        mesh.recompute_normals();
        mesh
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
            assert_eq!(scratch.depth, all);
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
}
