//! Parts into one mesh.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use glam::{DVec2, DVec3, Vec2Swizzles as _, Vec3};
use harmony_mesh::{ConvexPart, Group, Material, Mesh, hull_points, pack_charts};
use rayon::prelude::*;

use super::charts::{Chart, charts};
use super::{BuildContext, Built, BuiltShape, Look, Part, report};
use crate::Piece;
use crate::material::PatternKind;
use crate::tree::{ShapeTree, TreeError};

/// Most charts with a place of their own in the atlas; beyond it copies share theirs.
const MAX_CHARTS: usize = 4000;
/// Most convex pieces.
const MAX_CONVEX: usize = 48;

/// Joins the root's parts.
pub(super) fn assemble(tree: &ShapeTree, ctx: &BuildContext, root: &Built) -> Result<BuiltShape, TreeError> {
    let line = tree.nodes.last().map_or(0, |n| n.line);
    let parts: Vec<&Part> = root.parts.iter().filter(|p| !p.piece.triangles.is_empty()).collect();
    let Some((lo, hi)) = root.bounds().filter(|_| !parts.is_empty()) else {
        return Err(TreeError::Shape {
            message: "the program yields no surface; its last group is empty".into(),
            line,
        });
    };
    let origin = -DVec3::new(f64::midpoint(lo.x, hi.x), lo.y, f64::midpoint(lo.z, hi.z));
    let pieces = Pieces::of(&parts);
    let mut looks = Looks::new(tree, ctx);
    let mut mesh = Mesh::default();
    let places = atlas(&parts, &pieces);
    let mut used: BTreeMap<usize, Vec<[u32; 3]>> = BTreeMap::new();
    let mut stamp: HashMap<(u32, bool, Option<usize>), u32> = HashMap::new();
    let coplanar = report::coplanar(&parts);
    let nudges = report::nudges(parts.len(), &coplanar);
    for (i, part) in parts.iter().enumerate() {
        let k = pieces.of_part[i];
        let swell = Swell::new(part, nudges[i]);
        let own = looks.of(part.look.as_ref(), part.piece.closed);
        looks.materials[own].hairy |= part.hairy;
        let is_decal = matches!(part.look, Some(Look::Decal(_)));
        let mirrored = part.place.matrix3.determinant() < 0.0;
        let turned_over = shows_its_back(part, origin);
        let flip = mirrored != turned_over;
        let mut normal_map = part.place.matrix3.inverse().transpose();
        if turned_over {
            normal_map *= -1.0;
        }
        let stretch = stretch(part);
        for (c, chart) in pieces.charts[k].iter().enumerate() {
            let (offset, turned, scale) = places.place(i, k, c);
            stamp.clear();
            for t in &chart.triangles {
                let painted = part.paint.as_ref().map_or(u32::MAX, |p| p[*t as usize]);
                let material = if painted == u32::MAX { own } else { looks.slot(painted, part.piece.closed) };
                let grain = looks.grain(material);
                let photo = looks.photo(material).filter(|_| !is_decal || painted != u32::MAX);
                let (scaled, moved) = photo.map_or((DVec2::ONE, DVec2::ZERO), |size| chart.once(size, stretch));
                let mut corners = part.piece.triangles[*t as usize];
                if flip {
                    corners.swap(1, 2);
                }
                let corners = corners.map(|v| {
                    *stamp.entry((v, grain, photo.map(|_| material))).or_insert_with(|| {
                        let v = v as usize;
                        let uv = part.piece.uvs[v];
                        let local = (uv - chart.lo) * stretch;
                        let local = if turned { local.yx() } else { local };
                        let p = swell.at(part.place.transform_point3(part.piece.positions[v])) + origin;
                        let n = (normal_map * part.piece.normals[v]).normalize_or(DVec3::Y);
                        mesh.positions.push(p.as_vec3());
                        mesh.normals.push(n.as_vec3());
                        let metric = chart.metric(uv, grain) * stretch;
                        mesh.metric_uvs.push((metric * scaled + moved).as_vec2());
                        mesh.uvs.push((offset + local * scale).clamp(DVec2::ZERO, DVec2::ONE).as_vec2());
                        mesh.positions.len() as u32 - 1
                    })
                });
                used.entry(material).or_default().push(corners);
            }
        }
    }
    let mut slots = Vec::new();
    for (material, triangles) in used {
        slots.push(looks.materials[material].name.clone());
        mesh.materials.push(looks.materials[material].clone());
        mesh.groups.push(Group { material: mesh.materials.len() - 1, triangles });
    }
    let mut shape = BuiltShape { mesh, slots, origin, convex: convex(&parts, origin), ..BuiltShape::default() };
    report::fill(&mut shape, root, &parts);
    shape.coplanar = report::named(&parts, &coplanar);
    Ok(shape)
}

