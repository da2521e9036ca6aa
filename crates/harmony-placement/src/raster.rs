//! Depth of one mesh in a small window, for the inner loop of placement.
//!
//! Placement draws thousands of windows of some 128 pixels; this pass does nothing but the depth of one posed mesh
//! into a buffer that it is given. Everything that a person or a model looks at comes from `harmony_render`.

use glam::DVec3;
use harmony_mesh::Mesh;
use harmony_scene::{Camera, Pose};

/// Nearest depth that is drawn, metres.
pub(crate) const NEAR: f64 = 0.05;

/// A corner in the window: column, row, and inverse depth (which is linear in the window).
type Corner = [f32; 3];

/// Draws a posed mesh into a depth buffer (planar depth in metres, 0 = nothing; row-major, `camera.size`).
///
/// A pixel is covered when its centre is; both sides of a triangle are drawn.
pub(crate) fn rasterise(camera: &Camera, mesh: &Mesh, pose: &Pose, depth: &mut [f32]) {
    let linear = camera.rotation * pose.linear();
    let offset = camera.to_camera(pose.position);
    let points: Vec<DVec3> = mesh.positions.iter().map(|p| linear * p.as_dvec3() + offset).collect();
    let k = camera.intrinsics;
    let corner = |c: DVec3| -> Corner {
        [(k.fx * c.x / c.z + k.cx) as f32, (k.fy * c.y / c.z + k.cy) as f32, (1.0 / c.z) as f32]
    };
    let corners: Vec<Corner> = points.iter().map(|c| if c.z > NEAR { corner(*c) } else { [0.0; 3] }).collect();
    let (w, h) = (camera.size.width as usize, camera.size.height as usize);
    for t in mesh.triangles() {
        let [a, b, c] = t.map(|i| i as usize);
        if a >= points.len() || b >= points.len() || c >= points.len() {
            continue;
        }
        let front = [points[a].z > NEAR, points[b].z > NEAR, points[c].z > NEAR];
        if front == [true; 3] {
            fill(depth, w, h, corners[a], corners[b], corners[c]);
        } else if front != [false; 3] {
            let polygon = clip([points[a], points[b], points[c]]);
            let polygon: Vec<Corner> = polygon.into_iter().map(corner).collect();
            for i in 2..polygon.len() {
                fill(depth, w, h, polygon[0], polygon[i - 1], polygon[i]);
            }
        }
    }
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

fn fill(depth: &mut [f32], w: usize, h: usize, a: Corner, b: Corner, c: Corner) {
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if area.is_nan() || area.abs() <= 1e-12 {
        return;
    }
    let low = |i: usize| a[i].min(b[i]).min(c[i]);
    let high = |i: usize| a[i].max(b[i]).max(c[i]);
    // `as` saturates, so that far-off corners are safe.
    let x0 = (low(0) - 0.5).ceil().max(0.0) as usize;
    let x1 = ((high(0) - 0.5).floor() + 1.0).max(0.0) as usize;
    let y0 = (low(1) - 0.5).ceil().max(0.0) as usize;
    let y1 = ((high(1) - 0.5).floor() + 1.0).max(0.0) as usize;
    let (x1, y1) = (x1.min(w), y1.min(h));
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
        for (x, z) in row.iter_mut().enumerate().take(x1).skip(x0) {
            let px = x as f32 + 0.5 - a[0];
            let (u, v) = (px * bx + py * by, px * cx + py * cy);
            if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
                let near = 1.0 / (a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]));
                if near > 0.0 && (*z == 0.0 || near < *z) {
                    *z = near;
                }
            }
        }
    }
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
