//! Points without surfaces, drawn as what they are: a small tetrahedron each.
//!
//! A splat's shape is a cloud; its centre and mean radius are all that is kept here, so that pictures are grainy and
//! distances are those of the centres. Splats that are half transparent or more are left out, as others do for
//! distances.

use glam::Vec3;
use harmony_bench::ply::{PlyFile, grey_or_colored, linear};
use harmony_mesh::{Group, Mesh};

/// Most points drawn; of more, every n-th.
const MOST: usize = 300_000;
/// Least opacity of a splat that is kept.
const OPAQUE: f32 = 0.5;
/// Radius of points that have none, over the longest side of all points.
const POINT: f32 = 0.004;

/// The points as a mesh, and what is to be said about it.
pub fn points_mesh(ply: &PlyFile) -> (Mesh, String) {
    let splat = ply.splats.len() == ply.positions.len() && !ply.splats.is_empty();
    let keep: Vec<usize> = (0..ply.positions.len())
        .filter(|i| ply.positions[*i].is_finite() && (!splat || ply.splats[*i][0] > OPAQUE))
        .collect();
    let step = keep.len().div_ceil(MOST).max(1);
    let (low, high) =
        keep.iter().fold((Vec3::MAX, Vec3::MIN), |(l, h), i| (l.min(ply.positions[*i]), h.max(ply.positions[*i])));
    let side = (high - low).max_element().max(1e-6);
    let mut mesh = Mesh { materials: vec![grey_or_colored(!ply.colors.is_empty())], ..Mesh::default() };
    let mut triangles = Vec::new();
    let corners =
        [Vec3::new(1.0, 1.0, 1.0), Vec3::new(-1.0, -1.0, 1.0), Vec3::new(-1.0, 1.0, -1.0), Vec3::new(1.0, -1.0, -1.0)];
    for i in keep.iter().step_by(step) {
        // A radius of metres is a stray one.
        let radius = if splat { ply.splats[*i][1].clamp(side * 1e-4, side * 0.02) } else { side * POINT };
        let base = mesh.positions.len() as u32;
        for corner in corners {
            mesh.positions.push(ply.positions[*i] + corner * radius);
            mesh.normals.push(corner.normalize());
            mesh.uvs.push(glam::Vec2::ZERO);
            mesh.colors.extend(ply.colors.get(*i).map(|c| c.map(linear)));
        }
        triangles.extend([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|t: [u32; 3]| t.map(|k| base + k)));
    }
    mesh.groups.push(Group { material: 0, triangles });
    let what = if splat { "Gaussian splats by their centres, the opaque ones" } else { "points" };
    (mesh, format!("{what}: {} of {} drawn as small tetrahedra", keep.len().div_ceil(step), ply.positions.len()))
}
