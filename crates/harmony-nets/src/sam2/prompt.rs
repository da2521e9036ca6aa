//! Prompts and their encoding.

use std::f32::consts::TAU;

use super::Sam2Config;
use crate::backend::{Act, Backend, Window};
use crate::params::{Norm, Params};
use crate::{HostTensor, NetError};

/// What a clicked point says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Label {
    /// Not part of the object.
    Outside,
    /// Part of the object.
    Inside,
}

/// Logits of a mask on a square grid over the whole photo.
#[derive(Debug, Clone, PartialEq)]
pub struct MaskLogits {
    /// Cells a side.
    pub side: usize,
    /// Row-major values.
    pub values: Vec<f32>,
}

/// One object to cut out. Coordinates are pixels of the photo; the centre of the top-left pixel is (0.5, 0.5), as
/// upstream's boxes have it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Prompt {
    /// Left, top, right, bottom.
    pub bounds: Option<[f64; 4]>,
    /// Points.
    pub points: Vec<([f64; 2], Label)>,
    /// The logits of an earlier round.
    pub mask: Option<MaskLogits>,
}

impl Prompt {
    /// A box alone.
    pub fn from_box(bounds: [f64; 4]) -> Self {
        Self { bounds: Some(bounds), ..Self::default() }
    }

    /// Number of tokens that it becomes: the box is two points, and a point that says nothing comes last.
    pub(super) fn tokens(&self) -> usize {
        self.points.len() + if self.bounds.is_some() { 3 } else { 1 }
    }

    /// Points and rows of the table of point kinds.
    fn kinds(&self) -> Vec<([f64; 2], usize)> {
        let corners = self.bounds.map(|[x0, y0, x1, y1]| [([x0, y0], 2), ([x1, y1], 3)]);
        let points = self.points.iter().map(|(at, label)| (*at, usize::from(*label == Label::Inside)));
        corners.into_iter().flatten().chain(points).collect()
    }
}

/// Encodes prompts; tokens are few and made on the host.
pub(super) struct PromptEncoder<B: Backend> {
    /// Random frequencies `[2, width / 2]`.
    frequencies: Vec<f32>,
    /// Rows for outside, inside, top-left, bottom-right.
    kinds: Vec<Vec<f32>>,
    nothing: Vec<f32>,
    no_mask: B::Tensor,
    positions: B::Tensor,
    first: (B::Conv, Norm<B>),
    second: (B::Conv, Norm<B>),
    last: B::Linear,
    image_size: usize,
    width: usize,
    cells: usize,
}

impl<B: Backend> PromptEncoder<B> {
    pub(super) fn load(p: &Params<'_, B>, config: &Sam2Config) -> Result<Self, NetError> {
        let w = config.width;
        let frequencies = p.host("pe_layer.positional_encoding_gaussian_matrix", &[2, w / 2])?.to_f32();
        let row = |name: &str| Ok::<_, NetError>(p.host(&format!("{name}.weight"), &[1, w])?.to_f32());
        let kinds = (0..4).map(|i| row(&format!("point_embeddings.{i}"))).collect::<Result<_, _>>()?;
        let n = config.cells();
        let centre = |i: usize| (i as f32 + 0.5) / n as f32;
        let cells = (0..n).flat_map(|y| (0..n).map(move |x| (x, y)));
        let positions = cells.flat_map(|(x, y)| fourier(&frequencies, centre(x), centre(y))).collect();
        let down = |i: usize, from: usize, to: usize| {
            let conv = p.conv(&format!("mask_downscaling.{i}"), [to, from, 2, 2], Window::conv(2, 0))?;
            Ok::<_, NetError>((conv, p.norm(&format!("mask_downscaling.{}", i + 1), to, 1e-6)?))
        };
        let (weight, bias) = p.pointwise("mask_downscaling.6", w, 16)?;
        let load = |shape: &[usize], data| p.backend.load(&HostTensor::from_f32(shape, data), crate::DType::F32);
        Ok(Self {
            kinds,
            nothing: row("not_a_point_embed")?,
            no_mask: load(&[w], row("no_mask_embed")?)?,
            positions: load(&[n * n, w], positions)?,
            first: down(0, 1, 4)?,
            second: down(3, 4, 16)?,
            last: p.loaded(weight, Some(bias))?,
            frequencies,
            image_size: config.image_size,
            width: w,
            cells: n,
        })
    }

    /// Positions of the image's cells, `[n * n, width]`.
    pub(super) fn positions(&self) -> &B::Tensor {
        &self.positions
    }

    /// What stands for "no mask given", `[width]`.
    pub(super) fn no_mask(&self) -> &B::Tensor {
        &self.no_mask
    }

    /// A given mask, `[n * n, width]`.
    pub(super) fn dense(&self, b: &B, mask: &MaskLogits) -> Result<B::Tensor, NetError> {
        let side = 4 * self.cells;
        if mask.side != side || mask.values.len() != side * side {
            let reason =
                format!("a mask prompt of {} values, side {}; its side must be {side}", mask.values.len(), mask.side);
            return Err(NetError::Input { network: "SAM 2", reason });
        }
        let host = HostTensor::from_f32(&[1, side, side, 1], mask.values.clone());
        let mut x = b.load(&host, crate::DType::F32)?;
        for (conv, norm) in [&self.first, &self.second] {
            x = b.activation(&norm.apply(b, &b.conv2d(&x, conv, Act::None, None)?)?, Act::Gelu)?;
        }
        let x = b.linear(&x, &self.last, Act::None, None)?;
        b.reshape(&x, &[self.cells * self.cells, self.width])
    }

    /// Tokens of prompts with equally many each, `[prompts, tokens, width]`.
    pub(super) fn tokens(&self, prompts: &[Prompt], size: (u32, u32)) -> Result<Vec<f32>, NetError> {
        let mut out = Vec::new();
        for prompt in prompts {
            let kinds = prompt.kinds();
            let wrong = if kinds.is_empty() {
                Some("a prompt needs a box or a point")
            } else if kinds.iter().flat_map(|(at, _)| at).any(|v| !v.is_finite()) {
                Some("a prompt that is not finite")
            } else {
                None
            };
            if let Some(reason) = wrong {
                return Err(NetError::Input { network: "SAM 2", reason: reason.to_owned() });
            }
            let side = self.image_size as f32;
            // In upstream's order of operations: to the network's pixels, to their centres, to 0..1.
            let scaled = |v: f64, n: u32| (v as f32 / n as f32 * side + 0.5) / side;
            for ([x, y], kind) in kinds {
                let at = fourier(&self.frequencies, scaled(x, size.0), scaled(y, size.1));
                out.extend(at.zip(&self.kinds[kind]).map(|(p, k)| p + k));
            }
            out.extend_from_slice(&self.nothing);
        }
        Ok(out)
    }
}

/// Random Fourier features of a position in 0..1 (Tancik et al. 2020): sines, then cosines.
fn fourier(frequencies: &[f32], x: f32, y: f32) -> impl Iterator<Item = f32> {
    let (across, down) = frequencies.split_at(frequencies.len() / 2);
    let (x, y) = (2.0 * x - 1.0, 2.0 * y - 1.0);
    let angles: Vec<f32> = across.iter().zip(down).map(|(a, d)| TAU * (x * a + y * d)).collect();
    let cosines: Vec<f32> = angles.iter().map(|a| a.cos()).collect();
    angles.into_iter().map(f32::sin).chain(cosines)
}
