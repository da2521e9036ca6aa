//! The user study: people rank anonymous reconstructions of a photo.
//!
//! Paper: appendix "User Study" and the right half of its second table. A study has three parts that never mix:
//!
//! | part | holds | who sees it |
//! |---|---|---|
//! | the site | one page, photos and pictures under opaque names | everybody |
//! | the private folder | which opaque name is which method, the secret that signs invitations | whoever runs the study |
//! | the log | one line an answer, by participant's code | whoever runs the study |
//!
//! | module | holds |
//! |---|---|
//! | [`shuffle`] | the order of panels and trials, fixed to the bit; the page has the same in `assets/shuffle.js` |
//! | [`sets`] | the pictures of each method: folders of runs or of images |
//! | [`build`] | the site and the private folder |
//! | [`private`] | the decoding map, invitations and tokens |
//! | [`record`] | an answer, and what makes it valid |
//! | [`log`] | the append-only log: an acknowledged line is on the disk |
//! | [`server`] | the page and its answers over HTTP |
//! | [`collect`] | answers that came as files |
//! | [`analyse`] | ranks, intervals, tests, strengths |
//! | [`simulate`] | participants with known preferences, to test the analysis and to plan a study |

pub mod analyse;
pub mod build;
pub mod collect;
mod error;
pub mod log;
mod page;
pub mod private;
pub mod record;
pub mod server;
pub mod sets;
pub mod shuffle;
pub mod simulate;
pub mod text;

pub use error::StudyError;

/// Version of the formats of page, private folder and log; raised when a reader would have to change.
pub const FORMAT: u32 = 1;
