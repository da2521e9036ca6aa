//! Weights by key: where they come from, and layers made of them.

use crate::backend::{Act, Backend, ConvWeights, LinearWeights, Window};
use crate::{DType, HostTensor, NetError, WeightError, WeightFile, Weights};

/// A checkpoint, or something that behaves like one.
pub trait WeightSource {
    /// The tensor under a key, which must have this shape.
    ///
    /// # Errors
    /// [`WeightError::MissingKey`], [`WeightError::WrongShape`], [`WeightError::WrongType`].
    fn tensor(&self, key: &str, shape: &[usize]) -> Result<HostTensor, WeightError>;

    /// Whether there is such a key.
    fn has(&self, key: &str) -> bool;
}

impl WeightSource for Weights<'_> {
    fn tensor(&self, key: &str, shape: &[usize]) -> Result<HostTensor, WeightError> {
        self.get(key, shape)
    }

    fn has(&self, key: &str) -> bool {
        Weights::has(self, key)
    }
}

impl WeightSource for WeightFile {
    fn tensor(&self, key: &str, shape: &[usize]) -> Result<HostTensor, WeightError> {
        self.get(key, shape)
    }

    fn has(&self, key: &str) -> bool {
        self.find(key).is_some()
    }
}

/// Weights under a common prefix, put on a device as they are asked for.
pub struct Params<'a, B: Backend> {
    /// The device.
    pub backend: &'a B,
    source: &'a dyn WeightSource,
    prefix: String,
    /// Element type of matrices and filters; norms are kept in f32.
    dtype: DType,
}

/// A layer norm's weights.
#[derive(Debug)]
pub struct Norm<B: Backend> {
    weight: B::Tensor,
    bias: B::Tensor,
    eps: f32,
}

impl<B: Backend> Norm<B> {
    /// The norm of `x` over its last axis.
    ///
    /// # Errors
    /// As [`Backend::layer_norm`].
    pub fn apply(&self, backend: &B, x: &B::Tensor) -> Result<B::Tensor, NetError> {
        backend.layer_norm(x, Some(&self.weight), Some(&self.bias), self.eps)
    }
}

/// Linear layers one after the other, with an activation between them.
pub struct Mlp<B: Backend> {
    layers: Vec<B::Linear>,
    between: Act,
}

impl<B: Backend> Mlp<B> {
    /// The layers applied to the last axis of `x`.
    ///
    /// # Errors
    /// As [`Backend::linear`].
    pub fn apply(&self, backend: &B, x: &B::Tensor, residual: Option<B::Tensor>) -> Result<B::Tensor, NetError> {
        let Some((last, front)) = self.layers.split_last() else { return Ok(x.clone()) };
        let mut x = x.clone();
        for layer in front {
            x = backend.linear(&x, layer, self.between, None)?;
        }
        backend.linear(&x, last, Act::None, residual)
    }
}

#[expect(clippy::missing_errors_doc, reason = "all: what the source says of the key, what the device says")]
impl<'a, B: Backend> Params<'a, B> {
    /// All weights of a source.
    pub fn new(backend: &'a B, source: &'a dyn WeightSource, dtype: DType) -> Self {
        Self { backend, source, prefix: String::new(), dtype }
    }

    /// The weights below `name`.
    #[must_use]
    pub fn at(&self, name: &str) -> Self {
        Self { prefix: self.key(name), ..*self }
    }

    /// The same weights as another element type.
    #[must_use]
    pub fn as_type(&self, dtype: DType) -> Self {
        Self { prefix: self.prefix.clone(), dtype, ..*self }
    }

    /// A full key.
    pub fn key(&self, name: &str) -> String {
        if self.prefix.is_empty() { name.to_owned() } else { format!("{}.{name}", self.prefix) }
    }

    /// Whether there is such a weight.
    pub fn has(&self, name: &str) -> bool {
        self.source.has(&self.key(name))
    }

    /// A weight on the host.
    pub fn host(&self, name: &str, shape: &[usize]) -> Result<HostTensor, NetError> {
        Ok(self.source.tensor(&self.key(name), shape)?)
    }

