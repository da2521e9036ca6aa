//! Where things stand: boxes on the floor, on walls, under the ceiling and on other things, none in another's way.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use harmony_scene::{Extents, Room, Wall, WallPlane};

use super::dice::Dice;
use super::form::{Form, room_of};
use super::is_rug;
use super::pieces::{Piece, Top};

/// Where an object belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// On a wall.
    Wall,
    /// On the floor.
    Furniture,
    /// Under the ceiling.
    Ceiling,
    /// On another object.
    Decoration,
}

impl Level {
    /// The name in `objects.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Wall => "wall",
            Self::Furniture => "furniture",
            Self::Ceiling => "ceiling",
            Self::Decoration => "decoration",
        }
    }
}

/// What an object looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Facing {
    /// Nothing in particular.
    Nothing,
    /// Away from its wall.
    Room,
    /// Another object, by number.
    Object(usize),
}

/// An object with its place.
#[derive(Debug, Clone)]
pub(super) struct Item {
    pub(super) piece: Arc<Piece>,
    pub(super) level: Level,
    /// Bottom centre; centre for things on walls.
    pub(super) position: DVec3,
    pub(super) yaw: f64,
    pub(super) wall: Option<Wall>,
    /// How far before that wall the plane behind it is, metres.
    pub(super) inset: f64,
    /// What it stands on, when that is an object.
    pub(super) host: Option<usize>,
    pub(super) facing: Facing,
    pub(super) group: Option<&'static str>,
    /// The table that it is partly under.
    pub(super) tucked: Option<usize>,
}

impl Item {
    /// A point of the canonical frame in the room.
    pub(super) fn to_room(&self, p: DVec3) -> DVec3 {
        turn(self.yaw, p) + self.position
    }

    /// Lowest and highest y.
    pub(super) fn heights(&self) -> [f64; 2] {
        let h = self.piece.size.y;
        let low = self.position.y - if self.level == Level::Wall { h / 2.0 } else { 0.0 };
        [low, low + h]
    }

    fn corners(&self, gap: f64) -> [DVec2; 4] {
        let (a, b) = (self.piece.size.x / 2.0 + gap, self.piece.size.z / 2.0 + gap);
        [(-a, -b), (a, -b), (a, b), (-a, b)].map(|(x, z)| {
            let p = self.to_room(DVec3::new(x, 0.0, z));
            DVec2::new(p.x, p.z)
        })
    }

    /// Whether the boxes come closer than `gap`.
    fn meets(&self, other: &Self, gap: f64) -> bool {
        let ([a0, a1], [b0, b1]) = (self.heights(), other.heights());
        a0 < b1 + gap.min(0.0) && b0 < a1 + gap.min(0.0) && overlap(&self.corners(gap), &other.corners(0.0))
    }
}

/// Ry(yaw) p.
pub(super) fn turn(yaw: f64, p: DVec3) -> DVec3 {
    let (s, c) = yaw.sin_cos();
    DVec3::new(p.x * c + p.z * s, p.y, -p.x * s + p.z * c)
}

/// Separating axes of two rectangles.
fn overlap(a: &[DVec2; 4], b: &[DVec2; 4]) -> bool {
    let separated = |edge: DVec2| {
        let axis = DVec2::new(-edge.y, edge.x);
        let span = |r: &[DVec2; 4]| {
            r.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), p| (lo.min(p.dot(axis)), hi.max(p.dot(axis))))
        };
        let ((a0, a1), (b0, b1)) = (span(a), span(b));
        a1 <= b0 || b1 <= a0
    };
    ![a[1] - a[0], a[2] - a[1], b[1] - b[0], b[2] - b[1]].into_iter().any(separated)
}

/// A cut-out of a wall or a door on it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hole {
    pub(super) door: bool,
    pub(super) wall: Wall,
    /// How far before the wall of the box its plane is, metres.
    pub(super) inset: f64,
    pub(super) u: [f64; 2],
    pub(super) y: [f64; 2],
    pub(super) item: usize,
}

