//! SAM 2 and 2.1 as an image predictor: boxes and points to masks.
//!
//! Ravi et al., "SAM 2: Segment Anything in Images and Videos", 2024; reference: facebookresearch/sam2, whose key layout
//! the weights have. The parts for video (memory) are not read.
//!
//! The image is encoded once ([`Sam2::encode`]); prompts are answered from that ([`Sam2::predict`]).

mod attention;
mod config;
mod decoder;
mod hiera;
mod neck;
mod prompt;
#[cfg(feature = "players")]
mod segmenter;
mod upscale;

use std::sync::Arc;

use image::RgbImage;

use crate::backend::{Backend, TensorHandle};
use crate::params::{Params, WeightSource};
use crate::resample::{Filter, Pixels};
use crate::{DType, HostTensor, NetError};

pub use config::{Sam2Config, Sam2Size};
pub use prompt::{Label, MaskLogits, Prompt};
#[cfg(feature = "players")]
pub use segmenter::Sam2Segmenter;
pub use upscale::logits_at;
#[cfg(feature = "players")]
pub use upscale::mask_at;

use decoder::{Decoded, Decoder};
use hiera::Hiera;
use neck::Neck;
use prompt::PromptEncoder;

/// Mean of the photos that the encoder was trained on (ImageNet).
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
/// Standard deviation of the same.
const STD: [f32; 3] = [0.229, 0.224, 0.225];

/// Activations of a prompt that is decoded: as many prompts are decoded at once as there is room for.
const PROMPT_BYTES: usize = 60 << 20;

/// Logits of reused masks are kept within this, as upstream does.
const LOGIT_LIMIT: f32 = 32.0;

/// The network on a device.
pub struct Sam2<B: Backend> {
    backend: Arc<B>,
    config: Sam2Config,
    trunk: Hiera<B>,
    neck: Neck<B>,
    prompts: PromptEncoder<B>,
    decoder: Decoder<B>,
    at_once: usize,
}

/// An encoded image.
pub struct Encoded<B: Backend> {
    /// Image embedding `[1, n, n, width]`, "no memory" added.
    pub embedding: B::Tensor,
    /// Features at twice the resolution, `[1, 2n, 2n, width / 4]`.
    pub fine: B::Tensor,
    /// Features at four times the resolution, `[1, 4n, 4n, width / 8]`.
    pub finest: B::Tensor,
    /// Width and height of the photo in pixels.
    pub size: (u32, u32),
}

/// Which masks are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Masks {
    /// One: the mask for unambiguous prompts, or, where that one is not stable, the best of the three.
    Best,
    /// Three, from part to whole, for ambiguous prompts.
    Three,
}

/// A mask as the network gives it.
#[derive(Debug, Clone, PartialEq)]
pub struct MaskPrediction {
    /// Logits on a square grid over the whole photo, `side * side`, row-major; above 0 is inside.
    pub logits: MaskLogits,
    /// The network's estimate of the mask's intersection over union, 0 to 1.
    pub iou: f32,
}

/// What the decoder gives for one prompt, before a choice is made.
#[derive(Debug, Clone, PartialEq)]
pub struct RawPrediction {
    /// Four masks: the one for unambiguous prompts, then three from part to whole.
    pub masks: Vec<MaskPrediction>,
    /// Logit of there being an object at all.
    pub object_score: f32,
}

impl<B: Backend> Sam2<B> {
    /// Puts the weights on the device. Layers of the image encoder compute in the device's preferred type, with
    /// residuals in f32; the mask decoder is f32.
    ///
    /// # Errors
    /// [`NetError::Weights`] for a key that is missing or has another shape (a checkpoint of another size has), and what
    /// the device says.
    pub fn load(backend: Arc<B>, weights: &dyn WeightSource, config: Sam2Config) -> Result<Self, NetError> {
        let b = &*backend;
        let wide = Params::new(b, weights, b.preferred());
        let precise = wide.as_type(DType::F32);
        Ok(Self {
            trunk: Hiera::load(&wide.at("image_encoder.trunk"), &config)?,
            neck: Neck::load(&wide, &config)?,
            prompts: PromptEncoder::load(&precise.at("sam_prompt_encoder"), &config)?,
            decoder: Decoder::load(&precise.at("sam_mask_decoder"), &config)?,
            config,
            at_once: (b.room() / PROMPT_BYTES).max(1),
            backend,
        })
    }

