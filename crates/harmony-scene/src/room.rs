//! The room: a box, what makes it other than a box ([`RoomShape`]), openings and surface textures.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{ObjectId, Ray, RoomShape};

/// Width (x), height (y) and depth (z) of the room, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Extents {
    /// Along x.
    pub width: f64,
    /// Along y.
    pub height: f64,
    /// Along z.
    pub depth: f64,
}

/// A wall of the room box, named as seen by the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Wall {
    /// z = 0, the one the camera faces.
    Back,
    /// x = 0.
    Left,
    /// x = W.
    Right,
    /// z = D, behind the camera.
    Front,
}

/// One of the six faces of the room box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Surface {
    /// y = 0.
    Floor,
    /// y = H.
    Ceiling,
    /// z = 0.
    Back,
    /// x = 0.
    Left,
    /// x = W.
    Right,
    /// z = D.
    Front,
}

impl Wall {
    /// All four, in the order back, left, right, front.
    pub const ALL: [Self; 4] = [Self::Back, Self::Left, Self::Right, Self::Front];

    /// Unit normal into the room.
    pub fn normal(self) -> DVec3 {
        match self {
            Self::Back => DVec3::Z,
            Self::Left => DVec3::X,
            Self::Right => DVec3::NEG_X,
            Self::Front => DVec3::NEG_Z,
        }
    }

    /// The wall across the room.
    #[must_use]
    pub fn opposite(self) -> Self {
        match self {
            Self::Back => Self::Front,
            Self::Left => Self::Right,
            Self::Right => Self::Left,
            Self::Front => Self::Back,
        }
    }

    /// Whether its u grows to the right, as one faces it from inside: of the right wall to the viewer, of the left one not.
    pub fn runs_to_the_right(self) -> bool {
        match self {
            Self::Back | Self::Right => true,
            Self::Left | Self::Front => false,
        }
    }

    /// Yaw of an object whose back is on this wall and whose front faces the room.
    pub fn yaw(self) -> f64 {
        use std::f64::consts::{FRAC_PI_2, PI};
        match self {
            Self::Back => 0.0,
            Self::Left => FRAC_PI_2,
            Self::Right => -FRAC_PI_2,
            Self::Front => PI,
        }
    }

    /// The wall as a face of the box.
    pub fn surface(self) -> Surface {
        match self {
            Self::Back => Surface::Back,
            Self::Left => Surface::Left,
            Self::Right => Surface::Right,
            Self::Front => Surface::Front,
        }
    }

    /// Signed distance of a point to the wall, positive inside the room.
    pub fn distance(self, extents: &Extents, point: DVec3) -> f64 {
        match self {
            Self::Back => point.z,
            Self::Left => point.x,
            Self::Right => extents.width - point.x,
            Self::Front => extents.depth - point.z,
        }
    }

    /// Horizontal length of the wall.
    pub fn length(self, extents: &Extents) -> f64 {
        match self {
            Self::Back | Self::Front => extents.width,
            Self::Left | Self::Right => extents.depth,
        }
    }

    /// The wall point with coordinates `(u, y)`: u along x on back and front, along z on left and right.
    pub fn point(self, extents: &Extents, u: f64, y: f64) -> DVec3 {
        match self {
            Self::Back => DVec3::new(u, y, 0.0),
            Self::Left => DVec3::new(0.0, y, u),
            Self::Right => DVec3::new(extents.width, y, u),
            Self::Front => DVec3::new(u, y, extents.depth),
        }
    }

    /// `(u, y)` of a room point dropped onto the wall; see [`Wall::point`].
    pub fn coordinates(self, point: DVec3) -> DVec2 {
        match self {
            Self::Back | Self::Front => DVec2::new(point.x, point.y),
            Self::Left | Self::Right => DVec2::new(point.z, point.y),
        }
    }
}

impl Surface {
    /// All six.
    pub const ALL: [Self; 6] = [Self::Floor, Self::Ceiling, Self::Back, Self::Left, Self::Right, Self::Front];

