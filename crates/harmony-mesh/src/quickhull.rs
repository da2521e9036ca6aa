//! Quickhull with exact predicates (Barber, Dobkin and Huhdanpaa 1996, "The Quickhull Algorithm for Convex Hulls").
//!
//! Which side of a face a point lies on is decided exactly (Shewchuk 1997), and a point in a face's plane counts as seeing
//! it: as if it stood a little farther out. What a point sees is then one disc whatever lies in a plane or on a line with
//! what, so that the hull is always closed, and no face folds over another. Rounding only chooses which point comes next
//! and leaves out those nearer than a tolerance.

use std::collections::HashMap;

use glam::DVec3;
use robust::{Coord3D, orient3d};

/// A face while the hull grows.
struct Face {
    corners: [u32; 3],
    /// Outward unit normal; zero when rounding leaves none: nothing is far from such a face.
    normal: DVec3,
    /// Points outside of it by more than the tolerance that no other face has.
    outside: Vec<u32>,
    /// The farthest of them, and how far.
    far: Option<(f64, u32)>,
    gone: bool,
}

/// The faces of the hull of some points, counter-clockwise seen from outside; `None` when they lie in a plane.
///
/// Points outside of the faces by `tolerance` or less are left out. The farthest point comes first, until the hull has
/// `most` corners: that of more would hold all points, this one is inside of it by as little as can be.
pub fn quickhull(points: &[DVec3], tolerance: f64, most: usize) -> Option<Vec<[u32; 3]>> {
    let mut growing = Growing { points, tolerance, faces: Vec::new(), face_of: HashMap::new() };
    let start = growing.tetrahedron()?;
    let [a, b, c, d] = start;
    let first = [[a, b, c], [a, c, d], [a, d, b], [b, d, c]].map(|corners| growing.add(corners));
    growing.share((0..points.len() as u32).filter(|p| !start.contains(p)), &first);
    while growing.corners() < most
        && let Some((face, point)) = growing.farthest()
    {
        // What rounding alone put outside is let go.
        if growing.side(growing.faces[face].corners, point) > 0.0 {
            growing.reach(face, point);
        } else {
            let mut rest = std::mem::take(&mut growing.faces[face].outside);
            rest.retain(|i| *i != point);
            growing.faces[face].far = None;
            growing.share(rest, &[face]);
        }
    }
    Some(growing.faces.into_iter().filter(|f| !f.gone).map(|f| f.corners).collect())
}

struct Growing<'a> {
    points: &'a [DVec3],
    tolerance: f64,
    faces: Vec<Face>,
    /// The face on the left of each directed edge. Those of faces that are gone stay until another takes their place.
    face_of: HashMap<(u32, u32), usize>,
}

impl Growing<'_> {
    fn at(&self, i: u32) -> DVec3 {
        self.points[i as usize]
    }

    /// Four far points around a volume, the first three counter-clockwise seen from outside.
    fn tetrahedron(&self) -> Option<[u32; 4]> {
        let most = |f: &dyn Fn(DVec3) -> f64| {
            let far = |i: &u32| f(self.at(*i));
            (0..self.points.len() as u32).max_by(|i, k| far(i).total_cmp(&far(k)))
        };
        let a = most(&|p| p.x)?;
        let b = most(&|p| p.distance_squared(self.at(a)))?;
        let along = (self.at(b) - self.at(a)).try_normalize()?;
        let c = most(&|p| (p - self.at(a)).reject_from_normalized(along).length_squared())?;
        let across = (self.at(b) - self.at(a)).cross(self.at(c) - self.at(a));
        let d = most(&|p| (p - self.at(a)).dot(across).abs())?;
        let side = self.side([a, b, c], d);
        (side != 0.0).then_some(if side > 0.0 { [a, c, b, d] } else { [a, b, c, d] })
    }

    /// Above zero: the point lies outside of the face's plane. Zero: in it.
    fn side(&self, corners: [u32; 3], point: u32) -> f64 {
        let [a, b, c, p] = [corners[0], corners[1], corners[2], point].map(|i| {
            let DVec3 { x, y, z } = self.at(i);
            Coord3D { x, y, z }
        });
        // The library's sign is above zero below the plane.
        -orient3d(a, b, c, p)
    }

    fn add(&mut self, corners: [u32; 3]) -> usize {
        let [a, b, c] = corners.map(|i| self.at(i));
        let face = self.faces.len();
        let normal = (b - a).cross(c - a).normalize_or_zero();
        self.faces.push(Face { corners, normal, outside: Vec::new(), far: None, gone: false });
        for edge in edges(corners) {
            self.face_of.insert(edge, face);
        }
        face
    }

    fn height(&self, face: usize, point: u32) -> f64 {
        let Face { corners, normal, .. } = &self.faces[face];
        normal.dot(self.at(point) - self.at(corners[0]))
    }

    /// Gives each point to the face it is farthest outside of, or to none.
    fn share(&mut self, points: impl IntoIterator<Item = u32>, faces: &[usize]) {
        for point in points {
            let farthest = faces.iter().map(|f| (self.height(*f, point), *f)).max_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((height, face)) = farthest
                && height > self.tolerance
            {
                let Face { outside, far, .. } = &mut self.faces[face];
                outside.push(point);
                if far.is_none_or(|(most, _)| height > most) {
                    *far = Some((height, point));
                }
            }
        }
    }

    /// Corners of the hull, by Euler's formula.
    fn corners(&self) -> usize {
        self.faces.iter().filter(|f| !f.gone).count() / 2 + 2
    }

    /// The point that is farthest outside of a face, and that face.
    fn farthest(&self) -> Option<(usize, u32)> {
        let far = self.faces.iter().enumerate().filter(|(_, f)| !f.gone).filter_map(|(i, f)| Some((i, f.far?)));
        far.max_by(|(_, a), (_, b)| a.0.total_cmp(&b.0)).map(|(i, (_, point))| (i, point))
    }

    /// Draws the hull out to a point outside of a face: all that the point sees makes way for faces to the rim of it.
    fn reach(&mut self, face: usize, point: u32) {
        let mut seen = vec![face];
        let mut rim = Vec::new();
        let mut orphans = Vec::new();
        self.faces[face].gone = true;
        let mut next = 0;
        while next < seen.len() {
            let from = seen[next];
            next += 1;
            orphans.append(&mut self.faces[from].outside);
            for (a, b) in edges(self.faces[from].corners) {
                let over = self.face_of[&(b, a)];
                if self.faces[over].gone {
                    continue;
                }
                if self.side(self.faces[over].corners, point) >= 0.0 {
                    self.faces[over].gone = true;
                    seen.push(over);
                } else {
                    rim.push((a, b));
                }
            }
        }
        let new: Vec<usize> = rim.into_iter().map(|(a, b)| self.add([a, b, point])).collect();
        self.share(orphans, &new);
    }
}

