//! A bounding volume hierarchy over one mesh: rays and closest points.

use glam::DVec3;

use crate::Mesh;

/// Where a ray meets the mesh, or the closest point of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin (or the query point), in the mesh's unit.
    pub distance: f64,
    /// Index of the triangle in the order of [`Mesh::triangles`].
    pub triangle: usize,
    /// The point, in the mesh's frame.
    pub point: DVec3,
    /// Unit normal of the triangle by its winding (outward on a well-made mesh), whichever side was met.
    pub normal: DVec3,
}

/// A search tree over the triangles of a mesh, in the mesh's own frame.
#[derive(Debug, Clone)]
pub struct Bvh {}

impl Bvh {
    /// Builds the tree; triangles with bad indices or coordinates are left out.
    pub fn new(_mesh: &Mesh) -> Self {
        Self {}
    }

    /// First triangle met by a ray within `max` of its origin, from either side.
    ///
    /// `direction` need not be a unit vector; distances are in the mesh's unit all the same.
    pub fn raycast(&self, _origin: DVec3, _direction: DVec3, _max: f64) -> Option<Hit> {
        None
    }

    /// Whether a ray meets anything within `max` of its origin.
    pub fn any_hit(&self, _origin: DVec3, _direction: DVec3, _max: f64) -> bool {
        false
    }

    /// The point of the mesh that is closest to `point`; `None` when the mesh has no triangle.
    pub fn closest_point(&self, _point: DVec3) -> Option<Hit> {
        None
    }
}
