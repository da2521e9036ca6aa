//! All rooms of a home together: where each is, how large it is, and what of it yields to the others. Key `home.layout`.
//!
//! # Idea
//! A photographed room has a similarity into the home ([`Place`]): it moves room, objects and camera together and leaves the
//! photo as it is. Its walls are apart from it: those that the photo shows hold the similarity, those it does not show yield.
//! Walls, doors and heights of all rooms are residuals of one least-squares problem; doors have a bounded loss, so that a
//! wrong one is left behind.
//!
//! # Units
//! Every residual is in units of its sigma ([`Sigmas`]), so that the cost is half a chi-square.

use glam::{DVec2, DVec3};
use harmony_geometry::least_squares::{minimise, robust};
use serde::{Deserialize, Serialize};

use crate::frame::{Place, Rect, sides};
use crate::layout::{USUAL_WALL_M, outward};
use crate::rooms::{Evidence, flat};
use harmony_scene::{QuarterTurn, Surface, Wall};

/// How far off things are, one sigma each.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sigmas {
    /// Scale of a run, relative: the root mean square of 57 runs of generated rooms at noise `real`.
    pub scale: f64,
    /// Axes of a run, radians.
    pub yaw: f64,
    /// A wall that the photo shows, metres.
    pub seen_wall: f64,
    /// The same as a share of the distance from the middle of the room.
    pub seen_wall_share: f64,
    /// A wall that it does not show, as a share of the room's length.
    pub unseen_wall: f64,
    /// An end of a door along its wall, metres.
    pub door_end: f64,
    /// The top of a door, metres.
    pub door_top: f64,
    /// A ceiling that the photo shows, against the layout's height, metres.
    pub ceiling: f64,
    /// Two ceilings of a home that nobody measured, metres.
    pub ceilings: f64,
    /// Thickness of a wall between rooms, metres, where no layout says it.
    pub thickness: f64,
    /// Residuals of doors and guessed walls are bounded by so many sigmas.
    pub bound: f64,
    /// The same of side walls that the photo shows: a corner may have been taken for another.
    pub wall_bound: f64,
}

impl Default for Sigmas {
    fn default() -> Self {
        Self {
            scale: 0.022,
            yaw: 0.5_f64.to_radians(),
            seen_wall: 0.03,
            seen_wall_share: 0.01,
            unseen_wall: 0.2,
            door_end: 0.03,
            door_top: 0.03,
            ceiling: 0.03,
            ceilings: 0.03,
            thickness: 0.04,
            bound: 5.0,
            wall_bound: 4.0,
        }
    }
}

/// A room in the problem.
#[derive(Debug, Clone)]
pub struct RoomIn<'a> {
    /// What its run says.
    pub evidence: &'a Evidence,
    /// How it is turned.
    pub turn: QuarterTurn,
    /// Its walls in the layout.
    pub rect: Option<Rect>,
    /// Its height in the layout, metres.
    pub height: Option<f64>,
    /// Height of its floor, metres.
    pub floor: f64,
    /// Where to begin: the middle of its floor.
    pub at: DVec2,
}

/// One side of a door.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seat {
    /// The room.
    pub room: usize,
    /// Number in [`Evidence::doors`]; `None` when the run has not got it.
    pub door: Option<usize>,
    /// The side of the home that the room's wall is.
    pub side: Wall,
}

/// A door: the seats that it has, and where the layout has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// One or two.
    pub seats: Vec<Seat>,
    /// Range along the wall and height of its top, when a layout says it, metres.
    pub layout: Option<([f64; 2], Option<f64>)>,
}

/// Two walls that stand back to back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BackToBack {
    /// The rooms.
    pub rooms: [usize; 2],
    /// The side of the first.
    pub side: Wall,
    /// Whether a door says so, else only that they are near.
    pub sure: bool,
}

/// A room where it is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Solved {
    /// Of its photo, objects and camera.
    pub place: Place,
    /// Its walls, home frame.
    pub rect: Rect,
    /// Floor to ceiling, metres.
    pub height: f64,
}

/// The outcome.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// One a room.
    pub rooms: Vec<Solved>,
    /// Half the sum of squares.
    pub cost: f64,
    /// Steps of the solver.
    pub iterations: usize,
}

/// Unknowns of a room: x, z, ln scale, yaw; then the four walls where no layout has them.
const PLACE: usize = 4;
const WALLS: usize = 4;
/// A door this far from its place is a place to begin from, metres.
const ELSEWHERE_M: f64 = 0.15;

/// Ends of a door along its side, smaller first, home frame.
pub fn door_range(evidence: &Evidence, place: &Place, door: usize, side: Wall) -> [f64; 2] {
    let ends = evidence.doors[door].ends(&evidence.extents).map(|p| flat(place.point(&evidence.extents, p)));
    let along = ends.map(|p| if matches!(side, Wall::Left | Wall::Right) { p.y } else { p.x });
    [along[0].min(along[1]), along[0].max(along[1])]
}

