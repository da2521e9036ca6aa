//! A run judged against the truth of its room.
//!
//! # Frames
//! The run's room frame and the truth's share the floor and the back wall, and the side wall that the photo shows.
//! Where the photo shows only the right wall, the run's x = 0 lies where a guess of the width puts it; positions are
//! then compared with both frames anchored at the right wall ([`RoomScore::shift_x`]). Everything else is compared raw.
//! With `scale` the whole run is first scaled by the median ratio of true to predicted depth over the photo's pixels.

mod contact;
mod geometry;
mod looks;
mod objects;
mod prediction;

use glam::DVec3;
use harmony_scene::{Camera, Wall};
use serde::{Deserialize, Serialize};

pub use contact::{PairScore, Solid};
pub use geometry::pictures;
pub use geometry::{BENCH_POINTS, GeometryScore, MidiFigures, SurfaceScore, ThresholdFigures};
pub use looks::{LookScore, in_all};
pub use objects::ObjectScore;
pub(crate) use objects::{matched, place};
pub use prediction::{Prediction, PredictionError};

use crate::truth::TruthRoom;
use crate::views::{LitScore, ViewScore};

/// Camera errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CameraScore {
    /// Angle between the two rotations, degrees.
    pub rotation_deg: f64,
    /// Distance of the centres, metres.
    pub centre_m: f64,
    /// Relative error of the focal length.
    pub focal: f64,
}

/// How far the outline of the room is off, where the photo shows it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PlanScore {
    /// Median over the pixels of walls, metres.
    pub median_m: f64,
    /// 90th percentile, metres.
    pub p90_m: f64,
    /// Share of them within 10 cm.
    pub within: f64,
}

/// Everything about one room.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RoomScore {
    /// Name of the room.
    pub room: String,
    /// Seed of the oracle's noise, where it is known.
    #[serde(default)]
    pub seed: Option<u64>,
    /// Factor that was applied to the run, 1 without scale alignment.
    pub scale: f64,
    /// Shift along x that brings the seen side walls together, metres.
    pub shift_x: f64,
    /// Camera.
    pub camera: CameraScore,
    /// Distance of what the photo shows of the true walls to the run's walls, metres; `None` where none is in view.
    #[serde(default)]
    pub plan: Option<PlanScore>,
    /// Relative errors of width, height, depth; `None` where neither end of the extent is in view.
    pub extents: [Option<f64>; 3],
    /// Objects of the run, matched or not.
    pub objects: Vec<ObjectScore>,
    /// Objects of the truth that the run lacks.
    pub missed: Vec<String>,
    /// Pairs that cut each other by more than a centimetre and do not in truth.
    pub penetrating: Vec<PairScore>,
    /// Objects that float by more than 5 mm and do not in truth: id and gap, metres.
    pub floating: Vec<(String, f64)>,
    /// Surfaces, when they were compared.
    #[serde(default)]
    pub geometry: Option<GeometryScore>,
    /// Pixel loss of the evenly lit picture against the photo.
    #[serde(default)]
    pub pixel_loss: Option<f64>,
    /// N-CLIP of the same two pictures, where CLIP's weights are.
    #[serde(default)]
    pub n_clip: Option<f64>,
    /// LPIPS (AlexNet) of the same, where its weights are.
    #[serde(default)]
    pub lpips: Option<f64>,
    /// From where the photo was not taken, when the room shows that.
    #[serde(default)]
    pub views: Vec<ViewScore>,
    /// The lit picture in the photo's view, when it was judged.
    #[serde(default)]
    pub lit: Option<LitScore>,
    /// What each look mended and made worse.
    #[serde(default)]
    pub looks: Vec<LookScore>,
    /// Questions to the language model for each placed object, as the run tells; `None` where it does not.
    #[serde(default)]
    pub questions_per_object: Option<f64>,
    /// Seconds of the run; 0 when only the result was judged.
    pub seconds: f64,
    /// Why there is no result, when there is none.
    pub failure: Option<String>,
}

impl RoomScore {
    /// Objects of the run that are in the truth, too.
    pub fn matched(&self) -> impl Iterator<Item = &ObjectScore> {
        self.objects.iter().filter(|o| o.truth.is_some())
    }

    /// Room and seed in one word, as run folders are named.
    pub fn case(&self) -> String {
        self.seed.map_or_else(|| self.room.clone(), |seed| format!("{}_{seed}", self.room))
    }

    /// Median error of position over all its objects, metres; NaN without any.
    pub fn median_position(&self) -> f64 {
        crate::summary::quantile(&self.matched().map(|o| o.position_m).collect::<Vec<_>>(), 0.5)
    }

