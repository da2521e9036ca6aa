//! Exemplar fill as an image editor.

use async_trait::async_trait;
use harmony_imaging::inpaint::{FillSettings, Sources, fill};
use harmony_roles::{EditKind, EditRequest, EditedImage, ImageEditor, PlayerCard, RoleError, Usage};
use harmony_scene::{ImageSize, Mask};
use image::{RgbImage, Rgba, RgbaImage};

/// Plain grey behind a cut-out object.
const PLAIN: [u8; 3] = [128, 128, 128];

/// Share of a mask that may fall on known background when it is mirrored, for the mirror image to be believed.
const MAX_CONFLICT: f64 = 0.12;

/// Share of the object's box, around its middle, in which the axis of symmetry is looked for.
const AXIS_RANGE: f64 = 0.5;

/// Number of axes tried.
const AXES: usize = 41;

/// Fills with what is around.
///
/// * An empty room: what is marked is filled from the rest of the photo. Without a mask there is nothing to go by.
/// * A partly hidden object: holes in it are closed and, where its mirror image lies on pixels that may change, that is
///   taken; colours come from the mirrored pixel where the object shows it, else from exemplars of the object. What
///   neither tells is left out: nothing is invented.
#[derive(Debug, Clone, Copy)]
pub struct ExemplarEditor;

#[async_trait]
impl ImageEditor for ExemplarEditor {
    fn card(&self) -> PlayerCard {
        super::card("exemplar fill 1")
    }

    fn draws(&self) -> bool {
        false
    }

    async fn edit(&self, request: &EditRequest) -> Result<EditedImage, RoleError> {
        let request = request.clone();
        let image = super::computed(move || match request.kind {
            EditKind::EmptyRoom => empty_room(&request),
            EditKind::Amodal => amodal(&request),
            EditKind::Surface => Err(super::not_capable("faces are completed by whoever asks")),
        })
        .await??;
        Ok(EditedImage { image, usage: Usage::default() })
    }
}

fn empty_room(request: &EditRequest) -> Result<RgbaImage, RoleError> {
    let Some(mask) = request.mask.as_deref() else {
        return Err(super::not_capable("without a mask it can't tell furniture from room"));
    };
    let mask = mask.resized(size_of(&request.image));
    let filled = fill(&request.image, &mask, Sources::Anywhere, &FillSettings::default());
    Ok(opaque(&filled, |_, _| true))
}

fn amodal(request: &EditRequest) -> Result<RgbaImage, RoleError> {
    let size = size_of(&request.image);
    let Some(object) = request.object.as_deref().map(|mask| mask.resized(size)) else {
        return Err(super::not_capable("without the object's mask it can't tell what to complete"));
    };
    if object.count() == 0 {
        return Err(super::not_capable("nothing of the object is seen"));
    }
    let may_change = request.mask.as_deref().map(|mask| mask.resized(size).minus(&object));
    let axis = symmetry_axis(&object, may_change.as_ref());
    let mirrored = axis.map(|axis| Mask::from_fn(size, |x, y| object.get(mirror(x, axis), i64::from(y))));
    let mut complete = closed(&object);
    if let (Some(mirrored), Some(may_change)) = (&mirrored, &may_change) {
        complete = complete.or(&mirrored.and(may_change));
    }
    let mut picture = (*request.image).clone();
    let mut unknown = complete.minus(&object);
    if let Some(axis) = axis {
        for y in 0..size.height {
            for x in 0..size.width {
                let from = mirror(x, axis);
                if unknown.get(i64::from(x), i64::from(y)) && object.get(from, i64::from(y)) {
                    picture.put_pixel(x, y, *request.image.get_pixel(from as u32, y));
                    unknown.set(x, y, false);
                }
            }
        }
    }
    if unknown.count() > 0 {
        picture = fill(&picture, &unknown, Sources::Masked(&object), &FillSettings::default());
    }
    Ok(opaque(&picture, |x, y| complete.get(i64::from(x), i64::from(y))))
}

/// The pixels that belong to the result, on plain grey.
fn opaque(picture: &RgbImage, belongs: impl Fn(u32, u32) -> bool) -> RgbaImage {
    RgbaImage::from_fn(picture.width(), picture.height(), |x, y| {
        let ([r, g, b], alpha) = if belongs(x, y) { (picture.get_pixel(x, y).0, 255) } else { (PLAIN, 0) };
        Rgba([r, g, b, alpha])
    })
}

