//! The scene as rigid bodies: what a simulator needs, and what a simulation says about the scene.
//!
//! The paper ends with an earthquake in the reconstructed room (Sec. "Physical Simulations"): objects move "only from
//! gravity and friction with each object's own VLM-estimated mass and friction". This crate has the bodies for that, lets
//! the scene settle, repairs what does not stand, and shakes it. `docs/simulation.md` shows what comes out.
//!
//! | module | holds |
//! |---|---|
//! | [`mod@hull`] | convex hulls, their volume and inertia |
//! | [`mod@decompose`] | a mesh as convex hulls |
//! | [`matter`] | mass, friction, restitution, what moves |
//! | [`mod@shell`] | the room as colliders |
//! | [`mod@bodies`] | all of a scene's bodies: the interface for exports |
//! | [`load`] | a run folder's scene and meshes |
//! | [`world`] | places of bodies, and the simulator |
//! | [`mod@settle`], [`mod@repair`] | does it stand, and what makes it stand |
//! | [`plausible`] | the table of a scene's plausibility |
//! | [`ground`], [`quake`] | an earthquake's ground, and the room on it |
//! | [`animate`], [`pictures`] | animated GLB, frames, sheet, film |

pub mod animate;
pub mod bodies;
mod contact;
pub mod decompose;
pub mod ground;
pub mod hull;
pub mod load;
pub mod matter;
pub mod pictures;
pub mod plausible;
pub mod quake;
pub mod repair;
pub mod settle;
pub mod shell;
mod surface;
#[cfg(test)]
mod testing;
mod touch;
pub mod world;

pub use bodies::{Bodies, Body, BodyError, BodySettings, bodies};
pub use decompose::{Decomposition, Fit, decompose};
pub use hull::{Hull, Moments};
pub use load::{LoadError, RunScene};
pub use matter::Motion;
pub use plausible::{Plausibility, plausibility};
pub use quake::{Quake, QuakeError, Shaken, shake};
pub use repair::{Repaired, repair};
pub use settle::{Settled, SettledObject, places, settle};
pub use world::Placed;
