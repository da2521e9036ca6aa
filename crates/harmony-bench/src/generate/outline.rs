//! Key `shape` of `room.json`: outline of the free floor, ceiling, blocks, niches and walls of a room that is no box.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};
use harmony_scene::{Room, Slope, Surface, Wall};
use serde_json::{Value, json};

use super::GeneratedOpening;
use super::files::{kind_of, list, round};

/// Lengths below this are none, metres.
const EPS: f64 = 1e-6;

/// The key's value; `room` in the frame of the files.
pub(super) fn shape(room: &Room, openings: &[GeneratedOpening]) -> Value {
    let e = &room.extents;
    let numbered = |name: &str, k: usize| format!("{name}_{:02}", k + 1);
    let blocks: Vec<Value> = room.shape.blocks.iter().enumerate().map(|(k, b)| {
        json!({ "id": numbered("block", k), "kind": b.kind, "min": list(b.min, 6), "max": list(b.max, 6) })
    }).collect();
    let niches: Vec<Value> = room
        .shape
        .niches
        .iter()
        .enumerate()
        .map(|(k, n)| {
            let (a, b) = (n.surface.coordinates(n.min), n.surface.coordinates(n.max));
            json!({
                "id": numbered("niche", k), "kind": n.kind, "wall": n.surface.name(),
                "min": list(n.min, 6), "max": list(n.max, 6),
                "u0": round(a.x, 6), "u1": round(b.x, 6), "y0": round(a.y, 6), "y1": round(b.y, 6),
                "depth": round(depth(n.surface, n.min, n.max), 6),
            })
        })
        .collect();
    let outline = outlines(room, &[[0.0, e.width]]);
    let floor = outline.first().cloned().unwrap_or_default();
    json!({
        "polygon": polygon(&floor),
        "ceiling": ceiling(room),
        "blocks": blocks,
        "niches": niches,
        "walls": walls(room, &floor, openings),
        "note": "x, z in the room frame; outlines run counter-clockwise in (x, z), the free space on their left; plane: a x + b y + c z = d, unit normal out of the room; solid = blocks minus niches; u of a wall's openings from a towards b; depth: how far the niche's bottom or the plane the window is set in lies behind the wall's face (the pane 0.096 m more)",
    })
}

/// How deep a niche is.
fn depth(surface: Surface, min: DVec3, max: DVec3) -> f64 {
    (max - min).dot(surface.normal().abs())
}

fn polygon(points: &[DVec2]) -> Value {
    json!(points.iter().map(|p| [round(p.x, 6), round(p.y, 6)]).collect::<Vec<_>>())
}

/// Outlines (x, z) of the floor that no block stands on, in stretches along x: counter-clockwise, without corners on
/// straight edges.
fn outlines(room: &Room, stretches: &[[f64; 2]]) -> Vec<Vec<DVec2>> {
    let e = &room.extents;
    let standing: Vec<_> = room.shape.blocks.iter().filter(|b| b.min.y < EPS).collect();
    let lines = |ends: Vec<f64>, most: f64| {
        let mut at: Vec<f64> = ends.into_iter().map(|v| v.clamp(0.0, most)).chain([0.0, most]).collect();
        at.sort_by(f64::total_cmp);
        at.dedup_by(|a, b| *a - *b < EPS);
        at
    };
    let along = stretches.iter().flatten().copied();
    let xs = lines(standing.iter().flat_map(|b| [b.min.x, b.max.x]).chain(along).collect(), e.width);
    let zs = lines(standing.iter().flat_map(|b| [b.min.z, b.max.z]).collect(), e.depth);
    let free = |i: usize, k: usize| {
        let p = DVec2::new(f64::midpoint(xs[i], xs[i + 1]), f64::midpoint(zs[k], zs[k + 1]));
        let inside = |b: &&&harmony_scene::Block| p.x > b.min.x && p.x < b.max.x && p.y > b.min.z && p.y < b.max.z;
        stretches.iter().any(|s| p.x > s[0] && p.x < s[1]) && standing.iter().find(inside).is_none()
    };
    // Sides of free cells, from corner to corner; those between two free cells go.
    let mut next: BTreeMap<(usize, usize), (usize, usize)> = BTreeMap::new();
    let (nx, nz) = (xs.len() - 1, zs.len() - 1);
    for (i, k) in (0..nx).flat_map(|i| (0..nz).map(move |k| (i, k))).filter(|(i, k)| free(*i, *k)) {
        let sides = [
            (k == 0 || !free(i, k - 1), (i, k), (i + 1, k)),
            (i + 1 == nx || !free(i + 1, k), (i + 1, k), (i + 1, k + 1)),
            (k + 1 == nz || !free(i, k + 1), (i + 1, k + 1), (i, k + 1)),
            (i == 0 || !free(i - 1, k), (i, k + 1), (i, k)),
        ];
        next.extend(sides.into_iter().filter(|s| s.0).map(|(_, a, b)| (a, b)));
    }
    let mut out = Vec::new();
    while let Some((start, _)) = next.first_key_value().map(|(a, b)| (*a, *b)) {
        let (mut corners, mut at) = (Vec::new(), start);
        while let Some(to) = next.remove(&at) {
            corners.push(DVec2::new(xs[at.0], zs[at.1]));
            at = to;
        }
        let n = corners.len();
        let turns = |i: &usize| {
            let (a, b, c) = (corners[(i + n - 1) % n], corners[*i], corners[(i + 1) % n]);
            (b - a).perp_dot(c - b).abs() > EPS * EPS
        };
        out.push((0..n).filter(turns).map(|i| corners[i]).collect());
    }
    out
}

