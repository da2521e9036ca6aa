//! The layout of a home: rooms by the inner faces of their walls, doors between them.
//!
//! The format is JSON and is described in `docs/homes.md`; [`HomeLayout::parse`] checks all of it. Rooms have walls along
//! the axes; a room that is no rectangle is its bounding rectangle less what [`LayoutRoom::missing`] says.

use std::collections::BTreeSet;

use glam::DVec2;
use harmony_scene::Wall;
use serde::{Deserialize, Serialize};

use crate::HomeError;
use crate::frame::Rect;

/// Version of the format.
pub const LAYOUT_VERSION: u32 = 1;
/// Lengths of rooms that are plausible, metres.
const ROOM_M: [f64; 2] = [0.6, 60.0];
/// Thicknesses of walls that are plausible, metres.
const WALL_M: [f64; 2] = [0.0, 1.0];
/// Heights of rooms and doors that are plausible, metres.
const HEIGHT_M: [f64; 2] = [1.2, 12.0];
/// Coordinates of a plan that are this near to one another are the same, metres.
const SAME_M: f64 = 0.02;
/// Thickness of walls where nothing says it, metres: a plastered partition of 100 mm blocks.
pub const USUAL_WALL_M: f64 = 0.12;
/// Height of doors where nothing says it, metres.
pub const USUAL_DOOR_M: f64 = 2.05;

/// Lengths in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Unit {
    /// Metres.
    #[default]
    #[serde(rename = "m")]
    Metre,
    /// Centimetres.
    #[serde(rename = "cm")]
    Centimetre,
    /// Millimetres.
    #[serde(rename = "mm")]
    Millimetre,
}

impl Unit {
    fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 0.01,
            Self::Millimetre => 0.001,
        }
    }
}

/// What fills a way between rooms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DoorKind {
    /// A leaf.
    #[default]
    Door,
    /// Nothing.
    Opening,
}

/// A room of the layout.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayoutRoom {
    /// `[a-z0-9_]`, beginning with a letter, 32 at most.
    pub name: String,
    /// Its walls' inner faces, when it is a rectangle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rectangle: Option<Rect>,
    /// Its corners, when it is none: walls along the axes, either way round.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub polygon: Vec<DVec2>,
    /// Floor to ceiling, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<f64>,
    /// Height of its floor, metres.
    #[serde(default)]
    pub floor: f64,
    /// Which of its walls the photo's back wall is, where that is known: `back` is the one at the smallest z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photo_faces: Option<Wall>,
}

/// A way between two rooms, or out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayoutDoor {
    /// One room (a door out) or two.
    pub rooms: Vec<String>,
    /// Its middle, x and z, anywhere within the wall.
    pub at: DVec2,
    /// Along the wall, metres.
    pub width: f64,
    /// Metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<f64>,
    /// What it is.
    #[serde(default)]
    pub kind: DoorKind,
}

/// The layout of a home, metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HomeLayout {
    /// [`LAYOUT_VERSION`].
    pub version: u32,
    /// Lengths in the file; a [`HomeLayout`] that was parsed has metres.
    #[serde(default)]
    pub unit: Unit,
    /// Thickness of outer walls and of what lies beyond one; between two rooms the plan itself has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wall_thickness: Option<f64>,
    /// Rooms.
    pub rooms: Vec<LayoutRoom>,
    /// Doors and openings.
    #[serde(default)]
    pub doors: Vec<LayoutDoor>,
}

/// A door of a layout on one of its rooms' sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DoorSide {
    /// The room.
    pub room: usize,
    /// On which side of it.
    pub side: Wall,
}

fn bad(what: impl Into<String>, why: impl Into<String>) -> HomeError {
    HomeError::Layout { what: what.into(), why: why.into() }
}

/// Whether a name may be a room's: it becomes the name of nodes and the beginning of objects' ids.
pub fn is_name(name: &str) -> bool {
    let fine = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    name.starts_with(|c: char| c.is_ascii_lowercase()) && name.len() <= 32 && name.chars().all(fine)
}

