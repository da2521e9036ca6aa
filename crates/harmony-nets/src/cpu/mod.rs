//! The quick CPU backend: f32, all threads of rayon's pool, AVX-512 or AVX2 where the machine has it.

#![expect(unsafe_code, reason = "vector instructions, and threads that write disjoint parts of one buffer")]
#![allow(clippy::inline_always, reason = "bodies have to be compiled with their caller's instruction set")]
#![allow(clippy::wildcard_imports, reason = "vector instructions have telling names")]

mod attention;
mod image;
mod kernel;
mod pack;
mod product;
mod rows;
mod simd;

use std::sync::{Arc, Mutex};

use rayon::prelude::*;

use crate::backend::{
    Act, AttentionSpec, Backend, Binary, ConvWeights, LinearWeights, Pool, Qkv, Reduce, Resize, TensorHandle, Window,
};
use crate::host::{self, Dims4};
use crate::{DType, HostTensor, NetError, math};
use pack::{Columns, Matrix};
use product::{Finish, Size};

pub use simd::Level;

/// The quick CPU backend. Clones share their buffers.
#[derive(Debug, Clone, Default)]
pub struct Cpu {
    buffers: Arc<Buffers>,
}

/// Buffers to be used again: fresh memory costs a page fault every 4 KiB.
#[derive(Debug, Default)]
struct Buffers {
    free: Mutex<Vec<Vec<f32>>>,
}

impl Buffers {
    /// Most bytes kept free.
    const KEEP: usize = 512 << 20;
    /// Smaller buffers are left to the allocator.
    const SMALL: usize = 16 << 10;

    /// A buffer of `n` values, whatever they are.
    fn take(&self, n: usize) -> Vec<f32> {
        if n < Self::SMALL {
            return vec![0.0; n];
        }
        let mut free = self.free.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let fits = |v: &Vec<f32>| v.capacity() >= n && v.capacity() <= n + n / 2;
        let best = (0..free.len()).filter(|i| fits(&free[*i])).min_by_key(|i| free[*i].capacity());
        let mut buffer = match best {
            Some(i) => free.swap_remove(i),
            None => Vec::with_capacity(n),
        };
        drop(free);
        buffer.resize(n, 0.0);
        buffer
    }

    fn give(&self, buffer: Vec<f32>) {
        if buffer.capacity() < Self::SMALL {
            return;
        }
        let mut free = self.free.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        free.push(buffer);
        while free.iter().map(|b| b.capacity() * 4).sum::<usize>() > Self::KEEP {
            free.remove(0);
        }
    }
}

#[derive(Debug)]
enum Values {
    Owned {
        values: Vec<f32>,
        buffers: Arc<Buffers>,
    },
    /// Weights used where they lie in the file.
    Mapped(HostTensor),
}

impl Drop for Values {
    fn drop(&mut self) {
        if let Self::Owned { values, buffers } = self {
            buffers.give(std::mem::take(values));
        }
    }
}

/// A tensor of the CPU backend.
#[derive(Debug, Clone)]
pub struct Tensor {
    shape: Vec<usize>,
    values: Arc<Values>,
}

impl TensorHandle for Tensor {
    fn shape(&self) -> &[usize] {
        &self.shape
    }
    fn dtype(&self) -> DType {
        DType::F32
    }
}

impl Tensor {
    /// Its values.
    fn values(&self) -> &[f32] {
        match &*self.values {
            Values::Owned { values, .. } => values,
            Values::Mapped(host) => host.as_f32().unwrap_or_else(|| unreachable!("checked when it was loaded")),
        }
    }
}

/// Weights of a linear layer, in place where they are f32.
#[derive(Debug)]
pub struct Linear {
    weight: Tensor,
    bias: Option<Tensor>,
    scale: Option<Tensor>,
}

/// Weights of a convolution, as `[out, ky, kx, in]`; of a transposed one as `[ky, kx, out, in]`.
#[derive(Debug)]
pub struct Conv {
    weight: Tensor,
    bias: Option<Tensor>,
    kernel: [usize; 2],
    out: usize,
    inner: usize,
    window: Option<Window>,
}