/// A part made a little larger about the middle of its box.
struct Swell {
    middle: DVec3,
    factor: DVec3,
}

impl Swell {
    fn new(part: &Part, by: f64) -> Self {
        let Some((lo, hi)) = part.bounds().filter(|_| by > 0.0) else {
            return Self { middle: DVec3::ZERO, factor: DVec3::ONE };
        };
        // What is flat stays flat.
        let factor = ((hi - lo) / 2.0).to_array().map(|half| if half > 1e-4 { 1.0 + by / half } else { 1.0 });
        Self { middle: (lo + hi) / 2.0, factor: DVec3::from_array(factor) }
    }

    fn at(&self, point: DVec3) -> DVec3 {
        if self.factor == DVec3::ONE { point } else { self.middle + (point - self.middle) * self.factor }
    }
}

/// Share of a sheet's area that must face one way before the sheet has a side that is looked at.
const ONE_WAY: f64 = 0.5;

/// Whether an open sheet has the side that is looked at behind: whoever writes a grid of points does not think of the
/// way it winds. That side is the upper one of what lies, the front of what stands across, the outer one of what stands
/// along. Renderers draw both sides; the photo is painted and its light is laid on the one that normals tell.
fn shows_its_back(part: &Part, origin: DVec3) -> bool {
    if part.piece.closed || part.piece.outwards {
        return false;
    }
    let at = |v: u32| part.place.transform_point3(part.piece.positions[v as usize]) + origin;
    let handed = part.place.matrix3.determinant().signum();
    let (mut sum, mut all, mut middle) = (DVec3::ZERO, 0.0, DVec3::ZERO);
    for t in &part.piece.triangles {
        let [a, b, c] = t.map(at);
        let area = (b - a).cross(c - a) * handed;
        sum += area;
        all += area.length();
        middle += (a + b + c) / 3.0 * area.length();
    }
    if sum.length() < ONE_WAY * all {
        return false;
    }
    let size = sum.abs();
    if size.y >= size.x.max(size.z) {
        sum.y < 0.0
    } else if size.z >= size.x {
        sum.z < 0.0
    } else {
        sum.x * middle.x < 0.0
    }
}

/// How much longer lengths are where the piece stands.
fn stretch(part: &Part) -> f64 {
    libm::cbrt(part.place.matrix3.determinant().abs())
}

/// The different pieces and their charts.
struct Pieces {
    of_part: Vec<usize>,
    charts: Vec<Vec<Chart>>,
}

impl Pieces {
    fn of(parts: &[&Part]) -> Self {
        let mut index: HashMap<*const Piece, usize> = HashMap::new();
        let mut list: Vec<&Arc<Piece>> = Vec::new();
        let of_part = parts
            .iter()
            .map(|p| {
                *index.entry(Arc::as_ptr(&p.piece)).or_insert_with(|| {
                    list.push(&p.piece);
                    list.len() - 1
                })
            })
            .collect();
        let charts = list.par_iter().map(|p| charts(p)).collect();
        Self { of_part, charts }
    }
}

