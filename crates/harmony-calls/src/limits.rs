//! What a player can take, as configured: requests and tokens a minute, seconds a try. How many calls at a time is told
//! by the player itself ([`PlayerCard::concurrency`]), which is set with it.

use std::collections::BTreeMap;
use std::time::Duration;

use harmony_roles::{PlayerCard, Role};
use serde::{Deserialize, Serialize};

use crate::retry::RetryPolicy;

/// Longest deadline of one try, seconds: a day.
const MAX_SECONDS: f64 = 86_400.0;

/// Limits of one player, or of one of its models. What is left out is not limited (or as the player's card says).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlayerLimits {
    /// Requests a minute.
    pub requests_per_minute: Option<f64>,
    /// Input and output tokens a minute.
    pub tokens_per_minute: Option<f64>,
    /// Seconds after which a try counts as not answered; 0 = never.
    pub try_seconds: Option<f64>,
}

/// `[limits]` of the configuration.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Seconds after which a try counts as not answered, by role; overrides the built-in ones.
    pub try_seconds: BTreeMap<Role, f64>,
    /// What is tried again, and when.
    pub retry: RetryPolicy,
    /// By player (`openai`) or player and model (`openai / gpt-5.5`); the latter overrides the former, field by field.
    pub players: BTreeMap<String, PlayerLimits>,
    /// Length of the minute that rates are counted in; for tests whose times are scaled down.
    #[serde(skip)]
    pub minute: Option<Duration>,
}

/// Seconds after which a try counts as not answered, where nothing is configured: several times what a slow answer of
/// the kind takes (a reasoning model ten minutes, a mesh on a small card half an hour).
fn usual_try_seconds(role: Role) -> f64 {
    match role {
        Role::VisionLanguage | Role::ImageEditor | Role::GeometryEstimator => 600.0,
        Role::Detector | Role::Segmenter => 300.0,
        Role::MeshGenerator => 1800.0,
        Role::LitRenderer => 7200.0,
    }
}

/// When an answer can be expected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// As soon as it is made.
    AtOnce,
    /// When whoever answers comes to it.
    OwnTime,
}

impl Limits {
    /// The limits of a player.
    pub fn of(&self, card: &PlayerCard) -> PlayerLimits {
        let all = self.players.get(&card.player).copied().unwrap_or_default();
        let model = self.players.get(&format!("{} / {}", card.player, card.model)).copied().unwrap_or_default();
        PlayerLimits {
            requests_per_minute: model.requests_per_minute.or(all.requests_per_minute),
            tokens_per_minute: model.tokens_per_minute.or(all.tokens_per_minute),
            try_seconds: model.try_seconds.or(all.try_seconds),
        }
    }

    /// Whether a player that is not answering now is worth another try: one elsewhere is; this program alone, one that
    /// runs here as a process (the path tracer) and a person who did not come are not.
    pub fn is_tried_again(role: Role, card: &PlayerCard, pace: Pace) -> bool {
        !card.offline && pace == Pace::AtOnce && role != Role::LitRenderer
    }

    /// Deadline of one try of a player in a role, seconds; `None` = none. Whoever only computes has none, and who answers
    /// in their own time has a patience of their own.
    pub fn try_deadline(&self, role: Role, card: &PlayerCard, pace: Pace) -> Option<f64> {
        // What is set for a role is meant for whoever was cast: a stand-in that is cut off would end the run.
        let unbounded = card.offline || pace == Pace::OwnTime;
        let of_role = || self.try_seconds.get(&role).copied().unwrap_or_else(|| usual_try_seconds(role));
        let seconds = self.of(card).try_seconds.or_else(|| (!unbounded).then(of_role));
        seconds.filter(|s| *s > 0.0)
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// A sentence that names the field, its value and what is allowed.
    pub fn check(&self) -> Result<(), String> {
        self.retry.check()?;
        let within = |name: String, value: Option<f64>, low: f64, high: f64| match value {
            Some(v) if !(low..=high).contains(&v) => Err(format!("{name} is {v}; allowed is {low} to {high}")),
            _ => Ok(()),
        };
        for (role, seconds) in &self.try_seconds {
            within(format!("limits.try_seconds.{}", role.folder()), Some(*seconds), 0.0, MAX_SECONDS)?;
        }
        for (player, l) in &self.players {
            let name = |field: &str| format!("limits.players.{player:?}.{field}");
            within(name("requests_per_minute"), l.requests_per_minute, 0.01, 1e9)?;
            within(name("tokens_per_minute"), l.tokens_per_minute, 1.0, 1e12)?;
            within(name("try_seconds"), l.try_seconds, 0.0, MAX_SECONDS)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn card(player: &str, model: &str, offline: bool) -> PlayerCard {
        PlayerCard { player: player.into(), model: model.into(), offline, concurrency: 4 }
    }

    #[test]
    fn a_models_limits_override_its_players_field_by_field() {
        let mut limits = Limits::default();
        let player =
            PlayerLimits { try_seconds: Some(8.0), requests_per_minute: Some(60.0), ..PlayerLimits::default() };
        limits.players.insert("openai".into(), player);
        let model = PlayerLimits { requests_per_minute: Some(5.0), ..PlayerLimits::default() };
        limits.players.insert("openai / big".into(), model);
        let big = limits.of(&card("openai", "big", false));
        assert_eq!((big.try_seconds, big.requests_per_minute), (Some(8.0), Some(5.0)));
        assert_eq!(limits.of(&card("openai", "small", false)).requests_per_minute, Some(60.0));
        assert_eq!(limits.of(&card("gemini", "big", false)), PlayerLimits::default());
    }

    #[test]
    fn whoever_computes_or_is_a_person_has_no_deadline_unless_given_one() {
        let mut limits = Limits::default();
        let deadline = |limits: &Limits, role, card| limits.try_deadline(role, &card, Pace::AtOnce);
        let person = card("files", "a person", false);
        assert_eq!(deadline(&limits, Role::VisionLanguage, card("offline", "rules", true)), None);
        assert_eq!(limits.try_deadline(Role::VisionLanguage, &person, Pace::OwnTime), None);
        assert!(!Limits::is_tried_again(Role::VisionLanguage, &person, Pace::OwnTime));
        assert!(deadline(&limits, Role::MeshGenerator, card("hunyuan", "2", false)).is_some());
        limits.try_seconds.insert(Role::MeshGenerator, 2.0);
        assert_eq!(deadline(&limits, Role::MeshGenerator, card("hunyuan", "2", false)), Some(2.0));
        assert_eq!(deadline(&limits, Role::MeshGenerator, card("offline", "parts", true)), None, "stand-ins have none");
        limits.try_seconds.insert(Role::MeshGenerator, 0.0);
        assert_eq!(deadline(&limits, Role::MeshGenerator, card("hunyuan", "2", false)), None);
    }

    #[test]
    fn numbers_that_no_clock_can_hold_are_refused() {
        for value in [f64::NAN, f64::INFINITY, -1.0, 1e300] {
            let mut limits = Limits::default();
            limits.try_seconds.insert(Role::Detector, value);
            assert!(limits.check().unwrap_err().contains("detector"), "{value}");
        }
        assert!(Limits::default().check().is_ok());
    }
}
