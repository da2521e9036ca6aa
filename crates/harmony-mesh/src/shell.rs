//! The empty room as a mesh: floor, ceiling and walls that face inward, with the openings cut out.

use std::sync::Arc;

use glam::{DVec2, DVec3, Vec2};
use harmony_scene::{Extents, Room, Surface};
use image::RgbaImage;

pub use trim::{Trim, Trims};

use crate::{Group, Material, Mesh};

mod trim;

/// What to leave out of the shell, and how deep its openings are.
#[derive(Debug, Clone, PartialEq)]
pub struct ShellOptions {
    /// Faces that are not made.
    pub omit: Vec<Surface>,
    /// Depth of the jambs around openings, outward, metres.
    pub reveal: f64,
    /// Linear colour of faces without a texture.
    pub plain: [f32; 3],
    /// Skirting, cornice and casings, with groups and materials of their own after those of the faces.
    pub trims: Trims,
}

impl Default for ShellOptions {
    fn default() -> Self {
        Self { omit: Vec::new(), reveal: 0.1, plain: [0.6, 0.58, 0.55], trims: Trims::default() }
    }
}

/// Material and group name of a face: `floor`, `ceiling`, `wall_back`, `wall_left`, ...
pub fn shell_material_name(surface: Surface) -> &'static str {
    match surface {
        Surface::Floor => "floor",
        Surface::Ceiling => "ceiling",
        Surface::Back => "wall_back",
        Surface::Left => "wall_left",
        Surface::Right => "wall_right",
        Surface::Front => "wall_front",
    }
}

/// The room's shell in room coordinates, one group and material a face, single-sided, normals inward.
///
/// Texture coordinates cover each whole face: on walls u runs with [`Surface::point`]'s u and v = 0 is the top;
/// on floor and ceiling u runs along x and v along z. The reveals of a wall's openings belong to its group.
pub fn room_shell(room: &Room, textures: &dyn Fn(Surface) -> Option<Arc<RgbaImage>>) -> Mesh {
    room_shell_with(room, textures, &ShellOptions::default())
}

/// [`room_shell`] with faces left out.
pub fn room_shell_with(
    room: &Room,
    textures: &dyn Fn(Surface) -> Option<Arc<RgbaImage>>,
    options: &ShellOptions,
) -> Mesh {
    let mut mesh = Mesh::default();
    for surface in Surface::ALL.into_iter().filter(|s| !options.omit.contains(s)) {
        let texture = textures(surface);
        let color = if texture.is_some() { [1.0; 3] } else { options.plain };
        let mut material = Material::plain(shell_material_name(surface), color);
        material.texture = texture;
        let mut face = Face::new(surface, &room.extents, &mut mesh);
        let holes = holes(room, surface);
        face.sheet(&holes);
        for hole in &holes {
            face.reveals(hole, options.reveal);
        }
        let triangles = face.triangles;
        mesh.groups.push(Group { material: mesh.materials.len(), triangles });
        mesh.materials.push(material);
    }
    trim::add(&mut mesh, room, &options.trims, &options.omit);
    mesh
}

/// A rectangle on a face, in face coordinates, metres.
#[derive(Debug, Clone, Copy)]
struct Rect {
    min: DVec2,
    max: DVec2,
}

impl Rect {
    fn contains(&self, p: DVec2) -> bool {
        p.cmpgt(self.min).all() && p.cmplt(self.max).all()
    }
}

/// The openings of a wall, cut to it; those without area are left out.
fn holes(room: &Room, surface: Surface) -> Vec<Rect> {
    let size = surface.size(&room.extents);
    room.openings
        .iter()
        .filter(|o| Some(o.wall) == surface.wall())
        .map(|o| Rect { min: DVec2::new(o.u[0], o.y[0]), max: DVec2::new(o.u[1], o.y[1]) })
        .filter(|r| r.min.is_finite() && r.max.is_finite())
        .map(|r| Rect { min: r.min.max(DVec2::ZERO), max: r.max.min(size) })
        .filter(|r| (r.max - r.min).min_element() > 1e-6)
        .collect()
}

