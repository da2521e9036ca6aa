//! Shapes checked in one place, and the moving of values in host memory, for backends that live there.

#![expect(clippy::missing_errors_doc, reason = "every function: NetError::Shape when shapes do not fit")]

use crate::NetError;
use crate::backend::{AttentionSpec, ConvWeights, LinearWeights, Pool, Qkv, TensorHandle, Window};

/// Length of the last axis; 1 for a scalar.
pub fn last(shape: &[usize]) -> usize {
    shape.last().copied().unwrap_or(1).max(1)
}

/// The shape with another last axis.
pub fn with_last(shape: &[usize], last: usize) -> Vec<usize> {
    let mut shape = shape.to_vec();
    match shape.last_mut() {
        Some(end) => *end = last,
        None => shape.push(last),
    }
    shape
}

type Checked<T = ()> = Result<T, NetError>;

/// Two shapes must be equal.
pub fn check_equal(op: &'static str, found: &[usize], wanted: &[usize]) -> Checked {
    if found == wanted {
        return Ok(());
    }
    Err(NetError::shape(op, format!("shape {found:?}, wanted {wanted:?}")))
}

/// The last axis must have this length.
pub fn check_last(op: &'static str, shape: &[usize], wanted: usize) -> Checked {
    if shape.last() == Some(&wanted) {
        return Ok(());
    }
    Err(NetError::shape(op, format!("shape {shape:?}, its last axis must be {wanted}")))
}

/// A residual has the shape of the result.
pub fn check_residual(op: &'static str, result: &[usize], residual: Option<&[usize]>) -> Checked {
    match residual {
        Some(found) if found != result => {
            Err(NetError::shape(op, format!("residual {found:?}, the result is {result:?}")))
        }
        _ => Ok(()),
    }
}

/// A new shape has as many elements.
pub fn check_reshape(from: &[usize], to: &[usize]) -> Checked {
    if from.iter().product::<usize>() == to.iter().product::<usize>() {
        return Ok(());
    }
    Err(NetError::shape("reshape", format!("{from:?} to {to:?}")))
}

/// `b` is `a`'s shape, its end, or `[1]`.
pub fn check_broadcast(a: &[usize], b: &[usize]) -> Checked {
    if a.ends_with(b) || b == [1] {
        return Ok(());
    }
    Err(NetError::shape("binary", format!("{b:?} is neither {a:?} nor its end")))
}

/// Shapes of a linear layer's weights.
pub fn check_linear(w: &LinearWeights) -> Checked {
    let &[out, _] = w.weight.shape() else {
        return Err(NetError::shape("load_linear", format!("weight {:?}, wanted two axes", w.weight.shape())));
    };
    for part in [&w.bias, &w.scale].into_iter().flatten() {
        check_equal("load_linear", part.shape(), &[out])?;
    }
    Ok(())
}

/// Shapes of a convolution's weights; `out_axis` is 0 for plain and 1 for transposed ones.
pub fn check_conv(w: &ConvWeights, out_axis: usize) -> Checked {
    let shape = four("load_conv", w.weight.shape())?;
    w.bias.as_ref().map_or(Ok(()), |b| check_equal("load_conv", b.shape(), &[shape[out_axis]]))
}

/// A shape of four axes.
pub fn four(op: &'static str, shape: &[usize]) -> Checked<[usize; 4]> {
    <[usize; 4]>::try_from(shape).map_err(|_| NetError::shape(op, format!("shape {shape:?}, wanted four axes")))
}

/// An image tensor's axes.
#[derive(Debug, Clone, Copy)]
pub struct Dims4 {
    /// Images.
    pub n: usize,
    /// Rows.
    pub h: usize,
    /// Columns.
    pub w: usize,
    /// Channels.
    pub c: usize,
}

impl Dims4 {
    /// From a shape `[N, H, W, C]`.
    pub fn of(op: &'static str, shape: &[usize]) -> Checked<Self> {
        let [n, h, w, c] = four(op, shape)?;
        if shape.contains(&0) {
            return Err(NetError::shape(op, format!("empty image {shape:?}")));
        }
        Ok(Self { n, h, w, c })
    }

    /// Offset of channel 0 at a position in the padded image; `None` in the padding.
    pub fn padded(self, n: usize, y: usize, x: usize, padding: usize) -> Option<usize> {
        let (y, x) = (y.checked_sub(padding)?, x.checked_sub(padding)?);
        (y < self.h && x < self.w).then(|| ((n * self.h + y) * self.w + x) * self.c)
    }
}