    /// Name as in file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Floor => "floor",
            Self::Ceiling => "ceiling",
            Self::Back => "back",
            Self::Left => "left",
            Self::Right => "right",
            Self::Front => "front",
        }
    }

    /// The wall, when the surface is one.
    pub fn wall(self) -> Option<Wall> {
        match self {
            Self::Back => Some(Wall::Back),
            Self::Left => Some(Wall::Left),
            Self::Right => Some(Wall::Right),
            Self::Front => Some(Wall::Front),
            Self::Floor | Self::Ceiling => None,
        }
    }

    /// Unit normal into the room.
    pub fn normal(self) -> DVec3 {
        match self {
            Self::Floor => DVec3::Y,
            Self::Ceiling => DVec3::NEG_Y,
            Self::Back => DVec3::Z,
            Self::Left => DVec3::X,
            Self::Right => DVec3::NEG_X,
            Self::Front => DVec3::NEG_Z,
        }
    }

    /// Extent of the face in its own `(u, v)`: walls (length, height); floor and ceiling (W, D) with v along +z.
    pub fn size(self, e: &Extents) -> DVec2 {
        match self {
            Self::Floor | Self::Ceiling => DVec2::new(e.width, e.depth),
            Self::Back | Self::Front => DVec2::new(e.width, e.height),
            Self::Left | Self::Right => DVec2::new(e.depth, e.height),
        }
    }

    /// The room point of face coordinates: walls `(u, y)` as [`Wall::point`], floor and ceiling `(x, z)`.
    pub fn point(self, e: &Extents, uv: DVec2) -> DVec3 {
        match self {
            Self::Floor => DVec3::new(uv.x, 0.0, uv.y),
            Self::Ceiling => DVec3::new(uv.x, e.height, uv.y),
            Self::Back => Wall::Back.point(e, uv.x, uv.y),
            Self::Left => Wall::Left.point(e, uv.x, uv.y),
            Self::Right => Wall::Right.point(e, uv.x, uv.y),
            Self::Front => Wall::Front.point(e, uv.x, uv.y),
        }
    }

    /// Face coordinates of a room point dropped onto the face.
    pub fn coordinates(self, point: DVec3) -> DVec2 {
        match self.wall() {
            Some(wall) => wall.coordinates(point),
            None => DVec2::new(point.x, point.z),
        }
    }
}

impl Extents {
    /// Whether a point lies inside, with `slack` metres outside still accepted.
    pub fn contains(&self, p: DVec3, slack: f64) -> bool {
        p.cmpge(DVec3::splat(-slack)).all() && p.cmple(self.as_vec() + slack).all()
    }

    /// `(W, H, D)`.
    pub fn as_vec(&self) -> DVec3 {
        DVec3::new(self.width, self.height, self.depth)
    }

    /// Where a ray that starts inside leaves the box, and through which face.
    pub fn exit(&self, ray: &Ray) -> Option<(Surface, DVec3)> {
        let size = self.as_vec();
        let mut best: Option<(f64, Surface)> = None;
        for (axis, low, high) in [
            (0, Surface::Left, Surface::Right),
            (1, Surface::Floor, Surface::Ceiling),
            (2, Surface::Back, Surface::Front),
        ] {
            let d = ray.direction[axis];
            if d.abs() < 1e-12 {
                continue;
            }
            let (target, face) = if d < 0.0 { (0.0, low) } else { (size[axis], high) };
            let k = (target - ray.origin[axis]) / d;
            if k >= 0.0 && best.is_none_or(|(b, _)| k < b) {
                best = Some((k, face));
            }
        }
        best.map(|(k, face)| (face, ray.at(k)))
    }
}

/// What an opening is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OpeningKind {
    /// Glazed, usually above the floor.
    Window,
    /// A door leaf, or a passage without one.
    Door,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// A hole in a wall: a rectangle, perhaps with a rounded top. A door without an object is a passage: open, without a
/// leaf.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Opening {
    /// What it is.
    pub kind: OpeningKind,
    /// Which wall it is in.
    pub wall: Wall,
    /// Range along the wall, metres (x on back and front, z on left and right).
    pub u: [f64; 2],
    /// Range of height, metres.
    pub y: [f64; 2],
    /// How far before the wall the plane is that it is cut into, metres: on a block's face; negative in a niche.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub inset: f64,
    /// How far its top is rounded, metres: height of the middle over the ends of the arch; 0 is straight, half the width
    /// a half circle.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub rise: f64,
    /// The window or door object that fills it.
    pub object: Option<ObjectId>,
}

/// Chords that an arch is drawn with.
const ARCH_CHORDS: usize = 16;

