//! Convex decomposition: a mesh as convex hulls that follow its surface.
//! Key `physics.colliders`.
//!
//! Idea: only what can be touched counts. Triangles enclosed by others are left out, the rest falls into connected parts,
//! and a part whose hull stands off its surface is cut by an upright or level plane, the one of many that leaves the
//! smallest hulls, until every hull is close or the budget of hulls is spent; then neighbours whose common hull is still
//! close are joined again. Cuts are tried where the mesh has faces across the axis (undersides of tops, insides of legs),
//! so that furniture falls into its boards and legs.
//!
//! It works on surfaces, not on voxels: open and interpenetrating meshes are no exception, corners stay exact, and a
//! thing still stands on its own feet. The greedy tree of planes is that of Wei et al. 2022 (CoACD) without its search;
//! V-HACD (Mamou and Ghorbel 2009, in parry) works on voxels and rounds feet and tops to them.
//!
//! Limits: planes along the object's axes only, so that slanted boards cost more hulls. Cavities with a mouth narrower than
//! the rays that look for it are filled.

use std::collections::BTreeMap;

use harmony_scene::Vec3 as DVec3;
use rayon::prelude::*;

use crate::hull::{Hull, beyond, extreme_points};
use crate::surface::{Surface, bounds, samples};

/// Thinnest hull, metres: thinner things slip through each other in a step.
pub const THINNEST_M: f64 = 0.004;
/// How far hulls may stand off at the 95th percentile, metres ...
pub const FIT_M: f64 = 0.01;
/// ... or of the object's longest side, whichever is more.
pub const FIT_SHARE: f64 = 0.02;
/// Hulls and closeness (share of what is allowed) of the attempts, until one fits.
const ATTEMPTS: [(usize, f64); 3] = [(40, 1.0), (80, 0.6), (160, 0.35)];
/// More connected parts than this are cut by place instead: leaves of plants, tufts.
const MAX_PARTS: usize = 60;
/// Most that the volume of two pieces may grow when they are joined, a share.
const MAX_GAIN: f64 = 0.15;
/// A cut must leave less than this share of the cost of the whole.
const MIN_GAIN: f64 = 0.985;
/// Points for measuring the fit, each way.
const FIT_SAMPLES: usize = 2500;

/// How well hulls follow a surface: distances at the 95th percentile, metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Fit {
    /// From points of the surface that can be touched to the hulls' common surface.
    pub visual_to_collider: f64,
    /// From points of the hulls' common surface to the surface.
    pub collider_to_visual: f64,
}

impl Fit {
    /// The larger of both.
    pub fn worst(self) -> f64 {
        self.visual_to_collider.max(self.collider_to_visual)
    }
}

/// Hulls of one mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Decomposition {
    /// Convex pieces, in the frame of the triangles.
    pub hulls: Vec<Hull>,
    /// How close they are.
    pub fit: Fit,
    /// What was allowed, metres.
    pub allowed: f64,
    /// Triangles have no volume at some place: those hulls got a thickness of [`THINNEST_M`].
    pub thickened: usize,
}

/// Decomposes triangles (metres, finite corners); no hulls when there is no triangle.
pub fn decompose(triangles: Vec<[DVec3; 3]>) -> Decomposition {
    let surface = Surface::new(triangles);
    let allowed = FIT_M.max(FIT_SHARE * surface.size);
    let open = surface.open_triangles();
    // A mesh that encloses itself entirely (a bad winding does not matter here) keeps all of its triangles.
    let open = if open.is_empty() { surface.triangles.clone() } else { open };
    let mut best: Option<Decomposition> = None;
    for (most, closeness) in ATTEMPTS {
        let tolerance = (allowed * closeness).min(FIT_M);
        let mut pieces = split(&surface, &open, most, tolerance);
        pieces = join(&surface, pieces, tolerance);
        let thickened = pieces.iter().filter(|p| Hull::of(&p.points).is_none()).count();
        let hulls: Vec<Hull> = pieces.iter().filter_map(Piece::hull).collect();
        let fit = fit(&surface, &open, &hulls);
        let better = best.as_ref().is_none_or(|b| fit.worst() < b.fit.worst());
        if better {
            best = Some(Decomposition { hulls, fit, allowed, thickened });
        }
        if best.as_ref().is_some_and(|b| b.fit.worst() <= allowed || b.hulls.is_empty()) {
            break;
        }
    }
    best.unwrap_or(Decomposition { hulls: Vec::new(), fit: Fit::default(), allowed, thickened: 0 })
}

