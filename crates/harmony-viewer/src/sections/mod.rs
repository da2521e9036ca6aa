//! The parts of the page, top to bottom.

mod calls;
mod objects;
mod overview;
mod phases;
mod pictures;
mod plausibility;
mod room;
mod view3d;

pub(crate) use calls::calls;
pub(crate) use objects::objects;
pub(crate) use overview::overview;
pub(crate) use phases::phases;
pub(crate) use pictures::pictures;
pub(crate) use plausibility::{filled, plausibility};
pub(crate) use room::room;
pub(crate) use view3d::view3d;
