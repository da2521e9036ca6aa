//! Putting parts together, and what a part is besides its form.

use glam::{DAffine3, DVec3};
use harmony_shape::tree::{JointKind, Kind, LampKind, NodeId};
use starlark::values::Value;

use super::arrays::{place, turn_xyz};
use super::maths::Dice;
use crate::call::{COORDINATE, Call, FACES, Function, LENGTH, LENGTH0, Outcome, SHARE};
use crate::error::Complaint;
use crate::numbers::items;
use crate::thing;

pub(crate) fn functions() -> Vec<Function> {
    vec![
        Function::new("group(name=None, *parts, **named)", group),
        Function::new("stack(items, gap=0, jitter=0, seed=None, ...)", |c| {
            c.make(Kind::Stack {
                children: c.parts("items")?,
                gap: c.number("gap", 0.0, COORDINATE)?,
                jitter: c.number("jitter", 0.0, SHARE)?,
                seed: c.seed()?,
            })
        }),
        Function::new(
            "books(n, on=None, h=(0.18, 0.26), t=(0.015, 0.04), d=0.15, lean=0, palette=None, seed=None, ...)",
            books,
        ),
        Function::new("joint(part, kind=\"hinge\", axis=\"y\", pivot=(0, 0, 0), range=(0, 90), ...)", |c| {
            let kinds = [("hinge", JointKind::Hinge), ("slide", JointKind::Slide), ("ball", JointKind::Ball)];
            c.make(Kind::Joint {
                child: c.part("part")?,
                joint: c.choice("kind", &kinds, Some(JointKind::Hinge))?,
                axis: c.axis_vector("axis", DVec3::Y)?.to_array(),
                pivot: c.vector("pivot", Some(DVec3::ZERO))?.to_array(),
                range: c.list("range", Some([0.0, 90.0]), -3600.0..=3600.0)?,
            })
        }),
        Function::new(
            "light(kind=\"point\", lumens=800, kelvin=2700, radius=0.03, cone=120, at=(0, 0, 0), dir=(0, -1, 0), name=None)",
            |c| {
                let kinds = [("point", LampKind::Point), ("spot", LampKind::Spot), ("area", LampKind::Area)];
                let dir = c.vector("dir", Some(DVec3::NEG_Y))?;
                c.make(Kind::Light {
                    lamp: c.choice("kind", &kinds, Some(LampKind::Point))?,
                    lumens: c.number("lumens", 800.0, 0.0..=200_000.0)?,
                    kelvin: c.number("kelvin", 2700.0, 1000.0..=20_000.0)?,
                    radius: c.number("radius", 0.03, 0.0005..=5.0)?,
                    cone_deg: c.number("cone", 120.0, 1.0..=180.0)?,
                    at: c.vector("at", Some(DVec3::ZERO))?.to_array(),
                    dir: dir.try_normalize().unwrap_or(DVec3::NEG_Y).to_array(),
                })
            },
        ),
        Function::new("surface(name, size, at=(0, 0, 0))", |c| {
            c.make(Kind::Surface {
                size: c.list("size", None, LENGTH)?,
                at: c.vector("at", Some(DVec3::ZERO))?.to_array(),
            })
        }),
        Function::new("template(kind, size=None, **params)", template),
        Function::new("framed(w, h, rail=0.05, depth=0.04, panes=(1, 1), fill=None, bar=None, ...)", framed),
        Function::new("decal(part, face, map, at=(0.5, 0.5), size=None, ...)", decal),
    ]
}

/// A node under a name: its own, or around it when it has another one.
pub(crate) fn named(c: &Call<'_, '_>, id: NodeId, name: &str) -> Result<NodeId, Complaint> {
    let name: String = name.chars().take(60).collect();
    if c.session.name(id, &name) {
        return Ok(id);
    }
    let around = c.add(Kind::Group { children: vec![id] }, None)?;
    c.session.name(around, &name);
    Ok(around)
}

