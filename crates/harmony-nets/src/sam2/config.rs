//! Sizes of the network.

/// The published sizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Sam2Size {
    /// 38.9 M parameters.
    Tiny,
    /// 46 M.
    Small,
    /// 80.8 M.
    BasePlus,
    /// 224.4 M.
    Large,
}

impl Sam2Size {
    /// All sizes.
    pub const ALL: [Self; 4] = [Self::Tiny, Self::Small, Self::BasePlus, Self::Large];

    /// Name as in the names of the checkpoints: `tiny`, `small`, `base_plus`, `large`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tiny => "tiny",
            Self::Small => "small",
            Self::BasePlus => "base_plus",
            Self::Large => "large",
        }
    }

    /// The inverse of [`Self::name`].
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|size| size.name() == name)
    }
}

/// Numbers of the network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sam2Config {
    /// Side of the square that the photo is resized to, in pixels; a multiple of 32.
    pub image_size: usize,
    /// Channels of the first stage; doubled by each further one.
    pub embed: usize,
    /// Attention heads of the first stage; doubled by each further one.
    pub heads: usize,
    /// Blocks in each stage.
    pub stages: [usize; 4],
    /// Indices of the blocks that attend to the whole image.
    pub global_blocks: Vec<usize>,
    /// Side of the attention windows of each stage, in tokens.
    pub windows: [usize; 4],
    /// Side of the learned positions that are stretched over the image.
    pub background: usize,
    /// Channels of neck and decoder.
    pub width: usize,
    /// Hidden width of the decoder's feed-forward layers.
    pub hidden: usize,
    /// Hidden width of the quality head.
    pub iou_hidden: usize,
}

impl Sam2Config {
    /// A published size.
    pub fn of(size: Sam2Size) -> Self {
        let (embed, heads, stages, global_blocks, windows, background) = match size {
            Sam2Size::Tiny => (96, 1, [1, 2, 7, 2], [5, 7, 9], [8, 4, 14, 7], 7),
            Sam2Size::Small => (96, 1, [1, 2, 11, 2], [7, 10, 13], [8, 4, 14, 7], 7),
            Sam2Size::BasePlus => (112, 2, [2, 3, 16, 3], [12, 16, 20], [8, 4, 14, 7], 14),
            Sam2Size::Large => (144, 2, [2, 6, 36, 4], [23, 33, 43], [8, 4, 16, 8], 7),
        };
        Self {
            image_size: 1024,
            embed,
            heads,
            stages,
            global_blocks: global_blocks.to_vec(),
            windows,
            background,
            width: 256,
            hidden: 2048,
            iou_hidden: 256,
        }
    }

    /// Side of the image embedding in cells.
    pub fn cells(&self) -> usize {
        self.image_size / 16
    }

    /// Channels of each stage.
    pub fn channels(&self) -> [usize; 4] {
        [1, 2, 4, 8].map(|k| self.embed * k)
    }
}
