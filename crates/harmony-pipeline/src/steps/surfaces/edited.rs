//! What an image editor draws of the room itself: the photo without its things, and each face as one
//! whole material (key `layout.empty_room`, figure "layout initialization" of the paper).
//!
//! The first is asked for before anything is known of the things, so that every later question sees the room in its
//! textures; the faces are asked for beside the levels. Once the things are found, the photo's own pixels count wherever it shows the bare room, and the editor's
//! elsewhere, in the photo's colours: an editor redraws the whole picture, and a shade of its own.

use std::collections::BTreeMap;
use std::sync::Arc;

use futures::future::join_all;
use harmony_imaging::color::{lab_distance, linear_from_srgb, srgb_from_linear};
use harmony_roles::{EditKind, EditRequest};
use harmony_scene::{Extents, ImageSize, Mask, Surface, WarningKind};
use image::{DynamicImage, Rgb, RgbImage, RgbaImage, imageops};

use super::evidence::Face;
use crate::Phase;
use crate::ctx::{PhaseCtx, PhaseError};

/// Faces that the editor completes: the paper's floor and walls. The ceiling is one paint nearly always.
const COMPLETED: [Surface; 5] = [Surface::Floor, Surface::Back, Surface::Left, Surface::Right, Surface::Front];
/// A face of which a smaller share is known is not asked about, nor one of which a larger share is.
const KNOWN: [f64; 2] = [0.08, 0.97];
/// Longest side of a face that is sent, pixels.
const SENT_PX: u32 = 1024;
/// What is not known of a face is sent as this grey.
const UNKNOWN: Rgb<u8> = Rgb([128; 3]);
/// Side of the squares in which an edited picture is held against the one it was made from, pixels.
const SQUARE: u32 = 8;
/// Squares that differ by no more than this are the same (Lab).
const SAME: f64 = 12.0;
/// Share of the photo's squares that must be the same in its empty room: walls and floor fill most of a photo.
const SAME_ROOM: f64 = 0.25;
/// Share of the known squares of a face that must be the same in the completed one.
const SAME_FACE: f64 = 0.5;
/// Texels of an edited picture beside what is known of a face go over into it within this many, metres.
const FEATHER: f64 = 0.08;
/// An alpha from which a texel is what the photo shows.
const KEPT: u8 = 224;

/// Whole faces, in the frame of their textures.
pub type Faces = BTreeMap<Surface, Arc<RgbImage>>;

/// What the editor has drawn.
#[derive(Debug, Clone, Default)]
pub struct EditedRoom {
    /// The photo without its things.
    pub emptied: Option<Arc<RgbImage>>,
    /// Its faces as whole materials.
    pub faces: Faces,
}

/// Asks for the photo without its things. `None` when no editor draws here, or when it drew another room.
///
/// # Errors
/// Fatal role errors.
pub async fn emptied(ctx: &PhaseCtx<'_>, photo: &Arc<RgbImage>) -> Result<Option<Arc<RgbImage>>, PhaseError> {
    if !ctx.can().draws {
        return Ok(None);
    }
    let request = EditRequest {
        name: ctx.call("empty_room"),
        kind: EditKind::EmptyRoom,
        image: Arc::clone(photo),
        mask: None,
        object: None,
        instruction: "Remove all furniture, wall objects, lamps and decorations. Keep the room itself exactly as it \
                      is: floor, walls, ceiling, corners, doors, windows, light, camera."
            .to_owned(),
    };
    let Some(drawn) = asked(ctx, &request, "the empty room").await? else { return Ok(None) };
    let everywhere = Mask::from_fn(ImageSize::new(photo.width(), photo.height()), |_, _| true);
    let same = same_share(photo, &drawn, &everywhere);
    if same < SAME_ROOM {
        let message = format!(
            "the image editor's empty room is another room ({:.0} % of it is as in the photo): it is not used",
            100.0 * same
        );
        ctx.warn(WarningKind::Fallback, None, message);
        return Ok(None);
    }
    Ok(Some(Arc::new(drawn)))
}

