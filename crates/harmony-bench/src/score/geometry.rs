//! Surfaces of a run against those of its room, by published protocols, and its picture against the photo.
//!
//! # Frames
//! Predicted surfaces are in the frame of the run's camera, true ones in that of the true camera, both in metres: what
//! a run delivers is compared with the photo's view, without any registration. Scale alignment comes before
//! ([`super::ScoreOptions::align_scale`]) and scales about the camera's centre.
//!
//! # Departures from the protocol
//! - The truth's meshes hold the whole objects, hidden sides and what lies outside the image too. Both sides are
//!   therefore cut by the photo's frustum ([`TruthRegion::Frustum`]); the score with the truth left whole stands
//!   beside it.
//! - The true background is the depth map where the photo shows the shell; the predicted one is the depth of the run's
//!   shell, seen by the run's camera, in the same pixels. Every other pixel in each direction is used: half a
//!   million triangles say no more about planes than a quarter of them.

use harmony_render::{Instance, RenderOptions, render_depth_ids};
use harmony_scene::{Camera, ImageSize, Mask};
use serde::{Deserialize, Serialize};

use super::prediction::Prediction;
use crate::metrics::gen3dsr::{
    Distances, Gen3dsrError, Gen3dsrOptions, Gen3dsrScore, Surfaces, THRESHOLDS, TruthRegion, gen3dsr,
};
use crate::metrics::midi::{MidiOptions, POINTS_PER_OBJECT, midi};
use crate::metrics::picture::pixel_loss;
use crate::metrics::sample::{Seed, sample_surface};
use crate::metrics::soup::{Triangle, depth_soup, soup_of};
use crate::truth::TruthRoom;

/// Points of each side in the benchmark unless told otherwise: a fifth of the protocol's, for speed.
///
/// F at 0.1 m and the Chamfer distance hardly depend on it; F at 1 mm grows with it, as its floor does.
pub const BENCH_POINTS: usize = 200_000;
/// Share of the points that the protocol `midi` gets over all objects: its ICP takes up to 50 rounds.
const MIDI_SHARE: usize = 10;
/// Fewest points an object gets there.
const MIDI_FEWEST: usize = 256;
/// Values of the shell in the id image: floor, ceiling, four walls, skirting board, outside.
const SHELL_IDS: std::ops::RangeInclusive<u8> = 1..=8;
/// Pixels of the depth maps in each direction for one point of the background.
const STRIDE: u32 = 2;

/// Precision, recall and F at one distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ThresholdFigures {
    /// Distance that counts as near, metres.
    pub threshold_m: f64,
    /// Share of the predicted points near the truth, percent.
    pub precision: f64,
    /// Share of the true points near the prediction, percent.
    pub recall: f64,
    /// Their harmonic mean, percent.
    pub f1: f64,
    /// The F of the truth against another sampling of itself: no prediction gets more.
    pub best_f1: f64,
}

/// The protocol `gen3dsr` on one set of surfaces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SurfaceScore {
    /// Half the sum of both mean distances, metres.
    pub chamfer_m: f64,
    /// The same of the truth against another sampling of itself.
    pub best_chamfer_m: f64,
    /// By distance: 0.1, 0.01, 0.001 m.
    pub at: Vec<ThresholdFigures>,
    /// Predicted area compared, square metres.
    pub prediction_m2: f64,
    /// True area compared, square metres.
    pub truth_m2: f64,
}

/// The protocol `midi`: the scene in [-1, 1], rigid ICP.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MidiFigures {
    /// Sum of both mean squared distances after ICP, normalised units.
    pub chamfer_squared: f64,
    /// F at 0.1 after ICP, percent.
    pub f: f64,
    /// F at 0.1 before ICP, percent.
    pub f_before_icp: f64,
    /// Points of an object.
    pub points_per_object: usize,
}

/// Surfaces of one run. A comparison is missing when one side has no surface; the protocol then skips the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GeometryScore {
    /// Points drawn from each side in `gen3dsr`.
    pub points: usize,
    /// `gen3dsr`, objects alone, both cut by the frustum.
    pub objects: Option<SurfaceScore>,
    /// `gen3dsr`, objects and background, both cut by the frustum.
    pub with_background: Option<SurfaceScore>,
    /// `gen3dsr`, objects alone, the truth's left whole.
    pub whole: Option<SurfaceScore>,
    /// `midi`.
    pub midi: Option<MidiFigures>,
}

