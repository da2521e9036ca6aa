//! `MeshGenerator`: a textured mesh from an RGBA crop.

use std::sync::Arc;

use async_trait::async_trait;
use harmony_mesh::{ConvexPart, Mesh, PartModel, TemplateParams};
use harmony_scene::{Level, Size};
use image::RgbaImage;
use serde::{Deserialize, Serialize};

use crate::{PlayerCard, RoleError, Usage};

/// Mesh fidelity (paper App. B.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MeshSettings {
    /// Marching-cubes octree resolution.
    pub octree_resolution: u32,
    /// Shape-diffusion steps.
    pub steps: u32,
    /// Target faces after decimation.
    pub faces: u32,
}

impl Default for MeshSettings {
    fn default() -> Self {
        Self { octree_resolution: 384, steps: 25, faces: 80_000 }
    }
}

/// What to make a mesh of.
#[derive(Debug, Clone)]
pub struct MeshRequest {
    /// Stable call name.
    pub name: String,
    /// The completed object, alpha = object, other pixels plain.
    pub crop: Arc<RgbaImage>,
    /// Category in words.
    pub label: String,
    /// Looks in words.
    pub description: String,
    /// Level.
    pub level: Level,
    /// Expected size, metres.
    pub size: Size,
    /// Template that the VLM chose, if any; players that make their own shapes ignore it.
    pub template: Option<String>,
    /// Options of the template.
    pub params: TemplateParams,
    /// A part model that the VLM wrote for this object, if any.
    pub part_model: Option<PartModel>,
    /// Fidelity.
    pub settings: MeshSettings,
}

/// What is known about the frame of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MeshFrame {
    /// Canonical already: up, front and bottom are right, units are metres of the requested size.
    Canonical,
    /// As the generator left it: to be de-tilted, turned to its front, centred, and scaled.
    Raw,
}

/// A mesh.
#[derive(Debug, Clone)]
pub struct GeneratedMesh {
    /// The mesh.
    pub mesh: Arc<Mesh>,
    /// Convex parts in the same frame, when the generator knows them.
    pub convex: Option<Vec<ConvexPart>>,
    /// What its frame is.
    pub frame: MeshFrame,
    /// The part model it was built from: it can be rebuilt with other proportions.
    pub part_model: Option<PartModel>,
    /// Who or what made it, in words, such as `template sofa` or `hunyuan3d-2`.
    pub source: String,
    /// Remarks about what was approximated.
    pub notes: Vec<String>,
    /// Tokens and cost.
    pub usage: Usage,
}

/// Makes meshes.
///
/// Cast in the paper: Hunyuan3D-2.
#[async_trait]
pub trait MeshGenerator: Send + Sync {
    /// Who is playing.
    fn card(&self) -> PlayerCard;

    /// Whether crop and settings are all that reaches it: two requests that differ in words or sizes alone are then the
    /// same work, and one mesh serves both.
    fn sees_picture_only(&self) -> bool {
        false
    }

    /// Whether it makes shapes of its own from pictures. For one that builds part models, templates and programs are asked
    /// of the language model.
    fn makes_shapes(&self) -> bool {
        true
    }

    /// Makes one mesh.
    async fn generate(&self, request: &MeshRequest) -> Result<GeneratedMesh, RoleError>;
}
