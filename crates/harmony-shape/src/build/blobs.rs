//! Solids of a blend as distances.

use glam::{DAffine3, DVec2, DVec3};

use super::expand::affine;
use crate::solid::{Blob, Field, math};
use crate::tree::{Axis, Kind, NodeId, Section, ShapeTree};

/// The solids of a node.
pub(super) fn blobs(tree: &ShapeTree, id: NodeId) -> Result<Vec<Blob>, String> {
    let node = &tree.nodes[id.0 as usize];
    Ok(match &node.kind {
        Kind::Group { children } => children.iter().map(|c| blobs(tree, *c)).collect::<Result<Vec<_>, _>>()?.concat(),
        Kind::Placed { child, columns } => moved(blobs(tree, *child)?, &affine(columns)),
        Kind::Copies { child, places } => {
            let list = blobs(tree, *child)?;
            places.iter().flat_map(|c| moved(list.clone(), &affine(c))).collect()
        }
        Kind::Joint { child, .. } | Kind::Paint { child, .. } => blobs(tree, *child)?,
        Kind::Sphere { radii } => {
            let r = DVec3::from_array(*radii);
            vec![standing(Field::Ellipsoid(r), r, r.y)]
        }
        Kind::Box { size, bevel, .. } => {
            let half = DVec3::from_array(*size) / 2.0;
            vec![standing(Field::Box(half, bevel.min(half.min_element())), half, half.y)]
        }
        Kind::Cylinder { radius, height, top_radius, .. } => {
            let profile = [[0.0, 0.0], [*radius, 0.0], [*top_radius, *height], [0.0, *height]];
            vec![turned(&profile, 1.0)]
        }
        Kind::Lathe { profile, oval, .. } => vec![turned(profile, *oval)],
        Kind::Sweep { curve, section: Section::Round(radius), taper, .. } => {
            let mut points: Vec<DVec3> = curve.points.iter().map(|p| DVec3::from_array(*p)).collect();
            if curve.closed && points.len() > 2 {
                points.push(points[0]);
            }
            let lengths = math::cumulative(points.windows(2).map(|w| w[0].distance(w[1])));
            let total = lengths.last().copied().unwrap_or(0.0).max(1e-9);
            let tube: Vec<(DVec3, f64)> =
                points.iter().zip(&lengths).map(|(p, s)| (*p, radius * (1.0 + (taper - 1.0) * s / total))).collect();
            let reach = DVec3::splat(radius * taper.max(1.0));
            let lo = points.iter().fold(DVec3::INFINITY, |a, p| a.min(*p)) - reach;
            let hi = points.iter().fold(DVec3::NEG_INFINITY, |a, p| a.max(*p)) + reach;
            vec![Blob { field: Field::Tube(tube), lo, hi }]
        }
        Kind::Extrude { outline, depth, axis, .. } => {
            let mut loops: Vec<Vec<DVec2>> = Vec::new();
            let mut open = vec![outline];
            while let Some(o) = open.pop() {
                for l in std::iter::once(&o.points).chain(&o.holes) {
                    loops.push(l.iter().map(|p| DVec2::from_array(*p)).collect());
                }
                open.extend(&o.islands);
            }
            let all = || loops.iter().flatten();
            let lo = all().fold(DVec2::INFINITY, |a, p| a.min(*p));
            let hi = all().fold(DVec2::NEG_INFINITY, |a, p| a.max(*p));
            let start = if *axis == Axis::Y { 0.0 } else { -depth / 2.0 };
            let blob = Blob {
                field: Field::Pulled(loops.clone(), start, start + depth),
                lo: lo.extend(start),
                hi: hi.extend(start + depth),
            };
            let map = match axis {
                Axis::Z => return Ok(vec![blob]),
                Axis::X => glam::DMat3::from_cols(DVec3::NEG_Z, DVec3::Y, DVec3::X),
                Axis::Y => glam::DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
            };
            moved(vec![blob], &DAffine3::from_mat3(map))
        }
        Kind::Blend { children, radius } => {
            let list = children.iter().map(|c| blobs(tree, *c)).collect::<Result<Vec<_>, _>>()?.concat();
            let lo = list.iter().fold(DVec3::INFINITY, |a, b| a.min(b.lo));
            let hi = list.iter().fold(DVec3::NEG_INFINITY, |a, b| a.max(b.hi));
            vec![Blob { field: Field::United(list.into_iter().map(|b| b.field).collect(), *radius), lo, hi }]
        }
        other => {
            let kind = serde_json::to_value(other).ok().and_then(|v| Some(v.get("kind")?.as_str()?.to_owned()));
            return Err(format!(
                "blend takes spheres, boxes, cylinders, lathes, round sweeps and extrusions, not {}",
                kind.unwrap_or_else(|| "this".into())
            ));
        }
    })
}

/// A field about the origin, lifted onto y = 0.
fn standing(field: Field, half: DVec3, up: f64) -> Blob {
    let field = field.moved(&DAffine3::from_translation(DVec3::new(0.0, up, 0.0)));
    Blob { field, lo: DVec3::new(-half.x, up - half.y, -half.z), hi: DVec3::new(half.x, up + half.y, half.z) }
}

fn turned(profile: &[[f64; 2]], oval: f64) -> Blob {
    let mut polygon: Vec<DVec2> = profile.iter().map(|p| DVec2::from_array(*p)).collect();
    // closed along the axis
    if let (Some(first), Some(last)) = (polygon.first().copied(), polygon.last().copied()) {
        if last.x > 0.0 {
            polygon.push(DVec2::new(0.0, last.y));
        }
        if first.x > 0.0 {
            polygon.push(DVec2::new(0.0, first.y));
        }
        // the axis is inside, not a border: mirrored there
        let other: Vec<DVec2> = polygon.iter().rev().map(|p| DVec2::new(-p.x, p.y)).collect();
        polygon.extend(other);
    }
    let reach = polygon.iter().map(|p| p.x).fold(0.0, f64::max);
    let lo = polygon.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    let hi = polygon.iter().map(|p| p.y).fold(f64::NEG_INFINITY, f64::max);
    let wide = reach * oval.max(1.0);
    Blob { field: Field::Turned(polygon, oval), lo: DVec3::new(-wide, lo, -wide), hi: DVec3::new(wide, hi, wide) }
}

fn moved(list: Vec<Blob>, map: &DAffine3) -> Vec<Blob> {
    list.into_iter()
        .map(|b| {
            let corners: [DVec3; 8] = std::array::from_fn(|i| {
                let pick = |bit: usize, l: f64, h: f64| if i & bit == 0 { l } else { h };
                map.transform_point3(DVec3::new(
                    pick(1, b.lo.x, b.hi.x),
                    pick(2, b.lo.y, b.hi.y),
                    pick(4, b.lo.z, b.hi.z),
                ))
            });
            let lo = corners.iter().fold(DVec3::INFINITY, |a, p| a.min(*p));
            let hi = corners.iter().fold(DVec3::NEG_INFINITY, |a, p| a.max(*p));
            Blob { field: b.field.moved(map), lo, hi }
        })
        .collect()
}
