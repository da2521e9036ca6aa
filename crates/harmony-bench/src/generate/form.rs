//! Rooms that are not boxes: which features a seed gives a room, and where they are.
//!
//! Coordinates are those of the files: the box of the whole room. A niche and the recess of a window are cut into a
//! lining, a thick wall that covers a wall of the box; chimney breasts stand out of a wall; the missing corner of an
//! L-plan is a back corner, where the photo shows it; slopes come down to one side wall, or to both.

use glam::{DVec3, Vec3Swizzles as _};
use harmony_scene::{Block, Extents, Niche, Opening, OpeningKind, Room, RoomShape, Slope, Surface, Wall, WallPlane};

use super::dice::Dice;

/// Something that makes a room other than a box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RoomFeature {
    /// A block in a back corner: an L-plan.
    LShape,
    /// A block before a wall.
    ChimneyBreast,
    /// A niche in a thick wall.
    Niche,
    /// A window set back in a thick wall.
    WindowRecess,
    /// An attic's ceiling.
    Slope,
    /// A passage into another room, half of them arched. The room may be a box besides.
    Passage,
    /// A recess in the middle of the ceiling.
    Tray,
}

impl RoomFeature {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::LShape, Self::ChimneyBreast, Self::Niche, Self::WindowRecess, Self::Slope, Self::Passage, Self::Tray];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::LShape => "lshape",
            Self::ChimneyBreast => "chimney",
            Self::Niche => "niche",
            Self::WindowRecess => "recess",
            Self::Slope => "slope",
            Self::Passage => "passage",
            Self::Tray => "tray",
        }
    }

    /// Features by their names, separated by commas; `box` is none, `mixed` all.
    ///
    /// # Errors
    /// A name that is unknown.
    pub fn list(text: &str) -> Result<Vec<Self>, String> {
        match text.trim() {
            "box" => Ok(Vec::new()),
            "mixed" => Ok(Self::ALL.to_vec()),
            names => names
                .split(',')
                .map(|name| {
                    let known = Self::ALL.into_iter().find(|f| f.name() == name.trim());
                    known.ok_or_else(|| {
                        let all: Vec<&str> = Self::ALL.iter().map(|f| f.name()).collect();
                        format!("shape {name:?} is unknown; shapes are box, mixed, {}", all.join(", "))
                    })
                })
                .collect(),
        }
    }
}

/// What a room is besides its box, and what has to be seen of it.
#[derive(Debug, Clone, Default)]
pub(super) struct Form {
    pub(super) shape: RoomShape,
    /// Openings without a leaf.
    pub(super) passages: Vec<Opening>,
    /// Points of each feature, a little before its faces.
    pub(super) marks: Vec<Vec<DVec3>>,
}

/// Random numbers of shapes have a stream of their own: rooms that are boxes stay as they are.
const STREAM: u64 = 83;
/// Share of rooms with two features.
const TWO: f64 = 0.35;
/// Wall beside a feature at least, metres.
const BESIDE: f64 = 0.6;
/// A window's recess is larger than the window by this on each side, metres; the architrave lies in it.
pub(super) const RECESS_MARGIN: f64 = 0.16;
/// Kind of a niche with a window at its bottom.
pub(super) const WINDOW_RECESS: &str = "window_recess";
/// What an L-plan leaves of its back wall at least, metres.
const NARROWEST: f64 = 1.8;
/// Points of a feature lie this far before its faces, metres.
const BEFORE: f64 = 0.01;
/// Points a side of a face.
const GRID: usize = 6;

/// The empty room.
pub(super) fn room_of(extents: Extents, shape: RoomShape) -> Room {
    Room {
        room_type: String::new(),
        extents,
        shape,
        seen: Vec::new(),
        openings: Vec::new(),
        floor_texture: None,
        wall_texture: None,
    }
}

/// Times that a feature is tried in another place.
const TRIES: usize = 8;

