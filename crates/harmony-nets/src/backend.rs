//! What a network asks of a device: a thin layer of fused operations.
//!
//! Model code is written once, generic over [`Backend`]. Operations are as large as what a device can do well in one
//! go (a linear layer with bias, activation, layer scale and residual; attention with query/key norms and rotary
//! positions), not single tensor operations.
//!
//! # Rules for every operation
//! - Tensors are row-major and contiguous. Images are NHWC. Shapes stand in the docs as `[A, B, C]`.
//! - A tensor is an opaque handle, cheap to clone; its values may be in device memory and not computed yet.
//!   Only [`Backend::read`] waits for them.
//! - Values are never changed under a handle that somebody else holds. A tensor that is passed *by value* (residuals)
//!   may be overwritten when nobody else holds it.
//! - The result has the element type of the first tensor argument. Norms, softmax and sums are accumulated in f32
//!   whatever the type.
//! - Shapes that do not fit are [`NetError::Shape`], never a panic.
//! - No operation but [`Backend::read`] depends on values, so that a chain of operations can be recorded and replayed
//!   (see [`Backend::replayable`]).
//!
//! [`crate::reference::Reference`] is the oracle: plain loops, f32 (sums in f64), right and slow.

use std::fmt::Debug;

use crate::{DType, HostTensor, NetError};

/// What can be asked of a handle without waiting for its values.
pub trait TensorHandle: Clone + Debug + Send + Sync {
    /// Its shape.
    fn shape(&self) -> &[usize];
    /// Its element type.
    fn dtype(&self) -> DType;

    /// Length of axis `axis`.
    ///
    /// # Panics
    /// When there is no such axis.
    fn dim(&self, axis: usize) -> usize {
        self.shape()[axis]
    }

    /// Number of elements.
    fn count(&self) -> usize {
        self.shape().iter().product()
    }
}

/// Pointwise functions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Act {
    /// `x`.
    #[default]
    None,
    /// `max(x, 0)`.
    Relu,
    /// `x/2 (1 + erf(x/sqrt 2))`, the exact one.
    Gelu,
    /// GELU by the hyperbolic tangent.
    GeluTanh,
    /// `x sigmoid(1.702 x)`, CLIP's.
    QuickGelu,
    /// `x sigmoid(x)`.
    Silu,
    /// `1 / (1 + exp -x)`.
    Sigmoid,
    /// `exp x`.
    Exp,
}

/// Pointwise functions of two tensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Binary {
    Add,
    Sub,
    Mul,
    Div,
}

/// Reductions over the last axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Reduce {
    /// Sum.
    Sum,
    /// Mean.
    Mean,
    /// Largest.
    Max,
}

/// How an image is resized. Sizes are given; the scale of each axis follows from them (no scale-factor tricks).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Resize {
    /// `src = floor(dst * in/out)`.
    Nearest,
    /// Linear, pixel centres at +0.5 (`align_corners = false`), edge pixels repeated, no antialiasing.
    Bilinear,
    /// Linear, corner pixels on corner pixels (`align_corners = true`).
    BilinearCorners,
    /// Cubic with `a = -0.75`, pixel centres at +0.5, edge pixels repeated, no antialiasing (PyTorch's bicubic).
    Bicubic,
}

/// Kinds of pooling.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Pool {
    /// Largest; padding never wins.
    Max,
    /// Mean; padding counts as zero.
    Mean,
}

/// Window of a pooling or the geometry of a convolution; the same along both axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Window {
    /// Side of the window in pixels. For convolutions it comes from the weight, and this is not looked at.
    pub size: usize,
    /// Step in pixels.
    pub stride: usize,
    /// Zeros around the image (for [`Pool::Max`]: minus infinity).
    pub padding: usize,
}

impl Window {
    /// Stride and padding of a convolution.
    pub fn conv(stride: usize, padding: usize) -> Self {
        Self { size: 0, stride, padding }
    }

    /// Output length for input length `n` with a window of `size`, or `None` when the window does not fit.
    pub fn output(self, n: usize, size: usize) -> Option<usize> {
        (size > 0 && self.stride > 0).then_some(())?;
        Some((n + 2 * self.padding).checked_sub(size)? / self.stride + 1)
    }
}

