//! Convex hulls: made from points, measured, and given mass.
//!
//! Frames: a hull is in whatever frame its points are in; lengths are metres. Hulls are closed, consistently wound meshes
//! with few vertices, so that every simulator takes them as they are.
//!
//! Volume and moments are the exact integrals over a polyhedron, summed over tetrahedra from a point near it (Tonon 2004,
//! "Explicit exact formulas for the 3-D tetrahedron inertia tensor"). Points in a plane or on a line have no
//! hull and are thickened first, see [`Hull::of_sheet`].

use glam::{DMat3, Vec2};
use harmony_mesh::{Group, Material, Mesh, closest_on_triangle, quickhull};
use harmony_scene::Vec3 as DVec3;
use serde::{Deserialize, Serialize};

/// Most vertices of a hull: what PhysX takes on the GPU.
pub const MAX_VERTICES: usize = 64;

/// Points this near to the hull of the others are left out, shares of the longest side: about what meshes in single
/// precision resolve.
const FLUSH: f64 = 1e-6;

/// A closed convex mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hull {
    /// Corners, metres.
    pub vertices: Vec<DVec3>,
    /// Triangles, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
}

/// Mass, centre and inertia of a solid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    /// Volume in m3, or mass in kg when the density is one of mass.
    pub mass: f64,
    /// Centre of mass.
    pub centre: DVec3,
    /// Inertia about the centre, mass unit times m2.
    pub inertia: DMat3,
}

impl Moments {
    /// Nothing at all.
    pub const NONE: Self = Self { mass: 0.0, centre: DVec3::ZERO, inertia: DMat3::ZERO };

    /// The same shape of another density.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self { mass: self.mass * factor, centre: self.centre, inertia: self.inertia * factor }
    }

    /// Two solids together.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let mass = self.mass + other.mass;
        if mass <= 0.0 {
            return Self::NONE;
        }
        let centre = (self.centre * self.mass + other.centre * other.mass) / mass;
        let moved = |m: &Self| m.inertia + point_inertia(m.centre - centre) * m.mass;
        Self { mass, centre, inertia: moved(&self) + moved(&other) }
    }
}

/// Inertia of a unit point mass at `r`.
fn point_inertia(r: DVec3) -> DMat3 {
    let outer = DMat3::from_cols(r * r.x, r * r.y, r * r.z);
    DMat3::from_diagonal(DVec3::splat(r.length_squared())) - outer
}

impl Hull {
    /// The convex hull of points; `None` when they lie in a plane, on a line, or are too few (see [`Hull::of_sheet`]).
    ///
    /// At most [`MAX_VERTICES`] corners: those that stand out most are taken first, so that the hull of more lies inside the
    /// true one by as little as can be.
    pub fn of(points: &[DVec3]) -> Option<Self> {
        let (centre, axes) = principal_axes(points)?;
        let spread = axes.map(|axis| {
            let (low, high) = range(points, axis, centre);
            high - low
        });
        let largest = spread.into_iter().fold(0.0, f64::max);
        if spread.iter().any(|s| *s <= 1e-4 * largest || *s < 1e-6) {
            return None;
        }
        let points = if points.len() > 512 { extreme_points(points, 250) } else { distinct(points, largest * 1e-5) };
        let faces = quickhull(&points, largest * FLUSH, MAX_VERTICES)?;
        let hull = Self { vertices: points, faces }.without_unused();
        hull.is_sound().then_some(hull)
    }

    /// The convex hull of points that may lie in a plane or on a line: it is at least `thick` metres in every direction.
    ///
    /// What is too thin grows evenly to both sides, or upwards only when it lies flat: what rests on something still does.
    /// `None` without points.
    pub fn of_sheet(points: &[DVec3], thick: f64) -> Option<Self> {
        let mut points = points.to_vec();
        let (centre, axes) = principal_axes(&points)?;
        for axis in axes {
            let (low, high) = range(&points, axis, centre);
            let missing = thick - (high - low);
            if missing <= 0.0 {
                continue;
            }
            let up = if axis.y < 0.0 { -axis } else { axis };
            let flat = up.y > 0.7;
            let (down_by, up_by) = if flat { (0.0, missing) } else { (missing / 2.0, missing / 2.0) };
            // Only the far sides move; what lies between stays inside the hull.
            points = points.iter().flat_map(|p| [*p - up * down_by, *p + up * up_by]).collect();
            if points.len() > 4096 {
                points = extreme_points(&points, 250);
            }
        }
        Self::of(&points)
    }

