//! Where a service is, and whether that is on this machine.

use std::net::{IpAddr, SocketAddr, ToSocketAddrs};
use std::sync::Arc;

use reqwest::Url;
use reqwest::dns::{Addrs, Name, Resolve, Resolving};

/// An address can't be used. Addresses that hold a password are not repeated.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum AddressError {
    /// Not a URL.
    #[error("{address:?} is not an address such as http://127.0.0.1:8081")]
    NotAnAddress {
        /// What was given.
        address: String,
    },
    /// The address holds a user name, a password or a query, where keys are put by mistake.
    #[error("an address may not hold a user name, a password or a query: keys come from the environment")]
    HoldsSecrets,
    /// Nothing may leave the machine.
    #[error("{host} is not on this machine, and `local_only` is set")]
    NotLocal {
        /// The host.
        host: String,
    },
    /// The key could be read on the way.
    #[error("a key is not sent to {host} without encryption")]
    KeyInTheClear {
        /// The host.
        host: String,
    },
}

/// Which hosts count as this machine (or as trusted like it).
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LocalHosts {
    /// Host names and addresses that the user calls local, in small letters.
    pub named: Vec<String>,
}

impl LocalHosts {
    /// Whether the host of a URL is loopback or named local.
    pub fn contain(&self, url: &Url) -> bool {
        let host = url.host_str().unwrap_or_default().to_ascii_lowercase();
        is_loopback(url) || self.named.iter().any(|name| name.eq_ignore_ascii_case(&host))
    }
}

/// Whether a URL points at this machine: a loopback address, or the name `localhost`.
pub fn is_loopback(url: &Url) -> bool {
    let Some(host) = url.host_str() else { return false };
    let host = host.trim_start_matches('[').trim_end_matches(']');
    match host.parse::<IpAddr>() {
        Ok(IpAddr::V6(v6)) => v6.is_loopback() || v6.to_ipv4_mapped().is_some_and(|v4| v4.is_loopback()),
        Ok(IpAddr::V4(v4)) => v4.is_loopback(),
        Err(_) => host.eq_ignore_ascii_case("localhost"),
    }
}

/// Reads the base address of a service.
///
/// # Errors
/// [`AddressError`].
pub fn parse_address(text: &str) -> Result<Url, AddressError> {
    let url = Url::parse(text.trim());
    // A password is looked for first: what cannot be read for another reason must not show it either.
    if text.contains('@') || text.contains('?') || text.contains('#') {
        return Err(AddressError::HoldsSecrets);
    }
    let wrong = || AddressError::NotAnAddress { address: text.chars().take(200).collect() };
    let url = url.map_err(|_| wrong())?;
    if !matches!(url.scheme(), "http" | "https") || url.host_str().is_none_or(str::is_empty) {
        return Err(wrong());
    }
    Ok(url)
}

/// The address of a path below the base: `http://h:1/v1` and `/images/edits` give `http://h:1/v1/images/edits`.
pub fn join(base: &Url, path: &str) -> Url {
    let mut url = base.clone();
    let joined = format!("{}/{}", base.path().trim_end_matches('/'), path.trim_start_matches('/'));
    url.set_path(joined.trim_end_matches('/'));
    url
}

/// Resolves loopback and the names that the user calls local, and nothing else: what is not asked for by name cannot
/// be reached by mistake either.
#[derive(Debug)]
pub(super) struct LocalResolver(pub(super) Arc<LocalHosts>);

impl Resolve for LocalResolver {
    fn resolve(&self, name: Name) -> Resolving {
        let hosts = Arc::clone(&self.0);
        Box::pin(async move {
            let host = name.as_str().to_owned();
            if host.eq_ignore_ascii_case("localhost") {
                let loopback: Vec<SocketAddr> = vec![([127, 0, 0, 1], 0).into(), ([0, 0, 0, 0, 0, 0, 0, 1], 0).into()];
                return Ok(Box::new(loopback.into_iter()) as Addrs);
            }
            if !hosts.named.iter().any(|named| named.eq_ignore_ascii_case(&host)) {
                return Err(AddressError::NotLocal { host }.into());
            }
            let found = tokio::task::spawn_blocking(move || (host.as_str(), 0).to_socket_addrs()).await??;
            Ok(Box::new(found) as Addrs)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_is_told_from_what_only_looks_like_it() {
        for here in [
            "http://127.0.0.1:8081",
            "http://127.9.9.9",
            "http://[::1]:1",
            "http://LocalHost/v1",
            "http://[::ffff:127.0.0.1]",
        ] {
            assert!(is_loopback(&parse_address(here).unwrap()), "{here}");
        }
        for there in [
            "https://api.openai.com/v1",
            "http://localhost.example.org",
            "http://127.0.0.1.example.org",
            "http://10.0.0.7:8081",
            "http://0.0.0.0:1",
            "http://[::2]",
        ] {
            let url = parse_address(there).unwrap();
            assert!(!is_loopback(&url), "{there}");
            assert!(!LocalHosts::default().contain(&url));
        }
        let named = LocalHosts { named: vec!["gpu-box".into(), "10.0.0.7".into()] };
        assert!(named.contain(&parse_address("http://GPU-Box:8081").unwrap()));
        assert!(named.contain(&parse_address("http://10.0.0.7").unwrap()));
        assert!(!named.contain(&parse_address("http://gpu-box.example.org").unwrap()));
    }

    #[test]
    fn addresses_with_secrets_are_refused_and_not_repeated() {
        for text in ["https://user:hunter2@host/v1", "https://host/v1?key=hunter2", "ftp//hunter2@"] {
            let error = parse_address(text).unwrap_err();
            assert_eq!(error, AddressError::HoldsSecrets);
            assert!(!error.to_string().contains("hunter2"));
        }
        for text in ["", "host:8081", "file:///etc/passwd", "localhost", "http://"] {
            assert!(matches!(parse_address(text), Err(AddressError::NotAnAddress { .. })), "{text}");
        }
    }

    #[test]
    fn paths_are_joined_below_the_base() {
        let at = |base: &str, path: &str| join(&parse_address(base).unwrap(), path).to_string();
        assert_eq!(at("http://h:1/v1", "/images/edits"), "http://h:1/v1/images/edits");
        assert_eq!(at("http://h:1/v1/", "images/edits"), "http://h:1/v1/images/edits");
        assert_eq!(at("http://h:1", "/generate"), "http://h:1/generate");
        assert_eq!(at("https://h/v1beta", "models/m:generateContent"), "https://h/v1beta/models/m:generateContent");
    }
}