/// A plane across an axis that a piece was cut by.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cut {
    axis: usize,
    at: f64,
}

/// Part of the surface with its hull.
#[derive(Debug, Clone)]
struct Piece {
    triangles: Vec<[DVec3; 3]>,
    cuts: Vec<Cut>,
    /// Points that have the same hull.
    points: Vec<DVec3>,
    /// How far the hull stands off the surface, metres.
    error: f64,
    /// Cutting it again does not help.
    done: bool,
}

impl Piece {
    fn new(surface: &Surface, triangles: Vec<[DVec3; 3]>, cuts: Vec<Cut>) -> Self {
        let all: Vec<DVec3> = triangles.iter().flatten().copied().collect();
        let points = match Hull::of(&all) {
            Some(hull) => hull.vertices,
            None => extreme_points(&all, 250),
        };
        let mut piece = Self { triangles, cuts, points, error: 0.0, done: false };
        piece.error = piece.hull().map_or(0.0, |hull| stand_off(surface, &hull, &piece.cuts));
        piece
    }

    fn hull(&self) -> Option<Hull> {
        Hull::of(&self.points).filter(is_thick).or_else(|| Hull::of_sheet(&self.points, THINNEST_M))
    }
}

/// Whether a hull is thick enough as it is, by twice its volume over its area.
fn is_thick(hull: &Hull) -> bool {
    2.0 * hull.moments().mass >= 0.9 * THINNEST_M * hull.area() / 1.5
}

/// Largest distance of a hull's own surface to the mesh. On a cut only what can be touched counts: the face across a hollow,
/// not the one inside of a solid.
fn stand_off(surface: &Surface, hull: &Hull, cuts: &[Cut]) -> f64 {
    let faces: Vec<[DVec3; 3]> = hull.faces.iter().map(|f| hull.corners(*f)).collect();
    let near = 1e-4 * surface.size;
    let on_cut = |p: &DVec3| cuts.iter().any(|c| (p[c.axis] - c.at).abs() <= near);
    let mut off: Vec<(f64, DVec3)> = samples(&faces, 160).into_iter().map(|p| (surface.distance(p), p)).collect();
    off.sort_by(|a, b| b.0.total_cmp(&a.0));
    off.into_iter().find(|(_, p)| !on_cut(p) || surface.is_open(*p)).map_or(0.0, |(distance, _)| distance)
}

fn split(surface: &Surface, open: &[[DVec3; 3]], most: usize, tolerance: f64) -> Vec<Piece> {
    let parts = connected(open, 1e-5 * surface.size);
    let start = if parts.len() > MAX_PARTS.min(most) { vec![open.to_vec()] } else { parts };
    let mut pieces: Vec<Piece> = start.into_par_iter().map(|t| Piece::new(surface, t, Vec::new())).collect();
    while pieces.len() < most {
        let worst = (0..pieces.len())
            .filter(|i| !pieces[*i].done && pieces[*i].error > tolerance)
            .max_by(|a, b| pieces[*a].error.total_cmp(&pieces[*b].error).then(b.cmp(a)));
        let Some(worst) = worst else { break };
        match cut(surface, &pieces[worst]) {
            Some(parts) if pieces.len() + parts.len() - 1 <= most + 8 => {
                pieces.splice(worst..=worst, parts);
            }
            _ => pieces[worst].done = true,
        }
    }
    pieces
}

