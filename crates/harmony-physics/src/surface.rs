//! A mesh's surface as a search tree with samples, and what of it can be touched from outside.

use glam::Vec3;
use harmony_mesh::{Bvh, Group, Material, Mesh};
use harmony_scene::Vec3 as DVec3;
use rayon::prelude::*;

use crate::hull::directions;

/// Rays by which a point is found to be open to the outside.
const RAYS: usize = 42;

/// Triangles of one object, metres.
#[derive(Debug)]
pub(crate) struct Surface {
    pub(crate) triangles: Vec<[DVec3; 3]>,
    tree: Bvh,
    /// Longest side of the bounding box.
    pub(crate) size: f64,
}

impl Surface {
    /// From triangles with finite corners.
    pub(crate) fn new(triangles: Vec<[DVec3; 3]>) -> Self {
        let (low, high) = bounds(triangles.iter().flatten());
        let mesh = Mesh {
            positions: triangles.iter().flatten().map(|p| p.as_vec3()).collect::<Vec<Vec3>>(),
            groups: vec![Group {
                material: 0,
                triangles: (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            }],
            materials: vec![Material::plain("surface", [0.5; 3])],
            ..Mesh::default()
        };
        let size = if triangles.is_empty() { 0.0 } else { (high - low).max_element() };
        Self { tree: Bvh::new(&mesh), triangles, size }
    }

    /// Distance of a point to the surface.
    pub(crate) fn distance(&self, point: DVec3) -> f64 {
        self.tree.closest_point(point).map_or(f64::INFINITY, |hit| hit.distance)
    }

    /// Whether some straight way leads from a point to the outside.
    pub(crate) fn is_open(&self, point: DVec3) -> bool {
        let step = 1e-3 * self.size;
        directions(RAYS).any(|d| !self.tree.any_hit(point + d * step, d, 4.0 * self.size))
    }

    /// Triangles that can be touched from outside somewhere: at their middle or near a corner.
    pub(crate) fn open_triangles(&self) -> Vec<[DVec3; 3]> {
        let keep = |t: &&[DVec3; 3]| {
            let middle = (t[0] + t[1] + t[2]) / 3.0;
            self.is_open(middle) || t.iter().any(|c| self.is_open(middle.lerp(*c, 0.85)))
        };
        self.triangles.par_iter().filter(keep).copied().collect()
    }
}

/// Smallest and largest coordinates.
pub(crate) fn bounds<'a>(points: impl Iterator<Item = &'a DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)))
}

/// About `count` points, spread evenly over triangles by area; the same triangles give the same points.
pub(crate) fn samples(triangles: &[[DVec3; 3]], count: usize) -> Vec<DVec3> {
    let areas: Vec<f64> = triangles.iter().map(|[a, b, c]| (*b - *a).cross(*c - *a).length() / 2.0).collect();
    let total: f64 = areas.iter().sum();
    if total <= 0.0 || !total.is_finite() || count == 0 {
        return Vec::new();
    }
    let step = total / count as f64;
    let mut out = Vec::with_capacity(count + 1);
    let mut next = step / 2.0;
    let mut passed = 0.0;
    for ([a, b, c], area) in triangles.iter().zip(&areas) {
        while next < passed + area {
            // The additive recurrence of Roberts (2018) fills the square evenly, folding makes it a triangle.
            let k = out.len() as f64;
            let (mut u, mut v) = ((0.5 + k * 0.754_877_666).fract(), (0.5 + k * 0.569_840_291).fract());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            out.push(*a + (*b - *a) * u + (*c - *a) * v);
            next += step;
        }
        passed += area;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::Hull;

    fn faces(hull: &Hull) -> Vec<[DVec3; 3]> {
        hull.faces.iter().map(|f| hull.corners(*f)).collect()
    }

    #[test]
    fn what_is_enclosed_cannot_be_touched() {
        let outer = Hull::cuboid(DVec3::ZERO, DVec3::ONE);
        let inner = Hull::cuboid(DVec3::splat(0.3), DVec3::splat(0.6));
        let surface = Surface::new([faces(&outer), faces(&inner)].concat());
        assert_eq!(surface.open_triangles().len(), 12);
        assert!(!surface.is_open(DVec3::splat(0.2)) && surface.is_open(DVec3::new(0.5, 1.001, 0.5)));
        assert!((surface.distance(DVec3::new(0.5, 1.25, 0.5)) - 0.25).abs() < 1e-6);
    }

    #[test]
    fn samples_cover_by_area() {
        let hull = Hull::cuboid(DVec3::ZERO, DVec3::new(4.0, 1.0, 1.0));
        let points = samples(&faces(&hull), 1800);
        assert!(points.len().abs_diff(1800) <= 1);
        let ends = points.iter().filter(|p| p.x < 1e-9 || p.x > 4.0 - 1e-9).count();
        assert!(ends.abs_diff(200) <= 4, "{ends} of 200 on the two ends");
        assert!(samples(&[], 10).is_empty() && samples(&[[DVec3::ZERO; 3]], 10).is_empty());
    }
}
