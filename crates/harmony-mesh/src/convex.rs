//! Convex pieces for collision.

use glam::Vec3;

use crate::Mesh;

/// Most points of a piece.
pub const MAX_HULL_POINTS: usize = 32;

/// The convex hull of a few points, in the frame of its mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ConvexPart {
    /// Hull points, at most [`MAX_HULL_POINTS`].
    pub points: Vec<Vec3>,
}

/// Convex pieces of any mesh: an approximate convex decomposition, or one hull, or the box.
pub fn convex_parts(mesh: &Mesh) -> Vec<ConvexPart> {
    let Some(b) = mesh.bounds() else { return Vec::new() };
    let (lo, hi) = (b.min.as_vec3(), b.max.as_vec3());
    let points = (0..8)
        .map(|i| {
            let pick = |bit: i32, l: f32, h: f32| if i & bit == 0 { l } else { h };
            Vec3::new(pick(1, lo.x, hi.x), pick(2, lo.y, hi.y), pick(4, lo.z, hi.z))
        })
        .collect();
    vec![ConvexPart { points }]
}