    /// Decodes so many prompts at once: more is quicker where there is memory for it.
    #[must_use]
    pub fn decoding_at_once(self, prompts: usize) -> Self {
        Self { at_once: prompts.max(1), ..self }
    }

    /// The configuration.
    pub fn config(&self) -> &Sam2Config {
        &self.config
    }

    /// Resizes and encodes a photo.
    ///
    /// # Errors
    /// [`NetError::Input`] for an empty photo, and what the device says.
    pub fn encode(&self, photo: &RgbImage) -> Result<Encoded<B>, NetError> {
        if photo.width() == 0 || photo.height() == 0 {
            return Err(NetError::Input { network: "SAM 2", reason: "the photo has no pixels".to_owned() });
        }
        self.encode_pixels(preprocess(photo, self.config.image_size), photo.dimensions())
    }

    /// Encodes what [`preprocess`] made of a photo of that width and height.
    ///
    /// # Errors
    /// What the device says.
    pub fn encode_pixels(&self, pixels: Pixels, size: (u32, u32)) -> Result<Encoded<B>, NetError> {
        let stages = self.stages(pixels)?;
        let [embedding, fine, finest] = self.neck.forward(&self.backend, stages)?;
        Ok(Encoded { embedding, fine, finest, size })
    }

    /// Features at the ends of the four stages, finest first: taps for tests.
    ///
    /// # Errors
    /// What the device says.
    pub fn stages(&self, pixels: Pixels) -> Result<Vec<B::Tensor>, NetError> {
        let host = HostTensor::from_f32(&[1, pixels.height, pixels.width, 3], pixels.data);
        let x = self.backend.load(&host, self.backend.preferred())?;
        self.trunk.forward(&self.backend, x)
    }

    /// Masks for prompts, in their order; for each one mask or three.
    ///
    /// # Errors
    /// [`NetError::Input`] for a prompt without points and box, or that is not finite; and what the device says.
    pub fn predict(
        &self,
        image: &Encoded<B>,
        prompts: &[Prompt],
        masks: Masks,
    ) -> Result<Vec<Vec<MaskPrediction>>, NetError> {
        let mut answers = Vec::with_capacity(prompts.len());
        for now in self.batches(prompts) {
            answers.extend(self.decoded(image, now)?.chosen(&self.backend, masks)?);
        }
        Ok(answers)
    }

    /// All four masks and the object score of each prompt.
    ///
    /// # Errors
    /// As [`Self::predict`].
    pub fn predict_raw(&self, image: &Encoded<B>, prompts: &[Prompt]) -> Result<Vec<RawPrediction>, NetError> {
        let mut answers = Vec::with_capacity(prompts.len());
        for now in self.batches(prompts) {
            answers.extend(self.decoded(image, now)?.raw(&self.backend)?);
        }
        Ok(answers)
    }

    /// Prompts that are decoded together: they have the same number of tokens and no mask of their own.
    fn batches<'a>(&self, prompts: &'a [Prompt]) -> Vec<&'a [Prompt]> {
        let mut batches = Vec::new();
        let mut rest = prompts;
        while let Some(first) = rest.first() {
            let alike = |p: &&Prompt| p.tokens() == first.tokens() && p.mask.is_none();
            let count = rest.iter().take_while(alike).count().clamp(1, self.at_once);
            let (now, later) = rest.split_at(count);
            batches.push(now);
            rest = later;
        }
        batches
    }

    fn decoded(&self, image: &Encoded<B>, prompts: &[Prompt]) -> Result<Decoded<B>, NetError> {
        let b = &*self.backend;
        let tokens = self.prompts.tokens(prompts, image.size)?;
        let dense = match prompts.iter().find_map(|p| p.mask.as_ref()) {
            Some(mask) => self.prompts.dense(b, mask)?,
            None => self.prompts.no_mask().clone(),
        };
        let n = image.embedding.dim(1);
        let flat = b.reshape(&image.embedding, &[1, n * n, self.config.width])?;
        let keys = b.binary(flat, &dense, crate::backend::Binary::Add)?;
        self.decoder.forward(b, &keys, self.prompts.positions(), &tokens, prompts.len(), image)
    }

    /// The device.
    pub fn backend(&self) -> &B {
        &self.backend
    }
}

/// Resized to the network's square (the aspect ratio is not kept) and normalised.
pub fn preprocess(photo: &RgbImage, side: usize) -> Pixels {
    Pixels::from_photo(photo).resize_antialiased(side, side, Filter::Triangle).normalized(MEAN, STD)
}
