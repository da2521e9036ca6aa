//! The empty room: floor, ceiling, walls with their openings, and skirting boards.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use harmony_mesh::{Mesh, ShellOptions, room_shell_with};
use harmony_scene::{Opening, OpeningKind, Room, Surface, Wall};

use super::dice::Dice;
use super::layout::{Hole, Plan, turn};
use super::paint::{Look, Palette};
use super::pictures;
use super::pieces::{Origin, Sculptor};
use super::solid::brick;

/// Id of the skirting boards in `instances.png`.
pub(super) const SKIRTING: u8 = 7;

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
    let room = Room {
        room_type: String::new(),
        extents: e,
        shape: harmony_scene::RoomShape::default(),
        seen: Vec::new(),
        openings: plan.holes.iter().filter(|h| !h.door).map(opening).collect(),
        floor_texture: None,
        wall_texture: None,
    };
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
    out.push((SKIRTING, skirting(palette, plan)));
    out
}

fn opening(hole: &Hole) -> Opening {
    let kind = if hole.door { OpeningKind::Door } else { OpeningKind::Window };
    Opening { kind, wall: hole.wall, u: hole.u, y: hole.y, inset: 0.0, object: None }
}

/// Boards of 7 cm at the foot of the walls, interrupted by doors and low windows.
fn skirting(palette: &Palette, plan: &Plan) -> Mesh {
    let mut s = Sculptor::new();
    let look = s.look(Look::plain("skirting", palette.trim, 0.4));
    for wall in Wall::ALL {
        let mut cuts: Vec<[f64; 2]> =
            plan.holes.iter().filter(|h| h.wall == wall && (h.door || h.y[0] < 0.2)).map(|h| h.u).collect();
        cuts.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut from = 0.0;
        let end = wall.length(&plan.extents);
        for cut in cuts.into_iter().chain([[end, end]]) {
            let length = cut[0] - from;
            if length > 0.01 {
                let foot = wall.point(&plan.extents, from + length / 2.0, 0.0) + wall.normal() * 0.006;
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
