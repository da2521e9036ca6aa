//! Contacts between convex pieces over whole faces.
//!
//! parry takes at most four corners of a face, the first four that it finds. The foot of a bowl, a circle of thirty corners,
//! is a sliver at its edge then, and the bowl rocks on it; so do books on a table with rounded corners. Here the two faces
//! that look at each other are taken with all their corners, one is clipped by the other, and what both share carries. The
//! closest points and the normal are parry's.

use parry3d::math::{Pose, Vector};
use parry3d::query::details::contact_support_map_support_map_with_params;
use parry3d::query::details::{
    ContactManifoldsWorkspace, NormalConstraints, contact_manifolds_composite_shape_composite_shape,
    contact_manifolds_composite_shape_shape,
};
use parry3d::query::gjk::{GJKResult, VoronoiSimplex};
use parry3d::query::{
    ClosestPoints, Contact, ContactManifold, DefaultQueryDispatcher, NonlinearRigidMotion, PersistentQueryDispatcher,
    QueryDispatcher, ShapeCastHit, ShapeCastOptions, ShapeDistance, ShapeIntersection, TrackedContact, Unsupported,
};
use parry3d::shape::{ConvexPolyhedron, PackedFeatureId, Shape};

/// Corners this near the plane of a face belong to it, metres.
const FACE_M: f32 = 3e-4;
/// A contact is the one of the step before when it moved less, metres.
const SAME_M: f32 = 2e-3;
/// Contacts are brought up to date while neither shape turned against the normal by more (cosine of 1 degree) ...
const SAME_COS: f32 = 0.999_847_7;
/// ... and no point slid farther than the root of this, square metres.
const SLID_M2: f32 = 1e-6;
/// Faces that look at each other less than this (cosine) touch at an edge or a corner.
const FACING: f32 = 0.5;

/// parry's queries, but for contacts of convex polyhedra.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct WholeFaces;

impl QueryDispatcher for WholeFaces {
    fn intersection_test(&self, pos12: &Pose, a: &dyn Shape, b: &dyn Shape) -> Result<ShapeIntersection, Unsupported> {
        DefaultQueryDispatcher.intersection_test(pos12, a, b)
    }

    fn distance(&self, pos12: &Pose, a: &dyn Shape, b: &dyn Shape) -> Result<ShapeDistance, Unsupported> {
        DefaultQueryDispatcher.distance(pos12, a, b)
    }

    fn contact(
        &self,
        pos12: &Pose,
        a: &dyn Shape,
        b: &dyn Shape,
        prediction: f32,
    ) -> Result<Option<Contact>, Unsupported> {
        DefaultQueryDispatcher.contact(pos12, a, b, prediction)
    }

    fn closest_points(
        &self,
        pos12: &Pose,
        a: &dyn Shape,
        b: &dyn Shape,
        farthest: f32,
    ) -> Result<ClosestPoints, Unsupported> {
        DefaultQueryDispatcher.closest_points(pos12, a, b, farthest)
    }

    fn cast_shapes(
        &self,
        pos12: &Pose,
        velocity12: Vector,
        a: &dyn Shape,
        b: &dyn Shape,
        options: ShapeCastOptions,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        DefaultQueryDispatcher.cast_shapes(pos12, velocity12, a, b, options)
    }

    fn cast_shapes_nonlinear(
        &self,
        motion1: &NonlinearRigidMotion,
        a: &dyn Shape,
        motion2: &NonlinearRigidMotion,
        b: &dyn Shape,
        from: f32,
        to: f32,
        stop_at_penetration: bool,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        DefaultQueryDispatcher.cast_shapes_nonlinear(motion1, a, motion2, b, from, to, stop_at_penetration)
    }
}

impl<M: Default + Clone + Send + Sync, C: Default + Copy + Send + Sync> PersistentQueryDispatcher<M, C> for WholeFaces {
    fn contact_manifolds(
        &self,
        pos12: &Pose,
        a: &dyn Shape,
        b: &dyn Shape,
        prediction: f32,
        manifolds: &mut Vec<ContactManifold<M, C>>,
        workspace: &mut Option<ContactManifoldsWorkspace>,
    ) -> Result<(), Unsupported> {
        match (a.as_composite_shape(), b.as_composite_shape()) {
            (Some(a), Some(b)) => {
                contact_manifolds_composite_shape_composite_shape(self, pos12, a, b, prediction, manifolds, workspace);
            }
            (Some(a), None) => {
                contact_manifolds_composite_shape_shape(self, pos12, a, b, prediction, manifolds, workspace, false);
            }
            (None, Some(b)) => {
                let pos21 = pos12.inverse();
                contact_manifolds_composite_shape_shape(self, &pos21, b, a, prediction, manifolds, workspace, true);
            }
            (None, None) => {
                if manifolds.is_empty() {
                    manifolds.push(ContactManifold::new());
                }
                return self.contact_manifold_convex_convex(pos12, a, b, None, None, prediction, &mut manifolds[0]);
            }
        }
        Ok(())
    }