/// Asks for each face as one whole material, all at a time.
///
/// # Errors
/// Fatal role errors.
pub(super) async fn completed(ctx: &PhaseCtx<'_>, faces: &[Face], extents: &Extents) -> Result<Faces, PhaseError> {
    let asked = join_all(faces.iter().filter(|f| COMPLETED.contains(&f.surface)).map(|face| async move {
        let (image, known) = sent(&face.texture);
        let share = known.count() as f64 / known.size().pixels().max(1) as f64;
        if !(KNOWN[0]..=KNOWN[1]).contains(&share) {
            return Ok(None);
        }
        let size = face.surface.size(extents);
        let what = match face.surface.wall() {
            Some(_) => format!("the {} wall", face.surface.name()),
            None => format!("the {}", face.surface.name()),
        };
        let request = EditRequest {
            name: format!("{}/surface_{}", Phase::Layout, face.surface.name()),
            kind: EditKind::Surface,
            image: Arc::new(image.clone()),
            mask: Some(Arc::new(Mask::from_fn(known.size(), |x, y| !known.get(i64::from(x), i64::from(y))))),
            object: None,
            instruction: format!(
                "This is {what} of a room as a flat texture of {:.1} x {:.1} metres, seen straight on without \
                 perspective; plain grey (#808080) is not known. Fill all the grey, so that one coherent, tileable \
                 material covers the picture: the same pattern in the same size, direction and phase, the same colours, \
                 even light. No furniture, no shadows, no new doors or windows.",
                size.x, size.y
            ),
        };
        let Some(drawn) = self::asked(ctx, &request, &what).await? else { return Ok(None) };
        if same_share(&image, &drawn, &known) < SAME_FACE {
            let message = format!("the image editor changed what the photo shows of {what}: its texture is not used");
            ctx.warn(WarningKind::Fallback, None, message);
            return Ok(None);
        }
        Ok::<_, PhaseError>(Some((face.surface, Arc::new(drawn))))
    }))
    .await;
    asked.into_iter().filter_map(Result::transpose).collect()
}

/// An edited picture; `None`, told, when there is none to be had.
async fn asked(ctx: &PhaseCtx<'_>, request: &EditRequest, what: &str) -> Result<Option<RgbImage>, PhaseError> {
    match ctx.calls.edit(request).await {
        Ok(edited) => Ok(Some(DynamicImage::ImageRgba8(edited.image).to_rgb8())),
        Err(error) if error.is_fatal() => Err(error.into()),
        // Nobody stands in: what this program can do itself it does with the photo's bare pixels.
        Err(error) => {
            ctx.warn(WarningKind::Fallback, None, format!("no image editor drew {what}: {error}"));
            Ok(None)
        }
    }
}

/// A face as it is sent, and what is known of it.
fn sent(texture: &RgbaImage) -> (RgbImage, Mask) {
    let longest = texture.width().max(texture.height()).max(1);
    let scale = f64::from(SENT_PX.min(longest)) / f64::from(longest);
    let side = |n: u32| ((f64::from(n) * scale).round() as u32).max(1);
    let (width, height) = (side(texture.width()), side(texture.height()));
    let small = imageops::resize(texture, width, height, imageops::FilterType::Triangle);
    let known = Mask::from_fn(ImageSize::new(width, height), |x, y| small.get_pixel(x, y).0[3] >= KEPT);
    let image = RgbImage::from_fn(width, height, |x, y| {
        let [r, g, b, _] = small.get_pixel(x, y).0;
        if known.get(i64::from(x), i64::from(y)) { Rgb([r, g, b]) } else { UNKNOWN }
    });
    (image, known)
}

