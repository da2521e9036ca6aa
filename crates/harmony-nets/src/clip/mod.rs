//! CLIP: features of images and of text in one space (Radford et al. 2021, arXiv 2103.00020).
//!
//! [`ClipImageEncoder`] is all that N-CLIP needs; [`ClipTextEncoder`] needs the vocabulary of the model's folder.
//! The towers also carry the detector (OWLv2). Weights: the keys of transformers, or those of OpenAI's own code.
//! LAION's checkpoints of the same shape want another activation and are not for this code.

mod layout;
mod text;
mod tokenizer;
mod transformer;
mod vision;

use std::path::Path;
use std::sync::Arc;

use image::RgbImage;
use image::imageops::crop_imm;

use crate::backend::{Act, Backend};
use crate::params::{Params, WeightSource};
use crate::resample::{Filter, Pixels, resize_8bit};
use crate::{HostTensor, NetError, WeightFile};

pub use layout::Layout;
pub use text::{TextConfig, TextTower};
pub use tokenizer::{Tokenizer, TokenizerError};
pub use vision::{VisionConfig, VisionTower};

/// Mean of the photos that the image tower was trained on.
pub const MEAN: [f32; 3] = [0.481_454_66, 0.457_827_5, 0.408_210_73];
/// Standard deviation of the same.
pub const STD: [f32; 3] = [0.268_629_54, 0.261_302_6, 0.275_777_1];

/// Numbers of a CLIP network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ClipConfig {
    /// Image tower.
    pub vision: VisionConfig,
    /// Text tower.
    pub text: TextConfig,
    /// Length of the features.
    pub features: usize,
}

impl ClipConfig {
    /// ViT-B/32, the network of N-CLIP.
    pub fn vit_b32() -> Self {
        Self {
            vision: VisionConfig { width: 768, hidden: 3072, layers: 12, heads: 12, image_size: 224, patch: 32 },
            text: TextConfig { width: 512, hidden: 2048, layers: 12, heads: 8, vocabulary: 49_408, positions: 77 },
            features: 512,
        }
    }
}

/// Photos to features.
pub struct ClipImageEncoder<B: Backend> {
    backend: Arc<B>,
    tower: VisionTower<B>,
    projection: B::Linear,
    features: usize,
}

impl<B: Backend> ClipImageEncoder<B> {
    /// ViT-B/32 from a weight file of transformers (`model.safetensors`, `pytorch_model.bin`) or with OpenAI's keys.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn open(path: &Path, backend: Arc<B>) -> Result<Self, NetError> {
        Self::load(backend, &WeightFile::open(path)?, &ClipConfig::vit_b32())
    }

    /// Puts the weights on the device.
    ///
    /// # Errors
    /// [`NetError::Weights`] for missing keys and wrong shapes, and what the device says.
    pub fn load(backend: Arc<B>, weights: &dyn WeightSource, config: &ClipConfig) -> Result<Self, NetError> {
        let p = Params::new(&*backend, weights, backend.preferred());
        let layout = Layout::of(weights);
        let tower = VisionTower::load(&p, config.vision, layout, Layout::CLIP_PRE_NORM)?;
        let projection =
            layout.projection(&p, "visual_projection", "visual.proj", config.features, config.vision.width)?;
        Ok(Self { tower, projection, features: config.features, backend })
    }

    /// Features of photos, not normalised, one row a photo.
    ///
    /// # Errors
    /// [`NetError::Input`] for an empty photo, and what the device says.
    pub fn embed(&self, photos: &[&RgbImage]) -> Result<Vec<Vec<f32>>, NetError> {
        if photos.iter().any(|p| p.width() == 0 || p.height() == 0) {
            return Err(NetError::Input { network: "CLIP", reason: "a photo has no pixels".to_owned() });
        }
        let side = self.tower.config().image_size;
        self.embed_pixels(&photos.iter().map(|photo| preprocess(photo, side)).collect::<Vec<_>>())
    }

    /// Features of preprocessed images.
    ///
    /// # Errors
    /// [`NetError::Input`] for another size than the network's, and what the device says.
    pub fn embed_pixels(&self, images: &[Pixels]) -> Result<Vec<Vec<f32>>, NetError> {
        let b = &*self.backend;
        let tokens = self.tower.forward(b, images.to_vec())?;
        let class = self.tower.class_features(b, &tokens)?;
        let features = b.read(&b.linear(&class, &self.projection, Act::None, None)?)?;
        Ok(features.chunks_exact(self.features).map(<[f32]>::to_vec).collect())
    }
}

