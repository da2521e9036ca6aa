//! `harmony.toml`: layers, weakest first: defaults, profile, file, environment, command line.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use harmony_calls::{Budget, Limits, Prices};
use harmony_pipeline::Settings;
use serde::{Deserialize, Serialize};

use crate::display::hinted;

pub mod networks;
pub mod players;

pub use networks::ModelsConfig;
pub use players::PlayersConfig;

/// Longest patience with whoever answers: a year.
const MAX_TIMEOUT_MINUTES: f64 = 525_600.0;

/// Who plays, in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, schemars::JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// Nothing but this program: no model, no key, no network. Honest, and rough.
    #[default]
    Offline,
    /// A person (or a chat window, or an agent) answers questions through a folder; this program does the rest.
    Files,
    /// The paper's cast: gpt-5.5, a Gemini image model, a Hunyuan3D-2 server, a LocateAnything server. Needs the keys
    /// OPENAI_API_KEY and GEMINI_API_KEY, and the two servers.
    Paper,
    /// Open weights on servers of your own: a language model, an image editor, a mesh generator.
    Local,
    /// Services alone, no GPU and nothing to start: a Gemini model looks and draws, fal.ai makes meshes. Needs the keys
    /// GEMINI_API_KEY and FAL_KEY; `harmony setup` sets others.
    Hosted,
}

impl Profile {
    /// Name as typed.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Offline => "offline",
            Self::Files => "files",
            Self::Paper => "paper",
            Self::Local => "local",
            Self::Hosted => "hosted",
        }
    }
}

/// `harmony.toml` as a user writes it; everything may be left out.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ConfigFile {
    /// Who plays.
    pub profile: Option<Profile>,
    /// Pipeline settings.
    pub settings: Settings,
    /// The files player.
    pub files: FilesConfig,
    /// Hosted and local players, for the profiles `paper`, `local` and `hosted`.
    pub players: PlayersConfig,
    /// Weights of the networks inside this program.
    pub models: ModelsConfig,
    /// What may be spent.
    pub budget: Budget,
    /// What players can take, and when they are tried again.
    pub limits: Limits,
    /// What calls cost.
    pub prices: Prices,
}

/// The files player.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FilesConfig {
    /// Folder of the questions; default `<run>/questions`.
    pub folder: Option<PathBuf>,
    /// Minutes to wait for an answer before this program answers itself; 0 = for ever.
    pub timeout_minutes: f64,
}

impl Default for FilesConfig {
    fn default() -> Self {
        Self { folder: None, timeout_minutes: 0.0 }
    }
}

/// Reads the named file, else `harmony.toml` in the working folder, else nothing.
///
/// # Errors
/// A file that was named and is not there, or that does not fit.
pub fn load(named: Option<&Path>) -> Result<ConfigFile> {
    let path = if let Some(path) = named {
        path.to_owned()
    } else {
        let usual = PathBuf::from("harmony.toml");
        if !usual.is_file() {
            return Ok(ConfigFile::default());
        }
        usual
    };
    let bytes = harmony_io::read_bounded(&path, 4 << 20).with_context(|| format!("reading {}", path.display()))?;
    let text = String::from_utf8(bytes).map_err(|_| anyhow::anyhow!("{} is not text", path.display()))?;
    parse(&text).map_err(|reason| {
        hinted(
            format!("{} does not fit: {reason}", path.display()),
            Some("`harmony schema config` prints what can be set"),
        )
    })
}

/// Reads a configuration.
///
/// # Errors
/// What does not fit, with line and column.
pub fn parse(text: &str) -> Result<ConfigFile, String> {
    // The error's own text would repeat the line, and with it a key that was written where none belongs.
    let file: ConfigFile = toml::from_str(text).map_err(|error| {
        let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
        let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
        format!("line {}, column {column}: {}", before.matches('\n').count() + 1, error.message())
    })?;
    file.settings.check()?;
    file.players.check()?;
    file.budget.check()?;
    file.limits.check()?;
    file.prices.check()?;
    if !(0.0..=MAX_TIMEOUT_MINUTES).contains(&file.files.timeout_minutes) {
        return Err(format!(
            "files.timeout_minutes is {}; allowed is 0 to {MAX_TIMEOUT_MINUTES}",
            file.files.timeout_minutes
        ));
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelt_key_is_named() {
        let error = parse("[settings]\nworkng_px = 800\n").unwrap_err();
        assert!(error.contains("workng_px") && error.contains("working_px"), "{error}");
    }

    #[test]
    fn a_patience_that_no_clock_can_hold_is_refused() {
        for minutes in ["1e300", "-1.0", "nan", "inf"] {
            let error = parse(&format!("[files]\ntimeout_minutes = {minutes}\n")).unwrap_err();
            assert!(error.contains("timeout_minutes"), "{error}");
        }
        assert!(parse("[files]\ntimeout_minutes = 525600.0\n").is_ok());
    }

    #[test]
    fn budgets_limits_and_prices_are_read() {
        let file = parse(
            "[budget]\nusd = 5.0\nwhen_reached = \"offline\"\n[budget.roles.mesh_generator]\ncalls = 40\n\
             [limits.try_seconds]\nmesh_generator = 900.0\n[limits.players.\"openai / gpt-5.5\"]\nrequests_per_minute = 60.0\n\
             [prices]\ndate = \"2026-11-01\"\n[prices.models.\"gpt-5.5\"]\ninput = 1.0\noutput = 8.0\n",
        )
        .unwrap();
        assert_eq!(file.budget.roles[&harmony_roles::Role::MeshGenerator].calls, Some(40));
        assert!((file.limits.try_seconds[&harmony_roles::Role::MeshGenerator] - 900.0).abs() < 1e-9);
        assert!((file.prices.models["gpt-5.5"].output - 8.0).abs() < 1e-9);
        for (text, named) in [
            ("[budget]\nusd = -1.0\n", "budget.usd"),
            ("[prices.models.m]\nimage = nan\n", "image"),
            ("[limits.retry]\nfirst_seconds = inf\n", "first_seconds"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(named), "{error}");
        }
    }

    #[test]
    fn a_value_out_of_range_is_refused_with_the_range() {
        let error = parse("[settings]\nworking_px = 9\n").unwrap_err();
        assert!(error.contains("256") && error.contains('9'), "{error}");
        for (name, value) in [("window_px", "4000000000"), ("noise.size", "nan"), ("max_rounds", "1000000000000")] {
            let error = parse(&format!("[settings.placement]\n{name} = {value}\n")).unwrap_err();
            assert!(error.contains(name), "{error}");
        }
        assert!(harmony_pipeline::Settings::default().check().is_ok());
    }
}
