//! Asking a hub for a file: addresses, redirects, the token.

use std::time::Duration;

use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue, LOCATION};
use reqwest::{Client, Response, StatusCode, Url, redirect};

use crate::ModelError;
use crate::table::{ModelFile, Source};

/// Redirects that are followed.
const MAX_HOPS: usize = 8;
/// Longest text of a server that is repeated.
const MAX_WORDS: usize = 300;

/// Where files come from; each may be a mirror.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Endpoints {
    /// The model hub: `<hub>/<owner>/<name>/resolve/<revision>/<path>`.
    pub hub: Url,
    /// PyTorch's downloads: `<torch>/models/<file>`.
    pub torch: Url,
    /// Files of source repositories: `<code>/<owner>/<name>/<commit>/<path>`.
    pub code: Url,
}

impl Endpoints {
    /// The makers' own.
    pub const USUAL: [&'static str; 3] =
        ["https://huggingface.co", "https://download.pytorch.org", "https://raw.githubusercontent.com"];

    /// From addresses as written.
    ///
    /// # Errors
    /// [`ModelError::Address`].
    pub fn new(hub: &str, torch: &str, code: &str) -> Result<Self, ModelError> {
        Ok(Self { hub: base(hub)?, torch: base(torch)?, code: base(code)? })
    }

    /// The address of a file; `commit` instead of the table's revision where that one is not known.
    pub(crate) fn address(&self, file: &ModelFile, commit: Option<&str>) -> Url {
        let (base, path) = match file.source {
            Source::Hub { repo, revision } => {
                let revision = revision.or(commit).unwrap_or("main");
                (&self.hub, format!("{repo}/resolve/{revision}/{}", file.path))
            }
            Source::Torch => (&self.torch, format!("models/{}", file.path)),
            Source::Code { repo, commit } => (&self.code, format!("{repo}/{commit}/{}", file.path)),
        };
        let mut url = base.clone();
        url.set_path(&format!("{}/{path}", base.path().trim_end_matches('/')));
        url
    }

    /// The page of a file's repository, for a person.
    pub(crate) fn page(&self, file: &ModelFile) -> String {
        match file.source {
            Source::Hub { repo, .. } => format!("{}/{repo}", self.hub.as_str().trim_end_matches('/')),
            Source::Torch | Source::Code { .. } => shown(&self.address(file, None)),
        }
    }
}

fn base(text: &str) -> Result<Url, ModelError> {
    let refuse = |reason: &str| {
        // What holds a password is not repeated.
        let address = if text.contains('@') { "(not shown)".to_owned() } else { text.to_owned() };
        ModelError::Address { address, reason: reason.to_owned() }
    };
    let url = Url::parse(text.trim()).map_err(|_| refuse("not an address"))?;
    if !matches!(url.scheme(), "http" | "https") || url.host_str().is_none_or(str::is_empty) {
        return Err(refuse("not an address of http or https"));
    }
    if !url.username().is_empty() || url.password().is_some() || url.query().is_some() || url.fragment().is_some() {
        return Err(refuse("an address may not hold a user, a password or a query"));
    }
    Ok(url)
}

/// Whether a URL points at this machine.
fn is_loopback(url: &Url) -> bool {
    let host = url.host_str().unwrap_or_default();
    let host = host.trim_start_matches('[').trim_end_matches(']');
    host.parse::<std::net::IpAddr>().map_or(host.eq_ignore_ascii_case("localhost"), |ip| ip.is_loopback())
}

/// An address without what signs it.
pub(crate) fn shown(url: &Url) -> String {
    let mut url = url.clone();
    url.set_query(None);
    url.set_fragment(None);
    url.to_string()
}

/// A token of the hub. Its `Debug` prints nothing of it.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl Token {
    /// A token; `None` when the text is empty.
    pub fn new(text: &str) -> Option<Self> {
        let text = text.trim();
        (!text.is_empty()).then(|| Self(text.to_owned()))
    }
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(..)")
    }
}

/// Patience.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PullLimits {
    /// For a connection to stand.
    pub connect: Duration,
    /// Longest silence of a server.
    pub silence: Duration,
    /// Tries in a row that bring nothing before it is given up.
    pub tries: u32,
    /// Wait before the second try; doubled each time.
    pub first_wait: Duration,
    /// Longest wait, even if the server asks for more.
    pub longest_wait: Duration,
}

impl Default for PullLimits {
    fn default() -> Self {
        Self {
            connect: Duration::from_secs(20),
            silence: Duration::from_mins(1),
            tries: 6,
            first_wait: Duration::from_secs(2),
            longest_wait: Duration::from_mins(2),
        }
    }
}

/// How the hub is asked.
#[derive(Debug, Clone)]
pub struct HubOptions {
    /// Addresses.
    pub endpoints: Endpoints,
    /// Token; sent to the hub's own host only, and only encrypted or on this machine.
    pub token: Option<Token>,
    /// Hosts that may be asked beside this machine; `None` = all.
    pub only: Option<Vec<String>>,
    /// Patience.
    pub limits: PullLimits,
}