fn group<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let mut children = Vec::new();
    let (positional, pairs) = c.rest();
    // The name may be left out: group(a, b).
    let mut name = None;
    if let Some(value) = c.given("name") {
        match value.unpack_str() {
            Some(text) => name = Some(text),
            None => children.extend(c.some_parts("name", value)?),
        }
    }
    for value in positional {
        children.extend(c.some_parts("parts", value)?);
    }
    let mut material: Option<u32> = None;
    for (key, value) in pairs {
        if value.is_none() {
            continue;
        }
        if key == "mat" {
            material = part_material(c, value)?;
            continue;
        }
        // A list under one name is a group of that name; an empty list is nothing.
        if items(value).is_some_and(<[Value<'_>]>::is_empty) {
            continue;
        }
        let id = c.one_part(&key, value)?;
        let generic = matches!(key.as_str(), "parts" | "items" | "children" | "all");
        children.push(if generic { id } else { named(c, id, &key)? });
    }
    if children.is_empty() {
        return Err(Complaint::new("group() without parts")
            .with_hint("group(\"lamp\", base = base, shade = shade)")
            .into());
    }
    let id = c.add(Kind::Group { children }, material)?;
    if let Some(name) = name {
        c.session.name(id, name);
    }
    c.part_value(id)
}

fn part_material<'v>(c: &Call<'v, '_>, value: Value<'v>) -> Result<Option<u32>, Complaint> {
    match thing::Thing::from_value(value).map(|t| &t.kind) {
        Some(thing::Kind::Material(index)) => Ok(Some(*index)),
        _ => Err(c.refuse("mat", value, "a mat(...)")),
    }
}

/// A row of books along x, standing, spines to +z, from x = 0; each is a cover around a block of pages.
fn books<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let n = c.need_count("n", 1..=400)?;
    let (h, t) = (c.list("h", Some([0.18, 0.26]), LENGTH)?, c.list("t", Some([0.015, 0.04]), LENGTH)?);
    let d = c.number("d", 0.15, LENGTH)?;
    let lean = c.number("lean", 0.0, 0.0..=45.0)?;
    let mut covers = Vec::new();
    match c.given("palette") {
        None => {
            for color in ["#7a2f2b", "#2f4858", "#c7a65a", "#3f5d45", "#d8d0c0", "#5b4a6b"] {
                let spec = super::materials::plain(&format!("book_{}", &color[1..]), color);
                covers.push(c.session.material(spec)?);
            }
        }
        Some(value) => {
            for &item in items(value).ok_or_else(|| c.refuse("palette", value, "a list of colours or mats"))? {
                let index = match super::materials::color(item) {
                    Some(color) => {
                        let name = format!("book_{}", color.trim_start_matches('#'));
                        Some(c.session.material(super::materials::plain(&name, &color))?)
                    }
                    None => part_material(c, item)?,
                };
                covers.extend(index);
            }
        }
    }
    if covers.is_empty() {
        return Err(Complaint::new("books(): the palette is empty").into());
    }
    let paper = c.session.material(super::materials::plain("paper", "#e9e2d2"))?;
    let mut dice = Dice::new(c.seed()?);
    let mut between = |[a, b]: [f64; 2]| a + (b - a) * dice.unit();
    let mut x = 0.0;
    let mut children = Vec::new();
    for i in 0..n {
        let (height, thick) = (between(h), between(t));
        let depth = d * between([0.85, 1.0]);
        let cover = covers[(between([0.0, covers.len() as f64]) as usize).min(covers.len() - 1)];
        let tilt = if lean > 0.0 && i > 0 { between([0.0, lean]) } else { 0.0 };
        let board = 0.0025_f64.min(thick / 4.0);
        let solid =
            |size: [f64; 3], bevel: f64| Kind::Box { size, bevel, segments: 1, taper: [1.0; 2], shear: [0.0; 2] };
        let left = c.add(solid([board, height, depth], 0.0006), Some(cover))?;
        let spine = c.add(solid([thick, height, board], 0.001), Some(cover))?;
        let pages = c.add(solid([thick - 2.0 * board, height - 0.006, depth - 0.006], 0.0), Some(paper))?;
        let put = |id, x: f64, y: f64, z: f64| place(c, id, DAffine3::from_translation(DVec3::new(x, y, z)));
        let parts = vec![
            put(left, board / 2.0 - thick / 2.0, 0.0, 0.0)?,
            put(left, thick / 2.0 - board / 2.0, 0.0, 0.0)?,
            put(spine, 0.0, 0.0, (depth - board) / 2.0)?,
            put(pages, 0.0, 0.003, 0.0)?,
        ];
        let book = c.add(Kind::Group { children: parts }, None)?;
        // Leans to the left about its lower left edge.
        let turn = DAffine3::from_mat3(turn_xyz(DVec3::new(0.0, 0.0, tilt)));
        let corner = DVec3::new(thick / 2.0, 0.0, -depth / 2.0);
        let reach = height * libm::sin(tilt.to_radians());
        let map =
            DAffine3::from_translation(DVec3::new(x + reach, 0.0, 0.0)) * turn * DAffine3::from_translation(corner);
        children.push(place(c, book, map)?);
        x += thick * libm::cos(tilt.to_radians()) + reach + 0.0006;
    }
    let middle = DAffine3::from_translation(DVec3::new(-x / 2.0, 0.0, d / 2.0));
    let all = c.add(Kind::Group { children }, None)?;
    let all = place(c, all, middle)?;
    match c.given("on") {
        None => c.make(Kind::Group { children: vec![all] }),
        Some(_) => c.make(Kind::On { child: all, other: c.part("on")?, u: 0.5, v: 0.5 }),
    }
}