/// Where a run's own wall comes to be: the coordinate across the side, at both of its ends.
pub fn wall_ends(evidence: &Evidence, place: &Place, wall: Wall) -> [f64; 2] {
    let e = &evidence.extents;
    let side = place.turn.wall(wall);
    [0.0, wall.length(e)].map(|u| {
        let p = flat(place.point(e, wall.point(e, u, 0.0)));
        if matches!(side, Wall::Left | Wall::Right) { p.x } else { p.y }
    })
}

/// The rooms as they are before they are refined: scale 1, the walls of the runs; with a layout, seen walls are put onto
/// its walls, half way where they do not agree.
pub fn unrefined(rooms: &[RoomIn<'_>]) -> Vec<Solved> {
    rooms
        .iter()
        .map(|room| {
            let e = &room.evidence.extents;
            let place = |at: DVec2| Place { turn: room.turn, yaw: 0.0, scale: 1.0, at, floor: room.floor };
            let mut at = room.at;
            if let Some(rect) = room.rect {
                for axis in 0..2 {
                    let sides = if axis == 0 { [Wall::Left, Wall::Right] } else { [Wall::Back, Wall::Front] };
                    let off = |side: Wall| {
                        let wall = room.turn.inverse().wall(side);
                        let own = wall_ends(room.evidence, &place(room.at), wall)[0];
                        (rect.side(side) - own, room.evidence.sees(wall.surface()))
                    };
                    let both = sides.map(off);
                    let seen: Vec<f64> = both.iter().filter(|(_, seen)| *seen).map(|(off, _)| *off).collect();
                    let used = if seen.is_empty() { both.map(|(off, _)| off).to_vec() } else { seen };
                    at[axis] += used.iter().sum::<f64>() / used.len() as f64;
                }
            }
            let half = sides(room.turn, e) / 2.0;
            let rect = room.rect.unwrap_or(Rect { min: at - half, max: at + half });
            Solved { place: place(at), rect, height: room.height.unwrap_or(e.height) }
        })
        .collect()
}

/// The problem.
#[derive(Debug, Clone)]
pub struct Problem<'a> {
    /// Rooms.
    pub rooms: Vec<RoomIn<'a>>,
    /// Doors.
    pub joints: Vec<Joint>,
    /// Walls back to back, where no layout has them.
    pub walls: Vec<BackToBack>,
    /// How far off things are.
    pub sigmas: Sigmas,
}

