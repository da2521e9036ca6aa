//! Rooms that are not boxes: what is solid inside the box, what is free behind its walls, and ceilings that come down.
//!
//! The free space of a room is its box, less the blocks, plus the niches, below the slopes. Everything is along the
//! room's axes but the slopes, which are level along one wall. [`Room::faces`] turns it into flat faces. Key
//! `layout.shape`.

use std::cell::RefCell;
use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3Swizzles as _};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Extents, ObjectId, Ray, Room, Support, Surface, Wall};

/// Lengths below this are none, metres.
const EPS: f64 = 1e-6;
/// What ends this near to floor or ceiling reaches it, metres.
const HANGS: f64 = 0.05;
/// Nothing stands against a plane that meets the floor over less than this, metres.
const SHORTEST_FOOT: f64 = 0.15;
/// Rooms whose faces a thread keeps.
const KEPT: usize = 4;
/// A block whose side is this near to a wall of the box touches it, metres.
const TOUCH: f64 = 1e-3;
/// A foot may be so far below the floor of the niche that it stands in, metres.
const STEP: f64 = 0.03;

/// A block on which something can stand is this wide and deep, and so far below the ceiling, metres.
const MIN_LEDGE: f64 = 0.04;
const MIN_ROOM_ABOVE: f64 = 0.3;
/// A niche in which something can stand is this high, metres.
const MIN_IN_NICHE: f64 = 0.1;

/// What begins so little below the top of a ledge is above it, metres.
const ABOVE_LEDGE: f64 = 0.05;

/// What makes a room other than its box.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RoomShape {
    /// Solid boxes inside the room's box.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub blocks: Vec<Block>,
    /// Free boxes behind a face of the box, or in a block.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub niches: Vec<Niche>,
    /// Ceilings that come down towards a wall.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub slopes: Vec<Slope>,
}

/// A solid box inside the room: the missing corner of an L, a chimney breast, a column, a beam, a step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Block {
    /// What it is, in a word.
    pub kind: String,
    /// Its smallest coordinates, metres.
    #[schemars(with = "[f64; 3]")]
    pub min: DVec3,
    /// Its largest coordinates, metres.
    #[schemars(with = "[f64; 3]")]
    pub max: DVec3,
}

impl Block {
    /// Whether it hangs from the ceiling and does not reach the floor: a beam, a soffit, a lowered part of the ceiling.
    pub fn hangs(&self, extents: &Extents) -> bool {
        self.max.y > extents.height - HANGS && self.min.y > HANGS
    }

    /// Whether something can stand on it: it comes up from below and leaves room under the ceiling.
    pub fn carries(&self, extents: &Extents) -> bool {
        let sides = (self.max - self.min).with_y(MIN_LEDGE);
        self.max.y > STEP && self.max.y < extents.height - MIN_ROOM_ABOVE && sides.min_element() >= MIN_LEDGE
    }

    /// Whether all of a face lies on it.
    pub fn has(&self, face: &RoomFace) -> bool {
        face.polygon.iter().all(|p| p.cmpge(self.min - EPS).all() && p.cmple(self.max + EPS).all())
    }
}

/// A level part of the room on which things stand: the top of a block, the floor of a niche; by their place in the shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ledge {
    /// The top of a block.
    Block(usize),
    /// The floor of a niche.
    Niche(usize),
}

impl Ledge {
    /// What it is called where things stand on it.
    pub fn id(self) -> ObjectId {
        match self {
            Self::Block(index) => ObjectId::numbered("block", index + 1),
            Self::Niche(index) => ObjectId::numbered("niche", index + 1),
        }
    }

    /// What carries an object that stands on it.
    pub fn support(self) -> Support {
        match self {
            Self::Block(block) => Support::Block { block },
            Self::Niche(niche) => Support::Niche { niche },
        }
    }
}

/// Where things stand on a ledge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LedgeTop<'a> {
    /// What the block or the niche is, in a word.
    pub kind: &'a str,
    /// Smallest and largest x and z, metres.
    pub area: [DVec2; 2],
    /// Height above the floor, metres.
    pub height: f64,
    /// Lowest and highest of the block or the niche above the floor, metres.
    pub span: [f64; 2],
}

impl LedgeTop<'_> {
    /// Whether a place lies over it, whatever its height.
    pub fn is_under(&self, at: DVec3) -> bool {
        at.xz().cmpge(self.area[0]).all() && at.xz().cmple(self.area[1]).all()
    }

    /// The nearest place over it, at its height.
    pub fn nearest(&self, at: DVec3) -> DVec3 {
        let p = at.xz().clamp(self.area[0], self.area[1]);
        DVec3::new(p.x, self.height, p.y)
    }
}

/// A free box behind a face of the box: a niche, the recess of a window, the arm of an L, a tray in the ceiling.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Niche {
    /// What it is, in a word.
    pub kind: String,
    /// The face that it opens from: a wall, or the ceiling.
    #[serde(alias = "wall")]
    pub surface: Surface,
    /// Linear colour of its sides, where the photo shows them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sides: Option<[f32; 3]>,
    /// Linear colour of a strip of light that lies on its lower sides all around, hidden from below: a cove.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub glow: Option<[f32; 3]>,
    /// Its smallest coordinates, metres.
    #[schemars(with = "[f64; 3]")]
    pub min: DVec3,
    /// Its largest coordinates, metres.
    #[schemars(with = "[f64; 3]")]
    pub max: DVec3,
}

impl Niche {
    /// Whether something can stand in it, above the floor.
    pub fn carries(&self) -> bool {
        let sides = self.max - self.min;
        self.surface.wall().is_some()
            && self.min.y > STEP
            && sides.min_element() >= MIN_LEDGE
            && sides.y >= MIN_IN_NICHE
    }
}

/// A plane of the ceiling that comes down towards a wall, along all of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Slope {
    /// The wall that it comes down to.
    pub wall: Wall,
    /// Its height at that wall, metres.
    pub low: f64,
    /// Distance from that wall at which it meets the level ceiling, metres.
    pub run: f64,
}

