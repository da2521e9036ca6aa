//! OBJ files as inventories.

use glam::DVec3;

use super::Unreadable;
use super::inventory::{Inventory, Seen};

/// Vertices and triangles of an OBJ text; only positions.
pub(super) struct Solid {
    pub vertices: Vec<DVec3>,
    pub faces: Vec<[usize; 3]>,
}

/// Reads `v` and `f` lines; calls `named` for each `o` line with its name and the number of faces before it.
pub(super) fn read(text: &str, mut named: impl FnMut(&str, usize)) -> Result<Solid, Unreadable> {
    let mut out = Solid { vertices: Vec::new(), faces: Vec::new() };
    for (n, line) in text.lines().enumerate() {
        let mut words = line.split_ascii_whitespace();
        let fail = || format!("line {}: {}", n + 1, line.chars().take(60).collect::<String>());
        match words.next() {
            Some("o") => named(words.next().unwrap_or(""), out.faces.len()),
            Some("v") => {
                let mut next = || words.next().and_then(|w| w.parse::<f64>().ok()).ok_or_else(fail);
                out.vertices.push(DVec3::new(next()?, next()?, next()?));
            }
            Some("f") => {
                let corners: Vec<usize> = words
                    .map(|w| w.split('/').next().and_then(|i| i.parse::<usize>().ok()?.checked_sub(1)))
                    .collect::<Option<_>>()
                    .ok_or_else(fail)?;
                if corners.len() != 3 || corners.iter().any(|c| *c >= out.vertices.len()) {
                    return Err(fail());
                }
                out.faces.push([corners[0], corners[1], corners[2]]);
            }
            _ => {}
        }
    }
    Ok(out)
}

/// A whole scene.
pub(super) fn scene(bytes: &[u8]) -> Result<Inventory, Unreadable> {
    let text = std::str::from_utf8(bytes).map_err(|e| format!("no text: {e}"))?;
    let mut starts: Vec<(String, usize)> = Vec::new();
    let solid = read(text, |name, faces| starts.push((name.to_owned(), faces)))?;
    let mut out = Inventory::default();
    for (k, (name, from)) in starts.iter().enumerate() {
        let to = starts.get(k + 1).map_or(solid.faces.len(), |s| s.1);
        let mut seen = Seen { triangles: to - from, ..Seen::default() };
        solid.faces[*from..to].iter().flatten().for_each(|i| seen.visual(solid.vertices[*i]));
        out.add(name, seen);
    }
    Ok(out)
}