impl Problem<'_> {
    fn start(&self) -> Vec<f64> {
        let mut out = Vec::new();
        for (room, solved) in self.rooms.iter().zip(unrefined(&self.rooms)) {
            out.extend([solved.place.at.x, solved.place.at.y, 0.0, 0.0]);
            if room.rect.is_none() {
                out.extend(Wall::ALL.map(|side| solved.rect.side(side)));
            }
        }
        out
    }

    fn read(&self, p: &[f64]) -> Vec<Solved> {
        let mut rest = p;
        self.rooms
            .iter()
            .map(|room| {
                let (own, after) = rest.split_at(PLACE);
                rest = after;
                let place = Place {
                    turn: room.turn,
                    yaw: own[3],
                    scale: own[2].exp(),
                    at: DVec2::new(own[0], own[1]),
                    floor: room.floor,
                };
                let rect = room.rect.unwrap_or_else(|| {
                    let (walls, after) = rest.split_at(WALLS);
                    rest = after;
                    let mut rect = Rect { min: DVec2::ZERO, max: DVec2::ZERO };
                    Wall::ALL.into_iter().zip(walls).for_each(|(side, at)| rect.set_side(side, *at));
                    rect
                });
                let height = room.height.unwrap_or(room.evidence.extents.height * place.scale);
                Solved { place, rect, height }
            })
            .collect()
    }

    fn residuals(&self, p: &[f64], out: &mut Vec<f64>) {
        let s = &self.sigmas;
        let solved = self.read(p);
        for (room, at) in self.rooms.iter().zip(&solved) {
            let e = &room.evidence.extents;
            out.push(at.place.scale.ln() / s.scale);
            out.push(at.place.yaw / s.yaw);
            for wall in Wall::ALL {
                let side = room.turn.wall(wall);
                let length = e.as_vec().dot(wall.normal().abs());
                let ends = wall_ends(room.evidence, &at.place, wall);
                if room.evidence.sees(wall.surface()) {
                    let sigma = s.seen_wall.hypot(s.seen_wall_share * length / 2.0) * std::f64::consts::SQRT_2;
                    // The back wall is the one that the camera faces: nothing is mistaken for it.
                    let bound = if wall == Wall::Back { f64::INFINITY } else { s.wall_bound };
                    out.extend(ends.map(|end| robust((end - at.rect.side(side)) / sigma, bound)));
                } else {
                    let middle = f64::midpoint(ends[0], ends[1]);
                    out.push(robust((middle - at.rect.side(side)) / (s.unseen_wall * length), s.bound));
                }
            }
            if let Some(height) = room.height {
                let sigma = if room.evidence.sees(Surface::Ceiling) { s.ceiling } else { s.ceiling * 10.0 };
                out.push(robust((e.height * at.place.scale - height) / sigma, s.bound));
            }
        }
        for joint in &self.joints {
            self.door(joint, &solved, out);
        }
        for walls in &self.walls {
            let [a, b] = walls.rooms.map(|r| &solved[r].rect);
            let gap = (b.side(walls.side.opposite()) - a.side(walls.side)) * outward(walls.side);
            let off = (gap - USUAL_WALL_M) / s.thickness;
            out.push(if walls.sure { off } else { robust(off, s.bound) });
        }
        let told = |r: &RoomIn<'_>| r.height.is_none() && r.evidence.sees(Surface::Ceiling);
        let seen: Vec<f64> =
            self.rooms.iter().zip(&solved).filter(|(room, _)| told(room)).map(|(_, at)| at.height).collect();
        for pair in seen.windows(2) {
            out.push(robust((pair[0] - pair[1]) / s.ceilings, 2.0));
        }
    }

    fn door(&self, joint: &Joint, solved: &[Solved], out: &mut Vec<f64>) {
        let s = &self.sigmas;
        let found: Vec<([f64; 2], f64)> = joint
            .seats
            .iter()
            .filter_map(|seat| {
                let (evidence, place) = (self.rooms[seat.room].evidence, &solved[seat.room].place);
                let door = seat.door?;
                Some((
                    door_range(evidence, place, door, seat.side),
                    place.floor + evidence.doors[door].top * place.scale,
                ))
            })
            .collect();
        let mut push = |off: f64, sigma: f64| out.push(robust(off / sigma, s.bound));
        if let Some((range, top)) = joint.layout {
            for (seat, (own, own_top)) in joint.seats.iter().filter(|s| s.door.is_some()).zip(&found) {
                push(own[0] - range[0], s.door_end);
                push(own[1] - range[1], s.door_end);
                if let Some(top) = top {
                    push(own_top - solved[seat.room].place.floor - top, s.door_top);
                }
            }
        } else if let [(a, a_top), (b, b_top)] = found[..] {
            let both = std::f64::consts::SQRT_2;
            push(a[0] - b[0], s.door_end * both);
            push(a[1] - b[1], s.door_end * both);
            push(a_top - b_top, s.door_top * both);
        }
    }

    /// Solves it: from the walls, and for each door that a layout has elsewhere from that door. The least cost is taken,
    /// for a wall may be wrong that the photo seems to show.
    pub fn solve(&self) -> Solution {
        let from = |start: &[f64]| {
            let steps = vec![1e-5; start.len()];
            minimise(start, &steps, 60, |p, out| self.residuals(p, out))
        };
        let mut best = from(&self.start());
        let mut first = Vec::new();
        let mut next = 0;
        for room in &self.rooms {
            first.push(next);
            next += if room.rect.is_none() { PLACE + WALLS } else { PLACE };
        }
        for joint in &self.joints {
            let Some((range, _)) = joint.layout else { continue };
            for seat in &joint.seats {
                let Some(door) = seat.door else { continue };
                let place = self.read(&best.parameters)[seat.room].place;
                let own = door_range(self.rooms[seat.room].evidence, &place, door, seat.side);
                let off = f64::midpoint(range[0], range[1]) - f64::midpoint(own[0], own[1]);
                if off.abs() > ELSEWHERE_M {
                    let mut start = best.parameters.clone();
                    let axis = usize::from(matches!(seat.side, Wall::Left | Wall::Right));
                    start[first[seat.room] + axis] += off;
                    let other = from(&start);
                    if other.cost < best.cost {
                        best = other;
                    }
                }
            }
        }
        Solution { rooms: self.read(&best.parameters), cost: best.cost, iterations: best.iterations }
    }

    /// Half the chi-square of the rooms as they are before refinement.
    pub fn unrefined_cost(&self) -> f64 {
        let mut out = Vec::new();
        self.residuals(&self.start(), &mut out);
        0.5 * out.iter().map(|r| r * r).sum::<f64>()
    }
}

/// Where a room of the run is so that a point of its frame comes to a point of the home.
pub fn anchored(evidence: &Evidence, turn: QuarterTurn, room: DVec3, home: DVec2) -> DVec2 {
    let zero = Place { turn, yaw: 0.0, scale: 1.0, at: DVec2::ZERO, floor: 0.0 };
    home - flat(zero.point(&evidence.extents, room))
}
