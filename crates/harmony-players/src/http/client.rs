//! The client: one request, one answer, within limits.

use std::sync::Arc;
use std::time::Duration;

use harmony_calls::{Secret, shortened};
use harmony_roles::RoleError;
use reqwest::header::{HeaderName, HeaderValue};
use reqwest::{Client, Url, redirect};
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::address::{AddressError, LocalHosts, LocalResolver, is_loopback, join, parse_address};
use super::failure::{MAX_RAW, failure};
use super::file::{FileLink, PublicResolver, proxy_is_set};
use super::key::ApiKey;

/// Deadlines and sizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HttpLimits {
    /// Longest silence while the answer's body comes.
    pub silence: Duration,
    /// The whole call, from the first byte sent to the last one received.
    pub total: Duration,
    /// Largest answer, bytes.
    pub answer_bytes: u64,
}

impl Default for HttpLimits {
    fn default() -> Self {
        Self { silence: Duration::from_mins(1), total: Duration::from_mins(10), answer_bytes: 64 << 20 }
    }
}

/// How a request proves who asks.
#[derive(Debug, Clone)]
pub enum Auth {
    /// It does not.
    None,
    /// `Authorization: Bearer KEY`.
    Bearer(ApiKey),
    /// The key in a header of this name.
    Header(&'static str, ApiKey),
    /// `Authorization: SCHEME KEY`, where the scheme is another word than `Bearer`.
    Scheme(&'static str, ApiKey),
}

impl Auth {
    fn key(&self) -> Option<&ApiKey> {
        match self {
            Self::None => None,
            Self::Bearer(key) | Self::Header(_, key) | Self::Scheme(_, key) => Some(key),
        }
    }
}

/// The connections that players share.
#[derive(Debug, Clone)]
pub struct Http {
    /// Without a proxy.
    direct: Client,
    /// With the proxies of the environment.
    proxied: Client,
    /// For files at addresses that an answer names: without a proxy, and public addresses only.
    public: Client,
    local: Option<Arc<LocalHosts>>,
}

impl Http {
    /// Makes the client; a connection has to stand within `connect`. With `local` given, nothing else can be reached.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`] when the system's certificates can't be used.
    pub fn new(local: Option<LocalHosts>, connect: Duration) -> Result<Self, RoleError> {
        // Another part of the program may have chosen already; then that choice holds.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let local = local.map(Arc::new);
        let build = |proxies: bool, public: bool| {
            let mut builder = Client::builder()
                .redirect(redirect::Policy::none())
                .referer(false)
                .connect_timeout(connect)
                .user_agent(concat!("harmony/", env!("CARGO_PKG_VERSION")))
                .pool_idle_timeout(Duration::from_secs(30))
                // Whether and when something is tried again is decided in one place, and that is not here.
                .retry(reqwest::retry::never());
            if !proxies || local.is_some() {
                builder = builder.no_proxy();
            }
            if let Some(local) = &local {
                builder = builder.dns_resolver(Arc::new(LocalResolver(Arc::clone(local))));
            } else if public {
                builder = builder.dns_resolver(Arc::new(PublicResolver));
            }
            builder.build().map_err(|error| RoleError::NotSetUp {
                player: "http".to_owned(),
                reason: causes(&error),
                hint: "install the system's root certificates (package ca-certificates), or name a file of them in \
                       SSL_CERT_FILE"
                    .to_owned(),
            })
        };
        Ok(Self { direct: build(false, false)?, proxied: build(true, false)?, public: build(false, true)?, local })
    }
}

/// Where a player's service is and how it is spoken to.
#[derive(Debug, Clone)]
pub struct ServiceOptions {
    /// Name of the player, for errors.
    pub player: String,
    /// Base address.
    pub address: String,
    /// Key.
    pub auth: Auth,
    /// Deadlines and sizes.
    pub limits: HttpLimits,
    /// What to do when the service does not accept what it is asked.
    pub remedy: String,
}

/// A service at an address that was found acceptable.
#[derive(Debug, Clone)]
pub struct Service {
    http: Http,
    options: ServiceOptions,
    base: Url,
}

/// How a request is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the methods of HTTP")]
pub enum Method {
    Get,
    Post,
    Put,
}

/// One request, below the base address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HttpRequest {
    /// Method.
    pub method: Method,
    /// Path below the base address.
    pub path: String,
    /// Further headers.
    pub headers: Vec<(&'static str, String)>,
    /// Content type and body.
    pub body: Option<(String, Vec<u8>)>,
}

impl HttpRequest {
    /// Asks for a path.
    pub fn get(path: &str) -> Self {
        Self { method: Method::Get, path: path.to_owned(), headers: vec![], body: None }
    }

    /// Sends nothing to a path.
    pub fn empty(method: Method, path: &str) -> Self {
        Self { method, path: path.to_owned(), headers: vec![], body: None }
    }

    /// Sends JSON to a path.
    pub fn post_json(path: &str, body: &Value) -> Self {
        let body = Some(("application/json".to_owned(), body.to_string().into_bytes()));
        Self { method: Method::Post, path: path.to_owned(), headers: vec![], body }
    }

    /// Sends a form with files to a path.
    pub fn post_form(path: &str, fields: &[super::multipart::Field]) -> Self {
        let body = Some(super::multipart::encode(fields));
        Self { method: Method::Post, path: path.to_owned(), headers: vec![], body }
    }

    /// With a further header.
    #[must_use]
    pub fn header(mut self, name: &'static str, value: &str) -> Self {
        self.headers.push((name, value.to_owned()));
        self
    }
}

/// Longest window of a rate: mostly it is a minute, at times an hour.
const LONGEST_WINDOW: Duration = Duration::from_hours(1);

/// What was read from an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Received<T> {
    /// What.
    pub value: T,
    /// See [`HttpAnswer::closed_for`].
    pub closed_for: Option<Duration>,
}

/// An answer, whatever its status. The service's key is blotted out in it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct HttpAnswer {
    /// Status.
    pub status: u16,
    /// Headers, names in small letters.
    pub headers: Vec<(String, String)>,
    /// Body.
    pub body: Vec<u8>,
}

