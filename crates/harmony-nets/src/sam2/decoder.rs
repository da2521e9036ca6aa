//! The mask decoder.

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
    ) -> Result<Vec<RawPrediction>, NetError> {
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
        let masks = b.read(&b.matmul(&weights, &x, true)?)?;
        let ious = b.read(&b.activation(&self.iou.apply(b, &token(1)?, None)?, Act::Sigmoid)?)?;
        let scores = b.read(&self.score.apply(b, &token(0)?, None)?)?;

        let mask = |(values, iou): (&[f32], &f32)| MaskPrediction {
            logits: MaskLogits { side, values: values.to_vec() },
            iou: *iou,
        };
        let all = masks.chunks_exact(MASKS * side * side).zip(ious.chunks_exact(MASKS)).zip(scores);
        let raw = all.map(|((masks, ious), object_score)| RawPrediction {
            masks: masks.chunks_exact(side * side).zip(ious).map(mask).collect(),
            object_score,
        });
        Ok(raw.collect())
    }
}

/// The masks that are wanted, best single one or the three.
pub(super) fn choose(raw: RawPrediction, wanted: Masks) -> Vec<MaskPrediction> {
    let mut masks = raw.masks;
    if wanted == Masks::Three || masks.len() < 2 {
        return masks.split_off(masks.len().min(1));
    }
    let mut at = 0;
    if stability(&masks[0].logits.values) < STABILITY_LIMIT {
        // The first of equals, as upstream's argmax.
        at = 1;
        for i in 2..masks.len() {
            if masks[i].iou > masks[at].iou {
                at = i;
            }
        }
    }
    vec![masks.swap_remove(at)]
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

    fn mask(values: [f32; 4], iou: f32) -> MaskPrediction {
        MaskPrediction { logits: MaskLogits { side: 2, values: values.to_vec() }, iou }
    }

    #[test]
    fn a_stable_single_mask_is_taken_and_an_unstable_one_gives_way_to_the_best_of_three() {
        let three = [mask([1.0; 4], 0.2), mask([2.0; 4], 0.9), mask([3.0; 4], 0.9)];
        let raw = |first| RawPrediction { masks: [vec![first], three.to_vec()].concat(), object_score: 0.0 };
        let stable = mask([5.0, 5.0, -5.0, -5.0], 0.1);
        assert_eq!(choose(raw(stable.clone()), Masks::Best), std::slice::from_ref(&stable));
        let unstable = mask([5.0, 0.01, -5.0, -5.0], 0.99);
        assert_eq!(choose(raw(unstable), Masks::Best), [three[1].clone()]);
        assert_eq!(choose(raw(stable), Masks::Three), three);
        // Nothing inside at all counts as stable.
        let empty = mask([-5.0; 4], 0.1);
        assert_eq!(choose(raw(empty.clone()), Masks::Best), [empty]);
    }
}
