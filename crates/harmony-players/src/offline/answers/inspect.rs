//! `inspect`: every candidate is kept, with the usual size of its category and what boxes tell about relations.

use harmony_mesh::template_name;
use harmony_prompts::{InspectAnswer, InspectedObject, InspectedSize};
use harmony_scene::{Level, PixelBox, Size};
use serde_json::Value;

/// One candidate of the facts.
struct Candidate {
    id: String,
    label: String,
    bounds: Option<PixelBox>,
    /// Width and height as they appear at the depth where its foot meets the room.
    apparent: Option<[f64; 2]>,
    host: Option<String>,
}

/// Facts: `level`; `candidates` with `id`, `label`, `box`, `estimated_size_m`, `host`; `placed` with `id`, `level`, `box`.
///
/// Nothing tells a fragment from a thing, so all are kept. The size is the category's usual one, scaled so that its
/// height (its width, for flat things) is what appears in the photo, within what is plausible. The order is from far
/// to near: feet higher in the photo come first.
pub fn inspect(facts: &Value) -> InspectAnswer {
    let level = serde_json::from_value::<Level>(facts["level"].clone()).ok();
    let mut candidates: Vec<Candidate> =
        facts["candidates"].as_array().into_iter().flatten().filter_map(read).collect();
    let hosts: Vec<(String, PixelBox)> = facts["placed"]
        .as_array()
        .into_iter()
        .flatten()
        .filter(|placed| placed["level"] == "furniture")
        .filter_map(|placed| Some((placed["id"].as_str()?.to_owned(), bounds(&placed["box"])?)))
        .collect();
    let objects = candidates.iter().map(|candidate| about(candidate, level, &hosts)).collect();
    let foot = |c: &Candidate| c.bounds.map_or(0.0, |b| b.y1);
    candidates.sort_by(|a, b| foot(a).total_cmp(&foot(b)).then(a.id.cmp(&b.id)));
    InspectAnswer {
        objects,
        placement_order: candidates.into_iter().map(|c| c.id).collect(),
        scene_summary: "Nobody looked at the photo: labels, sizes and order are by rule.".to_owned(),
    }
}

fn read(entry: &Value) -> Option<Candidate> {
    let finite = |v: &Value| v.as_f64().filter(|v| v.is_finite() && *v > 0.0);
    let size = &entry["estimated_size_m"];
    Some(Candidate {
        id: entry["id"].as_str()?.to_owned(),
        label: entry["label"].as_str().unwrap_or("object").trim().to_lowercase(),
        bounds: bounds(&entry["box"]),
        apparent: finite(&size["width"]).zip(finite(&size["height"])).map(|(w, h)| [w, h]),
        host: entry["host"].as_str().map(str::to_owned),
    })
}

fn bounds(value: &Value) -> Option<PixelBox> {
    let read = serde_json::from_value::<PixelBox>(value.clone()).ok()?;
    [read.x0, read.y0, read.x1, read.y1].iter().all(|v| v.is_finite()).then_some(read)
}

fn about(candidate: &Candidate, level: Option<Level>, hosts: &[(String, PixelBox)]) -> InspectedObject {
    let kind = if candidate.label.is_empty() { "object" } else { &candidate.label };
    let kind: String = kind.chars().take(80).collect();
    let size = size(&kind, candidate.apparent, level);
    let mut object = InspectedObject::plain(
        &candidate.id,
        &kind,
        InspectedSize { width: size.width, height: size.height, depth: size.depth },
    );
    object.template = template_name(&kind).map(str::to_owned);
    if level == Some(Level::Decoration) {
        object.on_top_of = candidate.host.clone().or_else(|| host_under(candidate.bounds?, hosts));
    }
    object.notes = "by rule; nobody looked at it".into();
    object
}

/// The usual size, scaled to what appears, within the category's plausible range.
fn size(kind: &str, apparent: Option<[f64; 2]>, level: Option<Level>) -> Size {
    let usual = harmony_catalogue::default_size(kind);
    let (low, high) = harmony_catalogue::size_range(kind);
    let unknown = harmony_catalogue::kind(kind).is_none();
    let scaled = match apparent {
        // Of an unknown thing only what appears is known; it is taken to be as deep as it is wide, on a wall flat.
        Some([width, height]) if unknown => {
            let depth = if level == Some(Level::Wall) { 0.05 } else { width.min(1.0) };
            Size { width, height, depth }
        }
        Some([width, height]) => {
            let flat = usual.height < 0.25 * usual.width;
            let factor = if flat { width / usual.width } else { height / usual.height };
            Size::from_vec(usual.as_vec() * factor.clamp(0.4, 2.5))
        }
        None => usual,
    };
    let within = scaled.as_vec().max(low.as_vec()).min(high.as_vec().max(low.as_vec()));
    Size::from_vec(within.clamp(glam::DVec3::splat(0.005), glam::DVec3::splat(10.0)))
}

/// The furniture whose box holds the middle of a decoration's lower edge; of several the one nearest to the viewer.
fn host_under(bounds: PixelBox, hosts: &[(String, PixelBox)]) -> Option<String> {
    let (x, y) = (bounds.centre().x, bounds.y1);
    let holds = |b: &PixelBox| b.x0 <= x && x <= b.x1 && b.y0 <= y && y <= b.y1;
    let under = hosts.iter().filter(|(_, b)| holds(b)).max_by(|a, b| a.1.y1.total_cmp(&b.1.y1));
    under.map(|(id, _)| id.clone())
}
