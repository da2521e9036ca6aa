//! The mask decoder.

use rayon::prelude::*;

use super::attention::TwoWay;
use super::{Encoded, LOGIT_LIMIT, MaskLogits, MaskPrediction, Masks, RawPrediction, Sam2Config};
use crate::backend::{Act, Backend, Binary, TensorHandle};
use crate::params::{Mlp, Norm, Params};
use crate::{DType, HostTensor, NetError};

/// Masks of each prompt.
const MASKS: usize = 4;
/// Tokens before those of the prompt: object score, quality, masks.
const OWN_TOKENS: usize = 2 + MASKS;

/// Logits this far from zero count as certain in [`stability`] (upstream's `dynamic_multimask_stability_delta`).
const STABILITY_DELTA: f32 = 0.05;
/// Below this the single mask is not taken (upstream's `dynamic_multimask_stability_thresh`).
const STABILITY_LIMIT: f32 = 0.98;

/// The decoder.
pub(super) struct Decoder<B: Backend> {
    own_tokens: Vec<f32>,
    transformer: TwoWay<B>,
    up1: B::Conv,
    norm: Norm<B>,
    up2: B::Conv,
    hyper: Vec<Mlp<B>>,
    iou: Mlp<B>,
    score: Mlp<B>,
    width: usize,
}

impl<B: Backend> Decoder<B> {
    pub(super) fn load(p: &Params<'_, B>, config: &Sam2Config) -> Result<Self, NetError> {
        let w = config.width;
        let mut own_tokens = Vec::with_capacity(OWN_TOKENS * w);
        for (name, rows) in [("obj_score_token", 1), ("iou_token", 1), ("mask_tokens", MASKS)] {
            own_tokens.extend(p.host(&format!("{name}.weight"), &[rows, w])?.to_f32());
        }
        let head =
            |name: &str, widths: [usize; 4]| p.at(name).mlp(&["layers.0", "layers.1", "layers.2"], &widths, Act::Relu);
        let hyper = |i: usize| head(&format!("output_hypernetworks_mlps.{i}"), [w, w, w, w / 8]);
        Ok(Self {
            own_tokens,
            transformer: TwoWay::load(&p.at("transformer"), config)?,
            up1: p.conv_transpose("output_upscaling.0", [w, w / 4, 2, 2])?,
            norm: p.norm("output_upscaling.1", w / 4, 1e-6)?,
            up2: p.conv_transpose("output_upscaling.3", [w / 4, w / 8, 2, 2])?,
            hyper: (0..MASKS).map(hyper).collect::<Result<_, _>>()?,
            iou: head("iou_prediction_head", [w, config.iou_hidden, config.iou_hidden, MASKS])?,
            score: head("pred_obj_score_head", [w, w, w, 1])?,
            width: w,
        })
    }

    /// Masks of prompts that share the image `[1, N, width]`; `prompt_tokens` are `[prompts, tokens, width]`.
    pub(super) fn forward(
        &self,
        b: &B,
        image: &B::Tensor,
        positions: &B::Tensor,
        prompt_tokens: &[f32],
        prompts: usize,
        features: &Encoded<B>,
    ) -> Result<Decoded<B>, NetError> {
        let w = self.width;
        let mut tokens = Vec::new();
        for own in prompt_tokens.chunks_exact(prompt_tokens.len() / prompts) {
            tokens.extend_from_slice(&self.own_tokens);
            tokens.extend_from_slice(own);
        }
        let tokens = HostTensor::from_f32(&[prompts, tokens.len() / prompts / w, w], tokens);
        let tokens = b.load(&tokens, DType::F32)?;
        let (tokens, image) = self.transformer.forward(b, &tokens, image, positions)?;
        let token = |i: usize| b.slice(&tokens, 1, i, 1);

        let n = features.embedding.dim(1);
        let image = b.reshape(&image, &[prompts, n, n, w])?;
        // `[1, ..]` features against `[P, ..]`: without their first axis they are the end of the shape.
        let end = |x: &B::Tensor| b.reshape(x, &x.shape()[1..]);
        let x =
            b.binary(b.conv_transpose2d(&image, &self.up1, Act::None, None)?, &end(&features.fine)?, Binary::Add)?;
        drop(image);
        let x = b.activation(&self.norm.apply(b, &x)?, Act::Gelu)?;
        let x = b.conv_transpose2d(&x, &self.up2, Act::None, None)?;
        let x = b.activation(&b.binary(x, &end(&features.finest)?, Binary::Add)?, Act::Gelu)?;
        let side = x.dim(1);
        let x = b.reshape(&x, &[prompts, side * side, w / 8])?;

        let mut weights = Vec::with_capacity(MASKS);
        for (i, hyper) in self.hyper.iter().enumerate() {
            weights.push(hyper.apply(b, &token(2 + i)?, None)?);
        }
        let weights = b.concat(&weights.iter().collect::<Vec<_>>(), 1)?;
        let masks = b.matmul(&weights, &x, true)?;
        Ok(Decoded {
            masks: b.reshape(&masks, &[prompts * MASKS, side * side])?,
            ious: b.read(&b.activation(&self.iou.apply(b, &token(1)?, None)?, Act::Sigmoid)?)?,
            scores: b.read(&self.score.apply(b, &token(0)?, None)?)?,
            side,
        })
    }
}

