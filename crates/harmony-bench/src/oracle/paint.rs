//! Paint for the oracle's meshes: what the photo shows of an object, on its true surface.

use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};
use harmony_mesh::Mesh;
use harmony_scene::OpeningKind;
use image::{RgbImage, Rgba, RgbaImage};

use super::atlas::{texels, unwrapped};
use crate::truth::{TruthObject, TruthRoom};

/// Depths that differ less are one surface, metres.
const NEAR_M: f64 = 0.015;
/// The same as a share of the depth: truth meshes are simplified.
const NEAR_SHARE: f64 = 0.008;
/// Smallest cosine between the surface and the view at which it is painted.
const MIN_COSINE: f64 = 0.1;
/// Width and height of a window's pane, share of its box.
const PANE_SHARE: f64 = 0.92;
/// Sides of textures, pixels: the smallest that holds twice the visible pixels is taken.
const SIDES: [u32; 3] = [256, 512, 1024];

/// What is painted where the photo does not see the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unseen {
    /// The mean colour of what is seen.
    Mean,
    /// What the photo shows in front of it, when that is of the same object: the front copied to the back.
    Front,
}

/// The object's mesh, in its canonical frame, with a texture.
///
/// A point takes the photo's colour where the truth says that the photo shows it: the pixel is the object's and its
/// depth the point's. Vertices are the triangles' own; positions and normals are unchanged.
pub(super) fn painted(room: &TruthRoom, photo: &RgbImage, object: &TruthObject, unseen: Unseen) -> Mesh {
    let pixels = object.visible_pixels as f64;
    let side = SIDES.into_iter().find(|s| f64::from(*s).powi(2) >= 8.0 * pixels).unwrap_or(SIDES[2]);
    let (shape, pane) = with_pane(object);
    let (mut mesh, places) = unwrapped(&shape, side);
    let mean = mean_color(room, photo, object.index);
    let view = View { room, photo, index: object.index };
    let mut texture = RgbaImage::from_pixel(side, side, opaque(mean));
    for (i, (t, place)) in mesh.triangles().zip(&places).enumerate() {
        // Nothing is known of a pane's depth but that the photo shows the view through it.
        let unseen = if pane.is_some_and(|first| i >= first) { Unseen::Front } else { unseen };
        let p = t.map(|i| mesh.positions[i as usize]);
        let flat = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero();
        let normal = object.point(flat.as_dvec3()) - object.position;
        for (x, y, w) in texels(place, side) {
            let local: Vec3 = p[0] * w[0] + p[1] * w[1] + p[2] * w[2];
            let color = view.color(object.point(local.as_dvec3()), normal, unseen).unwrap_or(mean);
            texture.put_pixel(x, y, opaque(color));
        }
    }
    for material in &mut mesh.materials {
        material.base_color = [1.0; 4];
        material.texture = Some(Arc::new(texture.clone()));
        // Library meshes are open and thin: leaves, cloth, shades.
        material.double_sided = true;
    }
    mesh
}

fn is_window(label: &str) -> bool {
    harmony_catalogue::opening(label) == Some(OpeningKind::Window)
}

/// A window's mesh is its frame; the pane, which the id image counts as the window's, is put into its middle plane.
/// Also the number of the first triangle of the pane.
fn with_pane(object: &TruthObject) -> (Mesh, Option<usize>) {
    let mut mesh = (*object.mesh).clone();
    let Some(bounds) = mesh.bounds().filter(|_| is_window(&object.label)) else { return (mesh, None) };
    let first = mesh.triangle_count();
    let half = bounds.size() * PANE_SHARE / 2.0;
    let base = mesh.positions.len() as u32;
    for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        mesh.positions.push((bounds.centre() + DVec3::new(x * half.x, y * half.y, 0.0)).as_vec3());
        mesh.normals.push(Vec3::Z);
        mesh.uvs.push(glam::Vec2::ZERO);
    }
    if let Some(group) = mesh.groups.last_mut() {
        group.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    }
    (mesh, Some(first))
}

fn opaque([r, g, b]: [u8; 3]) -> Rgba<u8> {
    Rgba([r, g, b, 255])
}

