//! MJCF and URDF files as inventories.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DQuat, DVec3};
use harmony_io::read_bounded;
use roxmltree::{Document, Node};

use super::Unreadable;
use super::inventory::{Inventory, Seen, from_z_up};
use super::obj::{self, Solid};

/// Largest mesh file, bytes.
const MAX_MESH: u64 = 512 << 20;

fn document(bytes: &[u8]) -> Result<Document<'_>, Unreadable> {
    let text = std::str::from_utf8(bytes).map_err(|e| format!("no text: {e}"))?;
    Document::parse(text).map_err(|e| format!("no XML: {e}"))
}

fn numbers(node: Node<'_, '_>, name: &str) -> Result<Option<Vec<f64>>, Unreadable> {
    let Some(text) = node.attribute(name) else { return Ok(None) };
    let all: Option<Vec<f64>> = text.split_ascii_whitespace().map(|w| w.parse().ok()).collect();
    all.map(Some).ok_or_else(|| format!("{name} of {} is no list of numbers", node.attribute("name").unwrap_or("?")))
}

fn vector(node: Node<'_, '_>, name: &str) -> Result<DVec3, Unreadable> {
    match numbers(node, name)? {
        None => Ok(DVec3::ZERO),
        Some(v) if v.len() == 3 => Ok(DVec3::from_slice(&v)),
        Some(_) => Err(format!("{name} has not three numbers")),
    }
}

fn mesh_file(folder: &Path, name: &str) -> Result<Solid, Unreadable> {
    if name.contains(['/', '\\']) || name.contains("..") {
        return Err(format!("mesh {name} lies outside its folder"));
    }
    let bytes = read_bounded(&folder.join(name), MAX_MESH).map_err(|e| e.to_string())?;
    obj::read(&String::from_utf8_lossy(&bytes), |_, _| {}).map_err(|e| format!("mesh {name}: {e}"))
}

/// Bodies of a scene, or of one object.
pub(super) fn scene(bytes: &[u8], assets: &Path) -> Result<Inventory, Unreadable> {
    let doc = document(bytes)?;
    let mut meshes: BTreeMap<&str, Solid> = BTreeMap::new();
    for mesh in doc.descendants().filter(|n| n.has_tag_name("mesh")) {
        let name = mesh.attribute("name").ok_or("a mesh has no name")?;
        let solid = if let Some(points) = numbers(mesh, "vertex")? {
            Solid { vertices: points.chunks_exact(3).map(DVec3::from_slice).collect(), faces: Vec::new() }
        } else {
            mesh_file(assets, mesh.attribute("file").ok_or_else(|| format!("mesh {name} has no file"))?)?
        };
        meshes.insert(name, solid);
    }
    let mut out = Inventory::default();
    let bodies = || doc.descendants().filter(|n| n.has_tag_name("body"));
    let top = |n: &Node<'_, '_>| !n.ancestors().skip(1).any(|a| a.has_tag_name("body"));
    let alone = bodies().filter(top).count() == 1;
    for body in bodies().filter(top) {
        let name = body.attribute("name").ok_or("a body has no name")?;
        let at = vector(body, "pos")?;
        let turn = match numbers(body, "quat")? {
            Some(q) if q.len() == 4 => DQuat::from_xyzw(q[1], q[2], q[3], q[0]).normalize(),
            _ => DQuat::IDENTITY,
        };
        // A file of one object has its body at the origin, in its own turn.
        let turn = if alone && at == DVec3::ZERO { DQuat::IDENTITY } else { turn };
        let room = |p: DVec3| from_z_up(turn * p + at);
        let mut seen = Seen { position: Some(from_z_up(at)), ..Seen::default() };
        seen.moves = Some(body.children().any(|n| n.has_tag_name("freejoint")));
        // Parts that open are bodies in this one's frame.
        let parts: Vec<Node<'_, '_>> = body.children().filter(|n| n.has_tag_name("body")).collect();
        seen.parts = parts.len();
        let mass = |n: &Node<'_, '_>| -> Option<f64> {
            n.children().find(|c| c.has_tag_name("inertial"))?.attribute("mass")?.parse().ok()
        };
        seen.mass = mass(&body).map(|m| m + parts.iter().filter_map(mass).sum::<f64>());
        for part in &parts {
            let joint = part.children().find(|n| n.has_tag_name("joint"));
            let range = joint.map_or(Ok(None), |j| numbers(j, "range"))?.unwrap_or_default();
            if !(range.len() == 2 && range[0] < range[1]) || vector(*part, "pos")? != DVec3::ZERO {
                return Err(format!(
                    "part {} of {name} has no joint with limits",
                    part.attribute("name").unwrap_or("?")
                ));
            }
        }
        for (geom, own) in
            body.children().map(|n| (n, true)).chain(parts.iter().flat_map(|p| p.children().map(|n| (n, false))))
        {
            if !geom.has_tag_name("geom") {
                continue;
            }
            let mesh = geom
                .attribute("mesh")
                .map(|m| meshes.get(m).ok_or_else(|| format!("{name} names mesh {m}, which is not there")))
                .transpose()?;
            if geom.attribute("class") == Some("visual") {
                let solid = mesh.ok_or_else(|| format!("a visual geom of {name} has no mesh"))?;
                solid.faces.iter().flatten().for_each(|i| seen.visual(room(solid.vertices[*i])));
                seen.triangles += solid.faces.len();
                continue;
            }
            if !own {
                continue;
            }
            if let Some(solid) = mesh {
                solid.vertices.iter().for_each(|v| seen.collider(room(*v)));
            } else {
                for c in corners(vector(geom, "pos")?, vector(geom, "size")?) {
                    seen.collider(room(c));
                }
            }
            seen.hulls += 1;
            seen.friction = numbers(geom, "friction")?.and_then(|f| f.first().copied());
        }
        out.add(name, seen);
    }
    Ok(out)
}

