//! The CUDA backend: f32 and bf16 on one NVIDIA GPU.
//!
//! Products go to cuBLASLt with bias, activation and residual in its epilogue; everything else is a kernel of our own,
//! compiled for the GPU at hand when it is first used and kept in the cache folder. Nothing of CUDA is needed to build;
//! the driver, libnvrtc and libcublasLt are looked for at run time, and [`Cuda::open`] says what is missing.
//!
//! All work is on one stream. A `Cuda` may be moved between threads; [`Backend::replayable`] records whatever is launched
//! on it, so that several networks at a time need a lock around each or a `Cuda` each.

#![expect(unsafe_code, reason = "the driver's interface")]

mod device;
mod presence;
mod product;
mod profile;
mod record;

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use crate::backend::{
    Act, AttentionSpec, Backend, Binary, ConvWeights, LinearWeights, Pool, Qkv, Reduce, Resize, TensorHandle, Window,
};
use crate::host::{self, Dims4, Strided};
use crate::{DType, HostTensor, NetError};
use device::{Args, Buffer, Device, Source, lock};
use product::{Epilogue, Operands, Shape};
use record::Recording;

pub use presence::check;
pub use profile::Launches;

/// Bytes of gathered windows at a time in a convolution.
const GATHERED: usize = 768 << 20;
/// Products with more arithmetic than this have their algorithm chosen by a measurement.
const WORTH_TRYING: usize = 10_000_000;
/// Queries times keys times channels from which f32 attention beside bf16 is narrowed.
const WORTH_NARROWING: usize = 1 << 24;

/// An NVIDIA GPU as a backend. Clones share everything.
#[derive(Debug, Clone)]
pub struct Cuda {
    device: Arc<Device>,
    preferred: DType,
    /// f32 products are multiplied as TF32, and large cross attention in bf16.
    tf32: bool,
    records: Arc<Mutex<HashMap<String, Recording>>>,
}

/// A tensor in device memory, f32 or bf16.
#[derive(Debug, Clone)]
pub struct Tensor {
    shape: Vec<usize>,
    dtype: DType,
    /// Bytes from the buffer's start; a multiple of 256.
    offset: usize,
    buffer: Arc<Buffer>,
}

impl TensorHandle for Tensor {
    fn shape(&self) -> &[usize] {
        &self.shape
    }
    fn dtype(&self) -> DType {
        self.dtype
    }
}

impl Tensor {
    fn at(&self) -> u64 {
        self.buffer.address + self.offset as u64
    }

    fn bytes(&self) -> usize {
        self.count() * self.dtype.size()
    }

    /// Whether it may be overwritten.
    fn is_sole(&self) -> bool {
        Arc::strong_count(&self.buffer) == 1
    }

    fn reshaped(self, shape: &[usize]) -> Self {
        Self { shape: shape.to_vec(), ..self }
    }
}

/// Weights of a linear layer; a layer scale is folded in.
#[derive(Debug)]
pub struct Linear {
    weight: Tensor,
    bias: Option<Tensor>,
    scaled: bool,
}

/// Weights of a convolution as `[out, (ky, kx, in)]`, rows filled up with zeros to `pitch`; of a transposed one as
/// `[(ky, kx, out), in]`.
#[derive(Debug)]
pub struct Conv {
    weight: Tensor,
    bias: Option<Tensor>,
    kernel: [usize; 2],
    out: usize,
    inner: usize,
    pitch: usize,
    window: Option<Window>,
}

fn suffix(dtype: DType, f32: &'static str, bf16: &'static str) -> &'static str {
    if dtype == DType::BF16 { bf16 } else { f32 }
}

macro_rules! kernel {
    ($source:ident, $name:literal, $dtype:expr) => {
        (Source::$source, suffix($dtype, concat!($name, "_f32"), concat!($name, "_bf16")))
    };
}

fn act_code(act: Act) -> i32 {
    match act {
        Act::None => 0,
        Act::Relu => 1,
        Act::Gelu => 2,
        Act::GeluTanh => 3,
        Act::QuickGelu => 4,
        Act::Silu => 5,
        Act::Sigmoid => 6,
        Act::Exp => 7,
    }
}

fn kind(dtype: DType) -> DType {
    if dtype == DType::BF16 { DType::BF16 } else { DType::F32 }
}

/// Kernels count elements in 32 bits where they take positions apart.
fn countable(op: &'static str, count: usize) -> Result<(), NetError> {
    if u32::try_from(count).is_ok() {
        return Ok(());
    }
    Err(NetError::shape(op, format!("{count} elements are more than this device does at once")))
}

impl Cuda {
    /// The GPU of that number (0 is the first).
    ///
    /// # Errors
    /// [`NetError::Device`] that says what is missing: the driver, a library, a GPU.
    pub fn open(ordinal: usize) -> Result<Self, NetError> {
        let ordinal = i32::try_from(ordinal).unwrap_or(i32::MAX);
        let device = Device::open(ordinal)?;
        // Matrix units do bf16 from compute capability 8.0 on.
        let preferred = if device.arch >= 80 { DType::BF16 } else { DType::F32 };
        Ok(Self { device, preferred, tf32: preferred == DType::BF16, records: Arc::default() })
    }

    /// The same GPU with networks in another type: f32 to compare with, bf16 to be quick. Beside bf16, products of the
    /// parts that stay f32 are multiplied as TF32, as PyTorch does by default in convolutions, and large cross attention
    /// in bf16.
    #[must_use]
    pub fn computing_in(&self, dtype: DType) -> Self {
        let preferred = kind(dtype);
        let tf32 = preferred == DType::BF16 && self.device.arch >= 80;
        Self { preferred, tf32, records: Arc::default(), ..self.clone() }
    }

    /// The same GPU without TF32: whatever is f32 is computed in f32.
    #[must_use]
    pub fn without_tf32(&self) -> Self {
        Self { tf32: false, records: Arc::default(), ..self.clone() }
    }

    /// Bytes of device memory held by tensors and kept for the next ones: now, and at most so far. The libraries'
    /// own and the context's come on top.
    pub fn memory(&self) -> (usize, usize) {
        self.device.memory()
    }