/// A piece by its best plane; `None` when no plane makes the hulls smaller.
fn cut(surface: &Surface, piece: &Piece) -> Option<Vec<Piece>> {
    let whole = cost(&piece.points, surface.size);
    let wires = Wires::of(&piece.triangles);
    let scored: Vec<(f64, Cut)> = planes(piece, surface.size)
        .into_par_iter()
        .map(|plane| {
            let (low, high) = wires.sides(plane);
            (cost(&low, surface.size) + cost(&high, surface.size), plane)
        })
        .collect();
    let (score, best) = scored.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    // A bowl's halves have together the hull of the bowl; its quarters have not. Where no plane helps, the middle of the
    // longest side does in the end.
    let plane = if score > MIN_GAIN * whole { middle(piece, surface.size)? } else { best };
    let (mut low, mut high) = (Vec::new(), Vec::new());
    for t in &piece.triangles {
        clip(t, plane, &mut low, &mut high);
    }
    let mut cuts = piece.cuts.clone();
    cuts.push(plane);
    let connect = 1e-5 * surface.size;
    let parts: Vec<Vec<[DVec3; 3]>> = [low, high]
        .into_iter()
        .filter(|t| !t.is_empty())
        .flat_map(|t| {
            let parts = connected(&t, connect);
            if parts.len() > 8 { vec![t] } else { parts }
        })
        .collect();
    (parts.len() > 1).then(|| parts.into_par_iter().map(|t| Piece::new(surface, t, cuts.clone())).collect())
}

/// Corners and edges of triangles, each once.
struct Wires {
    corners: Vec<DVec3>,
    edges: Vec<[u32; 2]>,
}

impl Wires {
    fn of(triangles: &[[DVec3; 3]]) -> Self {
        let mut names: BTreeMap<[u64; 3], u32> = BTreeMap::new();
        let mut corners = Vec::new();
        let mut edges = std::collections::BTreeSet::new();
        for t in triangles {
            let named = t.map(|p| {
                *names.entry(p.to_array().map(f64::to_bits)).or_insert_with(|| {
                    corners.push(p);
                    corners.len() as u32 - 1
                })
            });
            for k in 0..3 {
                let (a, b) = (named[k], named[(k + 1) % 3]);
                edges.insert([a.min(b), a.max(b)]);
            }
        }
        Self { corners, edges: edges.into_iter().collect() }
    }

    /// Points with the hulls of what is on each side of a plane.
    fn sides(&self, plane: Cut) -> (Vec<DVec3>, Vec<DVec3>) {
        let off = |p: DVec3| p[plane.axis] - plane.at;
        let mut low: Vec<DVec3> = self.corners.iter().copied().filter(|p| off(*p) <= 0.0).collect();
        let mut high: Vec<DVec3> = self.corners.iter().copied().filter(|p| off(*p) >= 0.0).collect();
        for [a, b] in &self.edges {
            let (a, b) = (self.corners[*a as usize], self.corners[*b as usize]);
            let (da, db) = (off(a), off(b));
            if (da < 0.0 && db > 0.0) || (da > 0.0 && db < 0.0) {
                let m = a + (b - a) * (da / (da - db));
                low.push(m);
                high.push(m);
            }
        }
        (low, high)
    }
}

/// The plane through the middle of a piece's longest side; `None` of what is too small to be cut on.
fn middle(piece: &Piece, size: f64) -> Option<Cut> {
    let (low, high) = bounds(piece.points.iter());
    let sides = high - low;
    let axis = (0..3).max_by(|a, b| sides[*a].total_cmp(&sides[*b]))?;
    (sides[axis] > 0.05 * size).then(|| Cut { axis, at: f64::midpoint(low[axis], high[axis]) })
}

/// What a hull of these points costs: its volume, and a little of its area, which decides between sheets.
fn cost(points: &[DVec3], size: f64) -> f64 {
    if points.is_empty() {
        return 0.0;
    }
    let points = if points.len() > 100 { extreme_points(points, 60) } else { points.to_vec() };
    let hull = Hull::of(&points).or_else(|| Hull::of_sheet(&points, 1e-3 * size));
    hull.map_or(0.0, |h| h.moments().mass + 2e-3 * size * h.area())
}