/// One face while its triangles are made.
struct Face<'a> {
    surface: Surface,
    extents: &'a Extents,
    mesh: &'a mut Mesh,
    triangles: Vec<[u32; 3]>,
}

impl<'a> Face<'a> {
    fn new(surface: Surface, extents: &'a Extents, mesh: &'a mut Mesh) -> Self {
        Self { surface, extents, mesh, triangles: Vec::new() }
    }

    /// The face itself: a grid along the edges of all holes, without the cells inside a hole.
    ///
    /// Neighbouring cells share their vertices, so the sheet has no T-junctions.
    fn sheet(&mut self, holes: &[Rect]) {
        let size = self.surface.size(self.extents);
        let lines = |axis: usize| {
            let mut at = vec![0.0, size[axis]];
            at.extend(holes.iter().flat_map(|h| [h.min[axis], h.max[axis]]));
            at.sort_by(f64::total_cmp);
            at.dedup();
            at
        };
        let (us, vs) = (lines(0), lines(1));
        let first = self.mesh.positions.len() as u32;
        for v in &vs {
            for u in &us {
                self.vertex(DVec2::new(*u, *v), DVec3::ZERO, self.surface.normal());
            }
        }
        let row = us.len() as u32;
        for j in 0..vs.len().saturating_sub(1) {
            for i in 0..us.len().saturating_sub(1) {
                let centre = DVec2::new(us[i] + us[i + 1], vs[j] + vs[j + 1]) / 2.0;
                if !holes.iter().any(|h| h.contains(centre)) {
                    let a = first + j as u32 * row + i as u32;
                    self.quad([a, a + 1, a + row + 1, a + row]);
                }
            }
        }
    }

    /// The four sides of a hole, from the face outward, a door's threshold among them.
    fn reveals(&mut self, hole: &Rect, depth: f64) {
        // NaN makes no reveals either.
        if depth.is_nan() || depth <= 0.0 {
            return;
        }
        let outward = -self.surface.normal() * depth;
        let Rect { min, max } = *hole;
        let corners = [min, DVec2::new(max.x, min.y), max, DVec2::new(min.x, max.y)];
        let centre = self.surface.point(self.extents, (min + max) / 2.0);
        for i in 0..4 {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            let middle = self.surface.point(self.extents, (a + b) / 2.0);
            let normal = (centre - middle).normalize_or(DVec3::Y);
            let first = self.mesh.positions.len() as u32;
            for (at, shift) in [(a, DVec3::ZERO), (b, DVec3::ZERO), (b, outward), (a, outward)] {
                self.vertex(at, shift, normal);
            }
            self.quad([first, first + 1, first + 2, first + 3]);
        }
    }

    fn vertex(&mut self, at: DVec2, shift: DVec3, normal: DVec3) {
        let size = self.surface.size(self.extents);
        let share = (at / size).as_vec2();
        let uv = if self.surface.wall().is_some() { Vec2::new(share.x, 1.0 - share.y) } else { share };
        self.mesh.positions.push((self.surface.point(self.extents, at) + shift).as_vec3());
        self.mesh.normals.push(normal.as_vec3());
        self.mesh.uvs.push(uv);
    }

