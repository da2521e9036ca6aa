//! Boards along the walls: skirting, cornice, casings of doors.

use glam::{DVec2, DVec3, Vec2};
use harmony_scene::{Extents, Opening, OpeningKind, Room, Surface, WallPlane};

use super::Rect;
use crate::{Group, Material, Mesh};

/// A board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trim {
    /// Its face's height (a casing's width), metres.
    pub height: f64,
    /// How far it stands out of the wall, metres.
    pub depth: f64,
    /// Linear colour.
    pub color: [f32; 3],
}

/// The boards that a room has; they go round it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Trims {
    /// Along the floor.
    pub skirting: Option<Trim>,
    /// Under the ceiling.
    pub cornice: Option<Trim>,
    /// Around doors.
    pub casing: Option<Trim>,
}

/// Material names of the boards: along the floor, under the ceiling, around doors.
pub const TRIMS: [&str; 3] = ["skirting", "cornice", "casing"];
/// Shortest piece that is made, metres.
const SHORTEST: f64 = 0.02;
/// Bevel of the free edge as a share of the depth.
const BEVEL: f64 = 0.4;

/// A box on a wall: a range along it, a range of heights, and which of its edges is free and bevelled.
struct Board {
    u: [f64; 2],
    y: [f64; 2],
    edge: Edge,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Edge {
    Top,
    Bottom,
    Sharp,
}

/// Adds the boards to a shell, one group and material a kind.
pub(super) fn add(mesh: &mut Mesh, room: &Room, trims: &Trims, omit: &[Surface]) {
    for (name, trim) in TRIMS.into_iter().zip([trims.skirting, trims.cornice, trims.casing]) {
        let Some(trim) = trim.filter(|t| t.height > 0.005 && t.depth > 0.001) else { continue };
        let mut triangles = Vec::new();
        for wall in Surface::ALL.into_iter().filter(|s| s.wall().is_some() && !omit.contains(s)) {
            for (plane, board) in boards(name, &trim, room, wall) {
                board.add(mesh, &mut triangles, plane, &room.extents, &trim);
            }
        }
        if !triangles.is_empty() {
            mesh.groups.push(Group { material: mesh.materials.len(), triangles });
            mesh.materials.push(Material::plain(name, trim.color));
        }
    }
}

/// The boards of one kind on all planes that look as a wall does.
fn boards(name: &str, trim: &Trim, room: &Room, wall: Surface) -> Vec<(WallPlane, Board)> {
    let height = room.extents.height;
    // What stands at the opening's edge is the door's own frame, or its casing.
    let along = |y: [f64; 2], edge: Edge| -> Vec<(WallPlane, Board)> {
        stretches(room, wall, if edge == Edge::Top { 0.0 } else { height })
            .into_iter()
            .flat_map(|(plane, stretch)| {
                let doors = doors(room, plane);
                let gaps = gaps(stretch, doors.iter().filter(|d| d.min.y < y[1] && d.max.y > y[0]));
                gaps.into_iter().map(move |u| (plane, Board { u, y, edge }))
            })
            .collect()
    };
    match name {
        "skirting" => along([0.0, trim.height.min(height)], Edge::Top),
        "cornice" => along([(height - trim.height).max(0.0), height], Edge::Bottom),
        _ => {
            let length = wall.size(&room.extents).x;
            wall.wall()
                .map_or_else(Vec::new, |w| room.planes(w))
                .into_iter()
                .flat_map(|plane| doors(room, plane).into_iter().map(move |d| (plane, d)))
                .flat_map(|(plane, d)| {
                    let top = (d.max.y + trim.height).min(height);
                    let low = d.min.y.max(0.0);
                    let sides = [
                        ([(d.min.x - trim.height).max(0.0), d.min.x], [low, top]),
                        ([d.max.x, (d.max.x + trim.height).min(length)], [low, top]),
                        ([d.min.x, d.max.x], [d.max.y, top]),
                    ];
                    sides.map(|(u, y)| (plane, Board { u, y, edge: Edge::Sharp }))
                })
                .filter(|(_, b)| b.u[1] - b.u[0] > 0.005 && b.y[1] - b.y[0] > 0.005)
                .collect()
        }
    }
}

/// The doors in a plane.
fn doors(room: &Room, plane: WallPlane) -> Vec<Rect> {
    let own = |o: &&Opening| o.wall == plane.wall && (o.inset - plane.inset).abs() < super::SAME_PLANE;
    room.openings
        .iter()
        .filter(|o| o.kind == OpeningKind::Door)
        .filter(own)
        .map(|o| Rect { min: DVec2::new(o.u[0], o.y[0]), max: DVec2::new(o.u[1], o.y[1]) })
        .filter(|r| r.min.is_finite() && r.max.is_finite())
        .collect()
}

/// Where planes that look as a wall does meet the floor or the ceiling, at a height: ranges along them.
fn stretches(room: &Room, wall: Surface, height: f64) -> Vec<(WallPlane, [f64; 2])> {
    let mut out: Vec<(WallPlane, [f64; 2])> = Vec::new();
    for face in room.all_faces() {
        let Some(plane) = face.plane(&room.extents).filter(|p| p.wall.surface() == wall) else { continue };
        let at = face.polygon.iter().filter(|p| (p.y - height).abs() < 1e-6).map(|p| plane.coordinates(*p).x);
        let (low, high) = at.fold((f64::MAX, f64::MIN), |(l, h), u| (l.min(u), h.max(u)));
        if high - low > SHORTEST {
            out.push((plane, [low, high]));
        }
    }
    out.sort_by(|a, b| a.0.inset.total_cmp(&b.0.inset).then(a.1[0].total_cmp(&b.1[0])));
    out.dedup_by(|next, last| {
        let joins = (next.0.inset - last.0.inset).abs() < 1e-6 && next.1[0] <= last.1[1] + 1e-6;
        if joins {
            last.1[1] = last.1[1].max(next.1[1]);
        }
        joins
    });
    out
}

/// What the doors leave of a stretch of wall.
fn gaps<'a>([from, to]: [f64; 2], doors: impl Iterator<Item = &'a Rect>) -> Vec<[f64; 2]> {
    let mut taken: Vec<[f64; 2]> = doors.map(|d| [d.min.x, d.max.x]).collect();
    taken.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut from = from;
    let mut out = Vec::new();
    for [a, b] in taken.into_iter().chain([[to, to]]) {
        if a.min(to) - from > SHORTEST {
            out.push([from, a.min(to)]);
        }
        from = from.max(b);
    }
    out
}