impl Cpu {
    /// The backend on all threads of rayon's current pool.
    pub fn new() -> Self {
        Self::default()
    }

    fn tensor(&self, shape: Vec<usize>, values: Vec<f32>) -> Tensor {
        debug_assert_eq!(shape.iter().product::<usize>(), values.len());
        Tensor { shape, values: Arc::new(Values::Owned { values, buffers: Arc::clone(&self.buffers) }) }
    }

    fn moved(&self, (shape, values): (Vec<usize>, Vec<f32>)) -> Tensor {
        self.tensor(shape, values)
    }

    fn host(&self, host: &HostTensor) -> Tensor {
        if host.as_f32().is_some() {
            return Tensor { shape: host.shape().to_vec(), values: Arc::new(Values::Mapped(host.clone())) };
        }
        self.tensor(host.shape().to_vec(), host.to_f32())
    }

    /// The values to be changed in place when nobody else holds them, else a copy.
    fn own(&self, x: Tensor) -> (Vec<usize>, Vec<f32>) {
        let Tensor { shape, values } = x;
        match Arc::try_unwrap(values) {
            Ok(mut values) => match &mut values {
                Values::Owned { values, .. } => (shape, std::mem::take(values)),
                Values::Mapped(host) => (shape, host.to_f32()),
            },
            Err(shared) => {
                let x = Tensor { shape, values: shared };
                let mut copy = self.buffers.take(x.count());
                copy.copy_from_slice(x.values());
                (x.shape, copy)
            }
        }
    }

    fn each_row(&self, x: &Tensor, f: impl Fn(&mut [f32]) + Sync) -> Tensor {
        let c = host::last(&x.shape);
        let mut out = self.buffers.take(x.count());
        let step = rows_at_once(c) * c;
        out.par_chunks_mut(step).zip(x.values().par_chunks(step)).for_each(|(out, x)| {
            out.copy_from_slice(x);
            out.chunks_exact_mut(c).for_each(&f);
        });
        self.tensor(x.shape.clone(), out)
    }
}

/// Rows of `c` values that make a piece of work worth a task.
fn rows_at_once(c: usize) -> usize {
    (32_768 / c.max(1)).max(1)
}

impl Backend for Cpu {
    type Tensor = Tensor;
    type Linear = Linear;
    type Conv = Conv;

    fn device(&self) -> String {
        format!("cpu ({}, {} threads)", Level::best().name(), rayon::current_num_threads())
    }

    fn preferred(&self) -> DType {
        DType::F32
    }

    fn load(&self, host: &HostTensor, _dtype: DType) -> Result<Tensor, NetError> {
        Ok(self.host(host))
    }

    fn load_linear(&self, weights: &LinearWeights, _dtype: DType) -> Result<Linear, NetError> {
        host::check_linear(weights)?;
        Ok(Linear {
            weight: self.host(&weights.weight),
            bias: weights.bias.as_ref().map(|b| self.host(b)),
            scale: weights.scale.as_ref().map(|s| self.host(s)),
        })
    }

    fn load_conv(&self, weights: &ConvWeights, window: Window, _dtype: DType) -> Result<Conv, NetError> {
        host::check_conv(weights, 0)?;
        let [out, inner, kh, kw] = host::four("load_conv", weights.weight.shape())?;
        let weight = if kh * kw == 1 {
            self.host(&weights.weight)
        } else {
            self.moved(host::permute(&[out, inner, kh, kw], self.host(&weights.weight).values(), &[0, 2, 3, 1])?)
        };
        let bias = weights.bias.as_ref().map(|b| self.host(b));
        Ok(Conv { weight, bias, kernel: [kh, kw], out, inner, window: Some(window) })
    }