fn edges([a, b, c]: [u32; 3]) -> [(u32, u32); 3] {
    [(a, b), (b, c), (c, a)]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::closest_on_triangle;

    /// Exactly: closed, every corner behind or in every face's plane. No other point is outside by more than rounding.
    fn holds(points: &[DVec3], faces: &[[u32; 3]]) {
        let all = Growing { points, tolerance: 0.0, faces: Vec::new(), face_of: HashMap::new() };
        let mut directed: Vec<(u32, u32)> = faces.iter().flat_map(|f| edges(*f)).collect();
        directed.sort_unstable();
        assert!(directed.windows(2).all(|p| p[0] != p[1]), "an edge twice");
        for (a, b) in &directed {
            assert!(directed.binary_search(&(*b, *a)).is_ok(), "an edge with one face");
        }
        for face in faces {
            for corner in faces.iter().flatten() {
                assert!(all.side(*face, *corner) <= 0.0, "{face:?} and {corner}");
            }
        }
        let triangles: Vec<[DVec3; 3]> = faces.iter().map(|f| f.map(|i| points[i as usize])).collect();
        for (i, point) in points.iter().enumerate() {
            let inside = faces.iter().all(|face| all.side(*face, i as u32) <= 0.0);
            let distance = triangles.iter().map(|t| closest_on_triangle(*point, *t).distance(*point));
            assert!(inside || distance.fold(f64::INFINITY, f64::min) < 1e-12, "{i} is outside");
        }
    }

    proptest! {
        // On a small lattice most points lie in a plane or on a line with others, or are there twice.
        #[test]
        fn points_of_a_lattice(at in prop::collection::vec((0_i8..5, 0_i8..4, 0_i8..3), 4..60)) {
            let points: Vec<DVec3> = at.iter().map(|(x, y, z)| DVec3::new((*x).into(), (*y).into(), (*z).into())).collect();
            let flat = !points.iter().any(|d| {
                points.iter().any(|c| points.iter().any(|b| (*b - points[0]).cross(*c - points[0]).dot(*d - points[0]) != 0.0))
            });
            match quickhull(&points, 0.0, usize::MAX) {
                Some(faces) => { prop_assert!(!flat); holds(&points, &faces); }
                None => prop_assert!(flat),
            }
        }

        // A lattice that is turned and rounded: points are nearly, not truly, in planes.
        #[test]
        fn points_nearly_in_planes(
            at in prop::collection::vec((0_i8..5, 0_i8..4, 0_i8..3), 4..60),
            turn in (0.0_f64..3.0, 0.0_f64..3.0),
        ) {
            let turned = glam::DQuat::from_rotation_y(turn.0) * glam::DQuat::from_rotation_x(turn.1);
            let points: Vec<DVec3> = at
                .iter()
                .map(|(x, y, z)| turned * DVec3::new((*x).into(), (*y).into(), (*z).into()))
                .map(|p| p.as_vec3().as_dvec3())
                .collect();
            if let Some(faces) = quickhull(&points, 0.0, usize::MAX) {
                holds(&points, &faces);
            }
        }
    }

    #[test]
    fn what_is_nearer_than_the_tolerance_is_left_out() {
        let mut points = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, DVec3::splat(0.2)];
        points.push(DVec3::new(0.3, 0.3, -0.001));
        assert_eq!(quickhull(&points, 0.01, 99).unwrap().len(), 4);
        assert_eq!(quickhull(&points, 1e-6, 99).unwrap().len(), 6);
        assert_eq!(quickhull(&points, 1e-6, 4).unwrap().len(), 4);
        assert!(quickhull(&points[..3], 0.0, usize::MAX).is_none());
        assert!(quickhull(&[], 0.0, usize::MAX).is_none() && quickhull(&[DVec3::ONE; 9], 0.0, usize::MAX).is_none());
    }
}
