//! The dense heads (DPT, Ranftl et al., 2021): four levels of tokens to a map of every pixel.

use super::block::{Loader, Norm};
use super::config::VggtConfig;
use crate::backend::{Act, Binary, Resize, TensorHandle, Window};
use crate::{Backend, DType, HostTensor, NetError, Weights};

/// Weight of the position embedding.
const POSITION: f32 = 0.1;
/// Channels before the last convolution.
const LAST_CHANNELS: usize = 32;

/// How a level's map is brought to its size.
enum Rescale<B: Backend> {
    Up(B::Conv),
    Same,
    Down(B::Conv),
}

struct Level<B: Backend> {
    project: B::Conv,
    rescale: Rescale<B>,
    narrow: B::Conv,
    fuse: Fuse<B>,
}

/// `conv2(relu(conv1(relu x))) + relu x`: the reference's ReLU works in place, so the rectified input is added back.
struct ResidualUnit<B: Backend> {
    conv1: B::Conv,
    conv2: B::Conv,
}

impl<B: Backend> ResidualUnit<B> {
    fn load(loader: &Loader<'_, B>, at: &Weights<'_>, features: usize) -> Result<Self, NetError> {
        let conv = |name: &str| loader.conv(&at.at(name), [features, features, 3], Window::conv(1, 1), true);
        Ok(Self { conv1: conv("conv1")?, conv2: conv("conv2")? })
    }

    fn run(&self, backend: &B, x: &B::Tensor) -> Result<B::Tensor, NetError> {
        let x = backend.activation(x, Act::Relu)?;
        let inner = backend.conv2d(&x, &self.conv1, Act::Relu, None)?;
        backend.conv2d(&inner, &self.conv2, Act::None, Some(x))
    }
}

struct Fuse<B: Backend> {
    /// Absent at the coarsest level.
    skip: Option<ResidualUnit<B>>,
    unit: ResidualUnit<B>,
    out: B::Conv,
}

/// Position embeddings of the four levels and of the last map: made once a size, the same for all dense heads.
pub struct HeadTables<B: Backend> {
    levels: [B::Tensor; 4],
    last: B::Tensor,
}

/// A dense head.
pub struct DenseHead<B: Backend> {
    config: VggtConfig,
    dtype: DType,
    norm: Norm<B>,
    levels: Vec<Level<B>>,
    output1: B::Conv,
    output2: B::Conv,
    output3: B::Conv,
}

impl<B: Backend> DenseHead<B> {
    /// Loads a head with so many output channels (the last is the confidence), computing in `dtype` but for the last
    /// layer, which is f32.
    pub fn load(
        backend: &B,
        at: &Weights<'_>,
        config: &VggtConfig,
        channels: usize,
        dtype: DType,
    ) -> Result<Self, NetError> {
        let loader = Loader { backend, dtype };
        let (dim, features) = (2 * config.dim, config.features);
        let scratch = at.at("scratch");
        let mut levels = Vec::with_capacity(4);
        for (i, c) in config.head_channels.into_iter().enumerate() {
            let rescale = at.at("resize_layers").at(i);
            let fuse = scratch.at(format!("refinenet{}", i + 1));
            let unit = |n: usize| ResidualUnit::load(&loader, &fuse.at(format!("resConfUnit{n}")), features);
            levels.push(Level {
                project: loader.conv(&at.at("projects").at(i), [c, dim, 1], Window::conv(1, 0), true)?,
                rescale: match i {
                    0 => Rescale::Up(loader.conv_transpose(&rescale, [c, c, 4])?),
                    1 => Rescale::Up(loader.conv_transpose(&rescale, [c, c, 2])?),
                    2 => Rescale::Same,
                    _ => Rescale::Down(loader.conv(&rescale, [c, c, 3], Window::conv(2, 1), true)?),
                },
                narrow: loader.conv(
                    &scratch.at(format!("layer{}_rn", i + 1)),
                    [features, c, 3],
                    Window::conv(1, 1),
                    false,
                )?,
                fuse: Fuse {
                    skip: (i < 3).then(|| unit(1)).transpose()?,
                    unit: unit(2)?,
                    out: loader.conv(&fuse.at("out_conv"), [features, features, 1], Window::conv(1, 0), true)?,
                },
            });
        }
        let half = features / 2;
        Ok(Self {
            norm: loader.norm(&at.at("norm"), dim, 1e-5)?,
            levels,
            output1: loader.conv(&scratch.at("output_conv1"), [half, features, 3], Window::conv(1, 1), true)?,
            output2: loader.conv(&scratch.at("output_conv2.0"), [LAST_CHANNELS, half, 3], Window::conv(1, 1), true)?,
            dtype,
            output3: (Loader { backend, dtype: DType::F32 }).conv(
                &scratch.at("output_conv2.2"),
                [channels, LAST_CHANNELS, 1],
                Window::conv(1, 0),
                true,
            )?,
            config: config.clone(),
        })
    }

    /// Tables for photos of `rows` by `columns` patches.
    pub fn tables(&self, backend: &B, (rows, columns): (usize, usize)) -> Result<HeadTables<B>, NetError> {
        let aspect = columns as f64 / rows as f64;
        let load = |height: usize, width: usize, channels: usize| {
            let values = position_embedding(height, width, channels, aspect);
            backend.load(&HostTensor::from_f32(&[height, width, channels], values), self.dtype)
        };
        let [a, b, c, d] = self.config.head_channels.map(|channels| load(rows, columns, channels));
        let patch = self.config.patch;
        let last = load(rows * patch, columns * patch, self.config.features / 2)?;
        Ok(HeadTables { levels: [a?, b?, c?, d?], last })
    }

