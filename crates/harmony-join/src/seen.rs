//! The share of a scene's surface that photos show.

use glam::{DMat3, DVec3};
use harmony_mesh::Mesh;
use harmony_render::{Instance, RenderOptions, render_depth_ids};
use harmony_scene::Camera;
use rayon::prelude::*;
use serde::Serialize;

/// Points on all objects, and as many on the room.
const POINTS: usize = 20_000;
/// A point lies on what a photo shows when the depths agree so well: share, and metres.
const AGREE: (f64, f64) = (0.01, 0.015);
/// Width of the depth pictures, pixels.
const WIDTH: u32 = 640;

/// Shares of the surface, by area.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SeenShare {
    /// Of the objects, hidden sides and undersides included: by each photo.
    pub objects_by_photo: Vec<f64>,
    /// ... by any.
    pub objects: f64,
    /// Of the room's faces: by each photo.
    pub room_by_photo: Vec<f64>,
    /// ... by any.
    pub room: f64,
}

/// What a camera shows, as depth.
struct Picture {
    camera: Camera,
    depth: Vec<f32>,
}

impl Picture {
    fn shows(&self, point: DVec3) -> bool {
        let Some(pixel) = self.camera.project(point).filter(|p| self.camera.contains(*p)) else { return false };
        let at = pixel.y as usize * self.camera.size.width as usize + pixel.x as usize;
        let own = self.camera.depth(point);
        let seen = f64::from(self.depth[at]);
        seen > 0.0 && (seen - own).abs() <= AGREE.0 * own + AGREE.1
    }
}

/// Measures the shares: `objects` and `room` together are the scene, in one frame with the cameras.
pub fn seen_share(objects: &[Instance<'_>], room: &[Instance<'_>], cameras: &[Camera]) -> SeenShare {
    let all: Vec<Instance<'_>> = objects.iter().chain(room).copied().collect();
    let pictures: Vec<Picture> = cameras
        .iter()
        .map(|camera| {
            let camera = camera.resized(camera.size.fit_within(WIDTH));
            Picture { depth: render_depth_ids(&camera, &all, &RenderOptions::default()).depth, camera }
        })
        .collect();
    let (objects_by_photo, objects) = shares(&points(objects), &pictures);
    let (room_by_photo, room) = shares(&points(room), &pictures);
    SeenShare { objects_by_photo, objects, room_by_photo, room }
}

fn shares(points: &[DVec3], pictures: &[Picture]) -> (Vec<f64>, f64) {
    let shown: Vec<Vec<bool>> =
        points.par_iter().map(|p| pictures.iter().map(|picture| picture.shows(*p)).collect()).collect();
    let count = points.len().max(1) as f64;
    let by = (0..pictures.len()).map(|k| shown.iter().filter(|s| s[k]).count() as f64 / count).collect();
    (by, shown.iter().filter(|s| s.contains(&true)).count() as f64 / count)
}

/// Points spread evenly over the area of some meshes: strata along the summed area, within each triangle by the
/// generalised golden ratio (M. Roberts 2018).
fn points(instances: &[Instance<'_>]) -> Vec<DVec3> {
    let mut triangles: Vec<[DVec3; 3]> = Vec::new();
    let mut sums = Vec::new();
    let mut total = 0.0;
    for instance in instances {
        let place = |i: u32| instance.linear * instance.mesh.positions[i as usize].as_dvec3() + instance.translation;
        for t in instance.mesh.triangles() {
            let [a, b, c] = t.map(place);
            total += (b - a).cross(c - a).length() / 2.0;
            triangles.push([a, b, c]);
            sums.push(total);
        }
    }
    if total <= 0.0 {
        return Vec::new();
    }
    (0..POINTS)
        .map(|k| {
            let at = (k as f64 + 0.5) / POINTS as f64 * total;
            let [a, b, c] = triangles[sums.partition_point(|s| *s < at).min(triangles.len() - 1)];
            let (mut u, mut v) = ((k as f64 * 0.754_877_666).fract(), (k as f64 * 0.569_840_291).fract());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            a + (b - a) * u + (c - a) * v
        })
        .collect()
}

/// A mesh where it is, in room coordinates.
pub fn in_place(mesh: &Mesh) -> Instance<'_> {
    Instance { mesh, linear: DMat3::IDENTITY, translation: DVec3::ZERO, id: 1 }
}

#[cfg(test)]
mod tests {
    use harmony_mesh::{Group, Material, room_shell};
    use harmony_scene::{Extents, ImageSize, Intrinsics, Room, RoomShape};

    use super::*;

    fn room() -> Mesh {
        let room = Room {
            room_type: String::new(),
            extents: Extents { width: 4.0, height: 2.5, depth: 4.0 },
            shape: RoomShape::default(),
            seen: Vec::new(),
            openings: Vec::new(),
            floor_texture: None,
            wall_texture: None,
        };
        room_shell(&room, &|_| None)
    }

    /// A panel across the room, 1 m by 1 m, one-sided, that faces the front wall.
    fn panel() -> Mesh {
        let corners = [[1.5, 1.0], [2.5, 1.0], [2.5, 2.0], [1.5, 2.0]];
        let mut mesh = Mesh {
            positions: corners.iter().map(|[x, y]| glam::Vec3::new(*x, *y, 2.0)).collect(),
            uvs: vec![glam::Vec2::ZERO; 4],
            groups: vec![Group { material: 0, triangles: vec![[0, 1, 2], [0, 2, 3]] }],
            materials: vec![Material::plain("grey", [0.5; 3])],
            ..Mesh::default()
        };
        mesh.recompute_normals();
        mesh
    }

    fn camera(z: f64, towards: f64) -> Camera {
        let size = ImageSize::new(640, 480);
        let lens = Intrinsics::from_horizontal_fov(size, 1.4);
        Camera::looking(size, lens, DVec3::new(2.0, 1.5, z), DVec3::new(0.0, 0.0, towards))
    }

    #[test]
    fn two_photos_from_both_ends_show_more_of_a_room_than_one() {
        let shell = room();
        let panel = panel();
        let share = seen_share(&[in_place(&panel)], &[in_place(&shell)], &[camera(3.9, -1.0), camera(0.1, 1.0)]);
        assert!(share.objects > 0.97 && share.objects_by_photo[0] > 0.97, "{share:?}");
        let [a, b] = [share.room_by_photo[0], share.room_by_photo[1]];
        assert!(share.room > a.max(b) + 0.1 && share.room <= a + b + 1e-9 && share.room <= 1.0, "{share:?}");
        // From 1.9 m the panel hides 2.05 m by 2.03 m of the wall 3.9 m away: 4.2 of 72 square metres.
        let alone = seen_share(&[], &[in_place(&shell)], &[camera(3.9, -1.0)]).room;
        assert!(alone > a + 0.03 && alone < a + 0.08, "{alone} {a}");
    }
}
