//! Reconstructed rooms in one layout: a home. Key `home.layout`.
//!
//! Paper: appendix "Multi-Room Layout": "By refining camera poses with respect to a canonical layout, HARMONY naturally
//! generalizes to diverse room configurations and multi-room environments"; it says no more. What this program makes of
//! it stands in `docs/homes.md` and `docs/decisions/0037-homes.md`.
//!
//! | module | holds |
//! |---|---|
//! | [`layout`], [`svg`] | floor plans as JSON and as drawings |
//! | [`frame`] | the home's frame, quarter turns, places of rooms |
//! | [`rooms`] | what runs say of their rooms |
//! | [`assign`], [`matching`] | which run is which room of a layout; rooms joined by their doors |
//! | [`solve`] | all rooms refined together |
//! | [`mod@build`], [`home`] | from runs to a home with its conflicts |
//! | [`mod@merge`], [`walls`] | a home as one scene |
//! | [`mod@adapt`] | one room in another size |
//! | [`files`] | the folder of a home |

pub mod adapt;
pub mod assign;
pub mod build;
mod drawing;
pub mod error;
pub mod files;
pub mod frame;
pub mod home;
pub mod layout;
pub mod matching;
pub mod merge;
pub mod moved;
mod picture;
pub mod rooms;
mod shell;
pub mod solve;
pub mod svg;
pub mod walls;

pub use error::HomeError;
