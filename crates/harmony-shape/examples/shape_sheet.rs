//! Builds a few shape trees and draws them into one PNG, to be looked at.
//!
//! `shape_sheet FILE`: each tree from its front right, squares of 5 cm laid by the metric texture coordinates (light ones
//! darker towards larger u, so that the direction shows), with the time its building took.

#![allow(clippy::print_stdout, reason = "a command-line program")]
#![allow(clippy::unwrap_used, reason = "an example ends where something is wrong")]

use std::f64::consts::TAU;
use std::time::Instant;

use glam::{DVec2, DVec3};
use harmony_mesh::Bvh;
use harmony_shape::build::{BuildContext, BuiltShape, lazy_signs};
use harmony_shape::{Kind, Node, NodeId, ShapeTree};
use image::{Rgb, RgbImage};
use rayon::prelude::*;
use serde_json::{Value, json};

/// Width and height of one picture.
const CELL: u32 = 420;
/// Samples a pixel along each side.
const FINE: u32 = 2;

#[derive(Default)]
struct Maker {
    tree: ShapeTree,
}

impl Maker {
    fn new() -> Self {
        let mut m = Self::default();
        for (name, color) in
            [("stone", "#b8b0a4"), ("oak", "#b98a58"), ("velvet", "#7d6a86"), ("steel", "#6f8090"), ("red", "#b0483a")]
        {
            m.tree.materials.push(serde_json::from_value(json!({ "name": name, "color": color })).unwrap());
        }
        m.tree.materials[1].map = serde_json::from_value(json!({ "kind": "wood" })).ok();
        m
    }

    fn add(&mut self, material: u32, kind: Value) -> NodeId {
        let kind: Kind = serde_json::from_value(kind).unwrap();
        let line = self.tree.nodes.len() as u32 + 1;
        self.tree.nodes.push(Node { kind, name: Some(format!("n{line}")), material: Some(material), line });
        NodeId(line - 1)
    }

    fn at(&mut self, child: NodeId, x: f64, y: f64, z: f64) -> NodeId {
        let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [x, y, z]];
        self.tree.nodes.push(Node { kind: Kind::Placed { child, columns }, name: None, material: None, line: 0 });
        NodeId(self.tree.nodes.len() as u32 - 1)
    }

    /// Side by side in rows of four.
    fn rows(mut self, parts: &[NodeId], step: f64) -> ShapeTree {
        let children: Vec<NodeId> = parts
            .iter()
            .enumerate()
            .map(|(k, p)| self.at(*p, (k % 4) as f64 * step, 0.0, (k / 4) as f64 * step))
            .collect();
        self.tree.nodes.push(Node { kind: Kind::Group { children }, name: None, material: None, line: 0 });
        self.tree
    }
}

fn solid(size: [f64; 3], bevel: f64) -> Value {
    json!({ "kind": "box", "size": size, "bevel": bevel, "segments": 4, "taper": [1.0, 1.0], "shear": [0.0, 0.0] })
}

fn cylinder(r: f64, h: f64, top: f64, bevel: f64, sides: u32, wall: f64) -> Value {
    json!({ "kind": "cylinder", "radius": r, "height": h, "top_radius": top, "bevel": bevel, "sides": sides, "wall": wall })
}

fn lathe(profile: &[[f64; 2]], wall: f64, lobes: u32) -> Value {
    json!({ "kind": "lathe", "profile": profile, "smooth_deg": 40.0, "wall": wall, "oval": 1.0, "lobes": lobes, "lobe_depth": 0.15 })
}

fn extrude(outline: &Value, depth: f64, axis: &str, bevel: f64, bend: f64, twist: f64) -> Value {
    json!({ "kind": "extrude", "outline": outline, "depth": depth, "axis": axis, "bevel": bevel, "bend_deg": bend, "twist_deg": twist })
}