impl LayoutRoom {
    /// The smallest rectangle around it.
    pub fn bounds(&self) -> Rect {
        match self.rectangle {
            Some(rect) => rect,
            None => Rect {
                min: self.polygon.iter().copied().fold(DVec2::INFINITY, DVec2::min),
                max: self.polygon.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max),
            },
        }
    }

    /// What of its bounding rectangle is not the room's.
    pub fn missing(&self) -> Vec<Rect> {
        self.cells(false)
    }

    /// Rectangles that make up the room.
    pub fn free(&self) -> Vec<Rect> {
        if self.polygon.is_empty() { vec![self.bounds()] } else { self.cells(true) }
    }

    /// A room of which nothing but its name is known.
    pub(crate) fn empty(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            rectangle: None,
            polygon: Vec::new(),
            height: None,
            floor: 0.0,
            photo_faces: None,
        }
    }

    /// Cells of the grid of the polygon's coordinates, inside or outside, joined along x.
    fn cells(&self, inside: bool) -> Vec<Rect> {
        let lines = |f: fn(&DVec2) -> f64| {
            let mut all: Vec<f64> = self.polygon.iter().map(f).collect();
            all.sort_by(f64::total_cmp);
            all.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
            all
        };
        let (xs, zs) = (lines(|p| p.x), lines(|p| p.y));
        let mut out: Vec<Rect> = Vec::new();
        for z in zs.windows(2) {
            for x in xs.windows(2) {
                let cell = Rect { min: DVec2::new(x[0], z[0]), max: DVec2::new(x[1], z[1]) };
                if within(&self.polygon, cell.centre()) != inside {
                    continue;
                }
                match out.last_mut() {
                    Some(last) if last.min.y == cell.min.y && last.max.x == cell.min.x => last.max.x = cell.max.x,
                    _ => out.push(cell),
                }
            }
        }
        out
    }
}

/// Whether a point is inside a polygon (even-odd rule).
fn within(polygon: &[DVec2], p: DVec2) -> bool {
    let next = polygon.iter().cycle().skip(1);
    let crossed = polygon
        .iter()
        .zip(next)
        .filter(|(a, b)| (a.y > p.y) != (b.y > p.y) && p.x < (b.x - a.x) * (p.y - a.y) / (b.y - a.y) + a.x);
    crossed.count() % 2 == 1
}

impl HomeLayout {
    /// Reads and checks a layout.
    ///
    /// # Errors
    /// [`HomeError::Layout`] that says what is wrong with which room or door.
    pub fn parse(text: &str) -> Result<Self, HomeError> {
        let mut layout: Self = serde_json::from_str(text).map_err(|e| bad("the layout", e.to_string()))?;
        layout.bring_to_metres();
        layout.check()?;
        Ok(layout)
    }

    fn bring_to_metres(&mut self) {
        let k = self.unit.metres();
        self.unit = Unit::Metre;
        let scaled = |v: &mut Option<f64>| *v = v.map(|v| v * k);
        scaled(&mut self.wall_thickness);
        for room in &mut self.rooms {
            room.rectangle = room.rectangle.map(|r| Rect { min: r.min * k, max: r.max * k });
            room.polygon.iter_mut().for_each(|p| *p *= k);
            scaled(&mut room.height);
            room.floor *= k;
        }
        for door in &mut self.doors {
            door.at *= k;
            door.width *= k;
            scaled(&mut door.height);
        }
    }

    /// The number of a room.
    pub fn room(&self, name: &str) -> Option<usize> {
        self.rooms.iter().position(|r| r.name == name)
    }

    /// Thickness of walls towards outside, metres.
    pub fn outer_wall(&self) -> f64 {
        self.wall_thickness.unwrap_or(USUAL_WALL_M)
    }

