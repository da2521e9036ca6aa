//! Templates, part models, hollow boxes, hulls along curves.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use harmony_mesh::{BuiltModel, Material, PartModel, TemplateParams, template as template_model, template_name};
use harmony_scene::Size;

use super::{BuildContext, Built, Look, Part};
use crate::Piece;
use crate::solid::{self, Lathe};
use crate::tree::{Boolean, Curve, Face, Kind};

/// Most convex pieces along a curve.
const ALONG: usize = 8;

/// A template of the catalogue.
pub(super) fn template(
    name: &str,
    size: [f64; 3],
    params: &serde_json::Value,
    ctx: &BuildContext,
    line: u32,
) -> Result<Built, String> {
    if template_name(name).is_none() {
        return Err(format!("there is no template {name:?}; model it from boxes, lathes and sweeps instead"));
    }
    let size = match (size.iter().all(|v| *v > 0.0), ctx.size) {
        (true, _) => size,
        (false, Some(size)) => size,
        (false, None) => return Err(format!("template {name} needs a size = (width, height, depth)")),
    };
    let size = Size { width: size[0], height: size[1], depth: size[2] };
    let (params, _) = TemplateParams::from_value(params);
    let model = template_model(name, &params, size);
    pieces(&model.build(size).map_err(|e| e.to_string())?, line)
}

/// A JSON part model.
pub(super) fn part_model(model: &PartModel, size: [f64; 3], line: u32) -> Result<Built, String> {
    let size = Size { width: size[0], height: size[1], depth: size[2] };
    pieces(&model.build(size).map_err(|e| e.to_string())?, line)
}

/// One piece a slot.
fn pieces(built: &BuiltModel, line: u32) -> Result<Built, String> {
    let mesh = &built.mesh;
    let mut out = Built::default();
    for group in &mesh.groups {
        let mut piece = Piece::default();
        let mut new_of = vec![u32::MAX; mesh.positions.len()];
        for t in &group.triangles {
            let t = t.map(|i| {
                let k = i as usize;
                if new_of[k] == u32::MAX {
                    new_of[k] = piece.positions.len() as u32;
                    piece.positions.push(mesh.positions[k].as_dvec3());
                    piece.normals.push(mesh.normals[k].as_dvec3());
                    let uv = mesh.metric_uvs.get(k).or(mesh.uvs.get(k)).copied().unwrap_or_default();
                    piece.uvs.push(uv.as_dvec2());
                }
                new_of[k]
            });
            piece.triangles.push(t);
        }
        // all their solids are closed, but rounding to single precision may part a seam by a hair
        piece.closed = true;
        let material: Material = mesh.materials[group.material].clone();
        let mut part = Part::of(piece, line);
        part.name = Arc::from(material.name.as_str());
        part.look = Some(Look::Own(Arc::new(material)));
        part.hulls = Some(Arc::new(Vec::new()));
        out.parts.push(part);
    }
    let hulls = built.convex.iter().map(|c| c.points.iter().map(|p| p.as_dvec3()).collect()).collect();
    match out.parts.first_mut() {
        Some(first) => first.hulls = Some(Arc::new(hulls)),
        None => return Err("the model has no parts".into()),
    }
    Ok(out)
}

type Hollow = (Piece, Vec<Vec<DVec3>>);

/// Walls of plain boxes, cylinders and profiles, made without a copy of the solid; `None` for other kinds.
pub(super) fn hollow_box(kind: &Kind, wall: f64, open: Option<Face>) -> Option<Result<Hollow, String>> {
    match kind {
        Kind::Box { size, bevel, segments, taper, shear } if *taper == [1.0; 2] && *shear == [0.0; 2] => {
            Some(boxed(DVec3::from_array(*size), *bevel, *segments, wall, open))
        }
        Kind::Lathe { profile, smooth_deg, wall: own, oval, lobes, lobe_depth } if *own <= 0.0 => {
            let l = Lathe {
                wall,
                smooth_deg: *smooth_deg,
                oval: *oval,
                lobes: *lobes,
                lobe_depth: *lobe_depth,
                ..Lathe::of(profile)
            };
            Some(solid::lathe(&l).map(|piece| {
                let hulls = vec![piece.positions.clone()];
                (piece, hulls)
            }))
        }
        Kind::Cylinder { radius, height, top_radius, sides, wall: own, .. } if *own <= 0.0 && open.is_some() => {
            let profile = match open {
                Some(Face::Top) => vec![[0.0, 0.0], [*radius, 0.0], [*top_radius, *height]],
                Some(Face::Bottom) => vec![[*radius, 0.0], [*top_radius, *height], [0.0, *height]],
                _ => return None,
            };
            Some(solid::lathe(&Lathe { wall, sides: *sides, ..Lathe::of(&profile) }).map(|piece| {
                let hulls = vec![piece.positions.clone()];
                (piece, hulls)
            }))
        }
        _ => None,
    }
}