fn size_of(image: &RgbImage) -> ImageSize {
    ImageSize::new(image.width(), image.height())
}

/// Column of the mirror image; `axis` is twice the column of the axis, so that it may lie between two pixels.
fn mirror(x: u32, axis: i64) -> i64 {
    axis - i64::from(x)
}

/// Twice the column of the vertical axis about which the object agrees best with its mirror image, when little of the
/// mirror image falls on pixels that are known not to be the object.
fn symmetry_axis(object: &Mask, may_change: Option<&Mask>) -> Option<i64> {
    let bounds = object.bounds()?;
    let count = object.count() as f64;
    let mut best: Option<(f64, i64)> = None;
    for k in 0..AXES {
        let t = 0.5 + AXIS_RANGE * (k as f64 / (AXES - 1) as f64 - 0.5);
        let axis = (2.0 * (bounds.x0 + t * bounds.width())).round() as i64 - 1;
        let (mut agree, mut conflict) = (0.0, 0.0);
        for (i, on) in object.bits().iter().enumerate() {
            if !on {
                continue;
            }
            let (x, y) = (i as u32 % object.size().width, i64::from(i as u32 / object.size().width));
            let to = mirror(x, axis);
            let outside = to < 0 || to >= i64::from(object.size().width);
            if object.get(to, y) {
                agree += 1.0;
            } else if !outside && !may_change.is_some_and(|mask| mask.get(to, y)) {
                conflict += 1.0;
            }
        }
        let better = best.is_none_or(|(score, _)| agree - 2.0 * conflict > score);
        if conflict / count <= MAX_CONFLICT && better {
            best = Some((agree - 2.0 * conflict, axis));
        }
    }
    best.map(|(_, axis)| axis)
}

/// The mask with the holes closed that it encloses altogether.
fn closed(object: &Mask) -> Mask {
    let size = object.size();
    let (w, h) = (size.width as usize, size.height as usize);
    let mut outside = vec![false; w * h];
    let mut open: Vec<usize> = Vec::new();
    let border = (0..w).flat_map(|x| [x, (h - 1) * w + x]).chain((0..h).flat_map(|y| [y * w, y * w + w - 1]));
    for i in border {
        if !object.bits()[i] && !outside[i] {
            outside[i] = true;
            open.push(i);
        }
    }
    while let Some(i) = open.pop() {
        let (x, y) = (i % w, i / w);
        let near =
            [(x > 0).then(|| i - 1), (x + 1 < w).then(|| i + 1), (y > 0).then(|| i - w), (y + 1 < h).then(|| i + w)];
        for j in near.into_iter().flatten() {
            if !object.bits()[j] && !outside[j] {
                outside[j] = true;
                open.push(j);
            }
        }
    }
    Mask::from_fn(size, |x, y| !outside[y as usize * w + x as usize])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn enclosed_holes_are_closed_and_bays_are_not() {
        let size = ImageSize::new(12, 8);
        let ring = Mask::from_fn(size, |x, y| {
            let inside = (2..9).contains(&x) && (1..7).contains(&y);
            let hole = (4..6).contains(&x) && (3..5).contains(&y);
            let bay = x >= 7 && y == 3;
            inside && !hole && !bay
        });
        let whole = closed(&ring);
        assert!(whole.get(4, 3) && whole.get(5, 4));
        assert!(!whole.get(8, 3) && !whole.get(0, 0));
        assert_eq!(whole.count(), ring.count() + 4);
    }

    #[test]
    fn the_axis_of_a_half_hidden_shape_is_found_only_if_the_rest_may_be_hidden() {
        let size = ImageSize::new(40, 20);
        // A lamp: shade 10..30, post 18..22; everything right of 24 is behind something.
        let whole = Mask::from_fn(size, |x, y| if y < 8 { (10..30).contains(&x) } else { (18..22).contains(&x) });
        let hider = Mask::from_fn(size, |x, _| x >= 24);
        let seen = whole.minus(&hider);
        let axis = symmetry_axis(&seen, Some(&hider)).unwrap();
        assert_eq!(axis, 39, "between columns 19 and 20");
        let mirrored = Mask::from_fn(size, |x, y| seen.get(mirror(x, axis), i64::from(y)));
        assert_eq!(seen.or(&mirrored.and(&hider)), whole);
        assert_ne!(symmetry_axis(&seen, None), Some(39), "nothing says that the rest is hidden");
    }
}