/// Planes worth trying: evenly spaced ones, and those in which the mesh has faces.
fn planes(piece: &Piece, size: f64) -> Vec<Cut> {
    let (low, high) = bounds(piece.points.iter());
    let mut out = Vec::new();
    for axis in 0..3 {
        let (l, h) = (low[axis], high[axis]);
        let least = (0.02 * (h - l)).max(2e-3 * size);
        if h - l < 2.0 * least {
            continue;
        }
        let mut places: Vec<f64> = (1..8).map(|i| l + (h - l) * f64::from(i) / 8.0).collect();
        // Area of faces across this axis, by their place.
        let mut levels: BTreeMap<i64, f64> = BTreeMap::new();
        for [a, b, c] in &piece.triangles {
            let n = (*b - *a).cross(*c - *a);
            if n[axis].abs() > 0.9 * n.length() {
                *levels.entry(((a[axis] + b[axis] + c[axis]) / 3.0 / (1e-3 * size)).round() as i64).or_default() +=
                    n.length();
            }
        }
        let mut levels: Vec<(i64, f64)> = levels.into_iter().collect();
        levels.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        places.extend(levels.iter().take(8).map(|(k, _)| *k as f64 * 1e-3 * size));
        out.extend(places.into_iter().filter(|at| *at > l + least && *at < h - least).map(|at| Cut { axis, at }));
    }
    out
}

/// Corners of a triangle's parts on both sides of a plane.
fn clip_points(t: &[DVec3; 3], plane: Cut, low: &mut Vec<DVec3>, high: &mut Vec<DVec3>) {
    for i in 0..3 {
        let (a, b) = (t[i], t[(i + 1) % 3]);
        let (da, db) = (a[plane.axis] - plane.at, b[plane.axis] - plane.at);
        if da <= 0.0 {
            low.push(a);
        }
        if da >= 0.0 {
            high.push(a);
        }
        if (da < 0.0 && db > 0.0) || (da > 0.0 && db < 0.0) {
            let mut m = a + (b - a) * (da / (da - db));
            m[plane.axis] = plane.at;
            low.push(m);
            high.push(m);
        }
    }
}

/// A triangle's parts on both sides of a plane, as triangles.
fn clip(t: &[DVec3; 3], plane: Cut, low: &mut Vec<[DVec3; 3]>, high: &mut Vec<[DVec3; 3]>) {
    let side = t.map(|p| p[plane.axis] - plane.at);
    if side.iter().all(|d| *d <= 0.0) {
        low.push(*t);
        return;
    }
    if side.iter().all(|d| *d >= 0.0) {
        high.push(*t);
        return;
    }
    let (mut l, mut h) = (Vec::with_capacity(4), Vec::with_capacity(4));
    clip_points(t, plane, &mut l, &mut h);
    for (polygon, out) in [(l, low), (h, high)] {
        for i in 2..polygon.len() {
            out.push([polygon[0], polygon[i - 1], polygon[i]]);
        }
    }
}

/// Connected parts of triangles, by corners within `near` of each other, in the order of their first triangle.
fn connected(triangles: &[[DVec3; 3]], near: f64) -> Vec<Vec<[DVec3; 3]>> {
    let step = near.max(1e-7);
    let mut parent: Vec<usize> = (0..triangles.len()).collect();
    let mut corners: BTreeMap<[i64; 3], usize> = BTreeMap::new();
    for (i, t) in triangles.iter().enumerate() {
        for p in t {
            let key = (*p / step).to_array().map(|v| v.round() as i64);
            let other = *corners.entry(key).or_insert(i);
            let (a, b) = (root(&mut parent, i), root(&mut parent, other));
            parent[a.max(b)] = a.min(b);
        }
    }
    let mut parts: BTreeMap<usize, Vec<[DVec3; 3]>> = BTreeMap::new();
    for (i, t) in triangles.iter().enumerate() {
        parts.entry(root(&mut parent, i)).or_default().push(*t);
    }
    parts.into_values().collect()
}