/// A box with an inner box taken out, and its walls as boxes.
fn boxed(size: DVec3, bevel: f64, segments: u32, wall: f64, open: Option<Face>) -> Result<Hollow, String> {
    if wall <= 0.0 || 2.0 * wall >= size.min_element() {
        return Err(format!(
            "walls of {wall} m do not fit into {:.3} x {:.3} x {:.3} m; less than half of the smallest side would do",
            size.x, size.y, size.z
        ));
    }
    let outer = solid::rounded_box(size, bevel, segments, DVec2::ONE, DVec2::ZERO);
    let (mut lo, mut hi) =
        (DVec3::new(-size.x / 2.0, 0.0, -size.z / 2.0), DVec3::new(size.x / 2.0, size.y, size.z / 2.0));
    let (outer_lo, outer_hi) = (lo, hi);
    lo += DVec3::splat(wall);
    hi -= DVec3::splat(wall);
    // beyond the open side by more than the inner roundings
    let beyond = wall + bevel + 0.01;
    match open {
        Some(Face::Front) => hi.z += beyond,
        Some(Face::Back) => lo.z -= beyond,
        Some(Face::Right) => hi.x += beyond,
        Some(Face::Left) => lo.x -= beyond,
        Some(Face::Top) => hi.y += beyond,
        Some(Face::Bottom) => lo.y -= beyond,
        None => {}
    }
    let mut inner = solid::rounded_box(hi - lo, (bevel - wall).max(0.0), segments, DVec2::ONE, DVec2::ZERO);
    let shift = DVec3::new(f64::midpoint(lo.x, hi.x), lo.y, f64::midpoint(lo.z, hi.z));
    for p in &mut inner.positions {
        *p += shift;
    }
    let piece = if open.is_some() {
        solid::boolean(Boolean::Cut, &outer, &inner)?
    } else {
        let mut both = outer;
        both.append(&inner.flipped());
        both
    };
    let mut hulls = Vec::new();
    for (axis, low_side, high_side) in
        [(DVec3::X, Face::Left, Face::Right), (DVec3::Y, Face::Bottom, Face::Top), (DVec3::Z, Face::Back, Face::Front)]
    {
        for (side, low) in [(low_side, true), (high_side, false)] {
            if open != Some(side) {
                let thick = size - axis * (size - DVec3::splat(wall));
                let (a, b) = if low { (outer_lo, outer_lo + thick) } else { (outer_hi - thick, outer_hi) };
                hulls.push(corners(a, b));
            }
        }
    }
    Ok((piece, hulls))
}

fn corners(lo: DVec3, hi: DVec3) -> Vec<DVec3> {
    (0..8)
        .map(|i| {
            let pick = |bit: usize, l: f64, h: f64| if i & bit == 0 { l } else { h };
            DVec3::new(pick(1, lo.x, hi.x), pick(2, lo.y, hi.y), pick(4, lo.z, hi.z))
        })
        .collect()
}

/// Hulls of a sweep along its curve where the curve bends; `None` where one hull does.
pub(super) fn along_curve(piece: &Piece, curve: &Curve) -> Option<Vec<Vec<DVec3>>> {
    let points: Vec<DVec3> = curve.points.iter().map(|p| DVec3::from_array(*p)).collect();
    let first = *points.first()?;
    let length: f64 = points.windows(2).map(|w| w[0].distance(w[1])).sum();
    let closing = if curve.closed { points.last()?.distance(first) } else { 0.0 };
    let direct = if curve.closed { 0.0 } else { first.distance(*points.last()?) };
    let total = length + closing;
    if total < 1e-6 || direct > 0.98 * total {
        return None;
    }
    // a coarse centre line tells which run a point belongs to; corners between two runs belong to both
    let mut line = points;
    if curve.closed {
        line.push(first);
    }
    if line.len() > 65 {
        let n = line.len() - 1;
        line = (0..=64).map(|k| line[k * n / 64]).collect();
    }
    let sides = line.len() - 1;
    let runs = sides.min(ALONG);
    let mut out = vec![Vec::new(); runs];
    for p in &piece.positions {
        let mut least = vec![f64::INFINITY; runs];
        for k in 0..sides {
            let d = line[k + 1] - line[k];
            let t = ((*p - line[k]).dot(d) / d.length_squared().max(1e-18)).clamp(0.0, 1.0);
            let run = k * runs / sides;
            least[run] = least[run].min(p.distance(line[k] + d * t));
        }
        let nearest = least.iter().copied().fold(f64::INFINITY, f64::min);
        for (list, distance) in out.iter_mut().zip(&least) {
            if *distance < nearest + 1e-4 {
                list.push(*p);
            }
        }
    }
    out.retain(|l| l.len() > 3);
    Some(out)
}
