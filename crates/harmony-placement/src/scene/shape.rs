//! Canonical geometry of an object, prepared for many renders and distance queries.
//!
//! Canonical frame: bottom at y = 0, centred in x and z, front +Z, any unit; a pose makes metres of it. Beside mesh and
//! convex parts there is what placement asks for again and again, made once and shared: the form that is drawn (and its
//! opaque part), the points that can be outermost, ray queries, the depth of a casing, how it hangs over an edge, its
//! foot. These readings are by rays and thresholds on the mesh: a cloth or a foot of unusual form is read wrongly or
//! not at all.

use std::sync::{Arc, OnceLock};

use harmony_mesh::{Bounds, Bvh, ConvexPart, Group, Material, Mesh};
use harmony_scene::{Vec2, Vec3};

use crate::form::Bend;
use crate::observe::proxy::Proxy;

/// Points an outline is made of, at most.
const MAX_EXTREMES: usize = 240;

/// A canonical mesh with what placement derives from it once.
#[derive(Debug, Clone)]
pub struct Shape {
    mesh: Arc<Mesh>,
    proxy: Arc<Proxy>,
    hulls: Vec<Vec<Vec3>>,
    extremes: Vec<Vec3>,
    bounds: Bounds,
    bvh: OnceLock<Arc<Bvh>>,
    setback: OnceLock<f64>,
    hang: OnceLock<Option<Hang>>,
    foot: OnceLock<Option<[Vec2; 2]>>,
    /// What is not see-through; `None` when all is like that, so that [`Shape::proxy`] holds.
    opaque: Option<Arc<Proxy>>,
}

/// Share of a thing's height up to which it is its foot, and the share of its sides below which that is small.
const FOOT_SHARE: f64 = 0.06;
const SMALL_FOOT: f64 = 0.5;

/// How a thing hangs over an edge, as a throw over the arm of a sofa: it does not stand on its lowest points. Canonical
/// units.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Hang {
    /// Height of the part of its underside that lies on something.
    pub(crate) sag: f64,
    /// Points under that part: x and z.
    pub(crate) under: Vec<Vec2>,
}

/// Columns along each side of a footprint in which an underside is looked at.
pub(crate) const HANG_COLUMNS: u32 = 16;

/// The part of an underside that lies on something is level within this share of the height, as much of the footprint as this
/// at least (what is thrown over a rounded back touches its ridge), and as high as this share of the height at least: lower
/// ones are the roundness of a cushion.
const HANG_BAND: f64 = 0.15;
const HANG_LEVEL: f64 = 0.4;
const HANG_SAG: f64 = 0.15;

/// Share of opaque surface below which a thing is see-through.
const MOSTLY_CLEAR: f64 = 0.3;

/// Where a casing is looked for, share of width and height from the edge, and from so many hits it has been found.
const RIM: f64 = 0.035;
const FEWEST_OF_RIM: usize = 4;

/// Share of light that a material keeps back below which one sees through it.
const SEE_THROUGH: f32 = 0.5;

fn see_through(m: &Material) -> bool {
    m.base_color[3] * (1.0 - m.transmission.clamp(0.0, 1.0) * (1.0 - m.metallic.clamp(0.0, 1.0))) < SEE_THROUGH
}

/// The triangles of a mesh that one does not see through, when there are others.
fn opaque_part(mesh: &Mesh) -> Option<Mesh> {
    let clear = |g: &Group| mesh.materials.get(g.material).is_some_and(see_through);
    if !mesh.groups.iter().any(clear) {
        return None;
    }
    let groups = mesh.groups.iter().filter(|g| !clear(g)).cloned().collect();
    Some(Mesh { groups, ..mesh.clone() })
}

impl Shape {
    /// Prepares a canonical mesh (bottom at y = 0, centred, front +Z) and its convex parts (hull points in the
    /// same frame). Without usable parts the mesh's box stands in.
    pub fn new(mesh: Arc<Mesh>, hulls: Vec<Vec<Vec3>>) -> Self {
        let form = harmony_mesh::simple_form(&mesh);
        Self::with_form(mesh, &form, hulls)
    }

