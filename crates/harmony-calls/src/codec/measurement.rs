//! What a path tracer measured, as files.

use std::path::Path;

use harmony_io::npz::{NpyEntry, NpzError, npz_bytes, read_npz};
use harmony_roles::LightMeasurement;
use harmony_scene::{ImageSize, ViewTransform};
use serde::{Deserialize, Serialize};

use crate::book::read_json;

/// The arrays: `light_<n>`, `albedo`, `nodes`, `view_<n>`.
pub(super) const FILE: &str = "measured.npz";
/// Most lights and views that are read.
const MOST: usize = 4096;

/// What `answer.json` says about it.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Sheet {
    size: ImageSize,
    lights: Vec<Option<String>>,
    views: Vec<ViewTransform>,
}

#[derive(Deserialize)]
struct AnswerSheet {
    measured: Sheet,
}

pub(super) fn sheet(measured: &LightMeasurement) -> Sheet {
    Sheet {
        size: measured.size,
        lights: measured.lights.iter().map(|(id, _)| id.clone()).collect(),
        views: measured.views.iter().map(|(view, _)| *view).collect(),
    }
}

fn colours(name: &str, values: &[[f32; 3]]) -> NpyEntry {
    NpyEntry::f32(name, &[values.len(), 3], values.iter().flatten().copied())
}

pub(super) fn to_npz(measured: &LightMeasurement) -> Result<Vec<u8>, NpzError> {
    let mut entries = vec![
        colours("albedo", &measured.albedo),
        NpyEntry::f32("nodes", &[measured.nodes.len()], measured.nodes.iter().map(|n| *n as f32)),
    ];
    entries.extend(measured.lights.iter().enumerate().map(|(i, (_, rgb))| colours(&format!("light_{i}"), rgb)));
    entries.extend(measured.views.iter().enumerate().map(|(i, (_, rgb))| colours(&format!("view_{i}"), rgb)));
    npz_bytes(&entries)
}

pub(super) fn read(folder: &Path) -> Result<LightMeasurement, String> {
    let AnswerSheet { measured: sheet } = read_json(&folder.join("answer.json"))?;
    if sheet.lights.len() > MOST || sheet.views.len() > MOST {
        return Err(format!("{} lights and {} views are too many", sheet.lights.len(), sheet.views.len()));
    }
    let mut arrays = read_npz(&folder.join(FILE)).map_err(|error| error.to_string())?;
    let mut take = |name: &str| {
        let array = arrays.remove(name).ok_or_else(|| format!("{FILE} has no {name}"))?;
        Ok::<Vec<f32>, String>(array.values.iter().map(|v| *v as f32).collect())
    };
    let triples = |values: Vec<f32>| values.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect::<Vec<_>>();
    let mut lights = Vec::new();
    for (i, id) in sheet.lights.into_iter().enumerate() {
        lights.push((id, triples(take(&format!("light_{i}"))?)));
    }
    let mut views = Vec::new();
    for (i, view) in sheet.views.into_iter().enumerate() {
        views.push((view, triples(take(&format!("view_{i}"))?)));
    }
    Ok(LightMeasurement {
        size: sheet.size,
        lights,
        albedo: triples(take("albedo")?),
        nodes: take("nodes")?.into_iter().map(|v| v.max(0.0) as u32).collect(),
        views,
    })
}

/// Whether a measurement holds what was asked for.
pub(super) fn check(
    measured: &LightMeasurement,
    size: ImageSize,
    nodes: usize,
    views: &[ViewTransform],
) -> Result<(), String> {
    let pixels = size.pixels();
    let lengths = measured.lights.iter().map(|(_, rgb)| rgb.len());
    if let Some(found) = lengths.chain([measured.albedo.len(), measured.nodes.len()]).find(|n| *n != pixels) {
        return Err(format!("a measured image has {found} pixels, {pixels} are needed"));
    }
    if let Some(node) = measured.nodes.iter().find(|n| **n as usize > nodes) {
        return Err(format!("node {node} of {nodes} was measured"));
    }
    let images = measured.lights.iter().map(|(_, rgb)| rgb).chain([&measured.albedo]);
    let tables = measured.views.iter().map(|(_, rgb)| rgb);
    if images.chain(tables).flatten().flatten().any(|v| !v.is_finite()) {
        return Err("a measured value is not finite".to_owned());
    }
    if measured.views.iter().map(|(view, _)| *view).ne(views.iter().copied()) {
        return Err("other views were sampled than were asked for".to_owned());
    }
    Ok(())
}