/// Weights of a linear layer on the host: `y = scale .* act(x weight^T + bias)`.
#[derive(Debug, Clone)]
pub struct LinearWeights {
    /// `[out, in]`, PyTorch's order.
    pub weight: HostTensor,
    /// `[out]`.
    pub bias: Option<HostTensor>,
    /// Layer scale `[out]`, applied after the activation and before the residual. A backend may fold it into weight
    /// and bias when the layer is used without an activation (it then has to refuse one in [`Backend::linear`]).
    pub scale: Option<HostTensor>,
}

/// Weights of a convolution on the host.
#[derive(Debug, Clone)]
pub struct ConvWeights {
    /// `[out, in, kh, kw]` for a convolution, `[in, out, kh, kw]` for a transposed one (PyTorch's orders).
    pub weight: HostTensor,
    /// `[out]`.
    pub bias: Option<HostTensor>,
}

/// Queries, keys and values.
#[derive(Debug, Clone, Copy)]
pub enum Qkv<'a, T> {
    /// One tensor `[B, N, 3 * heads * D]`: queries, keys, values, each head-major (the output of a fused projection).
    Packed(&'a T),
    /// Three tensors `[B, Nq, heads * D]`, `[B, Nk, heads * D]`, `[B, Nk, heads * Dv]`.
    Separate {
        /// Queries.
        q: &'a T,
        /// Keys.
        k: &'a T,
        /// Values.
        v: &'a T,
    },
}

/// Layer norms over each head of queries and keys, before rotary positions. Each tensor is f32-loaded `[D]`.
#[derive(Debug, Clone, Copy)]
pub struct QkNorm<'a, T> {
    /// Weight for queries.
    pub q_weight: &'a T,
    /// Bias for queries.
    pub q_bias: &'a T,
    /// Weight for keys.
    pub k_weight: &'a T,
    /// Bias for keys.
    pub k_bias: &'a T,
    /// Epsilon of both.
    pub eps: f32,
}

/// Rotary positions in two dimensions, for queries and keys alike (so `Nq = Nk = N`).
///
/// A head of `D` numbers is two halves, vertical then horizontal. In half `h` the numbers `j` and `j + D/4`
/// (`j < D/4`, counted inside the half) are one pair, turned by the angle at `[n, h * D/4 + j]`:
/// `(a cos - b sin, b cos + a sin)`.
#[derive(Debug, Clone, Copy)]
pub struct Rope2d<'a, T> {
    /// Cosines `[N, D/2]`, f32.
    pub cos: &'a T,
    /// Sines `[N, D/2]`, f32.
    pub sin: &'a T,
}

/// How attention is done; [`AttentionSpec::heads`] makes the plain kind.
#[derive(Debug, Clone, Copy)]
pub struct AttentionSpec<'a, T> {
    /// Number of heads.
    pub heads: usize,
    /// Factor on the scores; `None` = `1/sqrt(D)`.
    pub scale: Option<f32>,
    /// Norms of queries and keys.
    pub qk_norm: Option<QkNorm<'a, T>>,
    /// Rotary positions.
    pub rope: Option<Rope2d<'a, T>>,
    /// Query `i` sees keys `0..=i` only.
    pub causal: bool,
    /// Added to the scores, f32, `[B or 1, Nq or 1, Nk]` (the same for all heads); minus infinity hides a key.
    /// A query whose keys are all hidden gets zeros.
    pub bias: Option<&'a T>,
}

impl<T> AttentionSpec<'_, T> {
    /// Plain attention with so many heads.
    pub fn heads(heads: usize) -> Self {
        Self { heads, scale: None, qk_norm: None, rope: None, causal: false, bias: None }
    }
}

/// A device that networks run on. See the module for the rules that hold for every operation.
#[expect(clippy::missing_errors_doc, reason = "every operation: NetError::Shape, and what the device may say")]
pub trait Backend: Send + Sync {
    /// Handle of a tensor.
    type Tensor: TensorHandle;
    /// Weights of a linear layer, in whatever form suits the device.
    type Linear: Send + Sync;
    /// Weights of a convolution or transposed convolution.
    type Conv: Send + Sync;

