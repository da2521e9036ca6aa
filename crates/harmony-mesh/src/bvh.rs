//! A bounding volume hierarchy over one mesh: rays and closest points.
//!
//! Built top-down with the surface area heuristic over binned centroids (Wald, "On fast construction of SAH-based
//! bounding volume hierarchies", 2007). Rays use the slab test on boxes and the Moller-Trumbore test on triangles,
//! closest points Ericson's region test ("Real-Time Collision Detection", 5.1.5). All in double precision.

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
pub struct Bvh {
    /// In depth-first order; the first is the root.
    nodes: Vec<Node>,
    /// Grouped by leaf.
    triangles: Vec<Triangle>,
}

#[derive(Debug, Clone, Copy)]
struct Triangle {
    corners: [DVec3; 3],
    index: usize,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    bounds: Aabb,
    kind: Kind,
}

#[derive(Debug, Clone, Copy)]
enum Kind {
    /// `triangles[start..end]`.
    Leaf { start: usize, end: usize },
    /// The first child follows its parent, the second is here.
    Inner { second: usize },
}

#[derive(Debug, Clone, Copy)]
struct Aabb {
    min: DVec3,
    max: DVec3,
}

impl Aabb {
    const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    fn of(triangle: &Triangle) -> Self {
        let [a, b, c] = triangle.corners;
        Self { min: a.min(b).min(c), max: a.max(b).max(c) }
    }

    fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    fn half_area(&self) -> f64 {
        let d = (self.max - self.min).max(DVec3::ZERO);
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    /// Distance at which a ray enters, if it does so before `max`.
    fn enter(&self, ray: &RayTest, max: f64) -> Option<f64> {
        let (mut near, mut far) = (0.0_f64, max);
        for axis in 0..3 {
            let (o, d) = (ray.origin[axis], ray.direction[axis]);
            if d == 0.0 {
                if o < self.min[axis] || o > self.max[axis] {
                    return None;
                }
                continue;
            }
            let (t0, t1) = ((self.min[axis] - o) * ray.inverse[axis], (self.max[axis] - o) * ray.inverse[axis]);
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1));
        }
        // A little slack: a flat box must not lose its triangle to rounding.
        (near <= far + 1e-12 * (1.0 + far.abs())).then_some(near)
    }

    fn distance_squared(&self, p: DVec3) -> f64 {
        (p - p.clamp(self.min, self.max)).length_squared()
    }
}

struct RayTest {
    origin: DVec3,
    direction: DVec3,
    inverse: DVec3,
}

/// Most triangles of a leaf that is not worth splitting.
const LEAF: usize = 4;

/// Bins a node's centroids are counted in.
const BINS: usize = 16;

/// Depth from which nodes are split in the middle of their list, so that no input makes a deep tree.
const SAH_DEPTH: usize = 48;

impl Bvh {
    /// Builds the tree; triangles with bad indices or coordinates are left out.
    pub fn new(mesh: &Mesh) -> Self {
        let corner = |i: u32| mesh.positions.get(i as usize).map(|p| p.as_dvec3()).filter(|p| p.is_finite());
        let mut triangles: Vec<Triangle> = mesh
            .triangles()
            .enumerate()
            .filter_map(|(index, t)| Some(Triangle { corners: [corner(t[0])?, corner(t[1])?, corner(t[2])?], index }))
            .collect();
        let mut nodes = Vec::with_capacity(triangles.len() / 2 + 1);
        if !triangles.is_empty() {
            build(&mut triangles, 0, 0, &mut nodes);
        }
        Self { nodes, triangles }
    }

    /// Number of triangles in the tree.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// First triangle met by a ray within `max` of its origin, from either side.
    ///
    /// `direction` need not be a unit vector; distances are in the mesh's unit all the same. Of equal distances the
    /// lower triangle index wins.
    pub fn raycast(&self, origin: DVec3, direction: DVec3, max: f64) -> Option<Hit> {
        self.cast(origin, direction, max, false)
    }

