//! The form of an object that silhouettes and depths are drawn from.
//!
//! A mesh of 80,000 faces is drawn hundreds of times while its object is solved. Its simple form
//! (`harmony_mesh::simple_form`) is welded, closed surfaces are wound outwards so that back faces can be skipped, and
//! what is still too large is clustered on a grid (Rossignac and Borrel, "Multi-resolution 3D approximations", 1993).
//! Canonical frame and units of the mesh. Outlines move by at most half a cell's diagonal, about 1 % of the object.

use std::collections::{BTreeMap, HashMap};

use glam::Vec3;
use harmony_mesh::Mesh;

/// More triangles than this are too many to draw in the inner loop.
const MAX_TRIANGLES: usize = 6000;

/// Cells along the longest side of the clustering grid for what cannot be simplified so far (foliage): 1 % of the object,
/// below a pixel of the window.
const CELLS: f64 = 96.0;

/// Triangles of the same outline as a mesh, in its frame.
#[derive(Debug, Clone, Default)]
pub struct Proxy {
    /// Each once, and none unused.
    pub(crate) points: Vec<Vec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
    /// So many triangles at the front belong to closed surfaces and are wound outwards (counter-clockwise from outside):
    /// those that look away from the camera are hidden by others.
    pub(crate) closed: usize,
}

impl Proxy {
    /// Area of its faces, square canonical units.
    pub(crate) fn area(&self) -> f64 {
        let half = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| self.points[i as usize]);
            0.5 * f64::from((b - a).cross(c - a).length())
        };
        self.triangles.iter().map(half).sum()
    }

    /// A box.
    pub(crate) fn boxed(low: Vec3, high: Vec3) -> Self {
        let pick = |i: u32, bit: u32, axis: usize| if i & bit == 0 { low[axis] } else { high[axis] };
        let points = (0..8).map(|i| Vec3::new(pick(i, 1, 0), pick(i, 2, 1), pick(i, 4, 2))).collect();
        let sides: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = sides.map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).concat();
        Self::of(points, &triangles)
    }

    /// From the [`harmony_mesh::simple_form`] of a mesh.
    pub(crate) fn new(form: &Mesh) -> Self {
        let proxy = Self::welded(form);
        if proxy.triangles.len() <= MAX_TRIANGLES {
            return proxy;
        }
        let extent = form.bounds().map_or(1.0, |b| b.size().max_element());
        proxy.clustered(extent / CELLS)
    }

    /// Equal positions become one; triangles without area in the index, or with positions that are none, go.
    fn welded(mesh: &Mesh) -> Self {
        let mut place: HashMap<[u32; 3], u32> = HashMap::with_capacity(mesh.positions.len());
        let mut points: Vec<Vec3> = Vec::new();
        let mut index = |i: u32| {
            let p = *mesh.positions.get(i as usize).filter(|p| p.is_finite())?;
            // Adding zero turns -0 into 0.
            Some(*place.entry((p + 0.0).to_array().map(f32::to_bits)).or_insert_with(|| {
                points.push(p);
                points.len() as u32 - 1
            }))
        };
        let mut triangles = Vec::with_capacity(mesh.triangle_count());
        for [a, b, c] in mesh.triangles() {
            let (Some(a), Some(b), Some(c)) = (index(a), index(b), index(c)) else { continue };
            if a != b && b != c && c != a {
                triangles.push([a, b, c]);
            }
        }
        Self::of(points, &triangles)
    }

    /// Closed surfaces first, all wound outwards.
    fn of(points: Vec<Vec3>, triangles: &[[u32; 3]]) -> Self {
        let (mut closed, mut open) = (Vec::with_capacity(triangles.len()), Vec::new());
        for surface in surfaces(triangles) {
            let all = surface.iter().map(|i| triangles[*i]);
            if !is_closed(triangles, &surface) {
                open.extend(all);
            } else if volume(&points, triangles, &surface) >= 0.0 {
                closed.extend(all);
            } else {
                closed.extend(all.map(|[a, b, c]| [a, c, b]));
            }
        }
        let count = closed.len();
        closed.extend(open);
        Self { points, triangles: closed, closed: count }
    }

    /// Vertex clustering (Rossignac and Borrel 1993): vertices of one grid cell become their mean.
    ///
    /// Outlines move by at most half a cell's diagonal; triangles that fall into one cell or edge vanish.
    fn clustered(&self, cell: f64) -> Self {
        let key = |p: Vec3| (p.as_dvec3() / cell).round().as_ivec3().to_array();
        let mut cells: BTreeMap<[i32; 3], (u32, glam::DVec3, f64)> = BTreeMap::new();
        for p in &self.points {
            let next = cells.len() as u32;
            let entry = cells.entry(key(*p)).or_insert((next, glam::DVec3::ZERO, 0.0));
            entry.1 += p.as_dvec3();
            entry.2 += 1.0;
        }
        let mut points = vec![Vec3::ZERO; cells.len()];
        for (index, sum, count) in cells.values() {
            points[*index as usize] = (*sum / *count).as_vec3();
        }
        let of_point: Vec<u32> = self.points.iter().map(|p| cells.get(&key(*p)).map_or(0, |c| c.0)).collect();
        let moved = self.triangles.iter().map(|t| t.map(|i| of_point[i as usize]));
        let mut triangles: Vec<[u32; 3]> = moved.filter(|t| t[0] != t[1] && t[1] != t[2] && t[0] != t[2]).collect();
        for t in &mut triangles {
            // One rotation for each triangle, so that duplicates meet.
            let first = (0..3).min_by_key(|i| t[*i]).unwrap_or(0);
            t.rotate_left(first);
        }
        triangles.sort_unstable();
        triangles.dedup();
        Self::of(points, &triangles)
    }
}

