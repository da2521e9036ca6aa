//! The scene as far as it is built.

use std::sync::Arc;

use harmony_scene::{
    Camera, Confidence, ImageSize, Level, Mask, ObjectId, PointMap, PointMapKind, Pose, Room, Similarity, Size,
    Support, Vec3,
};

use crate::{Evidence, Item};

/// The point map in the room frame.
#[derive(Debug, Clone)]
pub struct RoomPoints {
    /// What the points mean.
    pub kind: PointMapKind,
    /// Grid size; covers the whole image, at any resolution.
    pub size: ImageSize,
    /// Room positions, metres; NaN where there is none.
    pub xyz: Vec<Vec3>,
    /// Confidence, 0 = none.
    pub confidence: Vec<f32>,
}

impl RoomPoints {
    /// Carries a point map into the room.
    pub fn new(map: &PointMap, room_from_points: &Similarity) -> Self {
        let xyz = map
            .xyz
            .iter()
            .map(|p| if p.is_finite() { room_from_points.point(p.as_dvec3()) } else { Vec3::NAN })
            .collect();
        Self { kind: map.kind, size: map.size, xyz, confidence: map.confidence.clone() }
    }

    /// Whether objects have depths of their own.
    pub fn is_dense(&self) -> bool {
        !matches!(self.kind, PointMapKind::RoomBox)
    }
}

/// An object with its pose.
#[derive(Debug, Clone)]
pub struct Placed {
    /// The object.
    pub item: Arc<Item>,
    /// Pose of its canonical mesh.
    pub pose: Pose,
    /// What carries it.
    pub support: Support,
    /// What speaks for the pose.
    pub evidence: Evidence,
}

impl Placed {
    /// Size in the room before rotation, metres.
    pub fn size(&self) -> Size {
        Size::from_vec(self.item.shape.bounds().size() * self.pose.scale * self.pose.stretch)
    }

    /// Confidence from the evidence.
    pub fn confidence(&self) -> Confidence {
        self.evidence.confidence(self.item.detection)
    }
}

/// Room, camera, point map, and the objects placed so far.
#[derive(Debug, Clone)]
pub struct PartialScene {
    /// The room.
    pub room: Room,
    /// The photo's camera at working resolution; masks have its size.
    pub camera: Camera,
    /// The point map, if there is one.
    pub points: Option<RoomPoints>,
    /// Deepest floor corner, the anchor of the traversal (room frame).
    pub anchor: Vec3,
    /// Objects in placement order.
    pub placed: Vec<Placed>,
    /// Masks of objects of later levels, as far as they are known already: they may hide what is placed now.
    pub upcoming: Vec<Upcoming>,
}

/// An object that is seen but belongs to a later level.
#[derive(Debug, Clone)]
pub struct Upcoming {
    /// Its id.
    pub id: ObjectId,
    /// Its level.
    pub level: Level,
    /// Where it is seen.
    pub mask: Mask,
    /// Whether it lies flat (a rug): such things hide nothing.
    pub flat: bool,
}

impl PartialScene {
    /// An empty room. `anchor` is the deepest floor corner; without one, the corner farthest along the view is taken.
    pub fn new(room: Room, camera: Camera, points: Option<RoomPoints>, anchor: Option<Vec3>) -> Self {
        let e = room.extents;
        let deepest = [Vec3::ZERO, Vec3::new(e.width, 0.0, 0.0)]
            .into_iter()
            .max_by(|a, b| camera.depth(*a).total_cmp(&camera.depth(*b)))
            .unwrap_or(Vec3::ZERO);
        Self { room, camera, points, anchor: anchor.unwrap_or(deepest), placed: Vec::new(), upcoming: Vec::new() }
    }

    /// The placed object with this id.
    pub fn find(&self, id: &ObjectId) -> Option<&Placed> {
        self.placed.iter().find(|p| p.item.id == *id)
    }

    /// Its position in [`PartialScene::placed`].
    pub fn position(&self, id: &ObjectId) -> Option<usize> {
        self.placed.iter().position(|p| p.item.id == *id)
    }
}
