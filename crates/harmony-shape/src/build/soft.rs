//! Soft and grown nodes: which function makes them, and what becomes of their parts.

use std::sync::Arc;

use glam::{DAffine3, DVec3};

use super::expand::Before;
use super::{Built, Look, Part};
use crate::Piece;
use crate::soft::{self, Cloth, DrapeSpec, FringeSpec, HangSpec, Hems, PillowSpec, PlantSpec, TuftSpec};
use crate::solid::BentSheet;
use crate::tree::{Along, Axis, Curve, Kind, Node};

/// Hems where the cloth is moved to.
pub(super) fn moved(hems: &Hems, map: &DAffine3) -> Hems {
    let go = |l: &[DVec3]| l.iter().map(|p| map.transform_point3(*p)).collect();
    Hems { head: go(&hems.head), foot: go(&hems.foot), left: go(&hems.left), right: go(&hems.right) }
}

/// The edges of a bent sheet: head and foot at the ends of its profile.
pub(super) fn sheet_hems(sheet: &BentSheet<'_>) -> Hems {
    let half = sheet.width / 2.0;
    let at = |[a, b]: [f64; 2], s: f64| match sheet.axis {
        Axis::X => DVec3::new(s, b, a),
        Axis::Z => DVec3::new(a, b, s),
        Axis::Y => DVec3::new(a, s + half, b),
    };
    let edge = |p: [f64; 2]| vec![at(p, -half), at(p, half)];
    let side = |s: f64| sheet.profile.iter().map(|p| at(*p, s)).collect();
    let first = sheet.profile.first().copied().unwrap_or_default();
    let last = sheet.profile.last().copied().unwrap_or_default();
    Hems { head: edge(first), foot: edge(last), left: side(-half), right: side(half) }
}

/// The index of the part with the largest surface: what is tufted or quilted.
fn largest(built: &Built) -> Result<usize, String> {
    let areas: Vec<f64> = built.parts.iter().map(|p| p.placed().area()).collect();
    (0..areas.len())
        .reduce(|best, k| if areas[k] > areas[best] { k } else { best })
        .ok_or_else(|| "there is no surface to work on".into())
}

fn replaced(part: &Part, piece: Piece) -> Part {
    Part { piece: Arc::new(piece), place: DAffine3::IDENTITY, paint: None, hulls: None, ..part.clone() }
}

fn points(curve: &Curve) -> Vec<DVec3> {
    curve.points.iter().map(|p| DVec3::from_array(*p)).collect()
}

/// A part beside the main one: same material unless it has its own, no collision of its own.
fn beside(piece: Piece, line: u32, name: &str, look: Option<Look>) -> Option<Part> {
    (!piece.triangles.is_empty()).then(|| Part {
        look,
        name: Arc::from(name),
        hulls: Some(Arc::new(Vec::new())),
        ..Part::of(piece, line)
    })
}

fn cloth(made: Cloth, line: u32) -> Built {
    let mut out = Built::of(made.piece, line);
    out.hems = Some(made.hems);
    out.parts.extend(beside(made.fittings, line, "fittings", None));
    out
}