fn sweep(points: &[[f64; 3]], closed: bool, section: &Value, rings: [f64; 2], caps: bool) -> Value {
    json!({ "kind": "sweep", "curve": { "points": points, "closed": closed }, "section": section, "taper": 1.0,
        "twist_deg": 0.0, "rings": rings, "round_caps": caps })
}

fn star(n: u32, outer: f64, inner: f64) -> Value {
    let points: Vec<[f64; 2]> = (0..2 * n)
        .map(|k| {
            let r = if k % 2 == 0 { outer } else { inner };
            let a = TAU * f64::from(k) / f64::from(2 * n) + TAU / 4.0;
            [r * a.cos(), 0.2 + r * a.sin()]
        })
        .collect();
    json!({ "points": points })
}

fn circle(r: f64, n: u32) -> Vec<[f64; 2]> {
    (0..n).map(|k| TAU * f64::from(k) / f64::from(n)).map(|a| [r * a.cos(), r * a.sin()]).collect()
}

fn solids() -> ShapeTree {
    let mut m = Maker::new();
    let parts = [
        m.add(0, solid([0.3, 0.3, 0.3], 0.03)),
        m.add(1, json!({ "kind": "box", "size": [0.12, 0.4, 0.12], "bevel": 0.006, "segments": 2, "taper": [0.5, 0.5], "shear": [0.1, 0.0] })),
        m.add(3, cylinder(0.15, 0.3, 0.15, 0.01, 0, 0.0)),
        m.add(3, cylinder(0.16, 0.35, 0.06, 0.006, 6, 0.0)),
        m.add(0, cylinder(0.14, 0.3, 0.16, 0.0, 0, 0.012)),
        m.add(4, json!({ "kind": "sphere", "radii": [0.17, 0.13, 0.15] })),
        m.add(0, lathe(&[[0.0, 0.0], [0.07, 0.0], [0.13, 0.1], [0.14, 0.16], [0.1, 0.24], [0.05, 0.29], [0.06, 0.36]], 0.006, 0)),
        m.add(2, lathe(&[[0.0, 0.0], [0.12, 0.01], [0.16, 0.08], [0.16, 0.16], [0.12, 0.24], [0.0, 0.26]], 0.0, 8)),
    ];
    m.rows(&parts, 0.42)
}

fn pulled() -> ShapeTree {
    let mut m = Maker::new();
    let frame = json!({ "points": [[-0.17, 0.02], [0.17, 0.02], [0.17, 0.38], [-0.17, 0.38]],
        "holes": [[[-0.13, 0.06], [0.13, 0.06], [0.13, 0.34], [-0.13, 0.34]]] });
    let bar = json!({ "points": [[-0.03, 0.0], [0.03, 0.0], [0.03, 0.02], [-0.03, 0.02]] });
    let square = json!({ "points": [[-0.06, -0.06], [0.06, -0.06], [0.06, 0.06], [-0.06, 0.06]] });
    let ring: Vec<[f64; 3]> = circle(0.13, 48).iter().map(|[x, y]| [*x, y + 0.16, 0.0]).collect();
    let path = [[-0.15, 0.02, 0.0], [-0.15, 0.35, 0.0], [0.15, 0.35, 0.0], [0.15, 0.02, 0.0]];
    let hose: Vec<[f64; 3]> =
        (0..40).map(|k| f64::from(k) * 0.2).map(|a| [0.12 * a.cos(), 0.03 + a * 0.045, 0.12 * a.sin()]).collect();
    let section = |y: f64, r: f64, n: u32| json!({ "outline": { "points": circle(r, n) }, "at": [0.0, y, 0.0], "turn_deg": [0.0, 0.0, 0.0] });
    let wave: Vec<[f64; 2]> =
        (0..60).map(|k| f64::from(k) * 0.006).map(|z| [z - 0.18, 0.02 + 0.02 * (z * 90.0).sin()]).collect();
    let parts = [
        m.add(1, extrude(&frame, 0.04, "z", 0.006, 0.0, 0.0)),
        m.add(4, extrude(&star(5, 0.18, 0.08), 0.08, "z", 0.01, 0.0, 0.0)),
        m.add(1, extrude(&bar, 0.4, "x", 0.003, 120.0, 0.0)),
        m.add(3, extrude(&square, 0.4, "y", 0.004, 0.0, 120.0)),
        m.add(3, sweep(&ring, true, &json!({ "round": 0.03 }), [0.0; 2], false)),
        m.add(3, sweep(&path, false, &json!({ "round": 0.02 }), [0.0; 2], true)),
        m.add(2, sweep(&hose, false, &json!({ "round": 0.02 }), [0.02, 0.006], true)),
        m.add(0, json!({ "kind": "loft", "closed": false, "sections": [section(0.0, 0.15, 4), section(0.2, 0.08, 32), section(0.38, 0.14, 6)] })),
        m.add(0, json!({ "kind": "bent_sheet", "profile": wave, "width": 0.35, "thick": 0.006, "smooth": true, "axis": "x" })),
    ];
    m.rows(&parts, 0.42)
}

