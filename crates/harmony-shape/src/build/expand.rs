//! Every node in its own frame.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec2, DVec3};
use rayon::prelude::*;

use super::{
    BuildContext, Built, BuiltJoint, BuiltLight, BuiltSurface, JointAt, Look, Part, blobs, decal, place, soft, whole,
};
use crate::Piece;
use crate::solid::{self, BentSheet, Extrusion, Lathe, Sweep};
use crate::tree::{Boolean, Face, Kind, Node, NodeId, ShapeTree, TreeError};

/// Most parts of one node.
const MAX_PARTS: usize = crate::tree::MAX_INSTANCES as usize;

/// What the nodes before have become.
pub(super) struct Before<'a> {
    pub tree: &'a ShapeTree,
    pub ctx: &'a BuildContext,
    done: &'a [Option<Arc<Built>>],
}

impl Before<'_> {
    /// A node that was meshed before.
    pub fn get(&self, id: NodeId) -> &Built {
        static EMPTY: Built =
            Built { parts: Vec::new(), lights: Vec::new(), joints: Vec::new(), surfaces: Vec::new(), hems: None };
        self.done.get(id.0 as usize).and_then(|b| b.as_deref()).unwrap_or(&EMPTY)
    }
}

/// Meshes what the root needs, level by level.
pub(super) fn expand(tree: &ShapeTree, ctx: &BuildContext) -> Result<Arc<Built>, TreeError> {
    let n = tree.nodes.len();
    let mut used = vec![false; n];
    used[n - 1] = true;
    for i in (0..n).rev() {
        if used[i] {
            for r in tree.nodes[i].kind.references() {
                used[r.0 as usize] = true;
            }
        }
    }
    let mut level = vec![0_usize; n];
    for i in 0..n {
        let below = tree.nodes[i].kind.references().iter().map(|r| level[r.0 as usize] + 1).max();
        level[i] = below.unwrap_or(0);
    }
    let mut levels: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for i in (0..n).filter(|i| used[*i]) {
        levels.entry(level[i]).or_default().push(i);
    }
    let mut done: Vec<Option<Arc<Built>>> = vec![None; n];
    for ids in levels.values() {
        let before = Before { tree, ctx, done: &done };
        let built: Vec<Result<Built, TreeError>> =
            ids.par_iter().map(|i| finished(&before, &tree.nodes[*i], *i == n - 1)).collect();
        for (i, b) in ids.iter().zip(built) {
            done[*i] = Some(Arc::new(b?));
        }
    }
    done[n - 1].clone().ok_or(TreeError::Empty)
}

/// A node with its name and material given to what has none.
fn finished(before: &Before<'_>, node: &Node, root: bool) -> Result<Built, TreeError> {
    let error = |message: String| {
        let message = match &node.name {
            Some(name) if !message.contains(name.as_str()) => format!("{name}: {message}"),
            _ => message,
        };
        TreeError::Shape { message, line: node.line }
    };
    let mut built = meshed(before, node).map_err(error)?;
    if built.parts.len() > MAX_PARTS {
        return Err(error(format!("{} pieces; at most {MAX_PARTS} are allowed", built.parts.len())));
    }
    for part in &mut built.parts {
        if !part.piece.positions.iter().all(|p| p.is_finite()) {
            return Err(error("the numbers give points that are not finite".into()));
        }
        if let (None, Some(m)) = (&part.look, node.material) {
            part.look = Some(Look::Slot(m));
        }
    }
    if let (Some(name), false) = (&node.name, root) {
        let mut known: BTreeMap<Arc<str>, Arc<str>> = BTreeMap::new();
        let mut joined = |old: &Arc<str>| {
            known
                .entry(old.clone())
                .or_insert_with(|| {
                    if old.is_empty() { Arc::from(name.as_str()) } else { Arc::from(format!("{name}/{old}")) }
                })
                .clone()
        };
        for part in &mut built.parts {
            part.name = joined(&part.name);
        }
        let mut text = |old: &mut String| *old = joined(&Arc::from(old.as_str())).to_string();
        built.lights.iter_mut().for_each(|l| text(&mut l.name));
        built.surfaces.iter_mut().for_each(|s| text(&mut s.name));
        built.joints.iter_mut().for_each(|j| text(&mut j.joint.name));
    }
    Ok(built)
}

