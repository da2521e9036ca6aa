//! A finished scene seen from where the photo was not taken.
//!
//! A room's folder `views/` shows it from other places. The scene is drawn from there and compared with what is there:
//! the pictures, split into surfaces that the room's photo saw and those it did not; the objects' outlines and depths;
//! the share of pixels with nothing. Views are for judging alone; nothing in the pipeline reads them.
//!
//! # Frames
//! Pictures are drawn in the run's own room frame as it is: it should be the truth's. Objects are compared with the
//! frames anchored as for the other scores of objects ([`crate::score::RoomScore::shift_x`]).

mod case;
mod draw;
mod lit;
pub mod measure;
mod seen;
mod table;

use harmony_scene::Mask;
use image::RgbImage;
use serde::{Deserialize, Serialize};

pub use case::{Lit, judge_case, picture_name};
pub use draw::{Look, flat};
pub use lit::{LIT_SAMPLES, LIT_WIDTH, LitOptions, LitScore, lit_scores};
pub use seen::seen_by_photo;
pub(crate) use table::mean_iou;
pub use table::{csv, text};

use crate::metrics::similarity::Looking;
use crate::score::{ObjectScore, Prediction};
use crate::truth::{FEWEST_PIXELS, TruthError, TruthRoom, TruthView};

/// A picture's figures over a region of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RegionScore {
    /// Share of the picture.
    pub share: f64,
    /// Pixel loss.
    pub pl: f64,
    /// SSIM of luminance over blocks; `None` where no block lies in the region.
    pub ssim: Option<f64>,
    /// LPIPS (AlexNet), where its weights are. Of a region: with the true pixels around it, over its share.
    pub lpips: Option<f64>,
}

/// A picture's figures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PictureScore {
    /// The whole picture.
    pub all: RegionScore,
    /// Pixel loss after the best gain of each channel.
    pub pl_gain: f64,
    /// Surfaces that the room's photo saw.
    pub seen: Option<RegionScore>,
    /// Surfaces that it did not see.
    pub unseen: Option<RegionScore>,
}

/// An object from a view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewObject {
    /// Id in the truth.
    pub truth: String,
    /// Id in the run; `None` for what it lacks.
    pub id: Option<String>,
    /// Pixels of the view that show it.
    pub pixels: u64,
    /// IoU of what is visible of it; 0 for what is lacking.
    pub iou: f64,
    /// Median absolute difference of planar depth where both sides show it, metres.
    pub depth_m: Option<f64>,
}

/// A scene from one view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewScore {
    /// The view's name.
    pub view: String,
    /// The flat picture.
    pub flat: PictureScore,
    /// Share of its pixels where nothing was drawn.
    pub nothing: f64,
    /// Objects that the photo and the view show.
    pub objects: Vec<ViewObject>,
    /// The lit picture, when it was asked for and could be made.
    #[serde(default)]
    pub lit: Option<LitScore>,
}

/// A view with the pictures that were compared.
#[derive(Debug, Clone)]
pub struct JudgedView {
    /// Figures.
    pub score: ViewScore,
    /// What is there.
    pub photo: RgbImage,
    /// What was drawn, flat.
    pub flat: RgbImage,
    /// What was drawn, lit.
    pub lit: Option<RgbImage>,
    /// Surfaces that the room's photo saw.
    pub seen: Mask,
    /// Camera of the view.
    pub camera: harmony_scene::Camera,
}

/// Compares a picture with what should be there; `None` when the sizes differ.
pub fn picture_score(
    render: &RgbImage,
    photo: &RgbImage,
    seen: Option<&Mask>,
    looking: &Looking,
) -> Option<PictureScore> {
    let size = harmony_scene::ImageSize::new(photo.width(), photo.height());
    let everywhere = Mask::from_fn(size, |_, _| true);
    let region = |mask: &Mask| {
        let pl = measure::loss(render, photo, mask)?;
        let share = mask.count() as f64 / size.pixels() as f64;
        let lpips = looking.similarity.as_ref().and_then(|s| {
            let lpips = s.compare(&measure::pasted(render, photo, mask), photo).lpips?;
            Some(lpips / share)
        });
        Some(RegionScore { share, pl, ssim: measure::ssim(render, photo, mask), lpips })
    };
    Some(PictureScore {
        all: region(&everywhere)?,
        pl_gain: measure::loss_with_gain(render, photo)?,
        seen: seen.and_then(region),
        unseen: seen.and_then(|seen| region(&everywhere.minus(seen))),
    })
}