fn cut() -> ShapeTree {
    let mut m = Maker::new();
    let block = m.add(0, solid([0.34, 0.34, 0.2], 0.01));
    let drill = m.add(4, cylinder(0.1, 0.6, 0.1, 0.0, 0, 0.0));
    let columns = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [0.0, 0.17, -0.3]];
    let drill = m.add(4, json!({ "kind": "placed", "child": drill, "columns": columns }));
    let ball = m.add(4, json!({ "kind": "sphere", "radii": [0.17, 0.17, 0.17] }));
    let half = m.add(0, solid([0.4, 0.2, 0.4], 0.0));
    let half = m.at(half, 0.0, 0.2, 0.0);
    let crate_box = m.add(1, solid([0.34, 0.3, 0.3], 0.006));
    let body = m.add(4, json!({ "kind": "sphere", "radii": [0.14, 0.1, 0.1] }));
    let head = m.add(4, json!({ "kind": "sphere", "radii": [0.07, 0.07, 0.07] }));
    let head = m.at(head, 0.15, 0.14, 0.0);
    let neck =
        m.add(4, sweep(&[[0.08, 0.12, 0.0], [0.15, 0.2, 0.0]], false, &json!({ "round": 0.035 }), [0.0; 2], true));
    let parts = [
        m.add(0, json!({ "kind": "boolean", "op": "cut", "a": block, "b": drill })),
        m.add(4, json!({ "kind": "boolean", "op": "cut", "a": ball, "b": half })),
        m.add(1, json!({ "kind": "shell", "child": crate_box, "wall": 0.015, "open": "front" })),
        m.add(4, json!({ "kind": "blend", "children": [body, head, neck], "radius": 0.06 })),
    ];
    m.rows(&parts, 0.42)
}

fn table() -> ShapeTree {
    let mut m = Maker::new();
    let top = m.add(1, solid([1.2, 0.04, 0.7], 0.004));
    let top = m.at(top, 0.0, 0.7, 0.0);
    let leg = m.add(1, json!({ "kind": "box", "size": [0.06, 0.7, 0.06], "bevel": 0.003, "segments": 2, "taper": [1.0, 1.0], "shear": [0.0, 0.0] }));
    let places: Vec<[[f64; 3]; 4]> = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, z)| [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.55 * x, 0.0, 0.3 * z]])
        .to_vec();
    let legs = m.add(1, json!({ "kind": "copies", "child": leg, "places": places }));
    let book = m.add(3, solid([0.22, 0.035, 0.16], 0.003));
    let books =
        m.add(3, json!({ "kind": "stack", "children": [book, book, book], "gap": 0.0, "jitter": 0.8, "seed": 3 }));
    let on = m.add(3, json!({ "kind": "on", "child": books, "other": top, "u": 0.25, "v": 0.5 }));
    let ball = m.add(4, json!({ "kind": "sphere", "radii": [0.03, 0.03, 0.03] }));
    let balls =
        m.add(4, json!({ "kind": "scatter", "children": [ball], "on": top, "count": 14, "gap": 0.03, "seed": 5 }));
    let can = m.add(0, cylinder(0.1, 0.25, 0.1, 0.004, 0, 0.0));
    let can = m.add(
        0,
        json!({ "kind": "decal", "child": can, "face": "front", "with": 4, "at": [0.5, 0.5], "size": [0.14, 0.1] }),
    );
    let can = m.add(0, json!({ "kind": "on", "child": can, "other": top, "u": 0.75, "v": 0.5 }));
    let all = m.add(0, json!({ "kind": "group", "children": [top, legs, on, balls, can] }));
    m.rows(&[all], 1.0)
}

