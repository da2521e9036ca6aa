//! One level, from items to placed objects.

use harmony_scene::{ObjectId, Warning};

use crate::{Evidence, Item, OrderReport, PartialScene, PlacementSettings};

/// Two objects that no move separated.
#[derive(Debug, Clone, PartialEq)]
pub struct Unresolved {
    /// One.
    pub a: ObjectId,
    /// The other; `None` for a wall or the floor.
    pub b: Option<ObjectId>,
    /// How deep they are in one another, metres.
    pub penetration: f64,
}

/// How one object fared.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectReport {
    /// The object.
    pub id: ObjectId,
    /// Evidence at its final pose.
    pub evidence: Evidence,
    /// IoU of the first pose.
    pub first_iou: Option<f64>,
    /// Silhouette and depth rounds done.
    pub rounds: usize,
    /// Renders spent.
    pub renders: usize,
    /// Displacement by collision resolution, metres.
    pub moved_by_collision: f64,
    /// Host that replaced the one that was given, if any.
    pub rehosted_to: Option<ObjectId>,
}

/// What happened on a level.
#[derive(Debug, Clone, Default)]
pub struct LevelReport {
    /// The order.
    pub order: OrderReport,
    /// One per placed item, in placement order.
    pub objects: Vec<ObjectReport>,
    /// Items that could not be placed at all, with the reason.
    pub dropped: Vec<(ObjectId, PlacementError)>,
    /// Collisions that stay; the pipeline may ask for another order.
    pub unresolved: Vec<Unresolved>,
    /// Everything that went another way than intended.
    pub warnings: Vec<Warning>,
}

/// Why an item could not be placed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlacementError {
    /// The mask is empty.
    #[error("the mask has no pixel")]
    EmptyMask,
    /// The mask is not of the camera's size.
    #[error("the mask is {width}x{height}, the camera {camera_width}x{camera_height}")]
    MaskSize {
        /// Mask columns.
        width: u32,
        /// Mask rows.
        height: u32,
        /// Camera columns.
        camera_width: u32,
        /// Camera rows.
        camera_height: u32,
    },
    /// The mesh has no extent, or is not finite.
    #[error("the mesh has no usable extent: {width} x {height} x {depth}")]
    Mesh {
        /// Along x.
        width: f64,
        /// Along y.
        height: f64,
        /// Along z.
        depth: f64,
    },
}

/// Places one level's items into the scene, in order, and reports.
///
/// `given_order` is the VLM's, if there is one. Items that cannot be placed are in [`LevelReport::dropped`]; the
/// others are appended to [`PartialScene::placed`] in placement order.
pub fn place_level(
    scene: &mut PartialScene,
    items: Vec<Item>,
    given_order: Option<&[ObjectId]>,
    settings: &PlacementSettings,
) -> LevelReport {
    let order = crate::placement_order(scene, &items, given_order, settings);
    LevelReport { order, ..LevelReport::default() }
}
