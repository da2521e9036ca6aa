//! What `harmony setup` proposes and writes. [`propose`] chooses players from a [`crate::survey::Survey`] and what the user
//! wishes; [`file`] puts them into `harmony.toml` and leaves everything else there as it is; [`blender`] installs the path tracer.

pub mod blender;
pub mod file;
pub mod propose;
