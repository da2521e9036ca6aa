//! The image encoder's trunk: Hiera (Ryali et al. 2023, arXiv 2306.00989) with absolute windowed positions
//! (Bolya et al. 2023, arXiv 2311.05613).

use super::Sam2Config;
use crate::backend::{Act, AttentionSpec, Backend, Binary, Pool, Qkv, Resize, TensorHandle, Window};
use crate::params::{Mlp, Norm, Params};
use crate::residual::{added, wide};
use crate::{DType, HostTensor, NetError};

const EPS: f32 = 1e-6;
const HALVE: Window = Window { size: 2, stride: 2, padding: 0 };

/// The trunk.
pub(super) struct Hiera<B: Backend> {
    patches: B::Conv,
    positions: B::Tensor,
    blocks: Vec<Block<B>>,
    ends: [usize; 4],
}

struct Block<B: Backend> {
    norm1: Norm<B>,
    qkv: B::Linear,
    out: B::Linear,
    norm2: Norm<B>,
    mlp: Mlp<B>,
    /// Where the width changes: the way around the attention, halved like the queries.
    shortcut: Option<B::Linear>,
    width: usize,
    heads: usize,
    /// Side of the windows; 0 = the whole image.
    window: usize,
}

impl<B: Backend> Hiera<B> {
    pub(super) fn load(p: &Params<'_, B>, config: &Sam2Config) -> Result<Self, NetError> {
        // First what tells one size from another most plainly.
        let patches = p.conv("patch_embed.proj", [config.embed, 3, 7, 7], Window::conv(4, 3))?;
        let mut blocks = Vec::new();
        let mut ends = [0; 4];
        let channels = config.channels();
        for (stage, count) in config.stages.into_iter().enumerate() {
            for i in 0..count {
                let index = blocks.len();
                // The first block of a stage still has the width and the window of the stage before.
                let first = i == 0 && stage > 0;
                let from = if first { stage - 1 } else { stage };
                let window = if config.global_blocks.contains(&index) { 0 } else { config.windows[from] };
                let heads = config.heads << stage;
                let b = p.at(&format!("blocks.{index}"));
                blocks.push(Block::load(&b, channels[from], channels[stage], heads, window)?);
            }
            ends[stage] = blocks.len().saturating_sub(1);
        }
        Ok(Self { patches, positions: positions(p, config)?, blocks, ends })
    }

    /// `[1, side, side, 3]` to the ends of the four stages, finest first, in f32.
    pub(super) fn forward(&self, b: &B, image: B::Tensor) -> Result<Vec<B::Tensor>, NetError> {
        let mut x = wide(b, b.conv2d(&image, &self.patches, Act::None, None)?)?;
        drop(image);
        x = b.binary(x, &self.positions, Binary::Add)?;
        let mut ends = Vec::with_capacity(4);
        for (i, block) in self.blocks.iter().enumerate() {
            x = block.forward(b, x)?;
            if self.ends.contains(&i) {
                ends.push(x.clone());
            }
        }
        Ok(ends)
    }
}

/// Stretched positions of the whole image, plus those inside a window of the first stage, repeated.
fn positions<B: Backend>(p: &Params<'_, B>, config: &Sam2Config) -> Result<B::Tensor, NetError> {
    let (c, n, k) = (config.embed, config.image_size / 4, config.background);
    let b = p.backend;
    let stretched = b.permute(&p.tensor("pos_embed", &[1, c, k, k])?, &[0, 2, 3, 1])?;
    let stretched = b.resize(&stretched, n, n, Resize::Bicubic)?;
    let side = config.windows[0];
    let inside = p.host("pos_embed_window", &[1, c, side, side])?.to_f32();
    if !n.is_multiple_of(side) {
        return Err(NetError::shape("Hiera positions", format!("{n} cells are no multiple of the window of {side}")));
    }
    let at = |y: usize, x: usize| {
        let inside = &inside;
        (0..c).map(move |c| inside[(c * side + y % side) * side + x % side])
    };
    let tiled: Vec<f32> = (0..n).flat_map(|y| (0..n).flat_map(move |x| at(y, x))).collect();
    let tiled = b.load(&HostTensor::from_f32(&[n, n, c], tiled), DType::F32)?;
    b.reshape(&b.binary(stretched, &tiled, Binary::Add)?, &[n, n, c])
}

impl<B: Backend> Block<B> {
    fn load(p: &Params<'_, B>, from: usize, to: usize, heads: usize, window: usize) -> Result<Self, NetError> {
        Ok(Self {
            norm1: p.norm("norm1", from, EPS)?,
            qkv: p.linear("attn.qkv", 3 * to, from)?,
            out: p.linear("attn.proj", to, to)?,
            norm2: p.norm("norm2", to, EPS)?,
            mlp: p.mlp(&["mlp.layers.0", "mlp.layers.1"], &[to, 4 * to, to], Act::Gelu)?,
            shortcut: if from == to { None } else { Some(p.linear("proj", to, from)?) },
            width: to,
            heads,
            window,
        })
    }

    fn forward(&self, b: &B, x: B::Tensor) -> Result<B::Tensor, NetError> {
        let normed = b.cast(&self.norm1.apply(b, &x)?, b.preferred())?;
        let shortcut = match &self.shortcut {
            // From the normalised input, unlike in other blocks.
            Some(proj) => wide(b, b.pool2d(&b.linear(&normed, proj, Act::None, None)?, Pool::Max, HALVE)?)?,
            None => x,
        };
        let attended = self.attend(b, &normed, shortcut.dim(1), shortcut.dim(2))?;
        drop(normed);
        let x = added(b, shortcut, |residual| b.linear(&attended, &self.out, Act::None, residual))?;
        drop(attended);
        let normed = b.cast(&self.norm2.apply(b, &x)?, b.preferred())?;
        added(b, x, |residual| self.mlp.apply(b, &normed, residual))
    }

    /// Attention inside windows, to `[1, height, width, channels]`.
    fn attend(&self, b: &B, x: &B::Tensor, height: usize, width: usize) -> Result<B::Tensor, NetError> {
        let windows = match self.window {
            0 => b.reshape(x, &[x.dim(0), x.dim(1) * x.dim(2), x.dim(3)])?,
            side => b.window_partition(x, side)?,
        };
        let qkv = b.linear(&windows, &self.qkv, Act::None, None)?;
        drop(windows);
        let spec = AttentionSpec::heads(self.heads);
        let (attended, side) = if self.shortcut.is_none() {
            (b.attention(Qkv::Packed(&qkv), &spec)?, self.window)
        } else {
            let part = |i| b.slice(&qkv, 2, i * self.width, self.width);
            let (rows, columns) = if self.window == 0 { (x.dim(1), x.dim(2)) } else { (self.window, self.window) };
            let q = b.reshape(&part(0)?, &[qkv.dim(0), rows, columns, self.width])?;
            let q = b.pool2d(&q, Pool::Max, HALVE)?;
            let q = b.reshape(&q, &[qkv.dim(0), q.dim(1) * q.dim(2), self.width])?;
            let (k, v) = (part(1)?, part(2)?);
            (b.attention(Qkv::Separate { q: &q, k: &k, v: &v }, &spec)?, self.window / 2)
        };
        match self.window {
            0 => b.reshape(&attended, &[x.dim(0), height, width, self.width]),
            _ => b.window_merge(&attended, side, height, width),
        }
    }
}