/// The first of a triangle's part.
fn root(parent: &mut [usize], mut i: usize) -> usize {
    while parent[i] != i {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    i
}

/// Joins neighbours whose common hull is as close as it must be, those first that gain the least volume by it.
fn join(surface: &Surface, pieces: Vec<Piece>, tolerance: f64) -> Vec<Piece> {
    let near = DVec3::splat(1e-3 * surface.size);
    let volume = |p: &Piece| p.hull().map_or(0.0, |h| h.moments().mass);
    let entry = |p: Piece| (bounds(p.points.iter()), volume(&p), p);
    let mut all: BTreeMap<usize, ((DVec3, DVec3), f64, Piece)> = pieces.into_iter().map(entry).enumerate().collect();
    // What joining two would give; pairs that may not be joined stay with `None`.
    let mut tried: BTreeMap<(usize, usize), Option<(f64, Piece)>> = BTreeMap::new();
    loop {
        let names: Vec<usize> = all.keys().copied().collect();
        let mut pairs = Vec::new();
        for (k, i) in names.iter().enumerate() {
            for j in &names[k + 1..] {
                let (a, b) = (&all[i].0, &all[j].0);
                let touch = (a.0 - near).cmple(b.1).all() && (b.0 - near).cmple(a.1).all();
                if touch && !tried.contains_key(&(*i, *j)) {
                    pairs.push((*i, *j));
                }
            }
        }
        let new: Vec<_> = pairs
            .into_par_iter()
            .map(|(i, j)| ((i, j), joined(surface, &all[&i].2, &all[&j].2, all[&i].1 + all[&j].1, tolerance)))
            .collect();
        tried.extend(new);
        let best = tried
            .iter()
            .filter_map(|(pair, found)| Some((found.as_ref()?.0, *pair)))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let Some((_, (i, j))) = best else { break };
        let Some(Some((_, piece))) = tried.remove(&(i, j)) else { break };
        all.remove(&i);
        all.remove(&j);
        tried.retain(|(a, b), _| ![i, j].contains(a) && ![i, j].contains(b));
        let name = names.last().map_or(0, |n| n + 1);
        all.insert(name, entry(piece));
    }
    all.into_values().map(|(.., piece)| piece).collect()
}

/// Two pieces as one, and the share by which their volume grows; `None` when the hull would stand off too far.
fn joined(surface: &Surface, a: &Piece, b: &Piece, both: f64, tolerance: f64) -> Option<(f64, Piece)> {
    let points: Vec<DVec3> = [a, b].iter().flat_map(|p| p.points.iter().copied()).collect();
    let hull = Hull::of(&points)?;
    let gain = hull.moments().mass - both;
    if gain > MAX_GAIN * both {
        return None;
    }
    // What both were cut by stays an inner side only where it bounds the two together.
    let cuts: Vec<Cut> = a.cuts.iter().filter(|c| b.cuts.contains(c)).copied().collect();
    let error = stand_off(surface, &hull, &cuts);
    if error > tolerance.max(a.error.min(b.error)) {
        return None;
    }
    let triangles = [&a.triangles[..], &b.triangles[..]].concat();
    Some((gain / both.max(1e-12), Piece { triangles, cuts, points: hull.vertices, error, done: true }))
}

/// How close hulls are to what can be touched of a surface.
fn fit(surface: &Surface, open: &[[DVec3; 3]], hulls: &[Hull]) -> Fit {
    if hulls.is_empty() {
        return Fit { visual_to_collider: f64::INFINITY, collider_to_visual: f64::INFINITY };
    }
    let probes: Vec<Probe<'_>> = hulls.iter().map(Probe::of).collect();
    let to_hulls = |p: &DVec3| {
        let (mut outside, mut depth) = (f64::INFINITY, 0.0_f64);
        for probe in &probes {
            if probe.off_box(*p) >= outside.max(f64::MIN_POSITIVE) {
                continue;
            }
            let signed = probe.outside(*p);
            if signed <= 0.0 {
                depth = depth.max(-signed);
                outside = 0.0;
            } else if signed < outside {
                outside = outside.min(probe.hull.to_faces(*p));
            }
        }
        if outside > 0.0 { outside } else { depth }
    };
    let visual: Vec<f64> =
        samples(open, FIT_SAMPLES).par_iter().filter(|p| surface.is_open(**p)).map(to_hulls).collect();
    let seam = 2e-4 * surface.size;
    let faces: Vec<(usize, [DVec3; 3])> =
        hulls.iter().enumerate().flat_map(|(i, h)| h.faces.iter().map(move |f| (i, h.corners(*f)))).collect();
    let only: Vec<[DVec3; 3]> = faces.iter().map(|(_, t)| *t).collect();
    let points = owned_samples(&only, FIT_SAMPLES);
    let collider: Vec<f64> = points
        .par_iter()
        .filter(|(face, p)| {
            let own = faces[*face].0;
            let covers = |probe: &Probe<'_>| probe.off_box(*p) <= 2.0 * seam && probe.outside(*p) <= seam;
            let covered = probes.iter().enumerate().any(|(i, probe)| i != own && covers(probe));
            !covered && surface.is_open(*p)
        })
        .map(|(_, p)| surface.distance(*p))
        .collect();
    Fit { visual_to_collider: percentile(visual, 0.95), collider_to_visual: percentile(collider, 0.95) }
}

/// A hull that many points are measured against.
struct Probe<'h> {
    hull: &'h Hull,
    planes: Vec<(DVec3, f64)>,
    low: DVec3,
    high: DVec3,
}