    /// Name of the device for people, such as `cpu (avx512, 2 threads)`.
    fn device(&self) -> String;

    /// Element type that large networks should compute in here (CPU: f32, recent NVIDIA GPUs: bf16).
    /// Parts that need f32 (heads) ask for it by name.
    fn preferred(&self) -> DType;

    /// Bytes of activations that a network may well hold at once here: by this, work that can be cut (frames of a head,
    /// prompts of one photo) is cut.
    fn room(&self) -> usize {
        256 << 20
    }

    // ---- moving values

    /// Puts a tensor on the device as `dtype`. A backend without that type keeps f32.
    fn load(&self, host: &HostTensor, dtype: DType) -> Result<Self::Tensor, NetError>;

    /// Puts the weights of a linear layer on the device.
    fn load_linear(&self, weights: &LinearWeights, dtype: DType) -> Result<Self::Linear, NetError>;

    /// Puts the weights of a convolution on the device; `window.size` is not looked at.
    fn load_conv(&self, weights: &ConvWeights, window: Window, dtype: DType) -> Result<Self::Conv, NetError>;

    /// Puts the weights of a transposed convolution on the device whose stride is its kernel's side (no overlap,
    /// no padding).
    fn load_conv_transpose(&self, weights: &ConvWeights, dtype: DType) -> Result<Self::Conv, NetError>;

    /// Waits for the values of a tensor and copies them to the host as f32.
    fn read(&self, x: &Self::Tensor) -> Result<Vec<f32>, NetError>;

    /// Another element type.
    fn cast(&self, x: &Self::Tensor, dtype: DType) -> Result<Self::Tensor, NetError>;

    /// The same values under another shape with as many elements; no copy.
    fn reshape(&self, x: &Self::Tensor, shape: &[usize]) -> Result<Self::Tensor, NetError>;

    /// Axes in another order: axis `i` of the result is axis `order[i]` of `x`.
    fn permute(&self, x: &Self::Tensor, order: &[usize]) -> Result<Self::Tensor, NetError>;

    /// Tensors one after the other along `axis`; all other axes are equal.
    fn concat(&self, parts: &[&Self::Tensor], axis: usize) -> Result<Self::Tensor, NetError>;

    /// Elements `start .. start + len` of `axis`.
    fn slice(&self, x: &Self::Tensor, axis: usize, start: usize, len: usize) -> Result<Self::Tensor, NetError>;

    /// Rows of a table: `[R, C]` by ids to `[ids.len(), C]`.
    fn gather_rows(&self, table: &Self::Tensor, ids: &[u32]) -> Result<Self::Tensor, NetError>;

    // ---- dense

    /// Linear layer over the last axis: `y = residual + scale .* act(x W^T + b)`, `[.., in]` to `[.., out]`.
    ///
    /// `residual` has the shape of the result.
    fn linear(
        &self,
        x: &Self::Tensor,
        weights: &Self::Linear,
        act: Act,
        residual: Option<Self::Tensor>,
    ) -> Result<Self::Tensor, NetError>;

    /// Batched product: `a [.., M, K]` by `b [.., K, N]`, or by `b [.., N, K]` when `b_transposed`, to `[.., M, N]`.
    /// The axes in front are equal, or `b` has none.
    fn matmul(&self, a: &Self::Tensor, b: &Self::Tensor, b_transposed: bool) -> Result<Self::Tensor, NetError>;

    /// Layer norm over the last axis; `weight` and `bias` are `[C]`.
    fn layer_norm(
        &self,
        x: &Self::Tensor,
        weight: Option<&Self::Tensor>,
        bias: Option<&Self::Tensor>,
        eps: f32,
    ) -> Result<Self::Tensor, NetError>;

    /// Multi-head attention, to `[B, Nq, heads * Dv]`. Windows are batches: see [`Backend::window_partition`].
    fn attention(
        &self,
        qkv: Qkv<'_, Self::Tensor>,
        spec: &AttentionSpec<'_, Self::Tensor>,
    ) -> Result<Self::Tensor, NetError>;

