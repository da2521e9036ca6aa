//! What calls cost: a table of prices with its date.

use std::collections::BTreeMap;

use harmony_roles::{PlayerCard, Role, Usage};
use serde::{Deserialize, Serialize};

/// Prices of one model, US dollars. What is left out costs nothing or is not known: a model that is in the table at
/// all counts as priced.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Price {
    /// A million input tokens.
    pub input: f64,
    /// A million input tokens that the service had in its cache; left out = as other input.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cached: Option<f64>,
    /// A million output tokens, thinking and image tokens among them.
    pub output: f64,
    /// An image made.
    pub image: f64,
    /// A mesh made.
    pub mesh: f64,
    /// Any call, whatever it brings.
    pub call: f64,
}

/// `[prices]` of the configuration. Vendors change prices, so the program brings none of its own: a model that is not
/// in the table has no known cost, and bill and estimate say so.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Prices {
    /// When the prices were looked up, in words; shown wherever money is.
    pub date: String,
    /// By model, player and model (`openai / gpt-5.5`), or the beginning of either (`gpt-5.5` is the price of
    /// `gpt-5.5-2026-04-23` too); the longest name that fits counts.
    pub models: BTreeMap<String, Price>,
}

/// Tokens that a question is taken to cost before any was answered.
pub(crate) const QUESTION_TOKENS: (u64, u64) = (6000, 2500);

impl Prices {
    /// The prices of a player's model.
    pub fn of(&self, card: &PlayerCard) -> Option<&Price> {
        let full = format!("{} / {}", card.player, card.model);
        self.models
            .iter()
            .filter(|(name, _)| card.model.starts_with(*name) || full.starts_with(*name))
            .max_by_key(|(name, _)| name.len())
            .map(|(_, price)| price)
    }

    /// Cost of one answered try, US dollars: what the player says, else by the table. Offline players cost nothing and
    /// are not priced.
    pub fn cost(&self, role: Role, card: &PlayerCard, usage: Usage) -> Option<f64> {
        usage.cost_usd.or_else(|| {
            if card.offline {
                return None;
            }
            let price = self.of(card)?;
            let made = match role {
                Role::ImageEditor => price.image,
                Role::MeshGenerator => price.mesh,
                _ => 0.0,
            };
            let cached = usage.cached_tokens.min(usage.input_tokens);
            let fresh = usage.input_tokens - cached;
            let tokens = price.input * fresh as f64
                + price.cached.unwrap_or(price.input) * cached as f64
                + price.output * usage.output_tokens as f64;
            Some(price.call + made + tokens / 1e6)
        })
    }

    /// What a try is taken to cost before it is made, where nothing is known from earlier ones.
    pub fn expected(&self, role: Role, card: &PlayerCard) -> Option<f64> {
        let (input_tokens, output_tokens) = match role {
            // A detector may be a language model that is asked for boxes; others have no price for tokens.
            Role::VisionLanguage | Role::Detector => QUESTION_TOKENS,
            _ => (0, 0),
        };
        self.cost(role, card, Usage { input_tokens, output_tokens, ..Usage::default() })
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// A sentence that names the model, the field and its value.
    pub fn check(&self) -> Result<(), String> {
        for (model, p) in &self.models {
            let fields = [
                ("input", p.input),
                ("cached", p.cached.unwrap_or(0.0)),
                ("output", p.output),
                ("image", p.image),
                ("mesh", p.mesh),
                ("call", p.call),
            ];
            for (name, value) in fields {
                if !(0.0..=1e6).contains(&value) {
                    return Err(format!("prices.models.{model:?}.{name} is {value}; allowed is 0 to 1000000"));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn card(player: &str, model: &str) -> PlayerCard {
        PlayerCard { player: player.into(), model: model.into(), offline: false, concurrency: 0 }
    }

    #[test]
    fn the_longest_name_that_fits_gives_the_price_and_the_players_own_word_counts_more() {
        let mut prices = Prices::default();
        let tokens = |input, output| Price { input, output, ..Price::default() };
        prices.models.insert("big".into(), tokens(2.0, 10.0));
        prices.models.insert("big-mini".into(), tokens(0.2, 1.0));
        prices.models.insert("here / big".into(), tokens(0.0, 0.0));
        let usage = Usage { input_tokens: 1_000_000, output_tokens: 100_000, ..Usage::default() };
        let cost = |player: &str, model: &str| prices.cost(Role::VisionLanguage, &card(player, model), usage);
        assert_eq!(cost("there", "big-2026-01-01"), Some(3.0));
        assert_eq!(cost("there", "big-mini"), Some(0.3));
        assert_eq!(cost("here", "big"), Some(0.0));
        assert_eq!(cost("there", "other"), None, "not in the table, not known");
        let said = Usage { cost_usd: Some(0.07), ..usage };
        assert_eq!(prices.cost(Role::VisionLanguage, &card("there", "big"), said), Some(0.07));
    }

    #[test]
    fn cached_input_has_a_price_of_its_own() {
        let mut prices = Prices::default();
        let price = Price { input: 5.0, cached: Some(0.5), output: 30.0, call: 0.01, ..Price::default() };
        prices.models.insert("m".into(), price);
        let usage = Usage { input_tokens: 10_000, cached_tokens: 4000, output_tokens: 2000, ..Usage::default() };
        // 6000 x 5e-6 + 4000 x 0.5e-6 + 2000 x 30e-6 + 0.01
        let cost = prices.cost(Role::VisionLanguage, &card("p", "m"), usage).unwrap();
        assert!((cost - 0.102).abs() < 1e-12, "{cost}");
    }

    #[test]
    fn boxes_from_a_language_model_cost_what_its_tokens_cost() {
        let mut prices = Prices::default();
        prices.models.insert("m".into(), Price { input: 5.0, output: 30.0, ..Price::default() });
        prices.models.insert("dino".into(), Price { call: 0.01, ..Price::default() });
        let usage = Usage { input_tokens: 2000, output_tokens: 100, ..Usage::default() };
        let cost = prices.cost(Role::Detector, &card("p", "m"), usage).unwrap();
        assert!((cost - 0.013).abs() < 1e-12, "{cost}");
        let expected = |model: &str| prices.expected(Role::Detector, &card("p", model)).unwrap();
        assert!((expected("m") - (0.03 + 0.075)).abs() < 1e-12, "6000 in, 2500 out: {}", expected("m"));
        assert!((expected("dino") - 0.01).abs() < 1e-12);
    }

    #[test]
    fn images_and_meshes_are_priced_by_the_piece() {
        let mut prices = Prices::default();
        prices.models.insert("m".into(), Price { image: 0.04, mesh: 0.2, call: 0.01, ..Price::default() });
        let none = Usage::default();
        assert_eq!(prices.cost(Role::ImageEditor, &card("p", "m"), none), Some(0.05));
        let mesh = prices.cost(Role::MeshGenerator, &card("p", "m"), none).unwrap();
        assert!((mesh - 0.21).abs() < 1e-9, "{mesh}");
        assert_eq!(prices.cost(Role::Detector, &card("p", "m"), none), Some(0.01));
    }
}
