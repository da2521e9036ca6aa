//! The two-way transformer between prompt tokens and the image.

use super::Sam2Config;
use crate::NetError;
use crate::backend::{Act, AttentionSpec, Backend, Binary, Qkv, TensorHandle};
use crate::params::{Mlp, Norm, Params};

const HEADS: usize = 8;
const EPS: f32 = 1e-5;

/// Attention with projections into (possibly fewer) channels and back.
struct Attention<B: Backend> {
    q: B::Linear,
    k: B::Linear,
    v: B::Linear,
    out: B::Linear,
}

impl<B: Backend> Attention<B> {
    fn load(p: &Params<'_, B>, width: usize, inner: usize) -> Result<Self, NetError> {
        Ok(Self {
            q: p.linear("q_proj", inner, width)?,
            k: p.linear("k_proj", inner, width)?,
            v: p.linear("v_proj", inner, width)?,
            out: p.linear("out_proj", width, inner)?,
        })
    }

    fn forward(&self, b: &B, [q, k, v]: [&B::Tensor; 3], residual: Option<B::Tensor>) -> Result<B::Tensor, NetError> {
        let project = |x, w| b.linear(x, w, Act::None, None);
        let (mut q, k, v) = (project(q, &self.q)?, project(k, &self.k)?, project(v, &self.v)?);
        let prompts = q.dim(0).max(k.dim(0));
        let attended = if k.dim(0) < q.dim(0) {
            // Keys that all prompts share: queries do not see one another, so that they can be one batch.
            let shape = q.shape().to_vec();
            q = b.reshape(&q, &[1, shape[0] * shape[1], shape[2]])?;
            let x = b.attention(Qkv::Separate { q: &q, k: &k, v: &v }, &AttentionSpec::heads(HEADS))?;
            b.reshape(&x, &shape)?
        } else {
            let q = repeated(b, q, prompts)?;
            b.attention(Qkv::Separate { q: &q, k: &k, v: &v }, &AttentionSpec::heads(HEADS))?
        };
        b.linear(&attended, &self.out, Act::None, residual)
    }
}

/// The same for every prompt.
fn repeated<B: Backend>(b: &B, x: B::Tensor, prompts: usize) -> Result<B::Tensor, NetError> {
    if x.dim(0) == prompts { Ok(x) } else { b.concat(&vec![&x; prompts], 0) }
}

struct Block<B: Backend> {
    own: Attention<B>,
    to_image: Attention<B>,
    from_image: Attention<B>,
    norms: [Norm<B>; 4],
    mlp: Mlp<B>,
}

/// The transformer.
pub(super) struct TwoWay<B: Backend> {
    blocks: [Block<B>; 2],
    last: Attention<B>,
    norm: Norm<B>,
}

impl<B: Backend> TwoWay<B> {
    pub(super) fn load(p: &Params<'_, B>, config: &Sam2Config) -> Result<Self, NetError> {
        let (w, half) = (config.width, config.width / 2);
        let block = |i: usize| -> Result<Block<B>, NetError> {
            let p = p.at(&format!("layers.{i}"));
            let norm = |n: usize| p.norm(&format!("norm{n}"), w, EPS);
            Ok(Block {
                own: Attention::load(&p.at("self_attn"), w, w)?,
                to_image: Attention::load(&p.at("cross_attn_token_to_image"), w, half)?,
                from_image: Attention::load(&p.at("cross_attn_image_to_token"), w, half)?,
                norms: [norm(1)?, norm(2)?, norm(3)?, norm(4)?],
                mlp: p.mlp(&["mlp.layers.0", "mlp.layers.1"], &[w, config.hidden, w], Act::Relu)?,
            })
        };
        Ok(Self {
            blocks: [block(0)?, block(1)?],
            last: Attention::load(&p.at("final_attn_token_to_image"), w, half)?,
            norm: p.norm("norm_final_attn", w, EPS)?,
        })
    }

    /// Tokens `[P, T, width]` and the image `[1, N, width]` with the positions `[N, width]` of its cells, to the
    /// tokens and the image `[P, N, width]` as each prompt sees it.
    pub(super) fn forward(
        &self,
        b: &B,
        tokens: &B::Tensor,
        image: &B::Tensor,
        positions: &B::Tensor,
    ) -> Result<(B::Tensor, B::Tensor), NetError> {
        let placed = |x: &B::Tensor, at: &B::Tensor| b.binary(x.clone(), at, Binary::Add);
        let (mut queries, mut keys) = (tokens.clone(), image.clone());
        for (i, block) in self.blocks.iter().enumerate() {
            let [norm1, norm2, norm3, norm4] = &block.norms;
            queries = if i == 0 {
                // The first block replaces the tokens, without positions and without a way around.
                block.own.forward(b, [&queries; 3], None)?
            } else {
                let q = placed(&queries, tokens)?;
                block.own.forward(b, [&q, &q, &queries], Some(queries.clone()))?
            };
            queries = norm1.apply(b, &queries)?;
            let q = placed(&queries, tokens)?;
            let k = placed(&keys, positions)?;
            queries = norm2.apply(b, &block.to_image.forward(b, [&q, &k, &keys], Some(queries))?)?;
            let x = block.mlp.apply(b, &queries, Some(queries.clone()))?;
            queries = norm3.apply(b, &x)?;
            let q = placed(&queries, tokens)?;
            let keys_before = repeated(b, keys, queries.dim(0))?;
            keys = norm4.apply(b, &block.from_image.forward(b, [&k, &q, &queries], Some(keys_before))?)?;
        }
        let q = placed(&queries, tokens)?;
        let k = placed(&keys, positions)?;
        let queries = self.norm.apply(b, &self.last.forward(b, [&q, &k, &keys], Some(queries))?)?;
        Ok((queries, keys))
    }
}
