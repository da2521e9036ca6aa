//! One room in the frames of photos that face different walls.

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::{Camera, Extents, Surface, Wall};

/// A number of quarter turns about +Y, counter-clockwise seen from above, that carries a room's frame into that of the same
/// room with another wall as its back; the origin goes to the new back-left floor corner.
///
/// Points, cameras and spans along walls need the extents of the room in the frame they come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
pub struct QuarterTurn(u8);

impl TryFrom<u8> for QuarterTurn {
    type Error = String;

    fn try_from(quarters: u8) -> Result<Self, String> {
        (quarters < 4).then_some(Self(quarters)).ok_or_else(|| format!("{quarters} quarter turns: 0 to 3 are there"))
    }
}

impl From<QuarterTurn> for u8 {
    fn from(turn: QuarterTurn) -> Self {
        turn.0
    }
}

/// Walls in the order in which a quarter turn carries each to the next one's place.
const ROUND: [Wall; 4] = [Wall::Back, Wall::Left, Wall::Front, Wall::Right];

fn place(wall: Wall) -> u8 {
    ROUND.iter().position(|w| *w == wall).map_or(0, |i| i as u8)
}

impl QuarterTurn {
    /// All four, none first.
    pub const ALL: [Self; 4] = [Self(0), Self(1), Self(2), Self(3)];

    /// The one that gives a wall another one's name.
    pub fn bringing(wall: Wall, to: Wall) -> Self {
        Self((4 + place(to) - place(wall)) % 4)
    }

    /// How many quarters, 0 to 3.
    pub fn quarters(self) -> u8 {
        self.0
    }

    /// The way back.
    #[must_use]
    pub fn inverse(self) -> Self {
        Self((4 - self.0) % 4)
    }

    /// Its angle about +Y, radians.
    pub fn angle(self) -> f64 {
        f64::from(self.0) * std::f64::consts::FRAC_PI_2
    }

    /// Its rotation, of exact zeros and ones.
    pub fn rotation(self) -> DMat3 {
        let (s, c) = [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][usize::from(self.0)];
        DMat3::from_cols(DVec3::new(c, 0.0, -s), DVec3::Y, DVec3::new(s, 0.0, c))
    }

    /// The room's size in the turned frame.
    pub fn extents(self, from: &Extents) -> Extents {
        if self.0.is_multiple_of(2) { *from } else { Extents { width: from.depth, depth: from.width, ..*from } }
    }

    /// Where the old origin is in the turned frame.
    pub fn origin(self, from: &Extents) -> DVec3 {
        match self.0 {
            0 => DVec3::ZERO,
            1 => DVec3::new(0.0, 0.0, from.width),
            2 => DVec3::new(from.width, 0.0, from.depth),
            _ => DVec3::new(from.depth, 0.0, 0.0),
        }
    }

    /// A point in the turned frame.
    pub fn point(self, from: &Extents, point: DVec3) -> DVec3 {
        self.rotation() * point + self.origin(from)
    }

    /// A yaw in the turned frame, radians.
    pub fn yaw(self, yaw: f64) -> f64 {
        yaw + self.angle()
    }

    /// The name of a wall in the turned frame.
    pub fn wall(self, wall: Wall) -> Wall {
        ROUND[usize::from((place(wall) + self.0) % 4)]
    }

    /// The name of a face in the turned frame.
    pub fn surface(self, surface: Surface) -> Surface {
        surface.wall().map_or(surface, |wall| self.wall(wall).surface())
    }

    /// A range along a wall as a range along the same wall under its name in the turned frame.
    pub fn span(self, from: &Extents, wall: Wall, u: [f64; 2]) -> [f64; 2] {
        let [a, b] = u.map(|u| self.wall(wall).coordinates(self.point(from, wall.point(from, u, 0.0))).x);
        [a.min(b), a.max(b)]
    }

    /// A camera in the turned frame: its picture stays.
    #[must_use]
    pub fn camera(self, from: &Extents, camera: &Camera) -> Camera {
        let rotation = camera.rotation * self.rotation().transpose();
        Camera { rotation, translation: camera.translation - rotation * self.origin(from), ..*camera }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ImageSize, Intrinsics};

    const ROOM: Extents = Extents { width: 3.0, height: 2.5, depth: 5.0 };

    #[test]
    fn walls_go_where_their_points_go() {
        for turn in QuarterTurn::ALL {
            let turned = turn.extents(&ROOM);
            for wall in Wall::ALL {
                let point = turn.point(&ROOM, wall.point(&ROOM, 1.0, 0.7));
                assert!(turn.wall(wall).distance(&turned, point).abs() < 1e-12, "{turn:?} {wall:?}");
                assert!(turned.contains(point, 1e-12));
                let normal = turn.rotation() * wall.normal();
                assert!((normal - turn.wall(wall).normal()).length() < 1e-12);
                let yaw = turn.yaw(wall.yaw()) - turn.wall(wall).yaw();
                assert!(yaw.sin().abs() < 1e-12 && yaw.cos() > 0.0);
            }
            assert_eq!(QuarterTurn::bringing(turn.inverse().wall(Wall::Back), Wall::Back), turn);
        }
    }

    #[test]
    fn the_inverse_leads_back_and_pictures_stay() {
        let size = ImageSize::new(640, 480);
        let lens = Intrinsics::from_horizontal_fov(size, 1.2);
        let camera = Camera::looking(size, lens, DVec3::new(1.0, 1.5, 4.5), DVec3::new(0.2, -0.2, -1.0));
        let point = DVec3::new(0.6, 0.4, 1.1);
        for turn in QuarterTurn::ALL {
            let turned = turn.point(&ROOM, point);
            let back = turn.inverse().point(&turn.extents(&ROOM), turned);
            assert!((back - point).length() < 1e-12);
            let pixel = turn.camera(&ROOM, &camera).project(turned).unwrap();
            assert!((pixel - camera.project(point).unwrap()).length() < 1e-9);
        }
    }

    #[test]
    fn a_span_keeps_its_length_and_its_order() {
        for turn in QuarterTurn::ALL {
            for wall in Wall::ALL {
                let [a, b] = turn.span(&ROOM, wall, [0.5, 1.7]);
                assert!((b - a - 1.2).abs() < 1e-12 && a >= 0.0);
                assert!(b <= turn.wall(wall).length(&turn.extents(&ROOM)));
            }
        }
    }
}