fn bed() -> ShapeTree {
    let mut m = Maker::new();
    let base = m.add(1, solid([1.6, 0.25, 2.0], 0.015));
    let mattress = m.add(0, json!({ "kind": "cushion", "size": [1.56, 0.24, 1.96], "crown": 0.015, "sag": 0.0, "piping": 0.006, "bevel": 0.03 }));
    let mattress = m.at(mattress, 0.0, 0.25, 0.0);
    let board = m.add(
        2,
        json!({ "kind": "cushion", "size": [1.7, 1.0, 0.11], "crown": 0.02, "sag": 0.0, "piping": 0.0, "bevel": 0.03 }),
    );
    let board = m.add(2, json!({ "kind": "tuft", "child": board, "face": "front", "rows": 4, "cols": 9, "depth": 0.035, "diamond": true, "button": 0.014 }));
    let board = m.at(board, 0.0, 0.1, -1.06);
    let pillow = m.add(0, json!({ "kind": "pillow", "size": [0.65, 0.45, 0.16], "wrinkle": 0.5, "piping": 0.0, "ears": 0.3, "dent": 0.0, "seed": 1 }));
    let left = m.at(pillow, -0.38, 0.5, -0.7);
    let right = m.at(pillow, 0.38, 0.5, -0.7);
    let cloth = m.add(
        4,
        json!({ "kind": "drape", "size": [2.1, 1.2], "over": [base, mattress, left, right], "at": [0.0, 0.35],
        "turn_deg": 0.0, "rumple": 0.4, "thick": 0.015, "fold": 0.0, "stiff": 0.3, "seed": 4 }),
    );
    let fringe = m.add(
        0,
        json!({ "kind": "fringe", "along": { "hem": { "of": cloth, "side": "foot" } }, "fringe": "tassel",
        "length": 0.1, "spacing": 0.08, "jitter": 0.3, "seed": 2 }),
    );
    let all = m.add(0, json!({ "kind": "group", "children": [base, mattress, board, left, right, cloth, fringe] }));
    m.rows(&[all], 1.0)
}

fn templates() -> ShapeTree {
    let mut m = Maker::new();
    let chair =
        m.add(0, json!({ "kind": "template", "template": "armchair", "size": [0.8, 0.9, 0.8], "params": null }));
    let plant = m.add(3, json!({ "kind": "plant", "plant": "rosette", "height": 0.5, "spread": 0.6, "count": 20, "leaf": null, "flower": null, "seed": 3 }));
    m.rows(&[chair, plant], 0.9)
}

