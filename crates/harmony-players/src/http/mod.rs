//! One HTTP client for all hosted and local players.
//!
//! * Every request has a deadline for connecting, for silence while the answer comes, and for the whole.
//! * Answers are read up to a limit; a larger one is refused without being held.
//! * Redirects are not followed, wherever they lead.
//! * Proxies come from the environment only (`HTTPS_PROXY`, `HTTP_PROXY`, `ALL_PROXY`, `NO_PROXY`), and loopback
//!   addresses are reached without one.
//! * With [`LocalHosts`] given, whatever is not loopback or named local cannot be reached: not by address, not by a
//!   name that resolves elsewhere, not through a proxy.
//! * Files at addresses that an answer names are fetched without the key, from the service itself or from public hosts.
//! * Keys come from the environment, travel in one header, not over an unencrypted line to another machine, and are
//!   taken out of everything that comes back.

mod address;
mod client;
mod failure;
mod file;
mod key;
pub mod multipart;
mod price;
mod wait;

pub use address::{AddressError, LocalHosts, is_loopback, parse_address};
pub use client::{Auth, Http, HttpAnswer, HttpLimits, HttpRequest, Method, Received, Service, ServiceOptions};
pub use failure::{Complaint, MAX_RAW, complaint, failure};
pub use file::FileLink;
pub use key::{ApiKey, KeyError, check_variable};
pub use price::Tokens;
pub use wait::{http_date, retry_after, rfc3339, spelled};
