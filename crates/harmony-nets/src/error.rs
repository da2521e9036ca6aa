//! Why a network could not be loaded or run.

use std::path::PathBuf;

use crate::DType;

/// A failure of a network, its weights or its device.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetError {
    /// Shapes that do not fit one another; a fault of the model code or of a configuration read from a file.
    #[error("{op}: {what}")]
    Shape {
        /// The operation.
        op: &'static str,
        /// What was wanted and what was found.
        what: String,
    },
    /// A weight file that cannot be used.
    #[error(transparent)]
    Weights(#[from] WeightError),
    /// The device refused: no driver, no kernel, a failed launch.
    #[error("{device}: {reason}")]
    Device {
        /// Which device.
        device: String,
        /// Its words.
        reason: String,
    },
    /// Too little memory.
    #[error("{device} has too little memory: {needed} bytes more are needed, {free} are free")]
    OutOfMemory {
        /// Which device.
        device: String,
        /// Bytes asked for.
        needed: u64,
        /// Bytes left.
        free: u64,
    },
    /// An input that the network cannot take.
    #[error("{network} cannot take this input: {reason}")]
    Input {
        /// Which network.
        network: &'static str,
        /// Why.
        reason: String,
    },
}

impl NetError {
    /// A shape error.
    pub fn shape(op: &'static str, what: impl Into<String>) -> Self {
        Self::Shape { op, what: what.into() }
    }
}

/// What is wrong with a weight file. Every message names the file; where a tensor is meant, its key too.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WeightError {
    /// Not there, or not readable.
    #[error("cannot read weights: {source}: {}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// Neither safetensors nor a checkpoint of PyTorch, cut off, or malformed.
    #[error("not a usable weight file: {reason}: {}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong and where.
        reason: String,
    },
    /// A checkpoint that asks for more than tensors; nothing of it was run.
    #[error("refused for safety: {reason}: {}", path.display())]
    Refused {
        /// The file.
        path: PathBuf,
        /// What it asks for.
        reason: String,
    },
    /// A tensor that the network needs is not in the file.
    #[error("no tensor {key} (wanted shape {wanted:?}); nearest key in the file: {nearest}: {}", path.display())]
    MissingKey {
        /// The file.
        path: PathBuf,
        /// The wanted key.
        key: String,
        /// The wanted shape.
        wanted: Vec<usize>,
        /// The key most like it, or "none".
        nearest: String,
    },
    /// A tensor has another shape than the network needs.
    #[error("tensor {key} has shape {found:?}, wanted {wanted:?}: {}", path.display())]
    WrongShape {
        /// The file.
        path: PathBuf,
        /// The key.
        key: String,
        /// The shape that the network needs.
        wanted: Vec<usize>,
        /// The shape in the file.
        found: Vec<usize>,
    },
    /// A tensor has an element type that weights cannot have here.
    #[error("tensor {key} holds {found:?}, which cannot be used as weights: {}", path.display())]
    WrongType {
        /// The file.
        path: PathBuf,
        /// The key.
        key: String,
        /// The type in the file.
        found: DType,
    },
}