    /// Whether a ray meets anything within `max` of its origin.
    pub fn any_hit(&self, origin: DVec3, direction: DVec3, max: f64) -> bool {
        self.cast(origin, direction, max, true).is_some()
    }

    /// All triangles met by a ray within `max` of its origin, from either side, nearest first. An edge between two
    /// triangles is met twice.
    pub fn crossings(&self, origin: DVec3, direction: DVec3, max: f64) -> Vec<Hit> {
        let Some(direction) = direction.try_normalize().filter(|_| origin.is_finite() && !max.is_nan()) else {
            return Vec::new();
        };
        let ray = RayTest { origin, direction, inverse: direction.recip() };
        let mut hits = Vec::new();
        let mut stack = vec![0];
        while let Some(i) = stack.pop() {
            let Some(node) = self.nodes.get(i).filter(|node| node.bounds.enter(&ray, max).is_some()) else { continue };
            match node.kind {
                Kind::Leaf { start, end } => {
                    let met = self.triangles[start..end].iter().filter_map(|t| Some((meet(&ray, t)?, t)));
                    hits.extend(met.filter(|(k, _)| *k <= max).map(|(distance, t)| Hit {
                        distance,
                        triangle: t.index,
                        point: origin + direction * distance,
                        normal: t.normal(),
                    }));
                }
                Kind::Inner { second } => stack.extend([second, i + 1]),
            }
        }
        hits.sort_by(|a, b| a.distance.total_cmp(&b.distance).then(a.triangle.cmp(&b.triangle)));
        hits
    }

    fn cast(&self, origin: DVec3, direction: DVec3, max: f64, any: bool) -> Option<Hit> {
        let direction = direction.try_normalize()?;
        if !origin.is_finite() || max.is_nan() {
            return None;
        }
        let ray = RayTest { origin, direction, inverse: direction.recip() };
        let mut best: Option<(f64, &Triangle)> = None;
        let mut limit = max;
        let mut stack = Vec::with_capacity(64);
        stack.extend(self.nodes.first().and_then(|root| root.bounds.enter(&ray, limit)).map(|near| (near, 0)));
        while let Some((near, i)) = stack.pop() {
            if near > limit {
                continue;
            }
            match self.nodes[i].kind {
                Kind::Leaf { start, end } => {
                    for t in &self.triangles[start..end] {
                        let Some(k) = meet(&ray, t).filter(|k| *k <= limit) else { continue };
                        if best.is_none_or(|(b, old)| k < b || (k == b && t.index < old.index)) {
                            limit = k;
                            best = Some((k, t));
                        }
                        if any {
                            break;
                        }
                    }
                    if any && best.is_some() {
                        break;
                    }
                }
                Kind::Inner { second } => {
                    let child = |c: usize| self.nodes[c].bounds.enter(&ray, limit).map(|near| (near, c));
                    push_nearest_last(&mut stack, child(i + 1), child(second));
                }
            }
        }
        let (distance, t) = best?;
        Some(Hit { distance, triangle: t.index, point: origin + direction * distance, normal: t.normal() })
    }

    /// The point of the mesh that is closest to `point`; `None` when the mesh has no triangle.
    pub fn closest_point(&self, point: DVec3) -> Option<Hit> {
        if !point.is_finite() {
            return None;
        }
        let mut best: Option<(f64, DVec3, &Triangle)> = None;
        let mut stack = Vec::with_capacity(64);
        stack.extend(self.nodes.first().map(|root| (root.bounds.distance_squared(point), 0)));
        while let Some((near, i)) = stack.pop() {
            if best.is_some_and(|(d, ..)| near > d) {
                continue;
            }
            match self.nodes[i].kind {
                Kind::Leaf { start, end } => {
                    for t in &self.triangles[start..end] {
                        let q = closest_on_triangle(point, t.corners);
                        let d = q.distance_squared(point);
                        if best.is_none_or(|(b, _, old)| d < b || (d == b && t.index < old.index)) {
                            best = Some((d, q, t));
                        }
                    }
                }
                Kind::Inner { second } => {
                    let child = |c: usize| Some((self.nodes[c].bounds.distance_squared(point), c));
                    push_nearest_last(&mut stack, child(i + 1), child(second));
                }
            }
        }
        best.map(|(d, q, t)| Hit { distance: d.sqrt(), triangle: t.index, point: q, normal: t.normal() })
    }
}