impl SurfaceScore {
    fn of(score: &Gen3dsrScore) -> Self {
        let Distances { chamfer, at } = &score.score;
        let at = at.iter().zip(&score.floor.at).map(|(own, best)| ThresholdFigures {
            threshold_m: own.threshold,
            precision: own.precision,
            recall: own.recall,
            f1: own.f1,
            best_f1: best.f1,
        });
        Self {
            chamfer_m: *chamfer,
            best_chamfer_m: score.floor.chamfer,
            at: at.collect(),
            prediction_m2: score.prediction_area,
            truth_m2: score.truth_area,
        }
    }

    /// F at a distance, percent.
    pub fn f(&self, threshold_m: f64) -> Option<f64> {
        self.at.iter().find(|t| t.threshold_m == threshold_m).map(|t| t.f1)
    }
}

/// Compares the surfaces of a run, as it stands, with the truth; `points` from each side.
pub fn geometry(truth: &TruthRoom, run: &Prediction, points: usize) -> GeometryScore {
    let predicted: Vec<Vec<Triangle>> =
        run.objects.iter().map(|o| soup_of(&o.mesh, |p| run.camera.to_camera(p))).collect();
    let real: Vec<Vec<Triangle>> =
        truth.objects.iter().map(|o| soup_of(&o.mesh, |p| truth.camera.to_camera(o.point(p)))).collect();
    let (predicted_all, real_all) = (predicted.concat(), real.concat());
    let compare = |truth_region: TruthRegion, backgrounds: Option<(&[Triangle], &[Triangle])>| {
        let options =
            Gen3dsrOptions { points, thresholds: THRESHOLDS.to_vec(), truth_region, ..Gen3dsrOptions::default() };
        let prediction = Surfaces { objects: &predicted_all, background: backgrounds.map(|b| b.0) };
        let real = Surfaces { objects: &real_all, background: backgrounds.map(|b| b.1) };
        let score: Result<Gen3dsrScore, Gen3dsrError> =
            gen3dsr(prediction, real, truth.camera.size, &truth.camera.intrinsics, &options);
        score.inspect_err(|reason| tracing::debug!(room = truth.name, %reason, "no score")).ok()
    };
    let objects = compare(TruthRegion::Frustum, None).map(|s| SurfaceScore::of(&s));
    let whole = compare(TruthRegion::Whole, None).map(|s| SurfaceScore::of(&s));
    let (own, theirs) = backgrounds(truth, run);
    let with_background = compare(TruthRegion::Frustum, Some((&own, &theirs))).map(|s| SurfaceScore::of(&s));
    GeometryScore { points, objects, with_background, whole, midi: midi_figures(&predicted, &real, points) }
}

/// The predicted and the true background, each in the frame of its camera.
fn backgrounds(truth: &TruthRoom, run: &Prediction) -> (Vec<Triangle>, Vec<Triangle>) {
    let full = truth.camera.size;
    let coarse = ImageSize::new(full.width.div_ceil(STRIDE), full.height.div_ceil(STRIDE));
    // Column x of the coarse map is column 2 x of the full one, at 2 x + 0.5; its own centre would lie at x + 0.5.
    let source = |x: u32, y: u32| ((y * STRIDE) * full.width + x * STRIDE) as usize;
    let strided = |camera: &Camera| {
        let (step, mut k) = (f64::from(STRIDE), camera.intrinsics);
        k.fx /= step;
        k.fy /= step;
        k.cx = (k.cx - 0.5) / step + 0.5;
        k.cy = (k.cy - 0.5) / step + 0.5;
        k
    };
    let valid =
        Mask::from_fn(coarse, |x, y| SHELL_IDS.contains(&truth.ids[source(x, y)]) && truth.depth[source(x, y)] > 0.0);
    let true_depth: Vec<f32> = (0..coarse.height)
        .flat_map(|y| (0..coarse.width).map(move |x| (x, y)))
        .map(|(x, y)| truth.depth[source(x, y)])
        .collect();
    let camera = Camera { size: coarse, intrinsics: strided(&run.camera.resized(full)), ..run.camera };
    let shell = Instance { mesh: &run.shell, linear: glam::DMat3::IDENTITY, translation: glam::DVec3::ZERO, id: 1 };
    let frame = render_depth_ids(&camera, &[shell], &RenderOptions::default());
    (depth_soup(&frame.depth, &camera.intrinsics, &valid), depth_soup(&true_depth, &strided(&truth.camera), &valid))
}