impl<'h> Probe<'h> {
    fn of(hull: &'h Hull) -> Self {
        let (low, high) = hull.bounds();
        Self { hull, planes: hull.planes().collect(), low, high }
    }

    /// Distance of a point to the hull's upright box, 0 inside.
    fn off_box(&self, point: DVec3) -> f64 {
        (self.low - point).max(point - self.high).max(DVec3::ZERO).length()
    }

    /// As [`Hull::outside`].
    fn outside(&self, point: DVec3) -> f64 {
        beyond(&self.planes, point)
    }
}

/// As [`samples`], with the triangle that each is on.
fn owned_samples(triangles: &[[DVec3; 3]], count: usize) -> Vec<(usize, DVec3)> {
    let total: f64 = triangles.iter().map(|[a, b, c]| (*b - *a).cross(*c - *a).length() / 2.0).sum();
    let mut out = Vec::new();
    let mut owed = 0.0;
    for (i, t) in triangles.iter().enumerate() {
        let area = (t[1] - t[0]).cross(t[2] - t[0]).length() / 2.0;
        owed += area / total.max(1e-12) * count as f64;
        let n = owed.floor();
        owed -= n;
        out.extend(samples(std::slice::from_ref(t), n as usize).into_iter().map(|p| (i, p)));
    }
    out
}

