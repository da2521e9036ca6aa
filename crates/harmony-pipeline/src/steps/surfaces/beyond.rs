//! What the photo shows through a passage, or a window that is no object: a pane where the reveal ends, with the photo's
//! pixels on it.
//!
//! The room behind is not reconstructed; from the photo's place the pane shows what is there, from elsewhere it is a
//! picture in a doorway. What stands before a passage is not on its pane: its place is filled with what is around it.

use std::sync::Arc;

use harmony_imaging::inpaint;
use harmony_mesh::{Group, Material, Mesh};
use harmony_scene::{Camera, Extents, ImageSize, Mask, Opening, Room, Vec2, Vec3, WallPlane};
use image::{DynamicImage, Rgb, RgbImage, RgbaImage};

use crate::state::SceneState;

/// How far behind the wall's face a pane is, metres: where [`harmony_mesh::ShellOptions::reveal`] ends.
const BEHIND: f64 = 0.1;
/// Around an opening's edge its pixels are mixed ones, metres.
const EDGE: f64 = 0.02;
/// Around the photo's empty frame its pixels are mixed ones.
const FRAME_MARGIN: i32 = 3;
/// Texels around what stands before a passage that have its colours mixed in.
const TORN_PX: i32 = 2;
/// Texels a metre.
const PX_PER_M: f64 = 220.0;
/// Sides of a texture, texels.
const SIDE_PX: (f64, f64) = (8.0, 1024.0);

/// An opening with what is seen through it.
#[derive(Debug, Clone)]
pub struct Beyond {
    /// The opening.
    pub opening: Opening,
    /// From its low-u lower end: columns along u, the first row on top.
    pub picture: Arc<RgbaImage>,
}

/// The panes of all openings without an object of a scene of which the photo shows something.
pub fn beyond(state: &SceneState) -> Vec<Beyond> {
    let room = &state.partial.room;
    let bare = room.openings.iter().filter(|o| o.object.is_none());
    bare.filter_map(|o| Some(Beyond { opening: o.clone(), picture: Arc::new(seen_through(state, o)?) })).collect()
}

