//! Hard solids: each function makes one [`crate::Piece`] with texture coordinates in metres.
//!
//! Texture coordinates: u to the right and v downwards as seen from outside where a generator can say so (faces of
//! boxes, caps of extrusions: (0, 0) at their top left corner, so that a picture fits); elsewhere lengths along the
//! surface. Trigonometry is `libm`'s: the same tree gives the same bytes on every platform.

mod blend;
mod boolean;
mod boxes;
mod bsp;
mod collect;
mod extrude;
mod field;
mod lathe;
mod loft;
pub(crate) mod math;
mod outline;
mod project;
mod surf;
mod sweep;

pub use blend::{Blob, blend};
pub use boolean::{boolean, hollow};
pub use boxes::rounded_box;
pub use collect::Collector;
pub use extrude::{BentSheet, Extrusion, bent_sheet, extrude};
pub use field::Field;
pub use lathe::{Lathe, cylinder, lathe, sphere};
pub use loft::loft;
pub use project::box_projected;
pub use surf::{mesh, surf};
pub use sweep::{Sweep, sweep};

#[cfg(test)]
mod tests;
