//! Pictures and lines of text about the scene, for questions, files and the report.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;
use harmony_imaging::sheet::{LabelledBox, LineEnds, draw_boxes, draw_polyline, draw_tags, palette, ruled_window};
use harmony_mesh::{Bounds, Mesh, ShellOptions, Trims, room_shell_with};
use harmony_placement::{Placed, may_be_seen};
use harmony_prompts::{PlacedObject, RoomSummary};
use harmony_render::{
    Glass, Instance, Lighting, OUTSIDE, RenderOptions, RoomView, canonical_camera, mesh_view_camera, render,
    render_depth_ids, render_window,
};
use harmony_scene::{
    Camera, ImageSize, Intrinsics, Ledge, LedgeTop, Level, ObjectId, PixelBox, Pose, Room, Size, Support, Surface,
    gone_with,
};
use image::{DynamicImage, RgbImage, RgbaImage, imageops};

use crate::state::{Object, SceneState};
use crate::steps::features::Feature;
use crate::steps::surfaces::{Beyond, panes};

/// The room shell with the textures made so far; until then in the colours of the layout answer.
pub fn shell(state: &SceneState, omit: Vec<Surface>) -> Mesh {
    let built: Vec<&Arc<Mesh>> = state.features.iter().filter(|f| !omit.contains(&f.on)).map(Feature::shown).collect();
    let mut shell =
        faces(state, omit, &|surface| state.surfaces.get(&surface).cloned().or_else(|| named(state, surface)));
    for mesh in built {
        shell.append(mesh);
    }
    shell
}

/// The shell as far as no program built it.
pub fn shell_alone(state: &SceneState) -> Mesh {
    faces(state, Vec::new(), &|surface| state.surfaces.get(&surface).cloned())
}

/// A face in the one colour that the layout answer has for it; `None` once faces have textures, and where none was said.
fn named(state: &SceneState, surface: Surface) -> Option<Arc<RgbaImage>> {
    let said = state.layout.answer.surfaces.iter().find(|s| s.surface.surface() == surface);
    let [r, g, b] = said.filter(|_| state.surfaces.is_empty())?.rgb()?;
    Some(Arc::new(RgbaImage::from_pixel(4, 4, image::Rgba([r, g, b, 255]))))
}

/// The room shell for the path tracer: without the photo's light where that could be taken out.
pub fn shell_for_light(state: &SceneState) -> Mesh {
    let mut shell =
        faces(state, Vec::new(), &|s| state.even_surfaces.get(&s).or_else(|| state.surfaces.get(&s)).cloned());
    for feature in &state.features {
        shell.append(&feature.mesh);
    }
    shell
}

/// The room's faces and boards, and what the photo shows through passages.
fn faces(state: &SceneState, omit: Vec<Surface>, textures: &dyn Fn(Surface) -> Option<Arc<RgbaImage>>) -> Mesh {
    let options =
        ShellOptions { omit, trims: state.trims, roughness: state.roughness.clone(), ..ShellOptions::default() };
    let omitted = |o: &Beyond| options.omit.contains(&o.opening.wall.surface());
    let beyond: Vec<Beyond> = state.beyond.iter().filter(|o| !omitted(o)).cloned().collect();
    let mut shell = room_shell_with(&state.partial.room, textures, &options);
    if !beyond.is_empty() {
        shell.append(&panes(&beyond, &state.partial.room.extents));
    }
    shell
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
///
/// Ids stay those of the nearest surface, of glass too: they tell whose pixels a photo's are, and what is seen through a
/// glass table has not its own colours.
const FLAT: RenderOptions = RenderOptions {
    lighting: Lighting::Unlit,
    multisample: true,
    background: OUTSIDE,
    near: 0.05,
    glass: Glass::Solid,
};

/// A render of the scene from any camera, unlit, 4x multisampled. What is fixed to a face that is left out goes with it
/// ([`gone_with`]).
pub fn scene_from(state: &SceneState, camera: &Camera, omit: Vec<Surface>) -> RgbImage {
    let gone = gone(state, &omit);
    let hidden: Vec<u32> =
        state.partial.placed.iter().filter(|p| gone.contains(&p.item.id)).map(|p| p.item.index).collect();
    let shell = shell(state, omit);
    // The first is the room.
    let shown = instances(state, &shell).into_iter().enumerate().filter(|(k, i)| *k == 0 || !hidden.contains(&i.id));
    let shown: Vec<Instance<'_>> = shown.map(|(_, instance)| instance).collect();
    DynamicImage::ImageRgba8(render(camera, &shown, &FLAT).color).to_rgb8()
}

/// Nodes of the scene's file that a camera outside the room does not see: the faces left out, and what goes with them.
/// `nodes` are the names of all, for what is built into those faces.
pub fn hidden_nodes<'n>(
    omit: &[Surface],
    gone: &BTreeSet<&'n ObjectId>,
    nodes: impl Iterator<Item = &'n str>,
) -> Vec<String> {
    let faces = omit.iter().map(|s| harmony_mesh::shell_material_name(*s));
    let built = nodes.filter(|node| omit.iter().any(|face| node.starts_with(&built_into(*face))));
    faces.chain(gone.iter().map(|id| id.as_str())).chain(built).map(str::to_owned).collect()
}