    fn load_conv_transpose(&self, weights: &ConvWeights, _dtype: DType) -> Result<Conv, NetError> {
        host::check_conv(weights, 1)?;
        let [inner, out, kh, kw] = host::four("load_conv_transpose", weights.weight.shape())?;
        host::check_equal("load_conv_transpose", &[kh], &[kw])?;
        let loaded = self.host(&weights.weight);
        let weight = self.moved(host::permute(&[inner, out, kh, kw], loaded.values(), &[2, 3, 1, 0])?);
        let bias = weights.bias.as_ref().map(|b| self.host(b));
        Ok(Conv { weight, bias, kernel: [kh, kw], out, inner, window: None })
    }

    fn read(&self, x: &Tensor) -> Result<Vec<f32>, NetError> {
        Ok(x.values().to_vec())
    }

    fn cast(&self, x: &Tensor, _dtype: DType) -> Result<Tensor, NetError> {
        Ok(x.clone())
    }

    fn reshape(&self, x: &Tensor, shape: &[usize]) -> Result<Tensor, NetError> {
        host::check_reshape(&x.shape, shape)?;
        Ok(Tensor { shape: shape.to_vec(), values: Arc::clone(&x.values) })
    }

    fn permute(&self, x: &Tensor, order: &[usize]) -> Result<Tensor, NetError> {
        host::permute(&x.shape, x.values(), order).map(|m| self.moved(m))
    }

    fn concat(&self, parts: &[&Tensor], axis: usize) -> Result<Tensor, NetError> {
        let parts: Vec<(&[usize], &[f32])> = parts.iter().map(|p| (p.shape.as_slice(), p.values())).collect();
        host::concat(&parts, axis).map(|m| self.moved(m))
    }

    fn slice(&self, x: &Tensor, axis: usize, start: usize, len: usize) -> Result<Tensor, NetError> {
        host::slice(&x.shape, x.values(), axis, start, len).map(|m| self.moved(m))
    }

    fn gather_rows(&self, table: &Tensor, ids: &[u32]) -> Result<Tensor, NetError> {
        host::gather_rows(&table.shape, table.values(), ids).map(|m| self.moved(m))
    }

    fn linear(&self, x: &Tensor, w: &Linear, act: Act, residual: Option<Tensor>) -> Result<Tensor, NetError> {
        let (n, k) = (w.weight.shape[0], w.weight.shape[1]);
        host::check_last("linear", &x.shape, k)?;
        let shape = host::with_last(&x.shape, n);
        host::check_residual("linear", &shape, residual.as_ref().map(|r| r.shape.as_slice()))?;
        let m = shape.iter().product::<usize>() / n.max(1);
        let mut out = self.buffers.take(m * n);
        let finish = Finish {
            bias: w.bias.as_ref().map(Tensor::values),
            act,
            scale: w.scale.as_ref().map(Tensor::values),
            residual: residual.as_ref().map(Tensor::values),
        };
        let columns = Columns::Transposed(Matrix { data: w.weight.values(), stride: k });
        product::product(Size { m, n, k }, &Matrix { data: x.values(), stride: k }, columns, finish, &mut out);
        Ok(self.tensor(shape, out))
    }

    fn matmul(&self, a: &Tensor, b: &Tensor, b_transposed: bool) -> Result<Tensor, NetError> {
        let p = host::matmul_plan(&a.shape, &b.shape, b_transposed)?;
        let mut out = self.buffers.take(p.batch * p.m * p.n);
        // One matrix against all: one tall product.
        let (batch, m) = if p.b_batched { (p.batch, p.m) } else { (1, p.batch * p.m) };
        for i in 0..batch {
            let rows = Matrix { data: &a.values()[i * m * p.k..][..m * p.k], stride: p.k };
            let data = &b.values()[i * p.k * p.n..][..p.k * p.n];
            let columns = if b_transposed {
                Columns::Transposed(Matrix { data, stride: p.k })
            } else {
                Columns::Plain(Matrix { data, stride: p.n })
            };
            let out = &mut out[i * m * p.n..][..m * p.n];
            product::product(Size { m, n: p.n, k: p.k }, &rows, columns, Finish::default(), out);
        }
        Ok(self.tensor(p.shape, out))
    }

