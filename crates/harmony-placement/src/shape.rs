//! Canonical geometry of an object, prepared for many renders and distance queries.

use std::sync::Arc;

use harmony_mesh::{Bounds, Mesh};
use harmony_scene::Vec3;

/// A canonical mesh with what placement derives from it once.
#[derive(Debug, Clone)]
pub struct Shape {
    mesh: Arc<Mesh>,
    hulls: Vec<Vec<Vec3>>,
    bounds: Bounds,
}

impl Shape {
    /// Prepares a canonical mesh (bottom at y = 0, centred, front +Z) and its convex parts (hull points in the
    /// same frame). Without parts the mesh's box stands in.
    pub fn new(mesh: Arc<Mesh>, hulls: Vec<Vec<Vec3>>) -> Self {
        let bounds = mesh.bounds().unwrap_or(Bounds { min: Vec3::splat(-0.5), max: Vec3::splat(0.5) });
        Self { mesh, hulls, bounds }
    }

    /// The mesh.
    pub fn mesh(&self) -> &Arc<Mesh> {
        &self.mesh
    }

    /// Hull points of the convex parts, canonical frame.
    pub fn hulls(&self) -> &[Vec<Vec3>] {
        &self.hulls
    }

    /// Bounds in canonical units.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }
}
