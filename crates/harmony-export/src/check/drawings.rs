//! Drawings and lists read back.

use std::collections::BTreeMap;

use glam::DVec3;

use super::Unreadable;
use super::inventory::{Inventory, Seen};
use crate::world::World;

/// Rows of CSV (RFC 4180).
fn rows(text: &str) -> Vec<Vec<String>> {
    let mut out = vec![vec![String::new()]];
    let mut quoted = false;
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        let row = out.len() - 1;
        let cell = out[row].len() - 1;
        match c {
            '"' if quoted && chars.peek() == Some(&'"') => {
                chars.next();
                out[row][cell].push('"');
            }
            '"' => quoted = !quoted,
            ',' if !quoted => out[row].push(String::new()),
            '\n' if !quoted => out.push(vec![String::new()]),
            '\r' if !quoted => {}
            c => out[row][cell].push(c),
        }
    }
    out.retain(|r| r.len() > 1);
    out
}

/// The list of furniture; sizes are boxes at the origin.
pub(super) fn list(bytes: &[u8]) -> Result<Inventory, Unreadable> {
    let text = std::str::from_utf8(bytes).map_err(|e| format!("no text: {e}"))?;
    let all = rows(text);
    let head = all.first().ok_or("no header")?;
    let columns: BTreeMap<&str, usize> = head.iter().enumerate().map(|(i, n)| (n.as_str(), i)).collect();
    let mut out = Inventory::default();
    for row in &all[1..] {
        let cell = |name: &str| columns.get(name).and_then(|i| row.get(*i)).ok_or_else(|| format!("no {name}"));
        let number = |name: &str| {
            cell(name)?.parse::<f64>().map_err(|_| format!("{name} of {} is no number", cell("id").map_or("?", |s| s)))
        };
        let size = DVec3::new(number("width_m")?, number("height_m")?, number("depth_m")?);
        let seen = Seen {
            position: Some(DVec3::new(number("x_m")?, number("y_m")?, number("z_m")?)),
            low: DVec3::ZERO,
            high: size,
            ..Seen::default()
        };
        out.add(cell("id")?, seen);
    }
    Ok(out)
}

/// A drawing holds together: XML for SVG; pairs, layers and the room's size for DXF.
pub(super) fn drawing(bytes: &[u8], world: &World, dxf: bool, plan: bool) -> Result<(), Unreadable> {
    let text = std::str::from_utf8(bytes).map_err(|e| format!("no text: {e}"))?;
    if !dxf {
        let doc = roxmltree::Document::parse(text).map_err(|e| format!("no XML: {e}"))?;
        let shapes = doc.descendants().filter(|n| n.has_tag_name("path") || n.has_tag_name("text")).count();
        return if shapes > 0 { Ok(()) } else { Err("there is nothing in it".to_owned()) };
    }
    let lines: Vec<&str> = text.lines().collect();
    let pairs: Vec<(i32, &str)> = lines
        .chunks_exact(2)
        .map(|p| p[0].trim().parse().map(|code| (code, p[1])).map_err(|_| format!("{:?} is no group code", p[0])))
        .collect::<Result<_, _>>()?;
    if pairs.last() != Some(&(0, "EOF")) {
        return Err("the file has no end".to_owned());
    }
    if !plan {
        return Ok(());
    }
    // Walls reach around the room by the thickness that is drawn.
    let (mut layer, mut kind) = ("", "");
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let mut entities = false;
    for (code, value) in pairs {
        match code {
            2 if value == "ENTITIES" => entities = true,
            0 => kind = value,
            8 => layer = value,
            10 | 20 if entities && kind == "VERTEX" && layer.starts_with("WALLS") => {
                let v: f64 = value.parse().map_err(|_| format!("{value:?} is no number"))?;
                let k = usize::from(code == 20);
                low[k] = low[k].min(v);
                high[k] = high[k].max(v);
            }
            _ => {}
        }
    }
    let e = world.scene.room.extents;
    let wall = crate::plan::WALL_M;
    let wanted = [e.width + 2.0 * wall, e.depth + 2.0 * wall];
    for (k, what) in ["wide", "deep"].into_iter().enumerate() {
        let drawn = high[k] - low[k];
        if (drawn - wanted[k]).abs() > 1e-3 || drawn.is_nan() {
            return Err(format!("the room is {drawn:.3} m {what} with its walls instead of {:.3} m", wanted[k]));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quoted_cells_are_read() {
        assert_eq!(rows("a,b\r\n\"x, \"\"y\"\"\",2\r\n"), [vec!["a", "b"], vec!["x, \"y\"", "2"]]);
    }
}
