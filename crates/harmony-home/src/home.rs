//! A home: rooms where they are, doors between them, and what does not fit.

use glam::DVec2;
use harmony_scene::Wall;
use serde::{Deserialize, Serialize};

use crate::frame::Rect;
use crate::layout::{DoorKind, LayoutRoom, outward};
use crate::rooms::{Evidence, RoomRun};
use crate::solve::{Solved, wall_ends};

/// A room of a home.
#[derive(Debug, Clone)]
pub struct HomeRoom {
    /// Its name.
    pub name: String,
    /// Its run; a room of the layout without one stays empty.
    pub run: Option<(RoomRun, Evidence)>,
    /// Its corners where it is no rectangle, home frame; else empty.
    pub polygon: Vec<DVec2>,
    /// Where it is.
    pub solved: Solved,
    /// Where it was before all rooms were refined together.
    pub before: Solved,
}

/// A door in a home: one way through one wall.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HomeDoor {
    /// One room or two.
    pub rooms: Vec<usize>,
    /// The side of the first that it is in.
    pub side: Wall,
    /// Range along the wall, home frame, metres.
    pub range: [f64; 2],
    /// Height of its top above the floor, metres.
    pub top: f64,
    /// What it is.
    pub kind: DoorKind,
    /// What each room's run has of it: number of the opening in its room, and how far its middle is off, metres.
    pub seen: Vec<Option<(usize, f64)>>,
    /// The same before the rooms were refined together.
    pub before: Vec<Option<f64>>,
}

/// Something that does not fit, with its size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "what", rename_all = "snake_case")]
pub enum Conflict {
    /// Two rooms share floor.
    Overlap {
        /// Names.
        rooms: [String; 2],
        /// Width of what they share, metres.
        metres: f64,
        /// Its area, square metres.
        square_metres: f64,
    },
    /// A door of a run is not where the home has it.
    DoorOff {
        /// The room.
        room: String,
        /// The room beyond, if any.
        to: Option<String>,
        /// How far its middle is off along the wall, centimetres.
        centimetres: f64,
    },
    /// A wall that a run took from its photo is not where the home has it.
    WallOff {
        /// The room.
        room: String,
        /// The wall, as the photo has it.
        wall: Wall,
        /// By how much, centimetres.
        centimetres: f64,
    },
    /// A room's photo shows the wall, but no door in it.
    DoorMissing {
        /// The room.
        room: String,
        /// The room beyond, if any.
        to: Option<String>,
    },
    /// A door that leads nowhere in the home.
    DoorNowhere {
        /// The room.
        room: String,
        /// The object.
        object: Option<String>,
    },
    /// A wall between two rooms is thinner than walls are.
    ThinWall {
        /// Names.
        rooms: [String; 2],
        /// Its thickness, centimetres.
        centimetres: f64,
    },
    /// A run had to be scaled by more than its height leaves open.
    Scaled {
        /// The room.
        room: String,
        /// The factor less one, percent.
        percent: f64,
    },
    /// A room of the layout has no photo.
    NoPhoto {
        /// The room.
        room: String,
    },
    /// An object reaches out of its room.
    Outside {
        /// The object.
        object: String,
        /// By how much, centimetres.
        centimetres: f64,
    },
    /// A window looks into another room.
    InnerWindow {
        /// The object or the room.
        object: String,
        /// The room behind it.
        to: String,
    },
}

impl std::fmt::Display for Conflict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let beyond = |to: &Option<String>| to.as_ref().map_or_else(|| "outside".to_owned(), Clone::clone);
        match self {
            Self::Overlap { rooms: [a, b], metres, square_metres } => {
                write!(f, "{a} and {b} overlap by {metres:.2} m, {square_metres:.2} m2")
            }
            Self::DoorOff { room, to, centimetres } => {
                write!(f, "the door from {room} to {} is off by {centimetres:.0} cm in its photo", beyond(to))
            }
            Self::WallOff { room, wall, centimetres } => {
                write!(f, "the {} wall of {room} is off by {centimetres:.0} cm in its photo", wall.surface().name())
            }
            Self::DoorMissing { room, to } => {
                write!(f, "the photo of {room} shows the wall but no door to {}", beyond(to))
            }
            Self::DoorNowhere { room, object } => {
                write!(f, "{} of {room} leads nowhere in this home", object.as_deref().unwrap_or("a door"))
            }
            Self::ThinWall { rooms: [a, b], centimetres } => {
                write!(f, "the wall between {a} and {b} is {centimetres:.1} cm thick")
            }
            Self::Scaled { room, percent } => write!(f, "{room} was scaled by {percent:+.1} %"),
            Self::NoPhoto { room } => write!(f, "{room} has no photo and stays empty"),
            Self::Outside { object, centimetres } => {
                write!(f, "{object} reaches {centimetres:.0} cm out of its room")
            }
            Self::InnerWindow { object, to } => write!(f, "{object} looks into {to}"),
        }
    }
}

/// All that is known of a home before it becomes one scene.
#[derive(Debug, Clone)]
pub struct Home {
    /// Rooms.
    pub rooms: Vec<HomeRoom>,
    /// Doors.
    pub doors: Vec<HomeDoor>,
    /// Thickness of outer walls, metres.
    pub outer_wall: f64,
    /// What does not fit.
    pub conflicts: Vec<Conflict>,
    /// What else is to be said, one sentence each.
    pub notes: Vec<String>,
}

