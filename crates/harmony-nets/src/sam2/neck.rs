//! The feature pyramid after the trunk, and the decoder's projections of its fine levels.

use super::Sam2Config;
use crate::backend::{Act, Backend, Binary, Resize, TensorHandle};
use crate::params::Params;
use crate::residual::added;
use crate::{HostTensor, NetError};

/// The neck.
pub(super) struct Neck<B: Backend> {
    coarsest: B::Linear,
    coarse: B::Linear,
    fine: B::Linear,
    finest: B::Linear,
    no_memory: B::Tensor,
}

impl<B: Backend> Neck<B> {
    pub(super) fn load(p: &Params<'_, B>, config: &Sam2Config) -> Result<Self, NetError> {
        let c = config.channels();
        let w = config.width;
        let convs = p.at("image_encoder.neck.convs");
        // `convs.0` belongs to the coarsest level.
        let level = |i: usize| convs.pointwise(&format!("{}.conv", 3 - i), w, c[i]);
        let plain = |i: usize| {
            let (weight, bias) = level(i)?;
            p.loaded(weight, Some(bias))
        };
        // The fine levels get nothing from above and go nowhere but into one more projection: the two become one.
        let folded = |i: usize, name: &str, out: usize| {
            let after = p.at("sam_mask_decoder").pointwise(name, out, w)?;
            let (weight, bias) = fold(&level(i)?, &after, [out, w, c[i]]);
            p.loaded(weight, Some(bias))
        };
        let no_memory = p.backend.reshape(&p.tensor("no_mem_embed", &[1, 1, w])?, &[w])?;
        Ok(Self {
            coarsest: plain(3)?,
            coarse: plain(2)?,
            fine: folded(1, "conv_s1", w / 4)?,
            finest: folded(0, "conv_s0", w / 8)?,
            no_memory,
        })
    }

    /// The four stages, finest first and f32, to the image embedding and the two fine levels, f32 as well.
    pub(super) fn forward(&self, b: &B, stages: Vec<B::Tensor>) -> Result<[B::Tensor; 3], NetError> {
        let [finest, fine, coarse, coarsest] = <[B::Tensor; 4]>::try_from(stages)
            .map_err(|s| NetError::shape("SAM 2 neck", format!("{} stages, wanted four", s.len())))?;
        let linear = |x: &B::Tensor, w: &B::Linear, residual| b.linear(x, w, Act::None, residual);
        let above = linear(&coarsest, &self.coarsest, None)?;
        let above = b.resize(&above, coarse.dim(1), coarse.dim(2), Resize::Nearest)?;
        let embedding = added(b, above, |residual| linear(&coarse, &self.coarse, residual))?;
        let embedding = b.binary(embedding, &self.no_memory, Binary::Add)?;
        Ok([embedding, linear(&fine, &self.fine, None)?, linear(&finest, &self.finest, None)?])
    }
}

/// Two linear layers as one: `after (before x + b) + a`.
fn fold(
    (before, b): &(HostTensor, HostTensor),
    (after, a): &(HostTensor, HostTensor),
    [out, mid, input]: [usize; 3],
) -> (HostTensor, HostTensor) {
    let (before, b, after, a) = (before.to_f32(), b.to_f32(), after.to_f32(), a.to_f32());
    let mut weight = Vec::with_capacity(out * input);
    let mut bias = Vec::with_capacity(out);
    for o in 0..out {
        let row = &after[o * mid..(o + 1) * mid];
        let mut sums = vec![0f64; input];
        for (w, from) in row.iter().zip(before.chunks_exact(input)) {
            for (sum, v) in sums.iter_mut().zip(from) {
                *sum += f64::from(*w) * f64::from(*v);
            }
        }
        weight.extend(sums.iter().map(|s| *s as f32));
        let shift: f64 = row.iter().zip(&b).map(|(w, b)| f64::from(*w) * f64::from(*b)).sum();
        bias.push((shift + f64::from(a[o])) as f32);
    }
    (HostTensor::from_f32(&[out, input], weight), HostTensor::from_f32(&[out], bias))
}
