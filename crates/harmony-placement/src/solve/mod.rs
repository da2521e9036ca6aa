//! From hypotheses to poses: [`local`] for one object, [`joint`] for all of them with camera, room and scale.
//!
//! Both minimise the energy of `terms`. The local solve draws the object (paper's [`steps`], then a [`simplex`] over
//! the numbers that its support leaves free); the joint solve does not, and compares outlines by their reach in sixteen
//! directions. Poses stay on their supports throughout. Both find the minimum near their start: hypotheses have to be
//! near enough.

pub(crate) mod formulas;
pub(crate) mod joint;
pub(crate) mod local;
mod simplex;
pub(crate) mod steps;