    /// The score of a run that delivered no scene: nothing found.
    pub fn failed(truth: &TruthRoom, seconds: f64, reason: String) -> Self {
        Self {
            room: truth.name.clone(),
            seed: None,
            scale: 1.0,
            shift_x: 0.0,
            camera: CameraScore { rotation_deg: 180.0, centre_m: 10.0, focal: 1.0 },
            plan: None,
            extents: [None; 3],
            objects: Vec::new(),
            missed: truth.visible().map(|o| o.id.clone()).collect(),
            penetrating: Vec::new(),
            floating: Vec::new(),
            geometry: None,
            pixel_loss: None,
            n_clip: None,
            lpips: None,
            views: Vec::new(),
            lit: None,
            looks: Vec::new(),
            questions_per_object: None,
            seconds,
            failure: Some(reason),
        }
    }
}

/// Settings of a judgement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScoreOptions {
    /// Scale the run by the median ratio of depths first.
    pub align_scale: bool,
    /// Points drawn from each side's surfaces; 0 leaves out the comparison of surfaces.
    pub points: usize,
}

/// Judges a run.
pub fn score(truth: &TruthRoom, run: &Prediction, options: ScoreOptions) -> RoomScore {
    let scale = if options.align_scale { run.depth_ratio(truth).unwrap_or(1.0) } else { 1.0 };
    let mut run = run.clone();
    run.rescale(scale);
    let shift_x = shift(truth, &run);
    run.shift(DVec3::new(shift_x, 0.0, 0.0));
    let (objects, missed) = objects::compare(truth, &run);
    let (penetrating, floating) = contact::faults(truth, &run, &objects);
    RoomScore {
        room: truth.name.clone(),
        seed: None,
        scale,
        shift_x,
        camera: camera(&truth.camera, &run.camera),
        plan: plan(truth, &run),
        extents: extents(truth, &run),
        objects,
        missed,
        penetrating,
        floating,
        geometry: (options.points > 0).then(|| geometry::geometry(truth, &run, options.points)),
        pixel_loss: geometry::picture_loss(truth, &run),
        n_clip: None,
        lpips: None,
        views: Vec::new(),
        lit: None,
        looks: looks::looks(truth, &run, scale),
        questions_per_object: None,
        seconds: 0.0,
        failure: None,
    }
}

fn camera(truth: &Camera, found: &Camera) -> CameraScore {
    let turn = found.rotation * truth.rotation.transpose();
    let cos = ((turn.x_axis.x + turn.y_axis.y + turn.z_axis.z - 1.0) / 2.0).clamp(-1.0, 1.0);
    let found = found.resized(truth.size);
    CameraScore {
        rotation_deg: cos.acos().to_degrees(),
        centre_m: found.centre().distance(truth.centre()),
        focal: found.intrinsics.fx / truth.intrinsics.fx - 1.0,
    }
}

/// Ids of the walls in the id image: back, right, front, left.
const WALL_IDS: std::ops::RangeInclusive<u8> = 3..=6;
/// Every so many pixels a wall is probed.
const PROBE: usize = 7;
/// A wall this near has its outline where it is, metres.
const PLAN: f64 = 0.10;

/// Distance of the true walls, as far as the photo shows them, to the run's shell.
fn plan(truth: &TruthRoom, run: &Prediction) -> Option<PlanScore> {
    let shell = harmony_mesh::Bvh::new(&run.shell);
    let width = truth.camera.size.width as usize;
    let mut off: Vec<f64> = (0..truth.ids.len().min(truth.depth.len()))
        .step_by(PROBE)
        .filter(|i| WALL_IDS.contains(&truth.ids[*i]) && truth.depth[*i] > 0.0)
        .filter_map(|i| {
            let pixel = glam::DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let point = truth.camera.unproject(pixel, f64::from(truth.depth[i]));
            Some(shell.closest_point(point)?.distance)
        })
        .collect();
    if off.is_empty() {
        return None;
    }
    off.sort_by(f64::total_cmp);
    Some(PlanScore {
        median_m: crate::summary::quantile(&off, 0.5),
        p90_m: crate::summary::quantile(&off, 0.9),
        within: off.iter().filter(|d| **d <= PLAN).count() as f64 / off.len() as f64,
    })
}

/// Whether a side wall's foot or top is in view, seen from the truth.
fn shift(truth: &TruthRoom, run: &Prediction) -> f64 {
    let (left, right) = (truth.walls.contains(&Wall::Left), truth.walls.contains(&Wall::Right));
    if right && !left { truth.extents.width - run.room.extents.width } else { 0.0 }
}

fn extents(truth: &TruthRoom, run: &Prediction) -> [Option<f64>; 3] {
    let seen = |wall: Wall| truth.walls.contains(&wall);
    let (t, r) = (truth.extents, run.room.extents);
    [
        (seen(Wall::Left) && seen(Wall::Right)).then(|| r.width / t.width - 1.0),
        Some(r.height / t.height - 1.0),
        (seen(Wall::Back) && seen(Wall::Front)).then(|| r.depth / t.depth - 1.0),
    ]
}