/// How the names of nodes begin that are built into a face.
pub fn built_into(face: Surface) -> String {
    format!("feature_{}_", face.name())
}

/// The bounds of a placed thing, room frame.
pub fn bounds_of(placed: &Placed) -> Bounds {
    let own = placed.item.shape.bounds();
    let corners = (0..8).map(|i| {
        let pick = |bit: usize| if i & bit == 0 { own.min } else { own.max };
        placed.pose.point(DVec3::new(pick(1).x, pick(2).y, pick(4).z))
    });
    let (min, max) = corners.fold((DVec3::MAX, DVec3::MIN), |(low, high), p| (low.min(p), high.max(p)));
    Bounds { min, max }
}

/// Objects that go with faces left out of a view.
pub fn gone<'s>(state: &'s SceneState, omit: &[Surface]) -> BTreeSet<&'s ObjectId> {
    let partial = &state.partial;
    let held = partial.placed.iter().map(|p| (&p.item.id, &p.support, p.pose.position.y));
    gone_with(omit, partial.room.extents.height, held)
}

/// The scene from the photo's camera.
#[derive(Debug, Clone)]
pub struct Drawn {
    /// The flat render.
    pub flat: Arc<RgbImage>,
    /// As [`ids`].
    pub ids: Arc<[u32]>,
}

/// The scene as it was drawn last, shared by the copies of a state: a review, a level's files and the next question
/// mostly show the same.
#[derive(Debug, Clone, Default)]
pub struct Gallery(Arc<Mutex<Option<(Shown, Drawn)>>>);

/// Everything that [`Drawn`] depends on.
#[derive(Debug)]
struct Shown {
    camera: Camera,
    room: Room,
    surfaces: Vec<(Surface, Arc<RgbaImage>)>,
    trims: Trims,
    beyond: Vec<Arc<RgbaImage>>,
    features: Vec<Arc<Mesh>>,
    objects: Vec<(u32, Pose, Arc<Mesh>)>,
}

impl Shown {
    fn of(state: &SceneState) -> Self {
        let objects =
            state.partial.placed.iter().filter_map(|placed| {
                Some((placed.item.index, placed.pose, Arc::clone(state.mesh_of(&placed.item.id)?)))
            });
        Self {
            camera: state.partial.camera,
            room: state.partial.room.clone(),
            trims: state.trims,
            features: state.features.iter().map(|f| Arc::clone(f.shown())).collect(),
            beyond: state.beyond.iter().map(|b| Arc::clone(&b.picture)).collect(),
            surfaces: state.surfaces.iter().map(|(surface, texture)| (*surface, Arc::clone(texture))).collect(),
            objects: objects.collect(),
        }
    }

    /// Meshes and textures are compared by where they lie: they never change once they are shared.
    fn is(&self, other: &Self) -> bool {
        self.camera == other.camera
            && self.room == other.room
            && self.trims == other.trims
            && self.features.len() == other.features.len()
            && self.features.iter().zip(&other.features).all(|(a, b)| Arc::ptr_eq(a, b))
            && self.beyond.len() == other.beyond.len()
            && self.beyond.iter().zip(&other.beyond).all(|(a, b)| Arc::ptr_eq(a, b))
            && self.surfaces.len() == other.surfaces.len()
            && self.surfaces.iter().zip(&other.surfaces).all(|(a, b)| a.0 == b.0 && Arc::ptr_eq(&a.1, &b.1))
            && self.objects.len() == other.objects.len()
            && self.objects.iter().zip(&other.objects).all(|(a, b)| (a.0, a.1) == (b.0, b.1) && Arc::ptr_eq(&a.2, &b.2))
    }
}