    /// Bytes of the device's memory that are free, and all of them; `None` when the driver does not say.
    pub fn device_memory(&self) -> Option<(usize, usize)> {
        self.device.device_memory()
    }

    /// Waits until everything is done.
    ///
    /// # Errors
    /// What the device says of work that failed.
    pub fn synchronize(&self) -> Result<(), NetError> {
        self.device.bind()?;
        self.device.synchronize()
    }

    /// Forgets recordings and gives memory that is not in use back to the driver.
    pub fn trim(&self) {
        lock(&self.records).clear();
        self.device.empty(&self.device.common);
    }

    fn make(&self, shape: &[usize], dtype: DType) -> Result<Tensor, NetError> {
        let bytes = shape.iter().try_fold(dtype.size(), |n, d| n.checked_mul(*d));
        let bytes = bytes.ok_or_else(|| NetError::shape("a tensor", format!("{shape:?} is beyond any memory")))?;
        Ok(Tensor { shape: shape.to_vec(), dtype, offset: 0, buffer: Arc::new(self.device.take(bytes)?) })
    }

    fn upload(&self, bytes: &[u8], shape: &[usize], dtype: DType) -> Result<Tensor, NetError> {
        let tensor = self.make(shape, dtype)?;
        self.device.upload(tensor.at(), bytes)?;
        Ok(tensor)
    }

    fn upload_host(&self, host: &HostTensor) -> Result<Tensor, NetError> {
        match host.dtype() {
            DType::F32 | DType::BF16 if cfg!(target_endian = "little") => {
                self.upload(host.bytes(), host.shape(), host.dtype())
            }
            _ => self.upload(bytemuck::cast_slice(&host.to_f32()), host.shape(), DType::F32),
        }
    }

    fn as_type(&self, x: &Tensor, dtype: DType) -> Result<Tensor, NetError> {
        if x.dtype == dtype {
            return Ok(x.clone());
        }
        let y = self.make(&x.shape, dtype)?;
        let name = if dtype == DType::BF16 { "cast_f32_bf16" } else { "cast_bf16_f32" };
        let n = x.count();
        let wide = n.is_multiple_of(8);
        let args = Args::new().with(x.at()).with(y.at()).with(n as i64).with(i32::from(wide));
        self.device.launch_over((Source::Pointwise, name), if wide { n / 8 } else { n }, args)?;
        Ok(y)
    }

    /// `act(x + bias) + residual` into `y`, which may be `x`.
    fn finish(
        &self,
        x: u64,
        y: &Tensor,
        bias: Option<&Tensor>,
        act: Act,
        residual: Option<&Tensor>,
    ) -> Result<(), NetError> {
        let (n, columns) = (y.count(), host::last(&y.shape));
        let wide = if bias.is_some() { columns.is_multiple_of(8) } else { n.is_multiple_of(8) };
        let address = |t: Option<&Tensor>| t.map_or(0u64, Tensor::at);
        let args = Args::new().with(x).with(y.at()).with(address(bias)).with(address(residual)).with(act_code(act));
        let args = args.with(columns as i64).with(n as i64).with(i32::from(wide));
        self.device.launch_over(kernel!(Pointwise, "finish", y.dtype), if wide { n / 8 } else { n }, args)
    }

    /// Rows of bytes between two pitches.
    fn copy_rows(&self, from: u64, to: u64, bytes: usize, rows: usize, pitches: [usize; 2]) -> Result<(), NetError> {
        let fits = |unit: usize| {
            [bytes, pitches[0], pitches[1], from as usize, to as usize].iter().all(|v| v.is_multiple_of(unit))
        };
        let (unit, name) = if fits(16) {
            (16, "rows_16")
        } else if fits(4) {
            (4, "rows_4")
        } else {
            (2, "rows_2")
        };
        let n = |v: usize| (v / unit) as i64;
        let args = Args::new().with(from).with(to).with(n(bytes)).with(rows as i64);
        let args = args.with(n(pitches[0])).with(n(pitches[1]));
        self.device.launch_over((Source::Pointwise, name), bytes / unit * rows, args)
    }

    /// `act(x w + bias) + residual` into `y`, all of one type; `y` may be the residual's memory.
    #[expect(clippy::too_many_arguments, reason = "a product has that many parts")]
    fn multiply(
        &self,
        [m, n, k]: [usize; 3],
        transposed: bool,
        batch: usize,
        x: u64,
        w: u64,
        y: &Tensor,
        bias: Option<&Tensor>,
        act: Act,
        residual: Option<&Tensor>,
    ) -> Result<(), NetError> {
        if m == 0 || n == 0 || batch == 0 {
            return Ok(());
        }
        let epilogue = match act {
            Act::None => Some(Epilogue::None),
            Act::Relu if residual.is_none() => Some(Epilogue::Relu),
            // The library's GELU is the one by the hyperbolic tangent: 5e-4 off the exact one at most, less than half
            // a step of bf16 where it matters.
            Act::Gelu | Act::GeluTanh if residual.is_none() && y.dtype == DType::BF16 => Some(Epilogue::GeluTanh),
            _ => None,
        };
        let shape = Shape {
            dtype: y.dtype,
            tf32: self.tf32 && y.dtype == DType::F32,
            m,
            n,
            k,
            transposed,
            epilogue: epilogue.unwrap_or(Epilogue::None),
            bias: bias.is_some() && epilogue.is_some(),
            residual: residual.is_some() && epilogue.is_some(),
            batch,
        };
        let address = |t: Option<&Tensor>| t.map_or(0u64, Tensor::at);
        let operands = |y| Operands { x, w, bias: address(bias), residual: address(residual), y };
        if epilogue.is_some() && self.product(shape, operands(y.at()))? {
            return Ok(());
        }
        // In two steps: the product, then everything else. The residual must not be overwritten by the first.
        let apart = residual.is_some_and(|r| r.at() == y.at());
        let raw = if apart { self.make(&y.shape, y.dtype)? } else { y.clone() };
        let shape = Shape { epilogue: Epilogue::None, bias: false, residual: false, ..shape };
        if !self.product(shape, operands(raw.at()))? {
            let w_step = if batch > 1 { (n * k) as i64 } else { 0 };
            let args = Args::new().with(x).with(w).with(raw.at()).with(m as i32).with(n as i32).with(k as i32);
            let args = args.with(i32::from(transposed)).with((m * k) as i64).with(w_step);
            let grid = [n.div_ceil(16), m.div_ceil(16), batch];
            self.device.launch(kernel!(Pointwise, "product", y.dtype), grid, 256, 0, args)?;
        }
        if bias.is_none() && act == Act::None && residual.is_none() {
            return Ok(());
        }
        self.finish(raw.at(), y, bias, act, residual)
    }

