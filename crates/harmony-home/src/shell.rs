//! The faces of a home's rooms: each room's shell at the size that the home gives it, with the photo's textures.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{DVec3, Vec3};
use harmony_export::world::Face;
use harmony_mesh::{Group, Material, Mesh, ShellOptions, Trim, Trims, room_shell_with, shell_material_name};
use harmony_scene::{Extents, Room, Surface, Wall};
use image::RgbaImage;

use crate::frame::Place;

/// Linear colour of faces of rooms without a photo.
const PLAIN: [f32; 3] = [0.6, 0.58, 0.55];
/// Linear colour of what a horizontal cut through walls shows.
const CUT: [f32; 3] = [0.05, 0.05, 0.06];

/// A room's faces in the home, each named by its surface or board after a prefix (`kitchen_floor`).
///
/// `room` is the room at its size in the home, in its own frame; `place` has no scale and no yaw of its own. Textures and
/// boards are those of the run's `faces`.
pub fn faces(prefix: &str, room: &Room, place: &Place, faces: &[Face], door_reveal: f64) -> Vec<Face> {
    let textures = |surface: Surface| texture(faces, surface);
    let trims = trims(faces, room);
    let options = ShellOptions { door_reveal: Some(door_reveal), plain: PLAIN, trims, ..ShellOptions::default() };
    let mut shell = room_shell_with(room, &textures, &options);
    for material in &mut shell.materials {
        if let Some(own) = faces.iter().flat_map(|f| &f.mesh.materials).find(|m| m.name == material.name) {
            let texture = material.texture.clone();
            *material = Material { texture, name: material.name.clone(), ..own.clone() };
        }
    }
    let rotation = place.rotation();
    shell.map(|p| place.point(&room.extents, p.as_dvec3()).as_vec3(), |n| (rotation * n.as_dvec3()).as_vec3());
    let mut taken = BTreeSet::new();
    split(&shell)
        .into_iter()
        .map(|(material, mesh)| {
            let mut full = format!("{prefix}{material}");
            while !taken.insert(full.clone()) {
                full.push('_');
            }
            Face { name: full, mesh: Arc::new(mesh) }
        })
        .collect()
}

fn texture(faces: &[Face], surface: Surface) -> Option<Arc<RgbaImage>> {
    let name = shell_material_name(surface);
    let own = faces.iter().find(|f| f.name == name)?;
    own.mesh.materials.iter().find_map(|m| m.texture.clone())
}

/// A mesh's groups, each as a mesh of its own, with the name of its material.
fn split(mesh: &Mesh) -> Vec<(String, Mesh)> {
    let one = |group: &Group| {
        let mut place: BTreeMap<u32, u32> = BTreeMap::new();
        let material = mesh.materials[group.material].clone();
        let name = material.name.clone();
        let mut out = Mesh { materials: vec![material], ..Mesh::default() };
        let triangles = group.triangles.iter().map(|t| {
            t.map(|i| {
                *place.entry(i).or_insert_with(|| {
                    out.positions.push(mesh.positions[i as usize]);
                    out.normals.push(mesh.normals[i as usize]);
                    out.uvs.push(mesh.uvs[i as usize]);
                    out.positions.len() as u32 - 1
                })
            })
        });
        let triangles = triangles.collect();
        out.groups = vec![Group { material: 0, triangles }];
        (name, out)
    };
    mesh.groups.iter().filter(|g| !g.triangles.is_empty()).map(one).collect()
}