    /// Checks all that later steps take for granted; makes coordinates that are nearly the same the same.
    ///
    /// # Errors
    /// [`HomeError::Layout`].
    pub fn check(&mut self) -> Result<(), HomeError> {
        if self.version != LAYOUT_VERSION {
            let why = format!("its version is {}, this program reads {LAYOUT_VERSION}", self.version);
            return Err(bad("the layout", why));
        }
        if self.rooms.is_empty() {
            return Err(bad("the layout", "it has no rooms"));
        }
        if let Some(t) = self.wall_thickness
            && !(WALL_M[0]..=WALL_M[1]).contains(&t)
        {
            return Err(bad("wall_thickness", format!("{t} m; walls have {} to {} m", WALL_M[0], WALL_M[1])));
        }
        let mut names = BTreeSet::new();
        for room in &mut self.rooms {
            if !is_name(&room.name) {
                let why = "names of rooms are of a-z, 0-9 and _, begin with a letter and have 32 at most";
                return Err(bad(format!("room {:?}", room.name), why));
            }
            if !names.insert(room.name.clone()) {
                return Err(bad(format!("room {}", room.name), "two rooms have this name"));
            }
            check_room(room)?;
        }
        for (k, a) in self.rooms.iter().enumerate() {
            for b in &self.rooms[k + 1..] {
                let floors = a.free().into_iter().flat_map(|x| b.free().into_iter().filter_map(move |y| x.meet(&y)));
                if let Some(met) = floors.max_by(|x, y| x.size().min_element().total_cmp(&y.size().min_element()))
                    && met.size().min_element() > SAME_M
                {
                    let why = format!("they overlap by {:.2} x {:.2} m", met.size().x, met.size().y);
                    return Err(bad(format!("rooms {} and {}", a.name, b.name), why));
                }
            }
        }
        (0..self.doors.len()).try_for_each(|k| self.sides(k).map(|_| ()))
    }

    /// The sides of rooms that a door is in: of one room, or of two that face each other.
    ///
    /// # Errors
    /// [`HomeError::Layout`] for a door that no such walls have room for.
    pub fn sides(&self, door: usize) -> Result<Vec<DoorSide>, HomeError> {
        let d = &self.doors[door];
        let what = || format!("door {} ({})", door + 1, d.rooms.join(" - "));
        if !(d.at.is_finite() && (0.4..=6.0).contains(&d.width)) {
            return Err(bad(what(), format!("at {} with a width of {} m: 0.4 to 6 m are doors", d.at, d.width)));
        }
        if d.height.is_some_and(|h| !(HEIGHT_M[0]..=HEIGHT_M[1]).contains(&h)) {
            return Err(bad(what(), "its height is no door's"));
        }
        if d.rooms.is_empty() || d.rooms.len() > 2 || (d.rooms.len() == 2 && d.rooms[0] == d.rooms[1]) {
            return Err(bad(what(), "a door is between two rooms, or of one and leads out"));
        }
        let mut rooms = Vec::new();
        for name in &d.rooms {
            rooms.push(self.room(name).ok_or_else(|| bad(what(), format!("there is no room {name}")))?);
        }
        let of = |room: usize| {
            self.rooms[room]
                .free()
                .into_iter()
                .flat_map(|free| Wall::ALL.map(|side| (side, free)))
                .filter(|(side, f)| {
                    let (out, u) = match side {
                        Wall::Left | Wall::Right => (d.at.x, d.at.y),
                        Wall::Back | Wall::Front => (d.at.y, d.at.x),
                    };
                    let beyond = (out - f.side(*side)) * outward(*side);
                    let [low, high] = f.along(*side);
                    let slack = SAME_M + d.width / 2.0;
                    (-SAME_M..=WALL_M[1]).contains(&beyond)
                        && u - low >= slack - 2.0 * SAME_M
                        && high - u >= slack - 2.0 * SAME_M
                })
                .map(move |(side, f)| {
                    (
                        DoorSide { room, side },
                        (f.side(side) - if matches!(side, Wall::Left | Wall::Right) { d.at.x } else { d.at.y }).abs(),
                    )
                })
                .collect::<Vec<_>>()
        };
        let first = of(rooms[0]);
        if let [_, other] = rooms[..] {
            let second = of(other);
            let pairs = first.iter().flat_map(|a| second.iter().map(move |b| (a, b)));
            let best = pairs
                .filter(|(a, b)| b.0.side == a.0.side.opposite())
                .min_by(|x, y| (x.0.1 + x.1.1).total_cmp(&(y.0.1 + y.1.1)));
            return best
                .map(|(a, b)| vec![a.0, b.0])
                .ok_or_else(|| bad(what(), "it is not within a wall that both rooms have room for it in"));
        }
        let best = first.iter().min_by(|a, b| a.1.total_cmp(&b.1));
        best.map(|a| vec![a.0]).ok_or_else(|| bad(what(), "it is not in a wall of its room"))
    }
}

