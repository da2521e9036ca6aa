//! `LitRenderer`: a path-traced image.

use std::path::PathBuf;

use async_trait::async_trait;
use harmony_scene::{Camera, Extents, Lighting};
use image::RgbImage;

use crate::{PlayerCard, RoleError};

/// What to path-trace.
#[derive(Debug, Clone)]
pub struct LitRequest {
    /// Stable call name.
    pub name: String,
    /// The scene as GLB.
    pub glb: PathBuf,
    /// Content hash of the GLB, for the key.
    pub glb_hash: String,
    /// The camera; its size is the image's size.
    pub camera: Camera,
    /// Light.
    pub lighting: Lighting,
    /// The room box: in a closed room ambient light has to come from its faces.
    pub room: Option<Extents>,
    /// Samples a pixel.
    pub samples: u32,
    /// Whether to denoise.
    pub denoise: bool,
}

/// The image.
#[derive(Debug, Clone)]
pub struct LitImage {
    /// sRGB.
    pub image: RgbImage,
}

/// Path-traces scenes.
///
/// Cast in the paper: Blender Cycles.
#[async_trait]
pub trait LitRenderer: Send + Sync {
    /// Who is playing.
    fn card(&self) -> PlayerCard;

    /// Renders one image.
    async fn render(&self, request: &LitRequest) -> Result<LitImage, RoleError>;
}
