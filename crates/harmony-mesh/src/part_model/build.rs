//! From a part model to a mesh.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DVec2, DVec3, Vec2Swizzles as _, Vec3};
use harmony_scene::{MaterialCategory, Size};

use super::shapes::{self, Whole};
use super::solid::Solid;
use super::{
    Axis, MAX_DEPTH, MAX_PARTS, Mirror, Part, PartModel, PartModelError, Repeat, Repeats, Shape, Slot, TextureMode,
    atlas, linear_rgb, parse_color,
};
use crate::convex::hull_points;
use crate::{ConvexPart, Group, Material, Mesh};

/// Smallest side of an object, metres.
pub(super) const MIN_SIDE: f64 = 0.001;
/// Largest side of an object, metres.
pub(super) const MAX_SIDE: f64 = 50.0;
/// Thinnest side of a part, metres.
const THINNEST: f64 = 2e-4;
/// From this many parts on, curves are divided more coarsely.
const MANY: usize = 36;
/// Most convex pieces.
const MAX_CONVEX: usize = 48;
/// Colour of a slot that is not described.
const UNKNOWN_COLOR: [u8; 3] = [150, 145, 138];

/// What a part model becomes.
#[derive(Debug, Clone)]
pub struct BuiltModel {
    /// Canonical mesh in metres (+Y up, front +Z, bottom at y = 0, centred in x and z), one group and material a used
    /// slot, uniquely unwrapped.
    pub mesh: Mesh,
    /// Convex pieces in the mesh's frame, for collision.
    pub convex: Vec<ConvexPart>,
    /// Slot name of each material.
    pub slots: Vec<String>,
    /// Slots that keep their colour when the photo is baked.
    pub plain_slots: Vec<String>,
}

/// One part after repeats and mirrors.
struct Instance<'a> {
    part: &'a Part,
    slot: &'a str,
    /// Half extents, metres.
    half: DVec3,
    object_from_part: DAffine3,
}

pub(super) fn build(model: &PartModel, size: Size) -> Result<BuiltModel, PartModelError> {
    model.check()?;
    let wanted = size.as_vec();
    if !(wanted.is_finite() && wanted.min_element() >= MIN_SIDE && wanted.max_element() <= MAX_SIDE) {
        let Size { width, height, depth } = size;
        return Err(PartModelError::Size { width, height, depth, min: MIN_SIDE, max: MAX_SIDE });
    }
    Ok(assemble(model, &solids(model, wanted)?, wanted))
}

/// The parts' solids with their slots, in the canonical frame, together exactly as large as `wanted`.
pub(super) fn solids(model: &PartModel, wanted: DVec3) -> Result<Vec<(String, Solid)>, PartModelError> {
    // parts need not reach the sides of the unit box: the box is enlarged until they do, so that thicknesses and
    // roundings keep their proportions; only the last per cent is a stretch
    let mut virtual_size = wanted;
    let mut round = 0;
    loop {
        let mut list = instances(model, virtual_size)?;
        let many = list.len() > MANY;
        let whole = Whole { largest: wanted.max_element(), smallest: wanted.min_element(), many };
        let mut built: Vec<(String, Solid)> = list
            .drain(..)
            .map(|i| {
                let mut solid = shapes::solid(i.part, i.half, &whole);
                solid.transform(&i.object_from_part);
                (i.slot.to_owned(), solid)
            })
            .collect();
        let (lo, hi) = built
            .iter()
            .flat_map(|(_, s)| &s.points)
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi): (DVec3, DVec3), p| (lo.min(*p), hi.max(*p)));
        let extent = (hi - lo).max(DVec3::splat(1e-6));
        let off = wanted / extent;
        round += 1;
        if round < 4 && (off - DVec3::ONE).abs().max_element() > 0.01 {
            virtual_size = (virtual_size * off.clamp(DVec3::splat(0.2), DVec3::splat(5.0)))
                .clamp(DVec3::splat(MIN_SIDE * 0.1), DVec3::splat(MAX_SIDE * 10.0));
            continue;
        }
        let middle = (lo + hi) / 2.0;
        let origin = DVec3::new(middle.x, lo.y, middle.z);
        let canonical = DAffine3::from_scale(off) * DAffine3::from_translation(-origin);
        for (_, solid) in &mut built {
            solid.transform(&canonical);
        }
        return Ok(built);
    }
}

fn instances(model: &PartModel, extent: DVec3) -> Result<Vec<Instance<'_>>, PartModelError> {
    let mut out = Vec::new();
    for part in &model.parts {
        expand(part, extent, DAffine3::IDENTITY, "", 1, &mut out)?;
    }
    Ok(out)
}

