//! `ImageEditor`: an image from images and an instruction.

use std::sync::Arc;

use async_trait::async_trait;
use harmony_scene::Mask;
use image::{RgbImage, RgbaImage};

use crate::{PlayerCard, RoleError, Usage};

/// Why the edit is wanted; players that compute rather than draw choose their method by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EditKind {
    /// Remove the furniture, keep the room (`empty_room.png`).
    EmptyRoom,
    /// Complete a partly hidden object on a plain background.
    Amodal,
    /// Complete a face of the room, seen straight on as a flat texture: what is not known of it is marked. The answer is the
    /// editor's own picture everywhere; whoever asked puts the known part back, for only that tells how the editor's
    /// colours differ.
    Surface,
}

/// What to edit.
#[derive(Debug, Clone)]
pub struct EditRequest {
    /// Stable call name.
    pub name: String,
    /// Why.
    pub kind: EditKind,
    /// The image to change.
    pub image: Arc<RgbImage>,
    /// Pixels that may change (set = may change); `None` = all.
    pub mask: Option<Arc<Mask>>,
    /// Pixels of the object itself, for [`EditKind::Amodal`].
    pub object: Option<Arc<Mask>>,
    /// The instruction in words.
    pub instruction: String,
}

/// The edited image, in the frame and size of the request's image.
#[derive(Debug, Clone)]
pub struct EditedImage {
    /// Pixels; alpha = belongs to the result (all 255 where nothing was cut out).
    pub image: RgbaImage,
    /// Tokens and cost.
    pub usage: Usage,
}

/// Edits images.
///
/// Cast in the paper: Gemini 2.5 Flash Image.
#[async_trait]
pub trait ImageEditor: Send + Sync {
    /// Who is playing.
    fn card(&self) -> PlayerCard;

    /// Whether it draws what is hidden. One that only repeats what is around is not asked to complete objects or to empty
    /// a room.
    fn draws(&self) -> bool {
        true
    }

    /// Makes one image.
    async fn edit(&self, request: &EditRequest) -> Result<EditedImage, RoleError>;
}