/// Judges a run from all views of its room, flat; `objects` and `shift_x` are those of its score.
///
/// # Errors
/// A view that cannot be read.
pub fn judge(
    truth: &TruthRoom,
    run: &Prediction,
    objects: &[ObjectScore],
    shift_x: f64,
    looking: &Looking,
) -> Result<Vec<JudgedView>, TruthError> {
    let mut anchored = run.clone();
    anchored.shift(glam::DVec3::new(shift_x, 0.0, 0.0));
    truth
        .views()?
        .into_iter()
        .map(|view| {
            let path = view.photo();
            let wrong = |reason: String| TruthError::Format { path: path.clone(), reason };
            let photo = harmony_io::picture::read(&path).map_err(|e| wrong(e.to_string()))?.into_rgb8();
            let seen = seen_by_photo(truth, &view);
            let frame = flat(run, &view.camera, Look::Judge);
            let nothing = frame.depth.iter().filter(|d| **d <= 0.0).count() as f64 / frame.depth.len().max(1) as f64;
            let picture = image::DynamicImage::ImageRgba8(frame.color).into_rgb8();
            let score = picture_score(&picture, &photo, Some(&seen), looking)
                .ok_or_else(|| wrong("the photo has another size than the camera says".to_owned()))?;
            let objects = outlines(truth, &view, &anchored, objects);
            let score = ViewScore { view: view.name, flat: score, nothing, objects, lit: None };
            Ok(JudgedView { score, photo, flat: picture, lit: None, seen, camera: view.camera })
        })
        .collect()
}