    fn product(&self, shape: Shape, operands: Operands) -> Result<bool, NetError> {
        self.device.bind()?;
        let products = &self.device.products;
        let work = 2 * shape.m * shape.n * shape.k * shape.batch;
        let recording = !Arc::ptr_eq(&lock(&self.device.pool), &self.device.common);
        let scratch = if work >= WORTH_TRYING && !recording && products.is_new(&shape) {
            Some(self.make(&[shape.batch * shape.m * shape.n], shape.dtype)?)
        } else {
            None
        };
        products.run(&self.device, shape, operands, scratch.as_ref().map(Tensor::at))
    }

    /// The residual in the result's type and shape.
    fn residual(&self, op: &'static str, shape: &[usize], r: Option<Tensor>, dtype: DType) -> Checked<Option<Tensor>> {
        host::check_residual(op, shape, r.as_ref().map(|r| r.shape.as_slice()))?;
        r.map(|r| self.owned_as(r, dtype)).transpose()
    }

    /// Another type of a tensor that is given away: itself when it has that type already, still sole.
    fn owned_as(&self, x: Tensor, dtype: DType) -> Result<Tensor, NetError> {
        if x.dtype == dtype { Ok(x) } else { self.as_type(&x, dtype) }
    }

    /// A result that reuses the residual's memory when nobody else holds it.
    fn result(&self, shape: &[usize], dtype: DType, residual: Option<&Tensor>) -> Result<Tensor, NetError> {
        match residual {
            Some(r) if r.is_sole() => Ok(r.clone().reshaped(shape)),
            _ => self.make(shape, dtype),
        }
    }

