//! Pictures and lines of text about the scene, for questions, files and the report.

use std::sync::Arc;

use glam::DVec3;
use harmony_imaging::sheet::{LabelledBox, LineEnds, draw_boxes, draw_polyline, palette};
use harmony_mesh::{Bounds, Mesh, ShellOptions, room_shell_with};
use harmony_placement::Placed;
use harmony_render::{Instance, Lighting, RenderOptions, mesh_view_camera, render, render_depth_ids, render_window};
use harmony_scene::{Camera, ImageSize, Mask, PixelBox, Pose, Room, Size, Support, Surface};
use image::{DynamicImage, RgbImage, RgbaImage, imageops};

use crate::state::{Candidate, SceneState};

/// Colour of what is outside the room.
const OUTSIDE: [u8; 4] = [235, 238, 242, 255];

/// The room shell with the textures made so far.
pub fn shell(state: &SceneState, omit: Vec<Surface>) -> Mesh {
    let textures = |surface: Surface| state.surfaces.get(&surface).cloned();
    room_shell_with(&state.partial.room, &textures, &ShellOptions { omit, ..ShellOptions::default() })
}

/// What the scene draws, the shell first.
fn instances<'a>(state: &'a SceneState, shell: &'a Mesh) -> Vec<Instance<'a>> {
    let objects = state.partial.placed.iter().filter_map(|placed| {
        let mesh = state.mesh_of(&placed.item.id)?;
        Some(Instance::posed(mesh, &placed.pose, placed.item.index))
    });
    std::iter::once(Instance::in_room(shell, 1)).chain(objects).collect()
}

/// Unlit, 4x multisampled.
const FLAT: RenderOptions =
    RenderOptions { lighting: Lighting::Unlit, multisample: true, background: OUTSIDE, near: 0.05 };

/// A render of the scene from any camera, unlit, 4x multisampled.
pub fn scene_from(state: &SceneState, camera: &Camera, omit: Vec<Surface>) -> RgbImage {
    let shell = shell(state, omit);
    DynamicImage::ImageRgba8(render(camera, &instances(state, &shell), &FLAT).color).to_rgb8()
}

/// The scene from the photo's camera.
#[derive(Debug, Clone)]
pub struct Drawn {
    /// The flat render.
    pub flat: Arc<RgbImage>,
    /// As [`ids`].
    pub ids: Vec<u32>,
}

/// [`flat`] and [`ids`] in one pass.
pub fn drawn(state: &SceneState) -> Drawn {
    let shell = shell(state, Vec::new());
    let frame = render(&state.partial.camera, &instances(state, &shell), &FLAT);
    Drawn { flat: Arc::new(DynamicImage::ImageRgba8(frame.color).to_rgb8()), ids: without_room(frame.ids) }
}

fn without_room(ids: Vec<u32>) -> Vec<u32> {
    ids.into_iter().map(|id| if id == 1 { 0 } else { id }).collect()
}

/// The flat render from the photo's camera.
pub fn flat(state: &SceneState) -> Arc<RgbImage> {
    Arc::new(scene_from(state, &state.partial.camera, Vec::new()))
}

/// [`flat`]; while the room's faces have no textures yet its edges are drawn, so that one sees what stands where.
pub fn with_room(state: &SceneState, flat: Arc<RgbImage>) -> Arc<RgbImage> {
    if !state.surfaces.is_empty() {
        return flat;
    }
    Arc::new(with_room_lines((*flat).clone(), &state.partial.room, &state.partial.camera, false))
}

/// Per pixel the index of the nearest object (0 = room), from the photo's camera.
pub fn ids(state: &SceneState) -> Vec<u32> {
    let shell = shell(state, Vec::new());
    let camera = &state.partial.camera;
    without_room(render_depth_ids(camera, &instances(state, &shell), &RenderOptions::default()).ids)
}

/// The empty room from the photo's camera, its walls labelled.
pub fn empty_room(state: &SceneState) -> Arc<RgbImage> {
    let mut room_only = state.clone();
    room_only.partial.placed.clear();
    let camera = &state.partial.camera;
    let picture = if state.surfaces.is_empty() {
        let shell = shell(&room_only, Vec::new());
        let options = RenderOptions {
            multisample: true,
            lighting: Lighting::HeadLight,
            background: OUTSIDE,
            ..RenderOptions::default()
        };
        DynamicImage::ImageRgba8(render(camera, &[Instance::in_room(&shell, 1)], &options).color).to_rgb8()
    } else {
        scene_from(&room_only, camera, Vec::new())
    };
    Arc::new(if state.surfaces.is_empty() {
        with_room_lines(picture, &state.partial.room, camera, true)
    } else {
        picture
    })
}

/// The photo with the room's edges drawn in.
pub fn layout_overlay(state: &SceneState) -> RgbImage {
    with_room_lines((*state.photo).clone(), &state.partial.room, &state.partial.camera, true)
}