impl HttpAnswer {
    /// A header's value.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }

    /// The body as text, broken characters replaced.
    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    /// For how long the service takes nothing more: until the reset of a rate of which nothing remains. `None` when it
    /// does not say, or speaks of a day's quota rather than of a rate.
    pub fn closed_for(&self) -> Option<Duration> {
        super::wait::used_up(self).filter(|wait| self.is_success() && *wait <= LONGEST_WINDOW)
    }

    /// Whether it is a success.
    pub fn is_success(&self) -> bool {
        (200..300).contains(&self.status)
    }
}

impl Service {
    /// Looks at the address before anything is sent.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`] for an address that is none, that is not on this machine when it must be, or that a key
    /// would reach unencrypted.
    pub fn new(http: &Http, options: ServiceOptions) -> Result<Self, RoleError> {
        let refuse = |error: &AddressError, hint: &str| RoleError::NotSetUp {
            player: options.player.clone(),
            reason: error.to_string(),
            hint: hint.to_owned(),
        };
        let base = parse_address(&options.address)
            .map_err(|error| refuse(&error, "write the address as http://host:port or https://host/path"))?;
        let host = base.host_str().unwrap_or_default().to_owned();
        let trusted = http.local.as_ref().map_or_else(|| is_loopback(&base), |local| local.contain(&base));
        if http.local.is_some() && !trusted {
            let hint = "cast a local player for this role, or name the host in `players.local_hosts`";
            return Err(refuse(&AddressError::NotLocal { host }, hint));
        }
        if options.auth.key().is_some() && base.scheme() == "http" && !trusted {
            return Err(refuse(&AddressError::KeyInTheClear { host }, "use an https address"));
        }
        Ok(Self { http: http.clone(), options, base })
    }

    /// Name of the player.
    pub fn player(&self) -> &str {
        &self.options.player
    }

    /// Base address.
    pub fn address(&self) -> &str {
        self.base.as_str()
    }

    /// The key, for whoever writes files.
    pub fn secret(&self) -> Option<Secret> {
        self.options.auth.key().map(ApiKey::secret)
    }

    /// Deadlines and sizes.
    pub fn limits(&self) -> &HttpLimits {
        &self.options.limits
    }

    /// A text without the key.
    pub fn scrubbed(&self, text: &str) -> String {
        self.options.auth.key().map_or_else(|| text.to_owned(), |key| key.scrubbed(text))
    }

    /// Sends a request and reads the answer, whatever its status.
    ///
    /// # Errors
    /// [`RoleError::Unavailable`] when no answer comes in time or the connection breaks;
    /// [`RoleError::UnusableAnswer`] when it is too large.
    pub async fn send(&self, request: &HttpRequest) -> Result<HttpAnswer, RoleError> {
        match tokio::time::timeout(self.options.limits.total, self.exchange(request)).await {
            Ok(answer) => answer,
            Err(_) => Err(self.unavailable(format!("no whole answer within {:?}", self.options.limits.total))),
        }
    }

