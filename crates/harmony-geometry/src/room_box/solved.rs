//! The numbers of a room box around a camera.
//!
//! A camera's angles and focal length and its distances to five faces: the unknowns of the least squares as a value,
//! and what follows from them (camera matrix, extents, images of edges). Radians, metres, pixels relative to the
//! principal point. The front wall, which the camera has behind it, is not among them: its place is a choice of who
//! asks for the extents.

use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, Mat3, Surface, Vec2, Vec3};

use crate::{RoomEdge, camera_rotation};

/// Least distance of the front wall behind the camera, metres.
const FRONT_MARGIN: f64 = 0.3;
/// Pixels across at which "what the image shows" is sampled.
const SAMPLES: u32 = 48;
/// Share of the image from which a face counts as shown.
const SHOWN_SHARE: f64 = 0.01;

/// A camera and the distances from it to five faces of the room, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CameraBox {
    pub focal: f64,
    pub yaw: f64,
    pub tilt: f64,
    pub roll: f64,
    pub left: f64,
    pub right: f64,
    pub floor: f64,
    pub ceiling: f64,
    pub back: f64,
    /// How far the principal point lies below the middle of the image, pixels: not 0 where a photo was cropped or its
    /// verticals were straightened by shifting the lens.
    pub shift: f64,
}

impl CameraBox {
    pub fn rotation(&self) -> Mat3 {
        camera_rotation(self.yaw, self.tilt, self.roll)
    }

    pub fn extents(&self, least_depth: f64) -> Extents {
        Extents {
            width: self.left + self.right,
            height: self.floor + self.ceiling,
            depth: least_depth.max(self.back + FRONT_MARGIN),
        }
    }

    pub fn camera(&self, size: ImageSize) -> Camera {
        let rotation = self.rotation();
        let centre = Vec3::new(self.left, self.floor, self.back);
        let centred = Intrinsics::centred(size, self.focal);
        let intrinsics = Intrinsics { cy: centred.cy + self.shift, ..centred };
        Camera { size, intrinsics, rotation, translation: -(rotation * centre) }
    }

    /// A point and the direction of an edge, from the camera centre, room axes.
    pub fn edge(&self, edge: RoomEdge) -> (Vec3, Vec3) {
        let (l, r, f, c, b) = (-self.left, self.right, -self.floor, self.ceiling, -self.back);
        match edge {
            RoomEdge::FloorBack => (Vec3::new(0.0, f, b), Vec3::X),
            RoomEdge::FloorLeft => (Vec3::new(l, f, 0.0), Vec3::Z),
            RoomEdge::FloorRight => (Vec3::new(r, f, 0.0), Vec3::Z),
            RoomEdge::CeilingBack => (Vec3::new(0.0, c, b), Vec3::X),
            RoomEdge::CeilingLeft => (Vec3::new(l, c, 0.0), Vec3::Z),
            RoomEdge::CeilingRight => (Vec3::new(r, c, 0.0), Vec3::Z),
            RoomEdge::BackLeft => (Vec3::new(l, 0.0, b), Vec3::Y),
            RoomEdge::BackRight => (Vec3::new(r, 0.0, b), Vec3::Y),
        }
    }

    /// Signed distance, pixels, of a point (relative to the principal point) to the image of an edge's line.
    ///
    /// It stays smooth when the edge passes behind the camera.
    pub fn distance_to_edge(&self, rotation: &Mat3, edge: RoomEdge, point: Vec2) -> f64 {
        let (p, d) = self.edge(edge);
        let normal = (*rotation * p).cross(*rotation * d);
        let across = normal.x.hypot(normal.y).max(1e-12);
        normal.dot(point.extend(self.focal)) / across
    }
}

/// Faces that fill at least one percent of the image.
pub(crate) fn faces_shown(camera: &Camera, extents: &Extents) -> Vec<Surface> {
    let size = camera.size.fit_within(SAMPLES);
    let camera = camera.resized(size);
    let mut counts = [0usize; 6];
    for y in 0..size.height {
        for x in 0..size.width {
            let ray = camera.ray(Vec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            if let Some((face, _)) = extents.exit(&ray) {
                let i = Surface::ALL.iter().position(|s| *s == face).unwrap_or(0);
                counts[i] += 1;
            }
        }
    }
    let least = SHOWN_SHARE * size.pixels() as f64;
    Surface::ALL.into_iter().zip(counts).filter(|(_, n)| *n as f64 >= least).map(|(s, _)| s).collect()
}

/// The deepest floor corner in the image, or else the deepest one in front of the camera; with its pixel.
pub(crate) fn anchor(camera: &Camera, extents: &Extents) -> (Vec3, Option<Vec2>) {
    let (w, d) = (extents.width, extents.depth);
    [Vec3::ZERO, Vec3::new(w, 0.0, 0.0), Vec3::new(0.0, 0.0, d), Vec3::new(w, 0.0, d)]
        .into_iter()
        .map(|corner| (corner, camera.project(corner)))
        .max_by(|a, b| {
            let shown = |p: &Option<Vec2>| p.is_some_and(|p| camera.contains(p));
            shown(&a.1).cmp(&shown(&b.1)).then(camera.depth(a.0).total_cmp(&camera.depth(b.0)))
        })
        .unwrap_or((Vec3::ZERO, None))
}