pub(super) fn affine(columns: &[[f64; 3]; 4]) -> DAffine3 {
    let [x, y, z, o] = columns.map(DVec3::from_array);
    DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: o }
}

/// A map that would flatten a part keeps a hair of it.
fn sound(columns: &[[f64; 3]; 4]) -> Result<DAffine3, String> {
    let map = affine(columns);
    if map.matrix3.determinant().abs() < 1e-12 {
        return Err("a scale of 0 flattens the part; give it a small one".into());
    }
    Ok(map)
}

fn meshed(before: &Before<'_>, node: &Node) -> Result<Built, String> {
    let line = node.line;
    let one = |piece: Piece| Built::of(piece, line);
    Ok(match &node.kind {
        Kind::Group { children } => {
            let mut out = Built::default();
            for c in children {
                out.add(before.get(*c), &DAffine3::IDENTITY);
            }
            out
        }
        Kind::Placed { child, columns } => {
            let map = sound(columns)?;
            let mut out = Built::default();
            out.add(before.get(*child), &map);
            out.hems = before.get(*child).hems.as_ref().map(|h| soft::moved(h, &map));
            out
        }
        Kind::Copies { child, places } => {
            let mut out = Built::default();
            for columns in places {
                out.add(before.get(*child), &sound(columns)?);
            }
            out
        }
        Kind::On { child, other, u, v } => place::on(before.get(*child), before.get(*other), *u, *v)?,
        Kind::Against { child, other, side } => place::against(before.get(*child), before.get(*other), *side)?,
        Kind::Scatter { children, on, count, gap, seed } => {
            let list: Vec<&Built> = children.iter().map(|c| before.get(*c)).collect();
            place::scatter(&list, before.get(*on), *count, *gap, *seed)?
        }
        Kind::Stack { children, gap, jitter, seed } => {
            let list: Vec<&Built> = children.iter().map(|c| before.get(*c)).collect();
            place::stack(&list, *gap, *jitter, *seed)
        }
        Kind::Box { size, bevel, segments, taper, shear } => one(solid::rounded_box(
            DVec3::from_array(*size),
            *bevel,
            *segments,
            DVec2::from_array(*taper),
            DVec2::from_array(*shear),
        )),
        Kind::Cylinder { radius, height, top_radius, bevel, sides, wall } => {
            one(solid::cylinder(*radius, *height, *top_radius, *bevel, *sides, *wall)?)
        }
        Kind::Sphere { radii } => one(solid::sphere(DVec3::from_array(*radii))),
        Kind::Lathe { profile, smooth_deg, wall, oval, lobes, lobe_depth } => one(solid::lathe(&Lathe {
            profile,
            smooth_deg: *smooth_deg,
            wall: *wall,
            oval: *oval,
            lobes: *lobes,
            lobe_depth: *lobe_depth,
            sides: 0,
        })?),
        Kind::Extrude { outline, depth, axis, bevel, bend_deg, twist_deg } => one(solid::extrude(&Extrusion {
            outline,
            depth: *depth,
            axis: *axis,
            bevel: *bevel,
            bend_deg: *bend_deg,
            twist_deg: *twist_deg,
        })?),
        Kind::Sweep { curve, section, taper, twist_deg, rings, round_caps } => {
            let piece = solid::sweep(&Sweep {
                curve,
                section,
                taper: *taper,
                twist_deg: *twist_deg,
                rings: *rings,
                round_caps: *round_caps,
            })?;
            let hulls = whole::along_curve(&piece, curve);
            let mut out = one(piece);
            out.parts[0].hulls = hulls.map(Arc::new);
            out
        }
        Kind::Loft { sections, closed } => one(solid::loft(sections, *closed)?),
        Kind::BentSheet { profile, width, thick, smooth, axis } => {
            let sheet = BentSheet { profile, width: *width, thick: *thick, smooth: *smooth, axis: *axis };
            let mut out = one(solid::bent_sheet(&sheet)?);
            out.hems = Some(soft::sheet_hems(&sheet));
            out
        }
        Kind::Surf { points, nu, thick, closed_u } => one(solid::surf(points, *nu as usize, *thick, *closed_u)?),
        Kind::Mesh { points, faces } => one(solid::mesh(points, faces)?),
        Kind::Blend { children, radius } => {
            let blobs = children.iter().map(|c| blobs::blobs(before.tree, *c)).collect::<Result<Vec<_>, _>>()?.concat();
            let mut out = one(solid::blend(&blobs, *radius)?);
            // the look of the first one that has one
            out.parts[0].look = match node.material {
                Some(m) => Some(Look::Slot(m)),
                None => children.iter().flat_map(|c| &before.get(*c).parts).find_map(|p| p.look.clone()),
            };
            out
        }
        Kind::Boolean { op, a, b } => boolean(*op, before.get(*a), before.get(*b))?,
        Kind::Shell { child, wall, open } => {
            let plain = whole::hollow_box(&before.tree.nodes[child.0 as usize].kind, *wall, *open);
            let source = before.get(*child);
            let mut out = source.clone();
            if let (Some(made), 1) = (plain, out.parts.len()) {
                let (piece, hulls) = made?;
                out.parts[0].piece = Arc::new(piece);
                out.parts[0].hulls = Some(Arc::new(hulls));
                return Ok(out);
            }
            for part in &mut out.parts {
                // the walls keep the part's look; places stay as they are
                let made = solid::hollow(&part.placed(), *wall, *open).map_err(|e| naming(part, e))?;
                *part =
                    Part { piece: Arc::new(made), place: DAffine3::IDENTITY, paint: None, hulls: None, ..part.clone() };
            }
            out
        }
        Kind::Joint { child, joint, axis, pivot, range } => {
            let mut out = before.get(*child).clone();
            let joint = BuiltJoint {
                name: String::new(),
                parts: Vec::new(),
                kind: *joint,
                axis: DVec3::from_array(*axis).normalize_or(DVec3::Y),
                pivot: DVec3::from_array(*pivot),
                range: *range,
                boxes: Vec::new(),
            };
            let count = out.parts.len();
            out.joints.push(JointAt { joint, first: 0, count });
            out
        }
        Kind::Light { lamp, lumens, kelvin, radius, cone_deg, at, dir } => Built {
            lights: vec![BuiltLight {
                name: String::new(),
                kind: *lamp,
                position: DVec3::from_array(*at),
                direction: DVec3::from_array(*dir).normalize_or(DVec3::NEG_Y),
                lumens: *lumens,
                kelvin: *kelvin,
                radius: *radius,
                cone_deg: *cone_deg,
            }],
            ..Built::default()
        },
        Kind::Surface { size, at } => Built {
            surfaces: vec![BuiltSurface {
                name: String::new(),
                at: DVec3::from_array(*at),
                half_width: DVec3::X * (size[0] / 2.0),
                half_depth: DVec3::Z * (size[1] / 2.0),
            }],
            ..Built::default()
        },
        Kind::Template { template, size, params } => whole::template(template, *size, params, before.ctx, line)?,
        Kind::PartModel { model, size } => whole::part_model(model, *size, line)?,
        Kind::Paint { child, face, with } => paint(before.get(*child), *face, *with),
        Kind::Decal { child, face, with, at, size } => {
            let mut out = before.get(*child).clone();
            let mut piece = decal::decal(before.get(*child), *face, DVec2::from_array(*at), DVec2::from_array(*size))?;
            // A piece of the photo is shown once and whole, however large it is laid.
            if let Some(photo) = before.tree.materials.get(*with as usize).and_then(|m| m.photo.as_ref()) {
                let whole = DVec2::from_array(photo.size) / DVec2::from_array(*size);
                piece.uvs.iter_mut().for_each(|uv| *uv *= whole);
            }
            let mut part = Part::of(piece, line);
            part.look = Some(Look::Decal(*with));
            part.name = Arc::from("decal");
            part.hulls = Some(Arc::new(Vec::new()));
            out.parts.push(part);
            out
        }
        _ => soft::meshed(before, node)?,
    })
}