fn with_room_lines(mut picture: RgbImage, room: &Room, camera: &Camera, labels: bool) -> RgbImage {
    let e = room.extents.as_vec();
    let corner = |x: f64, y: f64, z: f64| DVec3::new(x * e.x, y * e.y, z * e.z);
    let edges = [
        (corner(0.0, 0.0, 0.0), corner(1.0, 0.0, 0.0)),
        (corner(0.0, 1.0, 0.0), corner(1.0, 1.0, 0.0)),
        (corner(0.0, 0.0, 0.0), corner(0.0, 1.0, 0.0)),
        (corner(1.0, 0.0, 0.0), corner(1.0, 1.0, 0.0)),
        (corner(0.0, 0.0, 0.0), corner(0.0, 0.0, 1.0)),
        (corner(1.0, 0.0, 0.0), corner(1.0, 0.0, 1.0)),
        (corner(0.0, 1.0, 0.0), corner(0.0, 1.0, 1.0)),
        (corner(1.0, 1.0, 0.0), corner(1.0, 1.0, 1.0)),
    ];
    for (a, b) in edges {
        // Many short pieces: the part behind the camera is left out.
        let points: Vec<[f64; 2]> = (0..=64)
            .filter_map(|k| {
                let p = a.lerp(b, f64::from(k) / 64.0);
                (camera.depth(p) > 0.05).then(|| camera.project(p)).flatten().map(|p| p.to_array())
            })
            .filter(|p| p.iter().all(|v| v.abs() < 1e5))
            .collect();
        if points.len() > 1 {
            picture = draw_polyline(&picture, &points, LineEnds::Open, [255, 60, 60], 2.0);
        }
    }
    if labels {
        let mut boxes = Vec::new();
        for (surface, name) in
            [(Surface::Back, "BACK"), (Surface::Left, "LEFT"), (Surface::Right, "RIGHT"), (Surface::Floor, "FLOOR")]
        {
            if let Some(at) = visible_middle(surface, room, camera) {
                let bounds = PixelBox { x0: at.x - 1.0, y0: at.y - 1.0, x1: at.x + 1.0, y1: at.y + 1.0 };
                boxes.push(LabelledBox { bounds, label: name.to_owned(), color: [255, 60, 60] });
            }
        }
        picture = draw_boxes(&picture, &boxes);
    }
    picture
}

/// Mean pixel of the visible part of a face.
fn visible_middle(surface: Surface, room: &Room, camera: &Camera) -> Option<glam::DVec2> {
    let size = surface.size(&room.extents);
    let mut sum = glam::DVec2::ZERO;
    let mut n = 0.0;
    for i in 0..24 {
        for j in 0..24 {
            let uv = glam::DVec2::new(f64::from(i) + 0.5, f64::from(j) + 0.5) / 24.0 * size;
            let p = surface.point(&room.extents, uv);
            if let Some(pixel) = camera.project(p).filter(|p| camera.contains(*p)) {
                sum += pixel;
                n += 1.0;
            }
        }
    }
    (n > 4.0).then(|| sum / n)
}

/// Photo and render half and half, with the outlines of masks (white) and renders (coloured) and the ids.
pub fn blend(state: &SceneState, drawn: &Drawn) -> Arc<RgbImage> {
    let (render, ids) = (&drawn.flat, &drawn.ids);
    let size = state.partial.camera.size;
    let mut picture = RgbImage::from_fn(size.width, size.height, |x, y| {
        let (a, b) = (state.photo.get_pixel(x, y).0, render.get_pixel(x, y).0);
        image::Rgb([0, 1, 2].map(|k| u16::midpoint(a[k].into(), b[k].into()) as u8))
    });
    let mut boxes = Vec::new();
    for (i, placed) in state.partial.placed.iter().enumerate() {
        let color = palette(i);
        let drawn = Mask::from_fn(size, |x, y| ids[y as usize * size.width as usize + x as usize] == placed.item.index);
        outline(&mut picture, &placed.item.mask, [255, 255, 255]);
        outline(&mut picture, &drawn, color);
        if let Some(bounds) = drawn.bounds().or_else(|| placed.item.mask.bounds()) {
            let c = bounds.centre();
            let bounds = PixelBox { x0: c.x, y0: c.y, x1: c.x + 1.0, y1: c.y + 1.0 };
            boxes.push(LabelledBox { bounds, label: placed.item.id.to_string(), color });
        }
    }
    Arc::new(draw_boxes(&picture, &boxes))
}

fn outline(picture: &mut RgbImage, mask: &Mask, color: [u8; 3]) {
    let edge = mask.minus(&mask.dilated(-1));
    for (pixel, on) in picture.pixels_mut().zip(edge.bits()) {
        if *on {
            pixel.0 = color;
        }
    }
}

/// One of the four yaw panels of a canonical mesh, head-light shaded.
pub fn mesh_view(mesh: &Mesh, yaw_index: usize, px: u32) -> RgbaImage {
    let bounds = mesh.bounds().unwrap_or(Bounds { min: DVec3::splat(-0.5), max: DVec3::splat(0.5) });
    let camera = mesh_view_camera(&bounds, yaw_index, ImageSize::new(px, px));
    let options = RenderOptions {
        multisample: true,
        lighting: Lighting::HeadLight,
        background: [245, 245, 245, 255],
        ..RenderOptions::default()
    };
    render(&camera, &[Instance::in_room(mesh, 1)], &options).color
}

