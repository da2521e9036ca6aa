//! The network: CLIP's towers and heads over the patches.

use std::sync::Arc;

use image::RgbImage;

use super::preprocess;
use crate::backend::{Act, Backend, Binary, TensorHandle};
use crate::clip::{Layout, TextConfig, TextTower, VisionConfig, VisionTower};
use crate::params::{Mlp, Norm, Params, WeightSource};
use crate::resample::Pixels;
use crate::{DType, HostTensor, NetError};

/// Added to the length of class features before dividing by it.
const EPS: f32 = 1e-6;

/// The published sizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Owlv2Size {
    /// ViT-B/16 at 960 pixels.
    Base,
    /// ViT-L/14 at 1008 pixels.
    Large,
}

impl Owlv2Size {
    /// `base` or `large`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Base => "base",
            Self::Large => "large",
        }
    }
}

/// Numbers of the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Owlv2Config {
    /// Image tower.
    pub vision: VisionConfig,
    /// Text tower; its width is the length of class features.
    pub text: TextConfig,
}

impl Owlv2Config {
    /// A published size.
    pub fn of(size: Owlv2Size) -> Self {
        let text = |width, heads| TextConfig {
            width,
            hidden: 4 * width,
            layers: 12,
            heads,
            vocabulary: 49_408,
            positions: 16,
        };
        match size {
            Owlv2Size::Base => Self {
                vision: VisionConfig { width: 768, hidden: 3072, layers: 12, heads: 12, image_size: 960, patch: 16 },
                text: text(512, 8),
            },
            Owlv2Size::Large => Self {
                vision: VisionConfig { width: 1024, hidden: 4096, layers: 24, heads: 16, image_size: 1008, patch: 14 },
                text: text(768, 12),
            },
        }
    }
}

/// The network on a device. The towers compute in the device's preferred type, the heads in f32.
pub struct Owlv2<B: Backend> {
    backend: Arc<B>,
    config: Owlv2Config,
    vision: VisionTower<B>,
    text: TextTower<B>,
    text_projection: B::Linear,
    norm: Norm<B>,
    class: B::Linear,
    shift: B::Linear,
    scale: B::Linear,
    boxes: Mlp<B>,
}

/// What the network sees in an image, before any phrase.
pub struct Owlv2Image<B: Backend> {
    /// Boxes, one a patch: centre x, centre y, width, height, as fractions of the square that the photo was filled up to.
    pub boxes: Vec<[f32; 4]>,
    /// Unit class features `[patches, width]`.
    pub(super) classes: B::Tensor,
    shift: Vec<f32>,
    scale: Vec<f32>,
}

impl<B: Backend> Owlv2<B> {
    /// Puts the weights on the device.
    ///
    /// # Errors
    /// [`NetError::Weights`] for missing keys and wrong shapes, and what the device says.
    pub fn load(backend: Arc<B>, weights: &dyn WeightSource, config: Owlv2Config) -> Result<Self, NetError> {
        let root = Params::new(&*backend, weights, backend.preferred());
        let towers = root.at("owlv2");
        let heads = root.as_type(DType::F32);
        let (w, t) = (config.vision.width, config.text.width);
        let vision = VisionTower::load(&towers, config.vision, Layout::Transformers, Layout::OWL_PRE_NORM)?;
        let text = TextTower::load(&towers, config.text, Layout::Transformers)?;
        Ok(Self {
            vision,
            text,
            text_projection: towers.linear_without_bias("text_projection", t, t)?,
            norm: heads.norm("layer_norm", w, 1e-5)?,
            class: heads.linear("class_head.dense0", t, w)?,
            shift: heads.linear("class_head.logit_shift", 1, w)?,
            scale: heads.linear("class_head.logit_scale", 1, w)?,
            boxes: heads.at("box_head").mlp(&["dense0", "dense1", "dense2"], &[w, w, w, 4], Act::Gelu)?,
            config,
            backend,
        })
    }

    /// The configuration.
    pub fn config(&self) -> &Owlv2Config {
        &self.config
    }

    /// Resizes and encodes a photo.
    ///
    /// # Errors
    /// [`NetError::Input`] for an empty photo, and what the device says.
    pub fn encode(&self, photo: &RgbImage) -> Result<Owlv2Image<B>, NetError> {
        if photo.width() == 0 || photo.height() == 0 {
            return Err(NetError::Input { network: "OWLv2", reason: "the photo has no pixels".to_owned() });
        }
        self.encode_pixels(preprocess(photo, self.config.vision.image_size))
    }

