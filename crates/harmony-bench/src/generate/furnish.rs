//! Steps that several kinds of room share.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DVec2, DVec3};
use harmony_scene::{Wall, WallPlane};

use super::form::{RECESS_MARGIN, WINDOW_RECESS};
use super::layout::{Facing, Hole, Level};
use super::pieces::{self, Piece};
use super::rooms::{Decorator, RoomKind};

const IN_VIEW: [Wall; 3] = [Wall::Back, Wall::Left, Wall::Right];

impl Decorator<'_> {
    /// Windows with curtains and radiators, and doors.
    pub(super) fn openings(&mut self, kind: RoomKind) {
        let e = self.plan.extents;
        let fixed = self.fixed;
        for door in fixed.iter().flat_map(|f| &f.doors) {
            let piece = self.make(|d, p| pieces::door(d, p, door.width as f32, door.height as f32));
            self.hang_door(&piece, door.wall, door.u, door.height);
        }
        self.recessed_windows();
        let walls = fixed.map_or(IN_VIEW.to_vec(), |f| f.outside.clone());
        let windows = if kind == RoomKind::Bathroom { self.dice.int(0, 1) } else { self.dice.int(1, 2) };
        let windows = if walls.is_empty() { 0 } else { windows };
        let hanging = self.dice.chance(0.5);
        for _ in 0..windows {
            let wall = self.dice.pick(&walls);
            let length = wall.length(&e);
            let w = self.dice.f(0.8, 1.9).min(length as f32 * 0.5);
            let tall = self.dice.chance(0.15);
            let sill = if tall { 0.16 } else { self.dice.f(0.8, 1.1) };
            let top = (e.height as f32 - self.dice.f(0.25, 0.5)).min(2.25);
            let h = top - sill;
            let (w, h) = ((w * 100.0).round() / 100.0, (h * 100.0).round() / 100.0);
            let (piece, depth) = pieces::window(self.dice, self.palette, w, h);
            let piece = Arc::new(piece);
            let half = f64::from(w) / 2.0 + 0.12;
            let far = if wall == Wall::Back { length - half } else { (length * 0.8).min(length - half) };
            let u = self.dice.range(half, far.max(half + 0.01));
            let plane = self.plan.plane_at(wall, u);
            if !self.plan.may_open(plane, u) {
                continue;
            }
            let centre = plane.point(&e, u, f64::from(sill) - opening_bottom(&piece)) + wall.normal() * depth;
            let Some(item) = self.plan.on_wall_at(&piece, plane, centre, &[]) else { continue };
            let uv = [u - f64::from(w) / 2.0, u + f64::from(w) / 2.0];
            let y = [f64::from(sill), f64::from(sill + h)];
            self.plan.holes.push(Hole { door: false, wall, inset: plane.inset, u: uv, y, item });
            let (a, b) = (plane.point(&e, uv[0], y[0]), plane.point(&e, uv[1], y[1]));
            self.plan.reserve(a - wall.normal() * 0.1, b + wall.normal() * 0.25);
            if hanging && !tall && kind != RoomKind::Bathroom && kind != RoomKind::Kitchen {
                let high = ((y[1] + 0.16).min(e.height - 0.05) - if self.dice.chance(0.6) { 0.06 } else { 0.5 }) as f32;
                let cloth = self.make(|d, p| pieces::curtains(d, p, w, high));
                let top = (y[1] + 0.16).min(e.height - 0.05);
                let out = 0.1 + cloth.size.z / 2.0;
                let at = plane.point(&e, u, top - cloth.size.y / 2.0) + wall.normal() * out;
                if self.plan.on_wall_at(&cloth, plane, at, &[item]).is_some() {
                    self.plan.reserve(a - wall.normal() * 0.1 - DVec3::Y * 0.8, b + wall.normal() * 0.25);
                }
            } else if !tall && self.dice.chance(0.3) {
                let rw = w * self.dice.f(0.6, 0.9);
                let piece = self.make(|d, p| pieces::radiator(d, p, rw));
                self.plan.on_wall(&piece, wall, [u, 0.12 + piece.size.y / 2.0], 0.015);
            }
        }
        if fixed.is_none() && self.dice.chance(0.65) {
            let (w, h) = (self.dice.f(0.82, 0.95), self.dice.f(2.0, 2.1).min(e.height as f32 - 0.1));
            let door = self.make(|d, p| pieces::door(d, p, w, h));
            let wall = self.dice.pick(&[Wall::Left, Wall::Right, Wall::Back]);
            let half = door.size.x / 2.0 + 0.05;
            for _ in 0..6 {
                let u = self.dice.range(half, wall.length(&e) - half);
                if self.hang_door(&door, wall, u, f64::from(h)) {
                    break;
                }
            }
        }
    }

    /// The windows of recesses: they lie in the wall of the box, behind the thick wall's face.
    fn recessed_windows(&mut self) {
        let e = self.plan.extents;
        for niche in self.plan.form.shape.niches.clone() {
            if niche.kind != WINDOW_RECESS {
                continue;
            }
            let Some(wall) = niche.surface.wall() else { continue };
            let (a, b) = (wall.coordinates(niche.min), wall.coordinates(niche.max));
            let (uv, y) = ([a.x + RECESS_MARGIN, b.x - RECESS_MARGIN], [a.y + RECESS_MARGIN, b.y - RECESS_MARGIN]);
            let (w, h) = ((uv[1] - uv[0]) as f32, (y[1] - y[0]) as f32);
            let (piece, depth) = pieces::window(self.dice, self.palette, w, h);
            let piece = Arc::new(piece);
            let u = f64::midpoint(uv[0], uv[1]);
            let centre = wall.point(&e, u, y[0] - opening_bottom(&piece)) + wall.normal() * depth;
            if let Some(item) = self.plan.on_wall_at(&piece, wall.into(), centre, &[]) {
                self.plan.holes.push(Hole { door: false, wall, inset: 0.0, u: uv, y, item });
            }
            let inner = WallPlane { wall, inset: wall.distance(&e, niche.min).max(wall.distance(&e, niche.max)) };
            let (a, b) = (inner.point(&e, uv[0], y[0]), inner.point(&e, uv[1], y[1]));
            self.plan.reserve(a, b + wall.normal() * 0.25);
        }
    }

    /// A door in a wall with free floor before it; whether there was room for it.
    fn hang_door(&mut self, door: &Arc<Piece>, wall: Wall, u: f64, height: f64) -> bool {
        let plane = self.plan.plane_at(wall, u);
        if !self.plan.may_open(plane, u) {
            return false;
        }
        let Some(item) = self.plan.on_wall(door, wall, [u, door.size.y / 2.0], 0.002) else { return false };
        let uv = [u - door.size.x / 2.0, u + door.size.x / 2.0];
        self.plan.holes.push(Hole { door: true, wall, inset: plane.inset, u: uv, y: [0.0, height], item });
        let e = self.plan.extents;
        let (a, b) = (plane.point(&e, uv[0], 0.0), plane.point(&e, uv[1], 2.0));
        self.plan.reserve(a, b + wall.normal() * 0.75);
        true
    }

    /// Pictures, lamps, plants: what any room has.
    pub(super) fn finish(&mut self, kind: RoomKind) {
        let e = self.plan.extents;
        let wet = kind == RoomKind::Bathroom;
        let pictures = if wet || kind == RoomKind::Kitchen { self.dice.int(0, 1) } else { self.dice.int(1, 3) };
        let set = self.dice.chance(0.35);
        let same = self.picture();
        let mut hung = Vec::new();
        for _ in 0..pictures {
            let piece = if set { Arc::clone(&same) } else { self.picture() };
            hung.push(self.plan.on_any_wall(
                self.dice,
                &piece,
                &[Wall::Back, Wall::Back, Wall::Left, Wall::Right],
                [1.45, 1.75],
            ));
        }
        if set && hung.len() > 1 {
            self.plan.group(&hung, "paintings");
        }
        if self.dice.chance(0.35) {
            let clock = self.make(pieces::clock);
            self.plan.on_any_wall(self.dice, &clock, &IN_VIEW, [1.6, 1.95]);
        }
        if !wet && self.dice.chance(0.25) {
            let mirror = self.make(pieces::mirror);
            self.plan.on_any_wall(self.dice, &mirror, &IN_VIEW, [1.4, 1.65]);
        }
        if self.dice.chance(0.4) {
            let shelf = self.make(pieces::wall_shelf);
            if let Some(s) = self.plan.on_any_wall(self.dice, &shelf, &IN_VIEW, [1.35, 1.7]) {
                self.clutter(s, 3);
            }
        }
        if !self.plan.items.iter().any(|i| i.level == Level::Ceiling) && self.dice.chance(0.75) {
            let middle = DVec2::new(e.width * self.dice.range(0.42, 0.58), e.depth * self.dice.range(0.3, 0.5));
            let drop = (e.height - 1.95).clamp(0.35, 0.9) as f32;
            let piece = match self.dice.int(0, 3) {
                0 if e.height > 2.5 && !wet => self.make(pieces::ceiling_fan),
                1 => self.make(pieces::ceiling_lamp),
                2 if e.height > 2.6 && !wet => self.make(|d, p| pieces::chandelier(d, p, drop.max(0.45))),
                _ => self.make(|d, p| pieces::pendant(d, p, drop)),
            };
            self.plan.hang(&piece, middle, 0.0);
        }
        for _ in 0..self.dice.int(0, 2) {
            let plant = self.make(pieces::plant);
            self.plan.edge(self.dice, &plant);
        }
        if !wet && self.dice.chance(0.35) {
            let thing = if self.dice.chance(0.5) { self.make(pieces::basket) } else { self.make(pieces::pouf) };
            self.plan.anywhere(self.dice, &thing, 0.0, 3.1);
        }
    }

    fn picture(&mut self) -> Arc<Piece> {
        let (w, h) = (self.dice.f(0.35, 1.0), self.dice.f(0.35, 0.75));
        self.make(|d, p| pieces::painting(d, p, w, h))
    }

    /// A large piece in the middle of a wall, or wherever it goes.
    pub(super) fn centred(&mut self, piece: &Arc<Piece>, wall: Wall) -> Option<usize> {
        let length = wall.length(&self.plan.extents);
        let shift = self.dice.range(-0.12, 0.12) * length;
        let gap = self.dice.range(0.0, 0.05);
        let middle = if wall == Wall::Back { 0.5 } else { 0.42 };
        self.plan
            .against(piece, wall, length * middle + shift, gap)
            .or_else(|| self.plan.against_any(self.dice, piece, &IN_VIEW))
    }

    /// The same small piece on both sides of a large one, where there is room.
    pub(super) fn beside(&mut self, host: usize, piece: &Arc<Piece>) -> Vec<Option<usize>> {
        let (one, gap) = (self.dice.chance(0.3), self.dice.range(0.04, 0.12));
        let first = self.dice.sign();
        let sides = if one { vec![first] } else { vec![-1.0, 1.0] };
        let Some(wall) = self.plan.items[host].wall else { return Vec::new() };
        sides
            .into_iter()
            .map(|side| {
                let item = &self.plan.items[host];
                let out = side * (item.piece.size.x / 2.0 + gap + piece.size.x / 2.0);
                let p = item.to_room(DVec3::new(out, 0.0, 0.0));
                let u = wall.coordinates(p).x;
                self.plan.against(piece, wall, u, 0.01)
            })
            .collect()
    }

    /// A rug under something; `share` of its width and depth, shifted towards its front.
    pub(super) fn rug_under(&mut self, host: usize, share: [f64; 2], forward: f64) {
        let item = self.plan.items[host].clone();
        let e = self.plan.extents;
        let k = self.dice.range(0.85, 1.05);
        let w = (item.piece.size.x * share[0] * k).min(3.2);
        let d = (item.piece.size.z * share[1] * k).min(2.6);
        let piece = self.make(|dice, p| pieces::rug(dice, p, w as f32, d as f32));
        let p = item.to_room(DVec3::new(0.0, 0.0, item.piece.size.z * forward));
        let odd = item.yaw.sin().abs() > 0.7;
        let (a, b) = if odd {
            (piece.size.z / 2.0 + 0.05, piece.size.x / 2.0 + 0.05)
        } else {
            (piece.size.x / 2.0 + 0.05, piece.size.z / 2.0 + 0.05)
        };
        if 2.0 * a < e.width && 2.0 * b < e.depth {
            let at = DVec2::new(p.x.clamp(a, e.width - a), p.z.clamp(b, e.depth - b));
            self.plan.stand(&piece, at, item.yaw, &[]);
        }
    }

    /// A cabinet against some wall with things on it.
    pub(super) fn storage(&mut self, label: &'static str, w: [f32; 2], h: [f32; 2], probability: f64) {
        if !self.dice.chance(probability) {
            return;
        }
        let size = [self.dice.f(w[0], w[1]), self.dice.f(h[0], h[1]), self.dice.f(0.36, 0.48)];
        let piece = self.make(|d, p| pieces::cabinet(d, p, label, size));
        if let Some(i) = self.plan.against_any(self.dice, &piece, &IN_VIEW) {
            let n = self.dice.int(1, 3);
            self.clutter(i, n);
        }
    }

    /// Bookcases, alike when there are several.
    pub(super) fn shelves(&mut self, most: usize) {
        let n = self.dice.int(usize::from(most > 1), most);
        let high = (self.plan.extents.height as f32 - 0.15).min(2.1);
        let size = [self.dice.f(0.7, 1.0), self.dice.f(1.1, high), self.dice.f(0.26, 0.36)];
        let piece = self.make(|d, p| pieces::bookcase(d, p, size));
        let mut placed = Vec::new();
        for _ in 0..n {
            let next = placed.last().copied().flatten().and_then(|i: usize| {
                let item = &self.plan.items[i];
                let wall = item.wall?;
                let p = item.to_room(DVec3::new(piece.size.x + 0.03, 0.0, 0.0));
                self.plan.against(&piece, wall, wall.coordinates(p).x, 0.0)
            });
            let i = next.or_else(|| self.plan.against_any(self.dice, &piece, &IN_VIEW));
            if let Some(i) = i {
                self.clutter(i, 1);
            }
            placed.push(i);
        }
        if placed.iter().flatten().count() > 1 {
            self.plan.group(&placed, "bookcases");
        }
    }

    /// A desk with a chair and what lies on desks.
    pub(super) fn work_place(&mut self, walls: &[Wall]) {
        let w = self.dice.f(1.0, 1.6);
        let desk = self.make(|d, p| pieces::desk(d, p, w));
        let Some(desk) = self.plan.against_any(self.dice, &desk, walls) else { return };
        let swivel = self.dice.chance(0.6);
        let chair = if swivel { self.make(pieces::office_chair) } else { self.make(pieces::chair) };
        let item = self.plan.items[desk].clone();
        let seat = (0..8).find_map(|_| {
            let (tuck, off) = (self.dice.range(-0.05, 0.22), self.dice.range(-0.43, 0.43));
            let out = item.piece.size.z / 2.0 + chair.size.z / 2.0 - tuck;
            let p = item.to_room(DVec3::new(self.dice.range(-0.25, 0.25), 0.0, out));
            let c = self.plan.stand(&chair, DVec2::new(p.x, p.z), item.yaw + PI + off, &[desk])?;
            self.plan.items[c].facing = Facing::Object(desk);
            self.plan.items[c].tucked = (tuck > 0.02).then_some(desk);
            Some(c)
        });
        self.plan.group(&[Some(desk), seat], "work");
        let screen = match self.dice.int(0, 2) {
            0 => self.make(|d, _| pieces::laptop(d)),
            _ => self.make(|d, _| {
                let w = d.f(0.46, 0.66);
                pieces::monitor(d, "monitor", w)
            }),
        };
        let back = if screen.label == "laptop" { 0.3 } else { -0.7 };
        let (x, yaw, lean) = (self.dice.range(-0.15, 0.15), self.dice.range(-0.1, 0.1), self.dice.range(-0.5, 0.5));
        self.plan.on(self.dice, desk, &screen, Some([x, back]), yaw);
        let lamp = self.make(pieces::desk_lamp);
        let side = self.dice.sign() * 0.9;
        if self.dice.chance(0.7) {
            self.plan.on(self.dice, desk, &lamp, Some([side, -0.6]), lean);
        }
        if self.dice.chance(0.6) {
            let pens = self.make(pieces::pen_holder);
            self.plan.on(self.dice, desk, &pens, None, 0.0);
        }
        self.clutter(desk, 2);
    }

    /// An armchair off the walls, now and then with a small table.
    pub(super) fn easy_chair(&mut self, probability: f64) {
        if !self.dice.chance(probability) {
            return;
        }
        let chair = self.make(pieces::armchair);
        let e = self.plan.extents;
        let placed = (0..30).find_map(|_| {
            let at = DVec2::new(self.dice.range(0.5, e.width - 0.5), self.dice.range(0.5, e.depth * 0.7));
            let to = DVec2::new(e.width / 2.0, e.depth * 0.7) - at;
            let yaw = to.x.atan2(to.y) + self.dice.range(-0.43, 0.43);
            self.plan.stand(&chair, at, yaw, &[])
        });
        if let Some(i) = placed {
            self.plan.items[i].group = Some("reading");
            if self.dice.chance(0.5) {
                let table = self.make(pieces::side_table);
                let side = self.dice.sign();
                let p = self.plan.items[i].to_room(DVec3::new(side * (chair.size.x / 2.0 + 0.32), 0.0, 0.05));
                if let Some(t) = self.plan.stand(&table, DVec2::new(p.x, p.z), 0.0, &[]) {
                    self.plan.items[t].group = Some("reading");
                    self.clutter(t, 1);
                }
            }
        }
    }

    /// A lamp on the floor near a wall.
    pub(super) fn standing_lamp(&mut self, probability: f64) {
        if self.dice.chance(probability) {
            let lamp = self.make(pieces::floor_lamp);
            for _ in 0..4 {
                if self.plan.edge(self.dice, &lamp).is_some() {
                    return;
                }
            }
        }
    }

    /// A bin near a wall.
    pub(super) fn bin(&mut self) {
        if self.dice.chance(0.6) {
            let bin = self.make(pieces::waste_bin);
            self.plan.edge(self.dice, &bin);
        }
    }

    /// Up to `n` small things on a host.
    pub(super) fn clutter(&mut self, host: usize, n: usize) {
        for _ in 0..n {
            let thing = match self.dice.int(0, 9) {
                0 | 1 => self.make(pieces::vase),
                2 | 3 => self.make(pieces::books),
                4 => self.make(pieces::bowl),
                5 => self.make(pieces::candle),
                6 => self.make(pieces::photo_frame),
                7 => self.make(pieces::small_plant),
                8 => self.make(pieces::mug),
                _ if self.dice.chance(0.3) => self.make(pieces::teddy),
                _ => self.make(pieces::vase),
            };
            self.plan.on(self.dice, host, &thing, None, 0.0);
        }
    }
}

/// Height of the lower edge of a window's opening in its canonical frame: 2 mm below its pane, the second look.
fn opening_bottom(piece: &Piece) -> f64 {
    let pane = piece.mesh.groups[1].triangles.iter().flatten();
    pane.map(|i| f64::from(piece.mesh.positions[*i as usize].y)).fold(f64::INFINITY, f64::min) - 0.002
}