/// The directed edges of a triangle.
fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// Numbers of the triangles that hang together by their edges.
fn surfaces(triangles: &[[u32; 3]]) -> Vec<Vec<usize>> {
    let mut by_edge: HashMap<[u32; 2], usize> = HashMap::with_capacity(triangles.len() * 2);
    // Union and find, with halved paths.
    let mut parent: Vec<usize> = (0..triangles.len()).collect();
    let root = |parent: &mut Vec<usize>, mut i: usize| {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    };
    for (i, t) in triangles.iter().enumerate() {
        for [a, b] in edges(*t) {
            let other = *by_edge.entry([a.min(b), a.max(b)]).or_insert(i);
            let (one, two) = (root(&mut parent, i), root(&mut parent, other));
            parent[one.max(two)] = one.min(two);
        }
    }
    let mut surfaces: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for i in 0..triangles.len() {
        surfaces.entry(root(&mut parent, i)).or_default().push(i);
    }
    surfaces.into_values().collect()
}

/// Whether every edge is passed as often in one direction as in the other.
fn is_closed(triangles: &[[u32; 3]], surface: &[usize]) -> bool {
    let mut along: Vec<[u32; 2]> = surface.iter().flat_map(|i| edges(triangles[*i])).collect();
    let mut against: Vec<[u32; 2]> = along.iter().map(|[a, b]| [*b, *a]).collect();
    along.sort_unstable();
    against.sort_unstable();
    along == against
}

