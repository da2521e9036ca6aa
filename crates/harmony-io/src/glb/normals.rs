//! Normals for meshes that come without: smooth over gentle bends, sharp over creases; tangents for normal maps.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3, Vec4};
use harmony_mesh::Mesh;

/// Faces that meet at a larger angle are shaded apart, degrees.
const CREASE_DEG: f32 = 40.0;

/// A normal of length one; `None` for one without a direction.
///
/// What has that length within rounding stays to the bit: dividing by a length once more would change last places, and a
/// file that is read and written again has to be the same file.
pub(super) fn unit(normal: Vec3) -> Option<Vec3> {
    if normal.is_normalized() { Some(normal) } else { normal.try_normalize() }
}

/// The mesh with normals; vertices on creases are doubled. Faces are joined where they share a vertex *position*, for
/// files without normals often repeat their vertices.
pub(super) fn creased(mesh: &Mesh) -> Mesh {
    let triangles: Vec<[u32; 3]> = mesh.triangles().collect();
    let mut place: BTreeMap<[u32; 3], u32> = BTreeMap::new();
    let corner: Vec<u32> = mesh
        .positions
        .iter()
        .map(|p| {
            let next = place.len() as u32;
            *place.entry((*p + 0.0).to_array().map(f32::to_bits)).or_insert(next)
        })
        .collect();
    let face: Vec<Vec3> = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            (b - a).cross(c - a)
        })
        .collect();
    let unit: Vec<Vec3> = face.iter().map(|n| n.normalize_or_zero()).collect();
    let mut around: Vec<Vec<u32>> = vec![Vec::new(); place.len()];
    for (f, t) in triangles.iter().enumerate() {
        for i in t {
            around[corner[*i as usize] as usize].push(f as u32);
        }
    }
    let limit = CREASE_DEG.to_radians().cos();
    let mut out = Mesh { materials: mesh.materials.clone(), ..Mesh::default() };
    let mut made: BTreeMap<(u32, [i32; 3]), u32> = BTreeMap::new();
    let mut f = 0;
    for group in &mesh.groups {
        let mut copied = Vec::with_capacity(group.triangles.len());
        for t in &group.triangles {
            let own = unit[f];
            copied.push(t.map(|i| {
                // Fans of thousands of faces around one point are averaged over the first of them only.
                let near = around[corner[i as usize] as usize].iter().take(64);
                let sum: Vec3 = near.filter(|g| unit[**g as usize].dot(own) >= limit).map(|g| face[*g as usize]).sum();
                let normal = sum.try_normalize().unwrap_or(if own == Vec3::ZERO { Vec3::Y } else { own });
                let key = (i, (normal * 1000.0).round().as_ivec3().to_array());
                *made.entry(key).or_insert_with(|| {
                    out.positions.push(mesh.positions[i as usize]);
                    out.uvs.push(mesh.uvs[i as usize]);
                    out.metric_uvs.extend(mesh.metric_uvs.get(i as usize));
                    out.colors.extend(mesh.colors.get(i as usize));
                    out.normals.push(normal);
                    out.positions.len() as u32 - 1
                })
            }));
            f += 1;
        }
        out.groups.push(harmony_mesh::Group { material: group.material, triangles: copied });
    }
    out
}

/// Tangents as glTF has them: xyz along growing u, w the side of `cross(normal, tangent)` on which the image's top lies
/// (against v). Means over the triangles at a vertex, weighted by area; without one, any direction in the surface.
pub(super) fn tangents(positions: &[Vec3], normals: &[Vec3], uvs: &[Vec2], indices: &[u32]) -> Vec<Vec4> {
    let mut sums = vec![(Vec3::ZERO, Vec3::ZERO); positions.len()];
    for t in indices.chunks_exact(3) {
        let [a, b, c] = [t[0] as usize, t[1] as usize, t[2] as usize];
        let (e, f) = (positions[b] - positions[a], positions[c] - positions[a]);
        let (p, q) = (uvs[b] - uvs[a], uvs[c] - uvs[a]);
        let det = p.x * q.y - q.x * p.y;
        let area = e.cross(f).length();
        if !(det.abs() > 1e-12 && area.is_finite()) {
            continue;
        }
        let unit = |v: Vec3| v.normalize_or_zero() * area;
        let (u, up) = (unit((e * q.y - f * p.y) / det), unit((e * q.x - f * p.x) / det));
        for i in [a, b, c] {
            sums[i].0 += u;
            sums[i].1 += up;
        }
    }
    let of = |(n, (u, up)): (&Vec3, (Vec3, Vec3))| {
        let flat = (u - *n * n.dot(u)).try_normalize();
        let tangent = flat.unwrap_or_else(|| n.any_orthonormal_vector());
        tangent.extend(if n.cross(tangent).dot(up) < 0.0 { -1.0 } else { 1.0 })
    };
    normals.iter().zip(sums).map(of).collect()
}