/// Height and width of a convolution's result.
pub fn conv_output(op: &'static str, d: Dims4, window: Window, kh: usize, kw: usize) -> Checked<(usize, usize)> {
    window
        .output(d.h, kh)
        .zip(window.output(d.w, kw))
        .ok_or_else(|| NetError::shape(op, format!("window {kh}x{kw} {window:?} does not fit {}x{}", d.h, d.w)))
}

/// Sizes of a batched product.
#[derive(Debug, Clone)]
pub struct MatmulPlan {
    /// Shape of the result.
    pub shape: Vec<usize>,
    /// Number of products.
    pub batch: usize,
    /// Whether `b` has one matrix a product.
    pub b_batched: bool,
    /// Rows.
    pub m: usize,
    /// Columns.
    pub n: usize,
    /// Summed axis.
    pub k: usize,
}

/// Checks the shapes of a batched product.
pub fn matmul_plan(a: &[usize], b: &[usize], b_transposed: bool) -> Checked<MatmulPlan> {
    let wrong = || NetError::shape("matmul", format!("{a:?} by {b:?} (transposed: {b_transposed})"));
    let (&[ref a_front @ .., m, k], &[ref b_front @ .., b0, b1]) = (a, b) else { return Err(wrong()) };
    let (bk, n) = if b_transposed { (b1, b0) } else { (b0, b1) };
    if bk != k || (!b_front.is_empty() && a_front != b_front) {
        return Err(wrong());
    }
    let mut shape = a_front.to_vec();
    shape.extend([m, n]);
    Ok(MatmulPlan { shape, batch: a_front.iter().product(), b_batched: !b_front.is_empty(), m, n, k })
}

/// Queries, keys or values inside a tensor.
#[derive(Debug)]
pub struct Strided<'a, T> {
    /// The tensor.
    pub tensor: &'a T,
    /// Offset of the first number.
    pub start: usize,
    /// From one batch to the next.
    pub batch: usize,
    /// From one token to the next.
    pub token: usize,
}

impl<T> Clone for Strided<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<T> Copy for Strided<'_, T> {}

impl<T> Strided<'_, T> {
    /// Offset of a token's first head.
    pub fn at(self, batch: usize, token: usize) -> usize {
        self.start + batch * self.batch + token * self.token
    }
}

/// Sizes of an attention.
#[derive(Debug)]
pub struct AttentionPlan<'a, T> {
    /// Batches.
    pub batch: usize,
    /// Queries a batch.
    pub queries: usize,
    /// Keys a batch.
    pub keys: usize,
    /// Heads.
    pub heads: usize,
    /// Numbers a head of queries and keys.
    pub dim: usize,
    /// Numbers a head of values.
    pub value_dim: usize,
    /// Factor on the scores.
    pub scale: f32,
    /// Queries.
    pub q: Strided<'a, T>,
    /// Keys.
    pub k: Strided<'a, T>,
    /// Values.
    pub v: Strided<'a, T>,
    bias_strides: (usize, usize),
}

impl<T> AttentionPlan<'_, T> {
    /// Offset of the bias row of a query.
    pub fn bias_at(&self, batch: usize, query: usize) -> usize {
        batch * self.bias_strides.0 + query * self.bias_strides.1
    }
}