fn expand<'a>(
    part: &'a Part,
    parent: DVec3,
    object_from_parent: DAffine3,
    inherited: &'a str,
    depth: usize,
    out: &mut Vec<Instance<'a>>,
) -> Result<(), PartModelError> {
    let slot = part.slot.as_deref().unwrap_or(inherited);
    let (low, high) = part_box(part, parent);
    let half = ((high - low) / 2.0).max(DVec3::splat(THINNEST / 2.0));
    let turn = part.turn_deg.unwrap_or_default().map(f64::to_radians);
    let rotation = DMat3::from_rotation_z(turn[2]) * DMat3::from_rotation_y(turn[1]) * DMat3::from_rotation_x(turn[0]);
    let turned = turn.iter().any(|a| *a != 0.0);
    for offset in offsets(part, low / parent, high / parent, parent) {
        let centre = (low + high) / 2.0 + offset;
        for reflection in reflections(part.mirror, centre, parent, turned || part.shape == Shape::Group) {
            if out.len() >= MAX_PARTS {
                return Err(PartModelError::TooManyParts { count: out.len() + 1, limit: MAX_PARTS });
            }
            let parent_from_part = reflection * DAffine3::from_mat3_translation(rotation, centre);
            let object_from_part = object_from_parent * parent_from_part;
            if part.shape == Shape::Group {
                if depth < MAX_DEPTH {
                    let object_from_box = object_from_part * DAffine3::from_translation(-half);
                    for child in part.parts.as_deref().unwrap_or(&[]) {
                        expand(child, half * 2.0, object_from_box, slot, depth + 1, out)?;
                    }
                }
            } else {
                out.push(Instance { part, slot, half, object_from_part });
            }
        }
    }
    Ok(())
}

/// Corners of the part's box in the parent, metres; squared parts keep their place relative to the parent's sides.
fn part_box(part: &Part, parent: DVec3) -> (DVec3, DVec3) {
    let (a, b) = (DVec3::from_array(part.from), DVec3::from_array(part.to));
    let (mut low, mut high) = (a.min(b), a.max(b));
    let round = match part.shape {
        Shape::Cylinder | Shape::Lathe if !part.oval.unwrap_or(false) => Some(part.axis.unwrap_or(Axis::Y)),
        _ => part.square,
    };
    if let Some(axis) = round {
        let (u, v) = match axis {
            Axis::X => (1, 2),
            Axis::Y => (0, 2),
            Axis::Z => (0, 1),
        };
        let side = ((high[u] - low[u]) * parent[u]).min((high[v] - low[v]) * parent[v]);
        for k in [u, v] {
            let extent = high[k] - low[k];
            let narrow = side / parent[k];
            // touching the low side it stays there, touching the high side there, in the middle in the middle
            let align = if extent < 1.0 - 1e-9 { (low[k] / (1.0 - extent)).clamp(0.0, 1.0) } else { 0.5 };
            low[k] += (extent - narrow) * align;
            high[k] = low[k] + narrow;
        }
    }
    (low * parent, high * parent)
}

fn offsets(part: &Part, low: DVec3, high: DVec3, parent: DVec3) -> Vec<DVec3> {
    let mut out = vec![DVec3::ZERO];
    let rows: &[Repeat] = match &part.repeat {
        None => &[],
        Some(Repeats::Row(row)) => std::slice::from_ref(row),
        Some(Repeats::Grid(rows)) => rows,
    };
    for row in rows {
        let k = row.axis as usize;
        let count = row.count.clamp(1, 100);
        let room = 1.0 - low[k] - high[k];
        let step = row.step.unwrap_or_else(|| room / f64::from(count.max(2) - 1));
        let mut unit = DVec3::ZERO;
        unit[k] = step * parent[k];
        // expansion stops at the part limit; no need to list more
        out = (0..count).flat_map(|n| out.iter().map(move |o| *o + unit * f64::from(n))).take(MAX_PARTS + 1).collect();
    }
    out
}

