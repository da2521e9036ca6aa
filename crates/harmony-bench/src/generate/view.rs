//! The photographer: a camera in the front of the room from which much is seen.

use glam::DVec3;
use harmony_mesh::Mesh;
use harmony_render::{Instance, RenderOptions, render_depth_ids};
use harmony_scene::{Camera, ImageSize, Intrinsics};

use super::dice::Dice;
use super::layout::{Level, Plan};

/// How many cameras are tried.
const TRIES: usize = 12;
/// Width of the trial pictures, pixels.
const TRIAL: u32 = 192;
/// Air around the camera in rooms that are no boxes, metres; less than what it keeps from the walls of a box.
const AIR: f64 = 0.1;
/// What a feature of the room's shape is worth, in objects.
const FEATURE: f64 = 6.0;
/// Share of a feature's points that is enough of it.
const FEATURE_SHARE: f64 = 0.3;

/// A camera with the angles it was made from.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    pub(super) camera: Camera,
    /// Left positive, radians.
    pub(super) yaw: f64,
    /// Down positive, radians.
    pub(super) pitch: f64,
    /// Objects with more than about 500 pixels at full size.
    pub(super) seen: usize,
    /// Doors with as many.
    pub(super) doors: usize,
    /// Features of the room's shape of which it shows enough.
    pub(super) features: usize,
}

/// The best of some cameras; `instances` are the shell and then the objects with ids from 10 on.
pub(super) fn choose(
    dice: &mut Dice,
    plan: &Plan,
    size: ImageSize,
    instances: &[Instance],
    must_show_doors: bool,
) -> Option<View> {
    let mut best: Option<(f64, View)> = None;
    for _ in 0..TRIES {
        let Some(mut view) = candidate(dice, plan, size) else { continue };
        let Judged { score, seen, doors, features } = judge(&view.camera, plan, instances);
        (view.seen, view.doors, view.features) = (seen, doors, features);
        // Whoever photographs a home sees to it that its doors are in the pictures.
        let worth = if must_show_doors { 30.0 * doors as f64 } else { 0.0 };
        let score = score + worth + dice.range(0.0, 1.5);
        if best.as_ref().is_none_or(|(s, _)| score > *s) {
            best = Some((score, view));
        }
    }
    best.map(|(_, view)| view)
}

fn candidate(dice: &mut Dice, plan: &Plan, size: ImageSize) -> Option<View> {
    let e = plan.extents;
    let eye = DVec3::new(
        e.width * dice.range(0.15, 0.85),
        dice.range(1.2, 1.75),
        e.depth - dice.range(0.12, (e.depth * 0.25).min(0.9)),
    );
    let near = |i: &super::layout::Item| {
        let [low, high] = i.heights();
        let r = i.piece.size.x.hypot(i.piece.size.z) / 2.0 + 0.3;
        let flat = DVec3::new(i.position.x - eye.x, 0.0, i.position.z - eye.z).length();
        i.level != Level::Ceiling && low < eye.y + 0.15 && high > eye.y - 0.5 && flat < r
    };
    if plan.items.iter().any(near) || !plan.is_free_around(eye, AIR) {
        return None;
    }
    let wide = e.width > 1.35 * e.depth && dice.chance(0.7);
    let hfov = dice.range(60.0, if wide { 66.0 } else { 90.0 }).to_radians();
    let aim =
        DVec3::new(if wide { eye.x } else { e.width * dice.range(0.3, 0.7) }, 0.0, e.depth * dice.range(0.15, 0.4))
            - eye;
    let limit = 38.0_f64.to_radians();
    let yaw = ((-aim.x).atan2(-aim.z) + dice.bell() * if wide { 0.04 } else { 0.1 }).clamp(-limit, limit);
    let pitch = dice.range(0.0, 18.0).to_radians();
    let forward = DVec3::new(-yaw.sin() * pitch.cos(), -pitch.sin(), -yaw.cos() * pitch.cos());
    let camera = Camera::looking(size, Intrinsics::from_horizontal_fov(size, hfov), eye, forward);
    Some(View { camera, yaw, pitch, seen: 0, doors: 0, features: 0 })
}

/// What a camera is worth.
struct Judged {
    score: f64,
    seen: usize,
    doors: usize,
    features: usize,
}

/// Counts the objects and features in view; a picture filled by one thing is a poor one.
fn judge(camera: &Camera, plan: &Plan, instances: &[Instance]) -> Judged {
    let small = camera.resized(ImageSize::new(TRIAL, TRIAL * camera.size.height / camera.size.width));
    let frame = render_depth_ids(&small, instances, &RenderOptions::default());
    let mut count = [0_usize; 256];
    frame.ids.iter().for_each(|id| count[(*id as usize).min(255)] += 1);
    let pixels = small.size.pixels();
    let full = f64::from(camera.size.width) / f64::from(TRIAL);
    let enough = (500.0 / (full * full)).ceil() as usize;
    let seen = count[10..].iter().filter(|c| **c > enough).count();
    let largest = count[10..].iter().max().copied().unwrap_or(0) as f64 / pixels as f64;
    let shallow = frame.depth.iter().filter(|z| **z < 0.6).count() as f64 / pixels as f64;
    let doors = plan.holes.iter().filter(|h| h.door && count[(h.item + 10).min(255)] > enough).count();
    let features = plan.form.marks.iter().filter(|marks| shows(&small, &frame.depth, marks)).count();
    let worth = seen as f64 + FEATURE * features as f64;
    Judged { score: worth - 20.0 * (largest - 0.35).max(0.0) - 25.0 * shallow, seen, doors, features }
}

/// Whether a camera shows enough of a feature's points, with nothing before them.
fn shows(camera: &Camera, depth: &[f32], marks: &[DVec3]) -> bool {
    let seen = marks.iter().filter(|mark| {
        let Some(pixel) = camera.project(**mark).filter(|p| camera.contains(*p)) else { return false };
        let z = f64::from(depth[pixel.y as usize * camera.size.width as usize + pixel.x as usize]);
        z > camera.depth(**mark) * 0.97 - 0.05
    });
    seen.count() as f64 >= FEATURE_SHARE * marks.len() as f64
}

/// Ids of the objects that a camera shows with more than about 500 pixels at full size.
pub(super) fn shown(camera: &Camera, instances: &[Instance]) -> std::collections::BTreeSet<u32> {
    let small = camera.resized(ImageSize::new(TRIAL, TRIAL * camera.size.height / camera.size.width));
    let frame = render_depth_ids(&small, instances, &RenderOptions::default());
    let mut count = std::collections::BTreeMap::new();
    frame.ids.iter().filter(|id| **id >= 10).for_each(|id| *count.entry(*id).or_insert(0_usize) += 1);
    let full = f64::from(camera.size.width) / f64::from(TRIAL);
    let enough = (500.0 / (full * full)).ceil() as usize;
    count.into_iter().filter(|(_, n)| *n > enough).map(|(id, _)| id).collect()
}

/// Meshes in the room, as the renderer wants them.
pub(super) fn instances<'a>(shell: &'a [(u8, Mesh)], plan: &'a Plan) -> Vec<Instance<'a>> {
    let mut out: Vec<Instance> = shell.iter().map(|(id, mesh)| Instance::in_room(mesh, u32::from(*id))).collect();
    out.extend(plan.items.iter().enumerate().map(|(k, item)| Instance {
        mesh: &item.piece.mesh,
        linear: glam::DMat3::from_rotation_y(item.yaw),
        translation: item.position,
        id: k as u32 + 10,
    }));
    out
}
