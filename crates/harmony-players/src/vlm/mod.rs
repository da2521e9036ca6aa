//! Language models over HTTP.
//!
//! | player | format | whose |
//! |---|---|---|
//! | `openai` | [`wire::responses`] | OpenAI |
//! | `openai_chat` | [`wire::chat`] | OpenAI |
//! | `gemini` | [`wire::gemini`] | Google |
//! | `anthropic` | [`wire::anthropic`] | Anthropic |
//! | `compatible` | [`wire::chat`] | vLLM, llama.cpp, Ollama, mistral.rs and others, told apart by their list of models |
//!
//! A question's schema is reshaped for the service's strict mode ([`schema`]), the answer is brought back and checked
//! against the schema of the question.

mod phased;
mod pictures;
mod player;
pub mod schema;
pub mod wire;

pub use phased::PhasedVlm;
pub use player::{Format, VlmOptions, VlmPlayer};
