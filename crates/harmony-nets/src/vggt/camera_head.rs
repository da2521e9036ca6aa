//! The camera head: four rounds of refinement of nine numbers a frame.

use super::block::{Block, BlockSize, Loader, Norm};
use super::config::VggtConfig;
use crate::backend::{Act, Binary, TensorHandle};
use crate::{Backend, DType, NetError, Weights};

/// Rounds of refinement.
const ROUNDS: usize = 4;
/// Numbers of a pose: translation, quaternion (x, y, z, w), vertical and horizontal field of view.
pub const POSE: usize = 9;

/// The camera head.
pub struct CameraHead<B: Backend> {
    dtype: DType,
    dim: usize,
    token_norm: Norm<B>,
    trunk_norm: Norm<B>,
    empty_pose: B::Tensor,
    embed_pose: B::Linear,
    modulation: B::Linear,
    trunk: Vec<Block<B>>,
    fc1: B::Linear,
    fc2: B::Linear,
}

impl<B: Backend> CameraHead<B> {
    /// Loads the head, computing in `dtype` but for the last layer and the pose itself, which are f32.
    pub fn load(backend: &B, weights: &Weights<'_>, config: &VggtConfig, dtype: DType) -> Result<Self, NetError> {
        let at = weights.at("camera_head");
        let loader = Loader { backend, dtype };
        let exact = Loader { backend, dtype: DType::F32 };
        let dim = 2 * config.dim;
        let size = BlockSize { dim, heads: config.heads, eps: 1e-5, qk_norm: false };
        let trunk = at.at("trunk");
        Ok(Self {
            dtype,
            dim,
            token_norm: loader.norm(&at.at("token_norm"), dim, 1e-5)?,
            trunk_norm: loader.norm(&at.at("trunk_norm"), dim, 1e-5)?,
            empty_pose: exact.tensor(&at, "empty_pose_tokens", &[1, 1, POSE])?,
            embed_pose: loader.linear(&at.at("embed_pose"), dim, POSE, None)?,
            modulation: loader.linear(&at.at("poseLN_modulation.1"), 3 * dim, dim, None)?,
            trunk: (0..config.camera_depth)
                .map(|i| Block::load(&loader, &trunk.at(i), size))
                .collect::<Result<_, _>>()?,
            fc1: loader.linear(&at.at("pose_branch.fc1"), dim / 2, dim, None)?,
            fc2: exact.linear(&at.at("pose_branch.fc2"), POSE, dim / 2, None)?,
        })
    }

    /// Raw poses `[1, S, 9]` from the last level `[S, P, 2 dim]`; the field of view is not rectified yet.
    pub fn run(&self, backend: &B, last: &B::Tensor) -> Result<B::Tensor, NetError> {
        let frames = last.dim(0);
        let camera = backend.reshape(&backend.slice(last, 1, 0, 1)?, &[1, frames, self.dim])?;
        let tokens = self.token_norm.run(backend, &backend.cast(&camera, self.dtype)?)?;
        let normed = backend.layer_norm(&tokens, None, None, 1e-6)?;
        let empty = backend.concat(&vec![&self.empty_pose; frames], 1)?;
        let mut pose: Option<B::Tensor> = None;
        for _ in 0..ROUNDS {
            // The raw pose goes back in, not the rectified one.
            let fed = backend.cast(pose.as_ref().unwrap_or(&empty), self.dtype)?;
            let condition = backend.linear(&fed, &self.embed_pose, Act::Silu, None)?;
            let modulation = backend.linear(&condition, &self.modulation, Act::None, None)?;
            let part = |i: usize| backend.slice(&modulation, 2, i * self.dim, self.dim);
            let (shift, scale, gate) = (part(0)?, part(1)?, part(2)?);
            let modulated = backend.binary(backend.affine(&scale, 1.0, 1.0)?, &normed, Binary::Mul)?;
            let modulated = backend.binary(modulated, &shift, Binary::Add)?;
            let gated = backend.binary(modulated, &gate, Binary::Mul)?;
            let mut x = backend.binary(gated, &tokens, Binary::Add)?;
            for block in &self.trunk {
                x = block.run(backend, x, None)?;
            }
            let inner = backend.linear(&self.trunk_norm.run(backend, &x)?, &self.fc1, Act::Gelu, None)?;
            let inner = backend.cast(&inner, DType::F32)?;
            pose = Some(backend.linear(&inner, &self.fc2, Act::None, pose)?);
        }
        pose.ok_or_else(|| NetError::shape("camera head", "no rounds"))
    }
}
