//! What a shape tells about itself: parts, joints, gaps, faces in one plane.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use crate::tree::JointKind;

use super::{Built, BuiltJoint, BuiltLight, BuiltPart, BuiltShape, BuiltSurface, Fit, Part};

/// Boxes nearer than this touch, metres.
const TOUCH: f64 = 0.005;
/// Most pieces that are looked at for gaps and planes.
const MAX_LOOKED_AT: usize = 4000;
/// Smallest flat face that counts, square metres.
const MIN_FACE: f64 = 4e-4;
/// Planes nearer than this flicker, metres.
const SAME_PLANE: f64 = 5e-4;
/// Share of the longest side below which a side is thin.
const THIN: f64 = 0.06;
/// Most pairs that are told apart.
const MAX_PAIRS: usize = 4000;
/// Step by which parts in one plane are told apart, metres.
const NUDGE: f64 = 6e-5;
/// Most such steps.
const MAX_LEVEL: u32 = 8;

/// Adds parts, joints, lights and surfaces.
pub(super) fn fill(shape: &mut BuiltShape, root: &Built, parts: &[&Part]) {
    let origin = shape.origin;
    let boxes: Vec<(DVec3, DVec3)> =
        parts.iter().filter_map(|p| p.bounds()).map(|(l, h)| (l + origin, h + origin)).collect();
    let gaps = gaps(&boxes);
    let mut index: BTreeMap<&str, usize> = BTreeMap::new();
    let mut of_part = Vec::new();
    for ((part, (low, high)), gap) in parts.iter().zip(&boxes).zip(&gaps) {
        let at = *index.entry(&part.name).or_insert_with(|| {
            shape.parts.push(BuiltPart {
                name: part.name.to_string(),
                line: part.line,
                low: *low,
                high: *high,
                triangles: 0,
                instances: 0,
                gap: 0.0,
            });
            shape.parts.len() - 1
        });
        let entry = &mut shape.parts[at];
        entry.low = entry.low.min(*low);
        entry.high = entry.high.max(*high);
        entry.triangles += part.piece.triangles.len();
        entry.instances += 1;
        entry.gap = entry.gap.max(*gap);
        of_part.push(at);
    }
    // joints count all parts of the tree, those without triangles too
    let place: Vec<Option<(usize, (DVec3, DVec3))>> = {
        let mut next = 0;
        root.parts
            .iter()
            .map(|p| {
                (!p.piece.triangles.is_empty()).then(|| {
                    next += 1;
                    (of_part[next - 1], boxes[next - 1])
                })
            })
            .collect()
    };
    shape.joints = root
        .joints
        .iter()
        .map(|j| {
            let end = (j.first + j.count).min(place.len());
            let pieces = || place[j.first.min(end)..end].iter().flatten();
            let mut moved: Vec<usize> = pieces().map(|(at, _)| *at).collect();
            moved.sort_unstable();
            moved.dedup();
            let boxes = pieces().map(|(_, (low, high))| [*low, *high]).collect();
            BuiltJoint { parts: moved, pivot: j.joint.pivot + origin, boxes, ..j.joint.clone() }
        })
        .collect();
    shape.lights = root.lights.iter().map(|l| BuiltLight { position: l.position + origin, ..l.clone() }).collect();
    shape.surfaces = root.surfaces.iter().map(|s| BuiltSurface { at: s.at + origin, ..s.clone() }).collect();
}

fn apart(a: (DVec3, DVec3), b: (DVec3, DVec3)) -> f64 {
    (b.0 - a.1).max(a.0 - b.1).max(DVec3::ZERO).length()
}

