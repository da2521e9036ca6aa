//! Data sets of photos and their reconstructions, and galleries of runs.
//!
//! Paper: appendix "HARMONY300 Dataset" (splits, per-scene contents, sourcing and licensing) and "Canonical Views".
//! A data set is a working folder that grows by [`add`] and of which [`release`] makes what is published:
//!
//! | in the working folder | in the release |
//! |---|---|
//! | photos byte for byte as they came | photos without EXIF, faces blurred; none where the licence forbids it |
//! | `dataset.json`, `sources.csv` written by hand and by [`add`] | the same, with licence manifest, card, Croissant, index, shards, hashes |
//!
//! | module | holds |
//! |---|---|
//! | [`layout`] | splits, names of scenes and files |
//! | [`config`] | `dataset.json` |
//! | [`sources`] | `sources.csv`: where each photo is from and what may be done with it |
//! | [`licences`] | what known licences allow |
//! | [`add`] | a finished run becomes a scene |
//! | [`faces`] | faces that somebody found become regions to blur |
//! | [`photo`] | photos without metadata, blurred regions |
//! | [`records`] | what the files of a scene say |
//! | [`check`] | what is missing, wrong or not licensed |
//! | [`stats`] | the paper's figure, as SVG and CSV |
//! | [`release`] | what is published |
//! | [`croissant`], [`card`], [`shards`], [`parquet`] | formats of others |
//! | [`gallery`] | canonical views, contact sheets, turntables |

pub mod add;
pub mod card;
pub mod check;
pub mod config;
pub mod croissant;
mod error;
pub mod faces;
pub mod gallery;
pub mod layout;
pub mod licences;
pub mod parquet;
pub mod photo;
pub mod records;
pub mod release;
pub mod shards;
pub mod sources;
pub mod stats;

pub use error::DatasetError;
