//! Pre-norm transformer blocks, the same in both towers.

use super::layout::Layout;
use crate::NetError;
use crate::backend::{Act, AttentionSpec, Backend, Qkv};
use crate::params::{Mlp, Norm, Params};
use crate::residual::{added, wide};

/// Epsilon of all of CLIP's norms.
pub(super) const EPS: f32 = 1e-5;

struct Block<B: Backend> {
    norm1: Norm<B>,
    qkv: B::Linear,
    out: B::Linear,
    norm2: Norm<B>,
    mlp: Mlp<B>,
}

/// A stack of blocks.
pub(super) struct Transformer<B: Backend> {
    blocks: Vec<Block<B>>,
    heads: usize,
    causal: bool,
}

/// Numbers of a stack.
#[derive(Debug, Clone, Copy)]
pub(super) struct Depth {
    pub(super) width: usize,
    pub(super) hidden: usize,
    pub(super) layers: usize,
    pub(super) heads: usize,
    pub(super) causal: bool,
}

impl<B: Backend> Transformer<B> {
    pub(super) fn load(p: &Params<'_, B>, tower: &str, layout: Layout, depth: Depth) -> Result<Self, NetError> {
        let Depth { width, hidden, layers, heads, causal } = depth;
        let block = |i: usize| -> Result<Block<B>, NetError> {
            let names = layout.block(tower, i);
            let p = p.at(&names.block);
            Ok(Block {
                norm1: p.norm(names.norm1, width, EPS)?,
                qkv: layout.qkv(&p, width)?,
                out: p.linear(names.out, width, width)?,
                norm2: p.norm(names.norm2, width, EPS)?,
                mlp: p.mlp(&[names.up, names.down], &[width, hidden, width], Act::QuickGelu)?,
            })
        };
        Ok(Self { blocks: (0..layers).map(block).collect::<Result<_, _>>()?, heads, causal })
    }

    /// `[N, tokens, width]` to the same, in f32.
    pub(super) fn forward(&self, b: &B, x: B::Tensor) -> Result<B::Tensor, NetError> {
        let spec = AttentionSpec { causal: self.causal, ..AttentionSpec::heads(self.heads) };
        let narrow = b.preferred();
        let mut x = wide(b, x)?;
        for block in &self.blocks {
            let normed = b.cast(&block.norm1.apply(b, &x)?, narrow)?;
            let qkv = b.linear(&normed, &block.qkv, Act::None, None)?;
            drop(normed);
            let attended = b.attention(Qkv::Packed(&qkv), &spec)?;
            drop(qkv);
            x = added(b, x, |residual| b.linear(&attended, &block.out, Act::None, residual))?;
            drop(attended);
            let normed = b.cast(&block.norm2.apply(b, &x)?, narrow)?;
            x = added(b, x, |residual| block.mlp.apply(b, &normed, residual))?;
        }
        Ok(x)
    }
}