    /// Raw maps `[S, 14 rows, 14 columns, channels]` of all frames, before their activations.
    ///
    /// `levels` are `[S, P, 2 dim]` with `special` tokens in front. Nothing is shared between frames here, and their maps
    /// are large: so many are done at once as the backend has room for.
    pub fn run(
        &self,
        backend: &B,
        levels: &[B::Tensor],
        special: usize,
        (rows, columns): (usize, usize),
        tables: &HeadTables<B>,
    ) -> Result<Vec<B::Tensor>, NetError> {
        let frames = levels.first().map_or(0, |l| l.dim(0));
        // The last map before it is narrowed, three times over.
        let pixels = rows * columns * self.config.patch * self.config.patch;
        let bytes = 3 * pixels * self.config.features / 2 * self.dtype.size();
        let parts = frames.div_ceil((backend.room() / bytes.max(1)).max(1)).max(1);
        let each = frames.div_ceil(parts).max(1);
        let mut maps = Vec::with_capacity(frames);
        for first in (0..frames).step_by(each) {
            let count = each.min(frames - first);
            let map = self.frames(backend, levels, (first, count, special), (rows, columns), tables)?;
            for i in 0..count {
                maps.push(backend.slice(&map, 0, i, 1)?);
            }
        }
        Ok(maps)
    }

    /// `count` frames from `first` on.
    fn frames(
        &self,
        backend: &B,
        tokens: &[B::Tensor],
        (first, count, special): (usize, usize, usize),
        (rows, columns): (usize, usize),
        tables: &HeadTables<B>,
    ) -> Result<B::Tensor, NetError> {
        let mut maps = Vec::with_capacity(4);
        for ((level, tokens), table) in self.levels.iter().zip(tokens).zip(&tables.levels) {
            let own = backend.slice(tokens, 0, first, count)?;
            let patches = backend.slice(&own, 1, special, rows * columns)?;
            let normed = self.norm.run(backend, &backend.cast(&patches, self.dtype)?)?;
            let map = backend.reshape(&normed, &[count, rows, columns, 2 * self.config.dim])?;
            let map = backend.conv2d(&map, &level.project, Act::None, None)?;
            let map = backend.binary(map, table, Binary::Add)?;
            let map = match &level.rescale {
                Rescale::Up(conv) => backend.conv_transpose2d(&map, conv, Act::None, None)?,
                Rescale::Same => map,
                Rescale::Down(conv) => backend.conv2d(&map, conv, Act::None, None)?,
            };
            maps.push(backend.conv2d(&map, &level.narrow, Act::None, None)?);
        }
        let mut fused: Option<B::Tensor> = None;
        while let Some(map) = maps.pop() {
            let fuse = &self.levels[maps.len()].fuse;
            let joined = match (fused, &fuse.skip) {
                (Some(coarse), Some(skip)) => backend.binary(coarse, &skip.run(backend, &map)?, Binary::Add)?,
                _ => map.clone(),
            };
            let (height, width) = maps.last().map_or((2 * map.dim(1), 2 * map.dim(2)), |m| (m.dim(1), m.dim(2)));
            drop(map);
            let refined = fuse.unit.run(backend, &joined)?;
            drop(joined);
            let resized = backend.resize(&refined, height, width, Resize::BilinearCorners)?;
            fused = Some(backend.conv2d(&resized, &fuse.out, Act::None, None)?);
        }
        let fused = fused.ok_or_else(|| NetError::shape("dense head", "no levels"))?;
        let map = backend.conv2d(&fused, &self.output1, Act::None, None)?;
        drop(fused);
        let (height, width) = (rows * self.config.patch, columns * self.config.patch);
        let map = backend.resize(&map, height, width, Resize::BilinearCorners)?;
        let map = backend.binary(map, &tables.last, Binary::Add)?;
        let map = backend.conv2d(&map, &self.output2, Act::Relu, None)?;
        backend.conv2d(&backend.cast(&map, DType::F32)?, &self.output3, Act::None, None)
    }
}

/// A tenth of the sinusoidal embedding of a grid of `height` by `width` cells in an image of aspect `aspect`.
///
/// Positions run between minus and plus `span (n - 1) / n`, the spans being the sides of a rectangle of that aspect
/// with a diagonal of one. The first half of the channels is for x, the second for y; each half is sines, then cosines,
/// of frequencies `100^(-j / (C/4))`.
fn position_embedding(height: usize, width: usize, channels: usize, aspect: f64) -> Vec<f32> {
    let diagonal = (aspect * aspect + 1.0).sqrt();
    let quarter = channels / 4;
    let axis = |n: usize, span: f64| -> Vec<Vec<f32>> {
        let end = span * (n - 1) as f64 / n as f64;
        let step = if n > 1 { 2.0 * end / (n - 1) as f64 } else { 0.0 };
        (0..n)
            .map(|i| {
                let position = f64::from((-end + step * i as f64) as f32);
                let angle = |j: usize| position * 100f64.powf(-(j as f64) / quarter as f64);
                let sines = (0..quarter).map(|j| POSITION * angle(j).sin() as f32);
                sines.chain((0..quarter).map(|j| POSITION * angle(j).cos() as f32)).collect()
            })
            .collect()
    };
    let (xs, ys) = (axis(width, aspect / diagonal), axis(height, 1.0 / diagonal));
    let mut out = Vec::with_capacity(height * width * channels);
    for y in &ys {
        for x in &xs {
            out.extend_from_slice(x);
            out.extend_from_slice(y);
        }
    }
    out
}