fn root(parent: &mut [usize], mut i: usize) -> usize {
    while parent[i] != i {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    i
}

/// For each box the distance of its cluster of touching boxes to the rest; 0 for the largest cluster and for those that
/// stand on the ground.
fn gaps(boxes: &[(DVec3, DVec3)]) -> Vec<f64> {
    let n = boxes.len();
    if !(2..=MAX_LOOKED_AT).contains(&n) {
        return vec![0.0; n];
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| boxes[*a].0.x.total_cmp(&boxes[*b].0.x).then(a.cmp(b)));
    let mut parent: Vec<usize> = (0..n).collect();
    for (k, i) in order.iter().enumerate() {
        for j in &order[k + 1..] {
            if boxes[*j].0.x > boxes[*i].1.x + TOUCH {
                break;
            }
            if apart(boxes[*i], boxes[*j]) <= TOUCH {
                let (a, b) = (root(&mut parent, *i), root(&mut parent, *j));
                parent[a.max(b)] = a.min(b);
            }
        }
    }
    let cluster: Vec<usize> = (0..n).map(|i| root(&mut parent, i)).collect();
    let mut extent: BTreeMap<usize, (DVec3, DVec3)> = BTreeMap::new();
    for (i, c) in cluster.iter().enumerate() {
        let e = extent.entry(*c).or_insert(boxes[i]);
        *e = (e.0.min(boxes[i].0), e.1.max(boxes[i].1));
    }
    let size = |c: usize| extent.get(&c).map_or(0.0, |(l, h)| (*h - *l).length());
    let main = extent.keys().copied().fold(cluster[0], |best, c| if size(c) > size(best) { c } else { best });
    let grounded = |c: usize| extent.get(&c).is_some_and(|(l, _)| l.y < TOUCH);
    let mut gap_of: BTreeMap<usize, f64> = BTreeMap::new();
    for (i, c) in cluster.iter().enumerate() {
        if *c == main || grounded(*c) {
            continue;
        }
        let nearest =
            (0..n).filter(|j| cluster[*j] != *c).map(|j| apart(boxes[i], boxes[j])).fold(f64::INFINITY, f64::min);
        let e = gap_of.entry(*c).or_insert(f64::INFINITY);
        *e = e.min(nearest);
    }
    cluster.iter().map(|c| gap_of.get(c).copied().filter(|g| g.is_finite()).unwrap_or(0.0)).collect()
}

/// A flat face: where its plane lies, how large it is, its box.
struct Flat {
    part: usize,
    normal: DVec3,
    offset: f64,
    area: f64,
    lo: DVec3,
    hi: DVec3,
}

/// Pairs of parts with faces that look the same way, lie within half a millimetre and overlap.
pub(super) fn coplanar(parts: &[&Part]) -> BTreeSet<(usize, usize)> {
    let mut out = BTreeSet::new();
    if parts.len() > MAX_LOOKED_AT {
        return out;
    }
    let mut faces: BTreeMap<[i64; 3], Vec<Flat>> = BTreeMap::new();
    for (i, part) in parts.iter().enumerate() {
        let mut own: BTreeMap<[i64; 4], Flat> = BTreeMap::new();
        let flip = part.place.matrix3.determinant().signum();
        if part.piece.triangles.len() > 20_000 {
            continue;
        }
        for corners in part.piece.corners() {
            let [a, b, c] = corners.map(|p| part.place.transform_point3(p));
            let cross = (b - a).cross(c - a) * flip;
            let area = cross.length() / 2.0;
            if area < 1e-6 {
                continue;
            }
            let normal = cross / (2.0 * area);
            let offset = normal.dot(a);
            let [x, y, z] = [normal.x, normal.y, normal.z].map(|v| (v * 200.0 + 0.37).floor() as i64);
            let key = [x, y, z, (offset * 2e4 + 0.37).floor() as i64];
            let e = own.entry(key).or_insert(Flat { part: i, normal, offset, area: 0.0, lo: a, hi: a });
            e.area += area;
            e.lo = e.lo.min(a).min(b).min(c);
            e.hi = e.hi.max(a).max(b).max(c);
        }
        for (key, flat) in own {
            if flat.area > MIN_FACE {
                faces.entry([key[0], key[1], key[2]]).or_default().push(flat);
            }
        }
    }
    for list in faces.values_mut() {
        list.sort_by(|a, b| a.offset.total_cmp(&b.offset));
        for (k, a) in list.iter().enumerate() {
            for b in &list[k + 1..] {
                if b.offset - a.offset > SAME_PLANE || out.len() > MAX_PAIRS {
                    break;
                }
                let shared = (a.hi.min(b.hi) - a.lo.max(b.lo)) + a.normal.abs() * 0.01;
                if a.part != b.part && shared.min_element() > 2e-3 {
                    out.insert((a.part.min(b.part), a.part.max(b.part)));
                }
            }
        }
    }
    out
}

/// How far each part stands out in all directions, metres, so that no two of a pair have a face in one plane: renderers
/// show such faces black, or flickering.
pub(super) fn nudges(count: usize, pairs: &BTreeSet<(usize, usize)>) -> Vec<f64> {
    let mut before: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (a, b) in pairs {
        before.entry(*b).or_default().push(*a);
    }
    // Each part takes the least level that none of those before it has which it shares a plane with.
    let mut level = vec![0_u32; count];
    for (part, others) in before {
        let taken: BTreeSet<u32> = others.iter().map(|a| level[*a]).collect();
        level[part] = (0..MAX_LEVEL).find(|l| !taken.contains(l)).unwrap_or(MAX_LEVEL);
    }
    level.into_iter().map(|l| f64::from(l) * NUDGE).collect()
}

/// Pairs by the names of their parts.
pub(super) fn named(parts: &[&Part], pairs: &BTreeSet<(usize, usize)>) -> Vec<(String, String)> {
    let names: BTreeSet<(String, String)> = pairs
        .iter()
        .map(|(a, b)| {
            let (p, q) = (parts[*a].name.to_string(), parts[*b].name.to_string());
            if p <= q { (p, q) } else { (q, p) }
        })
        .collect();
    names.into_iter().take(20).collect()
}

impl BuiltShape {
    /// Width, height and depth, metres.
    pub fn size(&self) -> DVec3 {
        self.mesh.bounds().map_or(DVec3::ZERO, |b| b.size())
    }

    /// Scales the shape to a wanted size: each axis by itself where it is within a factor of two, all alike (the geometric
    /// mean) where one is farther off. The thin side of something flat is no proportion: it is scaled by itself, however
    /// much, and does not shrink a rug whose pile was made too high. Everything that belongs to the mesh follows.
    pub fn fit_to(&mut self, wanted: DVec3) -> Fit {
        let size = self.size().max(DVec3::splat(1e-6));
        let ratio = wanted / size;
        if !(ratio.is_finite() && ratio.min_element() > 0.0) {
            return Fit { scale: DVec3::ONE, length: 1.0, uniform: true };
        }
        let thin = (wanted / wanted.max_element()).to_array().map(|share| share < THIN);
        // Geometric mean over the broad sides, of which there is one at least.
        let mean_of = |v: DVec3| {
            let broad = v.to_array().into_iter().zip(thin).filter(|(_, thin)| !thin);
            let (product, count) = broad.fold((1.0, 0), |(p, n), (r, _)| (p * r, n + 1));
            libm::pow(product, 1.0 / f64::from(count.max(1)))
        };
        let own = ratio.to_array();
        let uniform = own.iter().zip(thin).any(|(r, thin)| !thin && !(0.5..=2.0).contains(r));
        let scale = if uniform {
            let all = mean_of(ratio);
            DVec3::from_array(std::array::from_fn(|k| if thin[k] { own[k] } else { all }))
        } else {
            ratio
        };
        let mean = mean_of(scale);
        let s = scale.as_vec3();
        self.mesh.map(|p| p * s, |n| n / s);
        for uv in &mut self.mesh.metric_uvs {
            *uv *= mean as f32;
        }
        for p in self.convex.iter_mut().flat_map(|c| &mut c.points) {
            *p *= s;
        }
        for l in &mut self.lights {
            l.position *= scale;
            l.radius *= mean;
        }
        for j in &mut self.joints {
            j.pivot *= scale;
            if j.kind == JointKind::Slide {
                let longer = (j.axis * scale).length();
                j.range = j.range.map(|v| v * longer);
            }
            j.axis = (j.axis * scale).normalize_or(j.axis);
            j.boxes.iter_mut().flatten().for_each(|corner| *corner *= scale);
        }
        for surface in &mut self.surfaces {
            surface.at *= scale;
            surface.half_width *= scale;
            surface.half_depth *= scale;
        }
        for part in &mut self.parts {
            part.low *= scale;
            part.high *= scale;
            part.gap *= mean;
        }
        self.origin *= scale;
        Fit { scale, length: mean, uniform }
    }
}