    /// A weight on the device, as f32.
    pub fn tensor(&self, name: &str, shape: &[usize]) -> Result<B::Tensor, NetError> {
        self.backend.load(&self.host(name, shape)?, DType::F32)
    }

    /// `{name}.weight` and `{name}.bias`.
    pub fn linear(&self, name: &str, out: usize, input: usize) -> Result<B::Linear, NetError> {
        let weight = self.host(&format!("{name}.weight"), &[out, input])?;
        self.loaded(weight, Some(self.host(&format!("{name}.bias"), &[out])?))
    }

    /// `{name}.weight` alone.
    pub fn linear_without_bias(&self, name: &str, out: usize, input: usize) -> Result<B::Linear, NetError> {
        self.loaded(self.host(&format!("{name}.weight"), &[out, input])?, None)
    }

    /// Several linear layers over the same input as one, their results next to each other.
    pub fn fused(&self, names: &[&str], out: usize, input: usize) -> Result<B::Linear, NetError> {
        let (mut weight, mut bias) = (Vec::with_capacity(names.len() * out * input), Vec::new());
        for name in names {
            weight.extend(self.host(&format!("{name}.weight"), &[out, input])?.to_f32());
            bias.extend(self.host(&format!("{name}.bias"), &[out])?.to_f32());
        }
        let all = names.len() * out;
        self.loaded(HostTensor::from_f32(&[all, input], weight), Some(HostTensor::from_f32(&[all], bias)))
    }

    /// A linear layer of weights on the host.
    pub fn loaded(&self, weight: HostTensor, bias: Option<HostTensor>) -> Result<B::Linear, NetError> {
        self.backend.load_linear(&LinearWeights { weight, bias, scale: None }, self.dtype)
    }

    /// `{name}.{i}` for each of `widths` but the first: layers from each width to the next.
    pub fn mlp(&self, names: &[&str], widths: &[usize], between: Act) -> Result<Mlp<B>, NetError> {
        let layer = |(name, w): (&&str, &[usize])| self.linear(name, w[1], w[0]);
        let layers = names.iter().zip(widths.windows(2)).map(layer).collect::<Result<_, _>>()?;
        Ok(Mlp { layers, between })
    }

    /// A layer norm over `width` numbers.
    pub fn norm(&self, name: &str, width: usize, eps: f32) -> Result<Norm<B>, NetError> {
        let part = |part: &str| self.tensor(&format!("{name}.{part}"), &[width]);
        Ok(Norm { weight: part("weight")?, bias: part("bias")?, eps })
    }

    /// A convolution; `shape` is `[out, in, kh, kw]`.
    pub fn conv(&self, name: &str, shape: [usize; 4], window: Window) -> Result<B::Conv, NetError> {
        self.backend.load_conv(&self.conv_weights(name, shape, shape[0])?, window, self.dtype)
    }

    /// A transposed convolution; `shape` is `[in, out, k, k]`, its stride `k`.
    pub fn conv_transpose(&self, name: &str, shape: [usize; 4]) -> Result<B::Conv, NetError> {
        self.backend.load_conv_transpose(&self.conv_weights(name, shape, shape[1])?, self.dtype)
    }

    fn conv_weights(&self, name: &str, shape: [usize; 4], out: usize) -> Result<ConvWeights, NetError> {
        let weight = self.host(&format!("{name}.weight"), &shape)?;
        Ok(ConvWeights { weight, bias: Some(self.host(&format!("{name}.bias"), &[out])?) })
    }

    /// A convolution of one pixel, as a linear layer; the weight is `[out, in, 1, 1]` in the file.
    pub fn pointwise(&self, name: &str, out: usize, input: usize) -> Result<(HostTensor, HostTensor), NetError> {
        let weight = self.host(&format!("{name}.weight"), &[out, input, 1, 1])?;
        let weight = weight.reshaped(&[out, input]).unwrap_or(weight);
        Ok((weight, self.host(&format!("{name}.bias"), &[out])?))
    }
}
