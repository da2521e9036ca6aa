//! A pre-norm transformer block, and the loading of the small parts that all networks are made of.

use crate::backend::{Act, AttentionSpec, ConvWeights, LinearWeights, QkNorm, Qkv, Rope2d, Window};
use crate::{Backend, DType, NetError, Weights};

/// Loads parts of a network: a backend, an element type.
#[derive(Debug)]
pub struct Loader<'a, B> {
    /// Where to.
    pub backend: &'a B,
    /// As what.
    pub dtype: DType,
}

/// Weight and bias of a layer norm.
pub struct Norm<B: Backend> {
    weight: B::Tensor,
    bias: B::Tensor,
    eps: f32,
}

impl<B: Backend> Norm<B> {
    /// The norm of `x` over its last axis.
    pub fn run(&self, backend: &B, x: &B::Tensor) -> Result<B::Tensor, NetError> {
        backend.layer_norm(x, Some(&self.weight), Some(&self.bias), self.eps)
    }
}

impl<B: Backend> Loader<'_, B> {
    /// A tensor by itself.
    pub fn tensor(&self, at: &Weights<'_>, name: &str, shape: &[usize]) -> Result<B::Tensor, NetError> {
        self.backend.load(&at.get(name, shape)?, self.dtype)
    }

    /// A layer norm over `dim` channels.
    pub fn norm(&self, at: &Weights<'_>, dim: usize, eps: f32) -> Result<Norm<B>, NetError> {
        let load = |name: &str| self.backend.load(&at.get(name, &[dim])?, DType::F32);
        Ok(Norm { weight: load("weight")?, bias: load("bias")?, eps })
    }

    /// A linear layer with bias, `input` to `output` channels; `scale` is a layer scale's key beside it.
    pub fn linear(
        &self,
        at: &Weights<'_>,
        output: usize,
        input: usize,
        scale: Option<(&Weights<'_>, &str)>,
    ) -> Result<B::Linear, NetError> {
        let weights = LinearWeights {
            weight: at.get("weight", &[output, input])?,
            bias: Some(at.get("bias", &[output])?),
            scale: scale.map(|(at, name)| at.get(name, &[output])).transpose()?,
        };
        self.backend.load_linear(&weights, self.dtype)
    }

    /// A convolution with a square kernel of side `side`.
    pub fn conv(
        &self,
        at: &Weights<'_>,
        [output, input, side]: [usize; 3],
        window: Window,
        bias: bool,
    ) -> Result<B::Conv, NetError> {
        let weights = ConvWeights {
            weight: at.get("weight", &[output, input, side, side])?,
            bias: bias.then(|| at.get("bias", &[output])).transpose()?,
        };
        self.backend.load_conv(&weights, window, self.dtype)
    }

    /// A transposed convolution whose stride is its kernel's side.
    pub fn conv_transpose(&self, at: &Weights<'_>, [input, output, side]: [usize; 3]) -> Result<B::Conv, NetError> {
        let weights = ConvWeights {
            weight: at.get("weight", &[input, output, side, side])?,
            bias: Some(at.get("bias", &[output])?),
        };
        self.backend.load_conv_transpose(&weights, self.dtype)
    }
}

/// Sizes of a block.
#[derive(Debug, Clone, Copy)]
pub struct BlockSize {
    /// Channels.
    pub dim: usize,
    /// Heads.
    pub heads: usize,
    /// Epsilon of its two norms.
    pub eps: f32,
    /// Whether queries and keys are normed a head (epsilon 1e-5).
    pub qk_norm: bool,
}

/// `x += ls1 attn(norm1 x); x += ls2 mlp(norm2 x)`, GELU, four times as wide inside.
pub struct Block<B: Backend> {
    size: BlockSize,
    norm1: Norm<B>,
    qkv: B::Linear,
    qk_norm: Option<[B::Tensor; 4]>,
    proj: B::Linear,
    norm2: Norm<B>,
    fc1: B::Linear,
    fc2: B::Linear,
}

impl<B: Backend> Block<B> {
    /// Loads a block.
    pub fn load(loader: &Loader<'_, B>, at: &Weights<'_>, size: BlockSize) -> Result<Self, NetError> {
        let BlockSize { dim, heads, eps, qk_norm } = size;
        let head = dim / heads.max(1);
        let small = |name: &str| loader.backend.load(&at.get(name, &[head])?, DType::F32);
        let qk_norm = if qk_norm {
            let keys = ["attn.q_norm.weight", "attn.q_norm.bias", "attn.k_norm.weight", "attn.k_norm.bias"];
            let [a, b, c, d] = keys.map(small);
            Some([a?, b?, c?, d?])
        } else {
            None
        };
        Ok(Self {
            size,
            norm1: loader.norm(&at.at("norm1"), dim, eps)?,
            qkv: loader.linear(&at.at("attn.qkv"), 3 * dim, dim, None)?,
            qk_norm,
            proj: loader.linear(&at.at("attn.proj"), dim, dim, Some((at, "ls1.gamma")))?,
            norm2: loader.norm(&at.at("norm2"), dim, eps)?,
            fc1: loader.linear(&at.at("mlp.fc1"), 4 * dim, dim, None)?,
            fc2: loader.linear(&at.at("mlp.fc2"), dim, 4 * dim, Some((at, "ls2.gamma")))?,
        })
    }

    /// Runs it on tokens `[B, N, dim]`.
    pub fn run(&self, backend: &B, x: B::Tensor, rope: Option<Rope2d<'_, B::Tensor>>) -> Result<B::Tensor, NetError> {
        let qkv = backend.linear(&self.norm1.run(backend, &x)?, &self.qkv, Act::None, None)?;
        let qk_norm = self.qk_norm.as_ref().map(|[q_weight, q_bias, k_weight, k_bias]| QkNorm {
            q_weight,
            q_bias,
            k_weight,
            k_bias,
            eps: 1e-5,
        });
        let spec = AttentionSpec { qk_norm, rope, ..AttentionSpec::heads(self.size.heads) };
        let seen = backend.attention(Qkv::Packed(&qkv), &spec)?;
        drop(qkv);
        let x = backend.linear(&seen, &self.proj, Act::None, Some(x))?;
        drop(seen);
        let inner = backend.linear(&self.norm2.run(backend, &x)?, &self.fc1, Act::Gelu, None)?;
        backend.linear(&inner, &self.fc2, Act::None, Some(x))
    }
}
