//! `inspect`: every candidate is kept, with the usual size of its category and what boxes tell about relations.

use harmony_mesh::template_name;
use harmony_prompts::{InspectAnswer, InspectCandidate, InspectQuestion, InspectedObject, InspectedSize};
use harmony_scene::{Level, ObjectId, PixelBox, Size};

/// Nothing tells a fragment from a thing, so all are kept. The size is the category's usual one, scaled so that its
/// height (its width, for flat things) is what appears in the photo, within what is plausible. The order is from far
/// to near: feet higher in the photo come first.
pub fn inspect(question: &InspectQuestion) -> InspectAnswer {
    let furniture = question.placed.iter().filter(|known| known.level() == Level::Furniture);
    let hosts: Vec<(&ObjectId, PixelBox)> = furniture.filter_map(|known| Some((known.id(), known.seen()?))).collect();
    let objects = question.candidates.iter().map(|candidate| about(candidate, question.level, &hosts)).collect();
    let mut order: Vec<&InspectCandidate> = question.candidates.iter().collect();
    order.sort_by(|a, b| a.bounds.y1.total_cmp(&b.bounds.y1).then(a.id.cmp(&b.id)));
    InspectAnswer {
        objects,
        placement_order: order.into_iter().map(|c| c.id.to_string()).collect(),
        scene_summary: "Nobody looked at the photo: labels, sizes and order are by rule.".to_owned(),
    }
}

fn about(candidate: &InspectCandidate, level: Level, hosts: &[(&ObjectId, PixelBox)]) -> InspectedObject {
    let label = candidate.label.trim().to_lowercase();
    let kind: String = if label.is_empty() { "object".to_owned() } else { label.chars().take(80).collect() };
    let positive = |v: f64| v.is_finite() && v > 0.0;
    let apparent = candidate.estimated_size_m.filter(|size| positive(size.width) && positive(size.height));
    let size = size(&kind, apparent.map(|size| [size.width, size.height]), level);
    let mut object = InspectedObject::plain(
        candidate.id.as_str(),
        &kind,
        InspectedSize { width: size.width, height: size.height, depth: size.depth },
    );
    object.template = template_name(&kind).map(str::to_owned);
    if level == Level::Decoration {
        let host = candidate.host.as_ref().or_else(|| host_under(candidate.bounds, hosts));
        object.on_top_of = host.map(ToString::to_string);
    }
    object.notes = "by rule; nobody looked at it".into();
    object
}

/// The usual size, scaled to what appears, within the category's plausible range.
fn size(kind: &str, apparent: Option<[f64; 2]>, level: Level) -> Size {
    let usual = harmony_catalogue::default_size(kind);
    let (low, high) = harmony_catalogue::size_range(kind);
    let unknown = harmony_catalogue::kind(kind).is_none();
    let scaled = match apparent {
        // Of an unknown thing only what appears is known; it is taken to be as deep as it is wide, on a wall flat.
        Some([width, height]) if unknown => {
            let depth = if level == Level::Wall { 0.05 } else { width.min(1.0) };
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
fn host_under<'a>(bounds: PixelBox, hosts: &[(&'a ObjectId, PixelBox)]) -> Option<&'a ObjectId> {
    let (x, y) = (bounds.centre().x, bounds.y1);
    let holds = |b: &PixelBox| b.x0 <= x && x <= b.x1 && b.y0 <= y && y <= b.y1;
    let under = hosts.iter().filter(|(_, b)| holds(b)).max_by(|a, b| a.1.y1.total_cmp(&b.1.y1));
    under.map(|(id, _)| *id)
}
