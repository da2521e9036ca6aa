//! No depth: what vanishing points say about the camera, as evidence.

use async_trait::async_trait;
use harmony_geometry::{FocalPrior, GrayImage, estimate_view};
use harmony_roles::{GeometryAnswer, GeometryEstimator, GeometryRequest, PlayerCard, RoleError};
use harmony_scene::ImageSize;
use serde_json::json;

/// One sigma of the logarithm of a focal length from EXIF.
const EXIF_SIGMA: f64 = 0.03;

/// Longest side at which lines are looked for, pixels.
const WORKING_PX: u32 = 1024;

/// Says that there is no depth, and what the lines of the photo tell about its camera. The room box follows from that
/// and from the layout answer; the pipeline solves for both together.
#[derive(Debug, Clone, Copy)]
pub struct VanishingPoints;

#[async_trait]
impl GeometryEstimator for VanishingPoints {
    fn card(&self) -> PlayerCard {
        super::card("vanishing points 1")
    }

    async fn estimate(&self, request: &GeometryRequest) -> Result<GeometryAnswer, RoleError> {
        let image = request.image.clone();
        let exif = request.exif_focal_px;
        super::computed(move || {
            let size = ImageSize::new(image.width(), image.height());
            let gray = GrayImage::from_rgb8(size, image.as_raw())
                .map_err(|error| super::not_capable(format!("the photo can't be used: {error}")))?
                .fit_within(WORKING_PX);
            let ratio = f64::from(gray.size().width) / f64::from(size.width.max(1));
            let prior = exif
                .filter(|focal| focal.is_finite() && *focal > 0.0)
                .map(|focal| FocalPrior { focal_px: focal * ratio, sigma: EXIF_SIGMA });
            let view = estimate_view(&gray, prior);
            let evidence = json!({
                "method": "vanishing points; no depth was estimated",
                "focal_px": view.intrinsics.fx / ratio,
                "focal": view.focal,
                "tilt_deg": view.tilt_deg(),
                "yaw_deg": view.yaw_deg(),
                "support": view.support,
                "lines": view.counts,
                "confidence": view.confidence,
            });
            Ok(GeometryAnswer::NoDepth { evidence })
        })
        .await?
    }
}
