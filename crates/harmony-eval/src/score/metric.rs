//! Figures of a pair of pictures.

use std::fmt::Debug;
use std::sync::Arc;

use harmony_bench::metrics::picture::pixel_loss;
use image::RgbImage;
use serde::{Deserialize, Serialize};

/// A figure; lower is better for all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MetricId {
    /// One minus the cosine of CLIP ViT-B/32's image features.
    NClip,
    /// Photometric loss: mean squared difference of sRGB values in [0, 1], nothing masked.
    Pl,
    /// LPIPS 0.1 with AlexNet, the default of its authors.
    LpipsAlex,
    /// LPIPS 0.1 with VGG-16.
    LpipsVgg,
}

impl MetricId {
    /// In the order of tables.
    pub const ALL: [Self; 4] = [Self::NClip, Self::Pl, Self::LpipsAlex, Self::LpipsVgg];

    /// For people.
    pub fn title(self) -> &'static str {
        match self {
            Self::NClip => "N-CLIP",
            Self::Pl => "PL",
            Self::LpipsAlex => "LPIPS alex",
            Self::LpipsVgg => "LPIPS vgg",
        }
    }

    /// For columns of CSV files.
    pub fn key(self) -> &'static str {
        match self {
            Self::NClip => "n_clip",
            Self::Pl => "pl",
            Self::LpipsAlex => "lpips_alex",
            Self::LpipsVgg => "lpips_vgg",
        }
    }
}

/// Two pictures cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {reason}", .metric.title())]
pub struct MetricError {
    /// Which figure.
    pub metric: MetricId,
    /// Why not.
    pub reason: String,
}

/// Measures a render against its photo.
pub trait PictureMetric: Send + Sync + Debug {
    /// Which figure it gives.
    fn id(&self) -> MetricId;

    /// Compares two pictures of one size.
    ///
    /// # Errors
    /// [`MetricError`] when they cannot be compared, such as pictures that are too small for the network.
    fn measure(&self, render: &RgbImage, photo: &RgbImage) -> Result<f64, MetricError>;
}

/// [`MetricId::Pl`].
#[derive(Debug, Clone, Copy, Default)]
pub struct PixelLoss;

impl PictureMetric for PixelLoss {
    fn id(&self) -> MetricId {
        MetricId::Pl
    }

    fn measure(&self, render: &RgbImage, photo: &RgbImage) -> Result<f64, MetricError> {
        let empty = || MetricError { metric: MetricId::Pl, reason: "a picture without pixels".to_owned() };
        pixel_loss(render, photo).ok_or_else(empty)
    }
}

/// Who measures, and what is not measured and why.
#[derive(Debug, Clone)]
pub struct Looks {
    /// In the order of [`MetricId::ALL`].
    pub metrics: Vec<Arc<dyn PictureMetric>>,
    /// A sentence for each figure that is missing.
    pub absent: Vec<String>,
}

impl Looks {
    /// PL, which needs no weights, and the networks that are there.
    pub fn new(networks: Vec<Arc<dyn PictureMetric>>, absent: Vec<String>) -> Self {
        let mut metrics = networks;
        if metrics.iter().all(|m| m.id() != MetricId::Pl) {
            metrics.push(Arc::new(PixelLoss));
        }
        metrics.sort_by_key(|m| m.id());
        Self { metrics, absent }
    }
}