/// An error with the name of the part that it is about.
fn naming(part: &Part, error: String) -> String {
    if part.name.is_empty() { error } else { format!("{}: {error}", part.name) }
}

/// Outward direction of a side.
pub(super) fn outward(face: Face) -> DVec3 {
    match face {
        Face::Front => DVec3::Z,
        Face::Back => DVec3::NEG_Z,
        Face::Left => DVec3::NEG_X,
        Face::Right => DVec3::X,
        Face::Top => DVec3::Y,
        Face::Bottom => DVec3::NEG_Y,
    }
}

/// Triangles within 45 degrees of a side take another material.
fn paint(child: &Built, face: Face, with: u32) -> Built {
    let mut out = child.clone();
    let direction = outward(face);
    for part in &mut out.parts {
        let map = part.place;
        let flip = map.matrix3.determinant().signum();
        let old = part.paint.clone();
        let list: Vec<u32> = part
            .piece
            .corners()
            .enumerate()
            .map(|(t, corners)| {
                let [a, b, c] = corners.map(|p| map.transform_point3(p));
                let n = (b - a).cross(c - a).normalize_or_zero() * flip;
                if n.dot(direction) > 0.708 { with } else { old.as_ref().map_or(u32::MAX, |o| o[t]) }
            })
            .collect();
        part.paint = Some(Arc::new(list));
    }
    out
}