    fn contact_manifold_convex_convex(
        &self,
        pos12: &Pose,
        a: &dyn Shape,
        b: &dyn Shape,
        constraints1: Option<&dyn NormalConstraints>,
        constraints2: Option<&dyn NormalConstraints>,
        prediction: f32,
        manifold: &mut ContactManifold<M, C>,
    ) -> Result<(), Unsupported> {
        match (a.as_convex_polyhedron(), b.as_convex_polyhedron()) {
            (Some(a), Some(b)) => {
                touch(pos12, a, b, prediction, manifold);
                Ok(())
            }
            _ => DefaultQueryDispatcher.contact_manifold_convex_convex(
                pos12,
                a,
                b,
                constraints1,
                constraints2,
                prediction,
                manifold,
            ),
        }
    }
}

/// Contacts of two convex polyhedra.
fn touch<M, C: Default + Copy>(
    pos12: &Pose,
    a: &ConvexPolyhedron,
    b: &ConvexPolyhedron,
    prediction: f32,
    manifold: &mut ContactManifold<M, C>,
) {
    if manifold.try_update_contacts_eps(pos12, SAME_COS, SLID_M2) {
        return;
    }
    let from = manifold.local_n1.try_normalize();
    let simplex = &mut VoronoiSimplex::new();
    let closest = contact_support_map_support_map_with_params(pos12, a, b, prediction, simplex, from);
    let before = std::mem::take(&mut manifold.points);
    manifold.clear();
    match closest {
        GJKResult::ClosestPoints(p1, p2, n) => {
            let mut point = |p1: Vector, p2: Vector| {
                let (unknown, p2_2) = (PackedFeatureId::UNKNOWN, pos12.inverse_transform_point(p2));
                manifold.points.push(TrackedContact::new(p1, p2_2, unknown, unknown, (p2 - p1).dot(n)));
            };
            shared(&Face::toward(a, &Pose::IDENTITY, n), &Face::toward(b, pos12, -n), n, &mut point);
            point(p1, p2);
            manifold.local_n1 = n;
            manifold.local_n2 = pos12.rotation.inverse() * -n;
        }
        GJKResult::NoIntersection(n) => manifold.local_n1 = n,
        _ => manifold.local_n1 = Vector::ZERO,
    }
    manifold.match_contacts_using_positions(&before, SAME_M);
}

/// A face of a polyhedron with everything that lies in its plane, in a common frame.
struct Face {
    corners: Vec<Vector>,
    normal: Vector,
}

impl Face {
    /// The face that looks along `n` most.
    fn toward(shape: &ConvexPolyhedron, pose: &Pose, n: Vector) -> Self {
        let n = pose.rotation.inverse() * n;
        let faces = shape.faces().iter().map(|f| f.normal);
        let normal = faces.max_by(|a, b| a.dot(n).total_cmp(&b.dot(n))).unwrap_or(n);
        let high = shape.points().iter().map(|p| p.dot(normal)).fold(f32::MIN, f32::max);
        let corners = shape.points().iter().filter(|p| p.dot(normal) >= high - FACE_M).map(|p| *pose * *p).collect();
        Self { corners, normal: pose.rotation * normal }
    }

    /// Where the line through a point along `n` meets the face's plane.
    fn below(&self, p: Vector, n: Vector) -> Vector {
        p + n * ((self.corners[0] - p).dot(self.normal) / n.dot(self.normal))
    }
}

/// Corners of what two faces share, seen along the normal: points on the first and on the second.
fn shared(a: &Face, b: &Face, n: Vector, point: &mut impl FnMut(Vector, Vector)) {
    if a.normal.dot(n) < FACING || -b.normal.dot(n) < FACING {
        return;
    }
    let (u, v) = n.any_orthonormal_pair();
    let flat = |face: &Face| outline(face.corners.iter().map(|c| [c.dot(u), c.dot(v)]).collect());
    for [x, y] in clipped(flat(a), &flat(b)) {
        let p = u * x + v * y;
        point(a.below(p, n), b.below(p, n));
    }
}

