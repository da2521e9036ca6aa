//! What is asked of Blender.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use harmony_scene::{AlbedoField, Camera, Extents, Lighting, ViewTransform};
use serde::Serialize;

/// What kind of image is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(tag = "mode", rename_all = "snake_case")]
pub enum RenderMode {
    /// The lit picture.
    Lit,
    /// One linear image a light, at the job's intensities, from a single render.
    PerLight,
    /// Object ids, one sample at the pixel centre; [`CyclesJob::node_ids`] says which.
    Ids,
}

/// The one gain on all base colours of a scene; see `docs/decisions/0007-light.md`.
///
/// Textures cut from the photo hold its light, and their level says nothing about reflectance. All share one gain that
/// brings their bright end to [`Delight::bright_albedo`]; what each surface needs beside it is the job's albedo field.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Delight {
    /// Luminance albedo that the scene's bright base colours (95th percentile) get, 0 to 1.
    pub bright_albedo: f64,
    /// Largest gain that is given; its inverse is the smallest.
    pub max_gain: f64,
}

impl Default for Delight {
    fn default() -> Self {
        Self { bright_albedo: 0.75, max_gain: 3.0 }
    }
}

/// One render.
#[derive(Debug, Clone, PartialEq)]
pub struct CyclesJob {
    /// The scene, in room coordinates (glTF axes, metres). Lights and cameras in it are ignored.
    pub glb: PathBuf,
    /// The camera; its size is the image's size.
    pub camera: Camera,
    /// The light.
    pub lighting: Lighting,
    /// The room box: ambient light comes from its six faces, for a closed room lets none in from outside.
    pub room: Option<Extents>,
    /// What is wanted.
    pub mode: RenderMode,
    /// Samples a pixel (not for ids).
    pub samples: u32,
    /// Whether OpenImageDenoise cleans the picture (not for ids and per-light images).
    pub denoise: bool,
    /// Nodes of the GLB that the camera does not see but that still bounce light: near walls and ceiling of a
    /// canonical view. A node's descendants follow it.
    pub hidden_nodes: Vec<String>,
    /// Ids to write, by node name; descendants follow, other nodes get 0. `node/material` names one material of a node
    /// (per-light images only).
    pub node_ids: BTreeMap<String, u32>,
    /// What the picture shows where there is no geometry, sRGB 0 to 1; `None` = the ambient light.
    pub background: Option<[f64; 3]>,
    /// Base colours to reflectances, for the whole scene; `None` leaves them as they are.
    pub delight: Option<Delight>,
    /// Base colours to reflectances, by node and place.
    pub albedo: Option<Arc<AlbedoField>>,
    /// Nodes whose base colours are reflectances already, for they come from no photo: nothing scales them.
    pub true_colors: Vec<String>,
    /// View transforms to sample beside per-light images.
    pub views: Vec<ViewTransform>,
    /// Sampling seed.
    pub seed: u32,
    /// Threads; 0 = all.
    pub threads: u32,
    /// Wall-clock limit, after which Blender and its children are ended.
    pub timeout: Duration,
    /// Limit of Blender's address space, MiB; `None` = none.
    pub memory_limit_mb: Option<u64>,
}

impl CyclesJob {
    /// Samples of the final image (960 px).
    pub const FINAL_SAMPLES: u32 = 64;
    /// Samples of a preview (480 px).
    pub const PREVIEW_SAMPLES: u32 = 16;
    /// Samples of the per-light images (240 px).
    pub const PER_LIGHT_SAMPLES: u32 = 32;

    /// A lit picture with the defaults: 64 samples, denoised, through the lighting's view.
    pub fn lit(glb: impl Into<PathBuf>, camera: Camera, lighting: Lighting) -> Self {
        Self {
            glb: glb.into(),
            camera,
            lighting,
            room: None,
            mode: RenderMode::Lit,
            samples: Self::FINAL_SAMPLES,
            denoise: true,
            hidden_nodes: Vec::new(),
            node_ids: BTreeMap::new(),
            background: None,
            delight: Some(Delight::default()),
            albedo: None,
            true_colors: Vec::new(),
            views: Vec::new(),
            seed: 0,
            threads: 0,
            timeout: Duration::from_mins(15),
            memory_limit_mb: None,
        }
    }

    /// The same scene as a quick look: at most 480 px wide, 16 samples, denoised.
    #[must_use]
    pub fn preview(&self) -> Self {
        let size = self.camera.size.fit_within(480);
        Self {
            camera: self.camera.resized(size),
            mode: RenderMode::Lit,
            samples: Self::PREVIEW_SAMPLES,
            denoise: true,
            ..self.clone()
        }
    }

    /// The same scene as per-light images for [`crate::fit_lights`]: at most 240 px wide, 32 samples.
    #[must_use]
    pub fn per_light(&self) -> Self {
        let size = self.camera.size.fit_within(240);
        Self {
            camera: self.camera.resized(size),
            mode: RenderMode::PerLight,
            samples: Self::PER_LIGHT_SAMPLES,
            denoise: false,
            ..self.clone()
        }
    }

    /// The same scene as ids, for checking a camera.
    #[must_use]
    pub fn ids(&self, node_ids: BTreeMap<String, u32>) -> Self {
        Self { mode: RenderMode::Ids, node_ids, samples: 1, denoise: false, ..self.clone() }
    }
}