fn draw(shape: &BuiltShape, out: &mut RgbImage, left: u32, top: u32) {
    let mesh = &shape.mesh;
    let bvh = Bvh::new(mesh);
    let mut owner = Vec::new();
    for group in &mesh.groups {
        owner.extend(group.triangles.iter().map(|t| (*t, group.material)));
    }
    let b = mesh.bounds().unwrap();
    let (az, el) = (0.6_f64, 0.42_f64);
    let away = DVec3::new(az.sin() * el.cos(), el.sin(), az.cos() * el.cos());
    let right = DVec3::Y.cross(away).normalize();
    let up = away.cross(right);
    let radius = b.size().length() / 2.0;
    let scale = radius * 1.75 / f64::from(CELL);
    let sun = (right * 0.6 + DVec3::Y + away * 0.5).normalize();
    let shade = |x: f64, y: f64| -> DVec3 {
        let half = f64::from(CELL) / 2.0;
        let from = b.centre() + right * ((x - half) * scale) - up * ((y - half) * scale) + away * (radius * 2.0);
        let Some(hit) = bvh.raycast(from, -away, radius * 4.0) else { return DVec3::splat(0.8) };
        let (t, material) = owner[hit.triangle];
        let [p, q, r] = t.map(|i| mesh.positions[i as usize].as_dvec3());
        let area = (q - p).cross(r - p);
        let weight = |a: DVec3, b: DVec3| (a - hit.point).cross(b - hit.point).dot(area) / area.length_squared();
        let w = [weight(q, r), weight(r, p), weight(p, q)];
        let n: DVec3 = (0..3).map(|k| mesh.normals[t[k] as usize].as_dvec3() * w[k]).sum();
        let uv: DVec2 = (0..3).map(|k| mesh.metric_uvs[t[k] as usize].as_dvec2() * w[k]).sum();
        let cell = (uv / 0.05).floor();
        let light = (cell.x + cell.y).rem_euclid(2.0) < 0.5;
        let inside = (uv.x / 0.05).rem_euclid(1.0);
        let tone = if light { 1.1 - 0.35 * inside } else { 0.75 };
        let n = n.normalize_or(DVec3::Y);
        let back = n.dot(away) < -0.05 && !mesh.materials[material].double_sided;
        let n = if n.dot(away) < 0.0 { -n } else { n };
        let start = hit.point + n * (radius * 1e-3);
        let lit = if bvh.any_hit(start, sun, radius * 4.0) { 0.0 } else { n.dot(sun).max(0.0) };
        let color =
            DVec3::from(mesh.materials[material].base_color.map(f64::from).first_chunk::<3>().copied().unwrap());
        // a face seen from behind would be missing in a viewer: magenta
        if back { DVec3::new(1.0, 0.0, 1.0) } else { color * tone * (0.35 + 0.2 * n.y + 0.9 * lit) }
    };
    let rows: Vec<Vec<DVec3>> = (0..CELL)
        .into_par_iter()
        .map(|y| {
            (0..CELL)
                .map(|x| {
                    let sub = |k: u32| (f64::from(k) + 0.5) / f64::from(FINE);
                    let all =
                        (0..FINE * FINE).map(|k| shade(f64::from(x) + sub(k % FINE), f64::from(y) + sub(k / FINE)));
                    all.sum::<DVec3>() / f64::from(FINE * FINE)
                })
                .collect()
        })
        .collect();
    for (y, row) in rows.iter().enumerate() {
        for (x, c) in row.iter().enumerate() {
            let byte = |v: f64| (v.clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0) as u8;
            out.put_pixel(left + x as u32, top + y as u32, Rgb([byte(c.x), byte(c.y), byte(c.z)]));
        }
    }
}

fn main() {
    let file = std::env::args().nth(1).unwrap_or_else(|| "shapes.png".into());
    let trees = [
        ("solids", solids()),
        ("pulled", pulled()),
        ("cut", cut()),
        ("table", table()),
        ("bed", bed()),
        ("templates", templates()),
    ];
    let mut out = RgbImage::new(CELL * 3, CELL * trees.len().div_ceil(3) as u32);
    for (k, (name, tree)) in trees.iter().enumerate() {
        let start = Instant::now();
        match tree.build(&BuildContext::default()) {
            Ok(shape) => {
                let ms = start.elapsed().as_millis();
                println!(
                    "{name}: {} nodes, {} triangles, {} hulls, {ms} ms",
                    tree.nodes.len(),
                    shape.mesh.triangle_count(),
                    shape.convex.len()
                );
                for sign in lazy_signs(&shape, None) {
                    println!("  {sign}");
                }
                draw(&shape, &mut out, CELL * (k as u32 % 3), CELL * (k as u32 / 3));
            }
            Err(e) => println!("{name}: {e}"),
        }
    }
    out.save(&file).unwrap();
}