/// Six times the volume that a closed surface encloses; negative when it is wound inwards.
fn volume(points: &[Vec3], triangles: &[[u32; 3]], surface: &[usize]) -> f64 {
    let corners = surface.iter().map(|i| triangles[*i].map(|k| points[k as usize].as_dvec3()));
    corners.map(|[a, b, c]| a.dot(b.cross(c))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::box_mesh;
    use harmony_mesh::{Group, Material};

    #[test]
    fn boxes_are_closed_and_wound_outwards_and_an_open_one_is_not() {
        let whole = box_mesh(glam::DVec3::new(1.0, 0.5, 2.0));
        let proxy = Proxy::new(&whole);
        assert_eq!((proxy.points.len(), proxy.triangles.len(), proxy.closed), (8, 12, 12));
        let mut inside_out = whole.clone();
        inside_out.groups.iter_mut().flat_map(|g| &mut g.triangles).for_each(|t| t.reverse());
        for mesh in [&whole, &inside_out] {
            let proxy = Proxy::new(mesh);
            let middle = proxy.points.iter().sum::<Vec3>() / 8.0;
            assert!(proxy.triangles.iter().all(|t| {
                let [a, b, c] = t.map(|i| proxy.points[i as usize]);
                (b - a).cross(c - a).dot(a - middle) > 0.0
            }));
        }
        // One box without a lid beside a closed one.
        let mut open = whole.clone();
        let moved = |p: &Vec3| *p + Vec3::X * 3.0;
        let count = open.positions.len() as u32;
        let more: Vec<Vec3> = whole.positions.iter().map(moved).collect();
        open.positions.extend(more);
        open.normals.extend(whole.normals.iter());
        open.uvs.extend(whole.uvs.iter());
        let lidless: Vec<[u32; 3]> = whole.triangles().skip(2).map(|t| t.map(|i| i + count)).collect();
        open.groups[0].triangles.extend(lidless);
        let proxy = Proxy::new(&open);
        assert_eq!((proxy.triangles.len(), proxy.closed), (22, 12));
        // Two boxes that share an edge, which is passed twice each way, are one closed surface.
        let mut joined = whole.clone();
        let beside: Vec<Vec3> = whole.positions.iter().map(|p| *p + Vec3::new(1.0, 0.5, 0.0)).collect();
        joined.positions.extend(beside);
        joined.groups[0].triangles.extend(whole.triangles().map(|t| t.map(|i| i + count)));
        assert_eq!(Proxy::new(&joined).closed, 24);
        assert_eq!(surfaces(&Proxy::new(&joined).triangles).len(), 1);
    }

    #[test]
    fn a_fine_sphere_becomes_a_coarse_one_of_the_same_size() {
        let (rows, columns) = (120_u32, 120_u32);
        let mut mesh = Mesh::default();
        for i in 0..=rows {
            for j in 0..columns {
                let (a, b) =
                    (std::f32::consts::PI * i as f32 / rows as f32, std::f32::consts::TAU * j as f32 / columns as f32);
                // The poles are one point each.
                let ring = if i % rows == 0 { 0.0 } else { a.sin() };
                mesh.positions.push(Vec3::new(ring * b.cos(), 1.0 + a.cos(), ring * b.sin()));
            }
        }
        let mut triangles = Vec::new();
        for i in 0..rows {
            for j in 0..columns {
                let k = (j + 1) % columns;
                triangles.push([i * columns + j, (i + 1) * columns + k, (i + 1) * columns + j]);
                triangles.push([i * columns + j, i * columns + k, (i + 1) * columns + k]);
            }
        }
        mesh.uvs = vec![glam::Vec2::ZERO; mesh.positions.len()];
        mesh.groups = vec![Group { material: 0, triangles }];
        mesh.materials = vec![Material::plain("x", [0.5; 3])];
        mesh.recompute_normals();
        let full = mesh.bounds().unwrap();
        let proxy = Proxy::new(&harmony_mesh::simple_form(&std::sync::Arc::new(mesh)));
        assert!((500..=3002).contains(&proxy.triangles.len()), "{}", proxy.triangles.len());
        assert_eq!(proxy.closed, proxy.triangles.len());
        let coarse = proxy.clustered(full.size().max_element() / CELLS);
        for form in [&proxy, &coarse] {
            let (low, high) = form.points.iter().fold((Vec3::MAX, Vec3::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
            assert!(((high - low).as_dvec3() - full.size()).abs().max_element() <= 2.0 * 2.0 / CELLS);
            assert!(form.triangles.iter().flatten().all(|i| (*i as usize) < form.points.len()));
        }
    }
}