fn midi_figures(predicted: &[Vec<Triangle>], real: &[Vec<Triangle>], points: usize) -> Option<MidiFigures> {
    let share = points / MIDI_SHARE / predicted.len().max(1);
    let points_per_object = share.clamp(MIDI_FEWEST, POINTS_PER_OBJECT);
    let mut truth = Vec::new();
    for (soup, draw) in real.iter().zip(0..) {
        // Other numbers than the prediction's, so that equal objects don't get equal points.
        let seed = Seed { seed: 1, draw };
        truth.extend(sample_surface(soup, points_per_object, seed).map(|s| s.points).unwrap_or_default());
    }
    let score = midi(predicted, &truth, &MidiOptions { points_per_object, ..MidiOptions::default() }).ok()?;
    Some(MidiFigures {
        chamfer_squared: score.score.chamfer,
        f: 100.0 * score.score.f_score.f1,
        f_before_icp: 100.0 * score.before_icp.f_score.f1,
        points_per_object,
    })
}

/// Pixel loss of the run's evenly lit picture against the photo; `None` when one of them cannot be read.
pub fn picture_loss(truth: &TruthRoom, run: &Prediction) -> Option<f64> {
    let (render, photo) = pictures(truth, run)?;
    pixel_loss(&render, &photo)
}

/// The evenly lit picture of a run and the photo.
pub fn pictures(truth: &TruthRoom, run: &Prediction) -> Option<(image::RgbImage, image::RgbImage)> {
    let render = harmony_io::picture::read(&run.folder.join("render_flat.png")).ok()?.into_rgb8();
    let photo = harmony_io::picture::read(&truth.photo()).ok()?.into_rgb8();
    Some((render, photo))
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;
    use std::sync::Arc;

    use glam::{DMat3, DVec3, Vec2, Vec3};
    use harmony_mesh::{Group, Material, Mesh};
    use harmony_scene::{Extents, Intrinsics};

    use super::*;

    /// A floor and a back wall, seen by both cameras, drawn at full size for the truth.
    #[test]
    fn backgrounds_of_equal_rooms_lie_on_each_other() {
        let size = ImageSize::new(161, 120);
        let camera = Camera::looking(
            size,
            Intrinsics::from_horizontal_fov(size, 1.2),
            DVec3::new(2.0, 1.3, 4.5),
            DVec3::new(0.1, -0.15, -1.0),
        );
        let corners = [[0, 0, 0], [4, 0, 0], [4, 0, 4], [0, 0, 4], [4, 3, 0], [0, 3, 0]];
        let mut shell = Mesh {
            positions: corners.iter().map(|c| Vec3::from(c.map(|v: u8| f32::from(v)))).collect(),
            uvs: vec![Vec2::ZERO; corners.len()],
            groups: vec![Group { material: 0, triangles: vec![[0, 2, 1], [0, 3, 2], [0, 1, 4], [0, 4, 5]] }],
            materials: vec![Material::plain("grey", [0.5; 3])],
            normals: Vec::new(),
            metric_uvs: Vec::new(),
            colors: Vec::new(),
        };
        shell.recompute_normals();
        let shell = Arc::new(shell);
        let instance = Instance { mesh: &shell, linear: DMat3::IDENTITY, translation: DVec3::ZERO, id: 1 };
        let frame = render_depth_ids(&camera, &[instance], &RenderOptions::default());
        let extents = Extents { width: 4.0, height: 3.0, depth: 4.0 };
        let truth = TruthRoom {
            name: "corner".to_owned(),
            folder: PathBuf::new(),
            camera,
            extents,
            shape: harmony_scene::RoomShape::default(),
            origin: DVec3::ZERO,
            walls: Vec::new(),
            openings: Vec::new(),
            objects: Vec::new(),
            ids: frame.ids.iter().map(|id| *id as u8).collect(),
            depth: frame.depth,
        };
        let (folder, room) = (PathBuf::new(), truth.room());
        let run = Prediction {
            folder,
            camera,
            room,
            corner: DVec3::ZERO,
            objects: Vec::new(),
            shell,
            looks: Vec::new(),
            faults: crate::oracle::Faults::default(),
        };
        let (own, theirs) = backgrounds(&truth, &run);
        assert!(own.len() > 5000 && own.len() == theirs.len(), "{} {}", own.len(), theirs.len());
        let far = own.iter().flatten().zip(theirs.iter().flatten()).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        // Depths are f32 and drawn from other pixel grids; a shift by half a pixel would show as some 10 mm.
        assert!(far <= 1e-4, "{far}");
        // About 25 square metres: 20,000 points leave next to none without a neighbour within 0.1 m.
        let score = geometry(&truth, &run, 20_000);
        assert!(score.objects.is_none() && score.midi.is_none(), "nothing to compare");
        assert!(score.with_background.unwrap().f(0.1).unwrap() > 99.0);
        assert_eq!(score.points, 20_000);
    }
}
