//! The room from where the photo was not taken: at eye height on the other side, and from under the ceiling.
//!
//! The places follow the photo-like rooms: 15 cm before the front wall, looking at a point 0.8 m high in the middle of
//! the room's width and at 35 % of its depth, through a lens of 74 degrees; at the photo's exposure. Where something
//! stands before such a camera it moves in.

use glam::DVec3;
use harmony_render::{Instance, RenderOptions, render_depth_ids};
use harmony_scene::{Camera, ImageSize, Intrinsics};
use image::RgbImage;

use super::develop::Exposure;
use super::dice::Dice;
use super::layout::Plan;
use super::{bytes, flat, light};

/// A view of a room with its truth.
#[derive(Debug, Clone)]
pub struct GeneratedView {
    /// `1`: eye height; `2`: from above.
    pub name: &'static str,
    /// Camera.
    pub camera: Camera,
    /// Left positive, radians.
    pub yaw: f64,
    /// Down positive, radians.
    pub pitch: f64,
    /// Planar depth, metres, row-major; 0 = nothing.
    pub depth: Vec<f32>,
    /// Ids as in the photo.
    pub ids: Vec<u8>,
    /// What it looks like, before JPEG.
    pub photo: RgbImage,
}

/// Horizontal field of view, radians.
const LENS: f64 = 74.0 * std::f64::consts::PI / 180.0;
/// Height of the point that is looked at, metres.
const AIM_HEIGHT: f64 = 0.8;
/// Its distance from the back wall, share of the depth.
const AIM_DEPTH: f64 = 0.35;
/// Distances from the front wall that are tried, metres.
const FROM_FRONT: [f64; 4] = [0.15, 0.45, 0.8, 1.2];
/// Places along the width that are tried, shares of it from the near side.
const FROM_SIDE: [f64; 3] = [0.14, 0.25, 0.36];
/// What is nearer than this fills the picture, metres.
const SHALLOW_M: f64 = 0.6;
/// Share of shallow pixels that is let pass.
const SHALLOW_SHARE: f64 = 0.02;
/// Air around a camera at least, metres: what is inside a block, or above a slope, shows nothing.
const AIR: f64 = 0.1;
/// Width of trial pictures, pixels.
const TRIAL: u32 = 96;
/// Random numbers of the views have a stream of their own, so that the rooms stay as they are.
const STREAM: u64 = 77;

/// Both views; `instances` are the shell and then the objects.
pub(super) fn shown(
    seed: u64,
    plan: &Plan,
    photo: &Camera,
    instances: &[Instance],
    lit: &light::Lit,
    exposure: Exposure,
) -> Vec<GeneratedView> {
    let e = plan.extents;
    let left = photo.centre().x < e.width / 2.0;
    let side = |share: f64| e.width * if left { 1.0 - share } else { share };
    let eyes = FROM_SIDE.iter().flat_map(|s| FROM_FRONT.map(|f| DVec3::new(side(*s), 1.6, e.depth - f))).collect();
    let above = FROM_FRONT.map(|f| DVec3::new(e.width / 2.0, e.height - 0.25, e.depth - f)).to_vec();
    let aim = DVec3::new(e.width / 2.0, AIM_HEIGHT, e.depth * AIM_DEPTH);
    let mut dice = Dice::new(seed, STREAM);
    let one = |(name, mut places): (&'static str, Vec<DVec3>)| {
        places.retain(|p| plan.is_free_around(*p, AIR));
        let camera = clear(&places, aim, photo.size, instances)?;
        let frame = flat(&camera, instances);
        let (photo, _) = light::photo(&mut dice, &camera, &frame, lit, Some(exposure));
        let forward = camera.forward();
        Some(GeneratedView {
            name,
            camera,
            yaw: (-forward.x).atan2(-forward.z),
            pitch: (-forward.y).clamp(-1.0, 1.0).asin(),
            ids: bytes(&frame.ids),
            depth: frame.depth,
            photo,
        })
    };
    [("1", eyes), ("2", above)].into_iter().filter_map(one).collect()
}

/// The first place with nothing right before the camera, else the one with the least.
fn clear(places: &[DVec3], aim: DVec3, size: ImageSize, instances: &[Instance]) -> Option<Camera> {
    let mut best: Option<(f64, Camera)> = None;
    for eye in places {
        let camera = Camera::looking(size, Intrinsics::from_horizontal_fov(size, LENS), *eye, aim - *eye);
        let small = camera.resized(size.fit_within(TRIAL));
        let frame = render_depth_ids(&small, instances, &RenderOptions::default());
        let near = frame.depth.iter().filter(|z| f64::from(**z) < SHALLOW_M).count() as f64;
        let near = near / frame.depth.len().max(1) as f64;
        if best.as_ref().is_none_or(|(b, _)| near < *b) {
            best = Some((near, camera));
        }
        if near <= SHALLOW_SHARE {
            break;
        }
    }
    best.map(|(_, camera)| camera)
}
