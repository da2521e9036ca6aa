//! The oracle: every operation as plain loops, f32 values, sums in f64. Right and slow; for tests.

use std::sync::Arc;

use crate::backend::{
    Act, AttentionSpec, Backend, Binary, ConvWeights, LinearWeights, Pool, Qkv, Reduce, Resize, Rope2d, TensorHandle,
    Window,
};
use crate::host::{self, Dims4};
use crate::math;
use crate::{DType, HostTensor, NetError};

/// The reference backend.
#[derive(Debug, Clone, Copy, Default)]
pub struct Reference;

/// A tensor of the reference backend.
#[derive(Debug, Clone)]
pub struct Array {
    shape: Vec<usize>,
    data: Arc<Vec<f32>>,
}

impl TensorHandle for Array {
    fn shape(&self) -> &[usize] {
        &self.shape
    }
    fn dtype(&self) -> DType {
        DType::F32
    }
}

impl Array {
    fn new(shape: Vec<usize>, data: Vec<f32>) -> Self {
        debug_assert_eq!(shape.iter().product::<usize>(), data.len());
        Self { shape, data: Arc::new(data) }
    }

    fn of(host: &HostTensor) -> Self {
        Self::new(host.shape().to_vec(), host.to_f32())
    }

    fn with_last(&self, last: usize, data: Vec<f32>) -> Self {
        Self::new(host::with_last(&self.shape, last), data)
    }
}

/// Weights of a linear layer.
#[derive(Debug)]
pub struct RefLinear {
    weight: Array,
    bias: Option<Array>,
    scale: Option<Array>,
}

/// Weights of a convolution.
#[derive(Debug)]
pub struct RefConv {
    weight: Array,
    bias: Option<Array>,
    window: Option<Window>,
}

fn value(x: Option<&Array>, i: usize, otherwise: f32) -> f64 {
    f64::from(x.map_or(otherwise, |x| x.data[i]))
}

fn apply(act: Act, x: f64) -> f64 {
    match act {
        Act::None => x,
        Act::Relu => x.max(0.0),
        Act::Gelu => 0.5 * x * (1.0 + math::erf(x / std::f64::consts::SQRT_2)),
        Act::GeluTanh => 0.5 * x * (1.0 + ((2.0 / std::f64::consts::PI).sqrt() * (x + 0.044_715 * x * x * x)).tanh()),
        Act::QuickGelu => x / (1.0 + (-1.702 * x).exp()),
        Act::Silu => x / (1.0 + (-x).exp()),
        Act::Sigmoid => 1.0 / (1.0 + (-x).exp()),
        Act::Exp => x.exp(),
    }
}

/// One head of queries or keys, normed and turned.
fn prepare_head(x: &mut [f64], norm: Option<(&Array, &Array, f32)>, rope: Option<&Rope2d<'_, Array>>, token: usize) {
    if let Some((weight, bias, eps)) = norm {
        layer_norm_row(x, Some(weight), Some(bias), eps);
    }
    if let Some(rope) = rope {
        let quarter = x.len() / 4;
        for half in 0..2 {
            for j in 0..quarter {
                let at = token * 2 * quarter + half * quarter + j;
                let (c, s) = (f64::from(rope.cos.data[at]), f64::from(rope.sin.data[at]));
                let (i, k) = (half * 2 * quarter + j, half * 2 * quarter + quarter + j);
                (x[i], x[k]) = (x[i] * c - x[k] * s, x[k] * c + x[i] * s);
            }
        }
    }
}

fn layer_norm_row(row: &mut [f64], weight: Option<&Array>, bias: Option<&Array>, eps: f32) {
    let n = row.len() as f64;
    let mean = row.iter().sum::<f64>() / n;
    let variance = row.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    let inv = 1.0 / (variance + f64::from(eps)).sqrt();
    for (i, v) in row.iter_mut().enumerate() {
        *v = (*v - mean) * inv * value(weight, i, 1.0) + value(bias, i, 0.0);
    }
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|v| f64::from(*v)).collect()
}

fn narrow(x: &[f64]) -> Vec<f32> {
    x.iter().map(|v| *v as f32).collect()
}

fn rows(x: &Array, mut f: impl FnMut(&mut [f64])) -> Array {
    let c = host::last(&x.shape);
    let mut data = Vec::with_capacity(x.data.len());
    for row in x.data.chunks_exact(c) {
        let mut row = wide(row);
        f(&mut row);
        data.extend(narrow(&row));
    }
    Array::new(x.shape.clone(), data)
}

fn add_residual(mut y: Vec<f64>, residual: Option<&Array>) -> Vec<f32> {
    if let Some(r) = residual {
        y.iter_mut().zip(r.data.iter()).for_each(|(y, r)| *y += f64::from(*r));
    }
    narrow(&y)
}

