//! `list`: regions that differ from the room's surfaces, named by where they are.

use harmony_imaging::color::lab_from_rgb8;
use harmony_imaging::outline::trace_outline;
use harmony_imaging::regions::{Region, RegionSettings, propose_regions, surface_labels};
use harmony_prompts::{ListAnswer, ListQuestion, ListedInstance, ListedItem};
use harmony_scene::{Camera, Level, Surface};
use image::RgbImage;

/// Least objectness of a region that is taken for a thing.
const MIN_OBJECTNESS: f64 = 0.45;

/// Most things listed for one level.
const MAX_THINGS: usize = 12;

/// Lightness (CIE L*) from which a region on a wall is taken for a window.
const WINDOW_LIGHTNESS: f32 = 85.0;

/// Height of a region relative to its width below which a region on the floor is taken for a rug.
const RUG_FLATNESS: f64 = 0.3;

/// Error of outlines, as a fraction of the photo's longer side.
const OUTLINE_ERROR: f64 = 0.004;

/// Without a camera in the room box no surface is known, and nothing is listed.
///
/// What is flat on the floor is a "rug"; what is on a wall a "window" when it is very bright, else a "picture". Things that
/// stand or hang in the room are not listed: telling what they are, how deep they are and where one ends takes more than
/// colours, and a grey block before the real thing is worse than the thing as paint on wall and floor, where it stays.
pub fn list(question: &ListQuestion, photo: Option<&RgbImage>) -> ListAnswer {
    let (Some(view), Some(photo)) = (&question.view, photo) else { return ListAnswer::default() };
    let (level, camera) = (question.level, Camera::from(&view.camera));
    if matches!(level, Level::Ceiling | Level::Decoration)
        || (camera.size.width, camera.size.height) != photo.dimensions()
    {
        return ListAnswer::default();
    }
    let labels = surface_labels(&camera, &view.extents.into());
    let regions = propose_regions(photo, &labels, &RegionSettings::default());
    let mut answer = ListAnswer::default();
    for region in regions.iter().filter(|r| r.objectness >= MIN_OBJECTNESS).take(3 * MAX_THINGS) {
        let Some(kind) = kind(region, level) else { continue };
        let instance = instance(region, photo.width(), photo.height());
        if instance.bounds[2] - instance.bounds[0] < 1.0 || instance.bounds[3] - instance.bounds[1] < 1.0 {
            continue;
        }
        if answer.items.iter().map(|item| item.instances.len()).sum::<usize>() >= MAX_THINGS {
            break;
        }
        match answer.items.iter_mut().find(|item| item.kind == kind) {
            Some(item) => {
                item.count += 1;
                item.instances.push(instance);
            }
            None => answer.items.push(ListedItem {
                kind: kind.to_owned(),
                gdino: kind.to_owned(),
                count: 1,
                instances: vec![instance],
            }),
        }
    }
    if !question.with_boxes {
        answer.items.iter_mut().for_each(|item| item.instances.clear());
    }
    answer
}

/// What a region is taken for on a level; `None` = it belongs to another one.
fn kind(region: &Region, level: Level) -> Option<&'static str> {
    let on = match region.surface {
        Some(Surface::Ceiling) => Level::Ceiling,
        Some(Surface::Floor) => Level::Furniture,
        _ if region.touches_floor_boundary || region.on_floor > 0.25 => Level::Furniture,
        _ => Level::Wall,
    };
    if on != level {
        return None;
    }
    Some(match level {
        Level::Ceiling | Level::Decoration => return None,
        Level::Furniture => {
            let flat = region.bounds.height() < RUG_FLATNESS * region.bounds.width();
            if flat && region.on_floor > 0.8 {
                "rug"
            } else {
                return None;
            }
        }
        Level::Wall => {
            if lab_from_rgb8(region.color)[0] >= WINDOW_LIGHTNESS {
                "window"
            } else {
                "picture"
            }
        }
    })
}

/// Box and outline in thousandths.
fn instance(region: &Region, width: u32, height: u32) -> ListedInstance {
    let (kx, ky) = (1000.0 / f64::from(width), 1000.0 / f64::from(height));
    let round = |v: f64| (v * 10.0).round() / 10.0;
    let b = region.bounds;
    let mut tolerance = f64::from(width.max(height)) * OUTLINE_ERROR;
    let mut outline = trace_outline(&region.mask, tolerance);
    while outline.len() > 150 {
        tolerance *= 1.5;
        outline = trace_outline(&region.mask, tolerance);
    }
    if outline.len() < 3 {
        outline.clear();
    }
    ListedInstance {
        bounds: [b.x0 * kx, b.y0 * ky, b.x1 * kx, b.y1 * ky].map(round),
        outline: outline.into_iter().map(|[x, y]| [round(x * kx), round(y * ky)]).collect(),
        pieces: Vec::new(),
        host: None,
    }
}
