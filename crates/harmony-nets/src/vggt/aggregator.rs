//! The trunk: a DINOv2 ViT as patch embedding, then frame and global attention in turn.

use super::block::{Block, BlockSize, Loader, Norm};
use super::config::VggtConfig;
use crate::backend::{Act, Binary, Rope2d, TensorHandle, Window};
use crate::{Backend, DType, HostTensor, NetError, Weights, math};

/// The trunk of VGGT.
pub struct Aggregator<B: Backend> {
    config: VggtConfig,
    dtype: DType,
    projection: B::Conv,
    cls: Vec<f32>,
    positions: Vec<f32>,
    registers: B::Tensor,
    embed_blocks: Vec<Block<B>>,
    embed_norm: Norm<B>,
    frame_blocks: Vec<Block<B>>,
    global_blocks: Vec<Block<B>>,
    /// Camera and register tokens of the first frame and of the others, `[1, 1 + registers, dim]`.
    first_tokens: B::Tensor,
    other_tokens: B::Tensor,
}

/// What the trunk needs to know of a size of photos: made once a size, before anything is recorded.
pub struct TrunkTables<B: Backend> {
    cls: B::Tensor,
    positions: B::Tensor,
    frame: (B::Tensor, B::Tensor),
    global: (B::Tensor, B::Tensor),
}

/// What the heads take from the trunk: the tokens of four levels, `[S, P, 2 dim]`.
pub struct Aggregated<B: Backend> {
    /// By level.
    pub levels: Vec<B::Tensor>,
    /// Tokens in front of the patches.
    pub special: usize,
}