/// The ceiling's parts: under each slope, and what is level.
fn ceiling(room: &Room) -> Vec<Value> {
    let e = &room.extents;
    let part = |outline: Vec<DVec2>, plane: [f64; 4]| json!({ "polygon": polygon(&outline), "plane": plane.map(|v| round(v, 6)) });
    let mut level = [0.0, e.width];
    let mut out = Vec::new();
    for slope in &room.shape.slopes {
        let stretch = if slope.wall == Wall::Left { [0.0, slope.run] } else { [e.width - slope.run, e.width] };
        if slope.wall == Wall::Left {
            level[0] = slope.run;
        } else {
            level[1] = e.width - slope.run;
        }
        out.extend(outlines(room, &[stretch]).into_iter().map(|o| part(o, plane(slope, room))));
    }
    out.extend(outlines(room, &[level]).into_iter().map(|o| part(o, [0.0, 1.0, 0.0, e.height])));
    out
}

/// A slope's plane with its normal out of the room.
fn plane(slope: &Slope, room: &Room) -> [f64; 4] {
    let e = &room.extents;
    let outward = -slope.normal(e);
    let foot = slope.wall.point(e, 0.0, slope.low);
    [outward.x, outward.y, outward.z, outward.dot(foot)]
}

/// The outline's edges with what is in them.
fn walls(room: &Room, floor: &[DVec2], openings: &[GeneratedOpening]) -> Vec<Value> {
    let e = &room.extents;
    (0..floor.len())
        .filter_map(|i| {
            let (a, b) = (floor[i], floor[(i + 1) % floor.len()]);
            // The free space is on the left of an edge, and x, z are counter-clockwise.
            let inward = (b - a).perp().normalize_or_zero();
            let wall = Wall::ALL.into_iter().find(|w| {
                let n = w.normal();
                DVec2::new(n.x, n.z).dot(inward) > 0.999
            })?;
            let lift = |p: DVec2| DVec3::new(p.x, 0.0, p.y);
            let inset = wall.distance(e, lift(a));
            let from = wall.coordinates(lift(a)).x;
            let length = (b - a).length();
            let sign = (wall.coordinates(lift(b)).x - from).signum();
            let along = |u: [f64; 2]| {
                let (p, q) = ((u[0] - from) * sign, (u[1] - from) * sign);
                [p.min(q), p.max(q)]
            };
            let inside = |u: [f64; 2]| u[0] > -EPS && u[1] < length + EPS;
            let entry = |kind: &str, u: [f64; 2], y: [f64; 2], depth: f64| {
                json!({
                    "kind": kind, "u0": round(u[0], 6), "u1": round(u[1], 6),
                    "y0": round(y[0], 6), "y1": round(y[1], 6), "depth": round(depth, 6),
                })
            };
            let niches = room.shape.niches.iter().filter(|n| n.surface == wall.surface()).filter_map(|n| {
                let face = wall.distance(e, n.min).max(wall.distance(e, n.max));
                let (low, high) = (wall.coordinates(n.min), wall.coordinates(n.max));
                let u = along([low.x, high.x]);
                let own = (face - inset).abs() < EPS && inside(u);
                own.then(|| entry(&n.kind, u, [low.y, high.y], depth(n.surface, n.min, n.max)))
            });
            let cut = openings.iter().filter(|o| o.wall == wall).filter_map(|o| {
                let at = o.plane.map_or(0.0, |p| wall.distance(e, wall.normal().abs() * p));
                let recess = room.shape.niches.iter().find(|n| {
                    let (low, high) = (wall.coordinates(n.min), wall.coordinates(n.max));
                    n.surface == wall.surface()
                        && o.u[0] > low.x
                        && o.u[1] < high.x
                        && o.y[0] > low.y
                        && o.y[1] < high.y
                });
                let behind = recess.map_or(0.0, |n| depth(n.surface, n.min, n.max));
                let u = along(o.u);
                let own = (at + behind - inset).abs() < 1e-3 && inside(u);
                own.then(|| entry(kind_of(o), u, o.y, behind))
            });
            let here: Vec<Value> = niches.chain(cut).collect();
            Some(json!({
                "a": [round(a.x, 6), round(a.y, 6)], "b": [round(b.x, 6), round(b.y, 6)],
                "normal": [round(inward.x, 6), round(inward.y, 6)],
                "facing": wall.surface().name(), "openings": here,
            }))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Block, Extents, RoomShape};

    use super::*;
    use crate::generate::form::room_of;

    fn room(shape: RoomShape) -> Room {
        room_of(Extents { width: 5.0, height: 2.6, depth: 4.0 }, shape)
    }

    fn block(min: [f64; 3], max: [f64; 3]) -> Block {
        Block { kind: "corner".into(), min: min.into(), max: max.into() }
    }

    fn area(outline: &[DVec2]) -> f64 {
        (0..outline.len()).map(|i| outline[i].perp_dot(outline[(i + 1) % outline.len()])).sum::<f64>() / 2.0
    }

    #[test]
    fn the_outline_of_an_l_goes_round_its_corner_counter_clockwise() {
        let r = room(RoomShape { blocks: vec![block([3.3, 0.0, 0.0], [5.0, 2.6, 1.9])], ..RoomShape::default() });
        let outline = outlines(&r, &[[0.0, 5.0]]);
        let expected = [[0.0, 0.0], [3.3, 0.0], [3.3, 1.9], [5.0, 1.9], [5.0, 4.0], [0.0, 4.0]].map(DVec2::from);
        assert_eq!(outline, vec![expected.to_vec()]);
        assert!((area(&outline[0]) - r.floor_area()).abs() < 1e-9);
        let facing: Vec<String> =
            walls(&r, &outline[0], &[]).iter().map(|w| w["facing"].as_str().unwrap().to_owned()).collect();
        assert_eq!(facing, ["back", "right", "back", "right", "front", "left"]);
    }

    #[test]
    fn a_ceiling_covers_the_floor_and_its_planes_meet() {
        let slope = |wall| Slope { wall, low: 1.2, run: 1.4 };
        let breast = block([2.0, 0.0, 0.0], [3.2, 2.6, 0.4]);
        let slopes = vec![slope(Wall::Left), slope(Wall::Right)];
        let r = room(RoomShape { blocks: vec![breast], slopes, ..RoomShape::default() });
        let parts = ceiling(&r);
        let read = |v: &Value| -> Vec<DVec2> {
            v.as_array().unwrap().iter().map(|p| DVec2::new(p[0].as_f64().unwrap(), p[1].as_f64().unwrap())).collect()
        };
        let sum: f64 = parts.iter().map(|p| area(&read(&p["polygon"]))).sum();
        assert!((sum - (20.0 - 1.2 * 0.4)).abs() < 1e-9, "{sum}");
        for part in &parts {
            let plane: Vec<f64> = part["plane"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
            for p in read(&part["polygon"]) {
                let height = (plane[3] - plane[0] * p.x - plane[2] * p.y) / plane[1];
                let away = p.x.min(5.0 - p.x).min(1.4);
                assert!((height - (1.2 + 1.4 * away / 1.4)).abs() < 1e-4, "{p}: {height}");
            }
        }
    }
}