impl Gallery {
    fn find(&self, shown: &Shown) -> Option<Drawn> {
        let last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        last.as_ref().filter(|(what, _)| what.is(shown)).map(|(_, drawn)| drawn.clone())
    }

    fn keep(&self, shown: Shown, drawn: &Drawn) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((shown, drawn.clone()));
    }
}

/// [`flat`] and [`ids`] in one pass.
pub fn drawn(state: &SceneState) -> Drawn {
    let shown = Shown::of(state);
    if let Some(drawn) = state.drawn.find(&shown) {
        return drawn;
    }
    let shell = shell(state, Vec::new());
    let frame = render(&state.partial.camera, &instances(state, &shell), &FLAT);
    let flat = Arc::new(DynamicImage::ImageRgba8(frame.color).to_rgb8());
    let drawn = Drawn { flat, ids: without_room(frame.ids) };
    state.drawn.keep(shown, &drawn);
    drawn
}

fn without_room(ids: Vec<u32>) -> Arc<[u32]> {
    ids.into_iter().map(|id| if id == 1 { 0 } else { id }).collect()
}

/// The flat render from the photo's camera.
pub fn flat(state: &SceneState) -> Arc<RgbImage> {
    drawn(state).flat
}

/// [`flat`]; while the room's faces have no textures yet its edges are drawn behind what stands in it, so that one sees what
/// stands where.
pub fn with_room(state: &SceneState, flat: Arc<RgbImage>) -> Arc<RgbImage> {
    if !state.surfaces.is_empty() {
        return flat;
    }
    let mut lined = with_room_lines((*flat).clone(), &state.partial.room, &state.partial.camera, false);
    for ((pixel, id), before) in lined.pixels_mut().zip(&*ids(state)).zip(flat.pixels()) {
        if *id != 0 {
            *pixel = *before;
        }
    }
    Arc::new(lined)
}

/// Per pixel the index of the nearest object (0 = room), from the photo's camera.
pub fn ids(state: &SceneState) -> Arc<[u32]> {
    if let Some(drawn) = state.drawn.find(&Shown::of(state)) {
        return drawn.ids;
    }
    let shell = shell(state, Vec::new());
    let camera = &state.partial.camera;
    without_room(render_depth_ids(camera, &instances(state, &shell), &RenderOptions::default()).ids)
}

