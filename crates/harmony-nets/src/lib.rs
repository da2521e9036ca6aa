//! Native networks: model code written once over a thin layer of fused operations ([`Backend`]).
//!
//! The plain crate holds the trait, the reference backend, the tensors and the weight files. Everything heavy is
//! behind a feature. Networks compute in f32 (or narrower on GPUs); images are NHWC.

pub mod backend;
#[cfg(feature = "clip")]
pub mod clip;
#[cfg(feature = "cpu")]
pub mod cpu;
#[cfg(feature = "cuda")]
pub mod cuda;
#[cfg(feature = "detector")]
pub mod detector;
mod error;
pub mod host;
#[cfg(feature = "lpips")]
pub mod lpips;
pub mod math;
pub mod params;
#[cfg(all(feature = "players", any(feature = "sam2", feature = "detector")))]
mod player;
pub mod reference;
#[cfg(any(feature = "sam2", feature = "clip"))]
pub mod resample;
#[cfg(any(feature = "sam2", feature = "clip"))]
mod residual;
#[cfg(feature = "sam2")]
pub mod sam2;
mod tensor;
#[cfg(feature = "vggt")]
pub mod vggt;
pub mod weights;

pub use backend::Backend;
pub use error::{NetError, WeightError};
pub use tensor::{ByteSource, DType, HostTensor};
pub use weights::{WeightFile, Weights};