    /// Cuts `[B, H, W, C]` into windows of `side` by `side`, to `[B * rows * columns, side * side, C]`, windows
    /// row-major; the image is filled with zeros at the bottom and right up to a multiple of `side`.
    fn window_partition(&self, x: &Self::Tensor, side: usize) -> Result<Self::Tensor, NetError>;

    /// The inverse: windows `[B * rows * columns, side * side, C]` to `[B, height, width, C]`, what was filled in cut off.
    fn window_merge(
        &self,
        x: &Self::Tensor,
        side: usize,
        height: usize,
        width: usize,
    ) -> Result<Self::Tensor, NetError>;

    // ---- images

    /// Convolution: `y = residual + act(conv(x) + b)`, `[N, H, W, in]` to `[N, H', W', out]`.
    fn conv2d(
        &self,
        x: &Self::Tensor,
        weights: &Self::Conv,
        act: Act,
        residual: Option<Self::Tensor>,
    ) -> Result<Self::Tensor, NetError>;

    /// Transposed convolution with stride = kernel side `k`: `y = residual + act(convT(x) + b)`,
    /// `[N, H, W, in]` to `[N, k H, k W, out]`.
    fn conv_transpose2d(
        &self,
        x: &Self::Tensor,
        weights: &Self::Conv,
        act: Act,
        residual: Option<Self::Tensor>,
    ) -> Result<Self::Tensor, NetError>;

    /// Another size: `[N, H, W, C]` to `[N, height, width, C]`.
    fn resize(&self, x: &Self::Tensor, height: usize, width: usize, how: Resize) -> Result<Self::Tensor, NetError>;

    /// Pooling of `[N, H, W, C]`.
    fn pool2d(&self, x: &Self::Tensor, kind: Pool, window: Window) -> Result<Self::Tensor, NetError>;

    // ---- pointwise and reductions

    /// A function of every element.
    fn activation(&self, x: &Self::Tensor, act: Act) -> Result<Self::Tensor, NetError>;

    /// `a op b`; the shape of `b` is that of `a` or its end (`[C]`, `[W, C]`, ... against `[N, H, W, C]`), or `[1]`.
    /// `a` may be overwritten when nobody else holds it.
    fn binary(&self, a: Self::Tensor, b: &Self::Tensor, op: Binary) -> Result<Self::Tensor, NetError>;

    /// `factor * x + offset`.
    fn affine(&self, x: &Self::Tensor, factor: f32, offset: f32) -> Result<Self::Tensor, NetError>;

    /// Softmax over the last axis.
    fn softmax(&self, x: &Self::Tensor) -> Result<Self::Tensor, NetError>;

    /// Divides each row of the last axis by `sqrt(sum of squares) + eps`.
    fn l2_normalize(&self, x: &Self::Tensor, eps: f32) -> Result<Self::Tensor, NetError>;

    /// Reduces the last axis: `[.., C]` to `[..]` (`[C]` to `[1]`).
    fn reduce(&self, x: &Self::Tensor, how: Reduce) -> Result<Self::Tensor, NetError>;

    // ---- recording

    /// Runs `body` on `inputs`.
    ///
    /// `body` does nothing but call operations of this backend other than `load*` and [`Backend::read`]; given inputs
    /// of the same shapes it calls the same ones. A backend may therefore record the first run under `key`, and later
    /// copy `inputs` into place and replay it (CUDA graphs). Results of an earlier replay under the same key are no
    /// longer valid then: read them first. This default just runs.
    #[expect(clippy::type_complexity, reason = "a callback over handles")]
    fn replayable(
        &self,
        key: &str,
        inputs: &[&Self::Tensor],
        body: &mut dyn FnMut(&[Self::Tensor]) -> Result<Vec<Self::Tensor>, NetError>,
    ) -> Result<Vec<Self::Tensor>, NetError> {
        let _ = key;
        let inputs: Vec<Self::Tensor> = inputs.iter().map(|x| (*x).clone()).collect();
        body(&inputs)
    }
}