/// The elevated view of the scene.
pub fn canonical(state: &SceneState, size: ImageSize) -> RoomView {
    let things: Vec<(Pose, Size)> = state.partial.placed.iter().map(|p| (p.pose, p.size())).collect();
    canonical_camera(&state.partial.room, size, &state.partial.camera, &things)
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
    let edges = room_lines(room);
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

/// The edges of the room that lie before the front wall: where two of its faces meet at an angle.
fn room_lines(room: &Room) -> Vec<(DVec3, DVec3)> {
    let faces = room.all_faces();
    let mut sides: BTreeMap<[[i64; 3]; 2], (DVec3, DVec3, Vec<DVec3>)> = BTreeMap::new();
    for face in &faces {
        let n = face.polygon.len();
        for i in 0..n {
            let (a, b) = (face.polygon[i], face.polygon[(i + 1) % n]);
            let key = |p: DVec3| (p * 1e4).round().to_array().map(|c| c as i64);
            let mut ends = [key(a), key(b)];
            ends.sort_unstable();
            sides.entry(ends).or_insert_with(|| (a, b, Vec::new())).2.push(face.normal);
        }
    }
    let front = |p: DVec3| p.z >= room.extents.depth - 1e-6;
    sides
        .into_values()
        .filter(|(a, b, normals)| {
            let flat = normals.windows(2).any(|n| n[0].dot(n[1]) > 0.999);
            !(flat || front(*a) && front(*b))
        })
        .map(|(a, b, _)| (a, b))
        .collect()
}

/// Mean pixel of the visible part of a face.
fn visible_middle(surface: Surface, room: &Room, camera: &Camera) -> Option<glam::DVec2> {
    let size = surface.size(&room.extents);
    let faces = room.faces();
    let mut sum = glam::DVec2::ZERO;
    let mut n = 0.0;
    for i in 0..24 {
        for j in 0..24 {
            let uv = glam::DVec2::new(f64::from(i) + 0.5, f64::from(j) + 0.5) / 24.0 * size;
            let p = faces.point(surface, uv).0;
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
    let windows = windows_of(ids, size);
    let mut boxes = Vec::new();
    for (i, placed) in state.partial.placed.iter().enumerate() {
        let color = palette(i);
        let (index, mask) = (placed.item.index, &placed.item.mask);
        let (drawn_in, seen_in) = (windows.get(&index).copied(), mask.bounds());
        let own = |x: usize, y: usize| ids[y * size.width as usize + x] == index;
        outline(&mut picture, seen_in, [255, 255, 255], |x, y| mask.get(x as i64, y as i64));
        outline(&mut picture, drawn_in, color, own);
        if let Some(bounds) = drawn_in.or(seen_in) {
            boxes.push(LabelledBox { bounds, label: placed.item.id.to_string(), color });
        }
    }
    draw_tags(&mut picture, &boxes);
    Arc::new(picture)
}

/// The tight box of each id in an image of ids.
fn windows_of(ids: &[u32], size: ImageSize) -> BTreeMap<u32, PixelBox> {
    let mut windows: BTreeMap<u32, PixelBox> = BTreeMap::new();
    for (y, row) in ids.chunks_exact(size.width.max(1) as usize).enumerate() {
        let mut x = 0;
        for run in row.chunk_by(|a, b| a == b) {
            let (x0, x1, y0, y1) = (x as f64, (x + run.len()) as f64, y as f64, y as f64 + 1.0);
            x += run.len();
            let window = windows.entry(run[0]).or_insert(PixelBox { x0, y0, x1, y1 });
            *window = PixelBox { x0: window.x0.min(x0), y0: window.y0, x1: window.x1.max(x1), y1 };
        }
    }
    windows
}

/// Colours the set pixels that have one beside them, or across a corner, that is not set. All set ones lie in `window`.
fn outline(picture: &mut RgbImage, window: Option<PixelBox>, color: [u8; 3], set: impl Fn(usize, usize) -> bool) {
    let Some(window) = window else { return };
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    for y in window.y0 as usize..(window.y1 as usize).min(height) {
        for x in window.x0 as usize..(window.x1 as usize).min(width) {
            let mut around = (y.saturating_sub(1)..(y + 2).min(height))
                .flat_map(|v| (x.saturating_sub(1)..(x + 2).min(width)).map(move |u| (u, v)));
            if set(x, y) && around.any(|(u, v)| !set(u, v)) {
                picture.put_pixel(x as u32, y as u32, image::Rgb(color));
            }
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

/// Two cameras inside the room where the photo was not taken: at its height mirrored to the room's other side, and from
/// under the ceiling behind it; both look at the middle of what the photo sees.
pub fn inner_cameras(room: &Room, photo: &Camera, size: ImageSize) -> Vec<Camera> {
    let e = room.extents.as_vec();
    let (at, ahead) = (photo.centre(), photo.forward());
    let reach = (0.5 * e.x.max(e.z)).min(2.5);
    let level = DVec3::new(ahead.x, 0.0, ahead.z).normalize_or(-DVec3::Z);
    let target = (at + level * reach).clamp(DVec3::splat(0.3), e - DVec3::splat(0.3));
    // Towards the photo's own place until it is free all around.
    let inside = |p: DVec3| {
        let p = p.clamp(DVec3::splat(0.25), e - DVec3::splat(0.25));
        let free = |q: &DVec3| Surface::ALL.iter().all(|s| room.is_free(*q - s.normal() * 0.2));
        (0..=10).map(|k| p.lerp(at, f64::from(k) / 10.0)).find(free).unwrap_or(p)
    };
    let right = level.cross(DVec3::Y);
    // To the side on which there is more room.
    let space = |side: DVec3| inside(at + side * 1.4).distance(at);
    let side = if space(right) >= space(-right) { right } else { -right };
    let beside = inside(at + side * 1.4 + level * 0.3);
    let above = inside(DVec3::new(at.x, e.y - 0.3, at.z) - side * 0.6);
    let low = DVec3::new(target.x, 0.5, target.z);
    let intrinsics = Intrinsics::from_horizontal_fov(size, 1.25);
    [(beside, low), (above, low)]
        .into_iter()
        .map(|(from, to)| Camera::looking(size, intrinsics, from, (to - from).normalize_or(-DVec3::Z)))
        .collect()
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

/// A window of a picture.
pub fn cut(image: &RgbImage, w: PixelBox) -> RgbImage {
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
        } else if !may_be_seen(camera, &placed.item.shape.bounds(), &pose, &window) {
            continue;
        }
        if let Some(mesh) = state.mesh_of(&placed.item.id) {
            shown.push(Instance::posed(mesh, &pose, placed.item.index));
        }
    }
    let part = render_window(camera, &shown, &FLAT, window);
    DynamicImage::ImageRgb8(DynamicImage::ImageRgba8(part.frame.color).to_rgb8()).to_rgba8()
}

/// A placed object alone in a window of the photo's camera, without the photo's pixels, head-light shaded.
pub fn alone(state: &SceneState, index: usize, window: PixelBox) -> Option<RgbImage> {
    let placed = &state.partial.placed[index];
    let model = state.objects.get(&placed.item.id)?.model.as_ref()?;
    let shown = [Instance::posed(&model.mesh, &placed.pose, placed.item.index)];
    let options = RenderOptions { lighting: Lighting::HeadLight, background: [245, 245, 245, 255], ..FLAT };
    let part = render_window(&state.partial.camera, &shown, &options, window);
    Some(DynamicImage::ImageRgba8(part.frame.color).to_rgb8())
}

/// The scene from the photo's camera with boxes and ids of some objects.
pub fn marked(state: &SceneState, marked: impl Fn(&harmony_scene::ObjectId) -> bool) -> RgbImage {
    let drawn = drawn(state);
    let windows = windows_of(&drawn.ids, state.partial.camera.size);
    let shown = state.partial.placed.iter().enumerate().filter(|(_, p)| marked(&p.item.id));
    let boxes: Vec<LabelledBox> = shown
        .filter_map(|(i, p)| {
            let bounds = windows.get(&p.item.index).copied().or_else(|| p.item.mask.bounds())?;
            Some(LabelledBox { bounds, label: p.item.id.to_string(), color: palette(i) })
        })
        .collect();
    draw_boxes(&drawn.flat, &boxes)
}

/// Longest side of a ruled picture, pixels.
const RULED_PX: u32 = 1200;

/// A picture of the photo's size with thousandths along its border.
pub fn ruled(picture: &RgbImage) -> RgbImage {
    let (width, height) = picture.dimensions();
    let whole = PixelBox { x0: 0.0, y0: 0.0, x1: f64::from(width), y1: f64::from(height) };
    ruled_window(picture, whole, RULED_PX)
}

/// A box in thousandths of a photo, in pixels within it.
pub fn pixels(size: ImageSize, [x0, y0, x1, y1]: [f64; 4]) -> PixelBox {
    let (kx, ky) = (f64::from(size.width) / 1000.0, f64::from(size.height) / 1000.0);
    PixelBox { x0: x0 * kx, y0: y0 * ky, x1: x1 * kx, y1: y1 * ky }.clamped(size)
}

/// The inverse of [`pixels`].
pub fn thousandths(size: ImageSize, b: &PixelBox) -> [f64; 4] {
    let (width, height) = (f64::from(size.width), f64::from(size.height));
    [b.x0 * 1000.0 / width, b.y0 * 1000.0 / height, b.x1 * 1000.0 / width, b.y1 * 1000.0 / height]
}

/// The room and the camera in it, for questions.
pub fn room_summary(state: &SceneState) -> RoomSummary {
    RoomSummary {
        extents: state.partial.room.extents,
        room_type: state.partial.room.room_type.clone(),
        camera: state.partial.camera.centre().to_array(),
        shape: state.partial.room.shape.clone(),
    }
}

/// A placed object, for questions.
pub fn placed_object(p: &Placed) -> PlacedObject {
    PlacedObject {
        id: p.item.id.clone(),
        label: p.item.label.clone(),
        level: p.item.level,
        seen: p.item.mask.bounds(),
        position: p.pose.position.to_array(),
        yaw_deg: half_turn(p.pose.yaw.to_degrees()),
        size: p.size(),
        support: p.support.clone(),
        outline_agreement: p.evidence.silhouette_iou,
    }
}

/// The parts of the room on which things can stand, for questions: they are hosts like objects, but nothing moves them.
pub fn ledges(state: &SceneState) -> Vec<PlacedObject> {
    let row = |(ledge, top): (Ledge, LedgeTop<'_>)| {
        let [low, high] = top.area;
        let (middle, sides) = ((low + high) / 2.0, high - low);
        PlacedObject {
            id: ledge.id(),
            label: format!("{}, part of the room", top.kind),
            level: Level::Furniture,
            seen: None,
            position: [middle.x, top.span[0], middle.y],
            yaw_deg: 0.0,
            size: Size { width: sides.x, height: top.span[1] - top.span[0], depth: sides.y },
            support: Support::Floor,
            outline_agreement: None,
        }
    };
    state.partial.room.ledges().map(row).collect()
}

/// An angle as people write it, degrees: above -180, at most 180.
fn half_turn(degrees: f64) -> f64 {
    if degrees > -180.0 && degrees <= 180.0 { degrees } else { 180.0 - (180.0 - degrees).rem_euclid(360.0) }
}

/// Size that an object would have where its mask's bottom meets the floor (or its ray a wall), metres: width and
/// height only. `None` when the ray meets nothing.
pub fn apparent_size(state: &SceneState, c: &Object) -> Option<Size> {
    let camera = &state.partial.camera;
    let b = c.mask.bounds()?;
    let foot = glam::DVec2::new(b.centre().x, b.y1);
    let ray = camera.ray(foot);
    let hit = state.partial.room.faces().exit(&ray)?.point;
    let depth = camera.depth(hit);
    (depth > 0.1).then(|| Size {
        width: b.width() * depth / camera.intrinsics.fx,
        height: b.height() * depth / camera.intrinsics.fy,
        depth: 0.0,
    })
}

#[cfg(test)]
mod tests {
    use harmony_scene::Mask;

    use super::*;

    #[test]
    fn thousandths_are_of_the_photo() {
        let size = ImageSize::new(320, 240);
        let b = pixels(size, [0.0, 500.0, 250.0, 1200.0]);
        assert_eq!([b.x0, b.y0, b.x1, b.y1], [0.0, 120.0, 80.0, 240.0]);
        assert_eq!(thousandths(size, &b), [0.0, 500.0, 250.0, 1000.0]);
    }

    #[test]
    fn an_outline_is_what_erosion_takes_away() {
        let size = ImageSize::new(40, 30);
        // A disc that the border cuts, and a dot; each with its own id.
        let shapes = [(5.0, 12.0, 9.0), (30.0, 20.0, 0.6)];
        let inside = |i: usize, x: f64, y: f64| (x - shapes[i].0).hypot(y - shapes[i].1) < shapes[i].2;
        let ids: Vec<u32> = (0..size.pixels())
            .map(|k| {
                let (x, y) = ((k % 40) as f64, (k / 40) as f64);
                if inside(0, x, y) { 10 } else { 11 * u32::from(inside(1, x, y)) }
            })
            .collect();
        let windows = windows_of(&ids, size);
        for id in [10, 11] {
            let mask = Mask::from_fn(size, |x, y| ids[y as usize * 40 + x as usize] == id);
            assert_eq!(windows.get(&id).copied(), mask.bounds());
            let edge = mask.minus(&mask.dilated(-1));
            assert!(edge.count() > 0);
            let mut picture = RgbImage::new(40, 30);
            outline(&mut picture, mask.bounds(), [9; 3], |x, y| ids[y * 40 + x] == id);
            for (pixel, on) in picture.pixels().zip(edge.bits()) {
                assert_eq!(pixel.0 == [9; 3], *on);
            }
        }
        assert_eq!(windows.get(&12), None);
    }
}