    /// Two triangles, wound so that their normal agrees with that of their first vertex.
    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        let [pa, pb, pc] = [a, b, c].map(|i| self.mesh.positions[i as usize]);
        let agrees = (pb - pa).cross(pc - pa).dot(self.mesh.normals[a as usize]) >= 0.0;
        let (b, d) = if agrees { (b, d) } else { (d, b) };
        self.triangles.extend([[a, b, c], [a, c, d]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Bvh;
    use harmony_scene::{Opening, OpeningKind, Wall};

    fn room() -> Room {
        let opening = |kind, wall, u, y| Opening { kind, wall, u, y, object: None };
        Room {
            room_type: "bedroom".into(),
            extents: Extents { width: 4.0, height: 2.5, depth: 5.0 },
            seen: vec![],
            openings: vec![
                opening(OpeningKind::Window, Wall::Back, [1.0, 2.0], [0.9, 2.0]),
                opening(OpeningKind::Window, Wall::Back, [2.5, 3.5], [1.1, 2.2]),
                opening(OpeningKind::Door, Wall::Left, [3.0, 3.9], [0.0, 2.0]),
                opening(OpeningKind::Window, Wall::Right, [-1.0, 0.5], [1.0, f64::NAN]),
            ],
            floor_texture: None,
            wall_texture: None,
        }
    }

    fn area(mesh: &Mesh, group: &Group, keep: impl Fn(DVec3) -> bool) -> f64 {
        group
            .triangles
            .iter()
            .map(|t| t.map(|i| mesh.positions[i as usize].as_dvec3()))
            .filter(|[a, b, c]| keep((*b - *a).cross(*c - *a)))
            .map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0)
            .sum()
    }

    #[test]
    fn walls_have_the_area_of_the_face_less_its_openings_and_normals_point_in() {
        let room = room();
        let mesh = room_shell(&room, &|_| None);
        mesh.check().unwrap();
        let names: Vec<&str> = mesh.materials.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["floor", "ceiling", "wall_back", "wall_left", "wall_right", "wall_front"]);
        let holes = [0.0, 0.0, 1.1 + 1.1, 1.8, 0.0, 0.0];
        for ((surface, group), hole) in Surface::ALL.into_iter().zip(&mesh.groups).zip(holes) {
            let size = surface.size(&room.extents);
            let inward = |n: DVec3| n.normalize().dot(surface.normal()) > 0.999;
            let got = area(&mesh, group, inward);
            assert!((got - (size.x * size.y - hole)).abs() <= 1e-5, "{surface:?}: {got}");
            let against = area(&mesh, group, |n| n.dot(surface.normal()) < -1e-6);
            assert!(against == 0.0, "{surface:?} has triangles that face out");
        }
        for (i, t) in mesh.triangles().enumerate() {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            assert!((b - a).cross(c - a).dot(mesh.normals[t[0] as usize]) > 0.0, "winding of triangle {i}");
        }
    }

    #[test]
    fn rays_leave_through_the_openings_only_and_texture_coordinates_follow_the_face() {
        let room = room();
        let mesh = room_shell(&room, &|_| None);
        let bvh = Bvh::new(&mesh);
        let eye = DVec3::new(1.5, 1.4, 3.0);
        assert!(!bvh.any_hit(eye, DVec3::new(1.5, 1.5, 0.0) - eye, 100.0), "through the window");
        assert!(!bvh.any_hit(eye, DVec3::new(0.0, 1.0, 3.4) - eye, 100.0), "through the door");
        let triangles: Vec<[u32; 3]> = mesh.triangles().collect();
        let top_left = DVec3::new(0.02, 2.48, 0.0);
        let hit = bvh.raycast(eye, top_left - eye, 100.0).unwrap();
        assert!((hit.point - top_left).length() < 1e-6);
        let near_corner =
            triangles[hit.triangle].iter().map(|i| mesh.uvs[*i as usize]).any(|uv| uv == Vec2::new(0.0, 0.0));
        assert!(near_corner, "the top left of the back wall has uv (0, 0)");
        let jamb = bvh.raycast(DVec3::new(1.5, 1.4, -0.05), DVec3::X, 10.0).unwrap();
        assert!((jamb.distance - 0.5).abs() < 1e-6 && jamb.normal.x < -0.99, "the reveal faces into the opening");
    }

    #[test]
    fn faces_can_be_left_out() {
        let options = ShellOptions { omit: vec![Surface::Ceiling, Surface::Front], ..ShellOptions::default() };
        let mesh = room_shell_with(&room(), &|_| Some(Arc::new(RgbaImage::new(2, 2))), &options);
        let names: Vec<&str> = mesh.materials.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["floor", "wall_back", "wall_left", "wall_right"]);
        assert!(mesh.materials.iter().all(|m| m.texture.is_some() && !m.double_sided));
    }
}