impl Hole {
    /// The plane that it is cut into.
    pub(super) fn plane(&self) -> WallPlane {
        WallPlane { wall: self.wall, inset: self.inset }
    }
}

/// Air at walls, so that nothing cuts the skirting boards, metres.
const WALL_GAP: f64 = 0.03;

/// Where a plane that looks as a wall does meets the floor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretch {
    pub(super) plane: WallPlane,
    pub(super) u: [f64; 2],
}

/// All stretches of a room, wall by wall; those of a box are its walls.
fn stretches(room: &Room) -> Vec<Stretch> {
    let e = &room.extents;
    if room.shape.is_box() {
        return Wall::ALL.map(|wall| Stretch { plane: wall.into(), u: [0.0, wall.length(e)] }).to_vec();
    }
    let at_floor = |face: &harmony_scene::RoomFace| {
        let plane = face.plane(e)?;
        let feet = face.polygon.iter().filter(|p| p.y.abs() < 1e-6).map(|p| plane.coordinates(*p).x);
        let (low, high) = feet.fold((f64::MAX, f64::MIN), |(l, h), u| (l.min(u), h.max(u)));
        (high > low).then_some(Stretch { plane, u: [low, high] })
    };
    let mut out: Vec<Stretch> = room.all_faces().iter().filter_map(at_floor).collect();
    let place = |s: &Stretch| Wall::ALL.iter().position(|w| *w == s.plane.wall);
    out.sort_by(|a, b| {
        place(a).cmp(&place(b)).then(a.plane.inset.total_cmp(&b.plane.inset)).then(a.u[0].total_cmp(&b.u[0]))
    });
    out.dedup_by(|next, last| {
        let one = next.plane.wall == last.plane.wall && (next.plane.inset - last.plane.inset).abs() < 1e-6;
        let joins = one && next.u[0] <= last.u[1] + 1e-6;
        if joins {
            last.u[1] = last.u[1].max(next.u[1]);
        }
        joins
    });
    out
}

/// Free floor before a passage, metres.
const PASSAGE_FREE: f64 = 0.7;

/// A room while it is furnished.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub(super) extents: Extents,
    /// What makes it other than its box.
    pub(super) form: Form,
    /// The empty room.
    pub(super) room: Room,
    /// Where walls meet the floor.
    stretches: Vec<Stretch>,
    pub(super) items: Vec<Item>,
    pub(super) holes: Vec<Hole>,
    /// Boxes where no furniture goes: before doors, before windows above the sill.
    keep_out: Vec<(DVec3, DVec3)>,
}

impl Plan {
    pub(super) fn new(extents: Extents, form: Form) -> Self {
        let room = room_of(extents, form.shape.clone());
        let stretches = stretches(&room);
        let passages = form.passages.clone();
        let mut plan =
            Self { extents, form, room, stretches, items: Vec::new(), holes: Vec::new(), keep_out: Vec::new() };
        for o in passages {
            let (a, b) = (o.wall.point(&extents, o.u[0], 0.0), o.wall.point(&extents, o.u[1], o.y[1]));
            plan.reserve(a, b + o.wall.normal() * PASSAGE_FREE);
        }
        plan
    }

    /// Where walls meet the floor, wall by wall.
    pub(super) fn stretches(&self) -> &[Stretch] {
        &self.stretches
    }

    /// The plane of a wall that furniture at a place along it stands against: the longest stretch there.
    pub(super) fn plane_at(&self, wall: Wall, u: f64) -> WallPlane {
        let there = self.stretches.iter().filter(|s| s.plane.wall == wall && (s.u[0]..=s.u[1]).contains(&u));
        there.max_by(|a, b| (a.u[1] - a.u[0]).total_cmp(&(b.u[1] - b.u[0]))).map_or(wall.into(), |s| s.plane)
    }

