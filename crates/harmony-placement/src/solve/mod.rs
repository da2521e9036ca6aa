//! From hypotheses to poses: [`local`] for one object, [`joint`] for all of them with camera, room and scale.

pub(crate) mod formulas;
pub(crate) mod joint;
pub(crate) mod local;
mod simplex;
pub(crate) mod steps;
