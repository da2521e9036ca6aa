//! Canonical geometry of an object, prepared for many renders and distance queries.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use harmony_mesh::{Bounds, Bvh, ConvexPart, Group, Mesh};
use harmony_scene::Vec3;

/// Meshes up to this many triangles are compared as they are; larger ones through a proxy.
const PROXY_TRIANGLES: usize = 6000;

/// Triangles that a proxy is simplified to, and how far its surface may go for it, share of the object: a quarter of a
/// pixel of the window in which objects are compared.
const SIMPLE_TRIANGLES: usize = 3000;
const SIMPLE_ERROR: f32 = 0.004;

/// Cells along the longest side of the clustering grid for what cannot be simplified so far (foliage): 1 % of the object,
/// below a pixel of the window.
const PROXY_CELLS: f64 = 96.0;

/// A canonical mesh with what placement derives from it once.
#[derive(Debug, Clone)]
pub struct Shape {
    mesh: Arc<Mesh>,
    proxy: Arc<Mesh>,
    hulls: Vec<Vec<Vec3>>,
    bounds: Bounds,
    bvh: OnceLock<Arc<Bvh>>,
}

impl Shape {
    /// Prepares a canonical mesh (bottom at y = 0, centred, front +Z) and its convex parts (hull points in the
    /// same frame). Without usable parts the mesh's box stands in.
    pub fn new(mesh: Arc<Mesh>, hulls: Vec<Vec<Vec3>>) -> Self {
        let unit = Bounds { min: Vec3::new(-0.5, 0.0, -0.5), max: Vec3::new(0.5, 1.0, 0.5) };
        let bounds = mesh.bounds().filter(|b| b.min.is_finite() && b.max.is_finite()).unwrap_or(unit);
        let mut hulls: Vec<Vec<Vec3>> =
            hulls.into_iter().filter(|h| h.len() >= 4 && h.iter().all(|p| p.is_finite())).collect();
        if hulls.is_empty() {
            hulls.push(corners(&bounds).to_vec());
        }
        let proxy = if mesh.triangle_count() > PROXY_TRIANGLES {
            let simple = harmony_mesh::simplified(&mesh, SIMPLE_TRIANGLES, SIMPLE_ERROR);
            let fine = simple.triangle_count() > PROXY_TRIANGLES;
            Arc::new(if fine { clustered(&simple, bounds.size().max_element() / PROXY_CELLS) } else { simple })
        } else {
            Arc::clone(&mesh)
        };
        Self { mesh, proxy, hulls, bounds, bvh: OnceLock::new() }
    }

    /// The same from the pieces of [`harmony_mesh::convex_parts`].
    pub fn from_parts(mesh: Arc<Mesh>, parts: &[ConvexPart]) -> Self {
        Self::new(mesh, parts.iter().map(|p| p.points.iter().map(|q| q.as_dvec3()).collect()).collect())
    }

    /// The mesh.
    pub fn mesh(&self) -> &Arc<Mesh> {
        &self.mesh
    }

    /// The mesh that silhouettes are drawn from: the mesh itself, or a coarser one of the same outline.
    pub fn proxy(&self) -> &Mesh {
        &self.proxy
    }

    /// Hull points of the convex parts, canonical frame.
    pub fn hulls(&self) -> &[Vec<Vec3>] {
        &self.hulls
    }

    /// Bounds in canonical units.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Width, height and depth in canonical units, none of them zero.
    pub fn extent(&self) -> Vec3 {
        self.bounds.size().max(Vec3::splat(1e-6))
    }

    /// Ray queries on the mesh, canonical frame; built at the first call.
    pub fn bvh(&self) -> &Bvh {
        self.bvh.get_or_init(|| Arc::new(Bvh::new(&self.mesh)))
    }
}

