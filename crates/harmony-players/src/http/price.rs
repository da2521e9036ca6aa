//! Tokens of calls, and what their headers say of rates. What calls cost is known to `[prices]` alone (`harmony_calls::Prices`).

use std::time::Duration;

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
    /// As usage, with what the answer's headers said ([`super::HttpAnswer::closed_for`]); no service tells what a call
    /// cost.
    pub fn usage(self, closed_for: Option<Duration>) -> Usage {
        Usage {
            input_tokens: self.input,
            cached_tokens: self.cached,
            output_tokens: self.output,
            cost_usd: None,
            closed_for,
        }
    }
}
