//! The empty room: floor, ceiling, walls with their openings, and skirting boards.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use harmony_mesh::{Group, Mesh, ShellOptions, room_shell_with};
use harmony_scene::{Extents, Opening, OpeningKind, Room, RoomFace, Surface, Wall};

use super::dice::Dice;
use super::form;
use super::layout::{Hole, Plan, Stretch, turn};
use super::paint::{Look, Palette};
use super::pictures;
use super::pieces::{Origin, Sculptor};
use super::solid::brick;

/// Id of the skirting boards in `instances.png`.
pub(super) const SKIRTING: u8 = 7;
/// Id of what one sees through a passage.
const OUTSIDE: u8 = 8;
/// Id of floors and tops of niches.
pub(super) const LEDGE: u8 = 9;

/// What single precision leaves of a place, metres.
const FLOAT: f64 = 1e-4;

/// Depth of the jambs of windows, metres: a little more than where the panes are.
const REVEAL: f64 = 0.11;

/// Id of a face in `instances.png`.
pub(super) fn surface_id(surface: Surface) -> u8 {
    match surface {
        Surface::Floor => 1,
        Surface::Ceiling => 2,
        Surface::Back => 3,
        Surface::Right => 4,
        Surface::Front => 5,
        Surface::Left => 6,
    }
}

/// The faces with their ids, skirting boards last, in room coordinates.
pub(super) fn shell(dice: &mut Dice, palette: &Palette, plan: &Plan, wet: bool) -> Vec<(u8, Mesh)> {
    let e = plan.extents;
    let openings = plan.holes.iter().filter(|h| !h.door).map(opening);
    let openings = openings.chain(plan.form.passages.iter().cloned()).collect();
    let room = Room { openings, ..plan.room.clone() };
    let style = if wet { 3 } else { dice.pick(&[0, 0, 0, 4, 4, 1, 2]) };
    let only_back = dice.chance(0.4);
    let floor = Arc::new(pictures::floor(dice, palette, e.width as f32, e.depth as f32, wet));
    let seed = dice.number();
    let white = [240, 239, 235];
    let texture = |surface: Surface| {
        let size = surface.size(&e);
        let (w, h) = (size.x as f32, size.y as f32);
        let own = surface == Surface::Back;
        Some(match surface {
            Surface::Floor => Arc::clone(&floor),
            Surface::Ceiling => Arc::new(pictures::wall(seed, white, 0, w, h)),
            _ => {
                let color = palette.walls[usize::from(own)];
                let style = if style == 1 && only_back && !own { 0 } else { style };
                Arc::new(pictures::wall(seed ^ u32::from(surface_id(surface)), color, style, w, h))
            }
        })
    };
    let mut out: Vec<(u8, Mesh)> = Surface::ALL
        .into_iter()
        .map(|surface| {
            let omit = Surface::ALL.into_iter().filter(|s| *s != surface).collect();
            let options = ShellOptions { omit, reveal: REVEAL, ..ShellOptions::default() };
            (surface_id(surface), room_shell_with(&room, &texture, &options))
        })
        .collect();
    if !plan.form.shape.is_box() {
        let faces = room.all_faces();
        out = out.into_iter().flat_map(|(id, mesh)| by_direction(id, &mesh, &faces)).collect();
    }
    out.push((SKIRTING, skirting(palette, plan)));
    out.extend(plan.form.passages.iter().map(|o| (OUTSIDE, vestibule(o, plan, palette.walls[0]))));
    out
}

/// What one sees through a passage: a bare small room behind the wall, open towards it.
fn vestibule(passage: &Opening, plan: &Plan, wall: [u8; 3]) -> Mesh {
    let size = Extents { width: passage.u[1] - passage.u[0] + 0.9, height: plan.extents.height, depth: 1.6 };
    let room = form::room_of(size, harmony_scene::RoomShape::default());
    let plain = harmony_mesh::linear_rgb(wall);
    let options = ShellOptions { omit: vec![Surface::Front], plain, ..ShellOptions::default() };
    let mut mesh = room_shell_with(&room, &|_| None, &options);
    let (yaw, normal) = (passage.wall.yaw(), passage.wall.normal());
    let middle = passage.wall.point(&plan.extents, f64::midpoint(passage.u[0], passage.u[1]), 0.0) - normal * REVEAL;
    mesh.map(
        |p| (turn(yaw, p.as_dvec3() - DVec3::new(size.width / 2.0, 0.0, size.depth)) + middle).as_vec3(),
        |n| turn(yaw, n.as_dvec3()).as_vec3(),
    );
    mesh
}