    /// An upright box.
    pub fn cuboid(min: DVec3, max: DVec3) -> Self {
        let vertices = (0..8)
            .map(|i| {
                let pick = |bit: usize, l: f64, h: f64| if i & bit == 0 { l } else { h };
                DVec3::new(pick(1, min.x, max.x), pick(2, min.y, max.y), pick(4, min.z, max.z))
            })
            .collect();
        let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        Self { vertices, faces: quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect() }
    }

    fn without_unused(mut self) -> Self {
        let mut place = vec![u32::MAX; self.vertices.len()];
        let mut vertices = Vec::with_capacity(self.vertices.len());
        for i in self.faces.iter_mut().flatten() {
            let slot = &mut place[*i as usize];
            if *slot == u32::MAX {
                *slot = vertices.len() as u32;
                vertices.push(self.vertices[*i as usize]);
            }
            *i = *slot;
        }
        self.vertices = vertices;
        self
    }

    /// Whether every edge has two faces with opposite senses and the volume is positive.
    pub fn is_sound(&self) -> bool {
        let n = self.vertices.len();
        // A closed triangle mesh of a sphere's kind has 2 n - 4 faces.
        if n < 4 || self.faces.len() + 4 != 2 * n {
            return false;
        }
        let sides = |f: &[u32; 3]| [(f[0], f[1]), (f[1], f[2]), (f[2], f[0])];
        let mut edges: Vec<(u32, u32)> = self.faces.iter().flat_map(sides).collect();
        edges.sort_unstable();
        let once = edges.windows(2).all(|p| p[0] != p[1]) && edges.iter().all(|(a, _)| (*a as usize) < n);
        once && edges.iter().all(|(a, b)| edges.binary_search(&(*b, *a)).is_ok()) && self.moments().mass > 0.0
    }

    /// Corners of a face.
    pub fn corners(&self, face: [u32; 3]) -> [DVec3; 3] {
        face.map(|i| self.vertices[i as usize])
    }

    /// Outward unit normal and offset of each face's plane: `n . x = d`.
    pub fn planes(&self) -> impl Iterator<Item = (DVec3, f64)> + '_ {
        self.faces.iter().filter_map(|f| {
            let [a, b, c] = self.corners(*f);
            let n = (b - a).cross(c - a).try_normalize()?;
            Some((n, n.dot(a)))
        })
    }

    /// How far a point lies outside: the largest distance to a face's plane, negative inside.
    pub fn outside(&self, point: DVec3) -> f64 {
        self.planes().map(|(n, d)| n.dot(point) - d).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Distance of a point to the hull's surface, and whether it is inside.
    pub fn distance(&self, point: DVec3) -> (f64, bool) {
        let signed = self.outside(point);
        if signed <= 0.0 {
            return (-signed, true);
        }
        (self.to_faces(point), false)
    }

    /// Distance of a point to the nearest face.
    pub(crate) fn to_faces(&self, point: DVec3) -> f64 {
        let nearest = |f: &[u32; 3]| closest_on_triangle(point, self.corners(*f)).distance_squared(point);
        self.faces.iter().map(nearest).fold(f64::INFINITY, f64::min).sqrt()
    }

    /// Smallest and largest corner.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let fold = |f: fn(DVec3, DVec3) -> DVec3, start: DVec3| self.vertices.iter().fold(start, |a, v| f(a, *v));
        (fold(DVec3::min, DVec3::INFINITY), fold(DVec3::max, DVec3::NEG_INFINITY))
    }

    /// Volume, centroid and inertia at density 1.
    pub fn moments(&self) -> Moments {
        let origin = self.vertices.iter().sum::<DVec3>() / self.vertices.len().max(1) as f64;
        let mut volume = 0.0;
        let mut first = DVec3::ZERO;
        let mut second = DMat3::ZERO;
        for f in &self.faces {
            let [a, b, c] = self.corners(*f).map(|p| p - origin);
            let v = a.dot(b.cross(c)) / 6.0;
            volume += v;
            let sum = a + b + c;
            first += sum * (v / 4.0);
            // Second moments of a tetrahedron with one corner at the origin.
            let outer = |p: DVec3| DMat3::from_cols(p * p.x, p * p.y, p * p.z);
            second += (outer(a) + outer(b) + outer(c) + outer(sum)) * (v / 20.0);
        }
        if volume <= 0.0 || !volume.is_finite() {
            return Moments::NONE;
        }
        let centre = first / volume;
        let about = second - DMat3::from_cols(centre * centre.x, centre * centre.y, centre * centre.z) * volume;
        let trace = about.x_axis.x + about.y_axis.y + about.z_axis.z;
        let inertia = DMat3::from_diagonal(DVec3::splat(trace)) - about;
        Moments { mass: volume, centre: centre + origin, inertia }
    }

    /// Area of the surface, m2.
    pub fn area(&self) -> f64 {
        let one = |f: &[u32; 3]| {
            let [a, b, c] = self.corners(*f);
            (b - a).cross(c - a).length() / 2.0
        };
        self.faces.iter().map(one).sum()
    }

    /// Scaled by axis; positive factors only.
    #[must_use]
    pub fn scaled(&self, by: DVec3) -> Self {
        Self { vertices: self.vertices.iter().map(|v| *v * by).collect(), faces: self.faces.clone() }
    }

    /// Mapped by a proper motion.
    #[must_use]
    pub fn moved(&self, map: impl Fn(DVec3) -> DVec3) -> Self {
        Self { vertices: self.vertices.iter().map(|v| map(*v)).collect(), faces: self.faces.clone() }
    }
}