impl<B: Backend> Aggregator<B> {
    /// Loads the trunk in the backend's preferred type.
    pub fn load(backend: &B, weights: &Weights<'_>, config: &VggtConfig) -> Result<Self, NetError> {
        let at = weights.at("aggregator");
        let embed = at.at("patch_embed");
        let dtype = backend.preferred();
        let loader = Loader { backend, dtype };
        let VggtConfig { dim, heads, patch, registers, grid, .. } = *config;
        let size = BlockSize { dim, heads, eps: 1e-6, qk_norm: false };
        let blocks = |at: &Weights<'_>, n: usize, size: BlockSize| {
            (0..n).map(|i| Block::load(&loader, &at.at(i), size)).collect::<Result<Vec<_>, _>>()
        };
        let aa = BlockSize { eps: 1e-5, qk_norm: true, ..size };
        let camera = at.get("camera_token", &[1, 2, 1, dim])?.to_f32();
        let register = at.get("register_token", &[1, 2, registers, dim])?.to_f32();
        let special = |i: usize| {
            let mut tokens = camera[i * dim..(i + 1) * dim].to_vec();
            tokens.extend_from_slice(&register[i * registers * dim..(i + 1) * registers * dim]);
            backend.load(&HostTensor::from_f32(&[1, 1 + registers, dim], tokens), dtype)
        };
        Ok(Self {
            dtype,
            projection: loader.conv(&embed.at("patch_embed.proj"), [dim, 3, patch], Window::conv(patch, 0), true)?,
            cls: embed.get("cls_token", &[1, 1, dim])?.to_f32(),
            positions: embed.get("pos_embed", &[1, 1 + grid * grid, dim])?.to_f32(),
            registers: loader.tensor(&embed, "register_tokens", &[1, registers, dim])?,
            embed_blocks: blocks(&embed.at("blocks"), config.embed_depth, size)?,
            embed_norm: loader.norm(&embed.at("norm"), dim, 1e-6)?,
            frame_blocks: blocks(&at.at("frame_blocks"), config.depth, aa)?,
            global_blocks: blocks(&at.at("global_blocks"), config.depth, aa)?,
            first_tokens: special(0)?,
            other_tokens: special(1)?,
            config: config.clone(),
        })
    }

    /// Tables for `frames` photos of `rows` by `columns` patches.
    pub fn tables(
        &self,
        backend: &B,
        frames: usize,
        (rows, columns): (usize, usize),
    ) -> Result<TrunkTables<B>, NetError> {
        let dim = self.config.dim;
        let load = |shape: &[usize], data: Vec<f32>| backend.load(&HostTensor::from_f32(shape, data), self.dtype);
        // The class token gets the first position, the patches theirs, the registers none.
        let cls: Vec<f32> = self.cls.iter().zip(&self.positions).map(|(a, b)| a + b).collect();
        let (special, head) = (1 + self.config.registers, dim / self.config.heads);
        Ok(TrunkTables {
            cls: load(&[1, 1, dim], cls)?,
            positions: load(&[rows * columns, dim], self.patch_positions(rows, columns))?,
            frame: rope_tables(backend, special, rows, columns, 1, head)?,
            global: rope_tables(backend, special, rows, columns, frames, head)?,
        })
    }

    /// Runs the trunk on normalised images `[S, H, W, 3]`.
    pub fn run(&self, backend: &B, images: &B::Tensor, tables: &TrunkTables<B>) -> Result<Aggregated<B>, NetError> {
        let (frames, height, width) = (images.dim(0), images.dim(1), images.dim(2));
        let (rows, columns) = (height / self.config.patch, width / self.config.patch);
        let dim = self.config.dim;
        let patches = self.embed(backend, images, tables, rows * columns)?;
        let mut with_special = Vec::with_capacity(frames);
        for frame in 0..frames {
            let own = backend.slice(&patches, 0, frame, 1)?;
            let special = if frame == 0 { &self.first_tokens } else { &self.other_tokens };
            with_special.push(backend.concat(&[special, &own], 1)?);
        }
        let mut tokens = backend.concat(&with_special.iter().collect::<Vec<_>>(), 0)?;
        drop((patches, with_special));
        let special = 1 + self.config.registers;
        let count = special + rows * columns;
        let rope = |(cos, sin)| Some(Rope2d { cos, sin });
        let (frame_cos, frame_sin) = &tables.frame;
        let (global_cos, global_sin) = &tables.global;
        let mut levels = Vec::with_capacity(4);
        for (i, (frame_block, global_block)) in self.frame_blocks.iter().zip(&self.global_blocks).enumerate() {
            tokens = frame_block.run(backend, tokens, rope((frame_cos, frame_sin)))?;
            let kept = self.config.levels.contains(&i).then(|| tokens.clone());
            let all = backend.reshape(&tokens, &[1, frames * count, dim])?;
            drop(tokens);
            let all = global_block.run(backend, all, rope((global_cos, global_sin)))?;
            tokens = backend.reshape(&all, &[frames, count, dim])?;
            drop(all);
            if let Some(frame_tokens) = kept {
                levels.push(backend.concat(&[&frame_tokens, &tokens], 2)?);
            }
        }
        Ok(Aggregated { levels, special })
    }

    /// Patch tokens `[S, count, dim]`.
    fn embed(
        &self,
        backend: &B,
        images: &B::Tensor,
        tables: &TrunkTables<B>,
        count: usize,
    ) -> Result<B::Tensor, NetError> {
        let (frames, dim) = (images.dim(0), self.config.dim);
        let images = backend.cast(images, self.dtype)?;
        let patches = backend.conv2d(&images, &self.projection, Act::None, None)?;
        let patches = backend.reshape(&patches, &[frames, count, dim])?;
        let patches = backend.binary(patches, &tables.positions, Binary::Add)?;
        let mut all = Vec::with_capacity(frames);
        for frame in 0..frames {
            let own = backend.slice(&patches, 0, frame, 1)?;
            all.push(backend.concat(&[&tables.cls, &self.registers, &own], 1)?);
        }
        let mut tokens = backend.concat(&all.iter().collect::<Vec<_>>(), 0)?;
        drop((patches, all));
        for block in &self.embed_blocks {
            tokens = block.run(backend, tokens, None)?;
        }
        let tokens = self.embed_norm.run(backend, &tokens)?;
        backend.slice(&tokens, 1, 1 + self.config.registers, count)
    }

    /// Learned positions for a grid of patches: the stored ones, or these resized (cubic, antialiased).
    fn patch_positions(&self, rows: usize, columns: usize) -> Vec<f32> {
        let (grid, dim) = (self.config.grid, self.config.dim);
        let stored = &self.positions[dim..];
        if rows == grid && columns == grid {
            return stored.to_vec();
        }
        let (ys, xs) = (math::cubic_antialias_taps(grid, rows), math::cubic_antialias_taps(grid, columns));
        // Along x first, as PyTorch does it.
        let mut wide = vec![0f32; grid * columns * dim];
        for y in 0..grid {
            for (x, (first, weights)) in xs.iter().enumerate() {
                let to = &mut wide[(y * columns + x) * dim..][..dim];
                for (k, weight) in weights.iter().enumerate() {
                    let from = &stored[(y * grid + first + k) * dim..][..dim];
                    to.iter_mut().zip(from).for_each(|(t, f)| *t += *weight as f32 * f);
                }
            }
        }
        let mut out = vec![0f32; rows * columns * dim];
        for (y, (first, weights)) in ys.iter().enumerate() {
            let to = &mut out[y * columns * dim..][..columns * dim];
            for (k, weight) in weights.iter().enumerate() {
                let from = &wide[(first + k) * columns * dim..][..columns * dim];
                to.iter_mut().zip(from).for_each(|(t, f)| *t += *weight as f32 * f);
            }
        }
        out
    }
}

/// Cosines and sines for the tokens of `frames` frames: special tokens at (0, 0), patches at (row + 1, column + 1);
/// base frequency 100.
fn rope_tables<B: Backend>(
    backend: &B,
    special: usize,
    rows: usize,
    columns: usize,
    frames: usize,
    head: usize,
) -> Result<(B::Tensor, B::Tensor), NetError> {
    let quarter = head / 4;
    let frequencies: Vec<f32> = (0..quarter).map(|j| 1.0 / 100f32.powf(2.0 * j as f32 / (head / 2) as f32)).collect();
    let patches = (0..rows).flat_map(|y| (0..columns).map(move |x| (y + 1, x + 1)));
    let places: Vec<(usize, usize)> = std::iter::repeat_n((0, 0), special).chain(patches).collect();
    let angles: Vec<f32> = std::iter::repeat_n(&places, frames)
        .flatten()
        .flat_map(|(y, x)| [*y as f32, *x as f32])
        .flat_map(|p| frequencies.iter().map(move |f| p * f))
        .collect();
    let load =
        |values: Vec<f32>| backend.load(&HostTensor::from_f32(&[places.len() * frames, head / 2], values), DType::F32);
    Ok((load(angles.iter().map(|a| a.cos()).collect())?, load(angles.iter().map(|a| a.sin()).collect())?))
}