/// Pixels that look through an opening without an object, with what its edge mixes in.
pub(super) fn pixels(camera: &Camera, room: &Room) -> Mask {
    let bare: Vec<&Opening> = room.openings.iter().filter(|o| o.object.is_none()).collect();
    if bare.is_empty() {
        return Mask::empty(camera.size);
    }
    let faces = room.faces();
    Mask::from_fn(camera.size, |x, y| {
        let ray = camera.ray(Vec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
        let Some(exit) = faces.exit(&ray) else { return false };
        bare.iter().any(|o| {
            let away = o.wall.distance(&room.extents, exit.point) - o.inset;
            let at = o.wall.coordinates(exit.point);
            let within = |range: [f64; 2], v: f64| v > range[0] - EDGE && v < range[1] + EDGE;
            exit.wall() == Some(o.wall) && away.abs() < EDGE && within(o.u, at.x) && within(o.y, at.y)
        })
    })
}

/// The plane of a pane.
fn plane_of(opening: &Opening) -> WallPlane {
    WallPlane { wall: opening.wall, inset: opening.inset - BEHIND }
}

fn seen_through(state: &SceneState, opening: &Opening) -> Option<RgbaImage> {
    let (camera, e) = (&state.partial.camera, &state.partial.room.extents);
    if plane_of(opening).distance(e, camera.centre()) <= 0.0 {
        return None;
    }
    // The empty frame of an undistorted picture shows nothing, and mixes into what is next to it.
    let frame = state.photo_frame.dilated(FRAME_MARGIN);
    let objects =
        state.partial.placed.iter().filter(|p| Some(&p.item.id) != opening.object.as_ref()).map(|p| &*p.item.mask);
    let hidden: Vec<&Mask> = objects.chain([&frame]).collect();
    let length = |range: [f64; 2]| ((range[1] - range[0]) * PX_PER_M).clamp(SIDE_PX.0, SIDE_PX.1).ceil() as u32;
    let (w, h) = (length(opening.u), length(opening.y));
    let sample = |i: u32, j: u32| {
        let pixel =
            pixel_of(camera, e, opening, (f64::from(i) + 0.5) / f64::from(w), (f64::from(j) + 0.5) / f64::from(h))?;
        let free = !hidden.iter().any(|m| m.get(pixel.x as i64, pixel.y as i64));
        free.then(|| state.photo.get_pixel(pixel.x as u32, pixel.y as u32).0)
    };
    let mut picture = RgbImage::new(w, h);
    let mut unseen = Mask::empty(ImageSize::new(w, h));
    for (i, j) in (0..h).flat_map(|j| (0..w).map(move |i| (i, j))) {
        match sample(i, j) {
            Some(color) => picture.put_pixel(i, j, Rgb(color)),
            None => unseen.set(i, j, true),
        }
    }
    if unseen.count() == unseen.size().pixels() {
        return None;
    }
    // Torn edges of what stands before the passage are not copied.
    let torn = unseen.dilated(TORN_PX);
    let hole = if torn.count() < torn.size().pixels() { torn } else { unseen };
    let filled = inpaint::fill(&picture, &hole, inpaint::Sources::Anywhere, &inpaint::FillSettings::default());
    Some(DynamicImage::ImageRgb8(filled).into_rgba8())
}

/// The photo's pixel of a place on the pane, shares of its width and of its height from the top.
fn pixel_of(camera: &Camera, e: &Extents, opening: &Opening, across: f64, down: f64) -> Option<Vec2> {
    let u = opening.u[0] + (opening.u[1] - opening.u[0]) * across;
    let y = opening.y[1] - (opening.y[1] - opening.y[0]) * down;
    camera.project(plane_of(opening).point(e, u, y)).filter(|p| camera.contains(*p))
}

/// The panes as one mesh in the room, a material each, their fronts into the room.
pub fn panes(beyond: &[Beyond], e: &Extents) -> Mesh {
    let mut mesh = Mesh::default();
    for (k, one) in beyond.iter().enumerate() {
        let (plane, [a, b], [low, high]) = (plane_of(&one.opening), one.opening.u, one.opening.y);
        let first = mesh.positions.len() as u32;
        for (u, y, uv) in [(a, low, [0.0, 1.0]), (b, low, [1.0, 1.0]), (b, high, [1.0, 0.0]), (a, high, [0.0, 0.0])] {
            mesh.positions.push(plane.point(e, u, y).as_vec3());
            mesh.normals.push(plane.normal().as_vec3());
            mesh.uvs.push(glam::Vec2::from(uv));
        }
        let along = plane.point(e, 1.0, 0.0) - plane.point(e, 0.0, 0.0);
        let inward = along.cross(Vec3::Y).dot(plane.normal()) > 0.0;
        let fan = |i: u32, j: u32| if inward { [first, first + i, first + j] } else { [first, first + j, first + i] };
        mesh.groups.push(Group { material: mesh.materials.len(), triangles: vec![fan(1, 2), fan(2, 3)] });
        let mut material = Material::plain(&format!("beyond_{:02}", k + 1), [1.0; 3]);
        material.texture = Some(Arc::clone(&one.picture));
        mesh.materials.push(material);
    }
    mesh
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Level, OpeningKind, Support, Wall};
    use image::Rgb;

    use super::*;
    use crate::testing::{add, empty_room};
    use crate::views;

    /// A photo whose pixels say where they are.
    fn state(wall: Wall, u: [f64; 2]) -> SceneState {
        let mut state = empty_room();
        let size = state.partial.camera.size;
        let photo = image::RgbImage::from_fn(size.width, size.height, |x, y| Rgb([(x / 2) as u8, y as u8, 40]));
        state.photo = Arc::new(photo);
        let kind = OpeningKind::Door;
        let passage = Opening { kind, wall, u, y: [0.0, 2.0], inset: 0.0, rise: 0.0, object: None };
        state.partial.room.openings = vec![passage];
        state.beyond = beyond(&state);
        state
    }

    #[test]
    fn a_passage_shows_in_the_render_what_the_photo_shows_there() {
        for (wall, u) in [(Wall::Back, [1.2, 2.2]), (Wall::Left, [1.0, 2.0]), (Wall::Right, [1.0, 2.0])] {
            let state = state(wall, u);
            let drawn = views::drawn(&state).flat;
            let plane = plane_of(&state.partial.room.openings[0]);
            let e = state.partial.room.extents;
            let mut seen = 0;
            for (share, y) in [(0.4, 0.6), (0.5, 1.0), (0.6, 1.5)] {
                let at = plane.point(&e, u[0] + (u[1] - u[0]) * share, y);
                let Some(p) = state.partial.camera.project(at).filter(|p| state.partial.camera.contains(*p)) else {
                    continue;
                };
                let (got, want) =
                    (drawn.get_pixel(p.x as u32, p.y as u32).0, state.photo.get_pixel(p.x as u32, p.y as u32).0);
                assert!((0..3).all(|k| got[k].abs_diff(want[k]) <= 4), "{wall:?}: {got:?} instead of {want:?}");
                seen += 1;
            }
            assert!(seen > 0, "{wall:?}");
        }
    }

    #[test]
    fn the_photos_empty_frame_is_not_seen_through_a_passage() {
        let mut state = state(Wall::Back, [1.2, 2.2]);
        let size = state.partial.camera.size;
        let edge = state.partial.camera.project(Vec3::new(1.5, 1.0, 0.0)).unwrap().x as u32;
        let mut photo = (*state.photo).clone();
        photo.enumerate_pixels_mut().filter(|(x, ..)| *x < edge).for_each(|(.., p)| *p = Rgb([255; 3]));
        state.photo = Arc::new(photo);
        state.photo_frame = Arc::new(Mask::from_fn(size, |x, _| x < edge));
        let shown = beyond(&state).remove(0).picture;
        assert!(shown.pixels().all(|p| p.0[2] == 40), "nothing of the frame");
    }

    #[test]
    fn what_stands_before_a_passage_is_filled_with_what_is_around_it() {
        let mut state = state(Wall::Back, [1.0, 2.4]);
        // Light and dark squares behind it, and a red box before it.
        let size = state.partial.camera.size;
        let id =
            add(&mut state, "box_01", Level::Furniture, Vec3::splat(0.5), Vec3::new(1.7, 0.0, 0.6), Support::Floor);
        let mask = Arc::clone(&state.partial.find(&id).unwrap().item.mask);
        let square = |x: u32, y: u32| if (x / 6 + y / 6).is_multiple_of(2) { 60 } else { 180 };
        let photo = RgbImage::from_fn(size.width, size.height, |x, y| {
            if mask.get(i64::from(x), i64::from(y)) { Rgb([250, 0, 0]) } else { Rgb([square(x, y); 3]) }
        });
        state.photo = Arc::new(photo);
        let shown = beyond(&state).remove(0).picture;
        assert!(shown.pixels().all(|p| p.0[0].abs_diff(p.0[1]) < 40), "nothing of the box");
        // Where it stood the pattern goes on: no row of its place has one colour.
        let (w, h) = shown.dimensions();
        let varied = |j: u32| {
            let row: Vec<u8> = (w / 3..2 * w / 3).map(|i| shown.get_pixel(i, j).0[0]).collect();
            row.iter().max().unwrap() - row.iter().min().unwrap() > 60
        };
        let low: Vec<u32> = (h * 8 / 10..h * 19 / 20).collect();
        assert!(low.iter().filter(|j| varied(**j)).count() * 2 > low.len(), "smeared");
        // Of a passage that is hidden altogether nothing is known.
        state.photo_frame = Arc::new(Mask::from_fn(size, |_, _| true));
        assert!(beyond(&state).is_empty());
    }
}