/// Checks the shapes of an attention.
pub fn attention_plan<'a, T: TensorHandle>(
    qkv: &Qkv<'a, T>,
    spec: &AttentionSpec<'_, T>,
) -> Checked<AttentionPlan<'a, T>> {
    const OP: &str = "attention";
    let three = |t: &T| {
        <[usize; 3]>::try_from(t.shape())
            .map_err(|_| NetError::shape(OP, format!("shape {:?}, wanted three axes", t.shape())))
    };
    let heads = spec.heads;
    let per_head = |c: usize| {
        (heads > 0 && c > 0 && c.is_multiple_of(heads))
            .then(|| c / heads)
            .ok_or_else(|| NetError::shape(OP, format!("{c} channels in {heads} heads")))
    };
    let (batch, queries, keys, dim, value_dim, q, k, v) = match *qkv {
        Qkv::Packed(x) => {
            let [b, n, c3] = three(x)?;
            if !c3.is_multiple_of(3) {
                return Err(NetError::shape(OP, format!("{c3} packed channels")));
            }
            let c = c3 / 3;
            let part = |i: usize| Strided { tensor: x, start: i * c, batch: n * c3, token: c3 };
            let dim = per_head(c)?;
            (b, n, n, dim, dim, part(0), part(1), part(2))
        }
        Qkv::Separate { q, k, v } => {
            let ([b, nq, cq], [bk, nk, ck], [bv, nv, cv]) = (three(q)?, three(k)?, three(v)?);
            if bk != b || bv != b || ck != cq || nv != nk {
                let what = format!("queries {:?}, keys {:?}, values {:?}", q.shape(), k.shape(), v.shape());
                return Err(NetError::shape(OP, what));
            }
            let part = |t: &'a T, n: usize, c: usize| Strided { tensor: t, start: 0, batch: n * c, token: c };
            (b, nq, nk, per_head(cq)?, per_head(cv)?, part(q, nq, cq), part(k, nk, ck), part(v, nk, cv))
        }
    };
    if let Some(norm) = &spec.qk_norm {
        for t in [norm.q_weight, norm.q_bias, norm.k_weight, norm.k_bias] {
            check_equal(OP, t.shape(), &[dim])?;
        }
    }
    if let Some(rope) = &spec.rope {
        if queries != keys || !dim.is_multiple_of(4) {
            return Err(NetError::shape(OP, format!("rotary: {queries} queries, {keys} keys, head of {dim}")));
        }
        for t in [rope.cos, rope.sin] {
            check_equal(OP, t.shape(), &[queries, dim / 2])?;
        }
    }
    let mut bias_strides = (0, 0);
    if let Some(bias) = spec.bias {
        let [bb, bq, bk] = three(bias)?;
        if (bb != batch && bb != 1) || (bq != queries && bq != 1) || bk != keys {
            return Err(NetError::shape(OP, format!("bias {:?} for {batch}x{queries}x{keys}", bias.shape())));
        }
        bias_strides = (if bb == 1 { 0 } else { bq * bk }, if bq == 1 { 0 } else { bk });
    }
    let scale = spec.scale.unwrap_or(1.0 / (dim as f32).sqrt());
    Ok(AttentionPlan { batch, queries, keys, heads, dim, value_dim, scale, q, k, v, bias_strides })
}

type Moved = Checked<(Vec<usize>, Vec<f32>)>;

/// Axes in another order.
pub fn permute(shape: &[usize], data: &[f32], order: &[usize]) -> Moved {
    let mut sorted = order.to_vec();
    sorted.sort_unstable();
    if !sorted.iter().copied().eq(0..shape.len()) {
        return Err(NetError::shape("permute", format!("order {order:?} of {shape:?}")));
    }
    let mut strides = vec![1; shape.len()];
    for i in (0..shape.len().saturating_sub(1)).rev() {
        strides[i] = strides[i + 1] * shape[i + 1];
    }
    let new: Vec<usize> = order.iter().map(|i| shape[*i]).collect();
    let step: Vec<usize> = order.iter().map(|i| strides[*i]).collect();
    let mut out = Vec::with_capacity(data.len());
    let mut index = vec![0usize; new.len()];
    let mut at = 0usize;
    for _ in 0..data.len() {
        out.push(data[at]);
        for axis in (0..new.len()).rev() {
            index[axis] += 1;
            at += step[axis];
            if index[axis] < new[axis] {
                break;
            }
            at -= step[axis] * new[axis];
            index[axis] = 0;
        }
    }
    Ok((new, out))
}

/// Tensors one after the other along an axis.
pub fn concat(parts: &[(&[usize], &[f32])], axis: usize) -> Moved {
    let wrong = || {
        let shapes: Vec<_> = parts.iter().map(|p| p.0).collect();
        NetError::shape("concat", format!("{shapes:?} along axis {axis}"))
    };
    let Some(&(first, _)) = parts.first() else { return Err(wrong()) };
    if axis >= first.len() {
        return Err(wrong());
    }
    let mut shape = first.to_vec();
    shape[axis] = 0;
    for (s, _) in parts {
        let fits = s.len() == first.len() && (0..s.len()).all(|i| i == axis || s[i] == first[i]);
        if !fits {
            return Err(wrong());
        }
        shape[axis] += s[axis];
    }
    let outer: usize = first[..axis].iter().product();
    let inner: usize = first[axis + 1..].iter().product();
    let mut out = Vec::with_capacity(shape.iter().product());
    for o in 0..outer {
        for (s, data) in parts {
            let n = s[axis] * inner;
            out.extend_from_slice(&data[o * n..(o + 1) * n]);
        }
    }
    Ok((shape, out))
}

