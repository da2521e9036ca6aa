//! Levels of detail: each object's node names coarser nodes (MSFT_lod), which stand outside the scene.

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_mesh::Mesh;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::container::Parts;
use crate::budget::reduced;
use crate::world::Item;

/// Shares of the triangles that coarser forms have.
const SHARES: [f64; 2] = [0.35, 0.1];
/// Share of the screen's height down to which a form is drawn: the full one, the coarser ones, and nothing below.
const COVERAGE: [f64; 3] = [0.4, 0.12, 0.01];
/// Objects of fewer triangles have one form.
const SMALL: usize = 400;

/// A coarser form.
pub(super) struct Lod {
    /// Node name: `<id>_lod<n>`.
    pub name: String,
    /// Index into the items.
    pub item: usize,
    /// The mesh.
    pub mesh: Arc<Mesh>,
}

/// Coarser forms of all objects that have enough triangles and no parts that open; equal meshes share them.
pub(super) fn coarser(items: &[&Item]) -> Vec<Lod> {
    let meshes: BTreeMap<usize, &Arc<Mesh>> = items
        .iter()
        .filter(|i| i.mesh.triangle_count() >= SMALL && i.opens.is_empty())
        .map(|i| (Arc::as_ptr(&i.mesh) as usize, &i.mesh))
        .collect();
    let made: BTreeMap<usize, Vec<Arc<Mesh>>> = meshes
        .into_par_iter()
        .map(|(k, mesh)| (k, SHARES.iter().map(|s| Arc::new(reduced(mesh, *s))).collect()))
        .collect();
    let mut out = Vec::new();
    for (item, of) in items.iter().enumerate().filter(|(_, i)| i.opens.is_empty()) {
        for (n, mesh) in made.get(&(Arc::as_ptr(&of.mesh) as usize)).into_iter().flatten().enumerate() {
            out.push(Lod { name: format!("{}_lod{}", of.name(), n + 1), item, mesh: Arc::clone(mesh) });
        }
    }
    out
}

/// Takes the coarser nodes out of the scene and names them in their objects.
pub(super) fn link(parts: &mut Parts, lods: &[Lod], items: &[&Item]) {
    if lods.is_empty() {
        return;
    }
    let places: BTreeMap<String, usize> = parts.doc["nodes"]
        .as_array()
        .into_iter()
        .flatten()
        .enumerate()
        .filter_map(|(i, n)| Some((n["name"].as_str()?.to_owned(), i)))
        .collect();
    let mut by_item: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for lod in lods {
        if let Some(place) = places.get(&lod.name) {
            by_item.entry(lod.item).or_default().push(*place);
        }
    }
    let coarse: Vec<usize> = by_item.values().flatten().copied().collect();
    if let Some(roots) = parts.doc.pointer_mut("/scenes/0/nodes").and_then(Value::as_array_mut) {
        roots.retain(|n| n.as_u64().is_none_or(|n| !coarse.contains(&(n as usize))));
    }
    for (item, ids) in by_item {
        let Some(place) = places.get(items[item].name()) else { continue };
        let node = &mut parts.doc["nodes"][*place];
        node["extensions"]["MSFT_lod"] = json!({ "ids": ids });
        node["extras"]["MSFT_screencoverage"] = json!(COVERAGE[..=ids.len()]);
    }
    parts.uses("MSFT_lod", false);
}