fn reflections(mirror: Option<Mirror>, centre: DVec3, parent: DVec3, always: bool) -> Vec<DAffine3> {
    let planes: &[usize] = match mirror {
        None => &[],
        Some(Mirror::X) => &[0],
        Some(Mirror::Y) => &[1],
        Some(Mirror::Z) => &[2],
        Some(Mirror::Xz) => &[0, 2],
    };
    let mut out = vec![DAffine3::IDENTITY];
    for &k in planes {
        // a part in the plane would only double itself
        let own = (centre[k] - parent[k] / 2.0).abs() < 1e-6 * parent[k];
        if own && !always {
            continue;
        }
        let mut scale = DVec3::ONE;
        scale[k] = -1.0;
        let mut shift = DVec3::ZERO;
        shift[k] = parent[k];
        let reflect = DAffine3::from_translation(shift) * DAffine3::from_scale(scale);
        let reflected: Vec<DAffine3> = out.iter().map(|m| reflect * *m).collect();
        out.extend(reflected);
    }
    out
}

fn assemble(model: &PartModel, built: &[(String, Solid)], wanted: DVec3) -> BuiltModel {
    let charts: Vec<DVec2> = built.iter().flat_map(|(_, s)| &s.charts).map(|c| chart_box(c).1).collect();
    let (scale, places) = atlas::pack_charts(&charts);
    let mut mesh = Mesh::default();
    let mut convex = Vec::new();
    let mut material_of: BTreeMap<&str, usize> = BTreeMap::new();
    let mut slots = Vec::new();
    let mut plain_slots = Vec::new();
    let mut place = places.iter();
    let limit = wanted / 2.0;
    for (name, solid) in built {
        let name = name.as_str();
        let material = *material_of.entry(name).or_insert_with(|| {
            let slot = model.slot(name);
            slots.push(if name.is_empty() { "body".to_owned() } else { name.to_owned() });
            if slot.is_some_and(|s| s.texture == TextureMode::Plain) {
                plain_slots.push(name.to_owned());
            }
            mesh.materials.push(material(name, slot));
            mesh.groups.push(Group { material: mesh.materials.len() - 1, triangles: Vec::new() });
            mesh.materials.len() - 1
        });
        for chart in &solid.charts {
            let Some(spot) = place.next() else { break };
            let (corner, _) = chart_box(chart);
            let base = mesh.positions.len() as u32;
            for v in &chart.vertices {
                let p = solid.points[v.point as usize];
                let p = p.clamp(DVec3::new(-limit.x, 0.0, -limit.z), DVec3::new(limit.x, wanted.y, limit.z));
                let local = v.uv - corner;
                let local = if spot.turned { local.yx() } else { local };
                mesh.positions.push(p.as_vec3());
                mesh.normals.push(v.normal.as_vec3());
                mesh.metric_uvs.push(v.uv.as_vec2());
                mesh.uvs.push((spot.offset + local * scale).clamp(DVec2::ZERO, DVec2::ONE).as_vec2());
            }
            let triangles = chart.triangles.iter().map(|t| t.map(|i| i + base));
            mesh.groups[material].triangles.extend(triangles);
        }
        convex.extend(solid.pieces.iter().map(|p| ConvexPart { points: hull_points(p) }));
    }
    BuiltModel { mesh, convex: largest(convex), slots, plain_slots }
}

/// Drops the smallest pieces of many (handles, books).
fn largest(mut parts: Vec<ConvexPart>) -> Vec<ConvexPart> {
    if parts.len() > MAX_CONVEX {
        let extent = |part: &ConvexPart| {
            let (lo, hi) = part
                .points
                .iter()
                .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi): (Vec3, Vec3), p| (lo.min(*p), hi.max(*p)));
            (hi - lo).element_product()
        };
        parts.sort_by(|a, b| extent(b).total_cmp(&extent(a)));
        parts.truncate(MAX_CONVEX);
    }
    parts
}

/// Lowest corner and size of a chart's unwrapped box.
fn chart_box(chart: &super::solid::Chart) -> (DVec2, DVec2) {
    let (lo, hi) = chart
        .vertices
        .iter()
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(lo, hi): (DVec2, DVec2), v| (lo.min(v.uv), hi.max(v.uv)));
    (lo, (hi - lo).max(DVec2::ZERO))
}

fn material(name: &str, slot: Option<&Slot>) -> Material {
    let rgb = slot.and_then(|s| parse_color(&s.color)).unwrap_or(UNKNOWN_COLOR);
    let category = slot.and_then(|s| s.material).unwrap_or(MaterialCategory::Other);
    let pbr = category.defaults();
    Material {
        roughness: pbr.roughness as f32,
        metallic: pbr.metallic as f32,
        ior: pbr.ior as f32,
        transmission: pbr.transmission as f32,
        ..Material::plain(if name.is_empty() { "body" } else { name }, linear_rgb(rgb))
    }
}

#[cfg(test)]
#[path = "build_tests.rs"]
mod tests;