    fn layer_norm(&self, x: &Tensor, w: Option<&Tensor>, b: Option<&Tensor>, eps: f32) -> Result<Tensor, NetError> {
        let c = host::last(&x.shape);
        for p in [w, b].into_iter().flatten() {
            host::check_equal("layer_norm", &p.shape, &[c])?;
        }
        let (w, b) = (w.map(Tensor::values), b.map(Tensor::values));
        Ok(self.each_row(x, |row| rows::layer_norm_row(row, w, b, eps)))
    }

    fn attention(&self, qkv: Qkv<'_, Tensor>, spec: &AttentionSpec<'_, Tensor>) -> Result<Tensor, NetError> {
        let plan = host::attention_plan(&qkv, spec)?;
        let shape = vec![plan.batch, plan.queries, plan.heads * plan.value_dim];
        let mut out = self.buffers.take(shape.iter().product());
        if plan.keys == 0 {
            out.fill(0.0);
        } else {
            attention::attention(&plan, spec, &mut out);
        }
        Ok(self.tensor(shape, out))
    }

    fn window_partition(&self, x: &Tensor, side: usize) -> Result<Tensor, NetError> {
        host::window_partition(&x.shape, x.values(), side).map(|m| self.moved(m))
    }

    fn window_merge(&self, x: &Tensor, side: usize, height: usize, width: usize) -> Result<Tensor, NetError> {
        host::window_merge(&x.shape, x.values(), side, height, width).map(|m| self.moved(m))
    }

    fn conv2d(&self, x: &Tensor, w: &Conv, act: Act, residual: Option<Tensor>) -> Result<Tensor, NetError> {
        let d = Dims4::of("conv2d", &x.shape)?;
        let window = w.window.ok_or_else(|| NetError::shape("conv2d", "weights of a transposed convolution"))?;
        host::check_last("conv2d", &x.shape, w.inner)?;
        let [kh, kw] = w.kernel;
        let (oh, ow) = host::conv_output("conv2d", d, window, kh, kw)?;
        let shape = vec![d.n, oh, ow, w.out];
        host::check_residual("conv2d", &shape, residual.as_ref().map(|r| r.shape.as_slice()))?;
        let mut out = self.buffers.take(shape.iter().product());
        let size = Size { m: d.n * oh * ow, n: w.out, k: kh * kw * w.inner };
        let finish = Finish {
            bias: w.bias.as_ref().map(Tensor::values),
            act,
            scale: None,
            residual: residual.as_ref().map(Tensor::values),
        };
        let columns = Columns::Transposed(Matrix { data: w.weight.values(), stride: size.k });
        if kh * kw == 1 && window.stride == 1 && window.padding == 0 {
            product::product(size, &Matrix { data: x.values(), stride: size.k }, columns, finish, &mut out);
        } else {
            let zeros = vec![0f32; w.inner];
            let windows = image::Windows { data: x.values(), dims: d, window, kw, oh, ow, zeros: &zeros };
            product::product(size, &windows, columns, finish, &mut out);
        }
        Ok(self.tensor(shape, out))
    }

    fn conv_transpose2d(&self, x: &Tensor, w: &Conv, act: Act, residual: Option<Tensor>) -> Result<Tensor, NetError> {
        let d = Dims4::of("conv_transpose2d", &x.shape)?;
        if w.window.is_some() {
            return Err(NetError::shape("conv_transpose2d", "weights of a plain convolution"));
        }
        host::check_last("conv_transpose2d", &x.shape, w.inner)?;
        let [k, _] = w.kernel;
        let shape = vec![d.n, d.h * k, d.w * k, w.out];
        host::check_residual("conv_transpose2d", &shape, residual.as_ref().map(|r| r.shape.as_slice()))?;
        let size = Size { m: d.n * d.h * d.w, n: k * k * w.out, k: w.inner };
        let mut cells = self.buffers.take(size.m * size.n);
        let columns = Columns::Transposed(Matrix { data: w.weight.values(), stride: w.inner });
        let rows = Matrix { data: x.values(), stride: w.inner };
        product::product(size, &rows, columns, Finish::default(), &mut cells);
        // Each input pixel became a k by k cell: put the cells in their places.
        let mut out = self.buffers.take(shape.iter().product());
        let finish = Finish {
            bias: w.bias.as_ref().map(Tensor::values),
            act,
            scale: None,
            residual: residual.as_ref().map(Tensor::values),
        };
        let width = d.w * k;
        out.par_chunks_exact_mut(width * w.out).enumerate().for_each(|(row, out)| {
            let (image_row, ky) = (row / k, row % k);
            for (ox, pixel) in out.chunks_exact_mut(w.out).enumerate() {
                let cell = (image_row * d.w + ox / k) * k * k + ky * k + ox % k;
                pixel.copy_from_slice(&cells[cell * w.out..][..w.out]);
                product::finish_row(pixel, &finish, (row * width + ox) * w.out, 0);
            }
        });
        self.buffers.give(cells);
        Ok(self.tensor(shape, out))
    }

