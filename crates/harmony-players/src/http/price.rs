//! Tokens of calls. What they cost is known to `[prices]` alone (`harmony_calls::Prices`).

use harmony_roles::Usage;

/// Tokens of one call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tokens {
    /// All input, cached included.
    pub input: u64,
    /// Of the input, what the service had in its cache.
    pub cached: u64,
    /// All output, reasoning included.
    pub output: u64,
}

impl Tokens {
    /// As usage; no service tells what a call cost.
    pub fn usage(self) -> Usage {
        Usage { input_tokens: self.input, cached_tokens: self.cached, output_tokens: self.output, cost_usd: None }
    }
}