/// The photo where it shows the bare room, and the editor's empty room elsewhere, in the photo's colours.
pub(super) fn put_together(photo: &RgbImage, emptied: &RgbImage, bare: &Mask) -> RgbImage {
    let gain = gain(photo, emptied, bare);
    RgbImage::from_fn(photo.width(), photo.height(), |x, y| {
        if bare.get(i64::from(x), i64::from(y)) {
            *photo.get_pixel(x, y)
        } else {
            times(*emptied.get_pixel(x, y), gain)
        }
    })
}

/// Lays the editor's material over what the photo does not show of a face, in the colours of what it does; `painted` is the
/// face in its own material, `seen` what was seen of it (alpha).
pub(super) fn over_unseen(painted: &mut RgbaImage, seen: &RgbaImage, edited: &RgbImage, px_per_m: f64) {
    let (width, height) = painted.dimensions();
    let edited = imageops::resize(edited, width, height, imageops::FilterType::CatmullRom);
    let size = ImageSize::new(width, height);
    let known = Mask::from_fn(size, |x, y| seen.get_pixel(x, y).0[3] >= KEPT);
    let own = DynamicImage::ImageRgba8(painted.clone()).to_rgb8();
    let gain = gain(&own, &edited, &known);
    let feather = (FEATHER * px_per_m).round().max(1.0) as i32;
    // So many steps from the border of what is known, most of the way in the last.
    let steps = 4;
    let rings: Vec<Mask> = (0..steps).map(|k| known.dilated(feather * k / steps)).collect();
    for (x, y, pixel) in painted.enumerate_pixels_mut() {
        let inside = rings.iter().filter(|ring| ring.get(i64::from(x), i64::from(y))).count();
        let weight = 1.0 - inside as f32 / steps as f32;
        if weight > 0.0 {
            let drawn = times(*edited.get_pixel(x, y), gain);
            for c in 0..3 {
                let (from, to) = (f32::from(pixel.0[c]), f32::from(drawn.0[c]));
                pixel.0[c] = (from + weight * (to - from)).round() as u8;
            }
        }
    }
}

/// By what each channel of an edited picture is multiplied to have the colours of the one it was made from, where both show
/// the same: the middle of the ratios, linear.
fn gain(of: &RgbImage, edited: &RgbImage, same: &Mask) -> [f32; 3] {
    /// Darker pixels tell no ratio, linear.
    const DARK: f32 = 0.01;
    std::array::from_fn(|c| {
        let linear = |image: &RgbImage, x: u32, y: u32| linear_from_srgb(f32::from(image.get_pixel(x, y).0[c]) / 255.0);
        let mut ratios: Vec<f32> = (0..of.height())
            .flat_map(|y| (0..of.width()).map(move |x| (x, y)))
            .filter(|(x, y)| same.get(i64::from(*x), i64::from(*y)))
            .map(|(x, y)| (linear(of, x, y), linear(edited, x, y)))
            .filter(|(a, b)| *a > DARK && *b > DARK)
            .map(|(a, b)| a / b)
            .collect();
        let middle = ratios.len() / 2;
        if ratios.is_empty() { 1.0 } else { *ratios.select_nth_unstable_by(middle, f32::total_cmp).1 }
    })
}

fn times(pixel: Rgb<u8>, gain: [f32; 3]) -> Rgb<u8> {
    Rgb(std::array::from_fn(|c| {
        let linear = linear_from_srgb(f32::from(pixel.0[c]) / 255.0) * gain[c];
        (srgb_from_linear(linear.clamp(0.0, 1.0)) * 255.0).round() as u8
    }))
}

