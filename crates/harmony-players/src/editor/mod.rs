//! Image editors over HTTP.
//!
//! | player | format | whose |
//! |---|---|---|
//! | `gemini` | `generateContent` with pictures as output | Google |
//! | `openai` | `images/edits` | OpenAI |
//! | `local_edits` | `images/edits` without what only OpenAI knows | `sd-server` of stable-diffusion.cpp, and others |
//!
//! Whatever a service does with a mask, what is kept is decided here: outside of the mask of the request the picture's
//! own pixels are put back. The answer is brought to the frame and size of the request's picture ([`frame`]), objects
//! are cut out of their plain background ([`cutout`]).

pub mod cutout;
pub mod frame;
mod player;
pub mod wire;

pub use player::{EditorFormat, EditorOptions, EditorPlayer};