/// +1 where a side looks away from the room along a growing coordinate.
pub(crate) fn outward(side: Wall) -> f64 {
    match side {
        Wall::Right | Wall::Front => 1.0,
        Wall::Left | Wall::Back => -1.0,
    }
}

fn check_room(room: &mut LayoutRoom) -> Result<(), HomeError> {
    let what = || format!("room {}", room.name);
    if room.rectangle.is_some() != room.polygon.is_empty() {
        return Err(bad(what(), "it has either a rectangle or a polygon"));
    }
    if room.height.is_some_and(|h| !(HEIGHT_M[0]..=HEIGHT_M[1]).contains(&h))
        || !room.floor.is_finite()
        || room.floor.abs() > 100.0
    {
        return Err(bad(what(), "its height or floor level is not plausible (metres?)"));
    }
    if !room.polygon.is_empty() {
        if room.polygon.len() > 200 || !room.polygon.iter().all(|p| p.is_finite()) {
            return Err(bad(what(), "its corners are not numbers, or more than 200"));
        }
        let polygon = squared(&room.polygon).ok_or_else(|| {
            bad(what(), "its walls must run along the axes: turn the plan so that they do (slanted walls are not read)")
        })?;
        room.polygon = polygon;
    }
    let room: &LayoutRoom = room;
    let size = room.bounds().size();
    if !(size.min_element() >= ROOM_M[0] && size.max_element() <= ROOM_M[1]) {
        let why = format!(
            "it has {:.2} x {:.2} m; rooms have {} to {} m a side: is the unit right (m, cm, mm)?",
            size.x, size.y, ROOM_M[0], ROOM_M[1]
        );
        return Err(bad(format!("room {}", room.name), why));
    }
    Ok(())
}

