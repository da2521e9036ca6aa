//! Sizes of a VGGT network.

use crate::{NetError, Weights};

/// Sizes. What can be read from the weight file is read from it; the rest is fixed by the published network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VggtConfig {
    /// Side of a patch in pixels.
    pub patch: usize,
    /// Channels of a token.
    pub dim: usize,
    /// Attention heads of all blocks.
    pub heads: usize,
    /// Blocks of the patch embedding.
    pub embed_depth: usize,
    /// Pairs of frame and global blocks.
    pub depth: usize,
    /// Register tokens, of the patch embedding and of the aggregator alike.
    pub registers: usize,
    /// Blocks of the camera head.
    pub camera_depth: usize,
    /// Pairs whose output the dense heads take, 0-based.
    pub levels: [usize; 4],
    /// Channels of the four levels in the dense heads.
    pub head_channels: [usize; 4],
    /// Channels while the levels are fused.
    pub features: usize,
    /// Side of the learned grid of positions, in patches.
    pub grid: usize,
    /// Whether the file has a point head.
    pub points: bool,
}

impl VggtConfig {
    /// VGGT-1B.
    pub fn published() -> Self {
        Self {
            patch: 14,
            dim: 1024,
            heads: 16,
            embed_depth: 24,
            depth: 24,
            registers: 4,
            camera_depth: 4,
            levels: [4, 11, 17, 23],
            head_channels: [256, 512, 1024, 1024],
            features: 256,
            grid: 37,
            points: true,
        }
    }

    /// Sizes of the network in a file. Heads and levels are those of the published network; smaller ones (for tests)
    /// have heads of 64 channels at most and levels at the same fractions of the depth.
    ///
    /// # Errors
    /// [`NetError::Weights`] when the keys that tell the sizes are missing, [`NetError::Shape`] when they make no sense.
    pub fn of(weights: &Weights<'_>) -> Result<Self, NetError> {
        let published = Self::published();
        let embed = weights.at("aggregator.patch_embed");
        let proj = embed.shape("patch_embed.proj.weight")?;
        let odd = |what: String| NetError::shape("sizes of VGGT", what);
        let &[dim, 3, patch, _] = proj else { return Err(odd(format!("patch projection {proj:?}"))) };
        let positions = embed.shape("pos_embed")?.get(1).copied().unwrap_or(0);
        let grid = positions.saturating_sub(1).isqrt();
        let registers = embed.shape("register_tokens")?.get(1).copied().unwrap_or(0);
        let depth = weights.length("aggregator.frame_blocks");
        let head = weights.at("depth_head");
        let mut head_channels = [0; 4];
        for (i, channels) in head_channels.iter_mut().enumerate() {
            *channels = head.shape(&format!("projects.{i}.weight"))?.first().copied().unwrap_or(0);
        }
        let features = head.shape("scratch.layer1_rn.weight")?.first().copied().unwrap_or(0);
        if depth == 0 || grid == 0 || patch == 0 || dim == 0 || !dim.is_multiple_of(16) || features == 0 {
            return Err(odd(format!(
                "{depth} pairs of blocks, a grid of {grid}, {dim} channels in patches of {patch}"
            )));
        }
        let levels = if depth == published.depth {
            published.levels
        } else {
            [0, 1, 2, 3].map(|i| ((i + 1) * depth).div_ceil(4) - 1)
        };
        Ok(Self {
            patch,
            dim,
            heads: published.heads,
            embed_depth: weights.length("aggregator.patch_embed.blocks"),
            depth,
            registers,
            camera_depth: weights.length("camera_head.trunk"),
            levels,
            head_channels,
            features,
            grid,
            points: weights.has("point_head.norm.weight"),
        })
    }
}
