//! Placement: from masks, relations and size priors to poses. Paper Sec. 3.3 and App. C.
//!
//! Pure functions over data: no model, no file, no async. A pose has one score, `E = sum rho(r / sigma) - ln p(hypothesis)`
//! in nats (`terms`), for one object and for all together; every sigma and every probability stands in [`Noise`]. The main
//! path is [`place_level`]:
//!
//! 1. the order ([`placement_order`]);
//! 2. for each object: hypotheses (`propose`), the paper's silhouette and depth steps and a bounded search (`solve::local`);
//! 3. all of them with camera, room and scale together (`solve::joint`);
//! 4. projection to support and contact (`contact`);
//! 5. what speaks for each pose, and how sure it is ([`measure`], [`Evidence`]).
//!
//! [`apply`] tries a review action and [`judge`] decides about it by the same energy (`accept`).
//!
//! | module | holds |
//! |---|---|
//! | `scene` | room, camera, objects, how each is held: data, no solver |
//! | `observe` | what mask and point map show of one object |
//! | `terms`, `noise` | the energy, and every number in it |
//! | `propose`, `solve`, `accept` | hypotheses, solves, the rule by which a change is kept |
//! | `contact` | nothing in anything, everything on what carries it |
//! | `form` | seats, arms and backs where depth has them |
//! | `drape` | cloth on what carries it |
//!
//! Frames and units are those of `docs/conventions.md`: room frame (metres, +Y up), OpenCV camera, yaw about +Y.
//! Masks, and the camera of [`PartialScene`], are at one working resolution (longest side about 1024 pixels).

mod accept;
mod contact;
mod drape;
mod form;
mod level;
mod measure;
mod noise;
mod observe;
mod order;
mod propose;
mod review;
mod scene;
mod settings;
mod solve;
mod stats;
mod terms;
#[cfg(test)]
mod testing;

pub use contact::collision::{Collision, collisions};
pub use drape::{Draped, drape, drape_in};
pub use form::{Bend, FittedForm, bend_in, fit_form};
pub use level::{LevelReport, ObjectReport, PlacementError, place_level};
pub use measure::measure;
pub use noise::Noise;
pub use observe::may_be_seen;
pub use order::{OrderEntry, OrderReport, placement_order};
pub use review::{ActionError, ReviewAction, ReviewOutcome, Verdict, apply, energy_change, fit_shape, judge, reshape};
pub use scene::{Energy, Evidence, Item, PartialScene, Placed, RoomPoints, Shape, Spread, Traits, YawHint};
pub use settings::PlacementSettings;
pub use solve::formulas::{angular_size, corrected_depth, front_surface_depth, lateral_shift, metric_scale};
pub use solve::joint::{GlobalReport, refine_globally};