    /// Sends a request and reads the answer; anything but a success is an error.
    ///
    /// # Errors
    /// As [`Service::send`], and by status ([`failure`]).
    pub async fn call(&self, request: &HttpRequest) -> Result<HttpAnswer, RoleError> {
        let answer = self.send(request).await?;
        if answer.is_success() { Ok(answer) } else { Err(self.failure(&answer)) }
    }

    /// As [`Service::call`], the answer being JSON of some form.
    ///
    /// # Errors
    /// As [`Service::call`]; [`RoleError::UnusableAnswer`] when it is not that.
    pub async fn call_json<T: DeserializeOwned>(&self, request: &HttpRequest) -> Result<Received<T>, RoleError> {
        let answer = self.call(request).await?;
        let value = serde_json::from_slice(&answer.body).map_err(|error| {
            self.unusable(format!("its answer is not the JSON that was expected: {error}"), &answer.text())
        })?;
        Ok(Received { value, closed_for: answer.closed_for() })
    }

    /// The error of an answer that is not a success.
    pub fn failure(&self, answer: &HttpAnswer) -> RoleError {
        let mut clean = answer.clone();
        clean.body = self.scrubbed(&answer.text()).into_bytes();
        for (_, value) in &mut clean.headers {
            *value = self.scrubbed(value);
        }
        failure(&self.options.player, &clean, &self.options.remedy)
    }

    /// An answer that can't be used.
    pub fn unusable(&self, complaint: impl Into<String>, raw: &str) -> RoleError {
        RoleError::UnusableAnswer {
            player: self.options.player.clone(),
            complaint: self.scrubbed(&complaint.into()),
            raw: shortened(&self.scrubbed(raw), MAX_RAW),
        }
    }

    /// A refusal.
    pub fn refused(&self, reason: &str) -> RoleError {
        RoleError::Refused { player: self.options.player.clone(), reason: shortened(&self.scrubbed(reason), MAX_RAW) }
    }

    /// A passing failure without a status.
    pub fn unavailable(&self, reason: impl Into<String>) -> RoleError {
        RoleError::Unavailable {
            player: self.options.player.clone(),
            reason: self.scrubbed(&reason.into()),
            status: None,
            retry_after: None,
        }
    }

    /// A failure of the configuration.
    pub fn not_set_up(&self, reason: impl Into<String>, hint: impl Into<String>) -> RoleError {
        RoleError::NotSetUp {
            player: self.options.player.clone(),
            reason: self.scrubbed(&reason.into()),
            hint: hint.into(),
        }
    }

    async fn exchange(&self, request: &HttpRequest) -> Result<HttpAnswer, RoleError> {
        let url = join(&self.base, &request.path);
        let client = if is_loopback(&url) { &self.http.direct } else { &self.http.proxied };
        let mut building = match request.method {
            Method::Get => client.get(url),
            Method::Post => client.post(url),
            Method::Put => client.put(url),
        };
        for (name, value) in &request.headers {
            building = building.header(*name, value);
        }
        building = match &self.options.auth {
            Auth::None => building,
            Auth::Bearer(key) => {
                building.header(reqwest::header::AUTHORIZATION, hidden(&format!("Bearer {}", key.expose()))?)
            }
            Auth::Header(name, key) => building.header(HeaderName::from_static(name), hidden(key.expose())?),
            Auth::Scheme(scheme, key) => {
                building.header(reqwest::header::AUTHORIZATION, hidden(&format!("{scheme} {}", key.expose()))?)
            }
        };
        if let Some((content_type, body)) = &request.body {
            building = building.header(reqwest::header::CONTENT_TYPE, content_type).body(body.clone());
        }
        let mut answer = self.received(building, &self.base).await?;
        if let Some(key) = self.options.auth.key() {
            key.blot_out(&mut answer.body);
        }
        Ok(answer)
    }

    /// Takes a link to a file out of an answer. No answer is trusted with where it leads: to the service's own address,
    /// or encrypted to a public host by its name; never to this machine or its network.
    ///
    /// # Errors
    /// [`RoleError::UnusableAnswer`]; the link's query, which may be a signature, is not part of it.
    pub fn file_link(&self, text: &str) -> Result<FileLink, RoleError> {
        FileLink::read(text, &self.base, self.http.local.as_deref())
            .map_err(|reason| self.unusable(format!("the link to its file is not followed: {reason}"), ""))
    }