/// Hulls as a mesh of one colour.
pub fn hull_mesh(hulls: &[Hull], color: [f32; 3]) -> Mesh {
    let mut mesh = Mesh { materials: vec![Material::plain("body", color)], ..Mesh::default() };
    let mut group = Group::default();
    for hull in hulls {
        let base = mesh.positions.len() as u32;
        mesh.positions.extend(hull.vertices.iter().map(|v| v.as_vec3()));
        group.triangles.extend(hull.faces.iter().map(|f| f.map(|i| i + base)));
    }
    mesh.groups.push(group);
    mesh.uvs = vec![Vec2::ZERO; mesh.positions.len()];
    mesh.recompute_normals();
    mesh
}

/// The largest distance of a point to some planes, negative behind all of them.
pub(crate) fn beyond(planes: &[(DVec3, f64)], point: DVec3) -> f64 {
    planes.iter().map(|(n, d)| n.dot(point) - d).fold(f64::NEG_INFINITY, f64::max)
}

/// Evenly spread unit vectors (a spherical spiral).
pub(crate) fn directions(count: usize) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |k| {
        let y = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
        let r = (1.0 - y * y).max(0.0).sqrt();
        let turn = k as f64 * 2.399_963_229_728_653;
        DVec3::new(r * turn.cos(), y, r * turn.sin())
    })
}

/// The points that are farthest in many directions: the axes, `count` spread ones, and those near the axes that tell the
/// corners of upright boxes apart. In the order of `points`.
pub(crate) fn extreme_points(points: &[DVec3], count: usize) -> Vec<DVec3> {
    let signs = [-1.0, 1.0];
    let corners = signs
        .into_iter()
        .flat_map(move |x| signs.into_iter().flat_map(move |y| signs.into_iter().map(move |z| DVec3::new(x, y, z))));
    let near_axes = corners.flat_map(|d| {
        [DVec3::new(1.0, 0.01, 0.012), DVec3::new(0.01, 1.0, 0.012), DVec3::new(0.012, 0.01, 1.0), DVec3::ONE]
            .map(|w| d * w)
    });
    let keep: std::collections::BTreeSet<usize> = directions(count)
        .chain(near_axes)
        .filter_map(|d| {
            let along = points.iter().map(|p| p.dot(d)).enumerate();
            along.reduce(|best, one| if one.1 >= best.1 { one } else { best }).map(|(k, _)| k)
        })
        .collect();
    keep.into_iter().map(|i| points[i]).collect()
}

fn distinct(points: &[DVec3], step: f64) -> Vec<DVec3> {
    let step = step.max(1e-9);
    let mut seen = std::collections::BTreeSet::new();
    points.iter().filter(|p| seen.insert((**p / step).to_array().map(|v| v.round() as i64))).copied().collect()
}