impl Opening {
    /// Whether it is open, without a leaf or pane.
    pub fn is_passage(&self) -> bool {
        self.kind == OpeningKind::Door && self.object.is_none()
    }

    /// How far the top is rounded: not more than a half circle, nor than the opening is high; 0 when straight.
    pub fn rounded(&self) -> f64 {
        let most = ((self.u[1] - self.u[0]) / 2.0).min(self.y[1] - self.y[0]);
        if self.rise > ROUNDED && most > ROUNDED { self.rise.min(most) } else { 0.0 }
    }

    /// Points `(u, y)` along the top from its low-u end to the other: an arc of a circle, or the two corners.
    pub fn top(&self) -> Vec<DVec2> {
        let ([a, b], [_, high], rise) = (self.u, self.y, self.rounded());
        if rise <= 0.0 {
            return vec![DVec2::new(a, high), DVec2::new(b, high)];
        }
        let (middle, half) = (f64::midpoint(a, b), (b - a) / 2.0);
        let radius = (half * half + rise * rise) / (2.0 * rise);
        let (centre, turn) = (high - radius, (half / radius).clamp(-1.0, 1.0).asin());
        (0..=ARCH_CHORDS)
            .map(|k| {
                let angle = turn * (2.0 * k as f64 / ARCH_CHORDS as f64 - 1.0);
                DVec2::new(middle + radius * angle.sin(), centre + radius * angle.cos())
            })
            .collect()
    }

    /// Its outline `(u, y)`: along the bottom, up, and back along the top.
    pub fn outline(&self) -> Vec<DVec2> {
        let bottom = [DVec2::new(self.u[0], self.y[0]), DVec2::new(self.u[1], self.y[0])];
        bottom.into_iter().chain(self.top().into_iter().rev()).collect()
    }
}

/// Tops rounded by less than this are straight, metres.
const ROUNDED: f64 = 0.01;

/// What a room surface is made of (layout answer, STEP 4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SurfaceTexture {
    /// Material in words.
    pub material: String,
    /// Colour in words.
    pub color: String,
    /// Pattern or finish in words.
    pub pattern: String,
    /// Physical size of one tile of the texture, metres.
    pub tile_size_m: f64,
}

/// The room.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Room {
    /// `bedroom`, `living_room`, ... in the model's words, lower case.
    pub room_type: String,
    /// Size of the box, metres.
    pub extents: Extents,
    /// What makes it other than that box.
    #[serde(default, skip_serializing_if = "RoomShape::is_box")]
    pub shape: RoomShape,
    /// Faces that the photo shows, so that were measured; the others come from prior knowledge.
    pub seen: Vec<Surface>,
    /// Holes in the walls.
    pub openings: Vec<Opening>,
    /// Floor material.
    pub floor_texture: Option<SurfaceTexture>,
    /// Wall material.
    pub wall_texture: Option<SurfaceTexture>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_runs_to_the_right_of_who_faces_it_or_to_the_left() {
        let e = Extents { width: 4.0, height: 2.5, depth: 5.0 };
        for wall in Wall::ALL {
            let along = wall.point(&e, 1.0, 0.0) - wall.point(&e, 0.0, 0.0);
            let to_the_right = -wall.normal().cross(DVec3::Y);
            assert_eq!(along.dot(to_the_right) > 0.0, wall.runs_to_the_right(), "{wall:?}");
        }
    }

    #[test]
    fn walls_and_faces_agree_on_coordinates_and_normals() {
        let e = Extents { width: 4.0, height: 2.5, depth: 5.0 };
        for face in Surface::ALL {
            let uv = face.size(&e) * 0.25;
            let p = face.point(&e, uv);
            assert!(e.contains(p, 1e-9));
            assert!((face.coordinates(p) - uv).length() <= 1e-12);
            let centre = e.as_vec() / 2.0;
            assert!((centre - p).dot(face.normal()) > 0.0, "{face:?} normal points into the room");
            let ray = Ray { origin: centre, direction: (p - centre).normalize() };
            let (hit, at) = e.exit(&ray).unwrap();
            assert_eq!(hit, face);
            assert!((at - p).length() <= 1e-9);
        }
        for wall in Wall::ALL {
            let front = DVec3::new(wall.yaw().sin(), 0.0, wall.yaw().cos());
            assert!((front - wall.normal()).length() <= 1e-12, "{wall:?} yaw faces the room");
        }
    }
}
