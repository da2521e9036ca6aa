//! Soft and grown things: upholstery, cloth, fringes, leaves. Plain functions of numbers and pieces.
//!
//! Frame: metres, +Y up, front +Z. What stands by itself (pillow, cushion, roll, folded cloth, plant) stands on `y = 0`
//! and is centred in x and z; what acts on a piece (tuft, quilt, slump, fuzz, wicker) keeps the piece's coordinates.
//! Same arguments, same bytes: one thread, fixed order, mathematics of `libm`, random numbers from the seed alone.
//!
//! * [`pillow`], [`cushion`], [`tuft`], [`quilt`], [`slump`], [`roll`], [`folded`]: upholstery and linen.
//! * [`drape`], [`hang`]: cloth that falls and cloth that hangs; both give a [`Cloth`] with named hems.
//! * [`fringe`], [`fringe_on`] (lies on what is below), [`fuzz`], [`braid`], [`wicker`], [`wire_net`]: yarn, hair and basket work.
//! * [`leaf`], [`plant`]: foliage.

mod cloth;
mod collider;
mod cushion;
mod drape;
mod foliage;
mod fringe;
mod fuzz;
mod grid;
mod hang;
mod linen;
mod noise;
mod pillow;
mod refine;
mod sheet;
mod slump;
mod tuft;
mod weave;

pub use cushion::cushion;
pub use drape::{DrapeSpec, drape};
pub use foliage::{Plant, PlantSpec, leaf, plant};
pub use fringe::{FringeSpec, fringe, fringe_on};
pub use fuzz::fuzz;
pub use hang::{HangSpec, hang};
pub use linen::{folded, roll};
pub use pillow::{PillowSpec, pillow};
pub use sheet::{Cloth, Hems};
pub use slump::slump;
pub use tuft::{TuftSpec, Tufted, quilt, tuft};
pub use weave::{braid, wicker, wire_net};