    fn with_form(mesh: Arc<Mesh>, form: &Mesh, hulls: Vec<Vec<Vec3>>) -> Self {
        let unit = Bounds { min: Vec3::new(-0.5, 0.0, -0.5), max: Vec3::new(0.5, 1.0, 0.5) };
        let bounds = mesh.bounds().filter(|b| b.min.is_finite() && b.max.is_finite()).unwrap_or(unit);
        let mut hulls: Vec<Vec<Vec3>> =
            hulls.into_iter().filter(|h| h.len() >= 4 && h.iter().all(|p| p.is_finite())).collect();
        if hulls.is_empty() {
            hulls.push(corners(&bounds).to_vec());
        }
        let proxy = Arc::new(Proxy::new(form));
        let extremes = extremes(&hulls.concat());
        let opaque = opaque_part(&mesh).map(|part| {
            let empty = part.triangle_count() == 0;
            Arc::new(if empty { Proxy::default() } else { Proxy::new(&harmony_mesh::simple_form(&Arc::new(part))) })
        });
        Self {
            mesh,
            proxy,
            hulls,
            extremes,
            bounds,
            bvh: OnceLock::new(),
            setback: OnceLock::new(),
            hang: OnceLock::new(),
            foot: OnceLock::new(),
            opaque,
        }
    }

    /// The same with convex parts from elsewhere, or those of [`harmony_mesh::convex_parts`] for an object whose longest
    /// side has about `longest_m` metres.
    pub fn from_parts(mesh: Arc<Mesh>, parts: Option<&[ConvexPart]>, longest_m: f64) -> Self {
        let form = harmony_mesh::simple_form(&mesh);
        let made = if parts.is_none() { harmony_mesh::convex_parts(&form, longest_m) } else { Vec::new() };
        let hulls = parts.unwrap_or(&made).iter().map(|p| p.points.iter().map(|q| q.as_dvec3()).collect());
        Self::with_form(mesh, &form, hulls.collect())
    }

    /// The same bent along its axes, as silhouettes and depths draw it; its mesh is the one before.
    pub(crate) fn drawn_bent(&self, bend: &Bend) -> Self {
        let proxy = |proxy: &Proxy| {
            let points = proxy.points.iter().map(|p| bend.at(p.as_dvec3()).as_vec3()).collect();
            Arc::new(Proxy { points, ..proxy.clone() })
        };
        Self {
            mesh: Arc::clone(&self.mesh),
            proxy: proxy(&self.proxy),
            hulls: Vec::new(),
            extremes: self.extremes.iter().map(|p| bend.at(*p)).collect(),
            bounds: self.bounds,
            bvh: OnceLock::new(),
            setback: OnceLock::new(),
            hang: OnceLock::new(),
            foot: OnceLock::new(),
            opaque: self.opaque.as_deref().map(proxy),
        }
    }

    /// The same bent along its axes.
    pub(crate) fn bent(&self, bend: &Bend) -> Self {
        let mut mesh = (*self.mesh).clone();
        for (p, n) in mesh.positions.iter_mut().zip(&mut mesh.normals) {
            let at = p.as_dvec3();
            *n = (n.as_dvec3() / bend.stretch(at)).as_vec3().normalize_or(glam::Vec3::Y);
            *p = bend.at(at).as_vec3();
        }
        let hulls = self.hulls.iter().map(|hull| hull.iter().map(|p| bend.at(*p)).collect()).collect();
        Self { mesh: Arc::new(mesh), hulls, ..self.drawn_bent(bend) }
    }

    /// The mesh.
    pub fn mesh(&self) -> &Arc<Mesh> {
        &self.mesh
    }

    /// What silhouettes are drawn from.
    pub(crate) fn proxy(&self) -> &Proxy {
        &self.proxy
    }

    /// What hides others: all but glass; `None` when that is the whole [`Shape::proxy`].
    pub(crate) fn opaque(&self) -> Option<&Proxy> {
        self.opaque.as_deref()
    }