impl Backend for Reference {
    type Tensor = Array;
    type Linear = RefLinear;
    type Conv = RefConv;

    fn device(&self) -> String {
        "cpu (reference)".into()
    }

    fn preferred(&self) -> DType {
        DType::F32
    }

    fn load(&self, host: &HostTensor, _dtype: DType) -> Result<Array, NetError> {
        Ok(Array::of(host))
    }

    fn load_linear(&self, weights: &LinearWeights, _dtype: DType) -> Result<RefLinear, NetError> {
        host::check_linear(weights)?;
        Ok(RefLinear {
            weight: Array::of(&weights.weight),
            bias: weights.bias.as_ref().map(Array::of),
            scale: weights.scale.as_ref().map(Array::of),
        })
    }

    fn load_conv(&self, weights: &ConvWeights, window: Window, _dtype: DType) -> Result<RefConv, NetError> {
        host::check_conv(weights, 0)?;
        let (weight, bias) = (Array::of(&weights.weight), weights.bias.as_ref().map(Array::of));
        Ok(RefConv { weight, bias, window: Some(window) })
    }

    fn load_conv_transpose(&self, weights: &ConvWeights, _dtype: DType) -> Result<RefConv, NetError> {
        host::check_conv(weights, 1)?;
        Ok(RefConv { weight: Array::of(&weights.weight), bias: weights.bias.as_ref().map(Array::of), window: None })
    }

    fn read(&self, x: &Array) -> Result<Vec<f32>, NetError> {
        Ok(x.data.to_vec())
    }

    fn cast(&self, x: &Array, _dtype: DType) -> Result<Array, NetError> {
        Ok(x.clone())
    }

    fn reshape(&self, x: &Array, shape: &[usize]) -> Result<Array, NetError> {
        host::check_reshape(&x.shape, shape)?;
        Ok(Array { shape: shape.to_vec(), data: Arc::clone(&x.data) })
    }

    fn permute(&self, x: &Array, order: &[usize]) -> Result<Array, NetError> {
        let (shape, data) = host::permute(&x.shape, &x.data, order)?;
        Ok(Array::new(shape, data))
    }

    fn concat(&self, parts: &[&Array], axis: usize) -> Result<Array, NetError> {
        let parts: Vec<(&[usize], &[f32])> = parts.iter().map(|p| (p.shape.as_slice(), p.data.as_slice())).collect();
        let (shape, data) = host::concat(&parts, axis)?;
        Ok(Array::new(shape, data))
    }

    fn slice(&self, x: &Array, axis: usize, start: usize, len: usize) -> Result<Array, NetError> {
        let (shape, data) = host::slice(&x.shape, &x.data, axis, start, len)?;
        Ok(Array::new(shape, data))
    }

    fn gather_rows(&self, table: &Array, ids: &[u32]) -> Result<Array, NetError> {
        let (shape, data) = host::gather_rows(&table.shape, &table.data, ids)?;
        Ok(Array::new(shape, data))
    }

    fn linear(&self, x: &Array, w: &RefLinear, act: Act, residual: Option<Array>) -> Result<Array, NetError> {
        let (out, inner) = (w.weight.shape[0], w.weight.shape[1]);
        host::check_last("linear", &x.shape, inner)?;
        let shape = host::with_last(&x.shape, out);
        host::check_residual("linear", &shape, residual.as_ref().map(|r| r.shape.as_slice()))?;
        let mut y = Vec::with_capacity(shape.iter().product());
        for row in x.data.chunks_exact(inner) {
            for (o, w_row) in w.weight.data.chunks_exact(inner).enumerate() {
                let sum: f64 = row.iter().zip(w_row).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
                let sum = sum + value(w.bias.as_ref(), o, 0.0);
                y.push(value(w.scale.as_ref(), o, 1.0) * apply(act, sum));
            }
        }
        Ok(Array::new(shape, add_residual(y, residual.as_ref())))
    }

    fn matmul(&self, a: &Array, b: &Array, b_transposed: bool) -> Result<Array, NetError> {
        let p = host::matmul_plan(&a.shape, &b.shape, b_transposed)?;
        let mut y = Vec::with_capacity(p.batch * p.m * p.n);
        for batch in 0..p.batch {
            let a = &a.data[batch * p.m * p.k..][..p.m * p.k];
            let b = &b.data[if p.b_batched { batch * p.k * p.n } else { 0 }..][..p.k * p.n];
            for i in 0..p.m {
                for j in 0..p.n {
                    let at = |k: usize| if b_transposed { b[j * p.k + k] } else { b[k * p.n + j] };
                    y.push((0..p.k).map(|k| f64::from(a[i * p.k + k]) * f64::from(at(k))).sum::<f64>() as f32);
                }
            }
        }
        Ok(Array::new(p.shape, y))
    }