    /// Encodes a preprocessed image.
    ///
    /// # Errors
    /// [`NetError::Input`] for another size than the network's, and what the device says.
    pub fn encode_pixels(&self, pixels: Pixels) -> Result<Owlv2Image<B>, NetError> {
        let b = &*self.backend;
        let features = self.features(pixels)?;
        let classes = b.l2_normalize(&b.linear(&features, &self.class, Act::None, None)?, EPS)?;
        let head = |w: &B::Linear| b.read(&b.linear(&features, w, Act::None, None)?);
        let (shift, scale) = (head(&self.shift)?, head(&self.scale)?);
        // 1 + ELU.
        let scale = scale.into_iter().map(|v| if v > 0.0 { v + 1.0 } else { v.exp() }).collect();
        let raw = b.read(&self.boxes.apply(b, &features, None)?)?;
        let grid = self.config.vision.grid();
        let placed = |(i, raw): (usize, &[f32; 4])| {
            let bias = box_bias(i, grid);
            std::array::from_fn(|k| 1.0 / (1.0 + (-(raw[k] + bias[k])).exp()))
        };
        let boxes = raw.as_chunks::<4>().0.iter().enumerate().map(placed).collect();
        Ok(Owlv2Image { boxes, classes, shift, scale })
    }

    /// Features of the patches `[patches, width]`, f32: each patch times the class token.
    fn features(&self, pixels: Pixels) -> Result<B::Tensor, NetError> {
        let b = &*self.backend;
        let tokens = self.vision.forward(b, vec![pixels])?;
        let tokens = self.vision.normed(b, &tokens)?;
        let (count, width) = (tokens.dim(1) - 1, tokens.dim(2));
        let class = b.reshape(&b.slice(&tokens, 1, 0, 1)?, &[width])?;
        let patches = b.reshape(&b.slice(&tokens, 1, 1, count)?, &[count, width])?;
        self.norm.apply(b, &b.binary(patches, &class, Binary::Mul)?)
    }

    /// Unit features of sentences given as token ids, each row ending with the end mark; one row a sentence.
    ///
    /// # Errors
    /// [`NetError::Input`] for rows that are empty or too long, and what the device says.
    pub fn embed_text(&self, ids: &[Vec<u32>]) -> Result<Vec<Vec<f32>>, NetError> {
        let b = &*self.backend;
        let pooled = self.text.pooled(b, ids)?;
        let features = b.linear(&pooled, &self.text_projection, Act::None, None)?;
        let features = b.read(&b.l2_normalize(&b.cast(&features, DType::F32)?, 0.0)?)?;
        Ok(features.chunks_exact(self.config.text.width).map(<[f32]>::to_vec).collect())
    }

    /// Logits `[patch][phrase]` of phrases given by their features (of any length but zero).
    ///
    /// # Errors
    /// What the device says.
    pub fn logits(&self, image: &Owlv2Image<B>, phrases: &[Vec<f32>]) -> Result<Vec<Vec<f32>>, NetError> {
        let b = &*self.backend;
        if phrases.is_empty() {
            return Ok(vec![Vec::new(); image.boxes.len()]);
        }
        let width = self.config.text.width;
        if let Some(odd) = phrases.iter().find(|p| p.len() != width) {
            return Err(NetError::shape("OWLv2 phrases", format!("{} numbers, wanted {width}", odd.len())));
        }
        let host = HostTensor::from_f32(&[phrases.len(), width], phrases.concat());
        let phrases_here = b.l2_normalize(&b.load(&host, DType::F32)?, EPS)?;
        let cosines = b.read(&b.matmul(&image.classes, &phrases_here, true)?)?;
        let rows = cosines.chunks_exact(phrases.len()).zip(image.shift.iter().zip(&image.scale));
        Ok(rows.map(|(row, (shift, scale))| row.iter().map(|c| (c + shift) * scale).collect()).collect())
    }
}

/// Where a patch's box is when the head says nothing: at the far corner of its cell, as large as a cell.
fn box_bias(patch: usize, grid: usize) -> [f32; 4] {
    let n = grid as f32;
    let logit = |v: f32| (v + 1e-4).ln() - (-v + 1e-4).ln_1p();
    let corner = |i: usize| logit((i + 1) as f32 / n);
    [corner(patch % grid), corner(patch / grid), logit(1.0 / n), logit(1.0 / n)]
}