    /// Whether what is behind it is seen through it but for a rod or a frame: a sheer curtain, a pane.
    pub(crate) fn is_see_through(&self) -> bool {
        self.opaque.as_ref().is_some_and(|opaque| opaque.area() < MOSTLY_CLEAR * self.proxy.area())
    }

    /// Hull points of the convex parts, canonical frame.
    pub fn hulls(&self) -> &[Vec<Vec3>] {
        &self.hulls
    }

    /// Points of the convex parts that can be the outermost of its image in some direction, canonical frame.
    pub(crate) fn extremes(&self) -> &[Vec3] {
        &self.extremes
    }

    /// Bounds in canonical units.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Width, height and depth in canonical units, none of them zero.
    pub fn extent(&self) -> Vec3 {
        self.bounds.size().max(Vec3::splat(1e-6))
    }

    /// Ray queries on the mesh, canonical frame; built at the first call.
    pub fn bvh(&self) -> &Bvh {
        self.bvh.get_or_init(|| Arc::new(Bvh::new(&self.mesh)))
    }

    /// How it hangs over an edge, if it does: much of its underside lies far above its lowest points, at one height.
    pub(crate) fn hang(&self) -> Option<&Hang> {
        let found = self.hang.get_or_init(|| {
            let Bounds { min, max } = self.bounds;
            let size = self.extent();
            let share = |k: u32| (f64::from(k) + 0.5) / f64::from(HANG_COLUMNS);
            let columns = (0..HANG_COLUMNS * HANG_COLUMNS).map(|k| {
                let at = Vec2::new(share(k % HANG_COLUMNS), share(k / HANG_COLUMNS));
                Vec2::new(min.x, min.z) + at * Vec2::new(size.x, size.z)
            });
            let underside = |at: Vec2| {
                let from = Vec3::new(at.x, min.y - 0.1 * size.y, at.y);
                self.bvh().raycast(from, Vec3::Y, 1.2 * size.y).map(|hit| (hit.point.y - min.y, at))
            };
            let mut found: Vec<(f64, Vec2)> = columns.filter_map(underside).collect();
            found.sort_by(|a, b| a.0.total_cmp(&b.0));
            // The highest level at which enough of them are: the shoulders of a throw are below the ridge on which it lies.
            let about =
                |h: f64| found.iter().filter(move |(other, _)| (other - h).abs() <= HANG_BAND * (max.y - min.y) / 2.0);
            let is_level = |h: &f64| about(*h).count() as f64 >= HANG_LEVEL * found.len() as f64;
            let highest = found.iter().rev().map(|(h, _)| *h).find(is_level)?;
            let level: Vec<f64> = about(highest).map(|(h, _)| *h).collect();
            let sag = level[level.len() / 2];
            let hangs = sag > HANG_SAG * size.y;
            hangs.then(|| Hang { sag, under: about(sag).map(|(_, at)| *at).collect() })
        });
        found.as_ref()
    }

    /// The rectangle of what it stands on, least and greatest (x, z), canonical, where that is small against the whole: the
    /// pot of a plant, the base of a lamp, which need not be under its middle.
    pub(crate) fn foot(&self) -> Option<[Vec2; 2]> {
        *self.foot.get_or_init(|| {
            let (min, size) = (self.bounds.min, self.extent());
            let low = self.mesh.positions.iter().filter(|p| f64::from(p.y) <= min.y + FOOT_SHARE * size.y);
            let (from, to) = low.fold((Vec2::MAX, Vec2::MIN), |(from, to), p| {
                let p = Vec2::new(f64::from(p.x), f64::from(p.z));
                (from.min(p), to.max(p))
            });
            let (foot, whole) = (to - from, Vec2::new(size.x, size.z));
            let small = foot.cmpgt(Vec2::ZERO).all() && foot.cmplt(whole * SMALL_FOOT).all();
            small.then_some([from, to])
        })
    }