impl Slope {
    /// How far below the slope a point is, metres, measured upright; negative above.
    pub fn below(&self, extents: &Extents, p: DVec3) -> f64 {
        let share = self.wall.distance(extents, p) / self.run.max(EPS);
        self.low + (extents.height - self.low) * share - p.y
    }

    /// Unit normal into the room.
    pub fn normal(&self, extents: &Extents) -> DVec3 {
        let rise = (extents.height - self.low) / self.run.max(EPS);
        (self.wall.normal() * rise + DVec3::NEG_Y).normalize()
    }
}

/// A vertical plane of the room that faces as a wall of the box does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WallPlane {
    /// The wall that looks the same way.
    pub wall: Wall,
    /// How far before that wall the plane is, metres; negative in a niche.
    pub inset: f64,
}

impl From<Wall> for WallPlane {
    fn from(wall: Wall) -> Self {
        Self { wall, inset: 0.0 }
    }
}

impl WallPlane {
    /// Unit normal into the room.
    pub fn normal(self) -> DVec3 {
        self.wall.normal()
    }

    /// Yaw of an object whose back is on the plane.
    pub fn yaw(self) -> f64 {
        self.wall.yaw()
    }

    /// Distance of a point to the plane, positive on the free side.
    pub fn distance(self, extents: &Extents, point: DVec3) -> f64 {
        self.wall.distance(extents, point) - self.inset
    }

    /// The point of the plane with the wall's coordinates `(u, y)`.
    pub fn point(self, extents: &Extents, u: f64, y: f64) -> DVec3 {
        self.wall.point(extents, u, y) + self.wall.normal() * self.inset
    }

    /// `(u, y)` of a point dropped onto the plane.
    pub fn coordinates(self, point: DVec3) -> DVec2 {
        self.wall.coordinates(point)
    }
}

/// A flat, convex piece of the room's boundary.
#[derive(Debug, Clone, PartialEq)]
pub struct RoomFace {
    /// The face of the box whose material and texture it has: sides of a chimney breast belong to its wall, ledges of
    /// a niche to the niche's, slopes to the ceiling.
    pub surface: Surface,
    /// Unit normal into the room.
    pub normal: DVec3,
    /// Corners in order, metres.
    pub polygon: Vec<DVec3>,
    /// Which niche's side, sill or lintel it is.
    pub side_of: Option<usize>,
}

impl RoomFace {
    /// The plane as one that objects hang on; `None` when it is not upright along the room's axes, or the side of a tray
    /// in the ceiling.
    pub fn plane(&self, extents: &Extents) -> Option<WallPlane> {
        self.surface.wall()?;
        let wall = Wall::ALL.into_iter().find(|w| w.normal().dot(self.normal) > 0.999)?;
        Some(WallPlane { wall, inset: wall.distance(extents, *self.polygon.first()?) })
    }

    /// Whether a point lies in it, with so much slack across its plane and none along it.
    pub fn contains(&self, p: DVec3, slack: f64) -> bool {
        (p - self.polygon[0]).dot(self.normal).abs() <= slack && self.holds(p)
    }

    /// Whether a point of its plane lies in it.
    fn holds(&self, p: DVec3) -> bool {
        let n = self.polygon.len();
        let sides = (0..n).map(|i| {
            let (a, b) = (self.polygon[i], self.polygon[(i + 1) % n]);
            (b - a).cross(p - a).dot(self.normal) / (b - a).length().max(EPS)
        });
        let (low, high) = sides.fold((f64::MAX, f64::MIN), |(l, h), s| (l.min(s), h.max(s)));
        low >= -EPS || high <= EPS
    }

    /// The point of its plane that lies at a place along its surface's normal.
    fn lift(&self, on_box: DVec3) -> Option<DVec3> {
        let along = self.surface.normal();
        let slant = along.dot(self.normal);
        (slant.abs() > EPS).then(|| on_box + along * ((self.polygon[0] - on_box).dot(self.normal) / slant))
    }
}

/// Where a ray meets the room's boundary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exit {
    /// The surface that is there.
    pub surface: Surface,
    /// Unit normal into the room.
    pub normal: DVec3,
    /// Where.
    pub point: DVec3,
    /// Which niche's side, sill or lintel is there.
    pub side_of: Option<usize>,
}

impl Exit {
    /// The wall that looks as the room does there; `None` on floor, ceiling, trays and slopes.
    pub fn wall(&self) -> Option<Wall> {
        self.surface.wall()?;
        Wall::ALL.into_iter().find(|w| w.normal().dot(self.normal) > 0.999)
    }
}

/// All faces of a room, for many rays.
#[derive(Debug, Clone, PartialEq)]
pub struct RoomFaces {
    /// The faces; empty for a box.
    faces: Arc<Vec<RoomFace>>,
    /// Where each of them is.
    places: Arc<Vec<FacePlace>>,
    extents: Extents,
}

/// Where a face is: what rules it out before its corners are asked.
#[derive(Debug, Clone, PartialEq)]
struct FacePlace {
    low: DVec3,
    high: DVec3,
    /// Bounds in the coordinates of its surface; `None` where it does not face as that does.
    uv: Option<[DVec2; 2]>,
    /// Whether it fills its bounds.
    is_rectangle: bool,
}

