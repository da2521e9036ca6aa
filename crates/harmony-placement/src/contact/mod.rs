//! Contact: nothing in anything, everything on what carries it. The projection after the solves.

pub(crate) mod collision;
pub(crate) mod layers;
pub(crate) mod rest;
pub(crate) mod rows;
pub(crate) mod solid;