    /// How far a window's or a door's casing lies behind the foremost of it, a sill, a blind or a handle; canonical units.
    pub(crate) fn setback(&self) -> f64 {
        *self.setback.get_or_init(|| {
            let Bounds { min, max } = self.bounds;
            let size = max - min;
            let sides = [0.3, 0.45, 0.6, 0.75].into_iter().flat_map(|y| [(RIM, y), (1.0 - RIM, y)]);
            let head = [0.2, 0.4, 0.6, 0.8].map(|x| (x, 1.0 - RIM));
            let front = |(x, y): (f64, f64)| {
                let from = Vec3::new(min.x + x * size.x, min.y + y * size.y, max.z + size.z + 1.0);
                Some(self.bvh().raycast(from, Vec3::NEG_Z, 2.0 * size.z + 2.0)?.point.z)
            };
            let mut found: Vec<f64> = sides.chain(head).filter_map(front).collect();
            found.sort_by(f64::total_cmp);
            // A few hits are a horn's or a knob's.
            if found.len() < FEWEST_OF_RIM { 0.0 } else { max.z - found[found.len() / 2] }
        })
    }
}

/// The outermost points in evenly spread directions; all where there are few.
fn extremes(all: &[Vec3]) -> Vec<Vec3> {
    if all.len() <= MAX_EXTREMES {
        return all.to_vec();
    }
    let mut chosen: Vec<usize> = (0..MAX_EXTREMES)
        .filter_map(|i| {
            // A Fibonacci sphere of directions.
            let y = 1.0 - 2.0 * (i as f64 + 0.5) / MAX_EXTREMES as f64;
            let (sin, cos) = (i as f64 * 2.399_963).sin_cos();
            let d = Vec3::new(cos * (1.0 - y * y).sqrt(), y, sin * (1.0 - y * y).sqrt());
            (0..all.len()).max_by(|a, b| all[*a].dot(d).total_cmp(&all[*b].dot(d)))
        })
        .collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(|i| all[i]).collect()
}

/// The eight corners of a box.
pub(crate) fn corners(b: &Bounds) -> [Vec3; 8] {
    std::array::from_fn(|i| {
        Vec3::new(
            if i & 1 == 0 { b.min.x } else { b.max.x },
            if i & 2 == 0 { b.min.y } else { b.max.y },
            if i & 4 == 0 { b.min.z } else { b.max.z },
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Boards that look ahead: left, right, low, high, and how far ahead.
    fn boards(of: &[[f64; 5]]) -> Shape {
        let mut mesh = Mesh { materials: vec![Material::plain("board", [0.5; 3])], ..Mesh::default() };
        let mut triangles = Vec::new();
        for [l, r, b, t, z] in of {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend([[*l, *b], [*r, *b], [*r, *t], [*l, *t]].map(|[x, y]| Vec3::new(x, y, *z).as_vec3()));
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        mesh.groups = vec![Group { material: 0, triangles }];
        Shape::new(Arc::new(mesh), Vec::new())
    }

    #[test]
    fn a_casing_is_found_behind_sill_blind_and_handle() {
        let casing = [-0.5, 0.5, 0.0, 1.2, 0.03];
        let with = |more: &[[f64; 5]]| boards(&[&[casing][..], more].concat()).setback();
        assert!(with(&[]).abs() < 1e-6);
        let (sill, horns) = ([-0.5, 0.5, 0.0, 0.04, 0.15], [-0.58, 0.58, 0.0, 0.04, 0.15]);
        let (blind, handle) = ([-0.4, 0.4, 0.1, 1.1, 0.08], [0.3, 0.34, 0.5, 0.55, 0.1]);
        for (more, wanted) in [(sill, 0.12), (horns, 0.12), (blind, 0.05), (handle, 0.07)] {
            let found = with(&[more]);
            assert!((found - wanted).abs() < 1e-6, "{found} instead of {wanted} with {more:?}");
        }
        // Four knobs and nothing else are no casing.
        assert!(boards(&[[0.0, 0.01, 0.0, 0.01, 0.0], [0.9, 1.0, 0.9, 1.0, 0.1]]).setback().abs() < 1e-6);
    }
}
