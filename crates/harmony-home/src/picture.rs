//! The canonical view of a home: elevated, ceilings and all walls that would be seen from behind left out.

use glam::{DMat3, DVec3};
use harmony_export::World;
use harmony_export::world::{Face, Item};
use harmony_mesh::is_left_out;
use harmony_render::{Instance, OUTSIDE, RenderOptions, canonical_camera, render};
use harmony_scene::{Camera, ImageSize, Intrinsics, Level, OpeningKind, SceneObject, Support, Surface};
use image::{DynamicImage, RgbImage};

use crate::merge::Merged;

/// Horizontal field of view, radians: as the canonical views of rooms.
const FOV: f64 = 0.7;
/// Elevation above the horizon, radians: higher than that of one room, for walls of near rooms stand before far ones.
const ELEVATION: f64 = 1.05;
/// Azimuth, radians: a little from the right.
const AZIMUTH: f64 = 0.3;
/// Share of the picture that stays free on each side.
const MARGIN: f64 = 0.04;

/// The nearest camera of these angles that has all of a box in its picture, the box in the middle.
fn camera(size: ImageSize, extents: DVec3) -> Camera {
    let lens = Intrinsics::from_horizontal_fov(size, FOV);
    let out = DVec3::new(AZIMUTH.sin() * ELEVATION.cos(), ELEVATION.sin(), AZIMUTH.cos() * ELEVATION.cos());
    let corners: Vec<DVec3> = (0..8)
        .map(|i| extents * DVec3::new(f64::from(i & 1), f64::from((i >> 1) & 1), f64::from((i >> 2) & 1)))
        .collect();
    let mut target = extents / 2.0;
    let mut camera = Camera::looking(size, lens, target + out, -out);
    for _ in 0..8 {
        let probe = Camera::looking(size, lens, target, -out);
        let half = 0.5 - MARGIN;
        let (tx, ty) = (half * f64::from(size.width) / lens.fx, half * f64::from(size.height) / lens.fy);
        let away = corners.iter().map(|c| {
            let p = probe.to_camera(*c);
            (p.x.abs() / tx - p.z).max(p.y.abs() / ty - p.z)
        });
        let distance = away.fold(0.1, f64::max);
        camera = Camera::looking(size, lens, target + out * distance, -out);
        let seen = corners.iter().filter_map(|c| camera.project(*c));
        let (low, high) =
            seen.fold((glam::DVec2::INFINITY, glam::DVec2::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        let off = (low + high) / 2.0 - glam::DVec2::new(lens.cx, lens.cy);
        target += camera.right() * (off.x * distance / lens.fx) + camera.down() * (off.y * distance / lens.fy);
    }
    camera
}

/// The view, in even light.
pub fn canonical(merged: &Merged, size: ImageSize) -> RgbImage {
    let camera = camera(size, merged.world.scene.room.extents.as_vec());
    let eye = camera.centre();
    let hidden: Vec<&str> = merged
        .sides
        .iter()
        .filter(|(_, side, at)| *side == Surface::Ceiling || (eye - *at).dot(side.normal()) <= 0.0)
        .map(|(name, ..)| name.as_str())
        .collect();
    // What hangs on a wall that is left out, or under a ceiling, would float.
    // A door stays: its wall is seen from the other side.
    let floats = |object: &SceneObject| match object.support {
        Support::Wall { wall } if !is_door(&object.label) => {
            wall.normal().dot(eye - merged.world.scene.room.extents.as_vec() / 2.0) < 0.0
        }
        _ => false,
    };
    let faces = merged.world.shell.iter().filter(|f| !is_left_out(&f.name, &hidden));
    let items = merged.world.items.iter().filter(|i| i.object.level != Level::Ceiling && !floats(&i.object));
    drawn(&camera, faces, items)
}

/// Whether a label names what fills a door of a room.
fn is_door(label: &str) -> bool {
    harmony_catalogue::opening(label) == Some(OpeningKind::Door)
}

/// A room in the canonical view of runs.
pub fn of_room(world: &World) -> RgbImage {
    let view = canonical_camera(&world.scene.room, ImageSize::new(1280, 960), &world.camera, &world.scene.stands());
    let hidden: Vec<&str> = view.omit.iter().map(|s| harmony_mesh::shell_material_name(*s)).collect();
    drawn(&view.camera, world.shell.iter().filter(|f| !is_left_out(&f.name, &hidden)), world.items.iter())
}

fn drawn<'a>(
    camera: &Camera,
    faces: impl Iterator<Item = &'a Face>,
    items: impl Iterator<Item = &'a Item>,
) -> RgbImage {
    let mut instances: Vec<Instance<'_>> = faces.map(|f| Instance::in_room(&f.mesh, 0)).collect();
    instances.extend(items.map(|item| Instance {
        mesh: &item.mesh,
        linear: DMat3::from_rotation_y(item.object.pose.yaw)
            * DMat3::from_diagonal(item.object.pose.stretch * item.object.pose.scale),
        translation: item.object.pose.position,
        id: 0,
    }));
    let options = RenderOptions { multisample: true, background: OUTSIDE, ..RenderOptions::default() };
    DynamicImage::ImageRgba8(render(camera, &instances, &options).color).to_rgb8()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doors_of_rooms_are_doors_and_those_of_cupboards_are_not() {
        for (label, door) in
            [("interior door", true), ("French doors", true), ("cabinet door", false), ("doorbell", false)]
        {
            assert_eq!(is_door(label), door, "{label}");
        }
    }
}
