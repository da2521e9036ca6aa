//! Missing decorations, piece by piece: a zoomed crop of the photo beside the piece alone, without the photo's pixels. Paper
//! App. C "Missing-decoration detection".

use std::sync::Arc;

use futures::future::join_all;
use harmony_imaging::sheet::{LabelledBox, draw_boxes, ruled_window};
use harmony_prompts::{MissingQuestion, NamedObject, PresentDecoration};
use harmony_roles::{Detection, Picture};
use harmony_scene::{Level, ObjectId, PixelBox};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{SceneState, is_flat};
use crate::views;

/// Share of the photo that a piece must have for what stands on it to be seen.
const SEEN_SHARE: f64 = 0.005;
/// Pieces that are asked about at most, the largest in the photo first.
const MAX_PIECES: usize = 12;
/// How much of a piece's height above it is shown, and of its width beside it: lamps and plants stand out.
const AROUND: (f64, f64) = (0.8, 0.15);
/// Overlap from which a box shows what was found already.
const SAME: f64 = 0.5;
/// Longest side of the crop, pixels.
const CROP_PX: u32 = 900;
const RED: [u8; 3] = [230, 30, 30];
const BLUE: [u8; 3] = [40, 90, 235];

/// A missing decoration: its box, and what it rests on.
pub type Missing = (Detection, ObjectId);

/// Asks about every piece of furniture that the photo shows well. `found` are the boxes of decorations so far.
///
/// # Errors
/// Fatal role errors only.
pub async fn decorations(
    ctx: &PhaseCtx<'_>,
    state: &Arc<SceneState>,
    found: &[Detection],
) -> Result<Vec<Missing>, PhaseError> {
    if !ctx.settings.asked_looks().missing {
        return Ok(Vec::new());
    }
    let asked: Vec<(usize, String)> = pieces(state)
        .into_iter()
        .map(|i| (i, format!("missing/{}", state.partial.placed[i].item.id)))
        .filter(|(_, name)| ctx.is_looked_at(name))
        .collect();
    if asked.is_empty() {
        return Ok(Vec::new());
    }
    ctx.step(&format!("what is missing on {} pieces of furniture", asked.len()));
    let answers = join_all(asked.into_iter().map(|(i, name)| piece(ctx, state, found, i, name))).await;
    let mut all: Vec<Missing> = Vec::new();
    for answer in answers {
        for missing in answer? {
            let same = |d: &Detection| d.bounds.iou(&missing.0.bounds) >= SAME;
            if !found.iter().any(same) && !all.iter().any(|(d, _)| same(d)) {
                all.push(missing);
            }
        }
    }
    Ok(all)
}

/// Furniture on which things can stand.
fn pieces(state: &SceneState) -> Vec<usize> {
    let smallest = SEEN_SHARE * state.partial.camera.size.pixels() as f64;
    let area = |i: &usize| state.partial.placed[*i].item.mask.count();
    let mut pieces: Vec<usize> = (0..state.partial.placed.len())
        .filter(|i| {
            let item = &state.partial.placed[*i].item;
            item.level == Level::Furniture && !is_flat(&item.label) && area(i) as f64 >= smallest
        })
        .collect();
    pieces.sort_by_key(|i| (std::cmp::Reverse(area(i)), *i));
    pieces.truncate(MAX_PIECES);
    pieces
}

async fn piece(
    ctx: &PhaseCtx<'_>,
    state: &Arc<SceneState>,
    found: &[Detection],
    index: usize,
    name: String,
) -> Result<Vec<Missing>, PhaseError> {
    let placed = &state.partial.placed[index];
    let id = placed.item.id.clone();
    let Some(own) = placed.item.mask.bounds() else { return Ok(Vec::new()) };
    // What was listed for the whole room and lies over the piece is there.
    let over = |d: &&Detection| d.bounds.covered_by(&with_what_stands_on(own)) > SAME;
    let of_photo = |d: &Detection| views::thousandths(state.partial.camera.size, &d.bounds);
    let present = found.iter().filter(over).map(|d| PresentDecoration { label: d.label.clone(), bounds: of_photo(d) });
    let question = MissingQuestion {
        room_type: state.layout.answer.room.room_type.clone(),
        furniture: NamedObject { id: id.to_string(), about: placed.item.label.clone() },
        present: present.collect(),
    };
    let shown = Arc::clone(state);
    let pictures = ctx.computed(move || pictures(&shown, index, own)).await?;
    let answer = ctx.ask(&name, question, pictures).await?;
    let boxed = answer.missing_decorations.into_iter().map(|missing| {
        let label = missing.name.trim().to_lowercase();
        let phrase = if missing.description.is_empty() { label.clone() } else { missing.description };
        let bounds = views::pixels(state.partial.camera.size, missing.bounds);
        (Detection { label, phrase, bounds, score: None, outline: None }, id.clone())
    });
    Ok(boxed.filter(|(d, _)| d.bounds.area() >= 4.0).collect())
}

/// A piece's box with the room above it.
fn with_what_stands_on(own: PixelBox) -> PixelBox {
    let (up, beside) = (AROUND.0 * own.height(), AROUND.1 * own.width());
    PixelBox { x0: own.x0 - beside, y0: own.y0 - up, x1: own.x1 + beside, y1: own.y1 + AROUND.1 * own.height() }
}

/// The photo around the piece, it in red and its neighbours in blue, and the piece alone.
fn pictures(state: &SceneState, index: usize, own: PixelBox) -> Vec<Picture> {
    let window = with_what_stands_on(own).clamped(state.partial.camera.size);
    let boxes: Vec<LabelledBox> = state
        .partial
        .placed
        .iter()
        .enumerate()
        .filter(|(i, p)| *i == index || (p.item.level == Level::Furniture && !is_flat(&p.item.label)))
        .filter_map(|(i, p)| {
            let bounds = p.item.mask.bounds()?;
            let near = i == index || bounds.intersection(&window).area() > 0.0;
            let color = if i == index { RED } else { BLUE };
            near.then(|| LabelledBox { bounds, label: p.item.id.to_string(), color })
        })
        .collect();
    let crop = ruled_window(&draw_boxes(&state.photo, &boxes), window, CROP_PX);
    let mut pictures = vec![Picture { caption: "IMAGE 1: the photo around the piece".into(), image: Arc::new(crop) }];
    if let Some(alone) = views::alone(state, index, window) {
        pictures.push(Picture { caption: "IMAGE 2: the piece alone".into(), image: Arc::new(alone) });
    }
    pictures
}