/// Draws one or two of the features for a room; fewer where the room has no place for them.
pub(super) fn draw(seed: u64, attempt: u64, features: &[RoomFeature], extents: &Extents) -> Form {
    let mut form = Form::default();
    if features.is_empty() {
        return form;
    }
    let mut dice = Dice::new(seed, STREAM + (attempt << 8));
    let wanted = if features.len() > 1 && dice.chance(TWO) { 2 } else { 1 };
    let mut taken: Vec<Wall> = Vec::new();
    for _ in 0..TRIES {
        let feature = dice.pick(features);
        form.add(&mut dice, feature, extents, &mut taken);
        if form.marks.len() == wanted {
            break;
        }
    }
    form
}

/// Rounded to centimetres, as the sizes of rooms are.
fn cm(v: f64) -> f64 {
    (v * 100.0).round() / 100.0
}

/// A stretch of a wall of so many metres, with wall left on both sides; side walls have it in their far part.
fn place(dice: &mut Dice, e: &Extents, wall: Wall, long: f64) -> Option<[f64; 2]> {
    let far = if wall == Wall::Back { e.width } else { e.depth * 0.75 } - BESIDE - long;
    (far > BESIDE).then(|| cm(dice.range(BESIDE, far))).map(|from| [from, from + long])
}

/// A feature in its place: the walls that it takes, and points a little before what is to be seen of it.
struct Made {
    walls: Vec<Wall>,
    marks: Vec<DVec3>,
}

impl Form {
    fn add(&mut self, dice: &mut Dice, feature: RoomFeature, e: &Extents, taken: &mut Vec<Wall>) {
        let mut next = self.clone();
        let made = match feature {
            RoomFeature::LShape => next.corner(dice, e),
            RoomFeature::ChimneyBreast => next.breast(dice, e),
            RoomFeature::Niche => next.niche(dice, e, false),
            RoomFeature::WindowRecess => next.niche(dice, e, true),
            RoomFeature::Slope => Some(next.slope(dice, e)),
            RoomFeature::Passage => next.passage(dice, e),
            RoomFeature::Tray => next.tray(dice, e),
        };
        let Some(made) = made.filter(|m| !m.walls.iter().any(|w| taken.contains(w)) && next.fits(e)) else { return };
        taken.extend(made.walls);
        next.marks.push(made.marks);
        *self = next;
    }

    /// Whether niches lie below all slopes, and blocks leave room beside each other.
    fn fits(&self, e: &Extents) -> bool {
        let below = |p: DVec3| self.shape.slopes.iter().all(|s| s.below(e, p) > 0.08);
        let niches = self.shape.niches.iter().all(|n| below(n.max.with_x(n.min.x)) && below(n.max.with_z(n.min.z)));
        let apart = |a: &Block, b: &Block| {
            let gap = (a.min - b.max).max(b.min - a.max);
            gap.x.max(gap.z) > BESIDE || a.kind == "lining" || b.kind == "lining"
        };
        let passages = self.passages.iter().all(|o| {
            let top = o.y[1] + 0.08;
            below(o.wall.point(e, o.u[0], top)) && below(o.wall.point(e, o.u[1], top))
        });
        let blocks = &self.shape.blocks;
        passages && niches && (0..blocks.len()).all(|i| (0..i).all(|j| apart(&blocks[i], &blocks[j])))
    }

    fn block(&mut self, e: &Extents, kind: &str, wall: Wall, u: [f64; 2], depth: f64) {
        let (a, b) = (wall.point(e, u[0], 0.0), wall.point(e, u[1], e.height) + wall.normal() * depth);
        self.shape.blocks.push(Block { kind: kind.into(), min: a.min(b), max: a.max(b) });
    }

    fn corner(&mut self, dice: &mut Dice, e: &Extents) -> Option<Made> {
        let side = dice.pick(&[Wall::Left, Wall::Right]);
        let (w, d) = (cm(e.width * dice.range(0.25, 0.45)), cm(e.depth * dice.range(0.22, 0.42)));
        let u = if side == Wall::Left { [0.0, w] } else { [e.width - w, e.width] };
        self.block(e, "corner", Wall::Back, u, d);
        let mut marks = grid(WallPlane { wall: Wall::Back, inset: d }, e, u, [0.0, e.height]);
        // The block's other face looks as the wall of its side does.
        marks.extend(grid(WallPlane { wall: side, inset: w }, e, [0.0, d], [0.0, e.height]));
        (e.width - w > NARROWEST).then_some(Made { walls: vec![Wall::Back, side], marks })
    }