/// Sentences to features.
pub struct ClipTextEncoder<B: Backend> {
    backend: Arc<B>,
    tower: TextTower<B>,
    projection: B::Linear,
    tokenizer: Tokenizer,
    features: usize,
}

impl<B: Backend> ClipTextEncoder<B> {
    /// Puts the weights on the device.
    ///
    /// # Errors
    /// [`NetError::Weights`] for missing keys and wrong shapes, and what the device says.
    pub fn load(
        backend: Arc<B>,
        weights: &dyn WeightSource,
        config: &ClipConfig,
        tokenizer: Tokenizer,
    ) -> Result<Self, NetError> {
        let p = Params::new(&*backend, weights, backend.preferred());
        let layout = Layout::of(weights);
        let tower = TextTower::load(&p, config.text, layout)?;
        let projection =
            layout.projection(&p, "text_projection", "text_projection", config.features, config.text.width)?;
        Ok(Self { tower, projection, tokenizer, features: config.features, backend })
    }

    /// Features of sentences, not normalised. What does not fit the network's length is cut off.
    ///
    /// # Errors
    /// What the device says.
    pub fn embed(&self, sentences: &[&str]) -> Result<Vec<Vec<f32>>, NetError> {
        let most = self.tower.config().positions;
        self.embed_ids(&sentences.iter().map(|s| self.tokenizer.encode(s, most)).collect::<Vec<_>>())
    }

    /// Features of token ids, each row ending with the end mark.
    ///
    /// # Errors
    /// [`NetError::Input`] for rows that are empty or too long, and what the device says.
    pub fn embed_ids(&self, ids: &[Vec<u32>]) -> Result<Vec<Vec<f32>>, NetError> {
        let b = &*self.backend;
        let pooled = self.tower.pooled(b, ids)?;
        let features = b.read(&b.linear(&pooled, &self.projection, Act::None, None)?)?;
        Ok(features.chunks_exact(self.features).map(<[f32]>::to_vec).collect())
    }
}

/// As CLIP's processor: the shorter side to `side` (Pillow's bicubic), the middle square of that, normalised. The rest
/// of the photo is not looked at.
pub fn preprocess(photo: &RgbImage, side: usize) -> Pixels {
    let (w, h) = photo.dimensions();
    let side = side as u32;
    let (short, long) = (w.min(h).max(1), w.max(h));
    let long = (u64::from(side) * u64::from(long) / u64::from(short)) as u32;
    let (w, h) = if w <= h { (side, long) } else { (long, side) };
    let resized = resize_8bit(photo, w, h, Filter::Cubic);
    let middle = crop_imm(&resized, (w - side) / 2, (h - side) / 2, side, side).to_image();
    Pixels::from_photo(&middle).normalized(MEAN, STD)
}

/// Cosine of the angle between two features; 0 when one of them is zero.
pub fn cosine(a: &[f32], b: &[f32]) -> f64 {
    let dot = |a: &[f32], b: &[f32]| -> f64 { a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum() };
    let norms = (dot(a, a) * dot(b, b)).sqrt();
    if norms > 0.0 { dot(a, b) / norms } else { 0.0 }
}

/// A host matrix with rows and columns exchanged.
fn transposed(x: &HostTensor, rows: usize, columns: usize) -> HostTensor {
    let from = x.to_f32();
    let data = (0..columns).flat_map(|c| from.iter().skip(c).step_by(columns).copied()).collect();
    HostTensor::from_f32(&[columns, rows], data)
}