/// A part of an axis.
pub fn slice(shape: &[usize], data: &[f32], axis: usize, start: usize, len: usize) -> Moved {
    if axis >= shape.len() || start.checked_add(len).is_none_or(|end| end > shape[axis]) {
        return Err(NetError::shape("slice", format!("{start}+{len} of axis {axis} of {shape:?}")));
    }
    let outer: usize = shape[..axis].iter().product();
    let inner: usize = shape[axis + 1..].iter().product();
    let mut out = Vec::with_capacity(outer * len * inner);
    for o in 0..outer {
        let at = (o * shape[axis] + start) * inner;
        out.extend_from_slice(&data[at..at + len * inner]);
    }
    let mut shape = shape.to_vec();
    shape[axis] = len;
    Ok((shape, out))
}

/// Rows of a table.
pub fn gather_rows(shape: &[usize], data: &[f32], ids: &[u32]) -> Moved {
    let &[rows, c] = shape else {
        return Err(NetError::shape("gather_rows", format!("table {shape:?}, wanted two axes")));
    };
    let mut out = Vec::with_capacity(ids.len() * c);
    for id in ids {
        let id = *id as usize;
        if id >= rows {
            return Err(NetError::shape("gather_rows", format!("row {id} of {rows}")));
        }
        out.extend_from_slice(&data[id * c..(id + 1) * c]);
    }
    Ok((vec![ids.len(), c], out))
}

/// Windows of an image, zeros filled in.
pub fn window_partition(shape: &[usize], data: &[f32], side: usize) -> Moved {
    let d = Dims4::of("window_partition", shape)?;
    if side == 0 {
        return Err(NetError::shape("window_partition", "a window of nothing"));
    }
    let (rows, columns) = (d.h.div_ceil(side), d.w.div_ceil(side));
    let shape = vec![d.n * rows * columns, side * side, d.c];
    let mut out = vec![0f32; shape.iter().product()];
    let mut to = 0;
    for n in 0..d.n {
        for (wy, wx) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
            for y in wy * side..(wy + 1) * side {
                let x0 = wx * side;
                let width = side.min(d.w.saturating_sub(x0));
                if y < d.h && width > 0 {
                    let from = ((n * d.h + y) * d.w + x0) * d.c;
                    out[to..to + width * d.c].copy_from_slice(&data[from..from + width * d.c]);
                }
                to += side * d.c;
            }
        }
    }
    Ok((shape, out))
}

/// The inverse of [`window_partition`].
pub fn window_merge(shape: &[usize], data: &[f32], side: usize, height: usize, width: usize) -> Moved {
    let wrong =
        || NetError::shape("window_merge", format!("{shape:?}, windows of {side} to an image of {height}x{width}"));
    let &[windows, tokens, c] = shape else { return Err(wrong()) };
    if side == 0 || height == 0 || width == 0 || tokens != side * side {
        return Err(wrong());
    }
    let (rows, columns) = (height.div_ceil(side), width.div_ceil(side));
    if !windows.is_multiple_of(rows * columns) {
        return Err(wrong());
    }
    let n = windows / (rows * columns);
    let mut out = Vec::with_capacity(n * height * width * c);
    for i in 0..n {
        for y in 0..height {
            for wx in 0..columns {
                let window = (i * rows + y / side) * columns + wx;
                let from = (window * tokens + y % side * side) * c;
                let part = side.min(width - wx * side) * c;
                out.extend_from_slice(&data[from..from + part]);
            }
        }
    }
    Ok((vec![n, height, width, c], out))
}

/// Pooling.
pub fn pool2d(shape: &[usize], data: &[f32], kind: Pool, window: Window) -> Moved {
    let d = Dims4::of("pool2d", shape)?;
    let (oh, ow) = conv_output("pool2d", d, window, window.size, window.size)?;
    let start = if kind == Pool::Max { f32::NEG_INFINITY } else { 0.0 };
    let mut out = vec![start; d.n * oh * ow * d.c];
    for (i, cell) in out.chunks_exact_mut(d.c).enumerate() {
        let (n, oy, ox) = (i / (oh * ow), i / ow % oh, i % ow);
        for ky in 0..window.size {
            for kx in 0..window.size {
                let (y, x) = (oy * window.stride + ky, ox * window.stride + kx);
                let Some(at) = d.padded(n, y, x, window.padding) else { continue };
                for (o, v) in cell.iter_mut().zip(&data[at..at + d.c]) {
                    *o = if kind == Pool::Max { o.max(*v) } else { *o + v };
                }
            }
        }
        if kind == Pool::Mean {
            for o in cell {
                *o /= (window.size * window.size) as f32;
            }
        }
    }
    Ok((vec![d.n, oh, ow, d.c], out))
}
