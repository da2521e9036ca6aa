//! Robots in the reconstructed room.
//!
//! # Idea
//! The paper drives two robots through its rooms, with contact targets "taken from the reconstructed geometry itself, so
//! the interaction is grounded in the reconstruction rather than in hand-placed proxies" (Sec. "Robot Interaction"). Here
//! where to hold, sit and step is measured on the triangles, postures come from inverse kinematics, and what holds of every
//! frame is measured again on the result. A task that the geometry forbids fails with the measurement that forbids it.
//!
//! | module | holds |
//! |---|---|
//! | [`model`], `mjcf`, `meshes` | a robot's tree of links, read from its MJCF file |
//! | [`ik`] | inverse kinematics: damped least squares with priorities |
//! | [`shapes`], [`room`], `solids` | convex pieces of links, the scene and the room around them, distances |
//! | [`measure`], [`jaw`] | sections, seats and backrests; a hand with two fingers |
//! | [`mod@affordances`] | what can be grasped, sat on, placed on, opened |
//! | [`motion`] | frames, and what is measured of them |
//! | [`arm`], [`drawer`], [`human`] | tasks of an arm with a jaw, and of a humanoid |
//! | [`task`], [`mod@replay`], `stage`, [`pictures`], [`lit`] | files: trajectory, MJCF with keyframes, USD time samples, frames and sheet, path-traced frames |

pub mod affordances;
pub mod arm;
pub mod drawer;
mod error;
pub mod human;
pub mod ik;
pub mod jaw;
pub mod lit;
pub mod measure;
mod meshes;
mod mjcf;
pub mod model;
pub mod motion;
pub mod pictures;
pub mod replay;
pub mod room;
mod separation;
pub mod shapes;
mod solids;
mod stage;
pub mod task;

pub use affordances::{Affordances, affordances};
pub use error::RobotError;
pub use model::Model;
pub use room::Surroundings;
pub use task::{Job, Output, perform, write};