/// Lowest and highest place along a direction, from `origin`.
fn range(points: &[DVec3], direction: DVec3, origin: DVec3) -> (f64, f64) {
    points
        .iter()
        .map(|p| (*p - origin).dot(direction))
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)))
}

/// Centre and three perpendicular directions, the widest first; `None` without finite points.
fn principal_axes(points: &[DVec3]) -> Option<(DVec3, [DVec3; 3])> {
    if points.is_empty() || points.iter().any(|p| !p.is_finite()) {
        return None;
    }
    let low = points.iter().fold(DVec3::INFINITY, |a, p| a.min(*p));
    let high = points.iter().fold(DVec3::NEG_INFINITY, |a, p| a.max(*p));
    let centre = (low + high) / 2.0;
    // Farthest pair of extremes, then the farthest from that line, then across: enough to tell flat from full.
    let far = |f: &dyn Fn(DVec3) -> f64| points.iter().copied().max_by(|a, b| f(*a).total_cmp(&f(*b)));
    let a = far(&|p| p.distance_squared(centre))?;
    let b = far(&|p| p.distance_squared(a))?;
    let Some(first) = (b - a).try_normalize() else { return Some((centre, [DVec3::X, DVec3::Z, DVec3::Y])) };
    let c = far(&|p| (p - a).reject_from_normalized(first).length_squared())?;
    let off = (c - a).reject_from_normalized(first);
    let second = if off.length() > 1e-9 { off.normalize_or(DVec3::X) } else { first.any_orthonormal_vector() };
    Some((centre, [first, second, first.cross(second)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_has_the_volume_and_inertia_of_the_books() {
        let (w, h, d) = (0.4, 1.2, 0.3);
        let low = DVec3::new(1.0, -2.0, 0.5);
        for hull in [
            Hull::cuboid(low, low + DVec3::new(w, h, d)),
            Hull::of(&Hull::cuboid(low, low + DVec3::new(w, h, d)).vertices).unwrap(),
        ] {
            assert!(hull.is_sound());
            let m = hull.moments();
            assert!((m.mass - w * h * d).abs() < 1e-6 * m.mass, "{m:?}");
            assert!(m.centre.distance(low + DVec3::new(w, h, d) / 2.0) < 1e-6);
            let want = DVec3::new(h * h + d * d, w * w + d * d, w * w + h * h) * (m.mass / 12.0);
            let got = DVec3::new(m.inertia.x_axis.x, m.inertia.y_axis.y, m.inertia.z_axis.z);
            assert!((got - want).abs().max_element() < 1e-5 * want.max_element(), "{got} {want}");
            assert!(m.inertia.x_axis.y.abs() < 1e-9);
            assert!((hull.area() - 2.0 * (w * h + h * d + w * d)).abs() < 1e-5);
        }
    }

    #[test]
    fn a_board_with_finely_rounded_edges_is_convex() {
        for (radius, steps) in [(0.001, 3), (0.002, 4), (0.003, 6), (0.004, 4), (0.004, 8), (0.006, 5)] {
            let size = DVec3::new(1.494, 0.035, 0.686);
            let inner = size / 2.0 - radius;
            let mut points = Vec::new();
            for corner in 0..8 {
                let sign = DVec3::from_array(std::array::from_fn(|a| if corner >> a & 1 == 0 { -1.0 } else { 1.0 }));
                for (i, k) in (0..=steps).flat_map(|i| (0..=steps).map(move |k| (i, k))) {
                    let [up, round] = [i, k].map(|v| f64::from(v) / f64::from(steps) * std::f64::consts::FRAC_PI_2);
                    let d = DVec3::new(up.cos() * round.cos(), up.sin(), up.cos() * round.sin());
                    // In single precision, as meshes have them.
                    points.push((sign * (inner + d * radius)).as_vec3().as_dvec3());
                }
            }
            let hull = Hull::of(&points).unwrap();
            let planes: Vec<(DVec3, f64)> = hull.planes().collect();
            let bulge = hull.vertices.iter().map(|v| beyond(&planes, *v)).fold(0.0, f64::max);
            assert!(bulge < 1e-9, "{radius} {steps}: {bulge}");
            let (volume, whole) = (hull.moments().mass, size.element_product());
            // Of the rounding no more corners are kept than a hull may have.
            assert!(volume < whole && volume > 0.98 * whole, "{radius} {steps}: {volume} of {whole}");
            let most = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
            assert!(hull.area() < most && hull.area() > 0.97 * most, "{radius} {steps}: {} of {most}", hull.area());
            // A point of the underside is on the surface, wherever it is.
            for x in [-0.7, -0.31, 0.02, 0.44] {
                let at = DVec3::new(x, -size.y / 2.0, 0.13);
                assert!(hull.to_faces(at) < 1e-3 && hull.outside(at).abs() < 1e-3, "{radius} {steps}: {at}");
            }
        }
    }

    #[test]
    fn a_tetrahedron_and_a_ball_too() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let m = Hull::of(&corners).unwrap().moments();
        assert!((m.mass - 1.0 / 6.0).abs() < 1e-7 && m.centre.distance(DVec3::splat(0.25)) < 1e-6);
        // Ixx of the unit corner tetrahedron at density 1: 1/80 about its centroid.
        assert!((m.inertia.x_axis.x - 1.0 / 80.0).abs() < 1e-6, "{}", m.inertia.x_axis.x);
        let ball: Vec<DVec3> = directions(2000).map(|d| d * 0.5).collect();
        let hull = Hull::of(&ball).unwrap();
        assert!(hull.vertices.len() <= MAX_VERTICES && hull.is_sound());
        let m = hull.moments();
        let full = std::f64::consts::PI / 6.0;
        assert!(m.mass < full && m.mass > 0.9 * full, "{} of {full}", m.mass);
        let solid = 0.4 * m.mass * 0.25;
        assert!((m.inertia.y_axis.y / solid - 1.0).abs() < 0.1);
    }

    #[test]
    fn halves_of_a_box_together_have_its_moments() {
        let whole = Hull::cuboid(DVec3::ZERO, DVec3::new(2.0, 1.0, 1.0)).moments();
        let left = Hull::cuboid(DVec3::ZERO, DVec3::new(0.7, 1.0, 1.0)).moments();
        let right = Hull::cuboid(DVec3::new(0.7, 0.0, 0.0), DVec3::new(2.0, 1.0, 1.0)).moments();
        let both = left.and(right);
        assert!((both.mass - whole.mass).abs() < 1e-12 && both.centre.distance(whole.centre) < 1e-12);
        let apart = both.inertia - whole.inertia;
        assert!([apart.x_axis, apart.y_axis, apart.z_axis].iter().all(|c| c.abs().max_element() < 1e-12));
    }

    #[test]
    fn sheets_and_needles_get_thickness_and_what_lies_keeps_its_underside() {
        let sheet = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 0.0, 1.0), DVec3::Z];
        assert!(Hull::of(&sheet).is_none());
        let hull = Hull::of_sheet(&sheet, 0.004).unwrap();
        let (low, high) = hull.bounds();
        assert!(low.y.abs() < 1e-6 && (high.y - 0.004).abs() < 1e-6, "{low} {high}");
        assert!((hull.moments().mass - 0.004).abs() < 1e-5);
        let upright = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y];
        let (low, high) = Hull::of_sheet(&upright, 0.004).unwrap().bounds();
        assert!((low.z + 0.002).abs() < 1e-6 && (high.z - 0.002).abs() < 1e-6);
        let needle = [DVec3::ZERO, DVec3::new(0.3, 0.1, 0.0), DVec3::new(0.6, 0.2, 0.0)];
        assert!(Hull::of_sheet(&needle, 0.004).unwrap().is_sound());
        assert!(Hull::of_sheet(&[DVec3::ONE], 0.004).unwrap().is_sound());
        assert!(Hull::of_sheet(&[], 0.004).is_none());
        assert!(Hull::of_sheet(&[DVec3::NAN], 0.004).is_none());
    }

    #[test]
    fn distances_to_a_box() {
        let hull = Hull::cuboid(DVec3::ZERO, DVec3::ONE);
        let (d, inside) = hull.distance(DVec3::new(0.5, 0.5, 0.9));
        assert!(inside && (d - 0.1).abs() < 1e-12);
        let (d, inside) = hull.distance(DVec3::new(1.3, 1.4, 0.5));
        assert!(!inside && (d - 0.5).abs() < 1e-12);
    }
}