/// Part by part: cutting keeps each part of the first with its look; joining makes one solid of what looks alike.
fn boolean(op: Boolean, a: &Built, b: &Built) -> Result<Built, String> {
    for part in a.parts.iter().chain(&b.parts) {
        if !part.piece.closed {
            let e = "is not a closed solid, so that nothing can be cut from it or joined to it; give it a wall or thickness";
            let name =
                if part.name.is_empty() { format!("the part of line {}", part.line) } else { part.name.to_string() };
            return Err(format!("{name} {e}"));
        }
    }
    let mut out = Built { parts: Vec::new(), ..a.clone() };
    let tools: Vec<Piece> = b.parts.iter().map(Part::placed).collect();
    let made = |part: &Part, piece: Piece| Part {
        piece: Arc::new(piece),
        place: DAffine3::IDENTITY,
        paint: None,
        hulls: None,
        ..part.clone()
    };
    match op {
        Boolean::Cut => {
            for part in &a.parts {
                let mut piece = part.placed();
                for tool in &tools {
                    if !piece.triangles.is_empty() {
                        piece = solid::boolean(op, &piece, tool).map_err(|e| naming(part, e))?;
                    }
                }
                if !piece.triangles.is_empty() {
                    out.parts.push(made(part, piece));
                }
            }
        }
        Boolean::Common => {
            for part in &a.parts {
                let own = part.placed();
                for tool in &tools {
                    let piece = solid::boolean(op, &own, tool).map_err(|e| naming(part, e))?;
                    if !piece.triangles.is_empty() {
                        out.parts.push(made(part, piece));
                    }
                }
            }
        }
        Boolean::Join => {
            for part in a.parts.iter().chain(&b.parts) {
                let same = |other: &Part| match (&other.look, &part.look) {
                    (Some(Look::Slot(m)), Some(Look::Slot(n))) => m == n,
                    (None, _) | (_, None) => true,
                    _ => false,
                };
                match out.parts.iter_mut().find(|p| same(p)) {
                    Some(into) => {
                        let piece = solid::boolean(op, &into.piece, &part.placed()).map_err(|e| naming(part, e))?;
                        into.look = into.look.clone().or(part.look.clone());
                        into.piece = Arc::new(piece);
                    }
                    None => out.parts.push(made(part, part.placed())),
                }
            }
        }
    }
    if out.parts.is_empty() {
        return Err("nothing is left of it; move the second solid or make it smaller".into());
    }
    Ok(out)
}