/// Puts the nearer child on top of the stack.
fn push_nearest_last(stack: &mut Vec<(f64, usize)>, a: Option<(f64, usize)>, b: Option<(f64, usize)>) {
    match (a, b) {
        (Some(a), Some(b)) if a.0 <= b.0 => stack.extend([b, a]),
        (Some(a), Some(b)) => stack.extend([a, b]),
        (a, b) => stack.extend(a.or(b)),
    }
}

impl Triangle {
    fn centroid(&self) -> DVec3 {
        let [a, b, c] = self.corners;
        (a + b + c) / 3.0
    }

    /// Unit normal by the winding; +Y for a triangle without area.
    fn normal(&self) -> DVec3 {
        let [a, b, c] = self.corners;
        (b - a).cross(c - a).try_normalize().unwrap_or(DVec3::Y)
    }
}

/// Appends the subtree over `triangles` (which begin at `start` of the whole list) in depth-first order.
fn build(triangles: &mut [Triangle], start: usize, depth: usize, nodes: &mut Vec<Node>) {
    let bounds = triangles.iter().map(Aabb::of).fold(Aabb::EMPTY, Aabb::union);
    let at = nodes.len();
    nodes.push(Node { bounds, kind: Kind::Leaf { start, end: start + triangles.len() } });
    if triangles.len() <= LEAF {
        return;
    }
    let centres = triangles.iter().map(Triangle::centroid);
    let (low, high) = centres.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), c| (l.min(c), h.max(c)));
    let axis = (high - low).max_position();
    let extent = high[axis] - low[axis];
    let bin = |t: &Triangle| (((t.centroid()[axis] - low[axis]) / extent * BINS as f64) as usize).min(BINS - 1);
    let middle = if depth < SAH_DEPTH && extent > 0.0 {
        let split = best_split(triangles, bin);
        let mut n = 0;
        for i in 0..triangles.len() {
            if bin(&triangles[i]) < split {
                triangles.swap(i, n);
                n += 1;
            }
        }
        n
    } else {
        triangles.sort_by(|a, b| a.centroid()[axis].total_cmp(&b.centroid()[axis]).then(a.index.cmp(&b.index)));
        triangles.len() / 2
    };
    if middle == 0 || middle == triangles.len() {
        return;
    }
    let (first, second) = triangles.split_at_mut(middle);
    build(first, start, depth + 1, nodes);
    let second_at = nodes.len();
    build(second, start + middle, depth + 1, nodes);
    nodes[at].kind = Kind::Inner { second: second_at };
}

/// The first bin of the right side in the cheapest split.
fn best_split(triangles: &[Triangle], bin: impl Fn(&Triangle) -> usize) -> usize {
    let mut counts = [0_usize; BINS];
    let mut boxes = [Aabb::EMPTY; BINS];
    for t in triangles {
        let b = bin(t);
        counts[b] += 1;
        boxes[b] = boxes[b].union(Aabb::of(t));
    }
    let cost = |range: std::ops::Range<usize>| {
        let n: usize = counts[range.clone()].iter().sum();
        let b = boxes[range].iter().copied().fold(Aabb::EMPTY, Aabb::union);
        if n == 0 { f64::INFINITY } else { n as f64 * b.half_area() }
    };
    (1..BINS).min_by(|a, b| (cost(0..*a) + cost(*a..BINS)).total_cmp(&(cost(0..*b) + cost(*b..BINS)))).unwrap_or(1)
}