/// Places of charts in the unit square.
struct Atlas {
    scale: f64,
    /// Offset and turn of each place.
    places: Vec<(DVec2, bool)>,
    /// Place of each part's first chart.
    first: Vec<usize>,
    /// Place of each piece's first chart where copies share.
    shared: Option<Vec<usize>>,
    /// Stands for charts too small to have a place.
    tiny: Option<Vec<bool>>,
}

impl Atlas {
    /// Offset, whether turned, and scale of a chart of a part.
    fn place(&self, part: usize, piece: usize, chart: usize) -> (DVec2, bool, f64) {
        let at = self.shared.as_ref().map_or_else(|| self.first[part], |s| s[piece]) + chart;
        let scale = if self.tiny.as_ref().is_some_and(|t| t[at]) { 0.0 } else { self.scale };
        let (offset, turned) = self.places[at];
        (offset, turned, scale)
    }
}

fn atlas(parts: &[&Part], pieces: &Pieces) -> Atlas {
    let total: usize = pieces.of_part.iter().map(|k| pieces.charts[*k].len()).sum();
    let sizes_of = |k: usize, s: f64| pieces.charts[k].iter().map(move |c| (c.hi - c.lo).max(DVec2::ZERO) * s);
    let mut first = Vec::new();
    let mut shared = None;
    let mut sizes: Vec<DVec2> = Vec::new();
    if total <= MAX_CHARTS {
        for (part, k) in parts.iter().zip(&pieces.of_part) {
            first.push(sizes.len());
            sizes.extend(sizes_of(*k, stretch(part)));
        }
    } else {
        // the largest copy gives the size
        let mut largest = vec![0.0_f64; pieces.charts.len()];
        for (part, k) in parts.iter().zip(&pieces.of_part) {
            largest[*k] = largest[*k].max(stretch(part));
        }
        let mut starts = Vec::new();
        for (k, s) in largest.iter().enumerate() {
            starts.push(sizes.len());
            sizes.extend(sizes_of(k, *s));
        }
        shared = Some(starts);
    }
    let mut tiny = None;
    if sizes.len() > MAX_CHARTS {
        let mut order: Vec<usize> = (0..sizes.len()).collect();
        order.sort_by(|a, b| sizes[*b].element_product().total_cmp(&sizes[*a].element_product()).then(a.cmp(b)));
        let mut small = vec![false; sizes.len()];
        for i in &order[MAX_CHARTS..] {
            small[*i] = true;
        }
        tiny = Some(small);
    }
    let kept: Vec<usize> = (0..sizes.len()).filter(|i| tiny.as_ref().is_none_or(|t| !t[*i])).collect();
    let packed: Vec<DVec2> = kept.iter().map(|i| sizes[*i]).collect();
    let (scale, found) = pack_charts(&packed);
    let mut places = vec![(DVec2::ZERO, false); sizes.len()];
    for (i, place) in kept.iter().zip(found) {
        places[*i] = (place.offset, place.turned);
    }
    Atlas { scale, places, first, shared, tiny }
}

/// Materials in the order of the tree, then those of templates; each once for closed and once for open pieces when the
/// material is not two-sided by itself.
struct Looks<'a> {
    tree: &'a ShapeTree,
    ctx: &'a BuildContext,
    materials: Vec<Material>,
    grain: Vec<bool>,
    of_slot: BTreeMap<u32, usize>,
    own: Vec<(*const Material, usize)>,
    none: Option<usize>,
}

impl<'a> Looks<'a> {
    fn new(tree: &'a ShapeTree, ctx: &'a BuildContext) -> Self {
        let mut looks = Self {
            tree,
            ctx,
            materials: Vec::new(),
            grain: Vec::new(),
            of_slot: BTreeMap::new(),
            own: Vec::new(),
            none: None,
        };
        // numbered now, so that the mesh's materials keep the program's order; made when used
        for (i, spec) in tree.materials.iter().enumerate() {
            looks.of_slot.insert(i as u32, i);
            looks.materials.push(Material::plain("", [0.0; 3]));
            looks.grain.push(runs_along(spec));
        }
        looks
    }