/// Off by more than this a door does not meet, metres.
const DOOR_MEETS_M: f64 = 0.05;
/// Walls that a photo has this far elsewhere are told, metres.
const WALL_OFF_M: f64 = 0.15;
/// Rooms that share more than this overlap, metres.
const OVERLAP_M: f64 = 0.01;
/// Walls between rooms are at least this thick, metres.
const THIN_M: f64 = 0.05;
/// Scales that are told of, relative.
const SCALED: f64 = 0.08;

impl HomeRoom {
    /// Rectangles that make up its floor.
    pub fn free(&self) -> Vec<Rect> {
        if self.polygon.is_empty() {
            return vec![self.solved.rect];
        }
        LayoutRoom { polygon: self.polygon.clone(), ..LayoutRoom::empty(&self.name) }.free()
    }

    /// What of its bounding rectangle is not the room's.
    pub fn missing(&self) -> Vec<Rect> {
        LayoutRoom { polygon: self.polygon.clone(), ..LayoutRoom::empty(&self.name) }.missing()
    }
}

impl HomeDoor {
    /// The faces of the wall that it goes through: of its first room, and of the second, or `outer` metres behind.
    pub fn faces(&self, rooms: &[HomeRoom], outer: f64) -> [f64; 2] {
        let a = rooms[self.rooms[0]].solved.rect.side(self.side);
        let b = self
            .rooms
            .get(1)
            .map_or(a + outer * outward(self.side), |r| rooms[*r].solved.rect.side(self.side.opposite()));
        [a, b]
    }

    /// Its floor.
    pub fn floor(&self, rooms: &[HomeRoom], outer: f64) -> Rect {
        let [a, b] = self.faces(rooms, outer);
        let (low, high) = (a.min(b), a.max(b));
        let [u0, u1] = self.range;
        match self.side {
            Wall::Left | Wall::Right => Rect { min: DVec2::new(low, u0), max: DVec2::new(high, u1) },
            Wall::Back | Wall::Front => Rect { min: DVec2::new(u0, low), max: DVec2::new(u1, high) },
        }
    }
}

impl Home {
    /// The smallest rectangle around all rooms.
    pub fn bounds(&self) -> Rect {
        let mut rects = self.rooms.iter().map(|r| r.solved.rect);
        let first = rects.next().expect("a home has rooms");
        rects.fold(first, |a, b| a.around(&b))
    }

    /// Finds what does not fit between rooms and doors.
    pub fn find_conflicts(&mut self) {
        let mut out = Vec::new();
        let name = |k: usize| self.rooms[k].name.clone();
        for (i, a) in self.rooms.iter().enumerate() {
            if a.run.is_none() {
                out.push(Conflict::NoPhoto { room: a.name.clone() });
            }
            if let Some((_, evidence)) = &a.run {
                for wall in Wall::ALL.into_iter().filter(|w| evidence.sees(w.surface())) {
                    let [p, q] = wall_ends(evidence, &a.solved.place, wall);
                    let off = f64::midpoint(p, q) - a.solved.rect.side(a.solved.place.turn.wall(wall));
                    if off.abs() > WALL_OFF_M {
                        out.push(Conflict::WallOff { room: a.name.clone(), wall, centimetres: off.abs() * 100.0 });
                    }
                }
            }
            let percent = (a.solved.place.scale - 1.0) * 100.0;
            if a.run.is_some() && percent.abs() > SCALED * 100.0 {
                out.push(Conflict::Scaled { room: a.name.clone(), percent });
            }
            for b in &self.rooms[i + 1..] {
                let met = a.free().into_iter().flat_map(|x| b.free().into_iter().filter_map(move |y| x.meet(&y)));
                let met: Vec<Rect> = met.filter(|r| r.size().min_element() > OVERLAP_M).collect();
                if !met.is_empty() {
                    let metres = met.iter().map(|r| r.size().min_element()).fold(0.0, f64::max);
                    let square_metres = met.iter().map(Rect::area).sum();
                    out.push(Conflict::Overlap { rooms: [a.name.clone(), b.name.clone()], metres, square_metres });
                }
            }
        }
        for door in &self.doors {
            if let [a, b] = door.rooms[..] {
                let [from, to] = door.faces(&self.rooms, self.outer_wall);
                let thickness = (to - from) * outward(door.side);
                if thickness < THIN_M {
                    out.push(Conflict::ThinWall { rooms: [name(a), name(b)], centimetres: thickness * 100.0 });
                }
            }
            for (k, room) in door.rooms.iter().enumerate() {
                let to = door.rooms.iter().find(|r| *r != room).map(|r| name(*r));
                let side = if k == 0 { door.side } else { door.side.opposite() };
                let Some((_, evidence)) = &self.rooms[*room].run else { continue };
                match door.seen[k] {
                    Some((_, off)) if off.abs() > DOOR_MEETS_M => {
                        out.push(Conflict::DoorOff { room: name(*room), to, centimetres: off.abs() * 100.0 });
                    }
                    Some(_) => {}
                    None => {
                        let wall = self.rooms[*room].solved.place.turn.inverse().wall(side);
                        if evidence.sees(wall.surface()) {
                            out.push(Conflict::DoorMissing { room: name(*room), to });
                        }
                    }
                }
            }
        }
        self.conflicts.extend(out);
    }
}
