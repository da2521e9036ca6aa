//! An object that wants a place.
//!
//! Everything that placement knows of an object before it is placed, as plain data: shape, mask, named size, relations,
//! traits, turn. Sizes are metres and unrotated, turns radians in the room frame, masks of the scene camera's size. Who
//! said it does not matter here: what may be wrong of it has its probability in [`crate::Noise`].

use std::sync::Arc;

use harmony_scene::{Level, Mask, ObjectId, Placement, Relations, Size};

use crate::Shape;

/// What is known of the kind of object, beyond its mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[expect(clippy::struct_excessive_bools, reason = "independent facts")]
pub struct Traits {
    /// A rug or mat: lies flat under everything, never collides.
    pub flat: bool,
    /// Cushion, blanket, toy: may press into what it touches.
    pub soft: bool,
    /// Cloth: may be thrown over what carries it, hang down over its edge and reach the floor.
    pub drapes: bool,
    /// A thin wall item (painting, mirror, window, door, clock).
    pub planar: bool,
    /// A window or door: it sits in its wall, not on it.
    pub opening: bool,
    /// A door, or what was said to go on to the floor: its lower edge is there.
    pub to_floor: bool,
    /// On a wall: it was said to go on to the ceiling.
    pub to_ceiling: bool,
    /// A table: a lamp that hangs alone may hang over it.
    pub lit_from_above: bool,
    /// Hangs down (pendant, curtain).
    pub hangs: bool,
    /// Proportions may be corrected (part models, slabs).
    pub may_stretch: bool,
    /// As deep as it is wide, as round and square things are: a correction of the width is one of the depth too.
    pub as_wide_as_deep: bool,
    /// Much of it is hidden: the mask's size says nothing.
    pub heavily_occluded: bool,
    /// Its size is far outside what its kind has: little is thought of it.
    pub size_doubted: bool,
    /// Its place, turn or size was corrected by who saw it placed: another shape keeps them.
    pub corrected: bool,
    /// It has a front that matters.
    pub has_front: bool,
}

/// What is known of an object's yaw (radians, room frame) before placement.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum YawHint {
    /// Nothing beyond the relations.
    #[default]
    Unknown,
    /// About this, within some 25 degrees.
    About(f64),
}

/// One object to place.
#[derive(Debug, Clone)]
pub struct Item {
    /// Id.
    pub id: ObjectId,
    /// Value in the id image.
    pub index: u32,
    /// Level.
    pub level: Level,
    /// Category, lower case.
    pub label: String,
    /// Canonical geometry.
    pub shape: Arc<Shape>,
    /// Size by prior knowledge (the VLM's), metres, unrotated.
    pub size: Size,
    /// Where it is seen, at the scene camera's size; may be cut by the image border or by nearer objects.
    pub mask: Arc<Mask>,
    /// Relations.
    pub relations: Relations,
    /// How a decoration rests.
    pub placement: Placement,
    /// Further hosts a decoration may stand on, when `relations.on_top_of` turns out not to fit.
    pub host_candidates: Vec<ObjectId>,
    /// Traits.
    pub traits: Traits,
    /// What is known of the yaw.
    pub yaw: YawHint,
    /// Detection score, passed through into the confidence.
    pub detection: Option<f64>,
}
