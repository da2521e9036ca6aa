//! `GeometryEstimator`: point map, confidence, K, R, t.

use std::sync::Arc;

use async_trait::async_trait;
use harmony_scene::PointMap;
use image::RgbImage;
use serde_json::Value;

use crate::{PlayerCard, RoleError};

/// What to estimate geometry of.
#[derive(Debug, Clone)]
pub struct GeometryRequest {
    /// Stable call name.
    pub name: String,
    /// The photo.
    pub image: Arc<RgbImage>,
    /// Focal length from EXIF in pixels of `image`, a prior.
    pub exif_focal_px: Option<f64>,
}

/// What was estimated.
#[derive(Debug, Clone)]
pub enum GeometryAnswer {
    /// A dense map of every pixel's own surface.
    Points(Arc<PointMap>),
    /// No depth at all: the room box has to come from vanishing points and the layout answer.
    NoDepth {
        /// Evidence in the estimator's words, for `camera.json`.
        evidence: Value,
    },
}

/// Estimates geometry.
///
/// Cast in the paper: VGGT.
#[async_trait]
pub trait GeometryEstimator: Send + Sync {
    /// Who is playing.
    fn card(&self) -> PlayerCard;

    /// Estimates one photo.
    async fn estimate(&self, request: &GeometryRequest) -> Result<GeometryAnswer, RoleError>;
}