    fn rows(&self, x: &Tensor, what: (Source, &'static str), args: impl Fn(Args) -> Args) -> Result<Tensor, NetError> {
        let y = self.make(&x.shape, x.dtype)?;
        let rows = x.count() / host::last(&x.shape);
        self.device.launch(what, [rows, 1, 1], 128, 0, args(Args::new().with(x.at()).with(y.at())))?;
        Ok(y)
    }

    fn permuted(&self, x: &Tensor, order: &[usize]) -> Result<Tensor, NetError> {
        let mut sorted = order.to_vec();
        sorted.sort_unstable();
        if !sorted.iter().copied().eq(0..x.shape.len()) || order.len() > 6 {
            return Err(NetError::shape("permute", format!("order {order:?} of {:?}", x.shape)));
        }
        let mut strides = vec![1i64; x.shape.len()];
        for i in (0..x.shape.len().saturating_sub(1)).rev() {
            strides[i] = strides[i + 1] * x.shape[i + 1] as i64;
        }
        let shape: Vec<usize> = order.iter().map(|i| x.shape[*i]).collect();
        // Six sizes, then six strides; axes that are missing have a length of one.
        let mut axes = [1i64; 12];
        axes[6..].fill(0);
        for (i, axis) in order.iter().enumerate() {
            axes[6 - order.len() + i] = x.shape[*axis] as i64;
            axes[12 - order.len() + i] = strides[*axis];
        }
        let y = self.make(&shape, x.dtype)?;
        let args = Args::new().with(x.at()).with(y.at()).with(axes).with(x.count() as i64);
        self.device.launch_over(kernel!(Pointwise, "permute", x.dtype), x.count(), args)?;
        Ok(y)
    }
}

type Checked<T> = Result<T, NetError>;

/// How many channels are copied as one, and which of three kernels does it: sixteen bytes, or one f32 or bf16.
fn by_unit(dtype: DType, channels: usize, names: [&'static str; 3]) -> (usize, &'static str) {
    if (channels * dtype.size()).is_multiple_of(16) {
        (16 / dtype.size(), names[0])
    } else {
        (1, names[if dtype == DType::BF16 { 2 } else { 1 }])
    }
}

fn image_args(d: Dims4) -> [i32; 4] {
    [d.n as i32, d.h as i32, d.w as i32, d.c as i32]
}

impl Backend for Cuda {
    type Tensor = Tensor;
    type Linear = Linear;
    type Conv = Conv;

    fn device(&self) -> String {
        let a = self.device.arch;
        format!("cuda ({}, compute capability {}.{})", self.device.name, a / 10, a % 10)
    }

    fn preferred(&self) -> DType {
        self.preferred
    }

    fn room(&self) -> usize {
        2 << 30
    }

    fn load(&self, host: &HostTensor, dtype: DType) -> Result<Tensor, NetError> {
        self.as_type(&self.upload_host(host)?, kind(dtype))
    }

    fn load_linear(&self, w: &LinearWeights, dtype: DType) -> Result<Linear, NetError> {
        host::check_linear(w)?;
        let dtype = kind(dtype);
        let Some(scale) = &w.scale else {
            let bias = w.bias.as_ref().map(|b| self.load(b, dtype)).transpose()?;
            return Ok(Linear { weight: self.load(&w.weight, dtype)?, bias, scaled: false });
        };
        let scale = self.load(scale, DType::F32)?;
        let fold = |host: &HostTensor| {
            let x = self.load(host, DType::F32)?;
            let y = self.make(host.shape(), dtype)?;
            let (n, rows) = (x.count(), host.shape()[0].max(1));
            let args = Args::new().with(x.at()).with(scale.at()).with(y.at()).with((n / rows) as i64).with(n as i64);
            self.device.launch_over(kernel!(Pointwise, "scale_rows", dtype), n, args)?;
            Ok::<_, NetError>(y)
        };
        Ok(Linear { weight: fold(&w.weight)?, bias: w.bias.as_ref().map(fold).transpose()?, scaled: true })
    }

    fn load_conv(&self, w: &ConvWeights, window: Window, dtype: DType) -> Result<Conv, NetError> {
        host::check_conv(w, 0)?;
        let [out, inner, kh, kw] = host::four("load_conv", w.weight.shape())?;
        let dtype = kind(dtype);
        let ordered = self.permuted(&self.load(&w.weight, dtype)?, &[0, 2, 3, 1])?;
        let columns = kh * kw * inner;
        let pitch = columns.next_multiple_of(8);
        let weight = if pitch == columns {
            ordered.reshaped(&[out, columns])
        } else {
            let padded = self.load(&HostTensor::from_f32(&[out, pitch], vec![0.0; out * pitch]), dtype)?;
            let bytes = dtype.size();
            self.copy_rows(ordered.at(), padded.at(), columns * bytes, out, [columns * bytes, pitch * bytes])?;
            padded
        };
        let bias = w.bias.as_ref().map(|b| self.load(b, dtype)).transpose()?;
        Ok(Conv { weight, bias, kernel: [kh, kw], out, inner, pitch, window: Some(window) })
    }

    fn load_conv_transpose(&self, w: &ConvWeights, dtype: DType) -> Result<Conv, NetError> {
        host::check_conv(w, 1)?;
        let [inner, out, kh, kw] = host::four("load_conv_transpose", w.weight.shape())?;
        host::check_equal("load_conv_transpose", &[kh], &[kw])?;
        let dtype = kind(dtype);
        let weight = self.permuted(&self.load(&w.weight, dtype)?, &[2, 3, 1, 0])?;
        let weight = weight.reshaped(&[kh * kw * out, inner]);
        let bias = w.bias.as_ref().map(|b| self.load(b, dtype)).transpose()?;
        Ok(Conv { weight, bias, kernel: [kh, kw], out, inner, pitch: inner, window: None })
    }

    fn read(&self, x: &Tensor) -> Result<Vec<f32>, NetError> {
        let x = self.as_type(x, DType::F32)?;
        let mut values = vec![0f32; x.count()];
        self.device.download(bytemuck::cast_slice_mut(&mut values), x.at())?;
        Ok(values)
    }

    fn cast(&self, x: &Tensor, dtype: DType) -> Result<Tensor, NetError> {
        self.as_type(x, kind(dtype))
    }

    fn reshape(&self, x: &Tensor, shape: &[usize]) -> Result<Tensor, NetError> {
        host::check_reshape(&x.shape, shape)?;
        Ok(x.clone().reshaped(shape))
    }

    fn permute(&self, x: &Tensor, order: &[usize]) -> Result<Tensor, NetError> {
        self.permuted(x, order)
    }

    fn concat(&self, parts: &[&Tensor], axis: usize) -> Result<Tensor, NetError> {
        let wrong = || {
            let shapes: Vec<_> = parts.iter().map(|p| &p.shape).collect();
            NetError::shape("concat", format!("{shapes:?} along axis {axis}"))
        };
        let Some(&first) = parts.first() else { return Err(wrong()) };
        let fits = |p: &&&Tensor| {
            let s = &p.shape;
            s.len() == first.shape.len() && (0..s.len()).all(|i| i == axis || s[i] == first.shape[i])
        };
        if axis >= first.shape.len() || !parts.iter().all(|p| fits(&p)) {
            return Err(wrong());
        }
        if let [only] = parts {
            return Ok((*only).clone());
        }
        let mut shape = first.shape.clone();
        shape[axis] = parts.iter().map(|p| p.shape[axis]).sum();
        let y = self.make(&shape, first.dtype)?;
        let outer: usize = shape[..axis].iter().product();
        let inner = shape[axis + 1..].iter().product::<usize>() * first.dtype.size();
        let mut at = y.at();
        for part in parts {
            let part = self.as_type(part, first.dtype)?;
            let bytes = part.shape[axis] * inner;
            self.copy_rows(part.at(), at, bytes, outer, [bytes, shape[axis] * inner])?;
            at += bytes as u64;
        }
        Ok(y)
    }

    fn slice(&self, x: &Tensor, axis: usize, start: usize, len: usize) -> Result<Tensor, NetError> {
        if axis >= x.shape.len() || start.checked_add(len).is_none_or(|end| end > x.shape[axis]) {
            return Err(NetError::shape("slice", format!("{start}+{len} of axis {axis} of {:?}", x.shape)));
        }
        let mut shape = x.shape.clone();
        shape[axis] = len;
        let outer: usize = shape[..axis].iter().product();
        let inner = shape[axis + 1..].iter().product::<usize>() * x.dtype.size();
        let from = start * inner;
        if outer == 1 && (x.offset + from).is_multiple_of(256) {
            return Ok(Tensor { offset: x.offset + from, ..x.clone().reshaped(&shape) });
        }
        let y = self.make(&shape, x.dtype)?;
        let pitches = [x.shape[axis] * inner, len * inner];
        self.copy_rows(x.at() + from as u64, y.at(), len * inner, outer, pitches)?;
        Ok(y)
    }

    fn gather_rows(&self, table: &Tensor, ids: &[u32]) -> Result<Tensor, NetError> {
        let &[rows, c] = table.shape.as_slice() else {
            return Err(NetError::shape("gather_rows", format!("table {:?}, wanted two axes", table.shape)));
        };
        if let Some(id) = ids.iter().find(|id| **id as usize >= rows) {
            return Err(NetError::shape("gather_rows", format!("row {id} of {rows}")));
        }
        let y = self.make(&[ids.len(), c], table.dtype)?;
        for (i, part) in ids.chunks(512).enumerate() {
            let mut list = [0u32; 512];
            list[..part.len()].copy_from_slice(part);
            let to = y.at() + (i * 512 * c * y.dtype.size()) as u64;
            let args = Args::new().with(table.at()).with(to).with(list).with(c as i64).with((part.len() * c) as i64);
            self.device.launch_over(kernel!(Pointwise, "gather", y.dtype), part.len() * c, args)?;
        }
        Ok(y)
    }

    fn linear(&self, x: &Tensor, w: &Linear, act: Act, residual: Option<Tensor>) -> Result<Tensor, NetError> {
        let &[out, inner] = w.weight.shape.as_slice() else {
            return Err(NetError::shape("linear", "weights without two axes"));
        };
        host::check_last("linear", &x.shape, inner)?;
        if w.scaled && act != Act::None {
            return Err(NetError::shape("linear", "a layer scale is folded in, so no activation can come before it"));
        }
        let (wanted, dtype) = (x.dtype, w.weight.dtype);
        let x = self.as_type(x, dtype)?;
        let shape = host::with_last(&x.shape, out);
        let residual = self.residual("linear", &shape, residual, dtype)?;
        let y = self.result(&shape, dtype, residual.as_ref())?;
        let m = x.count() / inner.max(1);
        let (bias, r) = (w.bias.as_ref(), residual.as_ref());
        self.multiply([m, out, inner], true, 1, x.at(), w.weight.at(), &y, bias, act, r)?;
        drop(residual);
        self.owned_as(y, wanted)
    }

    fn matmul(&self, a: &Tensor, b: &Tensor, b_transposed: bool) -> Result<Tensor, NetError> {
        let p = host::matmul_plan(&a.shape, &b.shape, b_transposed)?;
        let b = self.as_type(b, a.dtype)?;
        let y = self.make(&p.shape, a.dtype)?;
        let (batch, m) = if p.b_batched { (p.batch, p.m) } else { (1, p.batch * p.m) };
        self.multiply([m, p.n, p.k], b_transposed, batch, a.at(), b.at(), &y, None, Act::None, None)?;
        Ok(y)
    }

    fn layer_norm(&self, x: &Tensor, w: Option<&Tensor>, b: Option<&Tensor>, eps: f32) -> Result<Tensor, NetError> {
        let c = host::last(&x.shape);
        for p in [w, b].into_iter().flatten() {
            host::check_equal("layer_norm", &p.shape, &[c])?;
        }
        let full = |t: Option<&Tensor>| t.map(|t| self.as_type(t, DType::F32)).transpose();
        let (w, b) = (full(w)?, full(b)?);
        let address = |t: &Option<Tensor>| t.as_ref().map_or(0u64, Tensor::at);
        if c.is_multiple_of(8) && c <= 1024 {
            let y = self.make(&x.shape, x.dtype)?;
            let rows = x.count() / c;
            let args = Args::new().with(x.at()).with(y.at()).with(address(&w)).with(address(&b)).with(eps);
            let args = args.with(c as i32).with(rows as i64).with(c.div_ceil(256).next_power_of_two() as i32);
            self.device.launch(kernel!(Rows, "short_norm", x.dtype), [rows.div_ceil(4), 1, 1], 128, 0, args)?;
            return Ok(y);
        }
        let wide = match c.div_ceil(1024) {
            n @ 1..=4 if c.is_multiple_of(8) => n.next_power_of_two() as i32,
            _ => 0,
        };
        self.rows(x, kernel!(Rows, "layer_norm", x.dtype), |args| {
            args.with(address(&w)).with(address(&b)).with(eps).with(c as i32).with(wide)
        })
    }

    fn attention(&self, qkv: Qkv<'_, Tensor>, spec: &AttentionSpec<'_, Tensor>) -> Result<Tensor, NetError> {
        match qkv {
            Qkv::Packed(_) => self.attend(&qkv, spec),
            Qkv::Separate { q, k, v } => {
                // Where f32 is multiplied as TF32, large attention goes through the matrix units in bf16.
                let work = q.dim(0) * q.dim(1) * k.dim(1) * q.dim(2);
                let narrow = self.tf32 && self.device.arch >= 80 && q.dtype == DType::F32 && work >= WORTH_NARROWING;
                let dtype = if narrow { DType::BF16 } else { q.dtype };
                let (q_here, k, v) = (self.as_type(q, dtype)?, self.as_type(k, dtype)?, self.as_type(v, dtype)?);
                self.owned_as(self.attend(&Qkv::Separate { q: &q_here, k: &k, v: &v }, spec)?, q.dtype)
            }
        }
    }

    fn window_partition(&self, x: &Tensor, side: usize) -> Result<Tensor, NetError> {
        let d = Dims4::of("window_partition", &x.shape)?;
        if side == 0 {
            return Err(NetError::shape("window_partition", "a window of nothing"));
        }
        let (rows, columns) = (d.h.div_ceil(side), d.w.div_ceil(side));
        let y = self.make(&[d.n * rows * columns, side * side, d.c], x.dtype)?;
        countable("window_partition", y.count())?;
        let names = ["window_partition_16", "window_partition_4", "window_partition_2"];
        let (unit, name) = by_unit(x.dtype, d.c, names);
        let (c, n) = (d.c / unit, y.count() / unit);
        let args = Args::new().with(x.at()).with(y.at()).with(image_args(Dims4 { c, ..d })).with(side as i32);
        let args = args.with(rows as i32).with(columns as i32).with(n as i64);
        self.device.launch_over((Source::Images, name), n, args)?;
        Ok(y)
    }

    fn window_merge(&self, x: &Tensor, side: usize, height: usize, width: usize) -> Result<Tensor, NetError> {
        let wrong = || {
            let what = format!("{:?}, windows of {side} to an image of {height}x{width}", x.shape);
            NetError::shape("window_merge", what)
        };
        let &[windows, tokens, c] = x.shape.as_slice() else { return Err(wrong()) };
        if side == 0 || height == 0 || width == 0 || tokens != side * side {
            return Err(wrong());
        }
        let (rows, columns) = (height.div_ceil(side), width.div_ceil(side));
        if !windows.is_multiple_of(rows * columns) {
            return Err(wrong());
        }
        let d = Dims4 { n: windows / (rows * columns), h: height, w: width, c };
        let y = self.make(&[d.n, height, width, c], x.dtype)?;
        countable("window_merge", y.count())?;
        let names = ["window_merge_16", "window_merge_4", "window_merge_2"];
        let (unit, name) = by_unit(x.dtype, d.c, names);
        let (c, n) = (d.c / unit, y.count() / unit);
        let args = Args::new().with(x.at()).with(y.at()).with(image_args(Dims4 { c, ..d })).with(side as i32);
        let args = args.with(rows as i32).with(columns as i32).with(n as i64);
        self.device.launch_over((Source::Images, name), n, args)?;
        Ok(y)
    }

    fn conv2d(&self, x: &Tensor, w: &Conv, act: Act, residual: Option<Tensor>) -> Result<Tensor, NetError> {
        let d = Dims4::of("conv2d", &x.shape)?;
        let window = w.window.ok_or_else(|| NetError::shape("conv2d", "weights of a transposed convolution"))?;
        let [kh, kw] = w.kernel;
        host::check_last("conv2d", &x.shape, w.inner)?;
        let (oh, ow) = host::conv_output("conv2d", d, window, kh, kw)?;
        let shape = [d.n, oh, ow, w.out];
        let (wanted, dtype) = (x.dtype, w.weight.dtype);
        let x = self.as_type(x, dtype)?;
        let residual = self.residual("conv2d", &shape, residual, dtype)?;
        let y = self.result(&shape, dtype, residual.as_ref())?;
        let rows = d.n * oh * ow;
        let bias = w.bias.as_ref();
        if kh * kw == 1 && window.stride == 1 && window.padding == 0 && w.pitch == w.inner {
            let (at, r) = (w.weight.at(), residual.as_ref());
            self.multiply([rows, w.out, w.inner], true, 1, x.at(), at, &y, bias, act, r)?;
        } else if self.convolve(&x, w, (d, window), &y, act, residual.as_ref())? {
            // Windows were gathered on the way to the matrix units.
        } else {
            countable("conv2d", rows)?;
            let row_bytes = w.pitch * dtype.size();
            // Parts start at multiples of 128 rows, so that addresses stay aligned.
            let part = (GATHERED / row_bytes / 128).max(1) * 128;
            let part = part.min(u32::MAX as usize / w.pitch / 128 * 128).max(128).min(rows);
            let gathered = self.make(&[part, w.pitch], dtype)?;
            let (unit, name) = if (w.inner * dtype.size()).is_multiple_of(16) {
                (16, "im2col_16")
            } else {
                (dtype.size(), if dtype == DType::BF16 { "im2col_2" } else { "im2col_4" })
            };
            let units = w.inner * dtype.size() / unit;
            let g: [i32; 9] = [d.h, d.w, units, kh, kw, window.stride, window.padding, oh, ow].map(|v: usize| v as i32);
            for first in (0..rows).step_by(part) {
                let here = part.min(rows - first);
                let (pitch, n) = (row_bytes / unit, here * row_bytes / unit);
                let args = Args::new().with(x.at()).with(gathered.at()).with(g).with(first as i64);
                let args = args.with(pitch as i64).with(n as i64);
                self.device.launch_over((Source::Images, name), n, args)?;
                let cut = |t: &Tensor| Tensor {
                    shape: vec![here, w.out],
                    offset: t.offset + first * w.out * dtype.size(),
                    ..t.clone()
                };
                let (y, r) = (cut(&y), residual.as_ref().map(cut));
                let sizes = [here, w.out, w.pitch];
                self.multiply(sizes, true, 1, gathered.at(), w.weight.at(), &y, bias, act, r.as_ref())?;
            }
        }
        drop(residual);
        self.owned_as(y, wanted)
    }

    fn conv_transpose2d(&self, x: &Tensor, w: &Conv, act: Act, residual: Option<Tensor>) -> Result<Tensor, NetError> {
        let d = Dims4::of("conv_transpose2d", &x.shape)?;
        if w.window.is_some() {
            return Err(NetError::shape("conv_transpose2d", "weights of a plain convolution"));
        }
        let k = w.kernel[0];
        host::check_last("conv_transpose2d", &x.shape, w.inner)?;
        let shape = [d.n, d.h * k, d.w * k, w.out];
        let (wanted, dtype) = (x.dtype, w.weight.dtype);
        let x = self.as_type(x, dtype)?;
        let residual = self.residual("conv_transpose2d", &shape, residual, dtype)?;
        let y = self.result(&shape, dtype, residual.as_ref())?;
        countable("conv_transpose2d", y.count())?;
        let cells = d.n * d.h * d.w;
        let wide = self.make(&[cells, k * k * w.out], dtype)?;
        let sizes = [cells, k * k * w.out, w.inner];
        self.multiply(sizes, true, 1, x.at(), w.weight.at(), &wide, None, Act::None, None)?;
        let address = |t: Option<&Tensor>| t.map_or(0u64, Tensor::at);
        let args = Args::new().with(wide.at()).with(y.at()).with(address(w.bias.as_ref()));
        let args = args.with(address(residual.as_ref())).with(act_code(act));
        let args = args.with(image_args(Dims4 { c: w.out, ..d })).with(k as i32).with(y.count() as i64);
        self.device.launch_over(kernel!(Images, "spread", dtype), y.count(), args)?;
        drop(residual);
        self.owned_as(y, wanted)
    }

    fn resize(&self, x: &Tensor, height: usize, width: usize, how: Resize) -> Result<Tensor, NetError> {
        let d = Dims4::of("resize", &x.shape)?;
        let y = self.make(&[d.n, height, width, d.c], x.dtype)?;
        countable("resize", y.count().max(x.count()))?;
        let scale = |input: usize, output: usize| match how {
            Resize::BilinearCorners if output > 1 => (input - 1) as f32 / (output - 1) as f32,
            Resize::BilinearCorners => 0.0,
            _ => input as f32 / output.max(1) as f32,
        };
        let code = match how {
            Resize::Nearest => 0,
            Resize::Bilinear => 1,
            Resize::BilinearCorners => 2,
            Resize::Bicubic => 3,
        };
        let wide = d.c.is_multiple_of(8);
        let n = y.count() / if wide { 8 } else { 1 };
        let args = Args::new().with(x.at()).with(y.at()).with(image_args(d)).with(height as i32).with(width as i32);
        let args = args.with(code).with(scale(d.h, height)).with(scale(d.w, width)).with(n as i64);
        self.device.launch_over(kernel!(Images, "resize", x.dtype), n, args.with(i32::from(wide)))?;
        Ok(y)
    }

    fn pool2d(&self, x: &Tensor, kind: Pool, window: Window) -> Result<Tensor, NetError> {
        let d = Dims4::of("pool2d", &x.shape)?;
        let (oh, ow) = host::conv_output("pool2d", d, window, window.size, window.size)?;
        let y = self.make(&[d.n, oh, ow, d.c], x.dtype)?;
        countable("pool2d", x.count())?;
        let args = Args::new().with(x.at()).with(y.at()).with(image_args(d)).with(i32::from(kind == Pool::Mean));
        let args = args.with(window.size as i32).with(window.stride as i32).with(window.padding as i32);
        let args = args.with(oh as i32).with(ow as i32).with(y.count() as i64);
        self.device.launch_over(kernel!(Images, "pool", x.dtype), y.count(), args)?;
        Ok(y)
    }

    fn activation(&self, x: &Tensor, act: Act) -> Result<Tensor, NetError> {
        let y = self.make(&x.shape, x.dtype)?;
        self.finish(x.at(), &y, None, act, None)?;
        Ok(y)
    }

    fn binary(&self, a: Tensor, b: &Tensor, op: Binary) -> Result<Tensor, NetError> {
        host::check_broadcast(&a.shape, &b.shape)?;
        let y = if a.is_sole() { a.clone() } else { self.make(&a.shape, a.dtype)? };
        let (n, period) = (a.count(), b.count());
        let wide = n.is_multiple_of(8) && period.is_multiple_of(8);
        let name = match (b.dtype, a.dtype) {
            (DType::BF16, DType::BF16) => "binary_bf16_bf16",
            (DType::BF16, _) => "binary_bf16_f32",
            (_, DType::BF16) => "binary_f32_bf16",
            _ => "binary_f32_f32",
        };
        let code = match op {
            Binary::Add => 0,
            Binary::Sub => 1,
            Binary::Mul => 2,
            Binary::Div => 3,
        };
        let args = Args::new().with(a.at()).with(b.at()).with(y.at()).with(code).with(n as i64).with(period as i64);
        let pieces = if wide { n / 8 } else { n };
        self.device.launch_over((Source::Pointwise, name), pieces, args.with(i32::from(wide)))?;
        Ok(y)
    }

    fn affine(&self, x: &Tensor, factor: f32, offset: f32) -> Result<Tensor, NetError> {
        let y = self.make(&x.shape, x.dtype)?;
        let args = Args::new().with(x.at()).with(y.at()).with(factor).with(offset).with(x.count() as i64);
        self.device.launch_over(kernel!(Pointwise, "affine", x.dtype), x.count(), args)?;
        Ok(y)
    }

    fn softmax(&self, x: &Tensor) -> Result<Tensor, NetError> {
        self.rows(x, kernel!(Rows, "softmax", x.dtype), |args| args.with(host::last(&x.shape) as i32))
    }

    fn l2_normalize(&self, x: &Tensor, eps: f32) -> Result<Tensor, NetError> {
        let columns = host::last(&x.shape) as i32;
        self.rows(x, kernel!(Rows, "l2_normalize", x.dtype), |args| args.with(eps).with(columns))
    }

    fn reduce(&self, x: &Tensor, how: Reduce) -> Result<Tensor, NetError> {
        let c = host::last(&x.shape);
        let rows = x.count() / c;
        let shape = if x.shape.len() > 1 { x.shape[..x.shape.len() - 1].to_vec() } else { vec![1] };
        let y = self.make(&shape, x.dtype)?;
        let code = match how {
            Reduce::Sum => 0,
            Reduce::Mean => 1,
            Reduce::Max => 2,
        };
        let args = Args::new().with(x.at()).with(y.at()).with(code).with(c as i32);
        self.device.launch(kernel!(Rows, "reduce", x.dtype), [rows, 1, 1], 128, 0, args)?;
        Ok(y)
    }

    fn replayable(
        &self,
        key: &str,
        inputs: &[&Tensor],
        body: &mut dyn FnMut(&[Tensor]) -> Result<Vec<Tensor>, NetError>,
    ) -> Result<Vec<Tensor>, NetError> {
        self.replay(key, inputs, body)
    }
}

impl Cuda {
    /// A convolution on warp-group products into `y`; `false` where it has to be done otherwise.
    fn convolve(
        &self,
        x: &Tensor,
        w: &Conv,
        (d, window): (Dims4, Window),
        y: &Tensor,
        act: Act,
        residual: Option<&Tensor>,
    ) -> Result<bool, NetError> {
        let bf16 = y.dtype == DType::BF16;
        let whole = w.inner.is_multiple_of(128 / y.dtype.size()) && w.out.is_multiple_of(2);
        if !self.device.groups || !(bf16 || self.tf32) || !whole || !matches!(act, Act::None | Act::Relu) {
            return Ok(false);
        }
        let pixels = y.count() / w.out;
        countable("conv2d", pixels)?;
        let blocks = pixels.div_ceil(128);
        // Wide blocks read pixels once; narrow ones where there would be too few blocks for the GPU.
        let processors = self.device.processors as usize;
        let (wide, stages) = match w.out {
            n if n > 128 && blocks * n.div_ceil(256) >= processors => (256, 4),
            n if n > 32 && blocks * n.div_ceil(128) * 2 >= processors => (128, 3),
            _ => (32, 4),
        };
        let shared = stages * (16384 + wide * 128) + 1024;
        let geometry =
            [d.h, d.w, w.inner, w.kernel[0], w.kernel[1], window.stride, window.padding, y.shape[1], y.shape[2]];
        let address = |t: Option<&Tensor>| t.map_or(0u64, Tensor::at);
        let args = Args::new().with(x.at()).with(w.weight.at()).with(y.at()).with(address(w.bias.as_ref()));
        let args = args.with(address(residual)).with(i32::from(act == Act::Relu)).with(geometry.map(|v| v as i32));
        let args = args.with(w.out as i32).with(pixels as i64);
        let source = Source::GroupConvolution(wide, stages, bf16);
        self.device.launch((source, "convolution"), [blocks, w.out.div_ceil(wide), 1], 256, shared, args)?;
        Ok(true)
    }
}

/// Queries, keys or values where they lie: start, batch step, token step.
fn part(p: Strided<'_, Tensor>) -> [i64; 3] {
    [p.start as i64, p.batch as i64, p.token as i64]
}

impl Cuda {
    fn attend(&self, qkv: &Qkv<'_, Tensor>, spec: &AttentionSpec<'_, Tensor>) -> Result<Tensor, NetError> {
        let p = host::attention_plan(qkv, spec)?;
        let dtype = p.q.tensor.dtype;
        if p.dim > 256 || p.value_dim > 256 {
            let what = format!("heads of {} and {} numbers; at most 256 here", p.dim, p.value_dim);
            return Err(NetError::shape("attention", what));
        }
        let full = |t: &Tensor| self.as_type(t, DType::F32);
        let bias = spec.bias.map(full).transpose()?;
        // What a kernel calls `Sizes`: seven numbers, the scale, two steps of the bias.
        let (bias_batch, bias_query) = (p.bias_at(1, 0) as u64, p.bias_at(0, 1) as u64);
        let sizes = |causal: bool| {
            let n = [p.batch, p.queries, p.keys, p.heads, p.dim, p.value_dim, usize::from(causal)].map(|v| v as u32);
            let scale = p.scale.to_bits();
            let [a, b] = [bias_batch, bias_query].map(|v| [v as u32, (v >> 32) as u32]);
            [n[0], n[1], n[2], n[3], n[4], n[5], n[6], scale, a[0], a[1], b[0], b[1]]
        };
        let (mut q, mut k) = ((p.q.tensor.at(), part(p.q)), (p.k.tensor.at(), part(p.k)));
        let mut prepared = None;
        if spec.qk_norm.is_some() || spec.rope.is_some() {
            let c = p.heads * p.dim;
            let (q_new, k_new) =
                (self.make(&[p.batch, p.queries, c], dtype)?, self.make(&[p.batch, p.keys, c], dtype)?);
            let norm = spec.qk_norm.as_ref().map(|n| [n.q_weight, n.q_bias, n.k_weight, n.k_bias].map(full));
            let norm = norm.map(|[a, b, c, d]| Ok::<_, NetError>([a?, b?, c?, d?])).transpose()?;
            let rope = spec.rope.as_ref().map(|r| Ok::<_, NetError>([full(r.cos)?, full(r.sin)?])).transpose()?;
            let norm_at = norm.as_ref().map_or([0; 4], |n| [n[0].at(), n[1].at(), n[2].at(), n[3].at()]);
            let rope_at = rope.as_ref().map_or([0; 2], |r| [r[0].at(), r[1].at()]);
            let eps = spec.qk_norm.as_ref().map_or(0.0, |n| n.eps);
            let args = Args::new().with(q.0).with(k.0).with(q.1).with(k.1).with(q_new.at()).with(k_new.at());
            let args = norm_at.iter().fold(args, |args, at| args.with(*at)).with(eps);
            let args = args.with(rope_at[0]).with(rope_at[1]).with(sizes(false));
            let heads = p.batch * p.queries.max(p.keys) * p.heads;
            let aligned = [part(p.q), part(p.k)].iter().flatten().all(|n| n % 8 == 0);
            if aligned && [32, 64, 128, 256].contains(&p.dim) {
                let grid = [heads.div_ceil(256 / (p.dim / 8)), 2, 1];
                self.device.launch(kernel!(Attention, "prepare_wide", dtype), grid, 256, 0, args)?;
            } else {
                let grid = [heads.div_ceil(8), 2, 1];
                self.device.launch(kernel!(Attention, "prepare", dtype), grid, 256, 0, args)?;
            }
            q = (q_new.at(), [0, (p.queries * c) as i64, c as i64]);
            k = (k_new.at(), [0, (p.keys * c) as i64, c as i64]);
            prepared = Some((q_new, k_new));
        }
        let y = self.make(&[p.batch, p.queries, p.heads * p.value_dim], dtype)?;
        let v = (p.v.tensor.at(), part(p.v));
        let args = Args::new().with(q.0).with(k.0).with(v.0).with(q.1).with(k.1).with(v.1);
        let args = args.with(bias.as_ref().map_or(0, Tensor::at)).with(y.at()).with(sizes(spec.causal));
        let aligned = [q.1, k.1, v.1].iter().flatten().all(|n| n % 8 == 0);
        let quick = self.device.arch >= 80 && dtype == DType::BF16 && aligned && p.dim.is_multiple_of(8);
        // Blocks of 192 queries: worth it where there are enough of them for two thirds of the GPU.
        let blocks = p.queries.div_ceil(192) * p.heads * p.batch;
        let plain = bias.is_none() && !spec.causal && p.dim == 64 && p.value_dim == 64 && p.scale > 0.0 && p.keys > 0;
        if quick && plain && self.device.groups && blocks * 3 >= 2 * self.device.processors as usize {
            let args = Args::new().with(q.0).with(k.0).with(v.0).with(q.1).with(k.1).with(v.1).with(y.at());
            // Queries, four stages of keys and values, a barrier, and room to start at a multiple of 1024 bytes.
            let shared = 3 * 8192 + 4 * 32768 + 16 + 1024;
            let grid = [p.queries.div_ceil(192), p.heads, p.batch];
            let args = args.with(sizes(false));
            self.device.launch((Source::GroupAttention, "attention_64"), grid, 384, shared, args)?;
        } else if quick && p.dim == p.value_dim && p.dim <= 128 {
            let head = p.dim.next_multiple_of(16);
            // Queries, and two stages of keys and values, rows filled up by eight numbers.
            let shared = 5 * 64 * (head + 8) * 2;
            let grid = [p.queries.div_ceil(64), p.heads, p.batch];
            self.device.launch((Source::Flash(head), "flash"), grid, 128, shared, args)?;
        } else {
            let shared = (16 * p.dim + 32 * (p.dim + 1) + 32 * p.value_dim + 16 * 33) * 4;
            let grid = [p.queries.div_ceil(16), p.heads, p.batch];
            self.device.launch(kernel!(Attention, "attention", dtype), grid, 128, shared, args)?;
        }
        drop(prepared);
        Ok(y)
    }
}