/// Mean linear colour of an object's pixels, as sRGB; grey where it has none.
fn mean_color(room: &TruthRoom, photo: &RgbImage, index: u32) -> [u8; 3] {
    let mut sum = [0.0_f64; 3];
    let mut count = 0.0;
    for (pixel, id) in photo.pixels().zip(&room.ids) {
        if u32::from(*id) == index {
            let linear = harmony_imaging::color::linear_from_rgb8(pixel.0);
            for (s, v) in sum.iter_mut().zip(linear) {
                *s += f64::from(v);
            }
            count += 1.0;
        }
    }
    if count == 0.0 {
        return [128; 3];
    }
    harmony_imaging::color::rgb8_from_linear(sum.map(|s| (s / count) as f32))
}

/// The photo with what it shows.
struct View<'a> {
    room: &'a TruthRoom,
    photo: &'a RgbImage,
    index: u32,
}

impl View<'_> {
    /// The photo's colour of a point of the room.
    fn color(&self, point: DVec3, normal: DVec3, unseen: Unseen) -> Option<[u8; 3]> {
        let camera = &self.room.camera;
        let pixel = camera.project(point).filter(|p| camera.contains(*p))?;
        let at = pixel.y as usize * camera.size.width as usize + pixel.x as usize;
        if u32::from(self.room.ids[at]) != self.index {
            return None;
        }
        let z = camera.depth(point);
        let there = f64::from(self.room.depth[at]);
        let towards = (camera.centre() - point).normalize_or(DVec3::Z);
        // Open meshes are seen from behind, too.
        let square = normal.dot(towards).abs() >= MIN_COSINE;
        let seen = square && (there - z).abs() <= NEAR_M.max(NEAR_SHARE * z);
        (seen || unseen == Unseen::Front).then(|| self.sample(pixel))
    }

    /// Bilinear, of the object's own pixels alone.
    fn sample(&self, pixel: DVec2) -> [u8; 3] {
        let (w, h) = self.photo.dimensions();
        let (x, y) = (pixel.x - 0.5, pixel.y - 0.5);
        let mut sum = [0.0; 3];
        let mut weights = 0.0;
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (px, py) = (x.floor() as i64 + dx, y.floor() as i64 + dy);
            if px < 0 || py < 0 || px >= i64::from(w) || py >= i64::from(h) {
                continue;
            }
            if u32::from(self.room.ids[(py * i64::from(w) + px) as usize]) != self.index {
                continue;
            }
            let weight = (1.0 - (x - px as f64).abs()) * (1.0 - (y - py as f64).abs());
            for (s, v) in sum.iter_mut().zip(self.photo.get_pixel(px as u32, py as u32).0) {
                *s += weight * f64::from(v);
            }
            weights += weight;
        }
        if weights <= 1e-9 {
            return self.photo.get_pixel(pixel.x as u32, pixel.y as u32).0;
        }
        sum.map(|s| (s / weights).round() as u8)
    }
}

