//! The renderer of the loop: a deterministic CPU rasteriser that draws colour, depth and object id in one pass.

mod frame;

pub use frame::{Frame, Instance, Lighting, RenderOptions};
