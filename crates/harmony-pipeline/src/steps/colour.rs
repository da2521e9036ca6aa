//! Whether an object has the photo's colours: another shape may have the right outline and the wrong cloth.

use std::collections::BTreeMap;

use harmony_imaging::color::{lab_distance, linear_from_rgb8, rgb8_from_linear};
use harmony_scene::{Mask, ObjectId};
use image::RgbImage;

use super::texture;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Look, SceneState};
use crate::views;

/// Cells along the longer side of an object; within one, colours are averaged: a pattern need not lie as in the photo.
const CELLS: u32 = 10;
/// Distance in Lab by which a change may lie farther from the photo's colours: what a model says of a colour is without
/// the photo's light and shade.
const FARTHER: f64 = 8.0;
/// And the factor.
const TIMES: f64 = 1.4;
/// The light on an object, for what is said of it is said for even white light: as a factor on its colours (a dim room,
/// a lamp nearby), and how far a channel's may be from that (the light's hue).
const LIGHT: [f64; 2] = [0.1, 2.0];
const TINT: f64 = 1.25;

/// How far an object's colours are from the photo's within its mask, in the light that brings them nearest: mean distance
/// in Lab (CIE76); `None` when it is not seen. It is painted anew for that, without the photo's light on it.
///
/// # Errors
/// Computations that broke.
pub async fn distance(ctx: &PhaseCtx<'_>, state: &SceneState, id: &ObjectId) -> Result<Option<f64>, PhaseError> {
    let mut shown = state.clone();
    if state.objects.get(id).is_none_or(|object| object.look.textured.is_none()) {
        texture::only(ctx, &mut shown, vec![id.clone()]).await?;
    } else if let Some(object) = shown.objects.get_mut(id) {
        object.look = Look { lit: None, ..object.look.clone() };
    }
    let Some(mask) = state.partial.find(id).map(|placed| placed.item.mask.clone()) else { return Ok(None) };
    ctx.computed(move || apart(&views::drawn(&shown).flat, &shown.photo, &mask)).await
}

/// Whether a change of colours from one distance to another is too much; why.
pub fn against(before: Option<f64>, after: Option<f64>) -> Option<String> {
    let (before, after) = (before?, after?);
    (after > before + FARTHER && after > before * TIMES).then(|| {
        format!(
            "its colours would lie farther from the photo's (distance {before:.0} -> {after:.0}, 2 is just visible): say \
             other colours, or take the cloth from the photo (`photo`, `paint=True`)"
        )
    })
}

/// Mean over a mask's pixels of the distance between the cells' mean colours.
fn apart(shown: &RgbImage, photo: &RgbImage, mask: &Mask) -> Option<f64> {
    let bounds = mask.bounds()?;
    let side = ((bounds.x1 - bounds.x0).max(bounds.y1 - bounds.y0) as u32).div_ceil(CELLS).max(1);
    let mut cells: BTreeMap<[u32; 2], ([[f64; 3]; 2], f64)> = BTreeMap::new();
    for ((x, y, shown), (photo, _)) in
        shown.enumerate_pixels().zip(photo.pixels().zip(mask.bits())).filter(|(_, (_, own))| **own)
    {
        let (sums, count) = cells.entry([x / side, y / side]).or_default();
        for (sum, pixel) in sums.iter_mut().zip([shown, photo]) {
            sum.iter_mut().zip(linear_from_rgb8(pixel.0)).for_each(|(s, v)| *s += f64::from(v));
        }
        *count += 1.0;
    }
    let light = light(&cells.values().map(|(sums, _)| *sums).collect::<Vec<_>>());
    let all: f64 = cells.values().map(|(_, count)| count).sum();
    let sum = cells.values().map(|([shown, photo], count)| {
        let shown: [f64; 3] = std::array::from_fn(|c| (shown[c] * light[c]).min(*count));
        let [a, b] = [shown, *photo].map(|sum| rgb8_from_linear(sum.map(|s| (s / count) as f32)));
        lab_distance(a, b) * count
    });
    (all > 0.0).then(|| sum.sum::<f64>() / all)
}

/// Per channel, the factor that brings cells' sums as shown to those of the photo, within what light can be: the middle
/// one of the cells'.
fn light(cells: &[[[f64; 3]; 2]]) -> [f64; 3] {
    let channels: [f64; 3] = std::array::from_fn(|c| {
        let told = cells.iter().filter(|[shown, photo]| shown[c] > 0.0 && photo[c] > 0.0);
        let mut ratios: Vec<f64> = told.map(|[shown, photo]| (photo[c] / shown[c]).ln()).collect();
        let middle = ratios.len() / 2;
        if ratios.is_empty() { 0.0 } else { *ratios.select_nth_unstable_by(middle, f64::total_cmp).1 }
    });
    let mean = channels.iter().sum::<f64>() / 3.0;
    let brightness = mean.clamp(LIGHT[0].ln(), LIGHT[1].ln());
    channels.map(|channel| (brightness + (channel - mean).clamp(-TINT.ln(), TINT.ln())).exp())
}

#[cfg(test)]
mod tests {
    use harmony_scene::ImageSize;

    use super::*;

    #[test]
    fn a_pattern_that_lies_elsewhere_has_the_same_colours_and_another_cloth_has_not() {
        let size = ImageSize::new(100, 100);
        let checks = |shift: u32, rgb: [u8; 3]| {
            RgbImage::from_fn(100, 100, move |x, y| {
                image::Rgb(if ((x + shift) / 5 + y / 5).is_multiple_of(2) { rgb } else { [200, 190, 170] })
            })
        };
        let mask = Mask::from_fn(size, |x, y| (10..90).contains(&x) && (20..80).contains(&y));
        let photo = checks(0, [150, 40, 30]);
        let same = apart(&checks(5, [150, 40, 30]), &photo, &mask);
        let blue = apart(&checks(0, [70, 110, 240]), &photo, &mask);
        assert!(same < Some(FARTHER / 2.0) && blue > Some(20.0), "{same:?} {blue:?}");
        assert!(against(same, blue).is_some() && against(blue, same).is_none());
        // What the photo was like before does not have to be met better.
        assert!(against(Some(12.0), Some(16.0)).is_none() && against(None, blue).is_none());
        assert_eq!(apart(&photo, &photo, &Mask::empty(size)), None);
        // The same cloth in a dim and rather yellow light, which is what it is said to be without.
        let dim = RgbImage::from_fn(100, 100, |x, y| {
            let [r, g, b] = linear_from_rgb8(photo.get_pixel(x, y).0);
            image::Rgb(rgb8_from_linear([0.14 * r, 0.13 * g, 0.105 * b]))
        });
        let (lit, other) = (apart(&photo, &dim, &mask), apart(&checks(0, [70, 110, 240]), &dim, &mask));
        assert!(lit < Some(2.0) && against(lit, other).is_some(), "{lit:?} {other:?}");
    }
}