/// Id of a piece of the room's boundary in `instances.png`: upright faces have that of the wall that looks the same way,
/// floors and tops of niches are ledges.
pub(super) fn face_id(face: &RoomFace) -> u8 {
    let upright = Wall::ALL.into_iter().find(|w| w.normal().dot(face.normal) > 0.999);
    // Sides of a tray are ceiling.
    match upright.filter(|_| face.surface.wall().is_some()) {
        Some(wall) => surface_id(wall.surface()),
        None if face.surface.wall().is_some() => LEDGE,
        None => surface_id(face.surface),
    }
}

/// A surface's mesh in parts by the id of the face that each triangle lies in; reveals of windows keep the surface's.
fn by_direction(id: u8, mesh: &Mesh, faces: &[RoomFace]) -> Vec<(u8, Mesh)> {
    let own = |t: &[u32; 3]| {
        let corners = t.map(|i| mesh.positions[i as usize].as_dvec3());
        let middle = corners.iter().sum::<DVec3>() / 3.0;
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(DVec3::Y);
        let face = faces.iter().find(|f| f.normal.dot(normal) > 0.999 && f.contains(middle, FLOAT));
        face.map_or(id, face_id)
    };
    let mut parts: BTreeMap<u8, Mesh> = BTreeMap::new();
    for group in &mesh.groups {
        for triangle in &group.triangles {
            let part = parts.entry(own(triangle)).or_insert_with(|| {
                let groups = mesh.groups.iter().map(|g| Group { material: g.material, triangles: Vec::new() });
                Mesh { groups: groups.collect(), ..mesh.clone() }
            });
            let at = part.groups.iter_mut().find(|g| g.material == group.material);
            at.expect("all groups are there").triangles.push(*triangle);
        }
    }
    parts.into_iter().collect()
}

fn opening(hole: &Hole) -> Opening {
    let kind = if hole.door { OpeningKind::Door } else { OpeningKind::Window };
    Opening { kind, wall: hole.wall, u: hole.u, y: hole.y, inset: hole.inset, rise: 0.0, object: None }
}

/// Boards of 7 cm at the foot of the walls, interrupted by doors and low windows.
fn skirting(palette: &Palette, plan: &Plan) -> Mesh {
    let mut s = Sculptor::new();
    let look = s.look(Look::plain("skirting", palette.trim, 0.4));
    for Stretch { plane, u: [start, end] } in plan.stretches().iter().copied() {
        let wall = plane.wall;
        let here =
            |h: &&Hole| h.wall == wall && (h.inset - plane.inset).abs() < FLOAT && h.u[1] > start && h.u[0] < end;
        let mut cuts: Vec<[f64; 2]> =
            plan.holes.iter().filter(here).filter(|h| h.door || h.y[0] < 0.2).map(|h| h.u).collect();
        let passages = plan.form.passages.iter().filter(|o| o.wall == wall && (o.inset - plane.inset).abs() < FLOAT);
        cuts.extend(passages.map(|o| o.u));
        cuts.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut from = start;
        for cut in cuts.into_iter().chain([[end, end]]) {
            let length = cut[0] - from;
            if length > 0.01 {
                let foot = plane.point(&plan.extents, from + length / 2.0, 0.0) + wall.normal() * 0.006;
                let board = brick(length as f32, 0.07, 0.012);
                let yaw = wall.yaw();
                let place = |p: Vec3| (turn(yaw, p.as_dvec3()) + foot).as_vec3();
                s.add(look, board.warped(place));
            }
            from = cut[1].max(from);
        }
    }
    let shift = DVec3::new(plan.extents.width / 2.0, 0.0, plan.extents.depth / 2.0).as_vec3();
    let mut mesh = s.finish("skirting", Origin::Bottom).mesh;
    mesh.map(|p| p + shift, |n| n);
    mesh
}
