//! A run's room at the size that the home gives it.

use std::collections::BTreeSet;

use glam::{DVec2, DVec3};
use harmony_scene::{Block, Extents, Niche, ObjectId, Opening, OpeningKind, Room, RoomShape, Wall};

use crate::frame::{Place, Rect, in_room, sides};
use crate::home::{Home, HomeRoom};
use crate::rooms::{Evidence, flat};

/// Where an opening comes from.
#[derive(Debug, Clone)]
pub(super) enum OpeningFrom {
    /// The run's own, with what fills it.
    Run(Option<ObjectId>),
    /// A door of the home.
    Door(usize),
}

/// A room at its size in the home, in its own frame.
pub(super) struct Fitted {
    pub(super) room: Room,
    /// Where each of its openings comes from.
    pub(super) from: Vec<OpeningFrom>,
    /// The way into the home, without scale or yaw.
    pub(super) place: Place,
}

impl HomeRoom {
    /// Its size in its own frame.
    fn extents(&self) -> Extents {
        let size = self.solved.rect.size();
        let own = sides(self.solved.place.turn, &Extents { width: size.x, height: self.solved.height, depth: size.y });
        Extents { width: own.x, height: self.solved.height, depth: own.y }
    }

    /// The way from its own frame, at its size in the home, into the home.
    fn straight(&self) -> Place {
        Place { yaw: 0.0, scale: 1.0, at: self.solved.rect.centre(), ..self.solved.place }
    }

    /// A rectangle of the home over a range of height in its own frame.
    fn own_box(&self, rect: &Rect, y: [f64; 2]) -> (DVec3, DVec3) {
        let e = self.extents();
        let turn = self.solved.place.turn;
        let middle = DVec3::new(e.width / 2.0, 0.0, e.depth / 2.0);
        let back = |p: DVec2| {
            let v = p - self.solved.rect.centre();
            // The turn back, its transpose.
            let v = DVec3::new(v.x, 0.0, v.y);
            let own = DVec3::new(v.dot(turn.rotation() * DVec3::X), 0.0, v.dot(turn.rotation() * DVec3::Z));
            own + middle
        };
        let (a, b) = (back(rect.min), back(rect.max));
        (a.min(b).with_y(y[0]), a.max(b).with_y(y[1]))
    }
}

/// Where along a side of the home a point of a run's wall comes to be.
pub(super) fn along(evidence: &Evidence, place: &Place, wall: Wall, u: f64) -> f64 {
    let p = flat(place.point(&evidence.extents, wall.point(&evidence.extents, u, 0.0)));
    if matches!(place.turn.wall(wall), Wall::Left | Wall::Right) { p.y } else { p.x }
}

/// A run's room at its size in the home, without the openings that are doors of the home; those are put in as they are
/// there.
pub(super) fn fitted(home: &Home, index: usize, merged_openings: &BTreeSet<(usize, usize)>) -> Fitted {
    let room = &home.rooms[index];
    let extents = room.extents();
    let (rect, turn) = (room.solved.rect, room.solved.place.turn);
    let (mut openings, mut from) = (Vec::new(), Vec::new());
    let mut shape = RoomShape::default();
    if let Some((run, evidence)) = &room.run {
        let own = &run.world.scene.room;
        for (k, opening) in own.openings.iter().enumerate() {
            if merged_openings.contains(&(index, k)) {
                continue;
            }
            let side = turn.wall(opening.wall);
            let ends =
                opening.u.map(|u| in_room(&rect, turn, side, along(evidence, &room.solved.place, opening.wall, u)).1);
            let y = opening.y.map(|y| (y * room.solved.place.scale).min(extents.height));
            let u = [ends[0].min(ends[1]), ends[0].max(ends[1])];
            openings.push(Opening { u, y, object: None, ..opening.clone() });
            from.push(OpeningFrom::Run(opening.object.clone()));
        }
        if room.polygon.is_empty() {
            shape = stretched(&own.shape, &own.extents, &extents);
        }
    }
    for missing in &room.missing() {
        let (min, max) = room.own_box(missing, [0.0, extents.height]);
        shape.blocks.push(Block { kind: "outside".to_owned(), min, max });
    }
    for (d, door) in home.doors.iter().enumerate() {
        for (k, _) in door.rooms.iter().enumerate().filter(|(_, r)| **r == index) {
            let side = if k == 0 { door.side } else { door.side.opposite() };
            let ends = door.range.map(|at| in_room(&rect, turn, side, at));
            let u = [ends[0].1.min(ends[1].1), ends[0].1.max(ends[1].1)];
            let wall = ends[0].0;
            let inset = inset(&shape, &extents, wall, f64::midpoint(u[0], u[1]));
            openings.push(Opening {
                kind: OpeningKind::Door,
                wall,
                u,
                y: [0.0, door.top],
                inset,
                rise: 0.0,
                object: None,
            });
            from.push(OpeningFrom::Door(d));
        }
    }
    let (room_type, floor_texture, wall_texture, seen) = room.run.as_ref().map_or_else(
        || (String::new(), None, None, Vec::new()),
        |(run, _)| {
            let r = &run.world.scene.room;
            (r.room_type.clone(), r.floor_texture.clone(), r.wall_texture.clone(), r.seen.clone())
        },
    );
    let fitted = Room { room_type, extents, shape, seen, openings, floor_texture, wall_texture };
    Fitted { room: fitted, from, place: room.straight() }
}

/// How far before a wall its plane is at a place along it: blocks that touch the wall stand before it.
fn inset(shape: &RoomShape, extents: &Extents, wall: Wall, u: f64) -> f64 {
    let before = shape.blocks.iter().filter(|b| {
        let (a, c) = (wall.coordinates(b.min).x, wall.coordinates(b.max).x);
        let near = wall.distance(extents, b.min).min(wall.distance(extents, b.max));
        b.min.y < 1.0 && b.max.y > 1.0 && near < 0.01 && (a.min(c)..=a.max(c)).contains(&u)
    });
    before.map(|b| wall.distance(extents, b.min).max(wall.distance(extents, b.max))).fold(0.0, f64::max)
}

/// A shape in a box of another size: everything goes along with it.
fn stretched(shape: &RoomShape, from: &Extents, to: &Extents) -> RoomShape {
    let k = to.as_vec() / from.as_vec();
    let mut out = shape.clone();
    for (min, max) in out
        .blocks
        .iter_mut()
        .map(|Block { min, max, .. }| (min, max))
        .chain(out.niches.iter_mut().map(|Niche { min, max, .. }| (min, max)))
    {
        *min *= k;
        *max *= k;
    }
    for slope in &mut out.slopes {
        slope.low *= k.y;
        slope.run *= if matches!(slope.wall, Wall::Left | Wall::Right) { k.x } else { k.z };
    }
    out
}