impl Board {
    fn add(&self, mesh: &mut Mesh, triangles: &mut Vec<[u32; 3]>, plane: WallPlane, e: &Extents, trim: &Trim) {
        let bevel = (trim.depth * BEVEL).min((self.y[1] - self.y[0]) * 0.5);
        let [low, high] = self.y;
        // Outline across the board, from the wall under it to the wall over it: depth and height.
        let outline = match self.edge {
            Edge::Top => {
                vec![[0.0, low], [trim.depth, low], [trim.depth, high - bevel], [trim.depth - bevel, high], [0.0, high]]
            }
            Edge::Bottom => {
                vec![[0.0, low], [trim.depth - bevel, low], [trim.depth, low + bevel], [trim.depth, high], [0.0, high]]
            }
            Edge::Sharp => vec![[0.0, low], [trim.depth, low], [trim.depth, high], [0.0, high]],
        };
        let at = |u: f64, p: [f64; 2]| plane.point(e, u, p[1]) + plane.normal() * p[0];
        let along = at(1.0, [0.0; 2]) - at(0.0, [0.0; 2]);
        for pair in outline.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            let normal = plane.normal() * (b[1] - a[1]) - DVec3::Y * (b[0] - a[0]);
            let corners = [at(self.u[0], a), at(self.u[1], a), at(self.u[1], b), at(self.u[0], b)];
            polygon(mesh, triangles, &corners, normal);
        }
        for (u, normal) in [(self.u[0], -along), (self.u[1], along)] {
            let corners: Vec<DVec3> = outline.iter().map(|p| at(u, *p)).collect();
            polygon(mesh, triangles, &corners, normal);
        }
    }
}