fn template<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let kind =
        c.text("kind")?.ok_or_else(|| Complaint::new("template() needs the name of a kind, such as \"armchair\""))?;
    let size = match (c.given("size"), c.session.inputs.size) {
        (None, Some(size)) => [size.width, size.height, size.depth],
        _ => c.list("size", None, LENGTH)?,
    };
    let (_, named) = c.rest();
    let mut params = serde_json::Map::new();
    for (key, value) in named {
        let json = value.to_json_value().map_err(|_| c.refuse(&key, value, "a number, text, list or None"))?;
        params.insert(key, json);
    }
    let params = serde_json::Value::Object(params);
    if params.to_string().len() > 10_000 {
        return Err(Complaint::limit("template(): its parameters are too long").into());
    }
    c.make(Kind::Template { template: kind.to_owned(), size, params })
}

/// A frame with bars, standing, its middle plane at z = 0: window, door leaf, picture, mirror.
fn framed<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let (w, h) = (c.need_number("w", LENGTH)?, c.need_number("h", LENGTH)?);
    let (rail, depth) = (c.number("rail", 0.05, LENGTH0)?.min(w.min(h) / 2.0), c.number("depth", 0.04, LENGTH)?);
    let panes = c.list::<2>("panes", Some([1.0; 2]), 1.0..=60.0)?.map(|n| n as u32);
    let bar = c.number("bar", rail * 0.5, LENGTH0)?;
    let bevel = (rail.min(depth) * 0.12).min(0.004);
    let fill = c.material("fill")?;
    let solid = |size: [f64; 3]| Kind::Box { size, bevel, segments: 2, taper: [1.0; 2], shear: [0.0; 2] };
    let mut children = Vec::new();
    let mut put = |c: &Call<'v, '_>, kind: Kind, material: Option<u32>, x: f64, y: f64| -> Result<NodeId, Complaint> {
        let id = c.add(kind, material)?;
        let id = place(c, id, DAffine3::from_translation(DVec3::new(x, y, 0.0)))?;
        children.push(id);
        Ok(id)
    };
    if rail > 0.0 {
        for side in [-1.0, 1.0] {
            put(c, solid([rail, h, depth]), None, side * (w - rail) / 2.0, 0.0)?;
        }
        for y in [0.0, h - rail] {
            put(c, solid([(w - 2.0 * rail).max(1e-4), rail, depth]), None, 0.0, y)?;
        }
    }
    let inner = [(w - 2.0 * rail).max(1e-4), (h - 2.0 * rail).max(1e-4)];
    if bar > 0.0 {
        let thin = depth * 0.6;
        for i in 1..panes[0] {
            let x = inner[0] * (f64::from(i) / f64::from(panes[0]) - 0.5);
            put(c, solid([bar, inner[1], thin]), None, x, rail)?;
        }
        for i in 1..panes[1] {
            let y = rail + inner[1] * f64::from(i) / f64::from(panes[1]) - bar / 2.0;
            put(c, solid([inner[0], bar, thin]), None, 0.0, y)?;
        }
    }
    if let Some(fill) = fill {
        let thin = (depth * 0.2).min(0.006);
        let plain =
            Kind::Box { size: [inner[0], inner[1], thin], bevel: 0.0, segments: 1, taper: [1.0; 2], shear: [0.0; 2] };
        let pane = put(c, plain, Some(fill), 0.0, rail)?;
        c.session.name(pane, "fill");
    }
    c.make(Kind::Group { children })
}

fn decal<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let child = c.part("part")?;
    let face = c.choice("face", &FACES, None)?;
    let with =
        c.material("map")?.ok_or_else(|| Complaint::new("decal() needs a map: photo(...), a pattern or a mat"))?;
    let size = match (c.given("size"), c.session.with_material(with, |m| m.photo.as_ref().map(|p| p.size))) {
        (None, Some(size)) => size,
        _ => c.list("size", None, LENGTH)?,
    };
    c.make(Kind::Decal { child, face, with, at: c.list("at", Some([0.5; 2]), SHARE)?, size })
}
