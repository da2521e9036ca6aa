//! The folder of weights, from the command line, the environment and the configuration.

use std::path::{Path, PathBuf};

use anyhow::Result;
use harmony_models::{Endpoints, Hub, HubOptions, ModelError, PullLimits, Store, Token};

use crate::config::{ModelsConfig, PlayersConfig};
use crate::display::hinted;

/// An error of the models crate, with what to do about it.
pub fn told(error: &ModelError) -> anyhow::Error {
    hinted(error.to_string(), error.hint())
}

fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok().filter(|value| !value.trim().is_empty())
}

/// The folder: `--dir`, HARMONY_MODELS, the configuration, the user's data folder.
pub fn store(config: &ModelsConfig, dir: Option<&Path>) -> Store {
    let data = || {
        let base = variable("XDG_DATA_HOME").or_else(|| variable("LOCALAPPDATA")).map(PathBuf::from);
        let base = base.or_else(|| variable("HOME").map(|home| PathBuf::from(home).join(".local/share")));
        base.unwrap_or_default().join("harmony/models")
    };
    let named = dir.map(Path::to_owned).or_else(|| variable("HARMONY_MODELS").map(PathBuf::from));
    Store::new(named.or_else(|| config.folder.clone()).unwrap_or_else(data))
}

/// The hub: HARMONY_HUB, HF_ENDPOINT, the configuration; the token of HF_TOKEN.
///
/// # Errors
/// An address that is none.
pub fn hub(config: &ModelsConfig, players: &PlayersConfig) -> Result<Hub> {
    let address = variable("HARMONY_HUB").or_else(|| variable("HF_ENDPOINT"));
    let endpoints = Endpoints::new(address.as_deref().unwrap_or(&config.hub), &config.torch, &config.code);
    let options = HubOptions {
        endpoints: endpoints.map_err(|e| told(&e))?,
        token: variable("HF_TOKEN").and_then(|text| Token::new(&text)),
        only: players.local_only.then(|| players.local_hosts.clone()),
        limits: PullLimits::default(),
    };
    Hub::new(options).map_err(|e| told(&e))
}

/// `5.03 GB`, `6.0 kB`.
pub fn bytes(count: u64) -> String {
    let n = count as f64;
    match count {
        1_000_000_000.. => format!("{:.2} GB", n / 1e9),
        1_000_000.. => format!("{:.0} MB", n / 1e6),
        1_000.. => format!("{:.1} kB", n / 1e3),
        _ => format!("{count} bytes"),
    }
}

#[cfg(test)]
mod tests {
    use super::bytes;

    #[test]
    fn sizes_are_told_in_sensible_units() {
        assert_eq!([6009, 156_008_466, 5_026_367_224, 12].map(bytes), ["6.0 kB", "156 MB", "5.03 GB", "12 bytes"]);
    }
}
