//! The two ways in which CLIP's weights are named.

use super::transposed;
use crate::NetError;
use crate::backend::Backend;
use crate::params::{Norm, Params, WeightSource};

/// Who named the weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// transformers: `vision_model.encoder.layers.N.self_attn.q_proj` and so on.
    Transformers,
    /// OpenAI: `visual.transformer.resblocks.N.attn.in_proj_weight` and so on.
    OpenAi,
}

/// Names inside one block.
pub(super) struct BlockNames {
    pub(super) block: String,
    pub(super) norm1: &'static str,
    pub(super) norm2: &'static str,
    pub(super) out: &'static str,
    pub(super) up: &'static str,
    pub(super) down: &'static str,
}

impl Layout {
    /// Spelt so in CLIP's checkpoints.
    pub const CLIP_PRE_NORM: &'static str = "pre_layrnorm";
    /// Spelt so in OWLv2's.
    pub const OWL_PRE_NORM: &'static str = "pre_layernorm";

    /// By a key that only OpenAI's has; missing keys are told in the names of transformers otherwise.
    pub fn of(weights: &dyn WeightSource) -> Self {
        if weights.has("visual.conv1.weight") { Self::OpenAi } else { Self::Transformers }
    }

    pub(super) fn block(self, tower: &str, i: usize) -> BlockNames {
        match self {
            Self::Transformers => BlockNames {
                block: format!("{tower}.encoder.layers.{i}"),
                norm1: "layer_norm1",
                norm2: "layer_norm2",
                out: "self_attn.out_proj",
                up: "mlp.fc1",
                down: "mlp.fc2",
            },
            Self::OpenAi => BlockNames {
                block: match tower {
                    "vision_model" => format!("visual.transformer.resblocks.{i}"),
                    _ => format!("transformer.resblocks.{i}"),
                },
                norm1: "ln_1",
                norm2: "ln_2",
                out: "attn.out_proj",
                up: "mlp.c_fc",
                down: "mlp.c_proj",
            },
        }
    }

    /// Queries, keys and values of a block as one layer.
    pub(super) fn qkv<B: Backend>(self, block: &Params<'_, B>, width: usize) -> Result<B::Linear, NetError> {
        match self {
            Self::Transformers => {
                block.fused(&["self_attn.q_proj", "self_attn.k_proj", "self_attn.v_proj"], width, width)
            }
            Self::OpenAi => {
                let weight = block.host("attn.in_proj_weight", &[3 * width, width])?;
                block.loaded(weight, Some(block.host("attn.in_proj_bias", &[3 * width])?))
            }
        }
    }

    /// A projection without bias; OpenAI keeps it as `[in, out]` under a name of its own.
    pub(super) fn projection<B: Backend>(
        self,
        p: &Params<'_, B>,
        name: &str,
        openai: &str,
        out: usize,
        input: usize,
    ) -> Result<B::Linear, NetError> {
        match self {
            Self::Transformers => p.linear_without_bias(name, out, input),
            Self::OpenAi => p.loaded(transposed(&p.host(openai, &[input, out])?, input, out), None),
        }
    }

    /// A norm by both of its names.
    pub(super) fn norm<B: Backend>(
        self,
        p: &Params<'_, B>,
        name: &str,
        openai: &str,
        width: usize,
    ) -> Result<Norm<B>, NetError> {
        p.norm(self.pick(name, openai), width, super::transformer::EPS)
    }

    pub(super) fn pick<'a>(self, transformers: &'a str, openai: &'a str) -> &'a str {
        match self {
            Self::Transformers => transformers,
            Self::OpenAi => openai,
        }
    }
}
