//! The text tower: a causal transformer, read at the end mark.

use super::layout::Layout;
use super::transformer::{Depth, Transformer};
use crate::NetError;
use crate::backend::{Backend, Binary};
use crate::params::{Norm, Params};

/// Numbers of a text tower.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TextConfig {
    /// Channels.
    pub width: usize,
    /// Channels inside the feed-forward layers.
    pub hidden: usize,
    /// Blocks.
    pub layers: usize,
    /// Attention heads.
    pub heads: usize,
    /// Tokens that there are.
    pub vocabulary: usize,
    /// Tokens that a sentence may have, marks included.
    pub positions: usize,
}

/// The tower on a device.
pub struct TextTower<B: Backend> {
    config: TextConfig,
    tokens: B::Tensor,
    positions: B::Tensor,
    blocks: Transformer<B>,
    post: Norm<B>,
}

impl<B: Backend> TextTower<B> {
    /// Weights below `p`.
    ///
    /// # Errors
    /// [`NetError::Weights`] for missing keys and wrong shapes, and what the device says.
    pub fn load(p: &Params<'_, B>, config: TextConfig, layout: Layout) -> Result<Self, NetError> {
        let TextConfig { width, hidden, layers, heads, vocabulary, positions } = config;
        let tensor = |names: [&str; 2], shape: &[usize]| {
            p.backend.load(&p.host(layout.pick(names[0], names[1]), shape)?, p.backend.preferred())
        };
        Ok(Self {
            tokens: tensor(
                ["text_model.embeddings.token_embedding.weight", "token_embedding.weight"],
                &[vocabulary, width],
            )?,
            positions: tensor(
                ["text_model.embeddings.position_embedding.weight", "positional_embedding"],
                &[positions, width],
            )?,
            blocks: Transformer::load(p, "text_model", layout, Depth { width, hidden, layers, heads, causal: true })?,
            post: layout.norm(p, "text_model.final_layer_norm", "ln_final", width)?,
            config,
        })
    }

    /// The configuration.
    pub fn config(&self) -> &TextConfig {
        &self.config
    }

    /// Normed features at the last token of each row of ids, `[rows, width]`. Rows end with the end mark.
    ///
    /// All rows go through the network at once. Shorter ones are filled up behind their end: no token sees a later one,
    /// so that what is filled in says nothing.
    ///
    /// # Errors
    /// [`NetError::Input`] for rows that are empty or too long, and what the device says.
    pub fn pooled(&self, b: &B, rows: &[Vec<u32>]) -> Result<B::Tensor, NetError> {
        let length = rows.iter().map(Vec::len).max().unwrap_or(0);
        if length == 0 || length > self.config.positions || rows.iter().any(Vec::is_empty) {
            let reason =
                format!("sentences of 1 to {} tokens are wanted, the longest has {length}", self.config.positions);
            return Err(NetError::Input { network: "text tower", reason });
        }
        let (width, count) = (self.config.width, rows.len());
        let filled = |row: &Vec<u32>| (0..length).map(|i| row.get(i).copied().unwrap_or(0)).collect::<Vec<_>>();
        let ids: Vec<u32> = rows.iter().flat_map(filled).collect();
        let x = b.reshape(&b.gather_rows(&self.tokens, &ids)?, &[count, length, width])?;
        let x = b.binary(x, &b.slice(&self.positions, 0, 0, length)?, Binary::Add)?;
        let x = self.blocks.forward(b, x)?;
        let ends: Vec<u32> = rows.iter().enumerate().map(|(i, row)| (i * length + row.len() - 1) as u32).collect();
        let x = b.gather_rows(&b.reshape(&x, &[count * length, width])?, &ends)?;
        self.post.apply(b, &x)
    }
}