/// The eight corners of a box.
pub(crate) fn corners(b: &Bounds) -> [Vec3; 8] {
    std::array::from_fn(|i| {
        Vec3::new(
            if i & 1 == 0 { b.min.x } else { b.max.x },
            if i & 2 == 0 { b.min.y } else { b.max.y },
            if i & 4 == 0 { b.min.z } else { b.max.z },
        )
    })
}

/// Vertex clustering (Rossignac and Borrel 1993): vertices of one grid cell become their mean.
///
/// Outlines move by at most half a cell's diagonal; triangles that fall into one cell or edge vanish.
fn clustered(mesh: &Mesh, cell: f64) -> Mesh {
    let key = |p: glam::Vec3| (p.as_dvec3() / cell).round().as_ivec3().to_array();
    let mut cells: BTreeMap<[i32; 3], (u32, Vec3, f64)> = BTreeMap::new();
    for p in &mesh.positions {
        let next = cells.len() as u32;
        let entry = cells.entry(key(*p)).or_insert((next, Vec3::ZERO, 0.0));
        entry.1 += p.as_dvec3();
        entry.2 += 1.0;
    }
    let mut positions = vec![glam::Vec3::ZERO; cells.len()];
    for (index, sum, count) in cells.values() {
        positions[*index as usize] = (*sum / *count).as_vec3();
    }
    let of_vertex: Vec<u32> = mesh.positions.iter().map(|p| cells.get(&key(*p)).map_or(0, |c| c.0)).collect();
    let mut triangles: Vec<[u32; 3]> = mesh
        .triangles()
        .filter(|t| t.iter().all(|i| (*i as usize) < of_vertex.len()))
        .map(|t| t.map(|i| of_vertex[i as usize]))
        .filter(|t| t[0] != t[1] && t[1] != t[2] && t[0] != t[2])
        .collect();
    for t in &mut triangles {
        // One rotation for each triangle, so that duplicates meet.
        let first = (0..3).min_by_key(|i| t[*i]).unwrap_or(0);
        t.rotate_left(first);
    }
    triangles.sort_unstable();
    triangles.dedup();
    let mut out = Mesh {
        uvs: vec![glam::Vec2::ZERO; positions.len()],
        positions,
        groups: vec![Group { material: 0, triangles }],
        materials: vec![harmony_mesh::Material::plain("proxy", [0.5; 3])],
        normals: Vec::new(),
    };
    out.recompute_normals();
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fine_sphere_becomes_a_coarse_one_of_the_same_size() {
        let (rows, columns) = (120_u32, 120_u32);
        let mut mesh = Mesh::default();
        for i in 0..=rows {
            for j in 0..columns {
                let (a, b) =
                    (std::f32::consts::PI * i as f32 / rows as f32, std::f32::consts::TAU * j as f32 / columns as f32);
                mesh.positions.push(glam::Vec3::new(a.sin() * b.cos(), 1.0 + a.cos(), a.sin() * b.sin()));
            }
        }
        let mut triangles = Vec::new();
        for i in 0..rows {
            for j in 0..columns {
                let k = (j + 1) % columns;
                triangles.push([i * columns + j, (i + 1) * columns + j, (i + 1) * columns + k]);
                triangles.push([i * columns + j, (i + 1) * columns + k, i * columns + k]);
            }
        }
        mesh.uvs = vec![glam::Vec2::ZERO; mesh.positions.len()];
        mesh.groups = vec![Group { material: 0, triangles }];
        mesh.materials = vec![harmony_mesh::Material::plain("x", [0.5; 3])];
        mesh.recompute_normals();
        let full = mesh.bounds().unwrap();
        let shape = Shape::new(Arc::new(mesh), Vec::new());
        let proxy = shape.proxy();
        assert!(proxy.triangle_count() < shape.mesh().triangle_count());
        assert!(proxy.check().is_ok());
        let b = proxy.bounds().unwrap();
        assert!((b.size() - full.size()).abs().max_element() <= 2.0 * 2.0 / PROXY_CELLS);
    }
}