    fn layer_norm(&self, x: &Array, w: Option<&Array>, b: Option<&Array>, eps: f32) -> Result<Array, NetError> {
        let c = host::last(&x.shape);
        for p in [w, b].into_iter().flatten() {
            host::check_equal("layer_norm", &p.shape, &[c])?;
        }
        Ok(rows(x, |row| layer_norm_row(row, w, b, eps)))
    }

    fn attention(&self, qkv: Qkv<'_, Array>, spec: &AttentionSpec<'_, Array>) -> Result<Array, NetError> {
        let p = host::attention_plan(&qkv, spec)?;
        let scale = f64::from(p.scale);
        let mut y = vec![0f32; p.batch * p.queries * p.heads * p.value_dim];
        let head = |part: host::Strided<'_, Array>, batch: usize, token: usize, head: usize, dim: usize| {
            wide(&part.tensor.data[part.at(batch, token) + head * dim..][..dim])
        };
        let norm_q = spec.qk_norm.as_ref().map(|n| (n.q_weight, n.q_bias, n.eps));
        let norm_k = spec.qk_norm.as_ref().map(|n| (n.k_weight, n.k_bias, n.eps));
        for batch in 0..p.batch {
            for h in 0..p.heads {
                let keys: Vec<Vec<f64>> = (0..p.keys)
                    .map(|t| {
                        let mut k = head(p.k, batch, t, h, p.dim);
                        prepare_head(&mut k, norm_k, spec.rope.as_ref(), t);
                        k
                    })
                    .collect();
                for i in 0..p.queries {
                    let mut q = head(p.q, batch, i, h, p.dim);
                    prepare_head(&mut q, norm_q, spec.rope.as_ref(), i);
                    let scores: Vec<f64> = (0..p.keys)
                        .map(|t| {
                            if spec.causal && t > i {
                                return f64::NEG_INFINITY;
                            }
                            let dot: f64 = q.iter().zip(&keys[t]).map(|(a, b)| a * b).sum();
                            dot * scale + spec.bias.map_or(0.0, |b| f64::from(b.data[p.bias_at(batch, i) + t]))
                        })
                        .collect();
                    let top = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                    if top == f64::NEG_INFINITY {
                        continue;
                    }
                    let weights: Vec<f64> = scores.iter().map(|s| (s - top).exp()).collect();
                    let total: f64 = weights.iter().sum();
                    let mut sum = vec![0f64; p.value_dim];
                    for (t, w) in weights.iter().enumerate() {
                        let v = head(p.v, batch, t, h, p.value_dim);
                        sum.iter_mut().zip(&v).for_each(|(s, v)| *s += w / total * v);
                    }
                    let at = ((batch * p.queries + i) * p.heads + h) * p.value_dim;
                    y[at..at + p.value_dim].copy_from_slice(&narrow(&sum));
                }
            }
        }
        Ok(Array::new(vec![p.batch, p.queries, p.heads * p.value_dim], y))
    }

    fn window_partition(&self, x: &Array, side: usize) -> Result<Array, NetError> {
        let (shape, data) = host::window_partition(&x.shape, &x.data, side)?;
        Ok(Array::new(shape, data))
    }

    fn window_merge(&self, x: &Array, side: usize, height: usize, width: usize) -> Result<Array, NetError> {
        let (shape, data) = host::window_merge(&x.shape, &x.data, side, height, width)?;
        Ok(Array::new(shape, data))
    }

    fn conv2d(&self, x: &Array, w: &RefConv, act: Act, residual: Option<Array>) -> Result<Array, NetError> {
        let d = Dims4::of("conv2d", &x.shape)?;
        let window = w.window.ok_or_else(|| NetError::shape("conv2d", "weights of a transposed convolution"))?;
        let [out, inner, kh, kw] = host::four("conv2d", &w.weight.shape)?;
        host::check_last("conv2d", &x.shape, inner)?;
        let (oh, ow) = host::conv_output("conv2d", d, window, kh, kw)?;
        let shape = vec![d.n, oh, ow, out];
        host::check_residual("conv2d", &shape, residual.as_ref().map(|r| r.shape.as_slice()))?;
        let mut y = Vec::with_capacity(shape.iter().product());
        for n in 0..d.n {
            for oy in 0..oh {
                for ox in 0..ow {
                    for o in 0..out {
                        let mut sum = value(w.bias.as_ref(), o, 0.0);
                        for ky in 0..kh {
                            for kx in 0..kw {
                                let (iy, ix) = (oy * window.stride + ky, ox * window.stride + kx);
                                let Some(at) = d.padded(n, iy, ix, window.padding) else { continue };
                                for c in 0..inner {
                                    let weight = w.weight.data[((o * inner + c) * kh + ky) * kw + kx];
                                    sum += f64::from(x.data[at + c]) * f64::from(weight);
                                }
                            }
                        }
                        y.push(apply(act, sum));
                    }
                }
            }
        }
        Ok(Array::new(shape, add_residual(y, residual.as_ref())))
    }

    fn conv_transpose2d(&self, x: &Array, w: &RefConv, act: Act, residual: Option<Array>) -> Result<Array, NetError> {
        let d = Dims4::of("conv_transpose2d", &x.shape)?;
        if w.window.is_some() {
            return Err(NetError::shape("conv_transpose2d", "weights of a plain convolution"));
        }
        let [inner, out, k, kw] = host::four("conv_transpose2d", &w.weight.shape)?;
        host::check_equal("conv_transpose2d", &[k], &[kw])?;
        host::check_last("conv_transpose2d", &x.shape, inner)?;
        let shape = vec![d.n, d.h * k, d.w * k, out];
        host::check_residual("conv_transpose2d", &shape, residual.as_ref().map(|r| r.shape.as_slice()))?;
        let mut y = Vec::with_capacity(shape.iter().product());
        for n in 0..d.n {
            for oy in 0..d.h * k {
                for ox in 0..d.w * k {
                    let at = ((n * d.h + oy / k) * d.w + ox / k) * inner;
                    for o in 0..out {
                        let mut sum = value(w.bias.as_ref(), o, 0.0);
                        for c in 0..inner {
                            let weight = w.weight.data[((c * out + o) * k + oy % k) * k + ox % k];
                            sum += f64::from(x.data[at + c]) * f64::from(weight);
                        }
                        y.push(apply(act, sum));
                    }
                }
            }
        }
        Ok(Array::new(shape, add_residual(y, residual.as_ref())))
    }

    fn resize(&self, x: &Array, height: usize, width: usize, how: Resize) -> Result<Array, NetError> {
        let d = Dims4::of("resize", &x.shape)?;
        let (ys, xs) = (math::taps(d.h, height, how), math::taps(d.w, width, how));
        let mut y = Vec::with_capacity(d.n * height * width * d.c);
        for n in 0..d.n {
            for ty in &ys {
                for tx in &xs {
                    for c in 0..d.c {
                        let mut sum = 0f64;
                        for (iy, wy) in ty {
                            for (ix, wx) in tx {
                                let v = x.data[((n * d.h + iy) * d.w + ix) * d.c + c];
                                sum += f64::from(*wy) * f64::from(*wx) * f64::from(v);
                            }
                        }
                        y.push(sum as f32);
                    }
                }
            }
        }
        Ok(Array::new(vec![d.n, height, width, d.c], y))
    }

    fn pool2d(&self, x: &Array, kind: Pool, window: Window) -> Result<Array, NetError> {
        let (shape, data) = host::pool2d(&x.shape, &x.data, kind, window)?;
        Ok(Array::new(shape, data))
    }

    fn activation(&self, x: &Array, act: Act) -> Result<Array, NetError> {
        let data = x.data.iter().map(|v| apply(act, f64::from(*v)) as f32).collect();
        Ok(Array::new(x.shape.clone(), data))
    }

    fn binary(&self, a: Array, b: &Array, op: Binary) -> Result<Array, NetError> {
        host::check_broadcast(&a.shape, &b.shape)?;
        let n = b.data.len();
        let data = a.data.iter().enumerate().map(|(i, x)| math::binary(op, *x, b.data[i % n])).collect();
        Ok(Array::new(a.shape, data))
    }

    fn affine(&self, x: &Array, factor: f32, offset: f32) -> Result<Array, NetError> {
        Ok(Array::new(x.shape.clone(), x.data.iter().map(|v| factor * v + offset).collect()))
    }

    fn softmax(&self, x: &Array) -> Result<Array, NetError> {
        Ok(rows(x, |row| {
            let top = row.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            for v in row.iter_mut() {
                *v = (*v - top).exp();
            }
            let total: f64 = row.iter().sum();
            for v in row.iter_mut() {
                *v /= total;
            }
        }))
    }

    fn l2_normalize(&self, x: &Array, eps: f32) -> Result<Array, NetError> {
        Ok(rows(x, |row| {
            let length = row.iter().map(|v| v * v).sum::<f64>().sqrt() + f64::from(eps);
            for v in row.iter_mut() {
                *v /= length;
            }
        }))
    }

    fn reduce(&self, x: &Array, how: Reduce) -> Result<Array, NetError> {
        let c = host::last(&x.shape);
        let data: Vec<f32> = x.data.chunks_exact(c).map(|row| math::reduce(how, row)).collect();
        let y = x.with_last(1, data);
        let shape = if x.shape.len() > 1 { x.shape[..x.shape.len() - 1].to_vec() } else { vec![1] };
        self.reshape(&y, &shape)
    }
}