/// Meshes a soft node.
pub(super) fn meshed(before: &Before<'_>, node: &Node) -> Result<Built, String> {
    let line = node.line;
    let one = |piece: Piece| {
        if piece.triangles.is_empty() {
            Err("these numbers give no surface".to_owned())
        } else {
            Ok(Built::of(piece, line))
        }
    };
    let each = |child: &Built, f: &dyn Fn(&Piece) -> Piece| {
        let mut out = child.clone();
        for part in &mut out.parts {
            *part = replaced(part, f(&part.placed()));
        }
        out
    };
    match &node.kind {
        Kind::Pillow { size, wrinkle, piping, ears, dent, seed } => one(soft::pillow(&PillowSpec {
            size: *size,
            wrinkle: *wrinkle,
            piping: *piping,
            ears: *ears,
            dent: *dent,
            seed: *seed,
        })),
        Kind::Cushion { size, crown, sag, piping, bevel } => one(soft::cushion(*size, *crown, *sag, *piping, *bevel)),
        Kind::Tuft { child, face, rows, cols, depth, diamond, button } => {
            let mut out = before.get(*child).clone();
            let k = largest(&out)?;
            let spec = TuftSpec { rows: *rows, cols: *cols, depth: *depth, diamond: *diamond, button: *button };
            let made = soft::tuft(&out.parts[k].placed(), *face, &spec);
            let look = out.parts[k].look.clone();
            out.parts[k] = replaced(&out.parts[k], made.piece);
            out.parts.extend(beside(made.buttons, line, "buttons", look));
            Ok(out)
        }
        Kind::Quilt { child, face, cell, depth, pattern } => {
            let mut out = before.get(*child).clone();
            let k = largest(&out)?;
            let made = soft::quilt(&out.parts[k].placed(), *face, *cell, *depth, pattern);
            out.parts[k] = replaced(&out.parts[k], made);
            Ok(out)
        }
        Kind::Drape { size, over, at, turn_deg, rumple, thick, fold, stiff, seed } => {
            let below: Vec<Piece> = over.iter().flat_map(|o| &before.get(*o).parts).map(Part::placed).collect();
            let refs: Vec<&Piece> = below.iter().collect();
            let spec = DrapeSpec {
                size: *size,
                at: *at,
                turn_deg: *turn_deg,
                rumple: *rumple,
                thick: *thick,
                fold: *fold,
                stiff: *stiff,
                seed: *seed,
            };
            Ok(cloth(soft::drape(&spec, &refs)?, line))
        }
        Kind::Hang { size, folds, gather, top, tie, seed } => Ok(cloth(
            soft::hang(&HangSpec { size: *size, folds: *folds, gather: *gather, top: *top, tie: *tie, seed: *seed }),
            line,
        )),
        Kind::Slump { child, amount } => Ok(each(before.get(*child), &|p| soft::slump(p, *amount))),
        Kind::Roll { width, radius, turns, thick } => one(soft::roll(*width, *radius, *turns, *thick)),
        Kind::Folded { size, layers, thick, seed } => one(soft::folded(*size, *layers, *thick, *seed)),
        Kind::Fringe { along, fringe, length, spacing, jitter, seed } => {
            let (line_points, closed) = match along {
                Along::Curve(curve) => (points(curve), curve.closed),
                Along::Hem { of, side } => {
                    let hems = before.get(*of).hems.as_ref();
                    let hems = hems.ok_or("only draped, hung and bent cloths have hems; give a curve instead")?;
                    let edge = hems.named(side);
                    let edge =
                        edge.ok_or_else(|| format!("a cloth has no edge {side:?}; head, foot, left, right or all"))?;
                    (edge, side == "all")
                }
            };
            if line_points.len() < 2 {
                return Err("a fringe needs an edge of at least two points".into());
            }
            let spec = FringeSpec { kind: *fringe, length: *length, spacing: *spacing, jitter: *jitter, seed: *seed };
            let mut out = one(soft::fringe(&line_points, closed, &spec))?;
            out.parts[0].hulls = Some(Arc::new(Vec::new()));
            Ok(out)
        }
        Kind::Fuzz { child, fuzz, length, density, seed } => {
            let mut out = before.get(*child).clone();
            let k = largest(&out)?;
            let hairs = soft::fuzz(&out.parts[k].placed(), *fuzz, *length, *density, *seed);
            let look = node.material.map(Look::Slot).or_else(|| out.parts[k].look.clone());
            out.parts.extend(beside(hairs, line, "hairs", look).map(|part| Part { hairy: true, ..part }));
            Ok(out)
        }
        Kind::Braid { curve, radius, strands, pitch } => {
            one(soft::braid(&points(curve), curve.closed, *radius, *strands, *pitch))
        }
        Kind::Wicker { child, cell, radius } => {
            let hulls: Vec<Vec<DVec3>> = before.get(*child).parts.iter().map(|p| p.placed().positions).collect();
            let mut out = each(before.get(*child), &|p| soft::wicker(p, *cell, *radius));
            for (part, hull) in out.parts.iter_mut().zip(hulls) {
                part.hulls = Some(Arc::new(vec![hull]));
            }
            Ok(out)
        }
        Kind::WireNet { outline, pitch, radius } => one(soft::wire_net(outline, *pitch, *radius)),
        Kind::Leaf { size, shape, fold_deg, curl_deg } => one(soft::leaf(*size, shape, *fold_deg, *curl_deg)),
        Kind::Plant { plant, height, spread, count, leaf, flower, seed } => {
            let own = leaf.map(|l| {
                let mut all = Piece::default();
                for part in &before.get(l).parts {
                    all.append(&part.placed());
                }
                all
            });
            let look = leaf.and_then(|l| before.get(l).parts.first().and_then(|p| p.look.clone()));
            let spec = PlantSpec { kind: *plant, height: *height, spread: *spread, count: *count, seed: *seed };
            let made = soft::plant(&spec, own.as_ref());
            let mut out = Built::default();
            out.parts.extend(beside(made.leaves, line, "leaves", look));
            out.parts.extend(beside(made.stems, line, "stems", None));
            out.parts.extend(beside(made.flowers, line, "flowers", flower.map(Look::Slot)));
            if let Some((lo, hi)) = out.bounds() {
                // one hull for the whole plant
                let corners = (0..8)
                    .map(|i| {
                        let pick = |bit: usize, l: f64, h: f64| if i & bit == 0 { l } else { h };
                        DVec3::new(pick(1, lo.x, hi.x), pick(2, lo.y, hi.y), pick(4, lo.z, hi.z))
                    })
                    .collect();
                out.parts[0].hulls = Some(Arc::new(vec![corners]));
                Ok(out)
            } else {
                Err("these numbers give no plant".into())
            }
        }
        _ => Err("this kind of node is not built yet".into()),
    }
}