/// A hub.
#[derive(Debug, Clone)]
pub struct Hub {
    direct: Client,
    proxied: Client,
    pub(crate) options: HubOptions,
}

/// What the hub said of a file before it sent it elsewhere.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Linked {
    /// SHA-256 of a large file.
    pub(crate) sha256: Option<String>,
    /// Its bytes.
    pub(crate) size: Option<u64>,
    /// Commit of the repository.
    pub(crate) commit: Option<String>,
}

/// An answer that holds a file, or a part of it.
pub(crate) struct Answer {
    pub(crate) response: Response,
    pub(crate) linked: Linked,
    /// Where it came from in the end.
    pub(crate) place: String,
}

impl Hub {
    /// Makes the client.
    ///
    /// # Errors
    /// [`ModelError::Address`] when there can be no connection at all.
    pub fn new(options: HubOptions) -> Result<Self, ModelError> {
        // Another part of the program may have chosen already; then that choice holds.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let build = |proxies: bool| {
            let mut builder = Client::builder()
                .redirect(redirect::Policy::none())
                .referer(false)
                .connect_timeout(options.limits.connect)
                .user_agent(concat!("harmony/", env!("CARGO_PKG_VERSION")));
            if !proxies {
                builder = builder.no_proxy();
            }
            builder.build().map_err(|error| ModelError::Address {
                address: options.endpoints.hub.to_string(),
                reason: format!(
                    "no client ({}); install the system's root certificates (package ca-certificates)",
                    causes(&error)
                ),
            })
        };
        Ok(Self { direct: build(false)?, proxied: build(true)?, options })
    }

    /// Asks for a file and follows where the hub sends us.
    pub(crate) async fn get(
        &self,
        name: &str,
        file: &ModelFile,
        commit: Option<&str>,
        range: &[(&'static str, String)],
    ) -> Result<Answer, ModelError> {
        let start = self.options.endpoints.address(file, commit);
        let (mut url, mut linked) = (start.clone(), Linked::default());
        for _ in 0..=MAX_HOPS {
            self.allowed(&url)?;
            let client = if is_loopback(&url) { &self.direct } else { &self.proxied };
            let mut request = client.get(url.clone());
            // A signature in an address is made for the request as it stands: nothing is added but the range.
            for (key, value) in range {
                request = request.header(*key, value);
            }
            let token = self.token_for(file, &url);
            if let Some(value) = &token {
                request = request.header(AUTHORIZATION, value.clone());
            }
            let place = shown(&url);
            let response = tokio::time::timeout(self.options.limits.silence, request.send()).await;
            let broken = |reason: String| ModelError::Broken {
                name: name.to_owned(),
                reason,
                have: 0,
                total: None,
                place: place.clone(),
            };
            let response = response
                .map_err(|_| broken(format!("no answer within {:?}", self.options.limits.silence)))?
                .map_err(|error| broken(causes(&error.without_url())))?;
            if url.origin() == start.origin() {
                linked = linked.or(response.headers());
            }
            if response.status().is_redirection() && response.status() != StatusCode::NOT_MODIFIED {
                let next = response.headers().get(LOCATION).and_then(|v| v.to_str().ok());
                let next = next.and_then(|next| url.join(next).ok());
                let next = next.filter(|next| matches!(next.scheme(), "http" | "https"));
                // From an encrypted address to one that is not: somebody in between could send anything.
                let next = next.filter(|next| url.scheme() == "http" || next.scheme() == "https");
                url = next.ok_or_else(|| ModelError::Answer {
                    name: name.to_owned(),
                    reason: format!("HTTP {} without an address that can be followed", response.status().as_u16()),
                    place: place.clone(),
                    passing: false,
                    after: None,
                })?;
                continue;
            }
            let status = response.status().as_u16();
            if matches!(status, 200 | 206 | 416) {
                return Ok(Answer { response, linked, place });
            }
            return Err(self.refusal(name, file, &response, place, token.is_some()));
        }
        Err(ModelError::Answer {
            name: name.to_owned(),
            reason: format!("more than {MAX_HOPS} redirects"),
            place: shown(&start),
            passing: false,
            after: None,
        })
    }

    fn allowed(&self, url: &Url) -> Result<(), ModelError> {
        let host = url.host_str().unwrap_or_default();
        let named = |only: &Vec<String>| only.iter().any(|name| name.eq_ignore_ascii_case(host));
        if is_loopback(url) || self.options.only.as_ref().is_none_or(named) {
            return Ok(());
        }
        Err(ModelError::Address {
            address: shown(url),
            reason: "players.local_only is set, so that nothing but this machine and players.local_hosts is asked"
                .to_owned(),
        })
    }

    /// The token, if this address may have it.
    fn token_for(&self, file: &ModelFile, url: &Url) -> Option<HeaderValue> {
        let hub = &self.options.endpoints.hub;
        let its_own = matches!(file.source, Source::Hub { .. }) && url.origin() == hub.origin();
        let safe = url.scheme() == "https" || is_loopback(url);
        let token = self.options.token.as_ref().filter(|_| its_own && safe)?;
        let mut value = HeaderValue::from_str(&format!("Bearer {}", token.0)).ok()?;
        value.set_sensitive(true);
        Some(value)
    }

    fn refusal(
        &self,
        name: &str,
        file: &ModelFile,
        response: &Response,
        place: String,
        with_token: bool,
    ) -> ModelError {
        let status = response.status();
        let header = |key: &str| response.headers().get(key).and_then(|v| v.to_str().ok()).map(str::to_owned);
        let (code, message) = (header("x-error-code"), header("x-error-message"));
        let after = header("retry-after").and_then(|text| text.parse().ok());
        let mut words = message
            .or(code)
            .unwrap_or_else(|| status.canonical_reason().unwrap_or("an answer that is no file").to_lowercase());
        if let Some(token) = &self.options.token {
            words = words.replace(&token.0, "(token)");
        }
        let reason: String = words.chars().take(MAX_WORDS).collect();
        let name = name.to_owned();
        match status.as_u16() {
            status @ (401 | 403) => {
                let page = self.options.endpoints.page(file);
                ModelError::Gated { name, status, reason, place, with_token, page }
            }
            404 | 410 => ModelError::NotFound { name, place },
            code => {
                let passing = matches!(code, 408 | 425 | 429 | 500..);
                ModelError::Answer { name, reason: format!("HTTP {code}: {reason}"), place, passing, after }
            }
        }
    }
}

impl Linked {
    fn or(self, headers: &HeaderMap) -> Self {
        let text = |key: &str| headers.get(key).and_then(|v| v.to_str().ok());
        let sha256 = text("x-linked-etag").map(|tag| tag.trim_start_matches("W/").trim_matches('"').to_lowercase());
        // Files that are not large have a Git hash there, of forty digits.
        let sha256 = sha256.filter(|s| s.len() == 64 && s.bytes().all(|b| b.is_ascii_hexdigit()));
        let size = text("x-linked-size").and_then(|v| v.parse().ok());
        let commit = text("x-repo-commit").map(str::to_owned);
        let commit = commit.filter(|c| c.len() == 40 && c.bytes().all(|b| b.is_ascii_hexdigit()));
        Self { sha256: sha256.or(self.sha256), size: size.or(self.size), commit: commit.or(self.commit) }
    }
}

/// An error with its causes, shortest telling first.
pub(crate) fn causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        let words = cause.to_string();
        if !text.contains(&words) {
            text.push_str(": ");
            text.push_str(&words);
        }
        next = cause.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hub(token: Option<&str>, hub: &str) -> Hub {
        let endpoints = Endpoints::new(hub, Endpoints::USUAL[1], Endpoints::USUAL[2]).unwrap();
        let token = token.and_then(Token::new);
        Hub::new(HubOptions { endpoints, token, only: None, limits: PullLimits::default() }).unwrap()
    }

    const FILE: ModelFile = ModelFile {
        name: "model.safetensors",
        path: "model.safetensors",
        source: Source::Hub { repo: "owner/name", revision: None },
        size: None,
        sha256: None,
    };

    #[test]
    fn addresses_are_those_of_hub_and_mirrors() {
        let endpoints =
            Endpoints::new("https://mirror.example/hub/", Endpoints::USUAL[1], Endpoints::USUAL[2]).unwrap();
        assert_eq!(
            endpoints.address(&FILE, None).as_str(),
            "https://mirror.example/hub/owner/name/resolve/main/model.safetensors"
        );
        assert!(endpoints.address(&FILE, Some("abc")).as_str().contains("/resolve/abc/"));
        let torch = ModelFile { source: Source::Torch, ..FILE };
        assert_eq!(endpoints.address(&torch, None).path(), "/models/model.safetensors");
        for wrong in ["ftp://h", "not an address", "https://me:secret@h", "https://h/?key=1"] {
            let error = Endpoints::new(wrong, Endpoints::USUAL[1], Endpoints::USUAL[2]).unwrap_err().to_string();
            assert!(!error.contains("secret"), "{error}");
        }
    }

    #[test]
    fn the_token_goes_to_the_hub_alone_and_is_not_printed() {
        let url = |text: &str| Url::parse(text).unwrap();
        let https = hub(Some("hf_canary"), "https://hub.example");
        assert!(https.token_for(&FILE, &url("https://hub.example/x")).is_some());
        for other in ["https://cdn.example/x", "https://hub.example:8443/x", "http://hub.example/x"] {
            assert!(https.token_for(&FILE, &url(other)).is_none(), "{other}");
        }
        let torch = ModelFile { source: Source::Torch, ..FILE };
        assert!(https.token_for(&torch, &url("https://hub.example/x")).is_none(), "not a file of the hub");
        let plain = hub(Some("hf_canary"), "http://hub.example");
        assert!(plain.token_for(&FILE, &url("http://hub.example/x")).is_none(), "not in the clear");
        assert!(!format!("{https:?}").contains("canary"));
    }
}