/// A polygon with its nearly straight walls made straight and corners that are none left out; `None` for slanted walls.
fn squared(polygon: &[DVec2]) -> Option<Vec<DVec2>> {
    let mut points = polygon.to_vec();
    let snap = |points: &mut Vec<DVec2>, axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        values.sort_by(f64::total_cmp);
        for p in points.iter_mut() {
            let near = values.iter().copied().find(|v| (*v - p[axis]).abs() < SAME_M);
            p[axis] = near.unwrap_or(p[axis]);
        }
    };
    snap(&mut points, 0);
    snap(&mut points, 1);
    points.dedup();
    if points.len() > 1 && points.first() == points.last() {
        points.pop();
    }
    let n = points.len();
    let straight = (0..n).all(|i| {
        let step = points[(i + 1) % n] - points[i];
        (step.x == 0.0) != (step.y == 0.0)
    });
    let corner = |i: &usize| {
        let (a, b) = (points[*i] - points[(i + n - 1) % n], points[(i + 1) % n] - points[*i]);
        (a.x == 0.0) != (b.x == 0.0)
    };
    let corners: Vec<DVec2> = (0..n).filter(corner).map(|i| points[i]).collect();
    (straight && corners.len() >= 4).then_some(corners)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two() -> HomeLayout {
        HomeLayout::parse(
            r#"{"version": 1, "wall_thickness": 0.12, "rooms": [
                {"name": "kitchen", "rectangle": {"min": [0, 0], "max": [3, 4]}, "height": 2.5},
                {"name": "hall", "polygon": [[3.12, 0], [6, 0], [6, 4], [4, 4], [4, 2], [3.12, 2]]}],
              "doors": [{"rooms": ["kitchen", "hall"], "at": [3.06, 1], "width": 0.9},
                        {"rooms": ["hall"], "at": [6, 3], "width": 1.0, "height": 2.1}]}"#,
        )
        .unwrap()
    }

    #[test]
    fn a_layout_says_which_walls_its_doors_are_in_and_what_rooms_lack() {
        let layout = two();
        let side = |room, side| DoorSide { room, side };
        assert_eq!(layout.sides(0).unwrap(), [side(0, Wall::Right), side(1, Wall::Left)]);
        assert_eq!(layout.sides(1).unwrap(), [side(1, Wall::Right)]);
        let hall = &layout.rooms[1];
        assert_eq!(hall.missing(), [Rect { min: DVec2::new(3.12, 2.0), max: DVec2::new(4.0, 4.0) }]);
        let free: f64 = hall.free().iter().map(Rect::area).sum();
        assert!((free - (2.88 * 4.0 - 0.88 * 2.0)).abs() < 1e-9);
        assert_eq!(layout.rooms[0].missing(), []);
    }

    #[test]
    fn units_are_read_and_layouts_survive_writing() {
        let text = r#"{"version": 1, "unit": "mm", "rooms": [
            {"name": "a", "rectangle": {"min": [0, 0], "max": [3000, 4000]}, "height": 2500, "photo_faces": "left"}]}"#;
        let layout = HomeLayout::parse(text).unwrap();
        assert_eq!(layout.rooms[0].bounds().max, DVec2::new(3.0, 4.0));
        assert_eq!(layout.rooms[0].height, Some(2.5));
        assert_eq!(HomeLayout::parse(&serde_json::to_string(&layout).unwrap()).unwrap(), layout);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let refused = |rooms: &str, doors: &str| {
            let text = format!(r#"{{"version": 1, "rooms": [{rooms}], "doors": [{doors}]}}"#);
            HomeLayout::parse(&text).unwrap_err().to_string()
        };
        let a = r#"{"name": "a", "rectangle": {"min": [0, 0], "max": [3, 4]}}"#;
        assert!(refused(r#"{"name": "a", "rectangle": {"min": [0, 0], "max": [3000, 4000]}}"#, "").contains("unit"));
        assert!(refused(r#"{"name": "A b", "rectangle": {"min": [0, 0], "max": [3, 4]}}"#, "").contains("a-z"));
        assert!(refused(r#"{"name": "a", "polygon": [[0, 0], [3, 1], [3, 4], [0, 4]]}"#, "").contains("axes"));
        assert!(refused(&format!("{a}, {a}"), "").contains("two rooms"));
        assert!(refused(&format!("{a}, {}", a.replace("\"a\"", "\"b\"")), "").contains("overlap by 3.00 x 4.00"));
        assert!(refused(a, r#"{"rooms": ["a", "b"], "at": [3, 1], "width": 0.9}"#).contains("no room b"));
        assert!(refused(a, r#"{"rooms": ["a"], "at": [1, 1], "width": 0.9}"#).contains("not in a wall"));
        assert!(refused(a, r#"{"rooms": ["a"], "at": [3, 3.9], "width": 0.9}"#).contains("not in a wall"));
        assert!(refused(a, r#"{"rooms": ["a"], "at": [3, 1], "width": 90}"#).contains("width"));
        assert!(refused(r#"{"name": "a"}"#, "").contains("either"));
        assert!(refused(r#"{"name": "a", "sides": 4}"#, "").contains("unknown field"));
    }
}