/// What the decoder gives for several prompts; masks stay on the device until they are asked for, for they are large.
pub(super) struct Decoded<B: Backend> {
    /// Logits `[prompts * MASKS, side * side]`.
    masks: B::Tensor,
    ious: Vec<f32>,
    scores: Vec<f32>,
    side: usize,
}

impl<B: Backend> Decoded<B> {
    /// Everything.
    pub(super) fn raw(&self, b: &B) -> Result<Vec<RawPrediction>, NetError> {
        let all = (0..self.ious.len() as u32).collect::<Vec<_>>();
        let mut masks = self.predictions(b, &all)?.into_iter();
        let raw = |score: &f32| RawPrediction { masks: masks.by_ref().take(MASKS).collect(), object_score: *score };
        Ok(self.scores.iter().map(raw).collect())
    }

    /// The masks that are wanted of each prompt, best single one or the three.
    pub(super) fn chosen(&self, b: &B, wanted: Masks) -> Result<Vec<Vec<MaskPrediction>>, NetError> {
        let prompts = self.scores.len();
        if wanted == Masks::Three {
            let three = (0..self.ious.len()).filter(|i| i % MASKS != 0).map(|i| i as u32).collect::<Vec<_>>();
            let mut masks = self.predictions(b, &three)?.into_iter();
            return Ok((0..prompts).map(|_| masks.by_ref().take(MASKS - 1).collect()).collect());
        }
        let first = (0..prompts).map(|i| (i * MASKS) as u32).collect::<Vec<_>>();
        let mut answers = self.predictions(b, &first)?;
        let ious = |i: usize| &self.ious[i * MASKS..(i + 1) * MASKS];
        let best = |(i, mask): (usize, &MaskPrediction)| (i, best(&mask.logits.values, ious(i)));
        let others = answers.par_iter().enumerate().map(best).filter(|(_, at)| *at > 0).collect::<Vec<_>>();
        let rows = others.iter().map(|(i, at)| (i * MASKS + at) as u32).collect::<Vec<_>>();
        for ((i, _), mask) in others.into_iter().zip(self.predictions(b, &rows)?) {
            answers[i] = mask;
        }
        Ok(answers.into_iter().map(|mask| vec![mask]).collect())
    }

    fn predictions(&self, b: &B, rows: &[u32]) -> Result<Vec<MaskPrediction>, NetError> {
        if rows.is_empty() {
            return Ok(Vec::new());
        }
        let values = b.read(&b.gather_rows(&self.masks, rows)?)?;
        let mask = |(values, row): (&[f32], &u32)| MaskPrediction {
            logits: MaskLogits { side: self.side, values: values.to_vec() },
            iou: self.ious[*row as usize],
        };
        Ok(values.par_chunks_exact(self.side * self.side).zip(rows).map(mask).collect())
    }
}

/// Which of a prompt's masks is the best single one, by the logits of the first and the qualities of all.
fn best(first: &[f32], ious: &[f32]) -> usize {
    let mut at = 0;
    if stability(first) < STABILITY_LIMIT {
        // The first of equals, as upstream's argmax.
        at = 1;
        for i in 2..ious.len() {
            if ious[i] > ious[at] {
                at = i;
            }
        }
    }
    at
}

impl MaskLogits {
    /// Kept within the limits that upstream sets for masks that become prompts again.
    #[must_use]
    pub fn for_reuse(mut self) -> Self {
        self.values.iter_mut().for_each(|v| *v = v.clamp(-LOGIT_LIMIT, LOGIT_LIMIT));
        self
    }
}

/// How little a mask depends on the threshold: the area well above zero over the area not well below it.
fn stability(logits: &[f32]) -> f32 {
    let above = |limit: f32| logits.iter().filter(|v| **v > limit).count() as f32;
    let (inner, outer) = (above(STABILITY_DELTA), above(-STABILITY_DELTA));
    if outer > 0.0 { inner / outer } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stable_single_mask_is_taken_and_an_unstable_one_gives_way_to_the_best_of_three() {
        assert_eq!(best(&[5.0, 5.0, -5.0, -5.0], &[0.1, 0.2, 0.9, 0.9]), 0);
        assert_eq!(best(&[5.0, 0.01, -5.0, -5.0], &[0.99, 0.2, 0.9, 0.9]), 2);
        // Nothing inside at all counts as stable.
        assert_eq!(best(&[-5.0; 4], &[0.1, 0.2, 0.9, 0.9]), 0);
    }
}
