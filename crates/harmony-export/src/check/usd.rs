//! USD layers and packages as inventories.

use std::io::{Cursor, Read as _};

use glam::{DAffine3, DMat3, DVec3};

use super::Unreadable;
use super::inventory::{Inventory, Seen, from_z_up};
use super::usda::{self, Prim, Value};

/// Largest layer inside a package, bytes.
const MAX_LAYER: u64 = 1 << 30;
/// Light prims.
const LIGHTS: [&str; 3] = ["SphereLight", "RectLight", "DistantLight"];

/// A package: stored files at multiples of 64 bytes, the layer first.
pub(super) fn package(bytes: &[u8]) -> Result<Inventory, Unreadable> {
    let mut zip = zip::ZipArchive::new(Cursor::new(bytes)).map_err(|e| format!("no zip archive: {e}"))?;
    let mut text = String::new();
    let mut names = Vec::new();
    for i in 0..zip.len() {
        let file = zip.by_index(i).map_err(|e| e.to_string())?;
        if file.compression() != zip::CompressionMethod::Stored {
            return Err(format!("{} is compressed, a package's files are not", file.name()));
        }
        if file.data_start() % 64 != 0 {
            return Err(format!("{} begins at byte {}, no multiple of 64", file.name(), file.data_start()));
        }
        names.push(file.name().to_owned());
        if i == 0 {
            file.take(MAX_LAYER)
                .read_to_string(&mut text)
                .map_err(|e| format!("the first file is no text layer: {e}"))?;
        }
    }
    let inventory = read(&text)?;
    for asset in assets(&text) {
        if !names.iter().any(|n| *n == asset.trim_start_matches("./")) {
            return Err(format!("{asset} is named but not in the package"));
        }
    }
    Ok(inventory)
}

fn assets(text: &str) -> Vec<&str> {
    text.split("= @").skip(1).filter_map(|rest| rest.split('@').next()).collect()
}

/// A layer.
pub(super) fn layer(bytes: &[u8]) -> Result<Inventory, Unreadable> {
    read(std::str::from_utf8(bytes).map_err(|e| format!("no text: {e}"))?)
}

fn read(text: &str) -> Result<Inventory, Unreadable> {
    let layer = usda::read(text)?;
    if layer.metadata.get("upAxis") != Some(&Value::Texts(vec!["Z".to_owned()])) {
        return Err("up is not +Z".to_owned());
    }
    if layer.metadata.get("metersPerUnit") != Some(&Value::Numbers(vec![1.0])) {
        return Err("its unit is not the metre".to_owned());
    }
    let world = layer.child("World").ok_or("there is no /World")?;
    let looks = world.child("Looks");
    let mut out = Inventory::default();
    let mut places = Vec::new();
    lights(world, DAffine3::IDENTITY, &mut places);
    out.lights = Some(places);
    out.camera = world
        .child("camera")
        .and_then(|c| c.numbers("xformOp:transform"))
        .and_then(|m| Some(from_z_up(DVec3::from_slice(m.get(12..15)?))));
    for group in &world.children {
        let room = group.name == "room";
        if !room && group.metadata.get("kind") != Some(&Value::Texts(vec!["group".to_owned()])) {
            continue;
        }
        for prim in &group.children {
            let seen = object(prim, looks)?;
            if room {
                out.faces.insert(prim.name.clone(), seen);
            } else {
                out.add(&prim.name, seen);
            }
        }
    }
    Ok(out)
}

/// Places of the lights at and below a prim, in the room.
fn lights(prim: &Prim, stage_from_parent: DAffine3, out: &mut Vec<DVec3>) {
    let column = |m: &[f64], row: usize| DVec3::from_slice(&m[4 * row..4 * row + 3]);
    let local = match prim.numbers("xformOp:transform") {
        Some(m) if m.len() == 16 => DAffine3::from_cols(column(m, 0), column(m, 1), column(m, 2), column(m, 3)),
        _ => DAffine3::from_mat3_translation(turn(prim), place(prim)),
    };
    let stage_from_prim = stage_from_parent * local;
    if LIGHTS.contains(&prim.kind.as_str()) {
        out.push(from_z_up(stage_from_prim.translation));
    }
    for child in &prim.children {
        lights(child, stage_from_prim, out);
    }
}

fn place(prim: &Prim) -> DVec3 {
    prim.numbers("xformOp:translate").filter(|t| t.len() == 3).map_or(DVec3::ZERO, DVec3::from_slice)
}

fn turn(prim: &Prim) -> DMat3 {
    DMat3::from_rotation_z(prim.number("xformOp:rotateZ").unwrap_or(0.0).to_radians())
}

fn object(prim: &Prim, looks: Option<&Prim>) -> Result<Seen, Unreadable> {
    let (at, turn) = (place(prim), turn(prim));
    let mut seen = Seen { position: Some(from_z_up(at)), ..Seen::default() };
    // An object with parts that open has its body and them beside each other.
    let own = prim.child("body").unwrap_or(prim);
    let opening: Vec<&Prim> =
        prim.children.iter().filter(|c| c.name != "body" && c.applies("PhysicsRigidBodyAPI")).collect();
    seen.moves = Some(own.applies("PhysicsRigidBodyAPI"));
    seen.mass =
        own.number("physics:mass").map(|m| m + opening.iter().filter_map(|p| p.number("physics:mass")).sum::<f64>());
    seen.parts = opening.len();
    let joints = prim.children.iter().filter(|c| c.kind.ends_with("Joint"));
    if joints.filter(|j| j.number("physics:lowerLimit") < j.number("physics:upperLimit")).count() != opening.len() {
        return Err(format!("not every part of {} that opens has a joint with limits", prim.name));
    }
    let points = |mesh: &Prim| -> Vec<DVec3> {
        let numbers = mesh.numbers("points").unwrap_or(&[]);
        numbers.chunks_exact(3).map(|p| from_z_up(turn * DVec3::from_slice(p) + at)).collect()
    };
    let drawn = std::iter::once(own).chain(opening.iter().copied()).filter_map(|p| p.child("visual"));
    for mesh in drawn.flat_map(|v| &v.children).filter(|m| m.kind == "Mesh") {
        let all = points(mesh);
        let indices = mesh.numbers("faceVertexIndices").unwrap_or(&[]);
        for i in indices {
            let p = all
                .get(*i as usize)
                .ok_or_else(|| format!("mesh {} of {} points past its points", mesh.name, prim.name))?;
            seen.visual(*p);
        }
        seen.triangles += indices.len() / 3;
        let bound = mesh.text("material:binding").and_then(|p| p.rsplit('/').next());
        let known = bound.is_some_and(|b| looks.is_some_and(|l| l.child(b).is_some()));
        if !known {
            return Err(format!("mesh {} of {} has no material that is there", mesh.name, prim.name));
        }
    }
    for hull in own.child("collision").iter().flat_map(|v| &v.children) {
        if !hull.applies("PhysicsCollisionAPI") || hull.text("physics:approximation") != Some("convexHull") {
            return Err(format!("collider {} of {} is no convex hull", hull.name, prim.name));
        }
        for p in points(hull) {
            seen.collider(p);
        }
        seen.hulls += 1;
        let material = hull.text("material:binding:physics").and_then(|p| p.rsplit('/').next());
        seen.friction = material.and_then(|m| looks?.child(m)?.number("physics:staticFriction"));
    }
    Ok(seen)
}