    fn breast(&mut self, dice: &mut Dice, e: &Extents) -> Option<Made> {
        let wall = dice.pick(&[Wall::Back, Wall::Back, Wall::Left, Wall::Right]);
        let (w, d) = (cm(dice.range(0.9, 1.6)), cm(dice.range(0.22, 0.5)));
        let u = place(dice, e, wall, w)?;
        self.block(e, "chimney_breast", wall, u, d);
        Some(Made { walls: vec![wall], marks: grid(WallPlane { wall, inset: d }, e, u, [0.0, e.height]) })
    }

    fn niche(&mut self, dice: &mut Dice, e: &Extents, window: bool) -> Option<Made> {
        let wall = dice.pick(&[Wall::Back, Wall::Back, Wall::Left, Wall::Right]);
        let thick = cm(dice.range(0.18, 0.36));
        let (w, y) = if window {
            let top = (e.height - dice.range(0.2, 0.4)).min(2.3);
            (dice.range(1.1, 1.9), [dice.range(0.45, 0.85), top])
        } else {
            let sill = dice.range(0.5, 1.1);
            (dice.range(0.6, 1.3), [sill, (sill + dice.range(0.6, 1.2)).min(e.height - 0.2)])
        };
        let (u, y) = (place(dice, e, wall, cm(w))?, y.map(cm));
        self.block(e, "lining", wall, [0.0, wall.length(e)], thick);
        let (a, b) = (wall.point(e, u[0], y[0]), wall.point(e, u[1], y[1]) + wall.normal() * thick);
        let kind = if window { WINDOW_RECESS } else { "niche" };
        let (min, max) = (a.min(b), a.max(b));
        self.shape.niches.push(Niche { kind: kind.into(), surface: wall.surface(), sides: None, glow: None, min, max });
        Some(Made { walls: vec![wall], marks: grid(wall.into(), e, u, y) })
    }

    fn tray(&mut self, dice: &mut Dice, e: &Extents) -> Option<Made> {
        let (beside, deep) = (cm(dice.range(0.35, 0.7)), cm(dice.range(0.1, 0.25)));
        let (min, max) =
            (DVec3::new(beside, e.height, beside), DVec3::new(e.width - beside, e.height + deep, e.depth - beside));
        // One feature of the ceiling, and no block under it.
        let alone = self.shape.slopes.is_empty() && self.shape.blocks.iter().all(|b| b.kind == "lining");
        let niche = Niche { kind: "tray".into(), surface: Surface::Ceiling, sides: None, glow: None, min, max };
        self.shape.niches.push(niche);
        // Its lip at the back wall is what a photo shows best.
        let marks = (0..GRID).map(|k| {
            let share = (k as f64 + 0.5) / GRID as f64;
            DVec3::new(min.x + share * (max.x - min.x), min.y + 0.5 * deep, min.z + BEFORE)
        });
        (alone && (max - min).xz().min_element() > NARROWEST)
            .then(|| Made { walls: Vec::new(), marks: marks.collect() })
    }

    fn passage(&mut self, dice: &mut Dice, e: &Extents) -> Option<Made> {
        let wall = dice.pick(&[Wall::Back, Wall::Left, Wall::Right]);
        let (w, h) = (cm(dice.range(0.85, 1.6)), cm(dice.range(2.0, 2.25).min(e.height - 0.15)));
        let u = place(dice, e, wall, w)?;
        let rise = if dice.chance(0.5) { cm(w * dice.range(0.15, 0.5)) } else { 0.0 };
        let kind = OpeningKind::Door;
        self.passages.push(Opening { kind, wall, u, y: [0.0, h], inset: 0.0, rise, object: None });
        Some(Made { walls: vec![wall], marks: grid(wall.into(), e, u, [0.0, h - rise]) })
    }