/// A flat convex polygon whose front is where the normal points.
fn polygon(mesh: &mut Mesh, triangles: &mut Vec<[u32; 3]>, corners: &[DVec3], normal: DVec3) {
    let normal = normal.normalize_or(DVec3::Y);
    let first = mesh.positions.len() as u32;
    for corner in corners {
        mesh.positions.push(corner.as_vec3());
        mesh.normals.push(normal.as_vec3());
        mesh.uvs.push(Vec2::ZERO);
    }
    let agrees = (corners[1] - corners[0]).cross(corners[2] - corners[0]).dot(normal) >= 0.0;
    for k in 1..corners.len() as u32 - 1 {
        let (b, c) = if agrees { (k, k + 1) } else { (k + 1, k) };
        triangles.push([first, first + b, first + c]);
    }
}

#[cfg(test)]
mod tests {
    use harmony_scene::Wall;

    use super::*;
    use crate::{Bvh, ShellOptions, room_shell_with};

    fn room() -> Room {
        let door = Opening {
            kind: OpeningKind::Door,
            wall: Wall::Left,
            u: [3.0, 3.9],
            y: [0.0, 2.0],
            inset: 0.0,
            rise: 0.0,
            object: None,
        };
        let window = Opening {
            kind: OpeningKind::Window,
            wall: Wall::Back,
            u: [1.0, 2.0],
            y: [0.9, 2.0],
            inset: 0.0,
            rise: 0.0,
            object: None,
        };
        Room {
            room_type: "bedroom".into(),
            extents: Extents { width: 4.0, height: 2.5, depth: 5.0 },
            shape: harmony_scene::RoomShape::default(),
            seen: vec![],
            openings: vec![door, window],
            floor_texture: None,
            wall_texture: None,
        }
    }

    fn board(height: f64) -> Trim {
        Trim { height, depth: 0.015, color: [0.8; 3] }
    }

    #[test]
    fn boards_go_round_the_room_and_leave_the_door_out() {
        let trims = Trims { skirting: Some(board(0.1)), cornice: Some(board(0.06)), casing: Some(board(0.07)) };
        let shell = room_shell_with(&room(), &|_| None, &ShellOptions { trims, ..ShellOptions::default() });
        shell.check().unwrap();
        let names: Vec<&str> = shell.materials.iter().skip(6).map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["skirting", "cornice", "casing"]);
        let bvh = Bvh::new(&shell);
        let eye = DVec3::new(2.0, 1.4, 2.5);
        let reach = |target: DVec3| bvh.raycast(eye, target - eye, 100.0).map(|h| h.point);
        // On each wall the ray to a point 5 cm above the floor meets the board 15 mm before the wall.
        for (target, axis) in [
            (DVec3::new(1.5, 0.05, 0.0), DVec3::Z),
            (DVec3::new(0.0, 0.05, 1.0), DVec3::X),
            (DVec3::new(4.0, 0.05, 1.0), DVec3::NEG_X),
            (DVec3::new(1.0, 0.05, 5.0), DVec3::NEG_Z),
        ] {
            let hit = reach(target).expect("the board");
            assert!(((hit - target).dot(axis) - 0.015).abs() < 1e-6, "{target}: {hit}");
            assert!(bvh.raycast(eye, target - eye, 100.0).unwrap().normal.dot(axis) > 0.99);
        }
        // Through the door, down onto its threshold outside.
        assert!(reach(DVec3::new(0.0, 0.05, 3.4)).is_none_or(|p| p.x < -0.01));
        // The door's casing, beside and above it, and no board over the window's sill.
        for target in [DVec3::new(0.0, 1.0, 2.97), DVec3::new(0.0, 2.03, 3.4)] {
            assert!((reach(target).unwrap().x - 0.015).abs() < 1e-6);
        }
        assert!(reach(DVec3::new(1.5, 0.5, 0.0)).unwrap().z.abs() < 1e-6);
        assert!((reach(DVec3::new(1.5, 2.48, 0.0)).unwrap().z - 0.015).abs() < 1e-6, "the cornice");
    }

    #[test]
    fn walls_that_are_left_out_have_no_boards() {
        let trims = Trims { skirting: Some(board(0.1)), ..Trims::default() };
        let omit = vec![Surface::Front, Surface::Right];
        let shell = room_shell_with(&room(), &|_| None, &ShellOptions { omit, trims, ..ShellOptions::default() });
        let boards = shell.groups.last().unwrap();
        let inside = |p: glam::Vec3| p.x < 0.02 || p.z < 0.02;
        assert!(boards.triangles.iter().flatten().all(|i| inside(shell.positions[*i as usize])));
    }
}
