//! What Blender gives back.

use std::time::Duration;

use image::RgbImage;
use serde::Serialize;

use crate::{GreyResponse, LinearImage};

/// Light that came from one source.
#[derive(Debug, Clone, PartialEq)]
pub struct LightPass {
    /// Id of the light, or `None` for the ambient light.
    pub light: Option<String>,
    /// Its contribution at the job's intensity and colour.
    pub image: LinearImage,
}

/// Where the time went, seconds of wall clock.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct CyclesTimings {
    /// Whole process, as seen from here.
    pub total: f64,
    /// Importing the GLB and building the scene.
    pub load: f64,
    /// Rendering and denoising.
    pub render: f64,
}

/// A finished job.
#[derive(Debug, Clone)]
pub struct CyclesOutput {
    /// The picture, sRGB ([`crate::RenderMode::Lit`]).
    pub image: Option<RgbImage>,
    /// Per-light images ([`crate::RenderMode::PerLight`]).
    pub lights: Vec<LightPass>,
    /// Ids, row-major ([`crate::RenderMode::Ids`]).
    pub ids: Option<Vec<u32>>,
    /// How grey light becomes 8-bit values under the job's view transform.
    pub response: GreyResponse,
    /// Gain that [`crate::Delight`] gave to the base colours; 1 without it.
    pub albedo_gain: f64,
    /// Blender's version.
    pub version: String,
    /// Where the time went.
    pub timings: CyclesTimings,
    /// Largest resident memory of the process, MiB.
    pub peak_memory_mb: u64,
    /// What the script had to leave out or could not find, in words.
    pub notes: Vec<String>,
    /// SHA-free check value: how many triangles Blender saw.
    pub triangles: u64,
    /// Time limit that was in force.
    pub timeout: Duration,
}