/// The image window around a placed object, with some surroundings.
pub fn window_around(state: &SceneState, index: usize) -> Option<PixelBox> {
    let placed = &state.partial.placed[index];
    let bounds = placed.item.mask.bounds()?;
    Some(bounds.padded(0.6, state.partial.camera.size))
}

/// The photo inside a window.
pub fn photo_window(state: &SceneState, window: PixelBox) -> RgbaImage {
    DynamicImage::ImageRgb8(cut(&state.photo, window)).to_rgba8()
}

fn cut(image: &RgbImage, w: PixelBox) -> RgbImage {
    let (x, y) = (w.x0.floor() as u32, w.y0.floor() as u32);
    let (width, height) = ((w.x1.ceil() as u32 - x).max(1), (w.y1.ceil() as u32 - y).max(1));
    imageops::crop_imm(image, x, y, width, height).to_image()
}

/// The scene inside a window with one object turned.
pub fn turned(state: &SceneState, index: usize, yaw: f64, window: PixelBox) -> RgbaImage {
    let camera = &state.partial.camera;
    let shell = shell(state, Vec::new());
    let mut shown = vec![Instance::in_room(&shell, 1)];
    for (i, placed) in state.partial.placed.iter().enumerate() {
        let mut pose = placed.pose;
        if i == index {
            pose.yaw += yaw;
        } else if !near_window(camera, &placed.item.shape.bounds(), &pose, &window) {
            continue;
        }
        if let Some(mesh) = state.mesh_of(&placed.item.id) {
            shown.push(Instance::posed(mesh, &pose, placed.item.index));
        }
    }
    let part = render_window(camera, &shown, &FLAT, window);
    DynamicImage::ImageRgb8(DynamicImage::ImageRgba8(part.frame.color).to_rgb8()).to_rgba8()
}

/// Whether a posed box can be seen in a window: not when it is before the camera and beside it.
fn near_window(camera: &Camera, bounds: &Bounds, pose: &Pose, window: &PixelBox) -> bool {
    let mut seen = PixelBox { x0: f64::MAX, y0: f64::MAX, x1: f64::MIN, y1: f64::MIN };
    for i in 0..8 {
        let pick = |axis: usize| if i & (1 << axis) == 0 { bounds.min[axis] } else { bounds.max[axis] };
        let corner = pose.point(DVec3::new(pick(0), pick(1), pick(2)));
        let Some(p) = camera.project(corner).filter(|_| camera.depth(corner) > 0.1) else { return true };
        seen = PixelBox { x0: seen.x0.min(p.x), y0: seen.y0.min(p.y), x1: seen.x1.max(p.x), y1: seen.y1.max(p.y) };
    }
    // Two pixels cover the samples beside a pixel's centre.
    seen.x1 >= window.x0 - 2.0 && seen.y1 >= window.y0 - 2.0 && seen.x0 <= window.x1 + 2.0 && seen.y0 <= window.y1 + 2.0
}

/// One line about the room and camera.
pub fn room_line(state: &SceneState) -> String {
    let e = state.partial.room.extents;
    let c = state.partial.camera.centre();
    format!(
        "Room W x D x H = {:.2} x {:.2} x {:.2} m ({}). Camera at x {:.2}, y {:.2}, z {:.2}.",
        e.width, e.depth, e.height, state.partial.room.room_type, c.x, c.y, c.z
    )
}

/// One line about a placed object.
pub fn line(p: &Placed) -> String {
    let (at, s) = (p.pose.position, p.size());
    let on = match &p.support {
        Support::Floor => "on the floor".to_owned(),
        Support::Ceiling => "under the ceiling".to_owned(),
        Support::Wall { wall } => format!("on the {} wall", wall.surface().name()),
        Support::Object { id } => format!("on {id}"),
    };
    let iou = p.evidence.silhouette_iou.map_or(String::new(), |v| format!(", outline agreement {v:.2}"));
    format!(
        "- {}: {}, at ({:.2}, {:.2}, {:.2}), yaw {:.0} deg, size {:.2} x {:.2} x {:.2} m, {on}{iou}",
        p.item.id,
        p.item.label,
        at.x,
        at.y,
        at.z,
        p.pose.yaw.to_degrees(),
        s.width,
        s.height,
        s.depth
    )
}

/// Size that a candidate would have where its mask's bottom meets the floor (or its ray a wall), metres: width and
/// height only. `None` when the ray meets nothing.
pub fn apparent_size(state: &SceneState, c: &Candidate) -> Option<Size> {
    let camera = &state.partial.camera;
    let b = c.mask.bounds()?;
    let foot = glam::DVec2::new(b.centre().x, b.y1);
    let ray = camera.ray(foot);
    let (_, hit) = state.partial.room.extents.exit(&ray)?;
    let depth = camera.depth(hit);
    (depth > 0.1).then(|| Size {
        width: b.width() * depth / camera.intrinsics.fx,
        height: b.height() * depth / camera.intrinsics.fy,
        depth: 0.0,
    })
}