/// On which side of the line from `a` to `b` a point is: positive to the left.
fn side(a: [f32; 2], b: [f32; 2], p: [f32; 2]) -> f32 {
    (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
}

/// Convex outline, counter-clockwise.
fn outline(mut points: Vec<[f32; 2]>) -> Vec<[f32; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let half = |points: &mut dyn Iterator<Item = [f32; 2]>| {
        let mut out: Vec<[f32; 2]> = Vec::new();
        for p in points {
            while out.len() > 1 && side(out[out.len() - 2], out[out.len() - 1], p) <= 0.0 {
                out.pop();
            }
            out.push(p);
        }
        out.pop();
        out
    };
    let mut out = half(&mut points.iter().copied());
    out.extend(half(&mut points.iter().rev().copied()));
    out
}

/// A polygon clipped by a convex counter-clockwise one.
fn clipped(mut polygon: Vec<[f32; 2]>, by: &[[f32; 2]]) -> Vec<[f32; 2]> {
    if polygon.len() < 3 || by.len() < 3 {
        return Vec::new();
    }
    for (k, a) in by.iter().enumerate() {
        let b = by[(k + 1) % by.len()];
        let mut left = Vec::with_capacity(polygon.len() + 1);
        for (j, p) in polygon.iter().enumerate() {
            let q = polygon[(j + 1) % polygon.len()];
            let (sp, sq) = (side(*a, b, *p), side(*a, b, q));
            if sp >= 0.0 {
                left.push(*p);
            }
            if (sp > 0.0 && sq < 0.0) || (sp < 0.0 && sq > 0.0) {
                let t = sp / (sp - sq);
                left.push([p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]);
            }
        }
        polygon = left;
    }
    polygon
}

#[cfg(test)]
mod tests {
    use super::*;

    fn prism(corners: usize, radius: f32, low: f32, high: f32) -> ConvexPolyhedron {
        let ring = |y: f32| {
            (0..corners).map(move |k| {
                let (sin, cos) = (std::f32::consts::TAU * k as f32 / corners as f32).sin_cos();
                Vector::new(radius * cos, y, radius * sin)
            })
        };
        ConvexPolyhedron::from_convex_hull(&ring(low).chain(ring(high)).collect::<Vec<_>>()).unwrap()
    }

    fn manifold(a: &ConvexPolyhedron, b: &ConvexPolyhedron, pos12: &Pose) -> ContactManifold<(), ()> {
        let mut manifold = ContactManifold::new();
        touch(pos12, a, b, 0.005, &mut manifold);
        manifold
    }

    #[test]
    fn a_round_foot_touches_all_around() {
        let table = prism(24, 0.5, 0.0, 0.7);
        let cup = prism(30, 0.04, 0.0, 0.1);
        // Near the rim, outside of every square in the table's top.
        let at = Pose::from_translation(Vector::new(0.3, 0.701, 0.3));
        let found = manifold(&table, &cup, &at);
        assert!((found.local_n1 - Vector::Y).length() < 1e-3, "{:?}", found.local_n1);
        let mean = found.points.iter().map(|p| p.local_p2).sum::<Vector>() / found.points.len() as f32;
        assert!(mean.length() < 0.005, "{mean:?}");
        for p in &found.points {
            assert!((p.dist - 0.001).abs() < 1e-4, "{p:?}");
            assert!((p.local_p1.y - 0.7).abs() < 1e-5 && p.local_p2.y.abs() < 1e-5, "{p:?}");
        }
        for way in [Vector::X, Vector::Z, -Vector::X, -Vector::Z] {
            let reach = found.points.iter().map(|p| p.local_p2.dot(way)).fold(f32::MIN, f32::max);
            assert!(reach > 0.039, "{way:?}: {reach}");
        }
    }

    #[test]
    fn what_stands_over_an_edge_touches_up_to_it() {
        let table = ConvexPolyhedron::from_convex_hull(&[
            Vector::new(0.0, 0.0, 0.0),
            Vector::new(1.0, 0.0, 0.0),
            Vector::new(0.0, 0.0, 1.0),
            Vector::new(1.0, 0.0, 1.0),
            Vector::new(0.0, 0.7, 0.0),
            Vector::new(1.0, 0.7, 0.0),
            Vector::new(0.0, 0.7, 1.0),
            Vector::new(1.0, 0.7, 1.0),
        ])
        .unwrap();
        let cup = prism(30, 0.04, 0.0, 0.1);
        let found = manifold(&table, &cup, &Pose::from_translation(Vector::new(0.98, 0.7005, 0.5)));
        let xs: Vec<f32> = found.points.iter().map(|p| p.local_p1.x).collect();
        let most = xs.iter().copied().fold(f32::MIN, f32::max);
        assert!((most - 1.0).abs() < 1e-4, "{xs:?}");
        assert!(xs.iter().any(|x| *x < 0.945), "{xs:?}");
    }

    #[test]
    fn a_corner_touches_at_a_point_and_what_is_far_not_at_all() {
        let table = prism(24, 0.5, 0.0, 0.7);
        let cube = prism(4, 0.1, -0.07, 0.07);
        let turned = Pose::rotation(Vector::new(0.0, 0.0, 0.9));
        let low =
            (turned.rotation * Vector::new(-0.1, -0.07, 0.0)).y.min((turned.rotation * Vector::new(0.1, -0.07, 0.0)).y);
        let at = |gap: f32| Pose::from_parts(Vector::new(0.0, 0.7 - low + gap, 0.0), turned.rotation);
        let found = manifold(&table, &cube, &at(0.001));
        assert!(found.points.iter().any(|p| (p.dist - 0.001).abs() < 2e-4), "{:?}", found.points);
        assert!(found.points.iter().filter(|p| p.dist < 0.005).count() < 3, "{:?}", found.points);
        assert!(manifold(&table, &cube, &at(0.1)).points.is_empty());
    }
}
