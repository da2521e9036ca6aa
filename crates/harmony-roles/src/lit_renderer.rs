//! `LitRenderer`: a path-traced image.

use std::path::PathBuf;
use std::sync::Arc;

use async_trait::async_trait;
use harmony_scene::{AlbedoField, Camera, Extents, ImageSize, Lighting, ViewTransform};
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
    /// Factors that make reflectances of the scene's base colours; `None` = one for all.
    pub albedo: Option<Arc<AlbedoField>>,
    /// Nodes that the camera does not see but that still bounce light: near walls of a canonical view.
    pub hidden_nodes: Vec<String>,
    /// What the picture shows where there is no geometry, sRGB 0 to 1; `None` = the ambient light.
    pub background: Option<[f64; 3]>,
    /// What is wanted.
    pub kind: LitKind,
}

/// What a path tracer is asked for.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum LitKind {
    /// The picture.
    #[default]
    Picture,
    /// Beside it what each light gives, for fitting them to a photo.
    Measurement {
        /// Nodes of the GLB to tell apart, in the order of [`LightMeasurement::nodes`].
        nodes: Vec<String>,
        /// View transforms to sample.
        views: Vec<ViewTransform>,
    },
}

/// The image.
#[derive(Debug, Clone)]
pub struct LitImage {
    /// sRGB.
    pub image: RgbImage,
    /// What was asked for by [`LitKind::Measurement`].
    pub measured: Option<Arc<LightMeasurement>>,
}

/// What each light gives in one view; images are row-major, of the request's size.
#[derive(Debug, Clone, PartialEq)]
pub struct LightMeasurement {
    /// Size.
    pub size: ImageSize,
    /// Scene-linear light before exposure, by light that is on, in the order of the lighting; `None` = ambient, last.
    pub lights: Vec<(Option<String>, Vec<[f32; 3]>)>,
    /// Diffuse reflectance as rendered.
    pub albedo: Vec<[f32; 3]>,
    /// Node that is seen: 1 for the first named one, 0 for none of them.
    pub nodes: Vec<u32>,
    /// Display values (sRGB encoded) of each view, a cube of samples, red fastest.
    pub views: Vec<(ViewTransform, Vec<[f32; 3]>)>,
}

/// Path-traces scenes.
///
/// Cast in the paper: Blender Cycles.
#[async_trait]
pub trait LitRenderer: Send + Sync {
    /// Who is playing.
    fn card(&self) -> PlayerCard;

    /// Whether there is a path tracer at all.
    fn traces(&self) -> bool {
        true
    }

    /// Renders one image.
    async fn render(&self, request: &LitRequest) -> Result<LitImage, RoleError>;
}
