//! Where a room is in the home: a quarter turn, and what joint refinement adds to it.
//!
//! # Frames
//! The **home frame** is a room frame for all rooms together: metres, +Y up, floor at y = 0; x and z are those of the
//! layout, seen from above with x to the right and z down the page. Its sides have the names of a room's walls: `back` is
//! towards -Z, `left` towards -X.

use glam::{DMat3, DVec2, DVec3};
use harmony_scene::{Extents, QuarterTurn, Wall};
use serde::{Deserialize, Serialize};

/// Width and depth of a turned room as the home has them.
pub fn sides(turn: QuarterTurn, extents: &Extents) -> DVec2 {
    let turned = turn.extents(extents);
    DVec2::new(turned.width, turned.depth)
}

/// A rectangle of the floor, home x and z, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rect {
    /// Smallest x and z.
    pub min: DVec2,
    /// Largest x and z.
    pub max: DVec2,
}

impl Rect {
    /// Lengths along x and z.
    pub fn size(&self) -> DVec2 {
        self.max - self.min
    }

    /// Its middle.
    pub fn centre(&self) -> DVec2 {
        (self.min + self.max) / 2.0
    }

    /// Its area, square metres.
    pub fn area(&self) -> f64 {
        self.size().max(DVec2::ZERO).element_product()
    }

    /// What two have in common; `None` without an area.
    pub fn meet(&self, other: &Self) -> Option<Self> {
        let met = Self { min: self.min.max(other.min), max: self.max.min(other.max) };
        (met.size().min_element() > 0.0).then_some(met)
    }

    /// The smallest one around both.
    #[must_use]
    pub fn around(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Grown on all sides, metres.
    #[must_use]
    pub fn grown(&self, by: f64) -> Self {
        Self { min: self.min - by, max: self.max + by }
    }

    /// Whether a point is in it, with `slack` metres outside still accepted.
    pub fn contains(&self, p: DVec2, slack: f64) -> bool {
        p.cmpge(self.min - slack).all() && p.cmple(self.max + slack).all()
    }

    /// Where one of its sides is: x of left and right, z of back and front.
    pub fn side(&self, side: Wall) -> f64 {
        match side {
            Wall::Left => self.min.x,
            Wall::Right => self.max.x,
            Wall::Back => self.min.y,
            Wall::Front => self.max.y,
        }
    }

    /// The range of one of its sides along the side: x of back and front, z of left and right.
    pub fn along(&self, side: Wall) -> [f64; 2] {
        match side {
            Wall::Left | Wall::Right => [self.min.y, self.max.y],
            Wall::Back | Wall::Front => [self.min.x, self.max.x],
        }
    }

    /// Moves one side to a place.
    pub fn set_side(&mut self, side: Wall, at: f64) {
        match side {
            Wall::Left => self.min.x = at,
            Wall::Right => self.max.x = at,
            Wall::Back => self.min.y = at,
            Wall::Front => self.max.y = at,
        }
    }
}

/// A place along a side of a room in the home as the room itself has it: its wall, and u along that.
///
/// `rect` are the room's walls, `at` is x of back and front and z of left and right, home frame.
pub fn in_room(rect: &Rect, turn: QuarterTurn, side: Wall, at: f64) -> (Wall, f64) {
    let wall = turn.inverse().wall(side);
    let along = |w: Wall| if matches!(w, Wall::Back | Wall::Front) { DVec3::X } else { DVec3::Z };
    let same = (turn.rotation() * along(wall)).dot(along(side)) > 0.0;
    let [low, high] = rect.along(side);
    (wall, if same { at - low } else { high - at })
}

/// The place of a photographed room, `home_from_room`:
/// `home = (x, floor, z) + Ry(turn + yaw) * scale * (room - (W/2, 0, D/2))`.
///
/// A similarity of room, objects and camera together: whatever its values, the photo stays as it is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// Quarter turns.
    pub turn: QuarterTurn,
    /// What the photo's axes were off, radians.
    pub yaw: f64,
    /// Home metres per metre of the run.
    pub scale: f64,
    /// Where the middle of the run's floor is, home x and z.
    pub at: DVec2,
    /// Height of its floor, metres.
    pub floor: f64,
}

impl Place {
    /// Linear part without the scale.
    pub fn rotation(&self) -> DMat3 {
        DMat3::from_rotation_y(self.turn.angle() + self.yaw)
    }

    /// A point of the run in the home.
    pub fn point(&self, extents: &Extents, room: DVec3) -> DVec3 {
        let middle = DVec3::new(extents.width / 2.0, 0.0, extents.depth / 2.0);
        DVec3::new(self.at.x, self.floor, self.at.y) + self.rotation() * (room - middle) * self.scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_agree_with_rotations_and_walls_with_their_normals() {
        for turn in QuarterTurn::ALL {
            let v = DVec3::new(0.3, 1.0, -2.0);
            assert!((turn.rotation() * v - DMat3::from_rotation_y(turn.angle()) * v).length() < 1e-12);
            for wall in Wall::ALL {
                assert_eq!(turn.rotation() * wall.normal(), turn.wall(wall).normal());
                assert_eq!(turn.inverse().wall(turn.wall(wall)), wall);
                assert_eq!(QuarterTurn::bringing(wall, turn.wall(wall)), turn);
                assert_eq!(wall.opposite().normal(), -wall.normal());
            }
        }
    }

    #[test]
    fn places_along_walls_are_the_same_in_room_and_home() {
        let rect = Rect { min: DVec2::new(1.0, 2.0), max: DVec2::new(4.0, 7.0) };
        for turn in QuarterTurn::ALL {
            let size = sides(turn, &Extents { width: 3.0, height: 2.5, depth: 5.0 });
            let extents = Extents { width: size.x, height: 2.5, depth: size.y };
            let place = Place { turn, yaw: 0.0, scale: 1.0, at: rect.centre(), floor: 0.0 };
            for side in Wall::ALL {
                let [low, high] = rect.along(side);
                let at = low + 0.3 * (high - low);
                let (wall, u) = in_room(&rect, turn, side, at);
                let home = place.point(&extents, wall.point(&extents, u, 0.0));
                let along = if matches!(side, Wall::Left | Wall::Right) { home.z } else { home.x };
                let beyond = if matches!(side, Wall::Left | Wall::Right) { home.x } else { home.z };
                assert!((along - at).abs() < 1e-9 && (beyond - rect.side(side)).abs() < 1e-9, "{turn:?} {side:?}");
            }
        }
    }

    #[test]
    fn sides_of_a_rectangle_are_where_walls_of_those_names_are() {
        let mut rect = Rect { min: DVec2::new(1.0, 2.0), max: DVec2::new(4.0, 7.0) };
        assert_eq!(Wall::ALL.map(|w| rect.side(w)), [2.0, 1.0, 4.0, 7.0]);
        assert_eq!(rect.along(Wall::Left), [2.0, 7.0]);
        rect.set_side(Wall::Front, 8.0);
        assert_eq!(rect.size(), DVec2::new(3.0, 6.0));
        let other = Rect { min: DVec2::new(3.5, 0.0), max: DVec2::new(9.0, 3.0) };
        assert_eq!(rect.meet(&other).map(|r| r.area()), Some(0.5));
        assert_eq!(rect.meet(&Rect { min: DVec2::new(4.0, 0.0), max: DVec2::new(9.0, 3.0) }), None);
    }
}