    fn slope(&mut self, dice: &mut Dice, e: &Extents) -> Made {
        let side = dice.pick(&[Wall::Left, Wall::Right]);
        let (low, run) = (cm(dice.range(0.8, 1.6)), cm(dice.range(1.0, 2.0).min(e.width * 0.4)));
        let other = if side == Wall::Left { Wall::Right } else { Wall::Left };
        let walls = if dice.chance(0.25) { vec![side, other] } else { vec![side] };
        let mut marks = Vec::new();
        for wall in &walls {
            let slope = Slope { wall: *wall, low, run };
            self.shape.slopes.push(slope);
            let flat = grid((*wall).into(), e, [0.0, e.depth], [0.0, 1.0]);
            marks.extend(flat.into_iter().map(|p| {
                // The share of a height becomes the share of the run.
                let at = wall.point(e, wall.coordinates(p).x, low + (e.height - low) * p.y) + wall.normal() * run * p.y;
                at + slope.normal(e) * BEFORE
            }));
        }
        Made { walls, marks }
    }
}

/// Points spread over a rectangle of a plane, a little before it.
fn grid(plane: WallPlane, e: &Extents, u: [f64; 2], y: [f64; 2]) -> Vec<DVec3> {
    let share = |k: usize| (k as f64 + 0.5) / GRID as f64;
    let at = |range: [f64; 2], k: usize| range[0] + (range[1] - range[0]) * share(k);
    (0..GRID * GRID).map(|k| plane.point(e, at(u, k % GRID), at(y, k / GRID)) + plane.normal() * BEFORE).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn extents() -> Extents {
        Extents { width: 5.0, height: 2.6, depth: 4.4 }
    }

    #[test]
    fn names_are_read_back_and_others_refused() {
        for feature in RoomFeature::ALL {
            assert_eq!(RoomFeature::list(feature.name()), Ok(vec![feature]));
        }
        assert_eq!(RoomFeature::list("box"), Ok(vec![]));
        assert_eq!(RoomFeature::list("mixed").unwrap().len(), RoomFeature::ALL.len());
        assert!(RoomFeature::list("lshape,round").unwrap_err().contains("round"));
    }

    #[test]
    fn every_feature_is_made_and_its_marks_lie_in_the_free_space_just_before_a_face() {
        for feature in RoomFeature::ALL {
            let made: Vec<Form> = (0..30).map(|seed| draw(seed, 0, &[feature], &extents())).collect();
            let with: Vec<&Form> = made.iter().filter(|f| !f.marks.is_empty()).collect();
            assert!(with.len() > 25, "{feature:?}: {} of 30", with.len());
            for form in with {
                let room = room_of(extents(), form.shape.clone());
                assert_eq!(form.shape.is_box(), feature == RoomFeature::Passage);
                for mark in form.marks.iter().flatten() {
                    assert!(room.is_free(*mark), "{feature:?} {mark}");
                    let near = room.all_faces().iter().any(|f| {
                        let solid = *mark - f.normal * 2.0 * BEFORE;
                        (*mark - f.polygon[0]).dot(f.normal).abs() < 1.5 * BEFORE && !room.is_free(solid)
                    });
                    assert!(near, "{feature:?} {mark}");
                }
            }
        }
    }

    #[test]
    fn a_box_and_a_mixed_room_come_from_the_same_seed() {
        assert!(draw(5, 0, &[], &extents()).shape.is_box());
        let two = (0..60).filter(|s| draw(*s, 0, &RoomFeature::ALL, &extents()).marks.len() == 2).count();
        assert!((8..=40).contains(&two), "{two} of 60 have two features");
        for seed in 0..60 {
            let form = draw(seed, 0, &RoomFeature::ALL, &extents());
            assert_eq!(form.shape, draw(seed, 0, &RoomFeature::ALL, &extents()).shape);
            // Features do not meet: what is free is the box less the blocks, with the niches, below the slopes.
            let room = room_of(extents(), form.shape.clone());
            for niche in &form.shape.niches {
                assert!(room.is_free((niche.min + niche.max) / 2.0));
            }
        }
    }
}
