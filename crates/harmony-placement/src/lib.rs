//! Placement: from masks, relations and size priors to poses. Paper Sec. 3.3 and App. C.
//!
//! Pure functions over data: no model, no file, no async. The main path is [`place_level`], which for one level of
//! objects
//!
//! 1. works out the order ([`placement_order`]);
//! 2. makes first poses from relations, prior size and the mask's rays;
//! 3. refines them by the paper's silhouette and depth steps, then by a bounded local search;
//! 4. resolves collisions on convex parts ([`collisions`] lists them);
//! 5. looks at every object once more with its neighbours in place, and brings matched sets into line
//!    ([`refine_groups`]);
//! 6. measures what speaks for each pose ([`measure`], [`Evidence`]).
//!
//! [`apply`] tries a review action and [`judge`] decides about it by measurement.
//!
//! Frames and units are those of `docs/conventions.md`: room frame (metres, +Y up), OpenCV camera, yaw about +Y.
//! Masks, and the camera of [`PartialScene`], are at one working resolution (longest side about 1024 pixels).

mod anchoring;
mod collision;
mod cost;
mod evidence;
mod first_on_host;
mod first_on_wall;
mod first_pose;
mod formulas;
mod global;
mod groups;
mod item;
mod level;
mod optimise;
mod order;
mod outline;
mod pieces;
mod plausible;
#[cfg(test)]
mod probe;
mod proxy;
mod raster;
mod review;
mod scene;
mod settings;
mod shape;
mod solid;
mod solve;
mod standard;
mod steps;
mod support;
#[cfg(test)]
mod testing;
mod view;

#[cfg(test)]
extern crate self as harmony_placement;

pub use collision::{Collision, collisions};
pub use evidence::{Evidence, measure};
pub use formulas::{angular_size, corrected_depth, front_surface_depth, lateral_shift, metric_scale};
pub use global::{GlobalReport, refine_globally};
pub use groups::{GroupReport, color_swaps, refine_groups};
pub use item::{Item, Traits, YawHint};
pub use level::{LevelReport, ObjectReport, PlacementError, Unresolved, place_level};
pub use order::{OrderEntry, OrderReport, placement_order};
pub use review::{ActionError, ReviewAction, ReviewOutcome, Verdict, apply, judge, reshape};
pub use scene::{PartialScene, Placed, RoomPoints, Upcoming};
pub use settings::PlacementSettings;
pub use shape::Shape;
pub use view::may_be_seen;
