//! From a part model to a mesh.

use harmony_scene::Size;

use super::{PartModel, PartModelError};
use crate::{ConvexPart, Mesh};

/// What a part model becomes.
#[derive(Debug, Clone)]
pub struct BuiltModel {
    /// Canonical mesh in metres (+Y up, front +Z, bottom at y = 0, centred in x and z), one group and material a used
    /// slot, uniquely unwrapped.
    pub mesh: Mesh,
    /// Convex pieces in the mesh's frame, for collision.
    pub convex: Vec<ConvexPart>,
    /// Slot name of each material.
    pub slots: Vec<String>,
    /// Slots that keep their colour when the photo is baked.
    pub plain_slots: Vec<String>,
}

pub(super) fn build(_model: &PartModel, _size: Size) -> Result<BuiltModel, PartModelError> {
    Ok(BuiltModel { mesh: Mesh::default(), convex: Vec::new(), slots: Vec::new(), plain_slots: Vec::new() })
}