/// Outlines and depths of the objects that both the photo and the view show.
fn outlines(truth: &TruthRoom, view: &TruthView, run: &Prediction, scores: &[ObjectScore]) -> Vec<ViewObject> {
    let (ids, depth) = run.render_from(&view.camera);
    let mut out = Vec::new();
    for object in truth.visible() {
        let there = |i: usize| u32::from(view.ids[i]) == object.index;
        let pixels = (0..view.ids.len()).filter(|i| there(*i)).count() as u64;
        if pixels < FEWEST_PIXELS {
            continue;
        }
        let found = scores.iter().find(|s| s.truth.as_deref() == Some(object.id.as_str()));
        let place = found.and_then(|s| run.objects.iter().position(|o| o.object.id.as_str() == s.id));
        let mut row = ViewObject { truth: object.id.clone(), id: None, pixels, iou: 0.0, depth_m: None };
        if let Some(place) = place {
            let own = |i: usize| ids[i] == place as u32 + 1;
            let (mut both, mut either) = (0_u64, 0_u64);
            let mut apart = Vec::new();
            for (i, (found, wanted)) in depth.iter().zip(&view.depth).enumerate() {
                let (a, b) = (own(i), there(i));
                either += u64::from(a || b);
                if a && b {
                    both += 1;
                    if *wanted > 0.0 {
                        apart.push(f64::from((found - wanted).abs()));
                    }
                }
            }
            row.id = Some(run.objects[place].object.id.to_string());
            row.iou = both as f64 / either.max(1) as f64;
            row.depth_m = (!apart.is_empty()).then(|| crate::summary::quantile(&apart, 0.5));
        }
        out.push(row);
    }
    out
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DVec3, Vec2, Vec3};
    use harmony_mesh::{Group, Material, Mesh};
    use harmony_scene::{Camera, Extents, ImageSize, Intrinsics};
    use image::Rgb;

    use super::*;

    /// A wall at z = 0, 4 m wide and 2 m high, that a camera at 2 m sees from side to side with half a metre of
    /// nothing above and below: of 60 rows 40 show it.
    fn judged(flip: bool) -> JudgedView {
        let size = ImageSize::new(80, 60);
        let camera = Camera::looking(size, Intrinsics::centred(size, 40.0), DVec3::new(2.0, 1.0, 2.0), DVec3::NEG_Z);
        let corners = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]];
        let triangles = [[0, 1, 2], [0, 2, 3]].map(|[a, b, c]: [u32; 3]| if flip { [a, c, b] } else { [a, b, c] });
        let mut shell = Mesh {
            positions: corners.iter().map(|[x, y]| Vec3::new(*x, *y, 0.0)).collect(),
            uvs: vec![Vec2::ZERO; 4],
            groups: vec![Group { material: 0, triangles: triangles.to_vec() }],
            materials: vec![Material::plain("wall", harmony_mesh::linear_rgb([153; 3]))],
            ..Mesh::default()
        };
        shell.recompute_normals();
        // Glows in viewers; the judge draws its base colour.
        shell.materials[0].emissive = [5.0; 3];
        let extents = Extents { width: 4.0, height: 3.0, depth: 4.0 };
        let folder = tempfile::tempdir().unwrap();
        let view = folder.path().join("views").join("1");
        std::fs::create_dir_all(&view).unwrap();
        let photo = image::RgbImage::from_pixel(80, 60, Rgb([51; 3]));
        harmony_io::picture::write_rgb_png(&view.join("photo.jpg"), &photo).unwrap();
        let depth = vec![2.0; size.pixels()];
        harmony_io::picture::write_depth_png(&view.join("depth.png"), size, &depth).unwrap();
        image::GrayImage::from_pixel(80, 60, image::Luma([3])).save(view.join("instances.png")).unwrap();
        let r = camera.rotation.transpose();
        let rows = [r.x_axis.to_array(), r.y_axis.to_array(), r.z_axis.to_array()];
        let json = serde_json::json!({
            "width": 80, "height": 60, "K": [[40.0, 0.0, 40.0], [0.0, 40.0, 30.0], [0.0, 0.0, 1.0]],
            "R": rows, "t": camera.translation.to_array(),
        });
        std::fs::write(view.join("camera.json"), json.to_string()).unwrap();
        let truth = TruthRoom {
            name: "wall".to_owned(),
            folder: folder.path().to_owned(),
            camera,
            extents,
            shape: harmony_scene::RoomShape::default(),
            origin: DVec3::ZERO,
            walls: Vec::new(),
            openings: Vec::new(),
            objects: Vec::new(),
            ids: vec![3; size.pixels()],
            // The photo knows the left half alone.
            depth: (0..size.pixels()).map(|i| if i % 80 < 40 { 2.0 } else { 9.0 }).collect(),
        };
        let run = Prediction {
            folder: folder.path().to_owned(),
            camera,
            room: truth.room(),
            corner: DVec3::ZERO,
            objects: Vec::new(),
            shell: Arc::new(shell),
            looks: Vec::new(),
            faults: crate::oracle::Faults::default(),
        };
        judge(&truth, &run, &[], 0.0, &Looking::default()).unwrap().remove(0)
    }

    #[test]
    fn a_wall_of_one_colour_has_the_loss_of_its_pixels() {
        let score = judged(false).score;
        // sRGB 153 against 51 on two thirds, black against 51 on the rest: 0.4 and 0.2 squared.
        let expected = 2.0 / 3.0 * 0.16 + 0.04 / 3.0;
        assert!((score.flat.all.pl - expected).abs() < 1e-3, "{}", score.flat.all.pl);
        assert!((score.nothing - 1.0 / 3.0).abs() < 1e-9);
        let (seen, unseen) = (score.flat.seen.unwrap(), score.flat.unseen.unwrap());
        assert_eq!((seen.share, unseen.share), (0.5, 0.5));
        assert!((seen.pl - expected).abs() < 1e-3 && (unseen.pl - expected).abs() < 1e-3);
        assert!(score.objects.is_empty() && score.lit.is_none());
    }

    #[test]
    fn walls_are_seen_from_their_front_alone() {
        let score = judged(true).score;
        assert_eq!(score.nothing, 1.0);
        assert!((score.flat.all.pl - 0.04).abs() < 1e-9);
    }
}
