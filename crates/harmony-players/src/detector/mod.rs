//! Detectors over HTTP.
//!
//! | player | server | score |
//! |---|---|---|
//! | `locate_anything` | LocateAnything behind a server that speaks chat completions ([`locate`]) | none |
//! | `grounding_dino` | zero-shot detection in the form of Hugging Face's task ([`grounding`]) | the detector's |
//! | `vlm_boxes` | the language model, asked for boxes ([`asked`]) | none |
//!
//! A score that a detector does not give is `None`: none is made up.

pub mod asked;
pub mod boxes;
pub mod grounding;
pub mod locate;
