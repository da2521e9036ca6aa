//! Boxes for phrases: OWLv2 (Minderer et al. 2023, arXiv 2306.09683).
//!
//! The image goes through the network once, whatever the phrases; all phrases go through the text tower at once. Then
//! every patch of the image has a box, and a logit for every phrase. `docs/decisions/0014-detector.md` says why this
//! network. Weights and vocabulary: the files of `google/owlv2-*-ensemble`, in transformers' layout.

mod calibration;
#[cfg(feature = "players")]
mod choose;
mod network;
#[cfg(feature = "players")]
mod player;
mod preprocess;

pub use calibration::Calibration;
#[cfg(feature = "players")]
pub use choose::{Candidate, ChoiceSettings, choose};
pub use network::{Owlv2, Owlv2Config, Owlv2Image, Owlv2Size};
#[cfg(feature = "players")]
pub use player::{DetectorError, DetectorSettings, Owlv2Detector};
pub use preprocess::preprocess;