fn percentile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = ((values.len() as f64 * share).ceil() as usize).clamp(1, values.len().max(1)) - 1;
    values.get(at).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faces(hulls: &[Hull]) -> Vec<[DVec3; 3]> {
        hulls.iter().flat_map(|h| h.faces.iter().map(|f| h.corners(*f))).collect()
    }

    fn cuboid(low: [f64; 3], high: [f64; 3]) -> Hull {
        Hull::cuboid(low.into(), high.into())
    }

    #[test]
    fn a_box_stays_one_hull() {
        let found = decompose(faces(&[cuboid([0.0; 3], [0.5, 0.3, 0.2])]));
        assert_eq!(found.hulls.len(), 1);
        assert!((found.hulls[0].moments().mass - 0.03).abs() < 1e-6 && found.fit.worst() < 1e-5, "{:?}", found.fit);
    }

    #[test]
    fn a_table_in_one_skin_becomes_its_top_and_legs() {
        // The outline of a table's front, swept back: one connected closed mesh, as generated meshes are.
        let outline =
            [(0.0, 0.0), (0.1, 0.0), (0.1, 0.7), (1.1, 0.7), (1.1, 0.0), (1.2, 0.0), (1.2, 0.75), (0.0, 0.75)];
        let quads = [[0, 1, 2, 7], [2, 3, 6, 7], [3, 4, 5, 6]];
        let mut triangles = Vec::new();
        let at = |i: usize, z: f64| DVec3::new(outline[i].0, outline[i].1, z);
        for q in quads {
            for z in [0.0, 0.6] {
                let p = q.map(|i| at(i, z));
                let two = [[p[0], p[1], p[2]], [p[0], p[2], p[3]]];
                triangles.extend(two.map(|t| if z == 0.0 { [t[0], t[2], t[1]] } else { t }));
            }
        }
        for i in 0..outline.len() {
            let j = (i + 1) % outline.len();
            let (a, b, c, d) = (at(i, 0.0), at(j, 0.0), at(j, 0.6), at(i, 0.6));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        let found = decompose(triangles);
        assert_eq!(found.hulls.len(), 3, "two sides and a top");
        let volume: f64 = found.hulls.iter().map(|h| h.moments().mass).sum();
        let want = 0.6 * (2.0 * 0.1 * 0.7 + 1.2 * 0.05);
        assert!((volume - want).abs() < 0.02 * want, "{volume} {want}");
        assert!(found.fit.worst() < 0.005, "{:?}", found.fit);
        let free = DVec3::new(0.6, 0.35, 0.3);
        assert!(found.hulls.iter().all(|h| h.outside(free) > 0.2), "the room under the top is free");
    }

    /// Points on a level circle about the y axis.
    fn ring(radius: f64, y: f64) -> [DVec3; AROUND] {
        std::array::from_fn(|k| {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / AROUND as f64).sin_cos();
            DVec3::new(radius * cos, y, radius * sin)
        })
    }

    const AROUND: usize = 32;

    #[test]
    fn a_bowl_keeps_its_hollow() {
        // Open, of one sheet: floor, wall going out.
        let (inner, rim) = (ring(0.15, 0.0), ring(0.3, 0.25));
        let mut triangles = Vec::new();
        for k in 0..AROUND {
            let j = (k + 1) % AROUND;
            triangles.push([DVec3::ZERO, inner[k], inner[j]]);
            triangles.extend([[inner[k], rim[k], rim[j]], [inner[k], rim[j], inner[j]]]);
        }
        let found = decompose(triangles);
        let inside = DVec3::new(0.0, 0.12, 0.0);
        assert!(found.hulls.iter().all(|h| h.outside(inside) > 0.05), "{} hulls", found.hulls.len());
        assert!(found.fit.worst() <= found.allowed, "{:?}", found.fit);
        assert!(found.hulls.iter().all(Hull::is_sound));
    }

    #[test]
    fn a_mug_is_hollow_down_to_its_floor() {
        // Closed, 9 cm high and 8 cm across: wall of 4 mm, floor of 5 mm.
        let rings = [ring(0.04, 0.0), ring(0.04, 0.09), ring(0.036, 0.09), ring(0.036, 0.005)];
        let mut triangles = Vec::new();
        for k in 0..AROUND {
            let j = (k + 1) % AROUND;
            triangles.push([DVec3::ZERO, rings[0][k], rings[0][j]]);
            triangles.push([DVec3::Y * 0.005, rings[3][j], rings[3][k]]);
            for pair in rings.windows(2) {
                let (low, high) = (&pair[0], &pair[1]);
                triangles.extend([[low[k], high[k], high[j]], [low[k], high[j], low[j]]]);
            }
        }
        let found = decompose(triangles);
        assert!(found.fit.worst() <= found.allowed, "{:?} with {} hulls", found.fit, found.hulls.len());
        for y in [0.035, 0.06, 0.085] {
            let deepest = found.hulls.iter().map(|h| h.outside(DVec3::Y * y)).fold(f64::INFINITY, f64::min);
            assert!(deepest > 0.015, "{deepest} at {y}");
        }
    }

    #[test]
    fn what_is_hidden_inside_costs_no_hull() {
        let shelf: Vec<Hull> = (0..5)
            .map(|k| cuboid([0.1, 0.1 + 0.15 * f64::from(k), 0.1], [0.9, 0.12 + 0.15 * f64::from(k), 0.4]))
            .collect();
        let found = decompose(faces(&[vec![cuboid([0.0; 3], [1.0, 1.0, 0.5])], shelf].concat()));
        assert_eq!(found.hulls.len(), 1);
    }

    #[test]
    fn nothing_gives_nothing_and_a_sheet_gives_a_thin_plate() {
        assert!(decompose(Vec::new()).hulls.is_empty());
        let sheet =
            [[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0)], [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]];
        let found = decompose(sheet.to_vec());
        assert_eq!(found.hulls.len(), 1);
        let (low, high) = found.hulls[0].bounds();
        assert!((high.z - low.z - THINNEST_M).abs() < 1e-6 && found.thickened == 1);
    }
}