    /// Whether windows and doors may be cut there: behind the face of a chimney breast is its flue.
    pub(super) fn may_open(&self, plane: WallPlane, u: f64) -> bool {
        let behind = plane.point(&self.extents, u, 1.0) - plane.normal() * 0.01;
        let holds = |b: &harmony_scene::Block| behind.cmpge(b.min).all() && behind.cmple(b.max).all();
        !self.form.shape.blocks.iter().any(|b| b.kind == "chimney_breast" && holds(b))
    }

    /// Whether a point is in the room's free space with so much air on all sides.
    pub(super) fn is_free_around(&self, p: DVec3, air: f64) -> bool {
        let around = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|a| [p + a * air, p - a * air]);
        around.chain([p]).all(|q| self.room.is_free(q))
    }

    /// Whether an item keeps clear of blocks and slopes, and one on a wall has wall behind all of it.
    fn clear_of_shape(&self, item: &Item) -> bool {
        let [low, high] = item.heights();
        let before_passage = |o: &harmony_scene::Opening| {
            let (u, half) = (o.wall.coordinates(item.position).x, item.piece.size.x / 2.0 + 0.03);
            item.wall == Some(o.wall) && u + half > o.u[0] && u - half < o.u[1] && low < o.y[1]
        };
        if item.level == Level::Wall && self.form.passages.iter().any(before_passage) {
            return false;
        }
        if self.form.shape.is_box() {
            return true;
        }
        if let (Level::Wall, Some(wall)) = (item.level, item.wall) {
            let plane = WallPlane { wall, inset: item.inset };
            let (u, half) = (plane.coordinates(item.position).x, item.piece.size.x / 2.0);
            let out = plane.distance(&self.extents, item.position) + item.piece.size.z / 2.0;
            return [u - half, u, u + half].into_iter().all(|u| {
                [low.max(0.02), f64::midpoint(low, high), high].into_iter().all(|y| {
                    let at = |d: f64| self.room.is_free(plane.point(&self.extents, u, y) + plane.normal() * d);
                    at(0.01) && at(out.max(0.01)) && !at(-0.01)
                })
            });
        }
        let corners = item.corners(WALL_GAP - 0.005);
        let blocked = self.form.shape.blocks.iter().any(|b| {
            let rect = [(b.min.x, b.min.z), (b.max.x, b.min.z), (b.max.x, b.max.z), (b.min.x, b.max.z)];
            low < b.max.y && high > b.min.y && overlap(&corners, &rect.map(|(x, z)| DVec2::new(x, z)))
        });
        let under = |p: &DVec2| {
            let top = DVec3::new(p.x, high, p.y);
            self.form.shape.slopes.iter().all(|s| s.below(&self.extents, top) > 0.01)
        };
        !blocked && corners.iter().all(under)
    }

    /// Keeps furniture out of a box.
    pub(super) fn reserve(&mut self, a: DVec3, b: DVec3) {
        self.keep_out.push((a.min(b), a.max(b)));
    }

    /// The item when it has room, else nothing.
    fn settle(&mut self, item: Item, gap: f64, ignore: &[usize]) -> Option<usize> {
        let corners = item.corners(0.0);
        let [low, high] = item.heights();
        let e = self.extents;
        let margin = if item.level == Level::Wall { -0.2 } else { WALL_GAP - 0.005 };
        let inside = corners
            .iter()
            .all(|p| p.x >= margin && p.x <= e.width - margin && p.y >= margin && p.y <= e.depth - margin);
        if !inside || low < -1e-9 || high > e.height - 0.001 || !self.clear_of_shape(&item) {
            return None;
        }
        for (k, other) in self.items.iter().enumerate() {
            let skip = ignore.contains(&k) || is_rug(&item) != is_rug(other) || item.host == Some(k);
            if !skip && item.meets(other, gap) {
                return None;
            }
        }
        if item.level == Level::Furniture && !is_rug(&item) {
            for (a, b) in &self.keep_out {
                let rect = [(a.x, a.z), (b.x, a.z), (b.x, b.z), (a.x, b.z)].map(|(x, z)| DVec2::new(x, z));
                if low < b.y && high > a.y && overlap(&corners, &rect) {
                    return None;
                }
            }
        }
        self.items.push(item);
        Some(self.items.len() - 1)
    }

    fn item(piece: &Arc<Piece>, level: Level, position: DVec3, yaw: f64) -> Item {
        Item {
            piece: Arc::clone(piece),
            level,
            position,
            yaw,
            wall: None,
            inset: 0.0,
            host: None,
            facing: Facing::Nothing,
            group: None,
            tucked: None,
        }
    }

    /// Furniture somewhere, closer than usual only to `ignore`.
    pub(super) fn stand(&mut self, piece: &Arc<Piece>, at: DVec2, yaw: f64, ignore: &[usize]) -> Option<usize> {
        let item = Self::item(piece, Level::Furniture, DVec3::new(at.x, 0.0, at.y), yaw);
        self.settle(item, 0.02, ignore)
    }

    /// Furniture with its back to a wall, its middle at `u`.
    pub(super) fn against(&mut self, piece: &Arc<Piece>, wall: Wall, u: f64, gap: f64) -> Option<usize> {
        let plane = self.plane_at(wall, u);
        let foot = plane.point(&self.extents, u, 0.0);
        let at = foot + wall.normal() * (piece.size.z / 2.0 + WALL_GAP + gap);
        let mut item = Self::item(piece, Level::Furniture, at, wall.yaw());
        item.wall = Some(wall);
        item.inset = plane.inset;
        item.facing = Facing::Room;
        self.settle(item, 0.025, &[])
    }

    /// Furniture with its back to one of the walls, wherever there is room.
    pub(super) fn against_any(&mut self, dice: &mut Dice, piece: &Arc<Piece>, walls: &[Wall]) -> Option<usize> {
        (0..24).find_map(|_| {
            let wall = dice.pick(walls);
            let (half, length) = (piece.size.x / 2.0 + WALL_GAP, wall.length(&self.extents));
            // Side walls are in view in their far part.
            let end = if wall == Wall::Back { length - half } else { (length * 0.82).min(length - half) };
            (end > half)
                .then(|| dice.range(half, end))
                .and_then(|u| self.against(piece, wall, u, dice.range(0.0, 0.04)))
        })
    }

    /// Furniture somewhere on the free floor, turned any way within `spread` of a yaw.
    pub(super) fn anywhere(&mut self, dice: &mut Dice, piece: &Arc<Piece>, yaw: f64, spread: f64) -> Option<usize> {
        (0..30).find_map(|_| {
            let at = DVec2::new(dice.range(0.2, self.extents.width - 0.2), dice.range(0.2, self.extents.depth * 0.75));
            self.stand(piece, at, yaw + dice.range(-spread, spread), &[])
        })
    }

    /// A corner or the foot of a wall, for plants and baskets.
    pub(super) fn edge(&mut self, dice: &mut Dice, piece: &Arc<Piece>) -> Option<usize> {
        (0..30).find_map(|_| {
            let r = piece.size.x.max(piece.size.z) / 2.0 + WALL_GAP + 0.02;
            let e = self.extents;
            let along = dice.range(r, (e.depth * 0.7).max(r));
            let at = match dice.int(0, 4) {
                0 => DVec2::new(r, r),
                1 => DVec2::new(e.width - r, r),
                2 => DVec2::new(r, along),
                3 => DVec2::new(e.width - r, along),
                _ => DVec2::new(dice.range(r, (e.width - r).max(r)), r),
            };
            let yaw = if dice.chance(0.7) { dice.range(-3.1, 3.1) } else { 0.0 };
            self.stand(piece, at, yaw, &[])
        })
    }

    /// Something on a wall: its centre at (u, y), its back `out` metres before the wall.
    pub(super) fn on_wall(&mut self, piece: &Arc<Piece>, wall: Wall, at: [f64; 2], out: f64) -> Option<usize> {
        let plane = self.plane_at(wall, at[0]);
        let centre = plane.point(&self.extents, at[0], at[1]) + wall.normal() * (piece.size.z / 2.0 + out);
        self.on_wall_at(piece, plane, centre, &[])
    }

    /// The same with a stated centre, closer than usual only to `ignore`.
    pub(super) fn on_wall_at(
        &mut self,
        piece: &Arc<Piece>,
        plane: WallPlane,
        centre: DVec3,
        ignore: &[usize],
    ) -> Option<usize> {
        let wall = plane.wall;
        let half = piece.size.x / 2.0 + 0.03;
        let u = wall.coordinates(centre).x;
        if u < half || u > wall.length(&self.extents) - half {
            return None;
        }
        let mut item = Self::item(piece, Level::Wall, centre, wall.yaw());
        item.wall = Some(wall);
        item.inset = plane.inset;
        item.facing = Facing::Room;
        self.settle(item, 0.03, ignore)
    }

    /// Something on one of the walls at a height, wherever there is room.
    pub(super) fn on_any_wall(
        &mut self,
        dice: &mut Dice,
        piece: &Arc<Piece>,
        walls: &[Wall],
        y: [f64; 2],
    ) -> Option<usize> {
        (0..24).find_map(|_| {
            let wall = dice.pick(walls);
            let length = wall.length(&self.extents);
            let u = dice.range(0.0, if wall == Wall::Back { length } else { length * 0.75 });
            let y = dice.range(y[0], y[1]);
            self.on_wall(piece, wall, [u, y], 0.002)
        })
    }

    /// Something under the ceiling, a few millimetres of air above.
    pub(super) fn hang(&mut self, piece: &Arc<Piece>, at: DVec2, yaw: f64) -> Option<usize> {
        let room = super::form::room_of(self.extents, self.form.shape.clone());
        let y = room.ceiling_over(DVec3::new(at.x, 0.0, at.y)) - piece.size.y - 0.002;
        let item = Self::item(piece, Level::Ceiling, DVec3::new(at.x, y, at.y), yaw);
        self.settle(item, 0.03, &[])
    }

    /// A thing on a host's top; `at` in -1..1 of the place, or anywhere.
    pub(super) fn on(
        &mut self,
        dice: &mut Dice,
        host: usize,
        piece: &Arc<Piece>,
        at: Option<[f64; 2]>,
        yaw: f64,
    ) -> Option<usize> {
        let owner = self.items[host].clone();
        let fits = |t: &&Top| t.clear > piece.size.y && t.y + owner.heights()[0] < 1.95;
        let top = *owner.piece.tops.iter().find(fits)?;
        let base = owner.to_room(DVec3::ZERO);
        let tries = if at.is_some() { 1 } else { 16 };
        (0..tries).find_map(|_| {
            let t = at.unwrap_or_else(|| [dice.range(-1.0, 1.0), dice.range(-1.0, 1.0)]);
            let yaw = yaw + if at.is_some() { 0.0 } else { dice.range(-0.5, 0.5) };
            // The thing's own reach along the host's axes.
            let (s, c) = (yaw.sin().abs(), yaw.cos().abs());
            let reach = [piece.size.x * c + piece.size.z * s, piece.size.x * s + piece.size.z * c];
            let place = |i: usize| {
                let slack = ((top.max[i] - top.min[i] - reach[i]) / 2.0).max(0.0);
                f64::midpoint(top.min[i], top.max[i]) + slack * t[i]
            };
            let fits = (0..2).all(|i| top.max[i] - top.min[i] >= reach[i] * 0.9);
            let p = turn(owner.yaw, DVec3::new(place(0), top.y, place(1))) + base;
            let mut item = Self::item(piece, Level::Decoration, p, owner.yaw + yaw);
            item.host = Some(host);
            let ignore: Vec<usize> = owner.tucked.into_iter().collect();
            fits.then(|| self.settle(item, 0.012, &ignore)).flatten()
        })
    }

    /// Names the set of some items.
    pub(super) fn group(&mut self, items: &[Option<usize>], name: &'static str) {
        for i in items.iter().flatten() {
            self.items[*i].group = Some(name);
        }
    }
}
