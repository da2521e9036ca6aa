//! Roles: what the pipeline asks of models, as traits, with their request and answer types.
//!
//! Every model is a role behind a trait and a *profile* says who plays it (`ARCHITECTURE.md`); the pipeline never
//! knows which. A player answers one request at a time and says in its [`PlayerCard`] who it is. Names, records,
//! replay, retries and budgets are wrapped around any player by `harmony-calls`.

mod detector;
mod error;
mod geometry;
mod image_editor;
mod lit_renderer;
mod mesh_generator;
mod player;
mod segmenter;
mod vision_language;

pub use detector::{DetectRequest, Detection, Detections, Detector, PhraseRequest};
pub use error::RoleError;
pub use geometry::{GeometryAnswer, GeometryEstimator, GeometryRequest};
pub use image_editor::{EditKind, EditRequest, EditedImage, ImageEditor};
pub use lit_renderer::{LightMeasurement, LitImage, LitKind, LitRenderer, LitRequest};
pub use mesh_generator::{GeneratedMesh, MeshFrame, MeshGenerator, MeshRequest, MeshSettings};
pub use player::{PlayerCard, Role, Usage};
pub use segmenter::{SegmentPrompt, SegmentRequest, SegmentedMask, Segmenter};
pub use vision_language::{Picture, VisionLanguage, VlmAnswer, VlmRequest};