    /// Fetches a file, whatever the status. The key is not sent; no redirect is followed.
    ///
    /// # Errors
    /// As [`Service::send`].
    pub async fn fetch(&self, link: &FileLink) -> Result<HttpAnswer, RoleError> {
        let client = match link {
            FileLink::Own(url) if is_loopback(url) => &self.http.direct,
            FileLink::Own(_) => &self.http.proxied,
            // A proxy resolves names itself, and may stand in the network of this machine.
            FileLink::Public(_) if proxy_is_set() => &self.http.proxied,
            FileLink::Public(_) => &self.http.public,
        };
        let building = client.get(link.url().clone());
        match tokio::time::timeout(self.options.limits.total, self.received(building, link.url())).await {
            Ok(answer) => answer,
            Err(_) => Err(self.unavailable(format!("no whole file within {:?}", self.options.limits.total))),
        }
    }

    /// Sends what is built and reads the answer within the limits.
    async fn received(&self, building: reqwest::RequestBuilder, to: &Url) -> Result<HttpAnswer, RoleError> {
        let broken = |error: &reqwest::Error| self.broken(error, to);
        let mut response = building.send().await.map_err(|error| broken(&error))?;
        let mut answer = HttpAnswer {
            status: response.status().as_u16(),
            headers: response
                .headers()
                .iter()
                .map(|(k, v)| (k.as_str().to_owned(), String::from_utf8_lossy(v.as_bytes()).into_owned()))
                .collect(),
            body: Vec::new(),
        };
        let limit = self.options.limits.answer_bytes;
        let too_large =
            |bytes: String| self.unusable(format!("the answer has {bytes} bytes; at most {limit} are read"), "");
        if let Some(length) = response.content_length() {
            if length > limit {
                return Err(too_large(length.to_string()));
            }
            answer.body.reserve(usize::try_from(length).unwrap_or_default());
        }
        loop {
            let Ok(chunk) = tokio::time::timeout(self.options.limits.silence, response.chunk()).await else {
                let silence = self.options.limits.silence;
                return Err(self.unavailable(format!("the answer stalled for {silence:?}")));
            };
            let chunk = chunk.map_err(|error| broken(&error))?;
            let Some(chunk) = chunk else { break };
            if (answer.body.len() + chunk.len()) as u64 > limit {
                return Err(too_large(format!("more than {limit}")));
            }
            answer.body.extend_from_slice(&chunk);
        }
        Ok(answer)
    }

    /// The error of an exchange that broke off.
    fn broken(&self, error: &reqwest::Error, to: &Url) -> RoleError {
        let reason = causes(error);
        if reason.contains("is set") && self.http.local.is_some() && error.is_connect() {
            return self.not_set_up(reason, "cast a local player for this role, or name the host as local");
        }
        if error.is_builder() || error.is_request() && !error.is_connect() && !error.is_timeout() && !error.is_body() {
            // What is sent cannot be a request, or the connection broke before an answer began.
            return self.unavailable(format!("the request could not be made: {reason}"));
        }
        let what = if error.is_timeout() {
            "no answer in time"
        } else if error.is_connect() {
            "no connection"
        } else {
            "the connection broke"
        };
        let host = to.host_str().unwrap_or_default();
        let port = to.port_or_known_default().unwrap_or_default();
        self.unavailable(format!("{what}: {reason}: {host}:{port}"))
    }
}

/// A header value that no log shows.
fn hidden(text: &str) -> Result<HeaderValue, RoleError> {
    let mut value = HeaderValue::from_str(text).map_err(|_| RoleError::NotSetUp {
        player: "http".to_owned(),
        reason: "the key cannot stand in a header".to_owned(),
        hint: "check the environment variable that holds it".to_owned(),
    })?;
    value.set_sensitive(true);
    Ok(value)
}

/// An error and its causes in one line, without the address (which is told once, at the end).
fn causes(error: &reqwest::Error) -> String {
    let mut text = String::new();
    let mut cause: Option<&(dyn std::error::Error + 'static)> = std::error::Error::source(error);
    while let Some(error) = cause {
        let said = error.to_string();
        if !text.contains(&said) {
            if !text.is_empty() {
                text.push_str(": ");
            }
            text.push_str(&said);
        }
        cause = error.source();
    }
    if text.is_empty() { "unknown reason".to_owned() } else { shortened(&text, 300) }
}
