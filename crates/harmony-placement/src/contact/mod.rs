//! Contact: nothing in anything, everything on what carries it. The projection after the solves.
//!
//! The solves know nothing of rigid contact between things. What they leave is projected here: pairs that are in one
//! another are parted ([`collision`], on convex parts of [`solid`]), rows that are too long give of their widths
//! ([`rows`]), what stands or hangs comes back onto its support ([`rest`]), hanging things lie in layers ([`layers`]).
//! Room frame, metres. Moves are bounded: what would have to go farther than the photo allows stays, and is told.

pub(crate) mod collision;
pub(crate) mod layers;
pub(crate) mod rest;
pub(crate) mod rows;
pub(crate) mod solid;