/// The share of the squares, of those that lie within a mask, that are the same in both pictures once the second has the
/// first's colours.
fn same_share(of: &RgbImage, edited: &RgbImage, within: &Mask) -> f64 {
    if of.dimensions() != edited.dimensions() {
        return 0.0;
    }
    let gain = gain(of, edited, within);
    let (mut all, mut same) = (0_u32, 0_u32);
    for top in (0..of.height().saturating_sub(SQUARE - 1)).step_by(SQUARE as usize) {
        for left in (0..of.width().saturating_sub(SQUARE - 1)).step_by(SQUARE as usize) {
            let pixels = || (0..SQUARE * SQUARE).map(|i| (left + i % SQUARE, top + i / SQUARE));
            if !pixels().all(|(x, y)| within.get(i64::from(x), i64::from(y))) {
                continue;
            }
            let mean = |image: &RgbImage| -> [u8; 3] {
                let sum = |c: usize| pixels().map(|(x, y)| u32::from(image.get_pixel(x, y).0[c])).sum::<u32>();
                std::array::from_fn(|c| (sum(c) / (SQUARE * SQUARE)) as u8)
            };
            all += 1;
            same += u32::from(lab_distance(mean(of), times(Rgb(mean(edited)), gain).0) < SAME);
        }
    }
    f64::from(same) / f64::from(all.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of stripes, half of it known, and an editor that has its own shade of everything.
    #[test]
    fn what_is_not_seen_goes_on_as_drawn_in_the_colours_of_what_is() {
        let stripe = |x: u32| if (x / 10).is_multiple_of(2) { [200, 180, 160] } else { [120, 100, 90] };
        let truth = RgbImage::from_fn(200, 100, |x, _| Rgb(stripe(x)));
        let shade = RgbImage::from_fn(200, 100, |x, y| times(*truth.get_pixel(x, y), [0.7, 0.8, 0.9]));
        let seen = RgbaImage::from_fn(200, 100, |x, _| {
            let [r, g, b] = stripe(x);
            image::Rgba([r, g, b, if x < 100 { 255 } else { 0 }])
        });
        let mut painted = RgbaImage::from_fn(200, 100, |x, y| {
            let mut pixel = *seen.get_pixel(x, y);
            if x >= 100 {
                pixel = image::Rgba([150, 140, 130, 255]);
            }
            pixel
        });
        over_unseen(&mut painted, &seen, &shade, 100.0);
        for x in (0..100).chain(110..200) {
            let [r, g, b, _] = painted.get_pixel(x, 50).0;
            let want = stripe(x);
            assert!([r, g, b].iter().zip(want).all(|(a, b)| a.abs_diff(b) <= 2), "{x}: {r} {g} {b}, {want:?}");
        }
    }

    #[test]
    fn an_empty_room_is_the_photo_where_it_is_bare() {
        let size = ImageSize::new(64, 48);
        let photo = RgbImage::from_fn(64, 48, |x, y| if x > 40 && y > 20 { Rgb([20, 60, 20]) } else { Rgb([180; 3]) });
        let drawn = RgbImage::from_pixel(64, 48, Rgb([160; 3]));
        let bare = Mask::from_fn(size, |x, y| !(x > 38 && y > 18));
        let together = put_together(&photo, &drawn, &bare);
        for (x, y, p) in together.enumerate_pixels() {
            assert!(p.0.iter().all(|c| c.abs_diff(180) <= 2), "{x} {y}: {p:?}");
        }
        assert!(same_share(&photo, &drawn, &Mask::from_fn(size, |_, _| true)) > SAME_ROOM);
        let other = RgbImage::from_fn(64, 48, |x, y| Rgb([(x * 4) as u8, (y * 5) as u8, 255 - (x * 3) as u8]));
        assert!(same_share(&photo, &other, &Mask::from_fn(size, |_, _| true)) < SAME_ROOM);
    }

    #[test]
    fn what_is_not_known_of_a_face_is_sent_grey() {
        let texture = RgbaImage::from_fn(2048, 512, |x, _| image::Rgba([200, 100, 50, if x < 1024 { 255 } else { 0 }]));
        let (image, known) = sent(&texture);
        assert_eq!(image.dimensions(), (1024, 256));
        assert!((510 * 256..=512 * 256).contains(&known.count()), "{}", known.count());
        assert_eq!((image.get_pixel(100, 9).0, image.get_pixel(900, 9).0), ([200, 100, 50], [128; 3]));
    }
}