    fn resize(&self, x: &Tensor, height: usize, width: usize, how: Resize) -> Result<Tensor, NetError> {
        let d = Dims4::of("resize", &x.shape)?;
        if height == 0 || width == 0 {
            return Err(NetError::shape("resize", format!("to {height}x{width}")));
        }
        let mut out = self.buffers.take(d.n * height * width * d.c);
        image::resize(x.values(), d, height, width, how, &mut out);
        Ok(self.tensor(vec![d.n, height, width, d.c], out))
    }

    fn pool2d(&self, x: &Tensor, kind: Pool, window: Window) -> Result<Tensor, NetError> {
        host::pool2d(&x.shape, x.values(), kind, window).map(|m| self.moved(m))
    }

    fn activation(&self, x: &Tensor, act: Act) -> Result<Tensor, NetError> {
        Ok(self.each_row(x, |row| product::activate(row, act)))
    }

    fn binary(&self, a: Tensor, b: &Tensor, op: Binary) -> Result<Tensor, NetError> {
        host::check_broadcast(&a.shape, &b.shape)?;
        let (shape, mut values) = self.own(a);
        let b = b.values();
        if b.len() == 1 {
            values.par_chunks_mut(65_536).for_each(|v| v.iter_mut().for_each(|v| *v = math::binary(op, *v, b[0])));
        } else if !b.is_empty() {
            let whole = (65_536 / b.len()).max(1) * b.len();
            values.par_chunks_mut(whole).for_each(|part| {
                for row in part.chunks_exact_mut(b.len()) {
                    combine(row, b, op);
                }
            });
        }
        Ok(self.tensor(shape, values))
    }

    fn affine(&self, x: &Tensor, factor: f32, offset: f32) -> Result<Tensor, NetError> {
        Ok(self.each_row(x, |row| row.iter_mut().for_each(|v| *v = factor * *v + offset)))
    }

    fn softmax(&self, x: &Tensor) -> Result<Tensor, NetError> {
        Ok(self.each_row(x, |row| {
            let top = attention::largest(row);
            let inv = 1.0 / attention::exp_sum(row, top);
            for v in row {
                *v *= inv;
            }
        }))
    }

    fn l2_normalize(&self, x: &Tensor, eps: f32) -> Result<Tensor, NetError> {
        Ok(self.each_row(x, |row| {
            let inv = 1.0 / (rows::sum_of_squares(row, 0.0).sqrt() + eps);
            for v in row {
                *v *= inv;
            }
        }))
    }

    fn reduce(&self, x: &Tensor, how: Reduce) -> Result<Tensor, NetError> {
        let c = host::last(&x.shape);
        let values: Vec<f32> = x.values().par_chunks_exact(c).map(|row| math::reduce(how, row)).collect();
        let shape = if x.shape.len() > 1 { x.shape[..x.shape.len() - 1].to_vec() } else { vec![1] };
        Ok(self.tensor(shape, values))
    }
}

simd::for_each_level! {
    /// `a = a op b`.
    pub fn combine(a: &mut [f32], b: &[f32], op: Binary) {
        for (a, b) in a.iter_mut().zip(b) {
            *a = math::binary(op, *a, *b);
        }
    }
}