/// Distance along the ray to a triangle, from either side.
fn meet(ray: &RayTest, t: &Triangle) -> Option<f64> {
    /// Barycentric slack, so that a ray at a shared edge does not slip through.
    const SLACK: f64 = 1e-12;
    let [a, b, c] = t.corners;
    let (e1, e2) = (b - a, c - a);
    let p = ray.direction.cross(e2);
    let determinant = e1.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let from_a = ray.origin - a;
    let u = from_a.dot(p) / determinant;
    let q = from_a.cross(e1);
    let v = ray.direction.dot(q) / determinant;
    let k = e2.dot(q) / determinant;
    (u >= -SLACK && v >= -SLACK && u + v <= 1.0 + SLACK && k >= 0.0).then_some(k)
}

/// The closest point of a triangle, by the region that `p` projects into (Ericson 2005, 5.1.5).
pub fn closest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    let (e, f) = (d4 - d3, d5 - d6);
    if va <= 0.0 && e >= 0.0 && f >= 0.0 && e + f > 0.0 {
        return b + (c - b) * (e / (e + f));
    }
    let sum = va + vb + vc;
    if sum == 0.0 { a } else { a + ab * (vb / sum) + ac * (vc / sum) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Group, Material};
    use glam::Vec3;

    /// Numbers in -1..1 from a fixed linear congruential generator.
    struct Numbers(u64);

    impl Numbers {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        }

        fn point(&mut self) -> DVec3 {
            DVec3::new(self.next(), self.next(), self.next())
        }
    }

    fn mesh(corners: &[DVec3]) -> Mesh {
        let n = corners.len() as u32;
        let mut mesh = Mesh {
            positions: corners.iter().map(|p| p.as_vec3()).collect(),
            uvs: vec![glam::Vec2::ZERO; corners.len()],
            groups: vec![Group { material: 0, triangles: (0..n / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect() }],
            materials: vec![Material::plain("m", [1.0; 3])],
            ..Mesh::default()
        };
        mesh.recompute_normals();
        mesh
    }

    fn soup(n: usize, seed: u64) -> Mesh {
        let mut r = Numbers(seed);
        let mut corners = Vec::new();
        for _ in 0..n {
            let c = r.point();
            corners.extend((0..3).map(|_| c + r.point() * 0.1));
        }
        mesh(&corners)
    }

    /// Ray against plane, then the three edge signs: independent of the test inside the tree.
    fn plain_ray(origin: DVec3, direction: DVec3, t: [DVec3; 3]) -> Option<f64> {
        let n = (t[1] - t[0]).cross(t[2] - t[0]);
        let k = n.dot(t[0] - origin) / n.dot(direction);
        let p = origin + direction * k;
        let inside = (0..3).all(|i| (t[(i + 1) % 3] - t[i]).cross(p - t[i]).dot(n) >= 0.0);
        (k >= 0.0 && inside).then_some(k)
    }

    #[test]
    fn rays_find_what_a_loop_over_all_triangles_finds() {
        let mesh = soup(800, 3);
        let bvh = Bvh::new(&mesh);
        let all: Vec<[DVec3; 3]> = mesh.triangles().map(|t| t.map(|i| mesh.positions[i as usize].as_dvec3())).collect();
        let mut r = Numbers(9);
        let mut hits = 0;
        for _ in 0..500 {
            let origin = r.point() * 2.0;
            let direction = r.point() * 0.7 - origin;
            let unit = direction.normalize();
            let mut every: Vec<f64> = all.iter().filter_map(|t| plain_ray(origin, unit, *t)).collect();
            every.sort_by(f64::total_cmp);
            let met: Vec<f64> =
                bvh.crossings(origin, direction, f64::INFINITY).iter().map(|hit| hit.distance).collect();
            assert_eq!(met.len(), every.len());
            assert!(met.iter().zip(&every).all(|(a, b)| (a - b).abs() <= 1e-9 * (1.0 + b)), "{met:?} {every:?}");
            let want = every.first().copied();
            let got = bvh.raycast(origin, direction, f64::INFINITY);
            assert_eq!(want.is_some(), got.is_some());
            assert_eq!(want.is_some(), bvh.any_hit(origin, direction, 100.0));
            if let (Some(want), Some(got)) = (want, got) {
                hits += 1;
                assert!((want - got.distance).abs() <= 1e-9 * (1.0 + want), "{want} {got:?}");
                assert!((origin + unit * want - got.point).length() <= 1e-8);
                assert!(bvh.raycast(origin, direction, want * 0.99).is_none(), "nothing before the first hit");
                assert!(!bvh.any_hit(origin, direction, want * 0.99));
            }
        }
        assert!(hits > 100, "the rays must meet something: {hits}");
    }

    #[test]
    fn the_closest_point_is_on_its_triangle_and_nothing_sampled_is_closer() {
        let mesh = soup(60, 5);
        let bvh = Bvh::new(&mesh);
        let all: Vec<[DVec3; 3]> = mesh.triangles().map(|t| t.map(|i| mesh.positions[i as usize].as_dvec3())).collect();
        let mut r = Numbers(11);
        for _ in 0..200 {
            let p = r.point() * 1.5;
            let got = bvh.closest_point(p).unwrap();
            assert!(((got.point - p).length() - got.distance).abs() <= 1e-12);
            let [a, b, c] = all[got.triangle];
            let plane = (b - a).cross(c - a).normalize().dot(got.point - a);
            assert!(plane.abs() <= 1e-9, "off its plane by {plane}");
            for [a, b, c] in &all {
                for i in 0..=12 {
                    for j in 0..=12 - i {
                        let s = *a + (*b - *a) * (f64::from(i) / 12.0) + (*c - *a) * (f64::from(j) / 12.0);
                        assert!(s.distance(p) >= got.distance - 1e-12);
                    }
                }
            }
        }
    }

    #[test]
    fn a_ray_down_onto_a_table_top_gives_height_and_upward_normal() {
        let y = 0.75;
        let q = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, z)| DVec3::new(x, y, z));
        let bvh = Bvh::new(&mesh(&[q[0], q[2], q[1], q[0], q[3], q[2]]));
        // Right on the shared diagonal.
        let hit = bvh.raycast(DVec3::new(0.3, 2.0, 0.3), DVec3::NEG_Y * 7.0, 5.0).unwrap();
        assert!((hit.distance - 1.25).abs() <= 1e-12);
        assert!((hit.normal - DVec3::Y).length() <= 1e-12);
        let under = bvh.raycast(DVec3::new(0.1, 0.0, 0.3), DVec3::Y, 5.0).unwrap();
        assert!((under.normal - DVec3::Y).length() <= 1e-12, "normals follow the winding, not the ray");
        assert!(bvh.raycast(DVec3::new(1.2, 2.0, 0.0), DVec3::NEG_Y, 5.0).is_none());
    }

    #[test]
    fn odd_meshes_and_queries_do_not_panic() {
        let empty = Bvh::new(&Mesh::default());
        assert!(empty.raycast(DVec3::ZERO, DVec3::X, 1.0).is_none());
        assert!(empty.closest_point(DVec3::ZERO).is_none());
        let mut bad = soup(5, 1);
        bad.positions[0] = Vec3::NAN;
        bad.groups[0].triangles.push([0, 1, 999]);
        let bvh = Bvh::new(&bad);
        assert_eq!(bvh.triangle_count(), 4);
        for v in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
            assert!(bvh.raycast(v, v, f64::NAN).is_none());
            let _ = bvh.closest_point(v);
        }
        // Ten thousand copies of one triangle.
        let same = Bvh::new(&mesh(&[DVec3::ZERO, DVec3::X, DVec3::Z].repeat(10_000)));
        let hit = same.raycast(DVec3::new(0.2, 1.0, 0.2), DVec3::NEG_Y, 2.0).unwrap();
        assert_eq!(hit.triangle, 0, "of equal distances the lowest index");
    }
}