impl FacePlace {
    fn of(face: &RoomFace) -> Self {
        let (low, high) = face.polygon.iter().fold((DVec3::MAX, DVec3::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
        let corners = face.polygon.iter().map(|p| face.surface.coordinates(*p));
        let uv = corners.fold([DVec2::MAX, DVec2::MIN], |[l, h], c| [l.min(c), h.max(c)]);
        let at_end = |p: &DVec3| (0..3).all(|k| (p[k] - low[k]).min(high[k] - p[k]) < EPS);
        Self {
            low,
            high,
            // Slopes count as ceiling.
            uv: (face.normal.dot(face.surface.normal()) >= 0.1).then_some(uv),
            is_rectangle: face.polygon.len() == 4
                && face.normal.abs().max_element() > 1.0 - 1e-9
                && face.polygon.iter().all(at_end),
        }
    }

    /// Whether a point of the face's plane is within its bounds.
    fn is_near(&self, p: DVec3) -> bool {
        p.cmpge(self.low - EPS).all() && p.cmple(self.high + EPS).all()
    }

    /// Whether it covers the coordinates `(u, v)` of its surface.
    fn covers(&self, uv: DVec2) -> bool {
        self.uv.is_some_and(|[low, high]| uv.cmpge(low - EPS).all() && uv.cmple(high + EPS).all())
    }
}

impl RoomFaces {
    fn new(faces: Arc<Vec<RoomFace>>, extents: Extents) -> Self {
        let places = Arc::new(faces.iter().map(FacePlace::of).collect());
        Self { faces, places, extents }
    }

    /// Where a ray that starts inside leaves the room.
    pub fn exit(&self, ray: &Ray) -> Option<Exit> {
        let mut best: Option<(f64, &RoomFace)> = None;
        for (face, place) in self.faces.iter().zip(self.places.iter()) {
            let towards = ray.direction.dot(face.normal);
            if towards > -1e-12 {
                continue;
            }
            let k = (face.polygon[0] - ray.origin).dot(face.normal) / towards;
            if k < 0.0 || best.is_some_and(|(b, _)| k >= b) {
                continue;
            }
            let p = ray.at(k);
            if place.is_near(p) && (place.is_rectangle || face.holds(p)) {
                best = Some((k, face));
            }
        }
        match best {
            Some((k, face)) => {
                let RoomFace { surface, normal, side_of, .. } = *face;
                Some(Exit { surface, normal, point: ray.at(k), side_of })
            }
            None => self.extents.exit(ray).map(|(surface, point)| Exit {
                surface,
                normal: surface.normal(),
                point,
                side_of: None,
            }),
        }
    }

    /// The upright plane that a ray meets, when it leaves the room through one.
    pub fn hit_plane(&self, ray: &Ray) -> Option<WallPlane> {
        let exit = self.exit(ray)?;
        let wall = exit.wall()?;
        Some(WallPlane { wall, inset: wall.distance(&self.extents, exit.point) })
    }

    /// The room point that a surface has at its coordinates `(u, v)` ([`Surface::point`]), on a block's face, in a niche
    /// or on a slope where there is one; with the normal there.
    pub fn point(&self, surface: Surface, uv: DVec2) -> (DVec3, DVec3) {
        let on_box = surface.point(&self.extents, uv);
        // Where two faces lie one behind the other, the one further in.
        let inward = |p: &DVec3| (*p - on_box).dot(surface.normal());
        self.faces
            .iter()
            .zip(self.places.iter())
            .filter(|(f, place)| f.surface == surface && place.covers(uv))
            .filter_map(|(f, _)| Some((f.lift(on_box)?, f.normal)))
            .max_by(|a, b| inward(&a.0).total_cmp(&inward(&b.0)))
            .unwrap_or((on_box, surface.normal()))
    }

    /// Whether the room is its box.
    pub fn is_box(&self) -> bool {
        self.faces.is_empty()
    }

    /// The faces; none for a box.
    pub fn all(&self) -> &[RoomFace] {
        &self.faces
    }

    /// The box.
    pub fn extents(&self) -> &Extents {
        &self.extents
    }
}

impl From<Extents> for RoomFaces {
    /// A room that is a box.
    fn from(extents: Extents) -> Self {
        Self { faces: Arc::default(), places: Arc::default(), extents }
    }
}

impl RoomShape {
    /// Whether nothing makes the room other than its box.
    pub fn is_box(&self) -> bool {
        self.blocks.is_empty() && self.niches.is_empty() && self.slopes.is_empty()
    }

    /// The shape in a room that is larger by a factor.
    pub fn scaled(&mut self, factor: f64) {
        let corners = self.blocks.iter_mut().map(|b| (&mut b.min, &mut b.max));
        for (min, max) in corners.chain(self.niches.iter_mut().map(|n| (&mut n.min, &mut n.max))) {
            *min *= factor;
            *max *= factor;
        }
        for slope in &mut self.slopes {
            slope.low *= factor;
            slope.run *= factor;
        }
    }

    /// The shape in a box that has become another one, everything seen at `factor` times its distance: what lies within the
    /// box keeps its share of it, as the photo has it; how far a niche goes behind its face takes the factor.
    pub fn stretched(&mut self, old: &Extents, new: &Extents, factor: f64) {
        let ratio = new.as_vec() / old.as_vec().max(DVec3::splat(EPS));
        let place = |p: DVec3| {
            let within = p.clamp(DVec3::ZERO, old.as_vec());
            within * ratio + (p - within) * factor
        };
        let corners = self.blocks.iter_mut().map(|b| (&mut b.min, &mut b.max));
        for (min, max) in corners.chain(self.niches.iter_mut().map(|n| (&mut n.min, &mut n.max))) {
            (*min, *max) = (place(*min), place(*max));
        }
        for slope in &mut self.slopes {
            slope.low *= ratio.y;
            slope.run *= if slope.wall.normal().x.abs() > 0.5 { ratio.x } else { ratio.z };
        }
    }

    /// The shape in a box whose left, right, ceiling and front sides moved: what touches a side, or lies behind it, goes
    /// with it. `left` is how far the left wall moved outward; all coordinates then count from the new one.
    pub fn fitted(&mut self, old: &Extents, new: &Extents, left: f64) {
        let moved = |p: &mut DVec3| {
            let (was, is) = (old.as_vec(), new.as_vec());
            if p.x > TOUCH {
                p.x += if p.x >= was.x - TOUCH { is.x - was.x } else { left };
            }
            for i in 1..3 {
                if p[i] >= was[i] - TOUCH {
                    p[i] += is[i] - was[i];
                }
            }
        };
        for b in &mut self.blocks {
            moved(&mut b.min);
            moved(&mut b.max);
        }
        for n in &mut self.niches {
            moved(&mut n.min);
            moved(&mut n.max);
        }
    }
}

impl Block {
    /// Whether its side towards a wall of the box lies on that wall.
    fn touches(&self, wall: Wall, extents: &Extents) -> bool {
        wall.distance(extents, self.min).min(wall.distance(extents, self.max)) < TOUCH
    }
}

/// What lies at a place.
#[derive(Clone, Copy, PartialEq)]
enum At<'a> {
    Box,
    Niche(&'a Niche),
    Block(&'a Block),
    Outside,
}

/// A room's faces by what they depend on.
type Known = (Extents, RoomShape, RoomFaces);

thread_local! {
    static KNOWN: RefCell<Vec<Known>> = const { RefCell::new(Vec::new()) };
}

impl Room {
    /// The faces of the room, ready for many questions.
    pub fn faces(&self) -> RoomFaces {
        if self.shape.is_box() { RoomFaces::from(self.extents) } else { self.known_faces() }
    }

    /// [`Room::all_faces`], kept for the rooms that this thread asked about last: placement asks thousands of times about
    /// the same few.
    fn known_faces(&self) -> RoomFaces {
        KNOWN.with_borrow_mut(|known| {
            if let Some((.., faces)) = known.iter().find(|(e, s, _)| *e == self.extents && *s == self.shape) {
                return faces.clone();
            }
            let faces = RoomFaces::new(Arc::new(self.all_faces()), self.extents);
            known.truncate(KEPT - 1);
            known.insert(0, (self.extents, self.shape.clone(), faces.clone()));
            faces
        })
    }

    /// Flat, convex faces that together close the room's free space; openings are not cut out.
    pub fn all_faces(&self) -> Vec<RoomFace> {
        let e = self.extents.as_vec();
        let corners = self.shape.blocks.iter().flat_map(|b| [b.min.clamp(DVec3::ZERO, e), b.max.clamp(DVec3::ZERO, e)]);
        let corners: Vec<DVec3> = corners
            .chain(self.shape.niches.iter().flat_map(|n| [n.min, n.max]))
            .chain([DVec3::ZERO, e])
            .filter(|p| p.is_finite())
            .collect();
        let lines: [Vec<f64>; 3] = std::array::from_fn(|axis| {
            let mut at: Vec<f64> = corners.iter().map(|p| p[axis]).collect();
            at.sort_by(f64::total_cmp);
            at.dedup_by(|a, b| *a - *b < EPS);
            at
        });
        let cells = lines.each_ref().map(|l| l.len().saturating_sub(1));
        let mut out = Vec::new();
        for index in (0..cells[0] * cells[1] * cells[2])
            .map(|k| [k % cells[0], k / cells[0] % cells[1], k / cells[0] / cells[1]])
        {
            let low = DVec3::from_array(std::array::from_fn(|a| lines[a][index[a]]));
            let high = DVec3::from_array(std::array::from_fn(|a| lines[a][index[a] + 1]));
            let here = self.at((low + high) / 2.0);
            if matches!(here, At::Block(_) | At::Outside) {
                continue;
            }
            for side in Surface::ALL {
                // The cell's side that looks along the surface's normal lies against it.
                let normal = side.normal();
                let beyond = (low + high) / 2.0 - normal * ((high - low).dot(normal.abs()) / 2.0 + 2.0 * EPS);
                let behind = self.at(beyond);
                if matches!(behind, At::Block(_) | At::Outside) {
                    let surface = self.belongs(side, here, behind, low.y);
                    let polygon = self.under_slopes(cell_side(side, low, high), None);
                    // Ledges at floor level and a niche's bottom are no sides of it.
                    let side_of = match here {
                        At::Niche(n) if surface != side => self.shape.niches.iter().position(|o| o == n),
                        _ => None,
                    };
                    out.extend((polygon.len() > 2).then_some(RoomFace { surface, normal, polygon, side_of }));
                }
            }
            for k in 0..self.shape.slopes.len() {
                let polygon = self.slope_in(k, low, high);
                if polygon.len() > 2 {
                    let normal = self.shape.slopes[k].normal(&self.extents);
                    out.push(RoomFace { surface: Surface::Ceiling, normal, polygon, side_of: None });
                }
            }
        }
        out
    }

    /// Whether a point is in the room's free space.
    pub fn is_free(&self, p: DVec3) -> bool {
        matches!(self.at(p), At::Box | At::Niche(_))
            && self.shape.slopes.iter().all(|s| s.below(&self.extents, p) >= 0.0)
    }

    fn at(&self, p: DVec3) -> At<'_> {
        let within = |min: DVec3, max: DVec3| p.cmpge(min).all() && p.cmple(max).all();
        if let Some(niche) = self.shape.niches.iter().find(|n| within(n.min, n.max)) {
            At::Niche(niche)
        } else if let Some(block) = self.shape.blocks.iter().find(|b| within(b.min, b.max)) {
            At::Block(block)
        } else if self.extents.contains(p, 0.0) {
            At::Box
        } else {
            At::Outside
        }
    }

    /// Which surface of the box a face belongs to that looks as `side` does.
    fn belongs(&self, side: Surface, here: At, behind: At, low: f64) -> Surface {
        let wall = side.wall();
        match (here, behind) {
            (At::Niche(niche), _) if side != niche.surface && !(side == Surface::Floor && low < EPS) => niche.surface,
            (_, At::Block(block)) if side != Surface::Ceiling => {
                let touched = |w: Wall| block.touches(w, &self.extents);
                if wall.is_some_and(touched) {
                    return side;
                }
                Wall::ALL.into_iter().find(|w| touched(*w)).map_or(side, Wall::surface)
            }
            _ => side,
        }
    }

    /// What a slope has inside a cell.
    fn slope_in(&self, k: usize, low: DVec3, high: DVec3) -> Vec<DVec3> {
        let (slope, e) = (&self.shape.slopes[k], &self.extents);
        let (a, b) = (slope.wall.coordinates(low).x, slope.wall.coordinates(high).x);
        let near = slope.wall.distance(e, low).min(slope.wall.distance(e, high));
        let far = slope.wall.distance(e, low).max(slope.wall.distance(e, high)).min(slope.run);
        if far - near < EPS {
            return Vec::new();
        }
        let at = |u: f64, d: f64| {
            let height = slope.low + (e.height - slope.low) * d / slope.run.max(EPS);
            slope.wall.point(e, u, height) + slope.wall.normal() * d
        };
        let polygon = vec![at(a, near), at(b, near), at(b, far), at(a, far)];
        let polygon = clipped(&polygon, |p| p.y - low.y);
        let polygon = clipped(&polygon, |p| high.y - p.y);
        self.under_slopes(polygon, Some(k))
    }

    /// What of a polygon is below all slopes but one.
    fn under_slopes(&self, polygon: Vec<DVec3>, but: Option<usize>) -> Vec<DVec3> {
        let others = self.shape.slopes.iter().enumerate().filter(|(k, _)| Some(*k) != but);
        others.fold(polygon, |polygon, (_, slope)| clipped(&polygon, |p| slope.below(&self.extents, p)))
    }

    /// The planes that face as a wall of the box does, the largest first.
    pub fn planes(&self, wall: Wall) -> Vec<WallPlane> {
        if self.shape.is_box() {
            return vec![wall.into()];
        }
        let mut out: Vec<(WallPlane, f64)> = Vec::new();
        for face in self.known_faces().all() {
            let Some(plane) = face.plane(&self.extents).filter(|p| p.wall == wall) else { continue };
            let area = area(&face.polygon);
            match out.iter_mut().find(|(p, _)| (p.inset - plane.inset).abs() < TOUCH) {
                Some((_, sum)) => *sum += area,
                None => out.push((plane, area)),
            }
        }
        out.sort_by(|a, b| b.1.total_cmp(&a.1));
        out.into_iter().map(|(plane, _)| plane).collect()
    }

    /// The parts of the room on which something can stand beside its floor.
    pub fn ledges(&self) -> impl Iterator<Item = (Ledge, LedgeTop<'_>)> {
        let blocks = self.shape.blocks.iter().enumerate().filter(|(_, block)| block.carries(&self.extents));
        let niches = self.shape.niches.iter().enumerate().filter(|(_, niche)| niche.carries());
        let all = blocks.map(|(i, _)| Ledge::Block(i)).chain(niches.map(|(i, _)| Ledge::Niche(i)));
        all.filter_map(|ledge| Some((ledge, self.ledge_top(ledge)?)))
    }

    /// Where things stand on a ledge; `None` where the shape has no such part.
    pub fn ledge_top(&self, ledge: Ledge) -> Option<LedgeTop<'_>> {
        let of = |kind, min: DVec3, max: DVec3, height| LedgeTop {
            kind,
            area: [min.xz(), max.xz()],
            height,
            span: [min.y, max.y],
        };
        match ledge {
            Ledge::Block(i) => self.shape.blocks.get(i).map(|b| of(b.kind.as_str(), b.min, b.max, b.max.y)),
            Ledge::Niche(i) => self.shape.niches.get(i).map(|n| of(n.kind.as_str(), n.min, n.max, n.min.y)),
        }
    }

    /// The ledge of a name ([`Ledge::id`]), where something can stand on it.
    pub fn ledge_named(&self, id: &ObjectId) -> Option<Ledge> {
        self.ledges().map(|(ledge, _)| ledge).find(|ledge| ledge.id() == *id)
    }

    /// Those of [`Room::planes`] that furniture can stand against: they come down to the floor, over more than a hand's
    /// breadth.
    pub fn standing_planes(&self, wall: Wall) -> Vec<WallPlane> {
        if self.shape.is_box() {
            return vec![wall.into()];
        }
        let faces = self.known_faces();
        let foot = |plane: &WallPlane| {
            let own = faces.all().iter().filter(|f| {
                let same = |p: WallPlane| p.wall == wall && (p.inset - plane.inset).abs() < TOUCH;
                f.plane(&self.extents).is_some_and(same)
            });
            own.map(|f| {
                let feet = f.polygon.iter().filter(|p| p.y < EPS).map(|p| wall.coordinates(*p).x);
                let (low, high) = feet.fold((f64::MAX, f64::MIN), |(l, h), u| (l.min(u), h.max(u)));
                (high - low).max(0.0)
            })
            .sum::<f64>()
        };
        let mut planes = self.planes(wall);
        planes.retain(|p| foot(p) > SHORTEST_FOOT);
        if planes.is_empty() { vec![wall.into()] } else { planes }
    }

    /// Level rectangles (smallest and largest x and z) in which something may be whose foot is at a height: the box first, then
    /// for each niche that is open there the stretch of the box before it, with the niche.
    pub fn standing_areas(&self, foot: f64) -> impl Iterator<Item = [DVec2; 2]> {
        let e = self.extents;
        let reached = move |n: &&Niche| n.min.y < foot + STEP && foot < n.max.y;
        let of_niche = move |niche: &Niche| {
            let (mut low, mut high) = (niche.min.xz(), niche.max.xz());
            match niche.surface.wall()? {
                Wall::Left => high.x = e.width,
                Wall::Right => low.x = 0.0,
                Wall::Back => high.y = e.depth,
                Wall::Front => low.y = 0.0,
            }
            Some([low, high])
        };
        let niches = self.shape.niches.iter().filter(reached).filter_map(of_niche);
        std::iter::once([DVec2::ZERO, DVec2::new(e.width, e.depth)]).chain(niches)
    }

    /// The plane behind an object that is held by, or has its back to, a wall: of those that cover its place along the
    /// wall, the nearest to it; the box's own wall when none does.
    pub fn plane_behind(&self, wall: Wall, at: DVec3) -> WallPlane {
        if self.shape.is_box() {
            return wall.into();
        }
        let here = wall.coordinates(at);
        let away = |p: &WallPlane| p.distance(&self.extents, at).abs();
        self.known_faces()
            .all()
            .iter()
            .filter_map(|face| {
                let plane = face.plane(&self.extents).filter(|p| p.wall == wall)?;
                let corners = || face.polygon.iter().map(|p| wall.coordinates(*p));
                let (low, high) = corners().fold((DVec2::MAX, DVec2::MIN), |(l, h), p| (l.min(p), h.max(p)));
                // Above a ledge the wall is behind, not the ledge's front.
                let passes = here.y >= high.y - ABOVE_LEDGE && high.y < self.extents.height - MIN_ROOM_ABOVE;
                (here.x >= low.x - EPS && here.x <= high.x + EPS && !passes).then_some(plane)
            })
            .min_by(|a, b| away(a).total_cmp(&away(b)))
            .unwrap_or(wall.into())
    }

    /// Height of the level ceiling above a place: in a tray, that of its field; under a part that is lowered, its.
    pub fn ceiling_over(&self, at: DVec3) -> f64 {
        let under =
            |b: &&Block| b.hangs(&self.extents) && at.xz().cmpge(b.min.xz()).all() && at.xz().cmple(b.max.xz()).all();
        if let Some(low) = self.shape.blocks.iter().filter(under).map(|b| b.min.y).reduce(f64::min) {
            return low;
        }
        let over = |n: &&Niche| {
            let (low, high) = (n.min.xz(), n.max.xz());
            n.surface == Surface::Ceiling && at.xz().cmpge(low).all() && at.xz().cmple(high).all()
        };
        // What hangs hangs in the opening, not above the ledge beside it.
        let open = |n: &&Niche| n.min.y <= self.extents.height + EPS;
        let trays = || self.shape.niches.iter().filter(over);
        if trays().any(|n| open(&n)) { trays().map(|n| n.max.y).fold(0.0, f64::max) } else { self.extents.height }
    }

    /// Area of the free floor, metres squared.
    pub fn floor_area(&self) -> f64 {
        let floor = |f: &&RoomFace| f.normal == DVec3::Y && f.polygon.iter().all(|p| p.y.abs() < EPS);
        self.all_faces().iter().filter(floor).map(|f| area(&f.polygon)).sum()
    }
}

fn area(polygon: &[DVec3]) -> f64 {
    (1..polygon.len().saturating_sub(1))
        .map(|i| (polygon[i] - polygon[0]).cross(polygon[i + 1] - polygon[0]))
        .sum::<DVec3>()
        .length()
        / 2.0
}

/// The side of a cell that lies against a face which looks as `side` does.
fn cell_side(side: Surface, low: DVec3, high: DVec3) -> Vec<DVec3> {
    let normal = side.normal();
    let axis = normal.abs().to_array().iter().position(|c| *c > 0.5).unwrap_or(0);
    let at = if normal[axis] > 0.0 { low[axis] } else { high[axis] };
    let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
    let corner = |a: f64, b: f64| {
        let mut p = DVec3::ZERO;
        (p[axis], p[i], p[j]) = (at, a, b);
        p
    };
    let quad = [corner(low[i], low[j]), corner(high[i], low[j]), corner(high[i], high[j]), corner(low[i], high[j])];
    // Counter-clockwise as seen from inside the room.
    if normal[axis] > 0.0 { quad.to_vec() } else { quad.into_iter().rev().collect() }
}

/// The part of a convex polygon where a linear function is not negative.
pub fn clipped(polygon: &[DVec3], keep: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let n = polygon.len();
    let mut out = Vec::with_capacity(n + 1);
    for i in 0..n {
        let (a, b) = (polygon[i], polygon[(i + 1) % n]);
        let (ka, kb) = (keep(a), keep(b));
        if ka >= -1e-9 {
            out.push(a);
        }
        if (ka > 1e-9 && kb < -1e-9) || (ka < -1e-9 && kb > 1e-9) {
            out.push(a + (b - a) * (ka / (ka - kb)));
        }
    }
    out.dedup_by(|a, b| a.distance(*b) < 1e-9);
    if area(&out) < 1e-10 { Vec::new() } else { out }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room(shape: RoomShape) -> Room {
        Room {
            room_type: "room".into(),
            extents: Extents { width: 5.0, height: 2.6, depth: 4.0 },
            shape,
            seen: vec![],
            openings: vec![],
            floor_texture: None,
            wall_texture: None,
        }
    }

    fn block(kind: &str, min: [f64; 3], max: [f64; 3]) -> Block {
        Block { kind: kind.into(), min: min.into(), max: max.into() }
    }

    fn niche(wall: Wall, min: [f64; 3], max: [f64; 3]) -> Niche {
        let surface = wall.surface();
        Niche { kind: "niche".into(), surface, sides: None, glow: None, min: min.into(), max: max.into() }
    }

    /// A tray 0.2 m deep, 3 by 2 m, with a ledge of 0.1 m above a lip of 0.05 m.
    fn tray() -> Vec<Niche> {
        let box_of = |min: [f64; 3], max: [f64; 3]| Niche {
            kind: "tray".into(),
            surface: Surface::Ceiling,
            sides: None,
            glow: None,
            min: min.into(),
            max: max.into(),
        };
        vec![box_of([1.0, 2.6, 1.0], [4.0, 2.65, 3.0]), box_of([0.9, 2.65, 0.9], [4.1, 2.8, 3.1])]
    }

    #[test]
    fn a_shape_keeps_its_share_of_a_room_that_is_another_one() {
        let mut shape = RoomShape {
            blocks: vec![block("soffit", [0.0, 2.0, 0.0], [5.0, 2.6, 1.0])],
            niches: vec![niche(Wall::Left, [-0.5, 0.0, 1.0], [0.0, 2.0, 3.0])],
            ..RoomShape::default()
        };
        let old = room(RoomShape::default()).extents;
        let new = Extents { width: 5.5, height: 2.86, depth: 4.4 };
        shape.stretched(&old, &new, 0.9);
        let near = |a: DVec3, b: [f64; 3]| assert!(a.distance(b.into()) < 1e-9, "{a} {b:?}");
        near(shape.blocks[0].min, [0.0, 2.2, 0.0]);
        near(shape.blocks[0].max, [5.5, 2.86, 1.1]);
        near(shape.niches[0].min, [-0.45, 0.0, 1.1]);
        near(shape.niches[0].max, [0.0, 2.2, 3.3]);
    }

    #[test]
    fn a_niche_that_comes_down_to_the_floor_is_a_place_to_stand_in() {
        let shape = RoomShape {
            niches: vec![
                niche(Wall::Left, [-0.75, 0.0, 1.0], [0.0, 2.0, 3.0]),
                niche(Wall::Back, [2.0, 1.1, -0.3], [3.0, 2.0, 0.0]),
            ],
            ..RoomShape::default()
        };
        let room = room(shape);
        let box_alone = [DVec2::ZERO, DVec2::new(5.0, 4.0)];
        let alcove = [DVec2::new(-0.75, 1.0), DVec2::new(5.0, 3.0)];
        assert_eq!(room.standing_areas(0.0).collect::<Vec<_>>(), [box_alone, alcove]);
        assert_eq!(room.standing_areas(1.1).count(), 3, "on the recess's sill");
        assert_eq!(room.standing_areas(2.2).collect::<Vec<_>>(), [box_alone], "above both");
    }

    /// Volume inside closed faces by the divergence theorem; wrong when a face is missing or doubled.
    fn volume(room: &Room) -> f64 {
        room.all_faces().iter().map(|f| -area(&f.polygon) * f.polygon[0].dot(f.normal) / 3.0).sum()
    }

    #[test]
    fn faces_close_the_free_space() {
        let full = 5.0 * 2.6 * 4.0;
        let corner = block("corner", [3.0, 0.0, 0.0], [5.0, 2.6, 1.5]);
        let beam = block("beam", [0.0, 2.3, 1.0], [5.0, 2.6, 1.2]);
        let recess = niche(Wall::Back, [1.0, 0.5, -0.3], [2.0, 2.0, 0.0]);
        let slope = Slope { wall: Wall::Left, low: 1.2, run: 1.4 };
        let cases = [
            (RoomShape::default(), full),
            (RoomShape { blocks: vec![corner.clone()], ..RoomShape::default() }, full - 2.0 * 2.6 * 1.5),
            (RoomShape { blocks: vec![beam], ..RoomShape::default() }, full - 5.0 * 0.3 * 0.2),
            (RoomShape { niches: vec![recess.clone()], ..RoomShape::default() }, full + 1.0 * 1.5 * 0.3),
            (RoomShape { slopes: vec![slope], ..RoomShape::default() }, full - 1.4 * 1.4 / 2.0 * 4.0),
            (RoomShape { niches: tray(), ..RoomShape::default() }, full + 3.0 * 2.0 * 0.05 + 3.2 * 2.2 * 0.15),
            (
                RoomShape { blocks: vec![corner], niches: vec![recess], slopes: vec![slope] },
                full - 2.0 * 2.6 * 1.5 + 1.0 * 1.5 * 0.3 - 1.4 * 1.4 / 2.0 * 4.0,
            ),
        ];
        // The recess ends at 2.0 m, where the slope is (x = 1: 2.2 m): nothing of it is cut.
        for (shape, expected) in cases {
            let got = volume(&room(shape.clone()));
            assert!((got - expected).abs() < 1e-6, "{shape:?}: {got}, expected {expected}");
        }
    }

    #[test]
    fn two_slopes_meet_in_a_ridge() {
        let slope = |wall| Slope { wall, low: 1.0, run: 3.0 };
        let r = room(RoomShape { slopes: vec![slope(Wall::Left), slope(Wall::Right)], ..RoomShape::default() });
        // Both reach 2.6 m after 3 m, so they meet in the middle, at 2.5 m, below it.
        let ridge = 1.0 + 1.6 * 2.5 / 3.0;
        let expected = 4.0 * 5.0 * f64::midpoint(1.0, ridge);
        assert!((volume(&r) - expected).abs() < 1e-6, "{}", volume(&r));
    }

    #[test]
    fn planes_that_touch_an_arch_close_a_vault() {
        // Half an ellipse over the room's 5 m, 0.8 m high.
        let touching = |wall: Wall| {
            [18.0_f64, 36.0, 54.0, 72.0].map(|degrees| {
                let angle = degrees.to_radians();
                let low = 1.8 + 0.8 * (angle / 2.0).tan();
                Slope { wall, low, run: (2.6 - low) * 2.5 / 0.8 * angle.tan() }
            })
        };
        let slopes = [Wall::Left, Wall::Right].into_iter().flat_map(touching).collect();
        let r = room(RoomShape { slopes, ..RoomShape::default() });
        let arch = 4.0 * (5.0 * 1.8 + std::f64::consts::PI * 2.5 * 0.8 / 2.0);
        assert!((1.0..1.01).contains(&(volume(&r) / arch)), "{} and {arch}", volume(&r));
        let open: DVec3 = r.all_faces().iter().map(|f| f.normal * area(&f.polygon)).sum();
        assert!(open.length() < 1e-6, "faces that close a space have no side too much: {open}");
    }

    #[test]
    fn rays_stop_at_blocks_and_go_into_niches() {
        let shape = RoomShape {
            blocks: vec![block("corner", [3.0, 0.0, 0.0], [5.0, 2.6, 1.5])],
            niches: vec![niche(Wall::Back, [1.0, 0.5, -0.3], [2.0, 2.0, 0.0])],
            slopes: vec![],
        };
        let r = room(shape);
        let faces = r.faces();
        let eye = DVec3::new(2.5, 1.3, 3.5);
        let exit =
            |to: [f64; 3]| faces.exit(&Ray { origin: eye, direction: (DVec3::from(to) - eye).normalize() }).unwrap();
        let front = exit([4.0, 1.0, 1.5]);
        assert_eq!((front.surface, front.normal), (Surface::Back, DVec3::Z));
        assert!(front.point.distance(DVec3::new(4.0, 1.0, 1.5)) < 1e-9);
        let side = exit([3.0, 1.2, 0.4]);
        assert_eq!((side.surface, side.normal), (Surface::Right, DVec3::NEG_X), "the side of the L is a right wall");
        let bottom = exit([1.5, 1.0, -0.3]);
        assert!(bottom.point.distance(DVec3::new(1.5, 1.0, -0.3)) < 1e-9);
        let jamb = exit([1.0, 1.2, -0.2]);
        assert_eq!((jamb.surface, jamb.normal), (Surface::Back, DVec3::X), "the side of a niche belongs to its wall");
        assert_eq!((jamb.side_of, bottom.side_of), (Some(0), None));
        // Each point is found again by its coordinates on its surface, where that is seen head-on.
        for hit in [front, side, bottom] {
            let (p, normal) = faces.point(hit.surface, hit.surface.coordinates(hit.point));
            assert!(p.distance(hit.point) < 1e-9 && normal == hit.normal);
        }
    }

    #[test]
    fn a_tray_is_ceiling_and_nothing_hangs_on_its_sides() {
        let r = room(RoomShape { niches: tray(), ..RoomShape::default() });
        let faces = r.faces();
        let eye = DVec3::new(2.5, 1.3, 3.5);
        let exit =
            |to: [f64; 3]| faces.exit(&Ray { origin: eye, direction: (DVec3::from(to) - eye).normalize() }).unwrap();
        let field = exit([2.0, 2.8, 2.0]);
        assert_eq!((field.surface, field.side_of), (Surface::Ceiling, None));
        assert!((field.point.y - 2.8).abs() < 1e-9);
        let lip = exit([2.0, 2.62, 1.0]);
        assert_eq!((lip.surface, lip.side_of, lip.wall()), (Surface::Ceiling, Some(0), None));
        assert!((exit([2.0, 2.6, 0.5]).point.y - 2.6).abs() < 1e-9, "the ceiling around it is where it was");
        for wall in Wall::ALL {
            assert_eq!(r.planes(wall).len(), 1, "{wall:?}");
        }
        // The field is found by its coordinates, and what is seen from below of the ceiling beside it.
        let (p, _) = faces.point(Surface::Ceiling, DVec2::new(2.0, 2.0));
        assert!((p.y - 2.8).abs() < 1e-9);
        let (p, _) = faces.point(Surface::Ceiling, DVec2::new(0.95, 2.0));
        assert!((p.y - 2.6).abs() < 1e-9, "the ledge hides what is above it");
        let over = |x: f64| r.ceiling_over(DVec3::new(x, 1.0, 2.0));
        assert_eq!([over(2.0), over(0.95), over(0.5)], [2.8, 2.6, 2.6]);
    }

    #[test]
    fn a_niche_of_an_older_file_opens_from_its_wall() {
        let text = r#"{"kind":"niche","wall":"left","min":[-0.3,0.5,1],"max":[0,1.5,2]}"#;
        let niche: Niche = serde_json::from_str(text).unwrap();
        assert_eq!(niche.surface, Surface::Left);
    }

    #[test]
    fn objects_find_the_plane_behind_them() {
        let r =
            room(RoomShape { blocks: vec![block("corner", [3.0, 0.0, 0.0], [5.0, 2.6, 1.5])], ..RoomShape::default() });
        let back: Vec<f64> = r.planes(Wall::Back).iter().map(|p| p.inset).collect();
        assert_eq!(back.len(), 2);
        assert!(back.contains(&0.0) && back.contains(&1.5));
        let at = |x: f64, z: f64| r.plane_behind(Wall::Back, DVec3::new(x, 1.0, z)).inset;
        assert_eq!(at(1.0, 0.1), 0.0);
        assert_eq!(at(4.0, 1.6), 1.5);
        assert_eq!(r.plane_behind(Wall::Right, DVec3::new(2.9, 1.0, 0.7)).inset, 2.0);
        assert_eq!(r.plane_behind(Wall::Right, DVec3::new(4.9, 1.0, 3.0)).inset, 0.0);
    }

    #[test]
    fn nothing_stands_against_a_niche() {
        let shape = RoomShape {
            blocks: vec![block("chimney breast", [2.0, 0.0, 0.0], [3.2, 2.6, 0.4])],
            niches: vec![niche(Wall::Back, [0.5, 0.8, -0.3], [1.2, 1.8, 0.0])],
            slopes: vec![],
        };
        let r = room(shape);
        let insets = |planes: Vec<WallPlane>| {
            let mut out: Vec<f64> = planes.iter().map(|p| p.inset).collect();
            out.sort_by(f64::total_cmp);
            out
        };
        assert_eq!(insets(r.planes(Wall::Back)), [-0.3, 0.0, 0.4]);
        assert_eq!(insets(r.standing_planes(Wall::Back)), [0.0, 0.4]);
        assert_eq!(r.standing_planes(Wall::Front).len(), 1);
        // The breast's side looks as the left wall does, and is 40 cm long.
        assert_eq!(insets(r.standing_planes(Wall::Left)), [0.0, 3.2]);
    }

    #[test]
    fn what_is_kept_of_a_room_is_not_told_of_another() {
        let mut r =
            room(RoomShape { blocks: vec![block("corner", [3.0, 0.0, 0.0], [5.0, 2.6, 1.5])], ..RoomShape::default() });
        let insets = |r: &Room| r.planes(Wall::Back).iter().map(|p| p.inset).fold(0.0, f64::max);
        assert_eq!(insets(&r), 1.5);
        r.shape.blocks[0].max.z = 1.2;
        assert_eq!(insets(&r), 1.2);
        r.extents.depth = 6.0;
        assert_eq!(r.planes(Wall::Front).len(), 1);
        assert!(r.faces().all().iter().flat_map(|f| &f.polygon).any(|p| p.z == 6.0));
    }

    #[test]
    fn the_floor_of_an_l_lacks_its_corner() {
        let r =
            room(RoomShape { blocks: vec![block("corner", [3.0, 0.0, 0.0], [5.0, 2.6, 1.5])], ..RoomShape::default() });
        assert!((r.floor_area() - (20.0 - 3.0)).abs() < 1e-6);
    }

    #[test]
    fn what_touches_a_wall_goes_with_it() {
        let old = Extents { width: 5.0, height: 2.6, depth: 4.0 };
        let new = Extents { width: 5.5, height: 2.7, depth: 4.0 };
        let mut shape =
            RoomShape { blocks: vec![block("corner", [3.0, 0.0, 0.0], [5.0, 2.6, 1.5])], ..RoomShape::default() };
        shape.fitted(&old, &new, 0.0);
        assert_eq!(shape.blocks[0].min, DVec3::new(3.0, 0.0, 0.0));
        assert_eq!(shape.blocks[0].max, DVec3::new(5.5, 2.7, 1.5));
    }
}
