//! What tokens and calls cost.

use harmony_roles::Usage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A price list in US dollars. No service tells the cost of a call: it is tokens times such a list.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Prices {
    /// A million input tokens.
    pub input_per_million: f64,
    /// A million input tokens that the service had in its cache; unset = as other input.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cached_per_million: Option<f64>,
    /// A million output tokens, reasoning and image tokens among them.
    pub output_per_million: f64,
    /// A call, whatever it uses.
    pub per_call: f64,
    /// The day for which the list holds, such as `2026-11-01`.
    pub as_of: String,
}

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
    /// Usage by a price list; without one the cost is not known.
    pub fn usage(self, prices: Option<&Prices>) -> Usage {
        let cost = |p: &Prices| {
            let cached = self.cached.min(self.input);
            let fresh = self.input - cached;
            let cached_price = p.cached_per_million.unwrap_or(p.input_per_million);
            p.per_call
                + (fresh as f64 * p.input_per_million
                    + cached as f64 * cached_price
                    + self.output as f64 * p.output_per_million)
                    / 1e6
        };
        Usage { input_tokens: self.input, output_tokens: self.output, cost_usd: prices.map(cost) }
    }
}

impl Prices {
    /// Whether every price is a number that can be a price.
    ///
    /// # Errors
    /// Which is not.
    pub fn check(&self) -> Result<(), String> {
        let all = [
            ("input_per_million", self.input_per_million),
            ("cached_per_million", self.cached_per_million.unwrap_or(0.0)),
            ("output_per_million", self.output_per_million),
            ("per_call", self.per_call),
        ];
        match all.iter().find(|(_, price)| !(0.0..=1e6).contains(price)) {
            Some((name, price)) => Err(format!("prices.{name} is {price}; allowed is 0 to 1000000 US$")),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cost_is_tokens_times_the_list() {
        let prices = Prices {
            input_per_million: 5.0,
            cached_per_million: Some(0.5),
            output_per_million: 30.0,
            per_call: 0.01,
            as_of: "2026-11-01".into(),
        };
        let tokens = Tokens { input: 10_000, cached: 4000, output: 2000 };
        let usage = tokens.usage(Some(&prices));
        // 6000 x 5e-6 + 4000 x 0.5e-6 + 2000 x 30e-6 + 0.01
        assert!((usage.cost_usd.unwrap() - 0.102).abs() < 1e-12);
        assert_eq!((usage.input_tokens, usage.output_tokens), (10_000, 2000));
        assert_eq!(tokens.usage(None).cost_usd, None);
        assert!(Prices { per_call: f64::NAN, ..prices }.check().is_err());
    }
}
