//! Parts that open as child nodes of their object, each with its origin on its axis.
//!
//! `extras.joint` of a child says how it moves: `of` (the object), `kind` (`hinge`, `slide`), `axis` (unit vector in the
//! node's frame), `range` (radians, or metres in the room), `state` (0 = closed). Turning the node about its axis, or moving
//! it along, opens it.

use std::sync::Arc;

use glam::DVec3;
use harmony_io::{GlbNode, NodeTransform};
use serde_json::{Value, json};

use super::container::Parts;
use crate::world::{Item, Jointed, Select};

/// Nodes of an object's parts. They stand beside it until [`link`] makes them its children.
pub(super) fn nodes(item: &Item) -> Vec<GlbNode> {
    item.opens
        .iter()
        .enumerate()
        .map(|(k, part)| {
            let (kind, axis, pivot) = match part.joint {
                Jointed::Hinge { axis, pivot } => ("hinge", axis, pivot),
                Jointed::Slide { axis } => ("slide", axis, (part.low + part.high) / 2.0),
            };
            // Children are in their parent's frame, before its scale.
            let origin = pivot / item.scale();
            let mut mesh = item.selected(Select::Part(k));
            for p in &mut mesh.positions {
                *p -= origin.as_vec3();
            }
            GlbNode {
                name: part.name.clone(),
                mesh: Arc::new(mesh),
                transform: NodeTransform { translation: origin, yaw: 0.0, scale: DVec3::ONE },
                extras: json!({ "joint": {
                    "of": item.name(), "kind": kind, "axis": axis.to_array(), "range": part.range, "state": 0.0,
                } }),
            }
        })
        .collect()
}

/// Moves the parts' nodes from the scene to their objects.
pub(super) fn link(parts: &mut Parts, items: &[&Item]) {
    for item in items.iter().filter(|i| !i.opens.is_empty()) {
        let place = |name: &str| {
            parts.doc["nodes"].as_array().into_iter().flatten().position(|n| n["name"].as_str() == Some(name))
        };
        let Some(parent) = place(item.name()) else { continue };
        let children: Vec<usize> = item.opens.iter().filter_map(|o| place(&o.name)).collect();
        if let Some(roots) = parts.doc.pointer_mut("/scenes/0/nodes").and_then(Value::as_array_mut) {
            roots.retain(|n| n.as_u64().is_none_or(|n| !children.contains(&(n as usize))));
        }
        parts.doc["nodes"][parent]["children"] = json!(children);
    }
}