    fn slot(&mut self, slot: u32, closed: bool) -> usize {
        let at = self.of_slot.get(&slot).copied().unwrap_or(0);
        if self.materials[at].name.is_empty()
            && let Some(spec) = self.tree.materials.get(slot as usize)
        {
            let made = (self.ctx.material)(spec);
            self.materials[at] = made;
            if self.materials[at].name.is_empty() {
                self.materials[at].name = format!("slot_{slot}");
            }
        }
        self.materials[at].double_sided |= !closed;
        at
    }

    fn of(&mut self, look: Option<&Look>, closed: bool) -> usize {
        match look {
            Some(Look::Slot(slot) | Look::Decal(slot)) => self.slot(*slot, closed),
            Some(Look::Own(material)) => {
                let key = Arc::as_ptr(material);
                let known = self.own.iter().find(|(k, _)| *k == key).map(|(_, i)| *i);
                let alike = known.or_else(|| {
                    self.own.iter().map(|(_, i)| *i).find(|i| {
                        let m = &self.materials[*i];
                        m.name == material.name && m.base_color == material.base_color
                    })
                });
                let at = alike.unwrap_or_else(|| self.add((**material).clone()));
                if known.is_none() {
                    self.own.push((key, at));
                }
                self.materials[at].double_sided |= !closed;
                at
            }
            None => {
                let at = match self.none {
                    Some(at) => at,
                    None => self.add(Material::plain("body", [0.3, 0.29, 0.27])),
                };
                self.none = Some(at);
                self.materials[at].double_sided |= !closed;
                at
            }
        }
    }

    fn add(&mut self, material: Material) -> usize {
        self.materials.push(material);
        self.grain.push(false);
        self.materials.len() - 1
    }

    fn grain(&self, material: usize) -> bool {
        self.grain[material]
    }

    /// Size of the piece of the photo that a material shows, metres.
    fn photo(&self, material: usize) -> Option<DVec2> {
        let spec = self.tree.materials.get(material)?;
        spec.photo.as_ref().map(|photo| DVec2::from_array(photo.size))
    }
}

/// Whether a pattern follows the length of its part: wood.
fn runs_along(spec: &crate::MaterialSpec) -> bool {
    spec.photo.is_none() && spec.map.as_ref().is_some_and(|m| m.kind == PatternKind::Wood)
}

fn convex(parts: &[&Part], origin: DVec3) -> Vec<ConvexPart> {
    let mut out: Vec<(f64, ConvexPart)> = Vec::new();
    let mut push = |points: &[DVec3], part: &Part| {
        let moved: Vec<DVec3> = points.iter().map(|p| part.place.transform_point3(*p) + origin).collect();
        let hull = hull_points(&moved);
        if hull.len() >= 3 {
            let (lo, hi) = hull
                .iter()
                .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h): (Vec3, Vec3), p| (l.min(*p), h.max(*p)));
            out.push((f64::from((hi - lo).max(Vec3::splat(1e-3)).element_product()), ConvexPart { points: hull }));
        }
    };
    if parts.len() > 2000 {
        // of very many the largest boxes are enough to choose from
        let mut order: Vec<(f64, usize)> = parts
            .iter()
            .enumerate()
            .filter_map(|(i, p)| {
                let (lo, hi) = p.piece.bounds()?;
                Some(((hi - lo).max(DVec3::splat(1e-3)).element_product() * stretch(p), i))
            })
            .collect();
        order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for (_, i) in order.into_iter().take(4 * MAX_CONVEX) {
            push(&parts[i].piece.positions, parts[i]);
        }
    } else {
        for part in parts {
            match &part.hulls {
                Some(hulls) => hulls.iter().for_each(|h| push(h, part)),
                None => push(&part.piece.positions, part),
            }
        }
    }
    if out.len() > MAX_CONVEX {
        out.sort_by(|a, b| b.0.total_cmp(&a.0));
        out.truncate(MAX_CONVEX);
    }
    out.into_iter().map(|(_, p)| p).collect()
}
