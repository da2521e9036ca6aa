//! The room itself as what a robot keeps out of: floor, ceiling, walls, blocks, what is around niches and above slopes.
//!
//! The solids are those that stand for the room in simulations ([`harmony_physics::shell`]): walls 0.2 m thick with their
//! openings cut out. So an arm may reach through an open doorway; a door that the scene has is a thing of its own.
//!
//! # Distances
//! How far the nearest corner of a piece is before the face of a solid that it is farthest before (the separating axes of
//! the solid's own faces), in double precision. Beside an edge that is less than the distance: there parry's is taken.
//! Below 0 it is the least way out through a face of the solid.

use glam::{DVec3, Vec3};
use harmony_physics::Hull;
use harmony_physics::shell::shell;
use harmony_scene::Room;
use parry3d::math::{Pose, Vector};
use parry3d::query;
use parry3d::shape::{ConvexPolyhedron, Shape};

/// Planes that turn by less than this from each other are one face, sine of the angle.
const SAME: f64 = 1e-6;

/// A convex solid of the room.
pub(crate) struct Solid {
    /// Which face of the room it belongs to, in words.
    pub face: &'static str,
    /// Unit normals outward, and how far from the origin.
    planes: Vec<(DVec3, f64)>,
    shape: Option<ConvexPolyhedron>,
}

/// Solids of a room, room frame.
pub(crate) fn solids(room: &Room) -> Vec<Solid> {
    shell(room).iter().flat_map(|(name, hulls)| hulls.iter().map(|h| Solid::new(words(name), h))).collect()
}

/// A node of the shell in words.
fn words(node: &str) -> &'static str {
    match node {
        "floor" => "floor",
        "ceiling" => "ceiling",
        "wall_left" => "left wall",
        "wall_right" => "right wall",
        "wall_front" => "front wall",
        _ => "back wall",
    }
}

impl Solid {
    fn new(face: &'static str, hull: &Hull) -> Self {
        let mut planes: Vec<(DVec3, f64)> = Vec::new();
        for (normal, offset) in hull.planes() {
            if !planes.iter().any(|(n, _)| n.cross(normal).length() < SAME && n.dot(normal) > 0.0) {
                planes.push((normal, offset));
            }
        }
        let points: Vec<Vector> = hull.vertices.iter().map(|v| vector(*v)).collect();
        let shape = ConvexPolyhedron::from_convex_mesh(points.clone(), &hull.faces)
            .or_else(|| ConvexPolyhedron::from_convex_hull(&points));
        Self { face, planes, shape }
    }

    /// How far a ball is before it at least, metres.
    pub fn before(&self, centre: DVec3, radius: f64) -> f64 {
        self.planes.iter().map(|(n, d)| n.dot(centre) - d).fold(f64::NEG_INFINITY, f64::max) - radius
    }

    /// Distance of what has these corners; `shape` at `at` is the same for parry.
    pub fn distance(&self, corners: &[DVec3], shape: &dyn Shape, at: &Pose) -> f64 {
        let mut best = (f64::NEG_INFINITY, DVec3::ZERO);
        for (normal, offset) in &self.planes {
            let nearest = corners.iter().map(|c| (normal.dot(*c) - offset, *c)).min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((distance, corner)) = nearest
                && distance > best.0
            {
                best = (distance, corner - *normal * distance);
            }
        }
        // Right before a face that is the distance; elsewhere the piece may be before an edge, or beside one.
        if best.0 > 0.0 && self.planes.iter().all(|(n, d)| n.dot(best.1) - d < 1e-6) {
            return best.0;
        }
        let own = self.shape.as_ref().and_then(|s| query::distance(&Pose::IDENTITY, s, at, shape).ok());
        match own.map(|d| f64::from(d.distance)) {
            Some(distance) if distance > best.0 && distance > 0.0 => distance,
            _ => best.0,
        }
    }

    /// Where a ray enters it, metres; 0 from inside.
    pub fn ray(&self, from: DVec3, along: DVec3) -> Option<f64> {
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for (normal, offset) in &self.planes {
            let (before, closing) = (normal.dot(from) - offset, -normal.dot(along));
            if closing.abs() < 1e-12 {
                if before > 0.0 {
                    return None;
                }
            } else if closing > 0.0 {
                enter = enter.max(before / closing);
            } else {
                leave = leave.min(before / closing);
            }
        }
        (enter <= leave).then_some(enter)
    }
}

fn vector(v: DVec3) -> Vector {
    let v: Vec3 = v.as_vec3();
    Vector::new(v.x, v.y, v.z)
}

#[cfg(test)]
mod tests {
    use parry3d::shape::Cuboid;

    use super::*;

    #[test]
    fn distances_to_a_face_an_edge_and_the_inside_are_those_of_a_box() {
        let solid = Solid::new("floor", &Hull::cuboid(DVec3::ZERO, DVec3::ONE));
        let shape = Cuboid::new(Vector::new(0.1, 0.1, 0.1));
        let of = |x: f64, y: f64, z: f64| {
            let centre = DVec3::new(x, y, z);
            let corners: Vec<DVec3> = (0..8)
                .map(|k| centre + DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)) * 0.2 - 0.1)
                .collect();
            solid.distance(&corners, &shape, &Pose::from_translation(vector(centre)))
        };
        assert!((of(0.5, 1.3, 0.5) - 0.2).abs() < 1e-12);
        // 0.3 and 0.4 from an edge.
        assert!((of(1.4, 1.5, 0.5) - 0.5).abs() < 1e-5, "{}", of(1.4, 1.5, 0.5));
        assert!((of(0.5, 1.05, 0.5) + 0.05).abs() < 1e-12);
        assert_eq!(solid.ray(DVec3::new(0.5, -1.0, 0.5), DVec3::Y), Some(1.0));
        assert_eq!(solid.ray(DVec3::new(1.5, -1.0, 0.5), DVec3::Y), None);
        assert_eq!(solid.ray(DVec3::new(0.5, 2.0, 0.5), DVec3::Y), None);
    }
}