/// The boards that a run's shell has, measured on their meshes.
///
/// Casings are measured where a door is; a shell whose doors are all gone has none.
fn trims(faces: &[Face], room: &Room) -> Trims {
    let board = |name: &str, height: &dyn Fn(&Mesh) -> Option<f64>| {
        let mesh = &faces.iter().find(|f| f.name == name)?.mesh;
        let bounds = mesh.bounds()?;
        let own = Extents { width: bounds.max.x, height: room.extents.height, depth: bounds.max.z };
        let out = |p: &Vec3| {
            Wall::ALL.into_iter().map(|w| w.distance(&own, p.as_dvec3()).abs()).fold(f64::INFINITY, f64::min)
        };
        let depth = mesh.positions.iter().map(out).fold(0.0, f64::max).min(0.06);
        let [r, g, b, _] = mesh.materials.first()?.base_color;
        Some(Trim { height: height(mesh)?, depth, color: [r, g, b] })
    };
    Trims {
        skirting: board("skirting", &|m| Some(m.bounds()?.max.y)),
        cornice: board("cornice", &|m| Some(m.bounds()?.size().y)),
        casing: None,
    }
}

/// Rectangles seen from above where a cut at their height goes through solid walls: for views without ceilings.
pub fn wall_tops(tops: impl Iterator<Item = (DVec3, DVec3)>) -> Option<Face> {
    let mut mesh = Mesh { materials: vec![Material::plain("wall_tops", CUT)], ..Mesh::default() };
    let mut triangles = Vec::new();
    for (min, max) in tops {
        let base = mesh.positions.len() as u32;
        for (x, z) in [(min.x, min.z), (min.x, max.z), (max.x, max.z), (max.x, min.z)] {
            mesh.positions.push(DVec3::new(x, max.y, z).as_vec3());
            mesh.normals.push(Vec3::Y);
            mesh.uvs.push(glam::Vec2::ZERO);
        }
        triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    }
    mesh.groups = vec![Group { material: 0, triangles }];
    (!mesh.positions.is_empty()).then(|| Face { name: "wall_tops".to_owned(), mesh: Arc::new(mesh) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use harmony_scene::{Opening, OpeningKind, QuarterTurn, RoomShape};

    #[test]
    fn a_turned_room_has_its_faces_and_boards_where_the_home_has_its_walls() {
        let extents = Extents { width: 3.0, height: 2.5, depth: 5.0 };
        let room = Room {
            room_type: String::new(),
            extents,
            shape: RoomShape::default(),
            seen: vec![],
            openings: vec![Opening {
                kind: OpeningKind::Door,
                wall: Wall::Left,
                u: [1.0, 1.9],
                y: [0.0, 2.0],
                inset: 0.0,
                rise: 0.0,
                object: None,
            }],
            floor_texture: None,
            wall_texture: None,
        };
        let skirting = Trim { height: 0.08, depth: 0.015, color: [0.9, 0.8, 0.7] };
        let options =
            ShellOptions { trims: Trims { skirting: Some(skirting), ..Trims::default() }, ..ShellOptions::default() };
        let own: Vec<Face> = split(&room_shell_with(&room, &|_| None, &options))
            .into_iter()
            .map(|(name, mesh)| Face { name, mesh: Arc::new(mesh) })
            .collect();
        let turn = QuarterTurn::try_from(1).unwrap();
        let place = Place { turn, yaw: 0.0, scale: 1.0, at: DVec2::new(12.5, 11.5), floor: 0.0 };
        let made = faces("hall_", &room, &place, &own, 0.07);
        let bounds = |name: &str| made.iter().find(|f| f.name == name).unwrap().mesh.bounds().unwrap();
        // The room's depth runs along the home's x; its left wall is at the largest z.
        let left = bounds("hall_wall_left");
        assert!((left.min.x - 10.0).abs() < 1e-5 && (left.max.x - 15.0).abs() < 1e-5, "{left:?}");
        assert!((left.min.z - 13.0).abs() < 1e-5 && (left.max.z - 13.07).abs() < 1e-5, "with the jambs of its door");
        let boards = bounds("hall_skirting");
        assert!((boards.max.y - 0.08).abs() < 1e-5, "{boards:?}");
        for (name, count) in [("hall_floor", 1), ("hall_ceiling", 1), ("kitchen_floor", 0)] {
            assert_eq!(made.iter().filter(|f| f.name == name).count(), count);
        }
        for face in &made {
            face.mesh.check().unwrap();
        }
    }
}