fn corners(centre: DVec3, half: DVec3) -> [DVec3; 8] {
    std::array::from_fn(|i| {
        let sign = |bit: usize| if i & bit == 0 { -1.0 } else { 1.0 };
        centre + half * DVec3::new(sign(1), sign(2), sign(4))
    })
}

/// One object: a link, and links of parts that open on joints with limits.
pub(super) fn urdf(bytes: &[u8], folder: &Path) -> Result<Inventory, Unreadable> {
    let doc = document(bytes)?;
    let mut out = Inventory::default();
    let joints: Vec<Node<'_, '_>> = doc.root_element().children().filter(|n| n.has_tag_name("joint")).collect();
    let of = |joint: &Node<'_, '_>, tag: &str| -> Option<String> {
        Some(joint.children().find(|n| n.has_tag_name(tag))?.attribute("link")?.to_owned())
    };
    let links: Vec<Node<'_, '_>> = doc.root_element().children().filter(|n| n.has_tag_name("link")).collect();
    let named = |link: &Node<'_, '_>| link.attribute("name").map(ToOwned::to_owned).ok_or("a link has no name");
    for link in &links {
        let name = named(link)?;
        if joints.iter().any(|j| of(j, "child").as_deref() == Some(&name)) {
            continue;
        }
        let mut seen = Seen { position: Some(DVec3::ZERO), ..Seen::default() };
        urdf_link(*link, DVec3::ZERO, true, folder, &mut seen)?;
        for joint in joints.iter().filter(|j| of(j, "parent").as_deref() == Some(&name)) {
            let limit = joint.children().find(|n| n.has_tag_name("limit"));
            let bound = |which: &str| limit.and_then(|l| l.attribute(which)?.parse::<f64>().ok());
            let child = of(joint, "child").ok_or("a joint has no child")?;
            if !matches!((bound("lower"), bound("upper")), (Some(low), Some(high)) if low < high) {
                return Err(format!("part {child} of {name} has no joint with limits"));
            }
            let origin = joint.children().find(|n| n.has_tag_name("origin"));
            let at = origin.map_or(Ok(DVec3::ZERO), |o| vector(o, "xyz"))?;
            let part = links.iter().find(|l| l.attribute("name") == Some(&child));
            urdf_link(*part.ok_or_else(|| format!("there is no link {child}"))?, at, false, folder, &mut seen)?;
            seen.parts += 1;
        }
        // URDF does not say whether a thing is fixed to the world: whoever loads it does.
        out.add(&name, seen);
    }
    Ok(out)
}

/// What a link adds to its object; colliders of the object's own link alone are compared.
fn urdf_link(link: Node<'_, '_>, origin: DVec3, own: bool, folder: &Path, seen: &mut Seen) -> Result<(), Unreadable> {
    let name = link.attribute("name").unwrap_or("?");
    let value = |tag: &str| {
        link.descendants().find(|n| n.has_tag_name(tag)).and_then(|n| n.attribute("value")?.parse::<f64>().ok())
    };
    if let Some(mass) = value("mass") {
        seen.mass = Some(seen.mass.unwrap_or(0.0) + mass);
    }
    seen.friction = value("lateral_friction");
    for part in link.children().filter(|n| n.has_tag_name("visual") || n.has_tag_name("collision")) {
        let visual = part.has_tag_name("visual");
        if !visual && !own {
            continue;
        }
        let at = part.children().find(|n| n.has_tag_name("origin")).map_or(Ok(DVec3::ZERO), |o| vector(o, "xyz"))?;
        let at = at + origin;
        let geometry = part.descendants().find(|n| n.has_tag_name("mesh") || n.has_tag_name("box"));
        let geometry = geometry.ok_or_else(|| format!("a part of {name} has no geometry"))?;
        if let Some(file) = geometry.attribute("filename") {
            let solid = mesh_file(folder, file)?;
            if visual {
                solid.faces.iter().flatten().for_each(|i| seen.visual(from_z_up(solid.vertices[*i] + at)));
                seen.triangles += solid.faces.len();
            } else {
                solid.vertices.iter().for_each(|v| seen.collider(from_z_up(*v + at)));
            }
        } else {
            for c in corners(at, vector(geometry, "size")? / 2.0) {
                seen.collider(from_z_up(c));
            }
        }
        seen.hulls += usize::from(!visual);
    }
    Ok(())
}
