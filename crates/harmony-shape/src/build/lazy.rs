//! Signs of a shape made without care.

use glam::DVec3;

use super::BuiltShape;

/// Parts that hover by more than this are named, metres.
const HOVER: f64 = 0.005;
/// Sides that are off by more than this share are named.
const OFF: f64 = 0.1;
/// Most names in one hint.
const NAMED: usize = 4;

/// Hints for a second look: one material only, hovering parts, a size that is off, faces that flicker. Empty when there
/// is nothing to say.
pub fn lazy_signs(shape: &BuiltShape, wanted: Option<DVec3>) -> Vec<String> {
    let mut out = Vec::new();
    if shape.slots.len() == 1 && shape.mesh.triangle_count() > 60 {
        out.push(format!("only one material ({}) is used", shape.slots[0]));
    }
    let hovering: Vec<String> = shape
        .parts
        .iter()
        .filter(|p| p.gap > HOVER)
        .map(|p| format!("{} (line {}) by {:.0} mm", named(&p.name), p.line, p.gap * 1000.0))
        .collect();
    if !hovering.is_empty() {
        out.push(format!("parts that touch nothing: {}", listed(&hovering)));
    }
    if let Some(wanted) = wanted {
        let size = shape.size();
        for (axis, has, want) in [("wide", size.x, wanted.x), ("high", size.y, wanted.y), ("deep", size.z, wanted.z)] {
            if want > 0.0 && (has / want - 1.0).abs() > OFF {
                out.push(format!("it is {has:.2} m {axis}, {want:.2} m were wanted"));
            }
        }
    }
    let flicker: Vec<String> = shape.coplanar.iter().map(|(a, b)| format!("{} and {}", named(a), named(b))).collect();
    if !flicker.is_empty() {
        out.push(format!("faces in one plane, set a hair apart lest they flicker: {}", listed(&flicker)));
    }
    out
}

fn named(name: &str) -> &str {
    if name.is_empty() { "a part without name" } else { name }
}

fn listed(items: &[String]) -> String {
    let shown = items[..items.len().min(NAMED)].join(", ");
    if items.len() > NAMED { format!("{shown} and {} more", items.len() - NAMED) } else { shown }
}
