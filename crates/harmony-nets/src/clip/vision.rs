//! The image tower: a vision transformer over square patches.

use super::layout::Layout;
use super::transformer::{Depth, Transformer};
use crate::backend::{Act, Backend, Binary, ConvWeights, TensorHandle, Window};
use crate::params::{Norm, Params};
use crate::resample::Pixels;
use crate::{DType, HostTensor, NetError};

/// Numbers of an image tower.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VisionConfig {
    /// Channels.
    pub width: usize,
    /// Channels inside the feed-forward layers.
    pub hidden: usize,
    /// Blocks.
    pub layers: usize,
    /// Attention heads.
    pub heads: usize,
    /// Side of the square image, in pixels.
    pub image_size: usize,
    /// Side of a patch, in pixels.
    pub patch: usize,
}

impl VisionConfig {
    /// Patches a side.
    pub fn grid(&self) -> usize {
        self.image_size / self.patch
    }
}

/// The tower on a device.
pub struct VisionTower<B: Backend> {
    config: VisionConfig,
    patches: B::Conv,
    class: B::Tensor,
    positions: B::Tensor,
    pre: Norm<B>,
    blocks: Transformer<B>,
    post: Norm<B>,
}

impl<B: Backend> VisionTower<B> {
    /// Weights below `p`; `pre_norm` is the name of the first norm in transformers' layout.
    ///
    /// # Errors
    /// [`NetError::Weights`] for missing keys and wrong shapes, and what the device says.
    pub fn load(p: &Params<'_, B>, config: VisionConfig, layout: Layout, pre_norm: &str) -> Result<Self, NetError> {
        let VisionConfig { width, hidden, layers, heads, patch, .. } = config;
        let tokens = config.grid() * config.grid() + 1;
        let embedding = layout.pick("vision_model.embeddings.patch_embedding.weight", "visual.conv1.weight");
        let weight = p.host(embedding, &[width, 3, patch, patch])?;
        let patches = ConvWeights { weight, bias: None };
        let tensor = |names: [&str; 2], shape: &[usize]| {
            p.backend.load(&p.host(layout.pick(names[0], names[1]), shape)?, p.backend.preferred())
        };
        let class = tensor(["vision_model.embeddings.class_embedding", "visual.class_embedding"], &[width])?;
        Ok(Self {
            patches: p.backend.load_conv(&patches, Window::conv(patch, 0), p.backend.preferred())?,
            class: p.backend.reshape(&class, &[1, 1, width])?,
            positions: tensor(
                ["vision_model.embeddings.position_embedding.weight", "visual.positional_embedding"],
                &[tokens, width],
            )?,
            pre: layout.norm(p, &format!("vision_model.{pre_norm}"), "visual.ln_pre", width)?,
            blocks: Transformer::load(
                p,
                "vision_model",
                layout,
                Depth { width, hidden, layers, heads, causal: false },
            )?,
            post: layout.norm(p, "vision_model.post_layernorm", "visual.ln_post", width)?,
            config,
        })
    }

    /// The configuration.
    pub fn config(&self) -> &VisionConfig {
        &self.config
    }

    /// Normalised images to tokens `[N, 1 + patches, width]`, the class token first, before the last norm.
    ///
    /// # Errors
    /// [`NetError::Input`] for an image of another size, and what the device says.
    pub fn forward(&self, b: &B, mut images: Vec<Pixels>) -> Result<B::Tensor, NetError> {
        let side = self.config.image_size;
        if let Some(image) = images.iter().find(|image| (image.width, image.height) != (side, side)) {
            let reason = format!("an image of {}x{}, wanted {side}x{side}", image.width, image.height);
            return Err(NetError::Input { network: "vision transformer", reason });
        }
        let (count, cells) = (images.len(), self.config.grid() * self.config.grid());
        // One image, the common case, is not copied.
        let pixels = match images.as_mut_slice() {
            [one] => std::mem::take(&mut one.data),
            many => many.iter().flat_map(|image| image.data.iter().copied()).collect(),
        };
        let host = HostTensor::from_f32(&[count, side, side, 3], pixels);
        let x = b.conv2d(&b.load(&host, b.preferred())?, &self.patches, Act::None, None)?;
        let x = b.reshape(&x, &[count, cells, self.config.width])?;
        let class = b.concat(&vec![&self.class; count], 0)?;
        let x = b.concat(&[&class, &x], 1)?;
        let x = b.binary(x, &self.positions, Binary::Add)?;
        let x = self.pre.apply(b, &x)?;
        self.blocks.forward(b, x)
    }

    /// The normed class token of each image, `[N, width]`.
    ///
    /// # Errors
    /// What the device says.
    pub fn class_features(&self, b: &B, tokens: &B::Tensor) -> Result<B::Tensor, NetError> {
        let class = b.slice(tokens, 1, 0, 1)?;
        let class = b.reshape(&class, &[tokens.dim(0), self.config.width])?;
        self.post.apply(b, &class)
    }

    /// All tokens normed, in f32.
    ///
    /// # Errors
    /// What the device says.
    pub fn normed(&self, b: &B, tokens: &B::Tensor) -> Result<B::Tensor, NetError> {
        self.post.apply(b, &b.cast(tokens, DType::F32)?)
    }
}