#[cfg(test)]
mod tests {
    use harmony_mesh::{Group, Material};
    use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, Level, Support};
    use image::Rgb;

    use super::*;

    /// A board 1 m wide and high, 0.1 m thick, whose front at z = 1 faces a camera at z = 3; the photo shows its left
    /// half red and its right half blue, the room around it green.
    fn scene(label: &str) -> (TruthRoom, RgbImage, TruthObject) {
        let size = ImageSize::new(120, 80);
        let camera = Camera::looking(size, Intrinsics::centred(size, 80.0), DVec3::new(2.0, 0.5, 3.0), DVec3::NEG_Z);
        let mut mesh = Mesh {
            materials: vec![Material::plain("grey", [0.5; 3])],
            groups: vec![Group { material: 0, triangles: Vec::new() }],
            ..Mesh::default()
        };
        for (z, flip) in [(0.05_f32, false), (-0.05, true)] {
            let base = mesh.positions.len() as u32;
            for (x, y) in [(-0.5, 0.0), (0.5, 0.0), (0.5, 1.0), (-0.5, 1.0)] {
                mesh.positions.push(Vec3::new(x, y, z));
                mesh.uvs.push(glam::Vec2::ZERO);
            }
            let quad = [[base, base + 1, base + 2], [base, base + 2, base + 3]];
            mesh.groups[0].triangles.extend(quad.map(|[a, b, c]| if flip { [a, c, b] } else { [a, b, c] }));
        }
        mesh.recompute_normals();
        let mut ids = vec![3; size.pixels()];
        let mut depth = vec![2.95; size.pixels()];
        let mut photo = RgbImage::from_pixel(size.width, size.height, Rgb([0, 200, 0]));
        // At 2 m the board spans 40 pixels each way around the centre.
        for y in 20..60_u32 {
            for x in 40..80_u32 {
                let at = (y * size.width + x) as usize;
                (ids[at], depth[at]) = (10, 2.0);
                photo.put_pixel(x, y, if x < 60 { Rgb([200, 0, 0]) } else { Rgb([0, 0, 200]) });
            }
        }
        let object = TruthObject {
            id: "board_01".to_owned(),
            index: 10,
            level: Level::Furniture,
            label: label.to_owned(),
            position: DVec3::new(2.0, 0.0, 0.95),
            yaw: 0.0,
            size: DVec3::new(1.0, 1.0, 0.1),
            support: Support::Floor,
            wall: None,
            facing: None,
            faces_room: false,
            group: None,
            model: String::new(),
            visible_pixels: 1600,
            occluded: 0.0,
            truncated: 0.0,
            may_overlap: Vec::new(),
            mesh: Arc::new(mesh),
        };
        let room = TruthRoom {
            name: "board".to_owned(),
            folder: std::path::PathBuf::new(),
            camera,
            extents: Extents { width: 4.0, height: 2.5, depth: 4.0 },
            shape: harmony_scene::RoomShape::default(),
            origin: DVec3::ZERO,
            walls: Vec::new(),
            openings: Vec::new(),
            objects: vec![object.clone()],
            ids,
            depth,
        };
        (room, photo, object)
    }

    /// Colour of the painted mesh at a corner-weighted point of one of its triangles.
    fn color_at(mesh: &Mesh, triangle: usize, w: [f32; 3]) -> [u8; 3] {
        let t = mesh.triangles().nth(triangle).unwrap();
        let uv = mesh.uvs[t[0] as usize] * w[0] + mesh.uvs[t[1] as usize] * w[1] + mesh.uvs[t[2] as usize] * w[2];
        let texture = mesh.materials[0].texture.as_ref().unwrap();
        let (x, y) = (uv.x * texture.width() as f32, uv.y * texture.height() as f32);
        let p = texture.get_pixel(x as u32, y as u32).0;
        [p[0], p[1], p[2]]
    }

    #[test]
    fn the_front_takes_the_photo_and_the_back_its_mean() {
        let (room, photo, object) = scene("board");
        let mesh = painted(&room, &photo, &object, Unseen::Mean);
        mesh.check().unwrap();
        assert_eq!(mesh.triangle_count(), 4);
        // Triangle 0 has corners left below, right below, right above; the first weight is at the left.
        assert_eq!(color_at(&mesh, 0, [0.8, 0.1, 0.1]), [200, 0, 0]);
        assert_eq!(color_at(&mesh, 0, [0.1, 0.5, 0.4]), [0, 0, 200]);
        // sRGB 200 is 0.578 linear; half of it is sRGB 146.
        let back = color_at(&mesh, 2, [0.4, 0.3, 0.3]);
        assert!(back[0].abs_diff(146) <= 1 && back[1] == 0 && back[2].abs_diff(146) <= 1, "{back:?}");
    }

    #[test]
    fn a_copied_front_shows_through_to_the_back() {
        let (room, photo, object) = scene("board");
        let mesh = painted(&room, &photo, &object, Unseen::Front);
        let back = &object.mesh.triangles().nth(2).unwrap();
        let left = back.iter().position(|i| object.mesh.positions[*i as usize].x < 0.0).unwrap();
        let mut w = [0.1; 3];
        w[left] = 0.8;
        assert_eq!(color_at(&mesh, 2, w), [200, 0, 0]);
    }

    #[test]
    fn a_window_gets_its_pane_with_what_is_seen_through_it() {
        let (room, photo, object) = scene("window");
        let mesh = painted(&room, &photo, &object, Unseen::Mean);
        assert_eq!(mesh.triangle_count(), 6);
        assert_eq!(color_at(&mesh, 4, [0.1, 0.5, 0.4]), [0, 0, 200]);
    }
}
