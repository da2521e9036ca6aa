//! `[models]`: the folder of weights and where they come from; `[players.geometry_estimator]`, `[players.segmenter]`:
//! networks that run inside this program.

use std::path::PathBuf;

use harmony_models::Endpoints;
use serde::{Deserialize, Serialize};

/// The folder of weights, and where `harmony models pull` gets them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelsConfig {
    /// Folder; left out = `harmony/models` in the user's data folder. HARMONY_MODELS overrides it.
    pub folder: Option<PathBuf>,
    /// The model hub, or a mirror of it. HARMONY_HUB (else HF_ENDPOINT) overrides it.
    pub hub: String,
    /// PyTorch's downloads, or a mirror of them.
    pub torch: String,
    /// Files of source repositories, or a mirror of them.
    pub code: String,
}

impl Default for ModelsConfig {
    fn default() -> Self {
        let [hub, torch, code] = Endpoints::USUAL.map(str::to_owned);
        Self { folder: None, hub, torch, code }
    }
}

/// Where a network runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Device {
    /// An NVIDIA GPU where one can be used and has the memory, else the CPU.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// An NVIDIA GPU or nothing.
    Cuda,
}

/// Who can be the geometry estimator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Geometry {
    /// The room box from vanishing points.
    Offline,
    /// VGGT.
    Vggt,
}

/// Who can be the segmenter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Masks {
    /// Graph cut.
    Offline,
    /// SAM 2.1.
    Sam2,
}

/// The geometry estimator.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GeometryConfig {
    /// Who; left out = `vggt` where its weights are, else `offline`.
    pub player: Option<Geometry>,
    /// `vggt-1b` or `vggt-1b-commercial`; left out = the one that is there.
    pub model: Option<String>,
    /// A weight file of one's own, with the keys of VGGT-1B.
    pub weights: Option<PathBuf>,
    /// Where it runs.
    pub device: Option<Device>,
}

/// The segmenter.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SegmenterConfig {
    /// Who; left out = `sam2` where its weights are, else `offline`.
    pub player: Option<Masks>,
    /// `sam2.1-large`, `sam2.1-base-plus`, `sam2.1-small`, `sam2.1-tiny`; left out = the largest that is there.
    pub model: Option<String>,
    /// A weight file of one's own; then `model` says of which size.
    pub weights: Option<PathBuf>,
    /// Where it runs.
    pub device: Option<Device>,
}
