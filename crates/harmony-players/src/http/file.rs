//! Files at addresses that a service's answer names.
//!
//! Such an address is an answer, and no answer is trusted: it leads to the service's own address or, encrypted, to a
//! public host by its name. Names that resolve to addresses of this machine or its network are not followed either,
//! unless a proxy resolves them. Links are often signed: their query appears in no error and no log.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs};

use reqwest::Url;
use reqwest::dns::{Addrs, Name, Resolve, Resolving};

use super::address::{LocalHosts, is_loopback};

/// Longest link, characters.
const MAX_LINK: usize = 8192;

/// Endings of names that no public host has.
const NOT_PUBLIC: [&str; 6] = [".local", ".localhost", ".internal", ".home.arpa", ".lan", ".invalid"];

/// A link that may be followed.
#[derive(Clone, PartialEq, Eq)]
pub enum FileLink {
    /// At the service's own address.
    Own(Url),
    /// At a public host.
    Public(Url),
}

impl std::fmt::Debug for FileLink {
    /// Without path and query: either may be what opens the file.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "FileLink({})", self.url().host_str().unwrap_or_default())
    }
}

impl FileLink {
    /// Where it leads.
    pub(super) fn url(&self) -> &Url {
        match self {
            Self::Own(url) | Self::Public(url) => url,
        }
    }

    /// Reads a link of a service at `base`. With `local` given, nothing else may be reached.
    ///
    /// # Errors
    /// In words, without the link's path and query.
    pub(super) fn read(text: &str, base: &Url, local: Option<&LocalHosts>) -> Result<Self, String> {
        if text.len() > MAX_LINK {
            return Err(format!("it has {} characters; at most {MAX_LINK} are taken", text.len()));
        }
        let url = Url::parse(text.trim()).map_err(|_| "it is not an address".to_owned())?;
        if !url.username().is_empty() || url.password().is_some() {
            return Err("it holds a user name or a password".to_owned());
        }
        let host = url.host_str().unwrap_or_default().to_ascii_lowercase();
        if url.origin() == base.origin() && matches!(url.scheme(), "http" | "https") {
            return Ok(Self::Own(url));
        }
        if let Some(local) = local {
            // A neighbour that the user calls local may give the files.
            let trusted = local.contain(&url) && !is_loopback(&url);
            return if trusted { Ok(Self::Own(url)) } else { Err(format!("{host} is not on this machine")) };
        }
        if url.scheme() != "https" {
            return Err(format!("it is not encrypted, at {host}"));
        }
        let named = url.domain().is_some_and(|name| name.contains('.') && !name.ends_with('.'));
        if !named || NOT_PUBLIC.iter().any(|ending| host.ends_with(ending)) {
            return Err(format!("{host} is not a public host"));
        }
        Ok(Self::Public(url))
    }
}

/// Whether the environment names a proxy for encrypted addresses.
pub(super) fn proxy_is_set() -> bool {
    ["HTTPS_PROXY", "https_proxy", "ALL_PROXY", "all_proxy"]
        .iter()
        .any(|name| std::env::var(name).is_ok_and(|value| !value.trim().is_empty()))
}

/// Whether an address can belong to a public host.
fn is_public(ip: IpAddr) -> bool {
    match ip {
        IpAddr::V4(v4) => is_public_v4(v4),
        IpAddr::V6(v6) => v6.to_ipv4_mapped().map_or_else(|| is_public_v6(v6), is_public_v4),
    }
}

fn is_public_v6(v6: Ipv6Addr) -> bool {
    let first = v6.segments()[0];
    let unique_local = first & 0xfe00 == 0xfc00;
    let link_local = first & 0xffc0 == 0xfe80;
    !(v6.is_loopback() || v6.is_unspecified() || v6.is_multicast() || unique_local || link_local)
}

fn is_public_v4(v4: Ipv4Addr) -> bool {
    let [a, b, ..] = v4.octets();
    let shared = a == 100 && (64..128).contains(&b);
    !(v4.is_loopback()
        || v4.is_private()
        || v4.is_link_local()
        || v4.is_unspecified()
        || v4.is_broadcast()
        || v4.is_multicast()
        || shared
        || a == 0)
}

/// Resolves names to public addresses only.
#[derive(Debug)]
pub(super) struct PublicResolver;

impl Resolve for PublicResolver {
    fn resolve(&self, name: Name) -> Resolving {
        Box::pin(async move {
            let host = name.as_str().to_owned();
            let asked = host.clone();
            let found = tokio::task::spawn_blocking(move || (asked.as_str(), 0).to_socket_addrs()).await??;
            let public: Vec<SocketAddr> = found.filter(|address| is_public(address.ip())).collect();
            if public.is_empty() {
                return Err(format!("{host} has no public address").into());
            }
            Ok(Box::new(public.into_iter()) as Addrs)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, base: &str, local: Option<&LocalHosts>) -> Result<FileLink, String> {
        FileLink::read(text, &Url::parse(base).unwrap(), local)
    }

    #[test]
    fn links_lead_to_the_service_or_to_public_hosts() {
        let base = "https://api.example.com/v1";
        let link = read("https://files.example.net/a/m.glb?sig=secret", base, None).unwrap();
        assert!(matches!(link, FileLink::Public(_)));
        assert!(!format!("{link:?}").contains("secret"));
        assert!(matches!(read("https://api.example.com/files/m.glb", base, None), Ok(FileLink::Own(_))));
        for odd in [
            "http://files.example.net/m.glb",
            "https://127.0.0.1/m.glb",
            "https://[::1]/m.glb",
            "https://10.0.0.7/m.glb",
            "https://localhost/m.glb",
            "https://router.lan/m.glb",
            "https://printer.local/m.glb",
            "https://intranet/m.glb",
            "https://user:pass@files.example.net/m.glb",
            "file:///etc/passwd",
            "m.glb",
            "",
        ] {
            let error = read(odd, base, None).unwrap_err();
            assert!(!error.contains("m.glb") && !error.contains("pass@"), "{odd}: {error}");
        }
        assert!(read(&format!("https://files.example.net/{}", "x".repeat(MAX_LINK)), base, None).is_err());
    }

    #[test]
    fn a_service_on_this_machine_gives_its_files_itself() {
        let base = "http://127.0.0.1:8000/fal";
        assert!(matches!(read("http://127.0.0.1:8000/files/1.glb", base, None), Ok(FileLink::Own(_))));
        assert!(read("http://127.0.0.1:8001/files/1.glb", base, None).is_err(), "another service of this machine");
        let local = LocalHosts { named: vec!["gpu-box".to_owned()] };
        assert!(matches!(read("http://gpu-box:9/1.glb", base, Some(&local)), Ok(FileLink::Own(_))));
        assert!(read("https://files.example.net/1.glb", base, Some(&local)).is_err());
    }

    #[test]
    fn addresses_of_this_machine_and_its_network_are_not_public() {
        for private in
            ["127.0.0.1", "10.1.2.3", "192.168.0.1", "172.16.5.5", "169.254.169.254", "100.64.0.1", "0.0.0.0", "::1"]
        {
            assert!(!is_public(private.parse().unwrap()), "{private}");
        }
        for private in ["fe80::1", "fd00::7", "::ffff:127.0.0.1", "::"] {
            assert!(!is_public(private.parse().unwrap()), "{private}");
        }
        for public in ["93.184.216.34", "2606:2800:220:1:248:1893:25c8:1946", "100.128.0.1"] {
            assert!(is_public(public.parse().unwrap()), "{public}");
        }
    }
}
